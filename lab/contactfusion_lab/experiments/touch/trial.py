"""One touch of the experiment: the last cloud of every source, and the truth."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.faults import unmet
from contactfusion.files import read_arrays
from contactfusion.frames import points_in
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.integrator.sources import EventKind
from contactfusion.loop import Observer, play
from contactfusion.pipeline import Pipeline
from contactfusion.readings import JointState, Reading
from contactfusion.robots.model import shared_robot
from contactfusion.stream import Arrival, Stream
from contactfusion_lab.experiments.touch.plan import Plan, Touch
from contactfusion_lab.scenes.touch.scene import TouchScene
from contactfusion_lab.trials.folder import as_npz

REQUIRED = ("positions", "likelihoods")
OPTIONAL = ("forces", "spreads")


@dataclass(frozen=True, eq=False)
class Trial:
    """One touch.

    Attributes:
        touch: which.
        stamp: when it ended [s].
        clouds: the last of each source, in the space's frame, by its name.
        places: shape (n, 3) [m], the true contacts in the space's frame, the strongest first; none
            after a miss, or in free air.
        links: the link that each is on.
        steady: whether the hand had settled.
        joints: shape (k,), the robot's joints as they were read in the end [rad, m].
        refused: why readings or clouds were refused, each reason once.
    """

    touch: Touch
    stamp: float
    clouds: Mapping[str, HypothesisCloud]
    places: FloatArray
    links: tuple[str, ...]
    steady: bool
    joints: FloatArray
    refused: tuple[str, ...]


def run_trial(plan: Plan, touch: Touch) -> Trial:
    """Touch once, and let the generators feel it.

    Raises:
        RobotError: the arm reaches the object along no path that was tried.
        ConfigurationError: a generator or a fault is for a sensor that the robot has not.
    """
    config = plan.pipeline_of(touch.target)
    assert config.robot is not None  # read_plan made sure of it
    robot = shared_robot(config.robot)
    scene = TouchScene(plan.scene_of(touch), robot, touch.seed)
    clouds: dict[str, HypothesisCloud] = {}
    pipeline = Pipeline(
        config.model_copy(update={"seed": touch.seed}),
        tell=lambda cloud: clouds.update({cloud.source: cloud}),
    )
    joints = np.zeros(len(robot.joint_names))
    measured: set[tuple[str, type[Reading]]] = set()

    def note(reading: Reading) -> None:
        nonlocal joints
        measured.add((reading.sensor, type(reading)))
        if isinstance(reading, JointState):
            joints = robot.positions(reading)

    (step,) = play(pipeline, _Whole(scene), [Observer(reading=note)])
    stamp, events = step.stamp, step.events
    pipeline.close()
    _require_measured(pipeline, measured)
    refused = dict.fromkeys(event.message for event in events if event.kind == EventKind.REFUSED)
    contacts = scene.truth.contacts
    pose = config.frame_tree().pose(config.integrator.frame, of=robot.root)
    places = points_in(pose, contacts.places)
    return Trial(
        touch,
        stamp,
        _worth_keeping(clouds, places, pipeline.state(stamp).grid),
        places,
        contacts.links,
        scene.truth.steady,
        joints,
        tuple(refused),
    )


@final
class _Whole(Stream):
    """A touch that is fused once, when it has ended.

    Args:
        scene: the touch.
    """

    def __init__(self, scene: TouchScene) -> None:
        self._scene = scene

    def readings(self) -> Iterator[Reading]:
        """The readings of the touch."""
        return self._scene.readings()

    def arrivals(self) -> Iterator[Arrival]:
        """The readings, of which none moves a clock; at the stamp of the last a step is due."""
        stamp: float | None = 0.0
        for arrival in self._scene.arrivals():
            stamp = arrival.stamp
            yield Arrival(None, arrival.readings)
        yield Arrival(stamp, (), due=True)


def content_of(trial: Trial) -> bytes:
    """The npz file of a trial."""
    fields = {
        "touch": asdict(trial.touch),
        "stamp": trial.stamp,
        "links": trial.links,
        "steady": trial.steady,
        "refused": trial.refused,
        "clouds": [
            {
                "source": cloud.source,
                "kind": str(cloud.kind),
                "stamp": cloud.stamp,
                "frame": cloud.frame,
                "single": cloud.single,
                "notes": cloud.notes,
            }
            for cloud in trial.clouds.values()
        ],
    }
    arrays: dict[str, Any] = {"places": trial.places, "joints": trial.joints}
    for cloud in trial.clouds.values():
        for name in (*REQUIRED, *OPTIONAL):
            if getattr(cloud, name) is not None:
                arrays[f"{cloud.source}/{name}"] = getattr(cloud, name)
    return as_npz(told=json.dumps(fields), **arrays)


def load(path: Path) -> Trial:
    """Read a trial.

    Raises:
        ConfigurationError: the file is missing, or is no trial.
    """
    held = read_arrays(path, "told", "places", "joints")
    try:
        return _read(held)
    except (KeyError, TypeError, ValueError):
        raise ConfigurationError(f"{path} is no touch of this experiment") from None


def _read(held: Mapping[str, Any]) -> Trial:
    fields: dict[str, Any] = json.loads(str(held["told"]))
    clouds = {}
    for described in fields["clouds"]:
        arrays: dict[str, Any] = {
            name: held.get(f"{described['source']}/{name}") for name in (*REQUIRED, *OPTIONAL)
        }
        clouds[described["source"]] = HypothesisCloud(**described, **arrays)
    return Trial(
        Touch(**fields["touch"]),
        fields["stamp"],
        clouds,
        held["places"],
        tuple(fields["links"]),
        fields["steady"],
        held["joints"],
        tuple(fields["refused"]),
    )


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


def _worth_keeping(
    clouds: Mapping[str, HypothesisCloud], places: FloatArray, grid: Grid
) -> dict[str, HypothesisCloud]:
    """Leave out Null voxels that hold neither a true contact nor a hypothesis of another kind."""
    occupied = set(map(tuple, grid.voxels(places).tolist()))
    for cloud in clouds.values():
        if cloud.kind != HypothesisKind.NULL:
            occupied.update(map(tuple, grid.voxels(cloud.positions).tolist()))
    kept = {}
    for name, cloud in clouds.items():
        if cloud.kind == HypothesisKind.NULL:
            voxels = map(tuple, grid.voxels(cloud.positions).tolist())
            rows = np.array([voxel in occupied for voxel in voxels], np.bool_)
            arrays: dict[str, Any] = {
                array: None if getattr(cloud, array) is None else getattr(cloud, array)[rows]
                for array in (*REQUIRED, *OPTIONAL)
            }
            cloud = replace(cloud, **arrays)
        kept[name] = cloud
    return kept
