"""The hooks by which a plug-in offers its classes; each gives a mapping of names to classes."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    from contactfusion.controller import Controller
    from contactfusion.generator import Generator
    from contactfusion.recordings.recording import RecordingFormat
    from contactfusion.rule import Condensation, Rule
    from contactfusion.scene import Scene
    from contactfusion.segmenter import Segmenter

GROUP = "contactfusion"
"""The group of entry points, and the prefix of all hooks."""

hookspec = pluggy.HookspecMarker(GROUP)
hookimpl = pluggy.HookimplMarker(GROUP)


@hookspec
def contactfusion_generators() -> "Mapping[str, type[Generator[Any]]]":
    """Offer generators: readings in, clouds of hypotheses out."""
    return {}


@hookspec
def contactfusion_controllers() -> "Mapping[str, type[Controller]]":
    """Offer controllers: contacts in, commands out."""
    return {}


@hookspec
def contactfusion_rules() -> "Mapping[str, type[Rule]]":
    """Offer rules: how the likelihoods of several sources in one voxel combine."""
    return {}


@hookspec
def contactfusion_condensations() -> "Mapping[str, type[Condensation]]":
    """Offer condensations: how a field of likelihoods becomes contacts."""
    return {}


@hookspec
def contactfusion_segmenters() -> "Mapping[str, type[Segmenter[Any]]]":
    """Offer segmenters: which pixels of an image belong to the object."""
    return {}


@hookspec
def contactfusion_recordings() -> "Mapping[str, type[RecordingFormat]]":
    """Offer recordings: files whose readings are played."""
    return {}


@hookspec
def contactfusion_scenes() -> "Mapping[str, type[Scene]]":
    """Offer scenes: what a simulated robot does while a pipeline listens."""
    return {}
