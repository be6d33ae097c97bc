"""One touch of the experiment, or one free motion: the clouds of every source, and the truth."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar, final

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.faults import unmet
from contactfusion.files import read_arrays
from contactfusion.frames import points_in
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.integrator.sources import EventKind
from contactfusion.loop import Observer, play
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import JointState, Reading
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion.stream import Arrival, Stream
from contactfusion_lab.experiments.touch.plan import SECONDS, Free, Plan, Touch
from contactfusion_lab.experiments.touch.record import (
    Arrived,
    Instant,
    Record,
    arrays_of,
    fields_of,
    record_of,
    worth_keeping,
)
from contactfusion_lab.scenes.touch.free import FreeMotion
from contactfusion_lab.scenes.touch.scene import TouchScene
from contactfusion_lab.trials.folder import as_npz

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Trial:
    """One touch.

    Attributes:
        touch: which.
        record: the clouds of every source over time.
        places: shape (n, 3) [m], the true contacts at the end, in the space's frame, the strongest
            first; none after a miss, or in free air.
        links: the link that each is on.
        steady: whether the hand had settled.
        force: magnitude of the sum of their forces [N].
        onset: stamp of the first contact [s]; NaN without any.
    """

    touch: Touch
    record: Record
    places: FloatArray
    links: tuple[str, ...]
    steady: bool
    force: float
    onset: float

    @cached_property
    def last(self) -> Instant:
        """The state at the end."""
        found = self.record.at(self.record.end)
        return Instant(found.stamp, found.clouds, found.joints, self.places)

    @property
    def ending(self) -> "Trial":
        """The touch without the clouds before the last ones."""
        return replace(self, record=self.record.ending)

    @property
    def clouds(self) -> Mapping[str, HypothesisCloud]:
        """The last cloud of each source, by its name."""
        return self.last.clouds


@dataclass(frozen=True, eq=False)
class FreeTrial:
    """One motion in free air.

    Attributes:
        motion: which.
        record: the clouds of every source over time.
    """

    motion: Free
    record: Record

    @property
    def touched(self) -> bool:
        """Whether something was touched all the same."""
        return any(map(len, self.record.contacts))


def run_trial(plan: Plan, touch: Touch) -> Trial:
    """Touch once, and let the generators feel it.

    Raises:
        RobotError: the arm reaches the object along no path that was tried.
        ConfigurationError: a generator or a fault is for a sensor that the robot has not.
    """
    config, robot = _felt_by(plan, touch.target)
    scene = TouchScene(plan.scene_of(touch), robot, touch.seed)
    record = _recorded(scene, config, robot, touch.seed)
    contacts = scene.truth.contacts
    pose = config.frame_tree().pose(config.integrator.frame, of=robot.root)
    return Trial(
        touch,
        record,
        points_in(pose, contacts.places),
        contacts.links,
        scene.truth.steady,
        float(np.linalg.norm(contacts.forces.sum(axis=0))),
        scene.truth.onset,
    )


def run_free(plan: Plan, motion: Free) -> FreeTrial:
    """Move once in free air, and let the generators feel it.

    Raises:
        RobotError: there is no path without a contact.
        ConfigurationError: a generator or a fault is for a sensor that the robot has not.
    """
    config, robot = _felt_by(plan, motion.target)
    scene = FreeMotion(
        plan.scene.model_copy(update={"target": motion.target}), robot, motion.seed, SECONDS
    )
    return FreeTrial(motion, _recorded(scene, config, robot, motion.seed))


def _felt_by(plan: Plan, target: str) -> tuple[PipelineConfig, RobotModel]:
    config = plan.pipeline_of(target)
    assert config.robot is not None  # read_plan made sure of it
    return config, shared_robot(config.robot)


def _recorded(scene: TouchScene, config: PipelineConfig, robot: RobotModel, seed: int) -> Record:
    """Play a scene through the generators.

    Raises:
        RobotError: the scene cannot be made.
        ConfigurationError: a generator or a fault is for a sensor that the robot has not.
    """
    history: dict[str, list[Arrived]] = {}

    def heard(cloud: HypothesisCloud) -> None:
        history.setdefault(cloud.source, []).append(Arrived(scene.now, cloud))

    pipeline = Pipeline(config.model_copy(update={"seed": seed}), tell=heard)
    pose = config.frame_tree().pose(config.integrator.frame, of=robot.root)
    stamps, joints, contacts = list[float](), list[FloatArray](), list[FloatArray]()
    measured: set[tuple[str, type[Reading]]] = set()

    def note(reading: Reading) -> None:
        measured.add((reading.sensor, type(reading)))
        if isinstance(reading, JointState):
            stamps.append(scene.now)
            joints.append(robot.positions(reading))
            true = [contact.position for contact in scene.facts().contacts]
            contacts.append(points_in(pose, np.reshape(true, (-1, 3))))

    (step,) = play(pipeline, _Whole(scene), [Observer(reading=note)])
    pipeline.close()
    _require_measured(pipeline, measured)
    refused = (each.message for each in step.events if each.kind == EventKind.REFUSED)
    evidence = [
        name
        for name, arrived in history.items()
        if arrived[0].cloud.kind == HypothesisKind.REGULAR
        or config.generators[name.split("/")[0]]["type"] == "range"  # in the papers' rows
    ]
    return Record(
        step.stamp,
        worth_keeping(history, contacts, pipeline.grid, evidence),
        np.array(stamps),
        np.array(joints),
        contacts,
        tuple(dict.fromkeys(refused)),
    )


@final
class _Whole(Stream):
    """A scene that is fused once, when it has ended.

    Args:
        scene: the scene.
    """

    def __init__(self, scene: TouchScene) -> None:
        self._scene = scene

    def readings(self) -> Iterator[Reading]:
        """The readings of the scene."""
        return self._scene.readings()

    def arrivals(self) -> Iterator[Arrival]:
        """The readings, of which none moves a clock; at the end a step is due."""
        for reading in self.readings():
            yield Arrival(None, (reading,))
        yield Arrival(self._scene.now, (), due=True)


def content_of(trial: Trial) -> bytes:
    """The npz file of a trial."""
    fields = {
        "touch": asdict(trial.touch),
        "links": trial.links,
        "steady": trial.steady,
        "force": trial.force,
        "onset": trial.onset,
        **fields_of(trial.record),
    }
    return as_npz(told=json.dumps(fields), places=trial.places, **arrays_of(trial.record))


def content_of_free(trial: FreeTrial) -> bytes:
    """The npz file of a motion."""
    fields = {"motion": asdict(trial.motion), **fields_of(trial.record)}
    return as_npz(told=json.dumps(fields), **arrays_of(trial.record))


def load(path: Path) -> Trial:
    """Read a trial.

    Raises:
        ConfigurationError: the file is missing, or is no trial.
    """
    return _loaded(path, _read)


def load_free(path: Path) -> FreeTrial:
    """Read a motion.

    Raises:
        ConfigurationError: the file is missing, or is no motion.
    """
    return _loaded(path, _read_free)


def _loaded(path: Path, read: Callable[[Mapping[str, Any], Mapping[str, Any]], T]) -> T:
    held = read_arrays(path, "told", "read/joints")
    try:
        return read(json.loads(str(held["told"])), held)
    except (KeyError, RecursionError, TypeError, ValueError):
        raise ConfigurationError(f"{path} is no trial of this experiment") from None


def _read(fields: Mapping[str, Any], held: Mapping[str, Any]) -> Trial:
    return Trial(
        Touch(**fields["touch"]),
        record_of(fields, held),
        held["places"],
        tuple(fields["links"]),
        fields["steady"],
        fields["force"],
        fields["onset"],
    )


def _read_free(fields: Mapping[str, Any], held: Mapping[str, Any]) -> FreeTrial:
    return FreeTrial(Free(**fields["motion"]), record_of(fields, held))


def _require_measured(pipeline: Pipeline, measured: set[tuple[str, type[Reading]]]) -> None:
    """Make sure that nothing waits for a sensor that there is not.

    Raises:
        ConfigurationError: something does.
    """
    sensors = {sensor for sensor, _ in measured if sensor}
    for problem in unmet(pipeline.config.faults, measured):
        raise ConfigurationError(problem)
    for name, generator in pipeline.generators.items():
        wanted = generator.config.sensor
        if not any(
            issubclass(kind, generator.readings) and wanted in (None, sensor)
            for sensor, kind in measured
        ):
            hint = name_hint(str(wanted), sensors, "sensors")
            problem = f"no reading of '{wanted}' came; {hint}"
            raise ConfigurationError(problem, f"generators.{name}.sensor")
