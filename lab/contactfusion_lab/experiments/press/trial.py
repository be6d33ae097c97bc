"""One arm that is pressed, or moves in free air, and what is reported by each row."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.files import read_json
from contactfusion.generators.joint_torque import UNDECIDED
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.identify.identification import identify_file
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.integrator import Integrator
from contactfusion.loop import play
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import IdentifiedConfig, PipelineConfig
from contactfusion.readings import JointState, Reading, Wrench
from contactfusion.recordings.mcap import McapWriter
from contactfusion.robots.model import shared_robot
from contactfusion.surface import Surface
from contactfusion_lab.experiments.press.plan import (
    ALONE,
    BESIDE,
    SECONDS,
    Arm,
    Press,
    arm,
    arm_file,
)
from contactfusion_lab.scenes.press.config import PressConfig
from contactfusion_lab.scenes.press.scene import PressScene
from contactfusion_lab.trials.calibration import level, radius
from contactfusion_lab.trials.localisation import localisation

NEAR = 0.05
"""A contact this near a true one has found it: half the width of an upper arm [m]."""
SELDOM = 0.1
"""Rate of images where no camera counts [Hz]."""
MOTION, LIVELY = 120.0, (0.2, 0.6)
"""Length of the free motion by which a specimen is identified [s], and its speed [rad/s]."""


@dataclass(frozen=True)
class Found:
    """The outcome of a trial by one row.

    Attributes:
        row: the row.
        contacts: how many are reported at the end.
        found: how many true contacts have a reported one within 5 cm, paired at the least cost.
        false: how many reported ones have no partner in that.
        error: from the likeliest to the nearest true contact [m]; NaN without either.
        link: that of the likeliest contact; "" without any.
        links: those between which the generator cannot decide; empty where it can.
        probability: of the likeliest contact, 0 without any.
        level: of the ellipsoid of its covariance that reaches the nearest true one; NaN.
        radius: of its 95 % ellipsoid, as of a sphere of that volume [m]; NaN without any.
        latency: from the first true contact to the first report of any [s]; NaN without either.
        alarms: how often a report began while nothing touched.
    """

    row: str
    contacts: int
    found: int
    false: int
    error: float
    link: str
    links: tuple[str, ...]
    probability: float
    level: float
    radius: float
    latency: float
    alarms: int


@dataclass(frozen=True)
class Trial:
    """A trial.

    Attributes:
        press: which.
        links: that are touched at the end, the strongest contact first.
        forces: of these contacts [N].
        found: by each row.
    """

    press: Press
    links: tuple[str, ...]
    forces: tuple[float, ...]
    found: tuple[Found, ...]


def run_trial(press: Press) -> Trial:
    """Press an arm once, or move it in free air, and let each row feel it.

    Raises:
        RobotError: the arm can be pressed in no posture that was tried.
    """
    described = identified(press.arm, press.specimen)
    assert described.pipeline.robot is not None  # each file has one
    scene = PressScene(
        scene_of(described.scene, press), shared_robot(described.pipeline.robot), press.seed
    )
    readings = list(scene.readings())
    alone, beside = described.felt(["torques"]), described.pipeline
    found = [_found(ALONE, _fused(alone, readings, {ALONE: ["torques"]})[ALONE], scene)]
    for row, fusions in _fused(beside, readings, BESIDE).items():
        found.append(_found(row, fusions, scene))
    touching = scene.touching
    forces = tuple(np.linalg.norm(touching.forces, axis=1).tolist())
    return Trial(press, touching.links, forces, tuple(found))


Fused = Sequence[tuple[float, Fusion, Surface]]
"""The fusion of each step, with its stamp [s] and the surface."""


def _fused(
    config: PipelineConfig, readings: Sequence[Reading], rows: Mapping[str, Sequence[str]]
) -> Mapping[str, Fused]:
    """What is fused of the clouds of some generators each.

    Args:
        config: all generators.
        readings: what they take.
        rows: the names of generators of each row.
    """
    arrived = list[HypothesisCloud]()
    pipeline = Pipeline(config, tell=arrived.append)
    integrators = {row: Integrator(config.integrator) for row in rows}
    fused: dict[str, list[tuple[float, Fusion, Surface]]] = {row: [] for row in rows}
    for step in play(pipeline, readings):
        surface = pipeline.state(step.stamp).placed_surface("experiment press")
        for row, names in rows.items():
            integrator = integrators[row]
            for cloud in arrived:
                if cloud.source.split("/")[0] in names:
                    integrator.plug(cloud.source, cloud.kind, replace=True)
                    integrator.receive(cloud)
            fused[row].append((step.stamp, integrator.step(step.stamp, surface), surface))
        arrived.clear()
    return fused


def _found(row: str, fused: Fused, scene: PressScene) -> Found:
    """The outcome of a row."""
    true, onset = scene.touching.places, scene.onset
    _, last, surface = fused[-1]
    contacts, notes = last.contacts, last.report.sources["torques"].notes
    places = np.reshape([contact.position for contact in contacts], (-1, 3))
    pairs = localisation(true, places, NEAR)
    away = true - places[0] if len(places) else np.empty((0, 3))
    nearest = away[np.linalg.norm(away, axis=1).argmin()] if len(away) else np.full(3, np.nan)
    undecided = next((note for note in notes if note.startswith(UNDECIDED)), "")
    reported = [(stamp, bool(fusion.contacts)) for stamp, fusion, _ in fused]
    return Found(
        row=row,
        contacts=len(contacts),
        found=len(true) - pairs.missed,
        false=pairs.false,
        error=float(np.linalg.norm(nearest)),
        link=_link_at(surface, places[0]) if len(places) else "",
        links=tuple(undecided.removeprefix(UNDECIDED).split(", ")) if undecided else (),
        probability=contacts[0].likelihood if contacts else 0.0,
        level=level(nearest, contacts[0].covariance) if len(away) else np.nan,
        radius=radius(contacts[0].covariance) if contacts else np.nan,
        latency=min((at for at, any_ in reported if any_ and at >= onset), default=np.nan) - onset,
        alarms=sum(
            now and not before
            for (_, before), (at, now) in pairwise([(0.0, False), *reported])
            if not at >= onset
        ),
    )


def scene_of(config: PressConfig, press: Press) -> PressConfig:
    """The scene of a trial."""
    fields = {"places": press.places, "specimen": press.specimen, "seconds": SECONDS}
    return config.model_copy(update={**fields, **({"press": press.force} if press.force else {})})


def _link_at(surface: Surface, place: FloatArray) -> str:
    """The link whose surface is nearest to a place, shape (3,) [m]."""
    (row,) = surface.nearest(place[None])[1]
    return str(surface.link_names[surface.links[row]])


def content_of(trial: Trial) -> bytes:
    """The JSON file of a trial."""
    return (json.dumps(asdict(trial), indent=1) + "\n").encode()


def load(path: Path) -> Trial:
    """Read a trial.

    Raises:
        ConfigurationError: it is no trial.
    """
    try:
        fields = read_json(path)
        found = tuple(Found(**{**each, "links": tuple(each["links"])}) for each in fields["found"])
        press, links = Press(**fields["press"]), tuple(fields["links"])
        return Trial(press, links, tuple(fields["forces"]), found)
    except (ValueError, KeyError, TypeError):
        raise ConfigurationError(f"{path} is no trial of this experiment") from None


@lru_cache(maxsize=32)
def identified(name: str, specimen: int) -> Arm:
    """An arm with what two minutes of free motion tell of one specimen, as a user identifies it."""
    described, path = arm(name), arm_file(name)
    assert described.pipeline.robot is not None  # each file has one
    free = {
        "places": 0, "specimen": specimen, "seconds": MOTION, "speed": LIVELY,
        "camera_rate": SELDOM,
    }  # fmt: skip
    scene = PressScene(
        described.scene.model_copy(update=free), shared_robot(described.pipeline.robot), specimen
    )
    with TemporaryDirectory(prefix="contactfusion-") as folder:
        recording = Path(folder, "free.mcap")
        with McapWriter(recording, scene.epoch_ns) as writer:
            for reading in scene.readings():
                if isinstance(reading, JointState | Wrench):
                    writer.reading(reading)
        measured = IdentifiedConfig(**identify_file(path, recording).fields)
    pipeline = described.pipeline
    fields = measured.over({"robot": pipeline.robot, "generators": pipeline.generators})
    return replace(described, pipeline=pipeline.model_copy(update=fields))
