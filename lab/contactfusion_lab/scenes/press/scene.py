"""An arm in motion that is pressed anywhere: the readings of its sensors, apart from the truth."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.spatial import KDTree

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.frames import points_in, vectors_in
from contactfusion.hooks import hookimpl
from contactfusion.pipeline import Pipeline, Step
from contactfusion.readings import Reading
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion.robots.solids import Solid
from contactfusion.scene import Scene
from contactfusion.shapes import ShapeConfig
from contactfusion.stream import Arrival, Facts, Verdict
from contactfusion_lab.scenes.approach import led_by
from contactfusion_lab.scenes.arm import STEP
from contactfusion_lab.scenes.facts import true_contact
from contactfusion_lab.scenes.press.config import PressConfig
from contactfusion_lab.scenes.press.drives import Drives
from contactfusion_lab.scenes.touch.scene import UNION, touch_verdict
from contactfusion_lab.scenes.touch.sensors import TouchSensors
from contactfusion_lab.scenes.touch.world import Touching, TouchWorld, contacts_of

RADIUS = 0.02
"""Of a probe, about that of a fist's knuckle [m]."""
GAP = 0.003
"""Distance from which a probe comes [m]."""
CLEAR = 0.01
"""Least distance of a probe from other links, and least height of the arm over the floor [m]."""
APART = 0.1
"""Least distance of two probes [m]."""
AIMS, DIRECTIONS = 2000, 20
"""Number of points on links that are tried, and of directions of motion for each."""
ALONG = 0.5
"""The least part of the velocity of a point that is along the normal where a probe comes."""
START = 0.3
"""Time in which the arm comes to its speed [s]."""
STEEPEST = 1.875
"""Greatest speed on a path of least jerk, of which the mean is 1."""
REST = 0.7
"""Time for which the arm rests in each posture [s]."""
INNER = 0.8
"""Postures lie in that part of the range of each joint, about its middle."""
WIDEST = 2.5
"""Range that is taken of joints without limits, either way [rad]."""


@dataclass(frozen=True, eq=False)
class Aim:
    """Where a probe comes.

    Attributes:
        link: that is pressed.
        point: shape (3,), in the link's frame [m].
        normal: shape (3,), out of the link, in its frame.
    """

    link: str
    point: FloatArray
    normal: FloatArray


class PressScene(Scene):
    """An arm in motion that is pressed; its readings can be iterated once.

    Args:
        config: the motion, and how the sensors err.
        robot: the arm, its root link at the origin.
        seed: of all random draws but those of the specimen.

    Raises:
        RobotError: the robot lacks a link that is named.
        ConfigurationError: the drives are those of another robot.
    """

    Config = PressConfig

    def __init__(self, config: PressConfig, robot: RobotModel, seed: int = 0) -> None:
        self.config, self.robot = config, robot
        robot.urdf.require_link(config.tool)
        moved = [name for name in robot.joint_names if name not in robot.config.still]
        for field in ("noise", "coulomb"):
            given = len(getattr(config.drives, field))
            if given != len(moved):
                raise ConfigurationError(
                    f"{given} values for the {len(moved)} joints {', '.join(moved)}",
                    f"drives.{field}",
                )
        self._moves = np.array([name in moved for name in robot.joint_names])
        self._rng = np.random.default_rng(seed)
        sensor_rng, drive_rng = self._rng.spawn(2)
        self._drives = Drives(
            config.drives, robot, np.random.default_rng([config.specimen, len(moved)]), drive_rng
        )
        self._world = TouchWorld(robot, {}, config.friction)
        self._drives.weigh(self._world.physics)
        self._sensor_rng = sensor_rng
        self._tip = Solid([ShapeConfig(shape="sphere", radius=RADIUS)])
        self._low, self._high = _inner_limits(robot)
        self._stamp, self._moments = 0.0, list[Touching]()
        self.onset = np.nan
        """Stamp of the first contact [s]; NaN without any."""

    @classmethod
    def opened(cls, config: PressConfig, robot: RobotConfig, seed: int) -> Self:
        """A scene at its start."""
        return cls(config, shared_robot(robot), seed)

    @property
    def now(self) -> float:
        """The time of the physics [s]."""
        return self._stamp

    @property
    def touching(self) -> Touching:
        """The true contacts of the last 50 ms."""
        return contacts_of(self._moments)

    def facts(self) -> Facts:
        """The true contacts of the last 50 ms."""
        stamp, root, now = self._stamp, self.robot.root, self.touching
        contacts = tuple(
            true_contact(stamp, root, position, force)
            for position, force in zip(now.places, now.forces, strict=True)
        )
        return Facts(stamp, root, contacts, ())

    def verdict(self, pipeline: Pipeline, last: Step) -> Verdict:
        """The true contacts at the end, and the distance of reported ones from them."""
        return touch_verdict(self.touching, self.robot.root, pipeline, last)

    def arrivals(self) -> Iterator[Arrival]:
        """The readings with the times at which they come."""
        for reading in self.readings():
            yield Arrival(self._stamp, (reading,))

    def readings(self) -> Iterator[Reading]:
        """All readings: the arm moves, is pressed, and moves on.

        Raises:
            RobotError: it can be pressed in no posture that was tried.
        """
        config = self.config
        aims, course = self._pressed() if config.places else ([], self._free())
        comes = round(config.lead / STEP)
        arm = self._world.arm(course[0], np.full(len(course[0]), config.stiffness))
        sensors = TouchSensors(
            self.robot, config.tool, led_by(self.robot, config.tool), course[0], config.noise,
            self._sensor_rng,
        )  # fmt: skip
        period = round(1.0 / config.rate / STEP)
        image = round(1.0 / config.camera_rate / STEP)
        window = np.zeros((period, 4, len(course[0])))
        self._moments = [self._world.touching()]
        for step, commanded in enumerate(course[1:], start=1):
            if step == comes:
                for aim in aims:
                    self._press(aim, arm.positions)
            if step % 200 == 0:
                arm.adapt(arm.positions)
            arm.step(commanded, self._drives.friction(arm.velocities))
            window[step % period] = arm.positions, arm.velocities, arm.torques, arm.dragged
            self._look(step)
            stamp = self._stamp
            if step % period == 0:
                middle = stamp - 0.5 * (period - 1) * STEP
                yield self._drives.read(middle, *window.mean(axis=0))
                yield from sensors.wrenches(stamp, arm.positions, self._world.felt())
            if step % image == 0 or step == len(course) - 1:
                poses = self.robot.poses_at(arm.positions)
                bodies = [(solid, poses[name]) for name, solid in self.robot.solids.items()]
                bodies += [(self._tip, pose) for pose in self._world.balls()]
                yield from sensors.sights(stamp, poses, bodies)

    def _look(self, step: int) -> None:
        """Take note of the true contacts after a step of the physics."""
        self._stamp = step * STEP
        self._moments = [*self._moments[1 - round(UNION / STEP) :], self._world.touching()]
        if np.isnan(self.onset) and self._moments[-1].links:
            self.onset = self._stamp

    def _press(self, aim: Aim, positions: FloatArray) -> None:
        """Let a probe come to where a link is at joint positions, shape (n,) [rad, m]."""
        pose = self.robot.poses_at(positions)[aim.link]
        point, normal = points_in(pose, aim.point[None])[0], vectors_in(pose, aim.normal[None])[0]
        self._world.press(point, normal, RADIUS, GAP, self.config.press, yields=True)

    def _posture(self) -> FloatArray:
        """Random joint positions, shape (n,) [rad, m]."""
        return self._rng.uniform(self._low, self._high)

    def _is_free(self, positions: FloatArray) -> bool:
        """Whether the arm, but for what one joint moves at most, is over the floor."""
        poses = self.robot.poses_at(positions)
        return all(
            points_in(poses[name], self.robot.parts[name].points)[:, 2].min() > CLEAR
            for name in self._links()
            if name in self.robot.parts
        )

    def _links(self) -> tuple[str, ...]:
        """The links that may be pressed."""
        if self.config.links:
            return self.config.links
        robot, rest = self.robot, np.clip(np.zeros(len(self._low)), self._low, self._high)
        moved = {
            name: int(np.abs(robot.jacobian(name, rest) * self._moves).any(axis=0).sum())
            for name in robot.parts
        }
        return tuple(name for name, count in moved.items() if count >= 2)

    def _pressed(self) -> tuple[list[Aim], FloatArray]:
        """Where probes come, and the commanded positions of each step, (steps + 1, n) [rad, m]."""
        config, rng, robot = self.config, self._rng, self.robot
        links = self._links()
        open_points = {name: np.flatnonzero(robot.exposed[name]) for name in links}
        beyond = {*robot.beyond(config.tool)} & {*links}
        arm = [name for name in links if name not in beyond] if config.places > 1 else [*links]
        for _ in range(AIMS):
            posture = self._posture()
            if not self._is_free(posture):
                continue
            chosen = [str(rng.choice(arm))]
            if config.places > 1:
                chosen.append(str(rng.choice(sorted(beyond))))
            aims = [self._aim(name, int(rng.choice(open_points[name]))) for name in chosen]
            if not self._come_free(aims, posture):
                continue
            for _ in range(DIRECTIONS):
                rates = np.where(self._moves, rng.uniform(-1.0, 1.0, len(posture)), 0.0)
                rates *= rng.uniform(*config.speed) / np.abs(rates).max()
                if all(self._meets(aim, posture, rates) for aim in aims):
                    course = self._through(posture, rates)
                    inside = (course >= self._low) & (course <= self._high)
                    if inside.all() and self._is_free(course[0]) and self._is_free(course[-1]):
                        return aims, course
        raise RobotError(f"the arm can be pressed in none of {AIMS} postures that were tried")

    def _aim(self, link: str, row: int) -> Aim:
        part = self.robot.parts[link]
        return Aim(link, part.points[row], part.normals[row])

    def _come_free(self, aims: list[Aim], posture: FloatArray) -> bool:
        """Whether probes touch nothing before they press, and are apart."""
        poses = self.robot.poses_at(posture)
        tips = np.concatenate(
            [
                points_in(poses[aim.link], (aim.point + (RADIUS + GAP) * aim.normal)[None])
                for aim in aims
            ]
        )
        parts = self.robot.parts.items()
        solid = KDTree(
            np.concatenate([points_in(poses[name], part.points) for name, part in parts])
        )
        others = [
            np.linalg.norm(first - second) for first, second in itertools.combinations(tips, 2)
        ]
        return bool(np.min(solid.query(tips)[0]) >= RADIUS and min(others, default=1.0) >= APART)

    def _meets(self, aim: Aim, posture: FloatArray, rates: FloatArray) -> bool:
        """Whether a point of a link moves towards its outside, at joint velocities (n,)."""
        pose = self.robot.poses_at(posture)[aim.link]
        twist = self.robot.jacobian(aim.link, posture) @ rates
        arm = vectors_in(pose, aim.point[None])[0]
        velocity = twist[:3] + np.cross(twist[3:], arm)
        normal = vectors_in(pose, aim.normal[None])[0]
        return bool(normal @ velocity >= ALONG * np.linalg.norm(velocity))

    def _through(self, posture: FloatArray, rates: FloatArray) -> FloatArray:
        """Commanded positions that pass a posture when the probes come, (steps + 1, n)."""
        config = self.config
        stamps = np.arange(round((config.lead + config.hold) / STEP) + 1) * STEP
        part = np.minimum(stamps / START, 1.0)
        travelled = np.where(
            stamps < START, START * (part**3 - 0.5 * part**4), stamps - 0.5 * START
        )
        travelled -= config.lead - 0.5 * START
        return np.asarray(posture + travelled[:, None] * rates)

    def _free(self) -> FloatArray:
        """Commanded positions from posture to posture, shape (steps + 1, n) [rad, m]."""
        steps = round(self.config.seconds / STEP)
        postures = (self._posture() for _ in itertools.count())
        positions = next(filter(self._is_free, postures))
        parts, count = [positions[None]], 1
        while count <= steps:
            following = self._posture()
            if not all(self._is_free(each) for each in np.linspace(positions, following, 8)[1:]):
                continue
            speed = self._rng.uniform(*self.config.speed)
            seconds = STEEPEST * np.abs(following - positions).max() / speed
            t = np.linspace(0.0, 1.0, max(round(seconds / STEP), 1) + 1)[1:, None]
            parts.append(
                positions + t**3 * (10.0 - 15.0 * t + 6.0 * t**2) * (following - positions)
            )
            parts.append(np.tile(following, (round(REST / STEP), 1)))
            count += len(t) + len(parts[-1])
            positions = following
        return np.concatenate(parts)[: steps + 1]


def _inner_limits(robot: RobotModel) -> tuple[FloatArray, FloatArray]:
    """Between which positions joints move, shape (n,) each [rad, m]."""
    low, high = np.clip(robot.limits.T, -WIDEST, WIDEST)
    middle, half = (low + high) / 2.0, INNER * (high - low) / 2.0
    still = robot.known_positions(None)[0]
    fixed = np.array([name in robot.config.still for name in robot.joint_names])
    return np.where(fixed, still, middle - half), np.where(fixed, still, middle + half)


@hookimpl
def contactfusion_scenes() -> dict[str, type[Scene]]:
    """The scene, as a plug-in."""
    return {"press": PressScene}
