"""The low-level controller of arm and hand in a grasp: from commands to joint positions."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.controller import Command
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.frames import Pose, vectors_in
from contactfusion.robots.model import RobotModel
from contactfusion_lab.scenes.approach import led_by
from contactfusion_lab.scenes.arm import STEP

SPEED, TURNING = 0.15, 0.6
"""Greatest speeds of the tool [m/s, rad/s]."""
ACCELERATION, ANGULAR_ACCELERATION = 0.3, 1.5
"""Greatest accelerations of the tool; a wrist that carries a hand measures every jerk as a push
[m/s², rad/s²]."""
FASTEST = 1.0
"""Greatest speed of the arm's joints [rad/s, m/s]."""
FINGERS = 0.8
"""Speed of the joints of fingers [rad/s, m/s]."""
EVERY = 10
"""Steps of the physics between updates of the joint velocities."""
SINGULAR = 0.003
"""Damping of least squares near singularities."""
GAIN = 10.0
"""Gain on the deviation of the tool from its goal [1/s]."""
BEHIND = np.array([0.02, 0.02, 0.02, 0.1, 0.1, 0.1])
"""The tool's goal waits when the arm is so far behind it, as at the end of its reach, or at an
obstacle: that limits its force [m, then rad]."""
BENT = BEHIND / 5.0
"""It waits, too, when joints at their limits keep the tool so far off [m, then rad]."""


class GraspDriver:
    """Follows commands as the controller of an arm does, always within joint limits.

    The velocity of the tool becomes that of the joints by damped least squares; its pose is the
    integral of what was commanded, so that it neither drifts nor turns.

    Args:
        model: the robot.
        tool: the link that moves.
        gripper: positions of the joints of fingers, open and closed [rad, m].
        grip: the greatest torque of the fingers [N·m, N].
        press: the greatest force of the arm on what does not give way [N].
        stiffness: shape (n,), of all joints [N·m/rad, N/m].
        positions: shape (n,), of the joints at the start [rad, m].
    """

    def __init__(
        self,
        model: RobotModel,
        tool: str,
        gripper: Mapping[str, tuple[float, float]],
        grip: float,
        press: float,
        stiffness: FloatArray,
        positions: FloatArray,
    ) -> None:
        self._model, self._tool = model, tool
        self._leading, self._limits = led_by(model, tool), model.limits.T
        self._rows = [model.joint_names.index(name) for name in gripper]
        self._open, self._closed = np.array(list(gripper.values())).T
        # the lead of a finger's goal limits its torque
        self._lead = grip / stiffness[self._rows]
        self._press, self._stiffness = press, stiffness
        self.commanded = positions.copy()
        """Commanded joint positions, shape (n,) [rad, m]."""
        self._goal: Pose = model.poses_at(positions)[tool].copy()
        self._target, self._twist = np.zeros(6), np.zeros(6)
        self._joints = np.zeros(len(positions))
        self._speeds = np.zeros(len(positions))
        self.fingers = positions[self._rows]
        """Commanded positions of the gripper's joints, shape (k,) [rad, m]."""
        self._steps = 0

    def obey(self, command: Command) -> None:
        """Accept a command; velocities that it leaves out are 0, the gripper keeps its last goal.

        Raises:
            ConfigurationError: its twist is in a frame that is neither the tool's nor the root's,
                or it moves an unknown joint, or one of the gripper.
        """
        self._target = np.zeros(6)
        if (twist := command.twist) is not None:
            if twist.frame not in (self._tool, self._model.root):
                raise ConfigurationError(
                    f"a twist is given in '{self._tool}' or '{self._model.root}', not in "
                    f"'{twist.frame}'",
                    "controller",
                )
            both = np.stack([twist.linear, twist.angular])
            if twist.frame == self._tool:
                both = vectors_in(self._model.poses_at(self.commanded)[self._tool], both)
            limits = np.array([SPEED, TURNING])
            length = np.maximum(np.linalg.norm(both, axis=1), 1e-12)
            self._target = (both * np.minimum(1.0, limits / length)[:, None]).ravel()
        self._joints = np.zeros(len(self.commanded))
        for name, speed in (command.joint_velocities or {}).items():
            if name not in self._model.joint_names:
                hint = name_hint(name, self._model.joint_names, "joints")
                raise ConfigurationError(f"unknown joint '{name}': {hint}", "controller")
            row = self._model.joint_names.index(name)
            if row in self._rows:
                raise ConfigurationError(f"the gripper leads joint '{name}'", "controller")
            self._joints[row] = min(max(speed, -FASTEST), FASTEST)
        if command.gripper is not None:
            part = min(max(command.gripper, 0.0), 1.0)
            self.fingers = (1.0 - part) * self._open + part * self._closed

    def advance(self, positions: FloatArray) -> FloatArray:
        """The joint positions to command in the next step of the physics.

        Args:
            positions: shape (n,), measured joint positions [rad, m].

        Returns:
            Shape (n,) [rad, m].
        """
        if self._steps % EVERY == 0:
            self._speeds = self._led(positions, EVERY * STEP)
            if self._joints.any():
                self._speeds = np.clip(self._joints + self._speeds, -FASTEST, FASTEST)
        self._steps += 1
        commanded = self.commanded + self._speeds * STEP
        there = self.commanded[self._rows]
        step = np.clip(self.fingers - there, -FINGERS * STEP, FINGERS * STEP)
        now = positions[self._rows]
        commanded[self._rows] = np.clip(there + step, now - self._lead, now + self._lead)
        self.commanded = np.clip(commanded, *self._limits)
        return self.commanded

    def _led(self, positions: FloatArray, period: float) -> FloatArray:
        """Joint velocities that follow the tool's goal, shape (n,) [rad/s, m/s]."""
        most = np.repeat([ACCELERATION, ANGULAR_ACCELERATION], 3) * period
        self._twist = self._twist + np.clip(self._target - self._twist, -most, most)
        actual = self._model.poses_at(positions)[self._tool]
        there = self._model.poses_at(self.commanded)[self._tool]
        if (self._joints * self._leading).any():  # commanded joints decide where the tool goes
            self._goal = there
        if self._pressing(positions) > self._press:  # the spring of the arm is let go
            self._goal[:3, 3], self._twist = actual[:3, 3], np.zeros(6)
        goal = self._goal.copy()
        goal[:3, 3] += self._twist[:3] * period
        goal[:3, :3] = Rotation.from_rotvec(self._twist[3:] * period).as_matrix() @ goal[:3, :3]
        if _comes_along(actual, self._goal, goal, BEHIND) and _comes_along(
            there, self._goal, goal, BENT
        ):
            self._goal = goal
        error = _deviation(there, self._goal)
        jacobian = self._model.jacobian(self._tool, self.commanded) * self._leading
        squared = jacobian @ jacobian.T + SINGULAR**2 * np.eye(6)
        speeds = jacobian.T @ np.linalg.solve(squared, self._twist + GAIN * error)
        led: FloatArray = speeds * min(1.0, FASTEST / max(float(np.abs(speeds).max()), 1e-12))
        return led

    def _pressing(self, positions: FloatArray) -> float:
        """The force of the tool that the springs of the arm's joints make [N]: τ = Jᵀ f."""
        jacobian = self._model.jacobian(self._tool, positions) * self._leading
        torques = self._stiffness * (self.commanded - positions)
        squared = jacobian @ jacobian.T + SINGULAR**2 * np.eye(6)
        return float(np.linalg.norm(np.linalg.solve(squared, jacobian @ torques)[:3]))


def _comes_along(tool: Pose, goal: Pose, further: Pose, most: FloatArray) -> bool:
    """Whether a tool is near enough to a goal that advances, or nearer to it than before."""
    before, after = (float(np.abs(_deviation(tool, pose) / most).max()) for pose in (goal, further))
    return after < max(before, 1.0)


def _deviation(start: Pose, end: Pose) -> FloatArray:
    """The deviation from a pose to another: shape (6,), translation [m], then rotation [rad]."""
    rotation = np.cross(start[:3, :3], end[:3, :3], axis=0).sum(axis=1) / 2.0
    return np.concatenate([end[:3, 3] - start[:3, 3], rotation])
