"""A wrench as the resultant of all contacts: which of them it needs (method §2)."""

from typing import NamedTuple

import numpy as np

from contactfusion.arrays import FloatArray

RELATIVE, LEAST = 0.1, 0.2
"""Standard deviation of a measured force: this part of it, and at least so much [N]."""
TORQUE = 1.5
"""Standard deviation of a torque, in forces times the spread of the source's positions."""


class Resultant(NamedTuple):
    """What a source of a single contact measures, as the sum over all contacts.

    Attributes:
        source: its name.
        force: shape (3,) [N], on the robot.
        point: shape (3,) [m], on the line of the force.
        spread: standard deviation of the line's position, by axis [m].
    """

    source: str
    force: FloatArray
    point: FloatArray
    spread: float

    def wrenches(
        self, positions: FloatArray, normals: FloatArray | None, friction: float
    ) -> FloatArray:
        """What contacts can add along each edge of their friction cones, shape (c, e, 6).

        In standard deviations of the measured force and torque.

        Args:
            positions: shape (c, 3) [m], c > 0.
            normals: shape (c, 3), out of the robot; None: forces of any direction.
            friction: coefficient of friction.
        """
        if normals is None:
            edges = np.broadcast_to(np.concatenate([np.eye(3), -np.eye(3)]), (len(positions), 6, 3))
        else:
            edges = _edges(normals, friction)
        torques = np.cross((positions - self.point)[:, None, :], edges)
        by_force, by_torque = self._deviations
        return np.concatenate([edges / by_force, torques / by_torque], axis=2)

    def explained(self, wrenches: FloatArray) -> tuple[float, FloatArray]:
        """How badly contacts explain the resultant, as χ², and how hard each presses, shape (c,).

        Their forces are found by non-negative least squares.

        Args:
            wrenches: shape (c, e, 6), c > 0, as `wrenches` gives them.
        """
        from scipy.optimize import nnls

        wanted = np.concatenate([self.force / self._deviations[0], np.zeros(3)])
        along, rest = nnls(wrenches.reshape(-1, 6).T, wanted)
        return float(rest) ** 2, along.reshape(wrenches.shape[:2]).sum(axis=1)

    @property
    def _deviations(self) -> tuple[float, float]:
        """Standard deviations of the force [N] and the torque [N·m], by axis."""
        force = float(np.linalg.norm(self.force))
        return max(RELATIVE * force, LEAST), TORQUE * force * self.spread


def _edges(normals: FloatArray, friction: float) -> FloatArray:
    """Four edges of the friction cone into the surface at each place, shape (c, 4, 3)."""
    across = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, across)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    sides = np.stack([first, -first, second, -second], axis=1)
    return np.asarray(friction * sides - normals[:, None, :], np.float64)
