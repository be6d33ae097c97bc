"""contactfusion tells a robot where it touches the world, from whatever sensors it has.

Names are imported when first used, so that the command line answers at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contactfusion.contacts import Contact
    from contactfusion.controller import Command, Controller
    from contactfusion.errors import ContactFusionError
    from contactfusion.generator import Generator, GeneratorConfig, OfRobot
    from contactfusion.grid import Grid
    from contactfusion.hooks import hookimpl
    from contactfusion.hypotheses import ContactHypothesis, HypothesisCloud, HypothesisKind, Note
    from contactfusion.integrator.config import IntegratorConfig
    from contactfusion.integrator.fusion import Fusion
    from contactfusion.integrator.integrator import Integrator
    from contactfusion.pipeline import Pipeline, Step
    from contactfusion.pipeline_config import PipelineConfig
    from contactfusion.readings import (
        DepthImage,
        JointCommand,
        JointState,
        Markers,
        ObjectPose,
        Odometry,
        PointCloud,
        Reading,
        Switch,
        TactileImage,
        Transform,
        Twist,
        Wrench,
    )
    from contactfusion.recordings.opening import open_recording
    from contactfusion.recordings.recording import Recording
    from contactfusion.rule import Condensation, Rule
    from contactfusion.runner import Runner
    from contactfusion.running import run_file
    from contactfusion.scene import Scene
    from contactfusion.segmenter import Segmenter, SegmenterConfig
    from contactfusion.state import State
    from contactfusion.surface import Surface
    from contactfusion.view.plot import plot_fusion

_HOMES = {
    "Command": "contactfusion.controller",
    "Condensation": "contactfusion.rule",
    "Contact": "contactfusion.contacts",
    "ContactFusionError": "contactfusion.errors",
    "ContactHypothesis": "contactfusion.hypotheses",
    "Controller": "contactfusion.controller",
    "DepthImage": "contactfusion.readings",
    "Fusion": "contactfusion.integrator.fusion",
    "Generator": "contactfusion.generator",
    "GeneratorConfig": "contactfusion.generator",
    "Grid": "contactfusion.grid",
    "HypothesisCloud": "contactfusion.hypotheses",
    "HypothesisKind": "contactfusion.hypotheses",
    "Integrator": "contactfusion.integrator.integrator",
    "IntegratorConfig": "contactfusion.integrator.config",
    "JointCommand": "contactfusion.readings",
    "JointState": "contactfusion.readings",
    "Markers": "contactfusion.readings",
    "Note": "contactfusion.hypotheses",
    "ObjectPose": "contactfusion.readings",
    "Odometry": "contactfusion.readings",
    "OfRobot": "contactfusion.generator",
    "Pipeline": "contactfusion.pipeline",
    "PipelineConfig": "contactfusion.pipeline_config",
    "PointCloud": "contactfusion.readings",
    "Reading": "contactfusion.readings",
    "Recording": "contactfusion.recordings.recording",
    "Rule": "contactfusion.rule",
    "Runner": "contactfusion.runner",
    "Scene": "contactfusion.scene",
    "Segmenter": "contactfusion.segmenter",
    "SegmenterConfig": "contactfusion.segmenter",
    "State": "contactfusion.state",
    "Step": "contactfusion.pipeline",
    "Surface": "contactfusion.surface",
    "Switch": "contactfusion.readings",
    "TactileImage": "contactfusion.readings",
    "Transform": "contactfusion.readings",
    "Twist": "contactfusion.readings",
    "Wrench": "contactfusion.readings",
    "hookimpl": "contactfusion.hooks",
    "open_recording": "contactfusion.recordings.opening",
    "plot_fusion": "contactfusion.view.plot",
    "run_file": "contactfusion.running",
}

__all__ = [
    "Command",
    "Condensation",
    "Contact",
    "ContactFusionError",
    "ContactHypothesis",
    "Controller",
    "DepthImage",
    "Fusion",
    "Generator",
    "GeneratorConfig",
    "Grid",
    "HypothesisCloud",
    "HypothesisKind",
    "Integrator",
    "IntegratorConfig",
    "JointCommand",
    "JointState",
    "Markers",
    "Note",
    "ObjectPose",
    "Odometry",
    "OfRobot",
    "Pipeline",
    "PipelineConfig",
    "PointCloud",
    "Reading",
    "Recording",
    "Rule",
    "Runner",
    "Scene",
    "Segmenter",
    "SegmenterConfig",
    "State",
    "Step",
    "Surface",
    "Switch",
    "TactileImage",
    "Transform",
    "Twist",
    "Wrench",
    "hookimpl",
    "open_recording",
    "plot_fusion",
    "run_file",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'contactfusion' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
