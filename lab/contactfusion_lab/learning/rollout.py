"""Pushes to learn from (O §III-B), and what LiDARs see of each while it is made."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, final
from zlib import crc32

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.controller import Command
from contactfusion.controllers.pushing import ARRIVED
from contactfusion.frames import points_in
from contactfusion.generators.networks import KINDS
from contactfusion.generators.perceived import ROBOT
from contactfusion.generators.proximity import ProximityConfig, without
from contactfusion.loop import play
from contactfusion.pipeline import Pipeline
from contactfusion.readings import PointCloud, Reading, Twist
from contactfusion.robots.description import RobotConfig
from contactfusion.stream import Arrival, Stream
from contactfusion_lab.experiments.push.plan import GRID, VALIDATION, Place
from contactfusion_lab.experiments.push.suites import Change, controller_options, read_sensing
from contactfusion_lab.learning.dataset import LabelledTrial
from contactfusion_lab.scenes.push.config import FRICTIONS, PAPER, PushConfig
from contactfusion_lab.scenes.push.scene import PushScene, PushTruth

Split = Literal["training", "validation"]
MOUNTINGS = ("lidar", "lidar_side", "lidar_tilted")
"""Every push is seen from all of them at once."""
SKIN = "skin"
"""The driver that senses by the skin."""
WITHOUT = 12
"""Number of the paper's pushes that never touch (O §III-B)."""
HELD = 7
"""Every so-manieth varied push is for validation; drivers and frictions alternate by 2, 3 and 5."""
FIELD, NEAREST = 3.0, 0.6
"""Varied targets lie within this along x and y, and not so near to the start [m]."""
OFFSET, YAW = 0.2, 45.0
"""Greatest lateral offset of varied objects [m], and greatest yaw [degrees]."""
AS_IN_PAPER = 0.6
"""The share of varied pushes with one of the paper's objects; others have some of their kind."""
VARIED_DRIVERS = ("tuned", "tuned", "tuned_neither", "paper", "tuned_realign_only")
"""Who steers varied pushes by skin."""
Motion = tuple[float, float, float]
"""Forward, lateral [m/s], yaw rate [rad/s]."""
LONGEST = 60.0
"""Timeout of a push [s]."""
ONCE_MORE = 2.0
"""Time for which the base backs off at the target, and in which it comes back [s]."""
SLOWEST, FASTEST = (0.05, -0.1, -0.3), (0.3, 0.1, 0.3)
"""Limits of the random motion then: forward, lateral [m/s], yaw rate [rad/s]."""
PROXIMITY = ProximityConfig(occupied=2)
"""Configuration of the proximity lengths."""
BEHIND = 0.05
"""Distance behind the face from which a contact is at a side of the base [m]."""
TAXELS = 12
"""Number of taxels on the front of the skin."""


@dataclass(frozen=True)
class Course:
    """How a lesson is seen, and when it ends.

    Attributes:
        mountings: LiDARs that see it, by name, all at once.
        proximity: how proximity lengths are made.
        longest: the end, at the latest [s].
        once_more: at the target the base backs off for so long, and comes back for as long [s].
    """

    mountings: tuple[str, ...] = MOUNTINGS
    proximity: ProximityConfig = PROXIMITY
    longest: float = LONGEST
    once_more: float = ONCE_MORE


AS_PRINTED = Course(MOUNTINGS[:1], ProximityConfig(), longest=300.0, once_more=0.0)
"""One LiDAR, a cell with a single point is occupied (O Eq 9), and a push ends at the target or
after 300 s (O §III-B)."""


@dataclass(frozen=True)
class Detour:
    """A period in which the base moves by a given twist, whatever the controller commands.

    Attributes:
        start: [s].
        end: [s].
        motion: of the base.
    """

    start: float
    end: float
    motion: Motion


@dataclass(frozen=True)
class Lesson:
    """One push of the dataset.

    Attributes:
        name: of the push, and of its file.
        split: training, validation or test.
        round: DAgger iteration, 0 when the skin drives; then the networks of the one before drive.
        object: its name, or its fields.
        friction: its name.
        target: of the push, in `odom` [m].
        offset: of the object to the left [m].
        yaw: of the object [degrees].
        driver: "skin", or the mounting whose networks drive.
        controller: the parameters of reactive pushing.
        detours: periods in which the base moves otherwise.
        seed: of its random draws.
        course: how it is seen, and when it ends.
    """

    name: str
    split: Split
    round: int
    object: Any
    friction: str
    target: Place
    offset: float = 0.0
    yaw: float = 0.0
    driver: str = SKIN
    controller: str = "tuned"
    detours: tuple[Detour, ...] = ()
    seed: int = 0
    course: Course = Course()

    def detour_at(self, stamp: float) -> Motion | None:
        """Motion of the base at a stamp [s], during a detour."""
        for detour in self.detours:
            if detour.start <= stamp < detour.end:
                return detour.motion
        return None


def first_lessons(varied: int, seed: int) -> list[Lesson]:
    """The paper's 156 + 36 pushes by skin, and varied ones.

    Args:
        varied: how many of these.
        seed: of all random draws.
    """
    lessons: list[Lesson] = []
    sets: dict[Split, Sequence[Place]] = {"training": GRID, "validation": VALIDATION}
    for split, places in sets.items():
        for object_name in PAPER:
            for friction in FRICTIONS:
                for row, target in enumerate(places):
                    name = f"{split}-{object_name}-{friction}-{row:02d}"
                    chance = _seed(seed, name)
                    lessons.append(
                        Lesson(name, split, 0, object_name, friction, target, seed=chance)
                    )
    for row in range(WITHOUT):
        rng = np.random.default_rng([seed, 1, row])
        object_name = list(PAPER)[row % len(PAPER)]
        away = Detour(0.0, 15.0, (-float(rng.uniform(0.05, 0.3)), *_lateral_and_yaw(rng)))
        name = f"training-without-{row:02d}"
        chance = _seed(seed, name)
        lessons.append(
            Lesson(
                name, "training", 0, object_name, "mu1", (2.0, 0.0), detours=(away,), seed=chance
            )
        )
    lessons += [_varied(row, 0, SKIN, seed) for row in range(varied)]
    return lessons


def as_printed(lessons: Sequence[Lesson]) -> list[Lesson]:
    """Lessons with no more than O §III-B prints, steered by the authors' parameters."""
    return [replace(lesson, controller="paper", course=AS_PRINTED) for lesson in lessons]


def driven_lessons(count: int, iteration: int, mountings: Sequence[str], seed: int) -> list[Lesson]:
    """Varied pushes that networks drive, each from one of the mountings."""
    return [_varied(row, iteration, mountings[row % len(mountings)], seed) for row in range(count)]


def _varied(row: int, iteration: int, driver: str, seed: int) -> Lesson:
    rng = np.random.default_rng([seed, 2, iteration, row])
    split: Split = "validation" if row % HELD == HELD - 1 else "training"
    detours, stamp = [], 0.0
    for _ in range(rng.integers(0, 4)):
        stamp += float(rng.uniform(1.5, 12.0))
        end = stamp + float(rng.uniform(0.3, 4.0))
        detours.append(Detour(stamp, end, (float(rng.uniform(-0.3, 0.1)), *_lateral_and_yaw(rng))))
        stamp = end
    controller = VARIED_DRIVERS[row % len(VARIED_DRIVERS)] if driver == SKIN else "tuned"
    name = f"{split}-varied-{iteration}-{row:03d}"
    return Lesson(
        name, split, iteration, _object(rng), list(FRICTIONS)[row % 2], _target(rng),
        float(rng.uniform(-OFFSET, OFFSET)), float(rng.uniform(-YAW, YAW)), driver, controller,
        tuple(detours), _seed(seed, name),
    )  # fmt: skip


def _seed(seed: int, name: str) -> int:
    """The seed of all random draws of a push."""
    return crc32(f"{seed} {name}".encode())


def _object(rng: np.random.Generator) -> Any:
    """Draw one of the paper's objects, or one like them of another size."""
    name = list(PAPER)[rng.integers(len(PAPER))]
    if rng.random() < AS_IN_PAPER:
        return name
    height, mass = float(rng.uniform(0.45, 0.85)), float(rng.uniform(5.0, 30.0))
    if rng.random() < 0.4:
        radius = float(rng.uniform(0.12, 0.35))
        return {"shape": "cylinder", "radius": radius, "height": height, "mass": mass}
    width, length = rng.uniform(0.2, 0.6, 2).tolist()
    return {"shape": "box", "size": (length, width, height), "mass": mass}


def _target(rng: np.random.Generator) -> Place:
    while True:
        x, y = rng.uniform(-FIELD, FIELD, 2).tolist()
        if np.hypot(x, y) >= NEAREST and not (-0.8 <= x <= 0.0 and abs(y) <= 0.35):
            return x, y


def _lateral_and_yaw(rng: np.random.Generator) -> tuple[float, float]:
    return float(rng.uniform(-0.15, 0.15)), float(rng.uniform(-0.4, 0.4))


@dataclass(frozen=True, eq=False)
class Moment:
    """One cycle of a push: proximity lengths and ground truth.

    Attributes:
        descriptors: shape (k, S) [m], the proximity lengths from each mounting.
        truth: the contact of the object.
    """

    descriptors: FloatArray
    truth: PushTruth


def live(lesson: Lesson, weights: Path | None) -> LabelledTrial:
    """A labelled trial of one push.

    Args:
        lesson: the push.
        weights: of the networks that drive; None: it is driven by skin.
    """
    pipeline = _pipeline(lesson, weights)
    assert pipeline.config.robot is not None
    rollout = _Rollout(lesson, pipeline.config.robot)
    for _ in play(pipeline, rollout):
        pass
    moments = rollout.moments
    truths = [moment.truth for moment in moments]
    touches = [_touch(truth) for truth in truths]
    return LabelledTrial(
        name=lesson.name,
        split=lesson.split,
        round=lesson.round,
        mountings=lesson.course.mountings,
        stamp=np.array([truth.stamp for truth in truths]),
        descriptors=np.stack([moment.descriptors for moment in moments], axis=1),
        kind=np.array([KINDS.index(kind) for kind, _ in touches], np.uint8),
        lateral=np.array([lateral for _, lateral in touches]),
    )


def _touch(truth: PushTruth) -> tuple[str, float]:
    """Kind and lateral position of the contact on the face; none is visible beside or behind it."""
    forward, lateral = truth.contact
    if forward < PROXIMITY.region.x[0] - BEHIND:
        return "none", np.nan
    return truth.kind, lateral


@final
class _Rollout(Stream):
    """A rollout cycle by cycle, by the commands of a pipeline and the detours of the push.

    Args:
        lesson: the push.
        robot: the base.
    """

    def __init__(self, lesson: Lesson, robot: RobotConfig) -> None:
        fields: dict[str, Any] = {"object": lesson.object, "friction": lesson.friction}
        config = PushConfig(
            **fields,
            target=lesson.target,
            offset=lesson.offset,
            yaw=lesson.yaw,
            sees=lesson.course.mountings,
        )
        self.moments: list[Moment] = []
        """Moments of the cycles so far."""
        self._lesson, self._robot = lesson, robot
        self._scene = PushScene(config, robot, lesson.seed)
        self._command: Command | None = None

    def readings(self) -> Iterator[Reading]:
        """The readings of the sensors."""
        return (reading for arrival in self.arrivals() for reading in arrival.readings)

    def arrivals(self) -> Iterator[Arrival]:
        """The readings of each cycle, at its end, until the push ends."""
        scene, lesson, course = self._scene, self._lesson, self._lesson.course
        end = course.longest
        drawn = np.random.default_rng([lesson.seed, 3]).uniform(SLOWEST, FASTEST).tolist()
        forward, lateral, yaw_rate = drawn
        while True:
            readings, truth = scene.readings(), scene.truth()
            self.moments.append(Moment(_descriptors(readings, self._robot, course), truth))
            yield Arrival(scene.stamp, tuple(readings), due=True)
            command = self._command
            assert command is not None  # the pipeline has a controller
            assert command.twist is not None
            if command.mode == ARRIVED:
                end = min(end, scene.stamp + 2.0 * course.once_more)
            if scene.stamp >= end or np.hypot(*truth.object[:2]) > scene.config.furthest:
                return
            if end < course.longest:
                back = scene.stamp < end - course.once_more
                scene.drive(-forward if back else forward, lateral, yaw_rate)
            else:
                scene.drive(*(lesson.detour_at(scene.stamp) or _motion(command.twist)))

    def send(self, command: Command | None) -> None:
        """Take the command of a cycle."""
        self._command = command


def _pipeline(lesson: Lesson, weights: Path | None) -> Pipeline:
    if lesson.driver == SKIN:
        sensing = read_sensing("skin", TAXELS, Change())
    else:
        sensing = read_sensing("lidar", TAXELS, Change(lidar=lesson.driver, weights=weights))
    controller = controller_options(lesson.controller, lesson.target, sensing.face)
    update = {"controller": controller, "seed": lesson.seed}
    return Pipeline(sensing.pipeline.model_copy(update=update))


def _descriptors(readings: Sequence[Reading], robot: RobotConfig, course: Course) -> FloatArray:
    """The proximity lengths as each LiDAR sees them, shape (k, S) [m]."""
    clouds = {reading.sensor: reading for reading in readings if isinstance(reading, PointCloud)}
    rows = []
    for name in course.mountings:
        pose = robot.frames[clouds[name].frame].pose()
        seen = without(points_in(pose, clouds[name].points), ROBOT)
        rows.append(course.proximity.lengths_of_cloud(seen))
    return np.stack(rows)


def _motion(twist: Twist) -> Motion:
    return float(twist.linear[0]), float(twist.linear[1]), float(twist.angular[2])
