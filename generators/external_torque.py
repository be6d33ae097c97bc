"""The torques that contacts load joints with, from what joints report.

A momentum observer (De Luca et al. 2006): r' = K (p' − τ − Cᵀq' + g − r) tells the torque that
nothing of motor, friction and gravity explains, with a lag of 1/K, from positions and velocities
alone; accelerations are not needed.
"""

from collections.abc import Iterable, Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import InvalidReadingError, name_hint
from contactfusion.readings import JointState
from contactfusion.robots.description import EffortConfig
from contactfusion.robots.dynamics import Dynamics

LONGEST = 0.25
"""After a longer silence the observer begins again [s]."""
MOST = 1e9
"""A greater effort is none [N·m, N, A]."""
SMOOTH = 0.05
"""Time over which positions that come between readings become a velocity [s]."""
SMALLEST = 1e-3
"""The least standard deviation of an effort: of less, a place would be a matter of rounding [N·m,
N]."""
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
        model = dynamics.model
        self._names = model.joint_names
        self._turning = model.turning
        self._follows = {
            name: model.urdf.mimics[name].joint
            for name in self._names
            if name in model.urdf.mimics and name not in model.config.still
        }
        self.known = np.array([name in joints for name in self._names], np.bool_)
        """The joints whose efforts are known, shape (n,)."""
        blank = EffortConfig(noise=1.0)
        own = [joints.get(name, blank) for name in self._names]
        fields = ("noise", "offset", "per_unit", "coulomb", "viscous")
        self._noise, self._offset, self._constant, self._coulomb, self._viscous = (
            np.array([getattr(joint, field) for joint in own]) for field in fields
        )
        self._noise = np.maximum(self._noise, SMALLEST)
        if sign == "by_robot":
            self._constant = -self._constant
        self.reset()

    def reset(self) -> None:
        """Begin again."""
        self.share = 1.0
        """The part of a sudden change that the last update took up."""
        self.reported: FloatArray = np.zeros(len(self._names))
        """The efforts of the last update, shape (n,), in their own units."""
        count = len(self._names)
        self._stamp = -np.inf
        self._positions, self._between = np.zeros((2, count))
        self._momentum: FloatArray | None = None
        self._residual = self._inertial = self._sticking = np.zeros(count)
        self._found: tuple[FloatArray, FloatArray] | None = None

    def update(
        self, reading: JointState, positions: FloatArray, gravity: FloatArray
    ) -> tuple[FloatArray, FloatArray] | None:
        """The torques of contacts by joint, and their standard deviations, both of shape (n,).

        Args:
            reading: of the joints; one of the same stamp as the last, or that this has overtaken,
                changes nothing.
            positions: shape (n,), of all joints of the robot [rad, m].
            gravity: shape (3,) [m/s²], in the root link's frame.

        Returns:
            None before they are known: at first, after a gap, and one reading longer where
            velocities have to be the differences of positions.

        Raises:
            InvalidReadingError: it has no effort of a joint that is known.
        """
        reported = self._efforts(reading)
        efforts = self._constant * (reported - self._offset)
        if self._effort == "external":
            return efforts, self._deviations(efforts)
        elapsed = reading.stamp - self._stamp
        if -LONGEST < elapsed <= 0.0:
            self.share = 0.0
            return self._found
        self.reported = reported
        is_next = 0.0 < elapsed <= LONGEST
        velocities = self._velocities(reading, positions, elapsed if is_next else None)
        self._stamp, self._positions = reading.stamp, positions
        before = self._momentum if is_next else None
        momentum = None if velocities is None else self._dynamics.momentum(positions, velocities)
        self._momentum = momentum
        if before is None or momentum is None or velocities is None:
            self._residual = self._inertial = self._sticking = np.zeros(len(positions))
            self._found = None
            return None
        sliding = np.tanh(velocities / SLOW)
        friction = self._coulomb * sliding + self._viscous * velocities
        drift = self._dynamics.drift(positions, velocities, gravity)
        change = momentum - before - (efforts - friction + drift) * elapsed
        step = self._gain * elapsed
        self.share = step / (1.0 + step)
        self._residual = (self._residual + self._gain * change) / (1.0 + step)
        gained = self._gain * (momentum - before)
        self._inertial = (self._inertial + gained) / (1.0 + step)
        # what friction held before a joint broke away is in the residual for as long as this lags
        sticking = self._coulomb * (1.0 - sliding**2)
        self._sticking = (self._sticking + step * sticking) / (1.0 + step)
        deviations = self._deviations(self._residual, self._inertial, self._sticking)
        self._found = self._residual, deviations
        return self._found

    def _velocities(
        self, reading: JointState, positions: FloatArray, elapsed: float | None
    ) -> FloatArray | None:
        """As measured, or by differences of positions; None before there is a difference.

        Positions of joints that the reading does not hold come when they come: their differences
        are smoothed.

        Args:
            reading: of some joints.
            positions: shape (n,), of all.
            elapsed: since the last reading [s]; None: since too long ago.
        """
        model, values = self._dynamics.model, reading.velocities
        pairs = () if values is None else zip(reading.names, values.tolist(), strict=True)
        measured = {name: value for name, value in pairs if value == value}
        held, known = self._among(reading.names), self._among(measured)
        if elapsed is None:
            self._between = np.zeros(len(positions))
            return model.speeds(measured) if known[held].all() else None
        moved = positions - self._positions
        moved[self._turning] = (moved[self._turning] + np.pi) % (2.0 * np.pi) - np.pi
        speeds = moved / elapsed
        self._between = self._between + elapsed / (SMOOTH + elapsed) * (speeds - self._between)
        return np.where(known, model.speeds(measured), np.where(held, speeds, self._between))

    def _among(self, names: Iterable[str]) -> NDArray[np.bool_]:
        """Which joints are among some, or follow one that is, shape (n,)."""
        among = set(names)
        return np.array(
            [not among.isdisjoint((name, self._follows.get(name))) for name in self._names]
        )

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

    def _efforts(self, reading: JointState) -> FloatArray:
        """Efforts in the order of the robot's joints, 0 where none is known, shape (n,).

        Raises:
            InvalidReadingError: that of a known joint is missing.
        """
        if reading.efforts is None:
            raise InvalidReadingError(
                f"{reading.label} has no efforts; a driver that reports torques or currents fills "
                "`effort`"
            )
        rows = {name: row for row, name in enumerate(reading.names)}
        found = np.zeros(len(self._names))
        for number in np.flatnonzero(self.known):
            name = self._names[number]
            if name not in rows:
                hint = name_hint(name, reading.names, "joints of the reading")
                raise InvalidReadingError(f"{reading.label} has no effort of '{name}': {hint}")
            found[number] = reading.efforts[rows[name]]
            if not abs(found[number]) <= MOST:
                raise InvalidReadingError(
                    f"{reading.label} has an effort of {found[number]:g} of '{name}'"
                )
        return found
