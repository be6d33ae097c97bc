"""Convex pieces that objects to push are made of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray

Triangles = tuple[FloatArray, NDArray[np.uint32]]
"""Vertices (v, 3) [m], and rows of them that make triangles, (t, 3)."""


@dataclass(frozen=True, eq=False)
class Part:
    """One convex piece of an object, upright.

    Attributes:
        outline: shape (n, 2) [m], its corners seen from above, in the object's frame.
        radius: of a cylinder [m], else None.
        bottom: above the floor [m].
        height: [m].
        mass: [kg].
    """

    outline: FloatArray
    radius: float | None
    bottom: float
    height: float
    mass: float

    @property
    def middle(self) -> FloatArray:
        """The middle of its area, shape (2,) [m], in the object's frame."""
        x, y = self.outline.T
        ahead_x, ahead_y = np.roll(self.outline, -1, axis=0).T
        cross = x * ahead_y - ahead_x * y
        weighted = [((x + ahead_x) * cross).sum(), ((y + ahead_y) * cross).sum()]
        middle: FloatArray = np.array(weighted) / (3.0 * cross.sum())
        return middle

    def moved(self, at: FloatArray, yaw: float, bottom: float) -> "Part":
        """Give the part turned by `yaw` [rad], then moved by `at`, shape (2,) [m], and lifted."""
        outline = self.outline @ _turn(yaw).T + at
        return Part(outline, self.radius, self.bottom + bottom, self.height, self.mass)


def rectangle(x: float, y: float) -> FloatArray:
    """Give the corners of a rectangle about the origin, counterclockwise, shape (4, 2) [m]."""
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) / 2.0


def polygon(sides: int, radius: float) -> FloatArray:
    """Give the corners of a regular polygon, an edge ahead, counterclockwise, shape (n, 2) [m]."""
    angles = 2.0 * np.pi * (np.arange(sides) + 0.5) / sides
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def extruded(part: Part) -> Triangles:
    """Give a convex piece's surface: underside, top, and a strip of walls."""
    count = len(part.outline)
    low, high = (
        np.column_stack([part.outline, np.full(count, z)])
        for z in (part.bottom, part.bottom + part.height)
    )
    here = np.arange(count)
    there = np.roll(here, -1)
    fan = np.stack([np.zeros(count - 2, np.intp), here[1:-1], here[2:]], axis=1)
    walls = [
        np.stack([here, there, there + count], axis=1),
        np.stack([here, there + count, here + count], axis=1),
    ]
    triangles = np.concatenate([fan[:, ::-1], fan + count, *walls])
    return np.concatenate([low, high]), triangles.astype(np.uint32)


def _turn(yaw: float) -> FloatArray:
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
