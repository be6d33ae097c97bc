"""A push: readings, ground truth, and the loop with a pipeline and its controller."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.controller import Command
from contactfusion.controllers.pushing import ARRIVED
from contactfusion.errors import ConfigurationError, RobotError, name_hint
from contactfusion.frames import planar_pose, yaw_quaternion
from contactfusion.hooks import hookimpl
from contactfusion.loop import play
from contactfusion.pipeline import Pipeline, Step
from contactfusion.readings import Odometry, Reading, TactileImage, Twist
from contactfusion.robots.description import RobotConfig, read_robot
from contactfusion.scene import Scene
from contactfusion.stream import Arrival, Facts, Verdict
from contactfusion_lab.scenes.facts import standing, true_contact
from contactfusion_lab.scenes.push.bodies import ORIGIN_HEIGHT, Chassis, read_chassis
from contactfusion_lab.scenes.push.clutter import Clutter
from contactfusion_lab.scenes.push.config import RATE, PushConfig
from contactfusion_lab.scenes.push.objects import outlines
from contactfusion_lab.scenes.push.odometry import PushOdometry
from contactfusion_lab.scenes.push.sensors import PushSkin, range_sensors, rng_of
from contactfusion_lab.scenes.push.world import PushWorld, Touches, Velocity, WorldState
from contactfusion_lab.scenes.sensor_errors import Arrivals

BASE = "contactfusion.robots:mobile_base.yaml"
"""The base that pushes, unless another is given."""
OBJECT = "object"
"""Name of the object in the ground truth, whichever it is."""
UNION = 0.05
"""Time over which contact points count as the truth (method §6) [s]."""
NARROW = 0.05
"""Extent under which contact points are a point at their mean, else a line at the middle of its
ends [m]."""


@cache
def mobile_base() -> Chassis:
    """The chassis of `BASE`."""
    return read_chassis(read_robot(BASE))


@dataclass(frozen=True, slots=True)
class PushTruth:
    """Ground truth of a push at one instant.

    Attributes:
        stamp: [s].
        base: x, y [m] and yaw [rad] of the robot in `odom`.
        object: x, y [m] and yaw [rad] of the object in `odom`.
        kind: of the contact of object and robot: "none", "point" or "line".
        contact: x and y in the robot's frame [m], NaN without contact.
        distance: from the contact to the target [m], NaN without contact.
        force: normal force of the object on the robot, mean of the cycle [N].
    """

    stamp: float
    base: tuple[float, float, float]
    object: tuple[float, float, float]
    kind: str
    contact: tuple[float, float]
    distance: float
    force: float


class PushScene:
    """One push: twists in, readings out.

    Args:
        config: the push.
        robot: the base, with a patch of the name `skin`; None: `mobile_base.yaml` of the package.
        seed: of all random draws.

    Raises:
        RobotError: the base or the object cannot be loaded, or the base has no skin.
        ConfigurationError: the target lies under the robot, or the object starts out of sight.
    """

    def __init__(self, config: PushConfig, robot: RobotConfig | None = None, seed: int = 0) -> None:
        robot = read_robot(BASE) if robot is None else robot
        if "skin" not in robot.patches:
            hint = name_hint("skin", robot.patches, "patches of the robot")
            raise RobotError(f"a push needs a patch 'skin' on the robot: {hint}")
        self.config = config
        self._frame = robot.patches["skin"].frame
        self.world = PushWorld(config, robot, seed)
        """The physics."""
        self._require_outside()
        self._skin = PushSkin(robot.patches["skin"], config.white[0], config.noise.taxels, seed)
        self._rng = np.random.default_rng(seed)
        self._range_sensors = range_sensors(config, robot, seed, self._clutter(seed))
        self._odometry = PushOdometry(
            config.noise.odometry,
            self.world.base_pose,
            self.world.base_twist,
            rng_of(seed, "odometry errors"),
        )
        self._arrivals = Arrivals(config.noise.delays, rng_of(seed, "delays"))
        self._cycles = 0

    @property
    def stamp(self) -> float:
        """The time [s]."""
        return self._cycles * self.config.period

    def readings(self) -> list[Reading]:
        """The readings now.

        Odometry, the twist of the base, the skin's image, and those of LiDARs and cameras that are
        due.
        """
        return [
            *self.motion_readings(self.stamp),
            *self.sensor_readings(self.stamp, self.world.state),
        ]

    def motion_readings(self, stamp: float) -> list[Reading]:
        """Odometry, and the twist of the base, as of a stamp [s]."""
        x, y, yaw = self._odometry.pose
        forward, lateral, yaw_rate = self._odometry.twist
        linear, angular = np.array([forward, lateral, 0.0]), np.array([0.0, 0.0, yaw_rate])
        return [
            Odometry(
                stamp=stamp,
                frame="odom",
                sensor="odometry",
                child_frame=self._frame,
                position=np.array([x, y, ORIGIN_HEIGHT]),
                orientation=yaw_quaternion(yaw),
                linear=linear,
                angular=angular,
            ),
            Twist(stamp=stamp, frame=self._frame, sensor="wheels", linear=linear, angular=angular),
        ]

    def sensor_readings(self, stamp: float, state: WorldState) -> list[Reading]:
        """The skin's image, and the readings of LiDARs and cameras that are due.

        Args:
            stamp: [s].
            state: of this world, or of one of the same configuration.
        """
        values = self._skin.values(stamp, state.touches, self.world.steps, self._rng)
        return [
            TactileImage(stamp=stamp, frame=self._frame, sensor="skin", values=values),
            *(
                sensor.reading(stamp, state.base, state.object)
                for sensor in self._range_sensors
                if sensor.due(stamp)
            ),
        ]

    def arriving(self) -> list[Reading]:
        """The readings that arrive now: of this cycle, and of earlier ones by their delays.

        A delay is rounded to whole cycles.
        """
        return self._arrivals.until(self.stamp + self.config.period / 2.0, self.readings())

    def drive(self, forward: float, lateral: float, yaw_rate: float) -> None:
        """One cycle, in which the base moves forward, to the left [m/s] and yaws [rad/s]."""
        self.world.drive(forward, lateral, yaw_rate)
        self._measure()

    def follow(self, velocities: Iterable[Velocity]) -> None:
        """One cycle, in which the base has a velocity at each step of the physics."""
        self.world.follow(velocities)
        self._measure()

    def _measure(self) -> None:
        world = self.world
        pressed = len(world.touches.forces) > 0
        self._odometry.follow(world.base_pose, world.base_twist, pressed, self.config.period)
        self._cycles += 1

    def truth(self) -> PushTruth:
        """The ground truth now."""
        world = self.world
        base, pushed = world.base_pose, world.object_pose
        kind, contact = touching(world.touches, world.steps)
        cos, sin = np.cos(base[2]), np.sin(base[2])
        there = (
            base[0] + cos * contact[0] - sin * contact[1],
            base[1] + sin * contact[0] + (cos * contact[1]),
        )
        distance = float(np.hypot(*np.subtract(self.config.target, there)))
        force = float(world.touches.forces.sum()) / world.steps
        return PushTruth(self.stamp, base, pushed, kind, contact, distance, force)

    def facts(self) -> Facts:
        """The true contact, in the robot's frame, and the true pose of the object in `odom`."""
        truth, touches = self.truth(), self.world.touches
        objects = standing(self.stamp, "odom", {OBJECT: planar_pose(truth.object, 0.0)})
        if truth.kind == "none":
            return Facts(self.stamp, self._frame, (), objects)
        points = touches.points[_recent(touches, self.world.steps)]
        position = np.array([*truth.contact, points[:, 2].mean()])
        force = touches.forces @ touches.normals / self.world.steps
        contact = true_contact(self.stamp, self._frame, position, force, points[_ends(points)])
        return Facts(self.stamp, self._frame, (contact,), objects)

    def _clutter(self, seed: int) -> Clutter | None:
        if not self.config.noise.clutter or not self.config.sees:
            return None
        base, pushed = self.world.base.chassis.corners, outlines(self.config.object)
        return Clutter(base, pushed, self.world.object_pose, rng_of(seed, "clutter"))

    def _require_outside(self) -> None:
        x, y = self.config.target
        base = self.world.base.chassis
        if base.rear - base.front <= x <= 0.0 and abs(y) <= base.half_width:
            raise ConfigurationError(
                f"the target {self.config.target} lies under the robot, whose front stands at "
                "x = 0 at the start",
                "target",
            )


def touching(touches: Touches, steps: int) -> tuple[str, tuple[float, float]]:
    """Kind and position of the true contact, from all points of the last 50 ms (O §III-A)."""
    points: FloatArray = touches.points[_recent(touches, steps), :2]
    if not len(points):
        return "none", (np.nan, np.nan)
    spans = np.ptp(points, axis=0)
    if np.hypot(*spans) < NARROW:
        middle = points.mean(axis=0)
        return "point", (float(middle[0]), float(middle[1]))
    middle = points[_ends(points)].mean(axis=0)
    return "line", (float(middle[0]), float(middle[1]))


def _recent(touches: Touches, steps: int) -> NDArray[np.bool_]:
    """Which of the points are of the last 50 ms of a cycle."""
    recent: NDArray[np.bool_] = touches.steps >= steps - UNION * RATE
    return recent


def _ends(points: FloatArray) -> NDArray[np.intp]:
    """The rows of the two points that lie furthest apart along x or y, shape (2,)."""
    along = points[:, np.argmax(np.ptp(points[:, :2], axis=0))]
    return np.argsort(along, kind="stable")[[0, -1]]


class Ending(StrEnum):
    """Why a push ended."""

    ARRIVED = "arrived"
    """The controller declared arrival."""
    TIMEOUT = "timeout"
    """The time limit was reached."""
    LOST = "lost"
    """There was no contact for too long, in all."""
    AWAY = "away"
    """The object is too far away."""


@dataclass(frozen=True, eq=False)
class Cycle:
    """One cycle of a push.

    Attributes:
        readings: of the sensors.
        step: of the pipeline, from them.
        truth: ground truth.
        ending: why the push ends with this cycle; None: it continues.
    """

    readings: list[Reading]
    step: Step
    truth: PushTruth
    ending: Ending | None


def pushed(scene: PushScene, pipeline: Pipeline) -> Iterator[Cycle]:
    """The cycles of a push; the controller receives readings, never the truth.

    Args:
        scene: at its start.
        pipeline: with a controller.

    Raises:
        ConfigurationError: the pipeline has no controller, its controller failed, or pushes to
            another target than the scene's.
    """
    pushing = Pushing(scene)
    for step in play(pipeline, pushing):
        yield pushing.cycle(step)


def _twist(command: Command | None) -> Twist:
    if command is None:
        raise ConfigurationError("a push needs a controller", "controller")
    if command.twist is None:
        raise ConfigurationError(f"the controller gave no twist: {command.reason}", "controller")
    return command.twist


class Pushing(Scene):
    """A push by the controller of the pipeline that plays it.

    Args:
        scene: at its start.
    """

    Config = PushConfig

    def __init__(self, scene: PushScene) -> None:
        self.scene = scene
        """The robot and its world."""
        self._readings: list[Reading] = []
        self._lost = 0.0
        self._twist: Twist | None = None
        self._truth: PushTruth | None = None
        self._ending: Ending | None = None

    @classmethod
    def opened(cls, config: PushConfig, robot: RobotConfig, seed: int) -> Self:
        """A push at its start."""
        return cls(PushScene(config, robot, seed))

    def begin(self, pipeline: Pipeline) -> None:
        """Refuse a controller that pushes to another target than the scene's.

        Raises:
            ConfigurationError: it does.
        """
        target = (pipeline.config.controller or {}).get("target", self.scene.config.target)
        if tuple(target) != self.scene.config.target:
            raise ConfigurationError(
                f"the controller pushes to {tuple(target)}, but the scene's target is "
                f"{self.scene.config.target}",
                "controller.target",
            )

    def readings(self) -> Iterator[Reading]:
        """The readings of the sensors."""
        return (reading for arrival in self.arrivals() for reading in arrival.readings)

    def arrivals(self) -> Iterator[Arrival]:
        """The readings of each cycle, at its end, until the push ends."""
        while self._ending is None:
            if self._twist is not None:
                linear, angular = self._twist.linear, self._twist.angular
                self.scene.drive(float(linear[0]), float(linear[1]), float(angular[2]))
            self._readings = self.scene.arriving()
            yield Arrival(self.scene.stamp, tuple(self._readings), due=True)

    def send(self, command: Command | None) -> None:
        """Accept the velocity of the next cycle, and record how this one ended.

        Raises:
            ConfigurationError: there is no controller, or it failed.
        """
        scene, config = self.scene, self.scene.config
        self._truth = truth = scene.truth()
        self._twist = _twist(command)
        self._lost += config.period * (truth.kind == "none" and scene.stamp > 0.0)
        if command is not None and command.mode == ARRIVED:
            self._ending = Ending.ARRIVED
        elif math.hypot(*truth.object[:2]) > config.furthest:
            self._ending = Ending.AWAY
        elif self._lost > config.longest_lost:
            self._ending = Ending.LOST
        elif scene.stamp >= config.longest:
            self._ending = Ending.TIMEOUT

    def cycle(self, step: Step) -> Cycle:
        """The cycle that a step closed."""
        assert self._truth is not None  # its command was sent
        return Cycle(self._readings, step, self._truth, self._ending)

    def facts(self) -> Facts:
        """The true contact, and the true pose of the object."""
        return self.scene.facts()

    def verdict(self, pipeline: Pipeline, last: Step) -> Verdict:
        """The ending of the push, and the distance of its true contact from the target."""
        truth, ending = self._truth, self._ending
        assert truth is not None  # there was a step
        within = self.scene.config.within
        success = ending == Ending.ARRIVED and truth.distance <= within
        if truth.kind == "none":
            touches = "the object does not touch the robot"
        else:
            touches = f"the object touches {truth.distance:.3f} m from the target"
        values = {
            "ending": str(ending),
            "time": truth.stamp,
            "success": success,
            "kind": truth.kind,
            "distance": None if math.isnan(truth.distance) else truth.distance,
            "base": list(truth.base),
            "object": list(truth.object),
        }
        word = "success" if success else "no success"
        return Verdict(values, (f"{ending} after {truth.stamp:.1f} s; {touches}: {word}",))


@hookimpl
def contactfusion_scenes() -> dict[str, type[Scene]]:
    """The scene, as a plug-in."""
    return {"push": Pushing}
