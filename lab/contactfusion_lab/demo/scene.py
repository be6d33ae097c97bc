"""The push of the demo: its scene file for `contactfusion run`, and its cycles."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from contactfusion.contacts import Contact
from contactfusion.controllers.face import FaceConfig, FaceContact, on_face
from contactfusion.controllers.pushing_law import place_of
from contactfusion.errors import ConfigurationError
from contactfusion.faults import Faults
from contactfusion.generators.networks import shipped
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.fusion import Fusion
from contactfusion.pipeline import Pipeline, Step
from contactfusion.readings import Reading
from contactfusion.run.configuration import RunConfig
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.experiments.push.suites import SENSINGS
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import Ending, PushScene, PushTruth, pushed

LEARNED = "lidar_cpm"
"""Type of the generator that reads the LiDAR, unless another is asked for."""
SKIN = "skin"
"""The sensor that dies."""
DIES = 10.0
"""Time at which it dies, about half-way [s]."""
TARGET = (-2.4, -1.2)
"""Target of the contact, behind the robot and to its right [m]."""
YAW = 20.0
"""Yaw of the box: its corner touches first [degrees]."""
LONGEST = 60.0
"""Time limit of the push [s]."""
HEAD = """\
# The push of the demo. Run it again, change it, break something else:
#   contactfusion run scene.yaml
#   contactfusion run scene.yaml --set faults.0.start=5 --set faults.0.sensor=lidar
"""
FACE = FaceConfig()


def scene_fields(lidar: str = LEARNED) -> dict[str, Any]:
    """The scene: the fused sensing of the push experiment, with a skin that falls silent.

    Args:
        lidar: the type of the generator that reads the LiDAR.

    Raises:
        ConfigurationError: the networks of that generator are missing.
    """
    if lidar == LEARNED and not shipped().is_file():
        raise ConfigurationError(
            f"the demo reads its LiDAR with networks that come with contactfusion, but {shipped()} "
            "is missing; install contactfusion again"
        )
    fused = read_yaml(SENSINGS["fused"])
    fused["generators"]["lidar"]["type"] = lidar
    return {
        **fused,
        "controller": {"type": "reactive_pushing", "target": list(TARGET)},
        "faults": [{"fault": "silent", "sensor": SKIN, "start": DIES}],
        "seed": 1,
        "scene": {
            "type": "push",
            "object": "box",
            "yaw": YAW,
            "target": list(TARGET),
            "sees": ["lidar"],
            "longest": LONGEST,
        },
    }


def by_skin_alone(fields: Mapping[str, Any]) -> dict[str, Any]:
    """The scene of the same push, dying skin included, with the skin as the only sensor."""
    return {
        **fields,
        "generators": {SKIN: fields["generators"][SKIN]},
        "scene": {**fields["scene"], "sees": []},
    }


def as_yaml(fields: Mapping[str, Any]) -> str:
    """The scene as the text of a file."""
    return HEAD + yaml.safe_dump(dict(fields), sort_keys=False)


@dataclass(frozen=True, eq=False)
class Moment:
    """One cycle of the push.

    Attributes:
        readings: that arrived, after all faults.
        step: contacts and command.
        truth: ground truth.
        ending: why the push ends here; None: it continues.
        contact: the likeliest on the robot's face, or None.
        touch: the controller's estimate from all contacts on the face, or None.
        alone: by source of evidence, lateral position of the contact without all other evidence
            [m], NaN where there would be none.
        left: distance from the believed contact to the target [m], NaN without contact.
        silent: time since the last cloud of the skin [s].
    """

    readings: tuple[Reading, ...]
    step: Step
    truth: PushTruth
    ending: Ending | None
    contact: Contact | None
    touch: FaceContact | None
    alone: Mapping[str, float]
    left: float
    silent: float

    @property
    def stamp(self) -> float:
        """The time [s]."""
        return self.truth.stamp

    @property
    def fusion(self) -> Fusion:
        """The fusion of the step."""
        return self.step.fusion

    @property
    def shares(self) -> Mapping[str, float]:
        """Shares of sources in the contact; empty without contact."""
        return self.contact.shares if self.contact else {}

    @property
    def mode(self) -> str:
        """Mode of the controller."""
        return self.step.command.mode if self.step.command else ""

    @property
    def reason(self) -> str:
        """Reason of the controller's command."""
        return self.step.command.reason if self.step.command else ""


def push_moments(fields: Mapping[str, Any]) -> Iterator[Moment]:
    """The moments of the push of a scene.

    Args:
        fields: of the scene.

    Raises:
        ContactFusionError: the scene cannot be set up, or what it needs is not installed.
    """
    config = RunConfig(**fields)
    scene = PushScene(PushConfig(**config.scene), config.robot, config.seed)
    # the same faults as in the pipeline: readings are those that got through
    faults = Faults(config.faults, config.seed)
    for cycle in pushed(scene, Pipeline(config)):
        contacts, truth = cycle.step.fusion.contacts, cycle.truth
        touch = on_face(contacts, FACE)
        left = math.nan
        if touch is not None:
            position = place_of((FACE.ahead, touch.lateral), truth.base)
            left = math.dist(position, scene.config.target)
        yield Moment(
            readings=tuple(kept for reading in cycle.readings for kept in faults.apply(reading)),
            step=cycle.step,
            truth=truth,
            ending=cycle.ending,
            contact=next((contact for contact in contacts if on_face([contact], FACE)), None),
            touch=touch,
            alone=_alone(cycle.step.fusion),
            left=left,
            silent=cycle.step.fusion.report.sources[SKIN].age,
        )


def sources_of(moment: Moment) -> list[str]:
    """Names of the sources that can have a share in a contact: all but Null ones."""
    sources = moment.fusion.report.sources.items()
    return [name for name, report in sources if report.kind != HypothesisKind.NULL]


def _alone(fusion: Fusion) -> dict[str, float]:
    sources = fusion.report.sources.items()
    evidence = [name for name, report in sources if report.kind == HypothesisKind.REGULAR]
    found = {}
    for source in evidence:
        rest = fusion
        for other in evidence:
            rest = rest if other == source else rest.without(other)
        touch = on_face(rest.contacts, FACE)
        found[source] = touch.lateral if touch else math.nan
    return found
