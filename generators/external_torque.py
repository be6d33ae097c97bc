"""The torques that contacts load joints with, from what joints report.

A momentum observer (De Luca et al. 2006): r' = K (p' − τ − Cᵀq' + g − r) tells the torque that
nothing of motor, friction and gravity explains, with a lag of 1/K, from positions and velocities
alone; accelerations are not needed.
"""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import InvalidReadingError, name_hint
from contactfusion.readings import JointState
from contactfusion.robots.description import EffortConfig
from contactfusion.robots.dynamics import Dynamics

LONGEST = 0.1
"""After a longer silence the observer begins again [s]."""
SLOW = 0.01
"""Speed at which friction turns from sticking to sliding [rad/s, m/s]."""
Effort = Literal["external", "measured", "current"]
Sign = Literal["on_robot", "by_robot"]


class ExternalTorque:
    """Follows the joints of a robot, and tells the torques of contacts.

    Args:
        dynamics: of the robot.
        joints: what is known of their efforts, by name; all others report none.
        effort: what they report: the torque of contacts, of motors, or the motors' currents.
        gain: K of the observer [1/s].
        scale: standard deviation of torques of contacts and of inertia, as a part of them.
        sign: whether they report torques on the robot, or of the robot.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        joints: Mapping[str, EffortConfig],
        effort: Effort,
        gain: float,
        scale: float,
        sign: Sign = "on_robot",
    ) -> None:
        self._dynamics, self._effort, self._gain, self._scale = dynamics, effort, gain, scale
        self._names = dynamics.model.joint_names
        self.known = np.array([name in joints for name in self._names], np.bool_)
        """The joints whose efforts are known, shape (n,)."""
        blank = EffortConfig(noise=1.0)
        own = [joints.get(name, blank) for name in self._names]
        fields = ("noise", "offset", "constant", "coulomb", "viscous")
        self._noise, self._offset, self._constant, self._coulomb, self._viscous = (
            np.array([getattr(joint, field) for joint in own]) for field in fields
        )
        if sign == "by_robot":
            self._constant = -self._constant
        self.reset()

    def reset(self) -> None:
        """Begin again."""
        self.share = 1.0
        """The part of a sudden change that the last update took up."""
        self._last: JointState | None = None
        self._positions = self._momentum = np.zeros(len(self._names))
        self._residual = self._inertial = np.zeros(len(self._names))

    def update(
        self, reading: JointState, positions: FloatArray, gravity: FloatArray
    ) -> tuple[FloatArray, FloatArray] | None:
        """The torques of contacts by joint, and their standard deviations, both of shape (n,).

        Args:
            reading: of the joints.
            positions: shape (n,), of all joints of the robot [rad, m].
            gravity: shape (3,) [m/s²], in the root link's frame.

        Returns:
            None before they are known.

        Raises:
            InvalidReadingError: it has no effort of a joint that is known.
        """
        efforts = self._constant * (self._of_joints(reading, reading.efforts) - self._offset)
        if self._effort == "external":
            return efforts, self._deviations(efforts)
        elapsed = reading.stamp - self._last.stamp if self._last else np.inf
        velocities = self._velocities(reading, positions, elapsed)
        self._last, self._positions = reading, positions
        momentum = self._dynamics.momentum(positions, velocities)
        if not 0.0 < elapsed <= LONGEST:
            self._momentum, self._residual, self._inertial = momentum, *np.zeros((2, len(momentum)))
            return None
        sliding = np.tanh(velocities / SLOW)
        friction = self._coulomb * sliding + self._viscous * velocities
        drift = self._dynamics.drift(positions, velocities, gravity)
        change = momentum - self._momentum - (efforts - friction + drift) * elapsed
        step = self._gain * elapsed
        self.share = step / (1.0 + step)
        self._residual = (self._residual + self._gain * change) / (1.0 + step)
        gained = self._gain * (momentum - self._momentum)
        self._inertial = (self._inertial + gained) / (1.0 + step)
        self._momentum = momentum
        sticking = self._coulomb * (1.0 - sliding**2)
        return self._residual, self._deviations(self._residual, self._inertial, sticking)

    def _velocities(self, reading: JointState, positions: FloatArray, elapsed: float) -> FloatArray:
        """As measured, or by the difference of positions."""
        if reading.velocities is not None:
            known = np.array([name in reading.names for name in self._names])
            return np.where(known, self._of_joints(reading, reading.velocities, False), 0.0)
        if not 0.0 < elapsed <= LONGEST:
            return np.zeros(len(self._names))
        return np.asarray((positions - self._positions) / elapsed, np.float64)

    def _deviations(
        self,
        torques: FloatArray,
        inertial: FloatArray | float = 0.0,
        sticking: FloatArray | float = 0.0,
    ) -> FloatArray:
        """By noise, a wrong scale, and friction at rest, which is anywhere within its limits."""
        scaled = self._scale**2 * (torques**2 + np.square(inertial))
        squares = self._noise**2 + scaled + np.square(sticking) / 3.0
        return np.asarray(np.sqrt(squares), np.float64)

    def _of_joints(
        self, reading: JointState, values: FloatArray | None, needed: bool = True
    ) -> FloatArray:
        """Values in the order of the robot's joints, 0 where there is none, shape (n,)."""
        if values is None:
            raise InvalidReadingError(
                f"{reading.label} has no efforts; a driver that reports torques or currents fills "
                "`effort`"
            )
        rows = {name: row for row, name in enumerate(reading.names)}
        found = np.zeros(len(self._names))
        for number in np.flatnonzero(self.known):
            name = self._names[number]
            if name in rows:
                found[number] = values[rows[name]]
            elif needed:
                hint = name_hint(name, reading.names, "joints of the reading")
                raise InvalidReadingError(f"{reading.label} has no effort of '{name}': {hint}")
        return found
