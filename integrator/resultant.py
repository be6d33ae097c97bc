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
        force: shape (3,) [N], on the robot.
        point: shape (3,) [m], on the line of the force.
        spread: standard deviation of the line's position, by axis [m].
    """

    force: FloatArray
    point: FloatArray
    spread: float


def misfit(
    resultant: Resultant, positions: FloatArray, normals: FloatArray | None, friction: float
) -> float:
    """How badly contacts explain a resultant, as χ².

    Their forces lie in their friction cones, of four edges each, and are eliminated by non-negative
    least squares.

    Args:
        resultant: force and line.
        positions: shape (c, 3) [m], c > 0.
        normals: shape (c, 3), out of the robot; None: forces of any direction.
        friction: coefficient of friction.
    """
    from scipy.optimize import nnls

    force = float(np.linalg.norm(resultant.force))
    by_force, by_torque = max(RELATIVE * force, LEAST), TORQUE * force * resultant.spread
    if normals is None:
        edges = np.broadcast_to(np.concatenate([np.eye(3), -np.eye(3)]), (len(positions), 6, 3))
    else:
        edges = _edges(normals, friction)
    torques = np.cross((positions - resultant.point)[:, None, :], edges)
    columns = np.concatenate([edges / by_force, torques / by_torque], axis=2).reshape(-1, 6)
    wanted = np.concatenate([resultant.force / by_force, np.zeros(3)])
    return float(nnls(columns.T, wanted)[1]) ** 2


def _edges(normals: FloatArray, friction: float) -> FloatArray:
    """Four edges of the friction cone into the surface at each place, shape (c, 4, 3)."""
    across = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, across)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    sides = np.stack([first, -first, second, -second], axis=1)
    return np.asarray(friction * sides - normals[:, None, :], np.float64)
