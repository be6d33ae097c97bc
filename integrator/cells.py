"""Kernels that find points near others: points dealt into the cells of a grid over them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.integrator.store import Int64Array
from contactfusion.jit import kernel

ROOM = 1 << 15
"""There are at most so many cells, and eight more a point; else cells are wider."""


class Dealt(NamedTuple):
    """Points by the cells of a grid over them.

    Attributes:
        rows: shape (n,), the points cell by cell.
        begins: shape (cells + 1,), where each cell begins in `rows`; z runs first, then y.
        low: shape (3,) [m], the least corner of the grid.
        counts: shape (3,), how many cells there are along each axis.
        side: of a cell [m].
    """

    rows: Int64Array
    begins: Int64Array
    low: FloatArray
    counts: Int64Array
    side: float


@kernel
def deal(points: FloatArray, side: float) -> Dealt:
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
    cells, rows = np.empty(n, np.int64), np.empty(n, np.int64)
    begins = np.zeros(counts[0] * counts[1] * counts[2] + 1, np.int64)
    for row in range(n):
        i = int((points[row, 0] - low[0]) / side)
        j = int((points[row, 1] - low[1]) / side)
        k = int((points[row, 2] - low[2]) / side)
        cells[row] = (i * counts[1] + j) * counts[2] + k
        begins[cells[row] + 1] += 1
    for cell in range(len(begins) - 1):
        begins[cell + 1] += begins[cell]
    at = begins[:-1].copy()
    for row in range(n):
        rows[at[cells[row]]] = row
        at[cells[row]] += 1
    return Dealt(rows, begins, low, counts, side)


@kernel
def _touched(
    point: FloatArray, dealt: Dealt, radius: float, first: Int64Array, last: Int64Array
) -> None:
    """Write the first and last cell along each axis that a ball around a point touches."""
    for axis in range(3):
        offset, most = point[axis] - dealt.low[axis], dealt.counts[axis] - 1.0
        last[axis] = int(min(max(np.floor((offset + radius) / dealt.side), -1.0), most))
        first[axis] = int(min(max(np.floor((offset - radius) / dealt.side), 0.0), most + 1.0))


@kernel
def heaviest(
    points: FloatArray, places: FloatArray, dealt: Dealt, weights: FloatArray, radius: float
) -> FloatArray:
    """Give the largest weight of a place within `radius` of each point, 0 without any, shape (n,).

    Args:
        points: shape (n, 3) [m].
        places: shape (c, 3) [m].
        dealt: the places by cells.
        weights: shape (c,).
        radius: [m].
    """
    found = np.zeros(len(points))
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for row in range(len(points)):
        _touched(points[row], dealt, radius, first, last)
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                column = (i * dealt.counts[1] + j) * dealt.counts[2]
                begin, end = dealt.begins[column + first[2]], dealt.begins[column + last[2] + 1]
                for at in range(begin, end):
                    other = dealt.rows[at]
                    if _squared(points[row], places[other]) <= radius * radius:
                        found[row] = max(found[row], weights[other])
    return found


@kernel
def linked(points: FloatArray, dealt: Dealt, start: int, reach: float) -> NDArray[np.bool_]:
    """Tell which points a chain of steps of at most `reach` joins to one of them, shape (n,).

    Args:
        points: shape (n, 3) [m].
        dealt: the points by cells.
        start: the row of that one.
        reach: [m].
    """
    found = np.zeros(len(points), np.bool_)
    waiting, count = np.empty(len(points), np.int64), 1
    found[start], waiting[0] = True, start
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    while count > 0:
        count -= 1
        row = waiting[count]
        _touched(points[row], dealt, reach, first, last)
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                column = (i * dealt.counts[1] + j) * dealt.counts[2]
                begin, end = dealt.begins[column + first[2]], dealt.begins[column + last[2] + 1]
                for at in range(begin, end):
                    other = dealt.rows[at]
                    if not found[other] and _squared(points[row], points[other]) <= reach * reach:
                        found[other], waiting[count] = True, other
                        count += 1
    return found


@kernel
def _squared(one: FloatArray, other: FloatArray) -> float:
    total = 0.0
    for axis in range(3):
        total += (one[axis] - other[axis]) ** 2
    return total
