"""Proximity of objects to the face of a base, strip by strip (O §II-C, IV-A)."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.jit import kernel
from contactfusion.model import Model
from contactfusion.units import Nearby, Spacing

ROUNDING = 1e-9
"""Tolerance within which a region is a whole number of cells."""

MOST_CELLS = 1000
"""The greatest number of cells along each axis."""


def _ordered(value: tuple[float, float]) -> tuple[float, float]:
    if value[1] <= value[0]:
        raise ValueError("give the lower bound, then the upper")
    return value


Span = Annotated[tuple[Nearby, Nearby], AfterValidator(_ordered)]
CellEdge = Annotated[Spacing, Field(gt=0)]


class BoxConfig(Model):
    """An upright box in the robot's frame."""

    x: Span
    """Least and greatest x [m]."""
    y: Span
    """Least and greatest y [m]."""
    z: Span
    """Least and greatest z [m]."""

    def holds(self, points: FloatArray) -> NDArray[np.bool_]:
        """Which points lie inside, shape (n,); those that are not finite do not."""
        bounds = np.array((self.x, self.y, self.z), points.dtype)
        return _between(np.ascontiguousarray(points), bounds)


@kernel
def _between(points: FloatArray, bounds: FloatArray) -> NDArray[np.bool_]:
    """Which points (n, 3) lie between bounds (3, 2)."""
    inside = np.ones(len(points), np.bool_)
    for row in range(len(points)):
        for axis in range(3):
            coordinate = points[row, axis]
            inside[row] &= (coordinate > bounds[axis, 0]) & (coordinate < bounds[axis, 1])
    return inside


class ProximityConfig(Model):
    """The region in front of the face, and its cells as seen from above (O §III-A)."""

    region: BoxConfig = Field(
        default_factory=lambda: BoxConfig(x=(0.30, 0.62), y=(-0.30, 0.30), z=(-0.40, 0.50))
    )
    """The region, in the robot's frame; its lower x is the face [m]."""
    cell: tuple[CellEdge, CellEdge] = (0.02, 0.05)
    """The edges of a cell along x and along y [m]."""
    occupied: int = Field(default=1, ge=1)
    """The least number of points of a LiDAR in an occupied cell; with 2, one false range is
    ignored."""

    @model_validator(mode="after")
    def _whole_cells(self) -> "ProximityConfig":
        for name, bounds, edge in zip("xy", (self.region.x, self.region.y), self.cell, strict=True):
            count = (bounds[1] - bounds[0]) / edge
            if count < 0.5 or abs(count - round(count)) > ROUNDING:
                raise ConfigurationError(
                    f"the region along {name}, {bounds[1] - bounds[0]:g} m, is not a whole number "
                    f"of cells of {edge:g} m",
                    "cell",
                )
            if count > MOST_CELLS:
                raise ConfigurationError(
                    f"the region along {name}, {bounds[1] - bounds[0]:g} m, is {count:.0f} cells "
                    f"of {edge:g} m, more than {MOST_CELLS}",
                    "cell",
                )
        return self

    @property
    def columns(self) -> int:
        """S, the number of strips along y."""
        return round((self.region.y[1] - self.region.y[0]) / self.cell[1])

    @property
    def rows(self) -> int:
        """M, the number of cells of a strip along x."""
        return round((self.region.x[1] - self.region.x[0]) / self.cell[0])

    @property
    def start(self) -> float:
        """The origin of proximity vectors along x: the middle of the first cell (O Eq 8) [m]."""
        return self.region.x[0] + self.cell[0] / 2.0

    @property
    def empty(self) -> float:
        """The length of a strip without a point: to the region's end (O Eq 9) [m]."""
        return abs(self.region.x[1] - self.start)

    def bounds(self) -> FloatArray:
        """The bounds of the strips along y, shape (S + 1,) [m], from right to left."""
        bounds: FloatArray = self.region.y[0] + self.cell[1] * np.arange(self.columns + 1.0)
        return bounds

    def lengths_of_cloud(self, points: FloatArray) -> FloatArray:
        """The proximity of points of a LiDAR, strip by strip (O Eq 5-11).

        A vector starts in the middle of a strip's first cell and ends at the mean x of the points
        in its nearest occupied cell. The norm drops the sign, as in the paper: a mean 2 mm before
        the middle of the first cell and one 2 mm behind it are equal.

        Args:
            points: shape (n, 3) [m], in the robot's frame; rows that are not finite are no points.

        Returns:
            Shape (S,) [m], from right to left; a strip without a point has the length `empty`.
        """
        x, strip = self._inside(points)
        rows, columns = self.rows, self.columns
        row = np.minimum(((x - self.region.x[0]) * (1.0 / self.cell[0])).astype(np.intp), rows - 1)
        cells = strip * rows + row
        counts = np.bincount(cells, minlength=rows * columns).reshape(columns, rows)
        sums = np.bincount(cells, x, minlength=rows * columns).reshape(columns, rows)
        nearest = np.argmax(counts >= self.occupied, axis=1)
        each = np.arange(columns)
        count = counts[each, nearest]
        ends = sums[each, nearest] / np.maximum(count, 1)
        found = count >= self.occupied
        lengths: FloatArray = np.abs(np.where(found, ends, self.region.x[1]) - self.start)
        return lengths

    def lengths_of_edges(self, points: FloatArray) -> FloatArray:
        """The proximity of an object by its edges in a camera, strip by strip (O Eq 14-16).

        A vector ends at the nearest of a strip's points.

        Args:
            points: shape (n, 3) [m], in the robot's frame; rows that are not finite are no points.

        Returns:
            Shape (S,) [m], as those of a cloud.
        """
        lengths: FloatArray = np.abs(self._nearest(points) - self.start)
        return lengths

    def lengths_of_surface_edges(self, points: FloatArray) -> FloatArray:
        """The proximity that a LiDAR would measure of surfaces that begin at these edges.

        A surface that begins at x and continues fills the rest of its cell, whose mean x ends the
        vector (O Eq 9) where its edge x would by O Eq 15: an object in contact has the length 0,
        not g_x/2.

        Args:
            points: shape (n, 3) [m], in the robot's frame; rows that are not finite are no points.

        Returns:
            Shape (S,) [m], as those of a cloud.
        """
        edges, (first, last) = self._nearest(points), self.region.x
        row = np.minimum(np.floor((edges - first) / self.cell[0]), self.rows - 1)
        ends = (edges + first + (row + 1.0) * self.cell[0]) / 2.0
        lengths: FloatArray = np.abs(np.where(edges < last, ends, last) - self.start)
        return lengths

    def _nearest(self, points: FloatArray) -> FloatArray:
        """The nearest x of each strip, shape (S,) [m]; of an empty one the region's end."""
        x, strip = self._inside(points)
        nearest = np.full(self.columns, self.region.x[1])
        np.minimum.at(nearest, strip, x)
        return nearest

    def _inside(self, points: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
        """The x of the points in the region, and their strips."""
        x, y, _ = points[self.region.holds(points)].T
        strip = ((y - self.region.y[0]) * (1.0 / self.cell[1])).astype(np.intp)
        return x, np.minimum(strip, self.columns - 1)


def without(points: FloatArray, boxes: Sequence[BoxConfig]) -> FloatArray:
    """Points outside of boxes, such as those of the robot itself.

    Args:
        points: shape (n, 3) [m].
        boxes: in the same frame.
    """
    for box in boxes:
        points = points[~box.holds(points)]
    return points
