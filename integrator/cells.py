"""Kernels: points by the cells of a grid, by which those near a point are found."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.integrator.store import Int64Array
from contactfusion.jit import kernel

ROOM = 1 << 15
"""The greatest number of cells, beside eight a point; beyond, cells are wider."""


class Dealt(NamedTuple):
    """A cell list: points by the cells of a grid over them.

    Attributes:
        rows: shape (n,), the points cell by cell.
        begins: shape (cells + 1,), where each cell begins in `rows`; z runs first, then y.
        low: shape (3,) [m], the least corner of the grid.
        counts: shape (3,), number of cells along each axis.
        side: of a cell [m].
    """

    rows: Int64Array
    begins: Int64Array
    low: FloatArray
    counts: Int64Array
    side: float


@kernel
def gap(x: float, cell: int, side: float) -> float:
    """The distance of a coordinate from a cell [m]."""
    return max(cell * side - x, x - (cell + 1) * side, 0.0)


@kernel
def grouped(groups: Int64Array | NDArray[np.int32], count: int) -> tuple[Int64Array, Int64Array]:
    """Sort rows by their group; within each they ascend.

    Args:
        groups: shape (n,), of each row, from 0.
        count: the number of groups.

    Returns:
        The rows, shape (n,), and where each group begins among them, shape (count + 1,).
    """
    rows, begins = np.empty(len(groups), np.int64), np.zeros(count + 1, np.int64)
    for row in range(len(groups)):
        begins[groups[row] + 1] += 1
    for group in range(count):
        begins[group + 1] += begins[group]
    at = begins[:-1].copy()
    for row in range(len(groups)):
        rows[at[groups[row]]] = row
        at[groups[row]] += 1
    return rows, begins


@kernel
def cell_list(points: FloatArray, side: float) -> Dealt:
    """Sort points by cells of `side` [m], or of wider ones where these would be too many.

    Args:
        points: shape (n, 3) [m], at least one.
        side: of a cell [m].
    """
    n = len(points)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for row in range(n):
        for axis in range(3):
            low[axis] = min(low[axis], points[row, axis])
            high[axis] = max(high[axis], points[row, axis])
    while np.prod(np.floor((high - low) / side) + 1.0) > ROOM + 8 * n:
        side *= 1.5
    counts = (np.floor((high - low) / side) + 1.0).astype(np.int64)
    cells = np.empty(n, np.int64)
    for row in range(n):
        i = int((points[row, 0] - low[0]) / side)
        j = int((points[row, 1] - low[1]) / side)
        k = int((points[row, 2] - low[2]) / side)
        cells[row] = (i * counts[1] + j) * counts[2] + k
    rows, begins = grouped(cells, counts[0] * counts[1] * counts[2])
    return Dealt(rows, begins, low, counts, side)


def sparse_cells(points: FloatArray, side: float) -> Dealt:
    """Sort points by hardly more cells than points, as `nearest` walks empty ones.

    Args:
        points: shape (n, 3) [m], at least one.
        side: of a cell, at least [m].
    """
    return cell_list(points, max(side, float(np.ptp(points, axis=0).max()) / len(points) ** 0.5))


@kernel
def _touched(
    point: FloatArray, cells: Dealt, radius: float, first: Int64Array, last: Int64Array
) -> None:
    """Write the first and last cell along each axis that a ball around a point touches."""
    for axis in range(3):
        offset, most = point[axis] - cells.low[axis], cells.counts[axis] - 1.0
        last[axis] = int(min(max(np.floor((offset + radius) / cells.side), -1.0), most))
        first[axis] = int(min(max(np.floor((offset - radius) / cells.side), 0.0), most + 1.0))


@kernel
def heaviest(
    points: FloatArray, places: FloatArray, cells: Dealt, weights: FloatArray, radius: float
) -> FloatArray:
    """The largest weight of a place within `radius` of each point, 0 without any, shape (n,).

    Args:
        points: shape (n, 3) [m].
        places: shape (c, 3) [m].
        cells: the places by cells.
        weights: shape (c,).
        radius: [m].
    """
    found = np.zeros(len(points))
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for row in range(len(points)):
        _touched(points[row], cells, radius, first, last)
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                column = (i * cells.counts[1] + j) * cells.counts[2]
                begin, end = cells.begins[column + first[2]], cells.begins[column + last[2] + 1]
                for at in range(begin, end):
                    other = cells.rows[at]
                    if _squared(points[row], places[other]) <= radius * radius:
                        found[row] = max(found[row], weights[other])
    return found


@kernel
def _squared(first: FloatArray, second: FloatArray) -> float:
    total = 0.0
    for axis in range(3):
        total += (first[axis] - second[axis]) ** 2
    return total


@kernel
def nearest(points: FloatArray, places: FloatArray, cells: Dealt) -> Int64Array:
    """The nearest place to each point, the first of equally near ones by cell, shape (n,).

    Args:
        points: shape (n, 3) [m].
        places: shape (c, 3) [m], c > 0.
        cells: the places by cells.
    """
    found, side, counts = np.empty(len(points), np.int64), cells.side, cells.counts
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for row in range(len(points)):
        x, y, z = points[row]
        best, radius = np.inf, side
        while True:
            _touched(points[row], cells, radius, first, last)
            for i in range(first[0], last[0] + 1):
                gap_x = gap(x - cells.low[0], i, side) ** 2
                for j in range(first[1], last[1] + 1):
                    if gap_x + gap(y - cells.low[1], j, side) ** 2 >= best:
                        continue
                    column = (i * counts[1] + j) * counts[2]
                    begin, end = cells.begins[column + first[2]], cells.begins[column + last[2] + 1]
                    for other in cells.rows[begin:end]:
                        dx, dy = places[other, 0] - x, places[other, 1] - y
                        dz = places[other, 2] - z
                        squared = dx * dx + dy * dy + dz * dz
                        if squared < best:
                            best, found[row] = squared, other
            if best <= radius * radius:
                break
            radius = min(2.0 * radius, np.sqrt(best) + 1e-9)
    return found
