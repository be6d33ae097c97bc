"""contactfusion tells a robot where it touches the world, from whatever sensors it has.

`import contactfusion as cf` is enough for users and plug-ins; what is not listed here may move.
Names are imported when first used, so that the command line answers at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contactfusion.check import check_file
    from contactfusion.contacts import Contact, Contacts
    from contactfusion.controller import Command, Controller
    from contactfusion.controllers.pushing import Decision, PushingConfig, PushingController
    from contactfusion.errors import ContactFusionError
    from contactfusion.explain.text import explain_fusion, explain_moment
    from contactfusion.generator import Generator, GeneratorConfig, OfRobot
    from contactfusion.generators.baselines import fit_baseline
    from contactfusion.generators.compensation import fit_compensation
    from contactfusion.generators.taxel_map import TaxelMap
    from contactfusion.grid import Grid
    from contactfusion.hooks import hookimpl
    from contactfusion.hypotheses import ContactHypothesis, HypothesisCloud, HypothesisKind, Note
    from contactfusion.identify.identification import identify_file
    from contactfusion.integrator.config import IntegratorConfig
    from contactfusion.integrator.entries import Field
    from contactfusion.integrator.fusion import Fusion
    from contactfusion.integrator.integrator import Integrator
    from contactfusion.loop import Observer, play
    from contactfusion.model import Model
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
    from contactfusion.readings.canvas import Canvas
    from contactfusion.readings.codec import Codec, Role
    from contactfusion.readings.columns import ColumnsConfig
    from contactfusion.readings.messages import message
    from contactfusion.readings.values import ElementValues, PointValues, Values
    from contactfusion.reason import Reason
    from contactfusion.recordings.mcap import McapWriter
    from contactfusion.recordings.opening import open_recording
    from contactfusion.recordings.recording import Recording, RecordingFormat
    from contactfusion.robots.description import read_robot
    from contactfusion.robots.model import RobotModel
    from contactfusion.rule import Condensation, Rule
    from contactfusion.run.execute import run_file
    from contactfusion.runner import Runner
    from contactfusion.scene import Scene, open_scene
    from contactfusion.segmenter import Segmenter, SegmenterConfig
    from contactfusion.shapes import ShapeConfig
    from contactfusion.state import State
    from contactfusion.stream import Arrival, Facts, Stream, Verdict
    from contactfusion.surface import Surface
    from contactfusion.testing import check_codec, check_generator
    from contactfusion.view.plot import plot_fusion
    from contactfusion.view.viewer import Viewer

_HOMES = {
    "Arrival": "contactfusion.stream",
    "Canvas": "contactfusion.readings.canvas",
    "Codec": "contactfusion.readings.codec",
    "ColumnsConfig": "contactfusion.readings.columns",
    "Command": "contactfusion.controller",
    "Condensation": "contactfusion.rule",
    "Contact": "contactfusion.contacts",
    "Contacts": "contactfusion.contacts",
    "ContactFusionError": "contactfusion.errors",
    "ContactHypothesis": "contactfusion.hypotheses",
    "Controller": "contactfusion.controller",
    "Decision": "contactfusion.controllers.pushing",
    "DepthImage": "contactfusion.readings",
    "ElementValues": "contactfusion.readings.values",
    "Facts": "contactfusion.stream",
    "Field": "contactfusion.integrator.entries",
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
    "McapWriter": "contactfusion.recordings.mcap",
    "Model": "contactfusion.model",
    "Note": "contactfusion.hypotheses",
    "ObjectPose": "contactfusion.readings",
    "Observer": "contactfusion.loop",
    "Odometry": "contactfusion.readings",
    "OfRobot": "contactfusion.generator",
    "Pipeline": "contactfusion.pipeline",
    "PipelineConfig": "contactfusion.pipeline_config",
    "PointCloud": "contactfusion.readings",
    "PointValues": "contactfusion.readings.values",
    "PushingConfig": "contactfusion.controllers.pushing",
    "PushingController": "contactfusion.controllers.pushing",
    "Reading": "contactfusion.readings",
    "Reason": "contactfusion.reason",
    "Recording": "contactfusion.recordings.recording",
    "RecordingFormat": "contactfusion.recordings.recording",
    "RobotModel": "contactfusion.robots.model",
    "Role": "contactfusion.readings.codec",
    "Rule": "contactfusion.rule",
    "Runner": "contactfusion.runner",
    "Scene": "contactfusion.scene",
    "Segmenter": "contactfusion.segmenter",
    "SegmenterConfig": "contactfusion.segmenter",
    "ShapeConfig": "contactfusion.shapes",
    "State": "contactfusion.state",
    "Step": "contactfusion.pipeline",
    "Stream": "contactfusion.stream",
    "Surface": "contactfusion.surface",
    "Switch": "contactfusion.readings",
    "TactileImage": "contactfusion.readings",
    "TaxelMap": "contactfusion.generators.taxel_map",
    "Transform": "contactfusion.readings",
    "Twist": "contactfusion.readings",
    "Values": "contactfusion.readings.values",
    "Verdict": "contactfusion.stream",
    "Viewer": "contactfusion.view.viewer",
    "Wrench": "contactfusion.readings",
    "check_codec": "contactfusion.testing",
    "check_file": "contactfusion.check",
    "check_generator": "contactfusion.testing",
    "explain_fusion": "contactfusion.explain.text",
    "explain_moment": "contactfusion.explain.text",
    "fit_baseline": "contactfusion.generators.baselines",
    "fit_compensation": "contactfusion.generators.compensation",
    "hookimpl": "contactfusion.hooks",
    "identify_file": "contactfusion.identify.identification",
    "message": "contactfusion.readings.messages",
    "open_recording": "contactfusion.recordings.opening",
    "open_scene": "contactfusion.scene",
    "play": "contactfusion.loop",
    "plot_fusion": "contactfusion.view.plot",
    "read_robot": "contactfusion.robots.description",
    "run_file": "contactfusion.run.execute",
}

__all__ = [
    "Arrival",
    "Canvas",
    "Codec",
    "ColumnsConfig",
    "Command",
    "Condensation",
    "Contact",
    "ContactFusionError",
    "ContactHypothesis",
    "Contacts",
    "Controller",
    "Decision",
    "DepthImage",
    "ElementValues",
    "Facts",
    "Field",
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
    "McapWriter",
    "Model",
    "Note",
    "ObjectPose",
    "Observer",
    "Odometry",
    "OfRobot",
    "Pipeline",
    "PipelineConfig",
    "PointCloud",
    "PointValues",
    "PushingConfig",
    "PushingController",
    "Reading",
    "Reason",
    "Recording",
    "RecordingFormat",
    "RobotModel",
    "Role",
    "Rule",
    "Runner",
    "Scene",
    "Segmenter",
    "SegmenterConfig",
    "ShapeConfig",
    "State",
    "Step",
    "Stream",
    "Surface",
    "Switch",
    "TactileImage",
    "TaxelMap",
    "Transform",
    "Twist",
    "Values",
    "Verdict",
    "Viewer",
    "Wrench",
    "check_codec",
    "check_file",
    "check_generator",
    "explain_fusion",
    "explain_moment",
    "fit_baseline",
    "fit_compensation",
    "hookimpl",
    "identify_file",
    "message",
    "open_recording",
    "open_scene",
    "play",
    "plot_fusion",
    "read_robot",
    "run_file",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'contactfusion' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
