"""contactfusion tells a robot where it touches the world, from whatever sensors it has.

Names are imported when first used, so that the command line answers at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contactfusion.contacts import Contact
    from contactfusion.controller import Command, Controller
    from contactfusion.errors import ContactFusionError
    from contactfusion.generator import Generator, GeneratorConfig
    from contactfusion.grid import Grid
    from contactfusion.hooks import hookimpl
    from contactfusion.hypotheses import ContactHypothesis, HypothesisCloud, HypothesisKind, Note
    from contactfusion.integrator.config import IntegratorConfig
    from contactfusion.integrator.fusion import Fusion
    from contactfusion.integrator.integrator import Integrator
    from contactfusion.pipeline import Pipeline, Step
    from contactfusion.pipeline_config import PipelineConfig
    from contactfusion.readings import Reading
    from contactfusion.recordings.recording import Recording
    from contactfusion.state import State
    from contactfusion.surface import Surface

_HOMES = {
    "Command": "contactfusion.controller",
    "Contact": "contactfusion.contacts",
    "ContactFusionError": "contactfusion.errors",
    "ContactHypothesis": "contactfusion.hypotheses",
    "Controller": "contactfusion.controller",
    "Fusion": "contactfusion.integrator.fusion",
    "Generator": "contactfusion.generator",
    "GeneratorConfig": "contactfusion.generator",
    "Grid": "contactfusion.grid",
    "HypothesisCloud": "contactfusion.hypotheses",
    "HypothesisKind": "contactfusion.hypotheses",
    "Integrator": "contactfusion.integrator.integrator",
    "IntegratorConfig": "contactfusion.integrator.config",
    "Note": "contactfusion.hypotheses",
    "Pipeline": "contactfusion.pipeline",
    "PipelineConfig": "contactfusion.pipeline_config",
    "Reading": "contactfusion.readings",
    "Recording": "contactfusion.recordings.recording",
    "State": "contactfusion.state",
    "Step": "contactfusion.pipeline",
    "Surface": "contactfusion.surface",
    "hookimpl": "contactfusion.hooks",
}

__all__ = [
    "Command",
    "Contact",
    "ContactFusionError",
    "ContactHypothesis",
    "Controller",
    "Fusion",
    "Generator",
    "GeneratorConfig",
    "Grid",
    "HypothesisCloud",
    "HypothesisKind",
    "Integrator",
    "IntegratorConfig",
    "Note",
    "Pipeline",
    "PipelineConfig",
    "Reading",
    "Recording",
    "State",
    "Step",
    "Surface",
    "hookimpl",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'contactfusion' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
