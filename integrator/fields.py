"""Kernels of the rule `posterior`: how well a contact at each place would explain a source.

Places are worked on cell by cell: what matters to one of them matters to its neighbours, and the
innermost loops go over places side by side.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.integrator.store import Int64Array
from contactfusion.jit import kernel

REACH = 4.0
"""A Gaussian ends after so many standard deviations."""
WIDER = 3.0
"""A tail is a second Gaussian, so much wider."""
TILE = 0.024
"""Places are worked on together in cells of this side [m], or wider ones."""
COLUMN = 0.024
"""Hypotheses are looked up by cells of this side [m], or wider ones."""
ROOM = 1 << 15
"""There are at most so many cells, and as many again for every eighth of a point."""
LANES = 8
"""As many places are worked on at once as fit into the widest vectors."""
BIG, ZERO = np.float32(1e30), np.float32(0.0)


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
def _gap(x: float, low: float, cell: int, side: float) -> float:
    """Give the distance of a coordinate from a cell [m]."""
    return max(low + cell * side - x, x - low - (cell + 1) * side, 0.0)


@kernel
def _exp(away: np.float32) -> np.float32:
    """Give exp(-away) for 0 ≤ away ≤ 8 to 2e-5: the 64th power of a polynomial; runs on vectors."""
    u = away * np.float32(-1.0 / 64.0)
    e = np.float32(1.0) + u * (
        np.float32(1.0) + u * (np.float32(0.5) + u * (np.float32(1 / 6) + u * np.float32(1 / 24)))
    )
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e


@kernel
def _tailed(away: np.float32, height: np.float32) -> np.float32:
    """Give exp(-away) + height · exp(-away / 9): a Gaussian and one that is three times as wide."""
    wide = _exp(away * np.float32(1.0 / 9.0))
    cubed = wide * wide * wide
    return cubed * cubed * cubed + height * wide


@kernel
def spread_out(
    places: FloatArray,
    tiles: Dealt,
    positions: FloatArray,
    likelihoods: FloatArray,
    variances: FloatArray,
    single: bool,
    tail: float,
    field: FloatArray,
) -> None:
    """Spread hypotheses over places: a Gaussian each, as wide as its spread, and a wider tail.

    Hypotheses of a single contact are alternatives, so that they add up; those of several contacts
    are claims of their own, of which the strongest counts.

    Args:
        places: shape (c, 3) [m].
        tiles: the places by cells.
        positions: shape (n, 3) [m].
        likelihoods: shape (n,), positive.
        variances: shape (n,) [m²], by axis.
        single: whether the hypotheses describe one contact.
        tail: the height of a second Gaussian, `WIDER` than the first, in parts of it; or 0.
        field: shape (c,), is overwritten; 0 where no hypothesis reaches.
    """
    field[:] = 0.0
    n = len(positions)
    if n == 0:
        return
    widest = np.sqrt(variances.max())
    stretch = WIDER if tail > 0.0 else 1.0
    reach = REACH * stretch * widest
    around = 0.5 * np.sqrt(3.0) * tiles.side
    rows, begins, low, counts, side = deal(positions, max(COLUMN, reach / 4.0))
    least, most = 0.5 / variances.max(), np.log(likelihoods.max())
    furthest, margin = np.float32(0.5 * (REACH * stretch) ** 2), np.float32(around)
    flatter, height = np.float32(1.0 / WIDER**2), np.float32(tail)
    lift = np.float32(-np.log(tail)) if tail > 0.0 else BIG
    bend = lift / (np.float32(1.0) - flatter)  # from here on the tail is the higher one
    x, y, z = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    halved, logs = np.empty(n, np.float32), np.empty(n, np.float32)
    for at in range(n):  # from a corner nearby, single precision is enough
        row = rows[at]
        x[at], y[at] = positions[row, 0] - low[0], positions[row, 1] - low[1]
        z[at] = positions[row, 2] - low[2]
        halved[at], logs[at] = 0.5 / variances[row], np.log(likelihoods[row])
    found, distances = np.empty(n + 1, np.int64), np.empty(n + 1, np.float32)
    room = len(places) + LANES
    px, py = np.zeros(room, np.float32), np.zeros(room, np.float32)
    pz, scores = np.zeros(room, np.float32), np.zeros(room, np.float32)
    for tile in range(len(tiles.begins) - 1):
        begin, m = tiles.begins[tile], tiles.begins[tile + 1] - tiles.begins[tile]
        if m == 0:
            continue
        k = tile % tiles.counts[2]
        j = tile // tiles.counts[2] % tiles.counts[1]
        i = tile // tiles.counts[2] // tiles.counts[1]
        cx = tiles.low[0] + (i + 0.5) * tiles.side - low[0]
        cy = tiles.low[1] + (j + 0.5) * tiles.side - low[1]
        cz = tiles.low[2] + (k + 0.5) * tiles.side - low[2]
        count, bound = 0, BIG
        within = reach if single or reach < 2.0 * around else max(widest, around)
        while True:
            wide = (within + around) ** 2
            count, bound = 0, BIG
            first_i = max(int(np.floor((cx - within - around) / side)), 0)
            last_i = min(int(np.floor((cx + within + around) / side)), counts[0] - 1)
            first_j = max(int(np.floor((cy - within - around) / side)), 0)
            last_j = min(int(np.floor((cy + within + around) / side)), counts[1] - 1)
            for i in range(first_i, last_i + 1):
                gx = _gap(cx, 0.0, i, side)
                for j in range(first_j, last_j + 1):
                    gy = _gap(cy, 0.0, j, side)
                    left = wide - gx * gx - gy * gy
                    if left < 0.0:
                        continue
                    left = np.sqrt(left)
                    first = max(int(np.floor((cz - left) / side)), 0)
                    last = min(int(np.floor((cz + left) / side)), counts[2] - 1)
                    if first > last:
                        continue
                    column = (i * counts[1] + j) * counts[2]
                    fx, fy, fz = np.float32(cx), np.float32(cy), np.float32(cz)
                    beyond = np.float32(wide)
                    for at in range(begins[column + first], begins[column + last + 1]):
                        dx, dy, dz = x[at] - fx, y[at] - fy, z[at] - fz
                        squared = dx * dx + dy * dy + dz * dz
                        found[count], distances[count] = at, squared  # free of branches
                        count += squared <= beyond
            if single:
                break
            for h in range(count):
                at = found[h]
                furthest_off = np.sqrt(distances[h]) + margin
                upper = furthest_off * furthest_off * halved[at]
                if upper < furthest:
                    bound = min(bound, min(upper, flatter * upper + lift) - logs[at])
            if within >= reach:
                break
            away = max(bound + most, 0.0)  # of the likeliest that could still be the strongest
            away = away if away <= bend else (away - lift) / flatter
            needed = np.sqrt(away / least) if bound < BIG else 2.0 * within
            if needed <= within:
                break
            within = min(needed, reach)
        for a in range(m):
            row = tiles.rows[begin + a]
            px[a], py[a] = places[row, 0] - low[0], places[row, 1] - low[1]
            pz[a] = places[row, 2] - low[2]
            scores[a] = ZERO if single else BIG
        lanes = (m + LANES - 1) // LANES * LANES  # whole vectors; what is in the rest is left there
        for h in range(count):
            at = found[h]
            hx, hy, hz, half, log = x[at], y[at], z[at], halved[at], logs[at]
            nearest = max(np.sqrt(distances[h]) - margin, ZERO)
            away = nearest * nearest * half
            if min(away, flatter * away + lift) - log > bound:
                continue
            if single:
                likelihood = np.exp(log)
                for a in range(lanes):
                    dx, dy, dz = px[a] - hx, py[a] - hy, pz[a] - hz
                    away = (dx * dx + dy * dy + dz * dz) * half
                    share = likelihood * _tailed(away, height)
                    scores[a] += share if away < furthest else ZERO
            else:
                for a in range(lanes):
                    dx, dy, dz = px[a] - hx, py[a] - hy, pz[a] - hz
                    away = (dx * dx + dy * dy + dz * dz) * half
                    tailed = flatter * away + lift
                    score = tailed if tailed < away else away
                    score = score - log if away < furthest else BIG
                    scores[a] = score if score < scores[a] else scores[a]
        for a in range(m):
            field[tiles.rows[begin + a]] = scores[a] if single else np.exp(-scores[a])


@kernel
def _cells(
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
        _cells(points[row], dealt, radius, first, last)
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
        _cells(points[row], dealt, reach, first, last)
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
