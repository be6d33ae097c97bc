"""Kernels: which points lie near others, and which hang together."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE
from contactfusion.integrator.cells import Dealt
from contactfusion.jit import kernel

Rows = NDArray[np.intp]
BETWEEN = 0.4
"""What is no further from the middle of two points lies between them, in parts of their distance:
what is beside both in a grid does not."""


class Barrier(NamedTuple):
    """Points that others do not hang together over.

    Attributes:
        points: shape (m, 3) [m].
        cells: the points by cells.
        away: shape (n,), how far the nearest of them is from each of the others [m].
    """

    points: FloatArray
    cells: Dealt
    away: FloatArray


@kernel
def _first(offset: float, radius: float, side: float, count: int) -> int:
    """The first cell along an axis that a ball touches; `count` where it touches none."""
    return int(min(max(np.floor((offset - radius) / side), 0.0), count))


@kernel
def _end(offset: float, radius: float, side: float, count: int) -> int:
    """One more than the last cell along an axis that a ball touches; 0 where it touches none."""
    return int(min(max(np.floor((offset + radius) / side) + 1.0, 0.0), count))


@kernel
def _squared(points: FloatArray, row: int | np.uintp, x: float, y: float, z: float) -> float:
    dx, dy, dz = points[row, 0] - x, points[row, 1] - y, points[row, 2] - z
    squared: float = dx * dx + dy * dy + dz * dz
    return squared


@kernel
def around(
    points: FloatArray,
    cells: Dealt,
    labels: NDArray[np.int32],
    left: NDArray[np.bool_],
    others: FloatArray,
    reach: float,
) -> Rows:
    """The points left in the box around others, widened by a reach, as rows.

    Args:
        points: shape (n, 3) [m].
        cells: the points by cells.
        labels: shape (n,), of each point.
        left: shape (labels,), which count.
        others: shape (m, 3) [m], m > 0.
        reach: [m].
    """
    low, high = others[0] - reach, others[0] + reach
    for row in range(1, len(others)):
        for axis in range(3):
            low[axis] = min(low[axis], others[row, axis] - reach)
            high[axis] = max(high[axis], others[row, axis] + reach)
    side, least, counts = cells.side, cells.low, cells.counts
    first, end = np.empty(3, np.int64), np.empty(3, np.int64)
    for axis in range(3):
        first[axis] = _first(low[axis] - least[axis], 0.0, side, counts[axis])
        end[axis] = _end(high[axis] - least[axis], 0.0, side, counts[axis])
    found, count = np.empty(len(points), np.intp), 0
    for i in range(first[0], end[0]):
        for j in range(first[1], end[1]):
            column = (i * counts[1] + j) * counts[2]
            for at in range(cells.begins[column + first[2]], cells.begins[column + end[2]]):
                row = cells.rows[at]
                inside = left[labels[row]]
                for axis in range(3):
                    inside &= low[axis] <= points[row, axis] <= high[axis]
                found[count] = row
                count += inside
    return found[:count]


@kernel
def reached(
    points: FloatArray,
    cells: Dealt,
    labels: NDArray[np.int32],
    left: NDArray[np.bool_],
    others: FloatArray,
    reach: float,
) -> NDArray[np.bool_]:
    """Of which labels a point lies within reach of others, among those left, shape (labels,).

    Args:
        points: shape (n, 3) [m].
        cells: the points by cells.
        labels: shape (n,), of each point.
        left: shape (labels,), which count.
        others: shape (m, 3) [m].
        reach: [m].
    """
    side, low, counts, begins = cells.side, cells.low, cells.counts, cells.begins
    found = np.zeros(len(left), np.bool_)
    for other in range(len(others)):
        px, py, pz = others[other]
        x, y, z = px - low[0], py - low[1], pz - low[2]
        j_first, j_end = _first(y, reach, side, counts[1]), _end(y, reach, side, counts[1])
        k_first, k_end = _first(z, reach, side, counts[2]), _end(z, reach, side, counts[2])
        for i in range(_first(x, reach, side, counts[0]), _end(x, reach, side, counts[0])):
            for j in range(j_first, j_end):
                column = (i * counts[1] + j) * counts[2]
                for row in cells.rows[begins[column + k_first] : begins[column + k_end]]:
                    label = labels[row]
                    if left[label] and not found[label]:
                        found[label] = _squared(points, row, px, py, pz) <= reach * reach
    return found


@kernel
def nearest_left(
    points: FloatArray,
    cells: Dealt,
    labels: NDArray[np.int32],
    left: NDArray[np.bool_],
    place: FloatArray,
) -> int:
    """The point nearest to a place among those left, the first of equals, as a row.

    Args:
        points: shape (n, 3) [m].
        cells: the points by cells.
        labels: shape (n,), of each point.
        left: shape (labels,), which count, at least one.
        place: shape (3,) [m].
    """
    side, counts, begins = cells.side, cells.counts, cells.begins
    x, y, z = place - cells.low
    nearest, least, reach = NONE, np.inf, side
    while least > reach * reach or nearest == NONE:
        reach *= 2.0
        j_first, j_end = _first(y, reach, side, counts[1]), _end(y, reach, side, counts[1])
        k_first, k_end = _first(z, reach, side, counts[2]), _end(z, reach, side, counts[2])
        for i in range(_first(x, reach, side, counts[0]), _end(x, reach, side, counts[0])):
            for j in range(j_first, j_end):
                column = (i * counts[1] + j) * counts[2]
                for row in cells.rows[begins[column + k_first] : begins[column + k_end]]:
                    squared = _squared(points, row, place[0], place[1], place[2])
                    is_first = squared < least or (squared == least and row < nearest)
                    if is_first and left[labels[row]]:
                        nearest, least = row, squared
    return nearest


@kernel
def near(points: FloatArray, others: FloatArray, reach: float) -> NDArray[np.bool_]:
    """Which points lie within reach [m] of others (m, 3) [m], shape (n,)."""
    found = np.zeros(len(points), np.bool_)
    for row in range(len(points)):
        for other in range(len(others)):
            x, y, z = others[other]
            if _squared(points, row, x, y, z) <= reach * reach:
                found[row] = True
                break
    return found


@kernel
def labelled(
    which: NDArray[np.int32], labels: NDArray[np.int32], wanted: NDArray[np.bool_]
) -> Rows:
    """The rows of `which`, shape (c,), that hold a point of some labels, not `NONE`; ascending.

    Args:
        which: shape (c,), points.
        labels: shape (n,), of each point.
        wanted: shape (labels,).
    """
    found, count = np.empty(len(which), np.intp), 0
    for row in range(len(which)):
        found[count] = row  # written over unless it counts
        count += which[row] != NONE and wanted[labels[which[row]]]
    return found[:count]


@kernel
def connected(
    points: FloatArray,
    cells: Dealt,
    values: FloatArray,
    least: float,
    start: int,
    reaches: FloatArray,
) -> Rows:
    """The points of at least some value that hang together with one of them, ascending.

    Args:
        points: shape (c, 3) [m].
        cells: the points by cells, of at least twice the longest reach.
        values: shape (c,).
        least: the least value.
        start: the row of the one.
        reaches: shape (c,), points that are no further apart than the sum of theirs hang together
            [m].
    """
    side, low, counts, begins = cells.side, cells.low, cells.counts, cells.begins
    left = values >= least
    left[start] = True
    found, count, done = np.empty(left.sum(), np.intp), 1, 0
    found[0], left[start] = start, False
    while done < count < len(found):
        row = found[done]
        done += 1
        px, py, pz = points[row, 0], points[row, 1], points[row, 2]
        x, y, z, reach = px - low[0], py - low[1], pz - low[2], float(reaches[row]) + 0.5 * side
        j_first, j_end = _first(y, reach, side, counts[1]), _end(y, reach, side, counts[1])
        k_first, k_end = _first(z, reach, side, counts[2]), _end(z, reach, side, counts[2])
        for i in range(_first(x, reach, side, counts[0]), _end(x, reach, side, counts[0])):
            for j in range(j_first, j_end):
                column = (i * counts[1] + j) * counts[2]
                for at in range(begins[column + k_first], begins[column + k_end]):
                    other = np.uintp(cells.rows[at])
                    if left[other]:
                        most = (reaches[row] + reaches[other]) ** 2
                        if _squared(points, other, px, py, pz) <= most:
                            found[count], left[other] = other, False
                            count += 1
    return np.sort(found[:count])


@kernel
def _is_barred(barrier: Barrier, x: float, y: float, z: float, reach: float) -> bool:
    """Whether a point of a barrier is nearer than a reach [m] to a place."""
    cells, low, found = barrier.cells, barrier.cells.low, False
    side, counts, begins = cells.side, cells.counts, cells.begins
    i, j, k = x - low[0], y - low[1], z - low[2]
    j_first, j_end = _first(j, reach, side, counts[1]), _end(j, reach, side, counts[1])
    k_first, k_end = _first(k, reach, side, counts[2]), _end(k, reach, side, counts[2])
    for row in range(_first(i, reach, side, counts[0]), _end(i, reach, side, counts[0])):
        for column in range(row * counts[1] + j_first, row * counts[1] + j_end):
            begin, end = begins[column * counts[2] + k_first], begins[column * counts[2] + k_end]
            for other in cells.rows[begin:end]:
                found |= _squared(barrier.points, other, x, y, z) < reach * reach
    return found


@kernel
def linked(
    points: FloatArray,
    cells: Dealt,
    reaches: FloatArray,
    barrier: Barrier,
) -> tuple[NDArray[np.int32], int]:
    """Label points by which hang together, but not over a barrier.

    What is labelled leaves its cell, so that hardly a pair is looked at twice.

    Args:
        points: shape (n, 3) [m].
        cells: the points by cells.
        reaches: shape (n,), points that are no further apart than the sum of theirs hang together
            [m].
        barrier: what they do not hang together over.

    Returns:
        Labels of shape (n,), numbered in the order of the groups' first points, and their number.
    """
    side, low, counts, begins = cells.side, cells.low, cells.counts, cells.begins
    rows, ends, furthest, clear = cells.rows.copy(), begins[1:].copy(), reaches.max(), barrier.away
    places, own = points[rows], reaches[rows]  # those of a cell side by side
    labels, found, number = np.full(len(points), NONE, np.int32), np.empty(len(points), np.intp), 0
    for start in range(len(points)):
        if labels[start] != NONE:
            continue
        found[0], labels[start], count = start, number, 1
        while count > 0:
            count -= 1
            row = found[count]
            px, py, pz = points[row]
            x, y, z, reach = px - low[0], py - low[1], pz - low[2], reaches[row] + furthest
            j_first, j_end = _first(y, reach, side, counts[1]), _end(y, reach, side, counts[1])
            k_first, k_end = _first(z, reach, side, counts[2]), _end(z, reach, side, counts[2])
            for i in range(_first(x, reach, side, counts[0]), _end(x, reach, side, counts[0])):
                for j in range(j_first, j_end):
                    column = (i * counts[1] + j) * counts[2]
                    for cell in range(column + k_first, column + k_end):
                        at = begins[cell]
                        while at < ends[cell]:
                            squared = _squared(places, at, px, py, pz)
                            other = rows[at]
                            apart = squared > (reaches[row] + own[at]) ** 2
                            furthest_off = (0.5 + BETWEEN) * np.sqrt(squared)
                            if not apart and furthest_off > max(clear[row], clear[other]):
                                mx, my, mz = 0.5 * (places[at] + points[row])
                                apart = _is_barred(barrier, mx, my, mz, BETWEEN * np.sqrt(squared))
                            if apart:
                                at += 1
                                continue
                            if labels[other] == NONE:  # not the first one itself
                                found[count], labels[other] = other, number
                                count += 1
                            ends[cell] -= 1
                            last = ends[cell]
                            rows[at], own[at] = rows[last], own[last]
                            for axis in range(3):
                                places[at, axis] = places[last, axis]
        number += 1
    return labels, number


@kernel
def _beside(
    points: FloatArray, cells: Dealt, row: int, line: FloatArray, least: float, most: float
) -> tuple[int, float]:
    """The nearest other point that lies beside a line through a point, and how far beside it [m].

    Args:
        points: shape (n, 3) [m].
        cells: the points by cells.
        row: of the point.
        line: shape (3,), a direction; of length 0 everything is beside it.
        least: how far beside the line it lies at least [m].
        most: how far from the point it lies at most [m]; without one `NONE` and `most`.
    """
    side, low, counts, begins = cells.side, cells.low, cells.counts, cells.begins
    px, py, pz = points[row]
    x, y, z, nearest, squared, away = px - low[0], py - low[1], pz - low[2], NONE, most**2, most
    j_first, j_end = _first(y, most, side, counts[1]), _end(y, most, side, counts[1])
    k_first, k_end = _first(z, most, side, counts[2]), _end(z, most, side, counts[2])
    for i in range(_first(x, most, side, counts[0]), _end(x, most, side, counts[0])):
        for j in range(j_first, j_end):
            column = (i * counts[1] + j) * counts[2]
            for other in cells.rows[begins[column + k_first] : begins[column + k_end]]:
                further = _squared(points, other, px, py, pz)
                if further < squared and other != row:
                    along = (points[other, 0] - px) * line[0] + (points[other, 1] - py) * line[1]
                    along += (points[other, 2] - pz) * line[2]
                    off = np.sqrt(max(further - along * along, 0.0))
                    if off >= least:
                        nearest, squared, away = other, further, off
    return nearest, away


@kernel
def spacings(points: FloatArray, cells: Dealt, rows: Rows, most: float) -> FloatArray:
    """How far the others next to some points are, at most `most` [m], shape (len(rows), 2).

    First that of the nearest; then how far the nearest that is at least half as far beside the line
    through both lies beside it, as the next row of a grid does.

    Args:
        points: shape (n, 3) [m].
        cells: the points by cells.
        rows: of the points.
        most: [m].
    """
    found = np.full((len(rows), 2), most)
    for number in range(len(rows)):
        row = rows[number]
        nearest, away = _beside(points, cells, row, np.zeros(3), 0.0, most)
        found[number, 0] = away
        if nearest != NONE and away > 0.0:
            line = (points[nearest] - points[row]) / away
            found[number, 1] = _beside(points, cells, row, line, 0.5 * away, most)[1]
    return found


@kernel
def nearer(points: FloatArray, rows: Rows, these: Rows, others: Rows) -> NDArray[np.bool_]:
    """Which of some points are no further from these than from the others, shape (len(rows),).

    Args:
        points: shape (c, 3) [m].
        rows: of the points.
        these: rows of points.
        others: rows of points.
    """
    found = np.empty(len(rows), np.bool_)
    for number in range(len(rows)):
        x, y, z = points[rows[number]]
        away = np.inf
        for other in these:
            away = min(away, _squared(points, other, x, y, z))
        found[number] = True
        for other in others:
            if _squared(points, other, x, y, z) < away:
                found[number] = False
                break
    return found


@kernel
def shifted(
    points: FloatArray, rows: Rows, weights: FloatArray, start: FloatArray, width: float, steps: int
) -> FloatArray:
    """Where mean shift over weighted points leads, shape (3,) [m].

    Args:
        points: shape (c, 3) [m].
        rows: of the points.
        weights: shape (len(rows),).
        start: shape (3,) [m].
        width: of the kernel [m].
        steps: at most.
    """
    place = start.copy()
    for _ in range(steps):
        total, mean = 0.0, np.zeros(3)
        for number in range(len(rows)):
            squared = _squared(points, rows[number], place[0], place[1], place[2])
            near = weights[number] * np.exp(-0.5 * squared / width**2)
            total += near
            mean += near * points[rows[number]]
        mean /= total
        away = np.abs(mean - place).max()
        if away < 1e-6:
            break
        place = mean
    return place
