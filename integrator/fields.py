"""Kernels: how well a contact at each place would explain a source.

Places are processed cell by cell: hypotheses near one of them are near its neighbours, and the
innermost loops go over places side by side.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE
from contactfusion.integrator.cells import Dealt, cell_list, gap
from contactfusion.integrator.store import Int64Array
from contactfusion.jit import kernel

REACH = 4.0
"""Extent of a Gaussian, in standard deviations."""
WIDER, FAR = 3.0, 9.0
"""Width of the second Gaussian, the tail, in widths of the first, and its extent in these."""
TILE = 0.04
"""Side of the cells of places [m]: each holds enough of them to fill vectors."""
COLUMN = 0.024
"""The least side of the cells of hypotheses [m]."""
LANES = 16
"""Innermost loops go over multiples of this number of places, which fill vectors."""
BIG, ZERO = np.float32(1e30), np.float32(0.0)
NEAREST, FURTHER = 2.0, 2.0
"""The strongest hypothesis is looked for so near first, in standard deviations, then further away
by at least this factor."""

Float32Array = NDArray[np.float32]
Int32Array = NDArray[np.int32]

NO_ROWS: Int32Array = np.empty(0, np.int32)


@kernel
def _exp(away: np.float32) -> np.float32:
    """exp(-away), to 2e-5 for 0 ≤ away ≤ 8: the 64th power of a polynomial.

    It is free of branches and calls, so that it runs on vectors.
    """
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
    """exp(-away) + height · exp(-away / 9): a Gaussian and one that is three times as wide."""
    wide = _exp(away * np.float32(1.0 / 9.0))  # WIDER squared
    cubed = wide * wide * wide
    return cubed * cubed * cubed + height * wide


class Room(NamedTuple):
    """Arrays that are written anew for each tile.

    Attributes:
        found: shape (n,), hypotheses that are near, as positions in the arrays of a `Spread`.
        squares: shape (n,), their squared distances from the middle of the tile [m²].
        bounds: shape (n,), their least exponents anywhere in it.
        chosen: shape (n,), those that are looked at.
        x: shape (c,) [m], of the places of the tile, as are all others.
        y: shape (c,) [m].
        z: shape (c,) [m].
        rows: shape (c,), the places themselves.
        scores: shape (c,), the exponent of the strongest hypothesis, or the sum of all.
        which: shape (c,), the strongest hypothesis, or `NONE`.
    """

    found: Int64Array
    squares: Float32Array
    bounds: Float32Array
    chosen: Int64Array
    x: Float32Array
    y: Float32Array
    z: Float32Array
    rows: Int64Array
    scores: Float32Array
    which: Int32Array


@kernel
def _room(hypotheses: int, places: int) -> Room:
    return Room(
        np.empty(hypotheses, np.int64),
        np.empty(hypotheses, np.float32),
        np.empty(hypotheses, np.float32),
        np.empty(hypotheses, np.int64),
        np.zeros(places, np.float32),
        np.zeros(places, np.float32),
        np.zeros(places, np.float32),
        np.zeros(places, np.int64),
        np.zeros(places, np.float32),
        np.zeros(places, np.int32),
    )


class Spread(NamedTuple):
    """Hypotheses by cells, prepared in single precision, from an origin among the places.

    Attributes:
        cells: the hypotheses by cells.
        origin: shape (3,) [m].
        x: shape (n,) [m], cell by cell, as are all others.
        y: shape (n,) [m].
        z: shape (n,) [m].
        halved: shape (n,), 1 / (2 variance) [1/m²].
        logs: shape (n,), of the likelihoods.
        furthest: exponent from which on a hypothesis counts as zero.
        flatter: the exponent of a tail, in parts of that of its Gaussian.
        lift: what is added to it, for a tail is lower.
    """

    cells: Dealt
    origin: FloatArray
    x: Float32Array
    y: Float32Array
    z: Float32Array
    halved: Float32Array
    logs: Float32Array
    furthest: np.float32
    flatter: np.float32
    lift: np.float32


@kernel
def _ready(
    cells: Dealt,
    positions: FloatArray,
    likelihoods: FloatArray,
    variances: FloatArray,
    tail: float,
    origin: FloatArray,
) -> Spread:
    n, ends = len(positions), FAR if tail > 0.0 else REACH
    x, y, z = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    halved, logs = np.empty(n, np.float32), np.empty(n, np.float32)
    for at in range(n):
        row = cells.rows[at]
        x[at] = positions[row, 0] - origin[0]
        y[at] = positions[row, 1] - origin[1]
        z[at] = positions[row, 2] - origin[2]
        halved[at], logs[at] = 0.5 / variances[row], np.log(likelihoods[row])
    furthest, flatter = np.float32(0.5 * ends * ends), np.float32(1.0 / WIDER**2)
    lift = np.float32(-np.log(tail)) if tail > 0.0 else BIG
    return Spread(cells, origin, x, y, z, halved, logs, furthest, flatter, lift)


@kernel
def _gather(
    spread: Spread, middle: FloatArray, radius: float, found: Int64Array, squares: Float32Array
) -> int:
    """Write the hypotheses in a ball, and their squared distances from its middle [m²].

    Returns:
        Their number.
    """
    low, counts, side = spread.cells.low, spread.cells.counts, spread.cells.side
    begins, x, y, z = spread.cells.begins, spread.x, spread.y, spread.z
    cx, cy, cz = middle[0] - low[0], middle[1] - low[1], middle[2] - low[2]
    fx = np.float32(middle[0] - spread.origin[0])
    fy = np.float32(middle[1] - spread.origin[1])
    fz = np.float32(middle[2] - spread.origin[2])
    wide, count = np.float32(radius * radius), 0
    first_i = max(int(np.floor((cx - radius) / side)), 0)
    last_i = min(int(np.floor((cx + radius) / side)), counts[0] - 1)
    first_j = max(int(np.floor((cy - radius) / side)), 0)
    last_j = min(int(np.floor((cy + radius) / side)), counts[1] - 1)
    for i in range(first_i, last_i + 1):
        gap_x = gap(cx, i, side)
        for j in range(first_j, last_j + 1):
            left = radius * radius - gap_x**2 - gap(cy, j, side) ** 2
            if left < 0.0:
                continue
            first = max(int(np.floor((cz - np.sqrt(left)) / side)), 0)
            last = min(int(np.floor((cz + np.sqrt(left)) / side)), counts[2] - 1)
            if first > last:
                continue
            column = (i * counts[1] + j) * counts[2]
            for at in range(begins[column + first], begins[column + last + 1]):
                dx, dy, dz = x[at] - fx, y[at] - fy, z[at] - fz
                squared = dx * dx + dy * dy + dz * dz
                found[count], squares[count] = at, squared  # written over unless it counts
                count += squared <= wide
    return count


@kernel
def _bounds(
    spread: Spread,
    found: Int64Array,
    squares: Float32Array,
    around: np.float32,
    bounds: Float32Array,
) -> None:
    """Write the least exponent of each hypothesis, anywhere `around` the middle."""
    flatter, lift = spread.flatter, spread.lift
    for h in range(len(found)):
        away = max(np.sqrt(squares[h]) - around, ZERO)
        away = away * away * spread.halved[found[h]]
        bounds[h] = min(away, flatter * away + lift) - spread.logs[found[h]]


@kernel
def _between(
    found: Int64Array, bounds: Float32Array, above: np.float32, most: np.float32, chosen: Int64Array
) -> int:
    """Write the hypotheses with a bound above one value, and not above another; their number."""
    count = 0
    for h in range(len(found)):
        chosen[count] = found[h]  # written over unless it counts
        count += (bounds[h] > above) & (bounds[h] <= most)
    return count


@kernel
def _strongest(spread: Spread, found: Int64Array, count: int, room: Room) -> None:
    """Lower each place's exponent to that of the strongest hypothesis there, and write its row."""
    furthest, flatter, lift = spread.furthest, spread.flatter, spread.lift
    whole = (count + LANES - 1) // LANES * LANES
    px, py, pz = room.x[:whole], room.y[:whole], room.z[:whole]
    scores, which = room.scores[:whole], room.which[:whole]
    for at in found:
        x, y, z = spread.x[at], spread.y[at], spread.z[at]
        halved, log = spread.halved[at], spread.logs[at]
        row = np.int32(spread.cells.rows[at])
        for a in range(len(scores)):
            dx, dy, dz = px[a] - x, py[a] - y, pz[a] - z
            away = (dx * dx + dy * dy + dz * dz) * halved
            tailed = flatter * away + lift
            score = tailed if tailed < away else away
            score = score - log if away < furthest else BIG
            which[a] = row if score < scores[a] else which[a]
            scores[a] = score if score < scores[a] else scores[a]


@kernel
def _total(
    spread: Spread,
    likelihoods: Float32Array,
    found: Int64Array,
    height: np.float32,
    count: int,
    room: Room,
) -> None:
    """Add up the densities of the hypotheses at each place of a tile."""
    furthest, whole = spread.furthest, (count + LANES - 1) // LANES * LANES
    px, py, pz, scores = room.x[:whole], room.y[:whole], room.z[:whole], room.scores[:whole]
    scores[:] = ZERO
    for h in range(len(found)):
        at = found[h]
        x, y, z = spread.x[at], spread.y[at], spread.z[at]
        halved, likelihood = spread.halved[at], likelihoods[at]
        for a in range(len(scores)):
            dx, dy, dz = px[a] - x, py[a] - y, pz[a] - z
            away = (dx * dx + dy * dy + dz * dz) * halved
            share = likelihood * _tailed(away, height)
            scores[a] += share if away < furthest else ZERO


@kernel
def _ball(places: FloatArray, rows: Int64Array, middle: FloatArray) -> float:
    """Write the middle of some places [m]; their greatest distance from it [m]."""
    middle[:] = 0.0
    for row in rows:
        for axis in range(3):
            middle[axis] += places[row, axis] / len(rows)
    furthest = 0.0
    for row in rows:
        squared = 0.0
        for axis in range(3):
            squared += (places[row, axis] - middle[axis]) ** 2
        furthest = max(furthest, squared)
    return float(np.sqrt(furthest)) + 1e-6


@kernel
def _exponent(spread: Spread, away: float, widest: float, most: float) -> np.float32:
    """The least exponent of any hypothesis so far away [m]."""
    squared = 0.5 * (away / widest) ** 2
    tailed = squared * float(spread.flatter) + float(spread.lift)
    return np.float32(min(squared, tailed) - most)


@kernel
def _distance(spread: Spread, exponent: np.float32, widest: float, most: float) -> float:
    """The distance from which on no hypothesis has a lesser exponent [m]."""
    squared = max(float(exponent) + most, 0.0)
    squared = max(squared, (squared - float(spread.lift)) / float(spread.flatter))
    return float(np.sqrt(2.0 * squared)) * widest


@kernel
def _find_strongest(
    spread: Spread,
    rows: Int64Array,
    middle: FloatArray,
    around: np.float32,
    widest: float,
    most: float,
    reach: float,
    room: Room,
    field: FloatArray,
    which: Int32Array,
) -> None:
    """Write the density of the strongest hypothesis at each place of a tile, and its row.

    The search goes further away until no hypothesis beyond can be stronger at any place.

    Args:
        spread: the hypotheses.
        rows: shape (m,), the places.
        middle: shape (3,) [m], of the places.
        around: their greatest distance from it [m].
        widest: the largest standard deviation [m].
        most: the logarithm of the largest likelihood.
        reach: distance beyond which a hypothesis counts as zero [m].
        room: holds the places.
        field: shape (c,), is written at the places.
        which: likewise; or empty.
    """
    count, within, done = len(rows), min(NEAREST * widest, reach), -BIG
    room.rows[:count], room.scores[:count], room.which[:count] = rows, BIG, NONE
    while count > 0:
        is_last = within >= reach
        limit = room.scores[:count].max()
        if not is_last:
            limit = min(limit, _exponent(spread, within, widest, most))
        n = _gather(spread, middle, within + float(around), room.found, room.squares)
        found, bounds = room.found[:n], room.bounds[:n]
        _bounds(spread, found, room.squares[:n], around, bounds)
        _strongest(
            spread, room.chosen[: _between(found, bounds, done, limit, room.chosen)], count, room
        )
        weakest, left, done = -BIG, 0, limit
        for a in range(count):
            row, score = room.rows[a], room.scores[a]
            if score > done and not is_last:  # another one further away may be stronger
                room.x[left], room.y[left], room.z[left] = room.x[a], room.y[a], room.z[a]
                room.rows[left], room.scores[left], room.which[left] = row, score, room.which[a]
                weakest = max(weakest, score)
                left += 1
                continue
            if score < BIG:
                field[row] = np.exp(-score)
            if len(which):
                which[row] = room.which[a]
        count = left
        needed = _distance(spread, weakest, widest, most) if weakest < BIG else 0.0
        within = min(max(needed, FURTHER * within), reach)


@kernel
def _over_tiles(
    places: FloatArray,
    tiles: Dealt,
    cells: Dealt,
    positions: FloatArray,
    likelihoods: FloatArray,
    variances: FloatArray,
    single: bool,
    tail: float,
    field: FloatArray,
    which: Int32Array,
) -> None:
    """Kernel density of hypotheses in a cell list; other arguments as `kernel_density`."""
    origin = places[len(places) // 2]
    spread = _ready(cells, positions, likelihoods, variances, tail, origin)
    widest, most = np.sqrt(variances.max()), np.log(likelihoods.max())
    reach = (FAR if tail > 0.0 else REACH) * widest
    shares = np.exp(spread.logs) if single else spread.logs
    room, middle = _room(len(positions) + 1, len(places) + LANES), np.empty(3)
    for tile in range(len(tiles.begins) - 1):
        rows = tiles.rows[tiles.begins[tile] : tiles.begins[tile + 1]]
        if len(rows) == 0:
            continue
        around = np.float32(_ball(places, rows, middle))
        away = 0.0
        for axis in range(3):
            width = cells.counts[axis] * cells.side
            away += gap(middle[axis] - cells.low[axis], 0, width) ** 2
        if away > (reach + float(around)) ** 2:  # all hypotheses are too far away
            continue
        for a in range(len(rows)):
            room.x[a] = places[rows[a], 0] - origin[0]
            room.y[a] = places[rows[a], 1] - origin[1]
            room.z[a] = places[rows[a], 2] - origin[2]
        if single:
            count = _gather(spread, middle, reach + float(around), room.found, room.squares)
            _total(spread, shares, room.found[:count], np.float32(tail), len(rows), room)
            for a in range(len(rows)):
                field[rows[a]] = room.scores[a]
            continue
        _find_strongest(spread, rows, middle, around, widest, most, reach, room, field, which)


def kernel_density(
    places: FloatArray,
    tiles: Dealt,
    positions: FloatArray,
    likelihoods: FloatArray,
    variances: FloatArray,
    single: bool,
    tail: float,
    field: FloatArray,
    which: Int32Array = NO_ROWS,
) -> None:
    """Kernel density over places: a Gaussian a hypothesis, as wide as its spread, and a tail.

    Hypotheses of a single contact are alternatives, so that they add up; of those of
    several contacts the strongest counts.

    Args:
        places: shape (c, 3) [m].
        tiles: the places by cells.
        positions: shape (n, 3) [m].
        likelihoods: shape (n,), positive.
        variances: shape (n,) [m²], by axis.
        single: whether the hypotheses describe one contact.
        tail: the height of a second Gaussian, `WIDER` than the first, in parts of it; or 0.
        field: shape (c,), is overwritten; 0 where no hypothesis reaches.
        which: shape (c,), is overwritten: of several contacts the strongest hypothesis, or `NONE`;
            or empty.
    """
    field[:], which[:] = 0.0, NONE
    if not len(positions):
        return
    reach = (FAR if tail > 0.0 else REACH) * float(np.sqrt(variances.max()))
    cells = cell_list(positions, max(COLUMN, reach / 4.0))
    given = (positions, likelihoods, variances, single, tail)
    _over_tiles(places, tiles, cells, *given, field, which)
