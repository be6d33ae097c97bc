"""Motion of arm and hand in free air, past an object that is not touched."""

from collections.abc import Iterator

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError
from contactfusion.readings import JointCommand, Reading
from contactfusion.robots.model import RobotModel
from contactfusion_lab.scenes.arm import STEP
from contactfusion_lab.scenes.touch.config import TouchConfig
from contactfusion_lab.scenes.touch.scene import EVERY, TouchScene, Truth, drawn_posture
from contactfusion_lab.scenes.touch.sensors import TouchSensors
from contactfusion_lab.scenes.touch.world import contacts_of

CLEARANCE = 0.02
"""Least distance of a path from all bodies [m]."""
REACH = 0.6
"""Joints of the arm move so far from a posture close to the object, either way [rad, m]."""
SPEEDS = (0.2, 0.5)
"""From these the greatest joint speed of a path is drawn [rad/s, m/s]."""
SPACING = 0.02
"""Greatest step of a joint between postures that are checked [rad, m]."""
TRIES = 300
"""How many postures are drawn for the next one."""
STEEPEST = 1.875
"""Greatest speed on a path of least jerk, of which the mean is 1."""


class FreeMotion(TouchScene):
    """Arm and hand go through random postures, the hand on every other path.

    What they are commanded is a reading, too; readings can be iterated once.

    Args:
        config: the touch of which are robot, objects, sensors and their errors; its `posture`
            says where the postures lie.
        robot: the robot, its root link at the origin.
        seed: of all random draws.
        seconds: how long it lasts [s].

    Raises:
        RobotError: the robot lacks a link that is named.
        ConfigurationError: a joint or the frame of an object is not what it should be.
    """

    def __init__(
        self, config: TouchConfig, robot: RobotModel, seed: int = 0, seconds: float = 10.0
    ) -> None:
        super().__init__(config, robot, seed)
        self._steps = round(seconds / STEP)

    def readings(self) -> Iterator[Reading]:
        """All readings: paths of least jerk from posture to posture.

        Raises:
            RobotError: there is no posture, or no path to another, without a contact.
        """
        config, course = self.config, self._course()
        arm = self._world.arm(course[0], self._stiffness())
        sensors = TouchSensors(
            self.robot, config.tool, self._leading, course[0], config.noise, self._rng
        )
        yield from sensors.believed({config.touched: self._target})
        self._moments = [self._world.touching()]
        for step, positions in enumerate(course[1:], start=1):
            yield from self._late.until(
                (step - 1) * STEP, self._sensed(sensors, arm, step - 1, last=False)
            )
            if (step - 1) % round(EVERY["joints"] / STEP) == 0:
                arm.adapt(arm.positions)
                yield self._command(positions)
            arm.step(positions)
            self._look(step)
        last = self._sensed(sensors, arm, self._steps, last=True)
        yield from self._late.until(self._steps * STEP, last)
        contacts = contacts_of(self._moments)
        self._truth = Truth(contacts, arm.positions, False, self._onset)

    def _command(self, positions: FloatArray) -> JointCommand:
        """What all joints that move are commanded now; `positions` of shape (n,) [rad, m]."""
        moved = {
            name: position
            for name, position in zip(self.robot.joint_names, positions.tolist(), strict=True)
            if name not in self.robot.config.still
        }
        return JointCommand(
            stamp=self.now,
            frame=self.robot.root,
            sensor="joints",
            names=tuple(moved),
            positions=np.array(list(moved.values())),
        )

    def _course(self) -> FloatArray:
        """Commanded positions at the start and after each step, shape (steps + 1, n) [rad, m]."""
        path = self._path()
        if self.config.noise.clutter:
            self._clutter = self._cluttered(path)
            self._world.stand(self._clutter)
        self._before = path.joints[0]
        positions = self._next(None)
        parts, count = [positions[None]], 1
        while count <= self._steps:
            following = self._next(positions, still=len(parts) % 2 == 1)
            furthest = np.abs(following - positions).max()
            seconds = STEEPEST * furthest / self._rng.uniform(*SPEEDS)
            t = np.linspace(0.0, 1.0, max(round(seconds / STEP), 1) + 1)[1:, None]
            parts.append(
                positions + t**3 * (10.0 - 15.0 * t + 6.0 * t**2) * (following - positions)
            )
            count += len(t)
            positions = following
        course: FloatArray = np.concatenate(parts)[: self._steps + 1]
        return course

    def _next(self, positions: FloatArray | None, still: bool = False) -> FloatArray:
        """A random posture that is free, as is the straight path to it in the space of joints.

        Args:
            positions: where the path begins, shape (n,) [rad, m]; None: there is no path.
            still: whether the hand keeps its posture.

        Raises:
            RobotError: none is found.
        """
        for _ in range(TRIES):
            drawn = drawn_posture(self.config, self.robot, self._rng)
            away = self._rng.uniform(-REACH, REACH, len(drawn))
            drawn = np.where(self._leading > 0.0, self._before + away, drawn)
            drawn = np.clip(drawn, *self.robot.limits.T)
            if positions is not None and still:
                drawn = np.where(self._leading > 0.0, drawn, positions)
            start = drawn if positions is None else positions
            count = int(np.abs(drawn - start).max() / SPACING) + 2
            path = np.linspace(drawn, start, count)
            if not any(self._world.blocked(each, set(), "", CLEARANCE) for each in path):
                return drawn
        raise RobotError(
            f"of {TRIES} postures about that of the scene, none is reached without a contact"
        )
