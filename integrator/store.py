"""Kernels of the store: places to voxel keys, and the newest entry of each voxel and source.

A voxel's key packs its three indices, offset to be positive, into 63 bits, so that ascending keys
are ascending (ix, iy, iz). Entries stand grouped by source and sorted by key: a cloud is sorted
once and merged, a source is removed or replaced by leaving its group out, and nothing that an
earlier step has seen is ever written again.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.grid import VOXEL_LIMIT
from contactfusion.integrator.jit import kernel

AXIS_BITS = 21
AXIS_MASK = (1 << AXIS_BITS) - 1
SMALL = 48
"""Up to this many rows, insertion sort is faster than counting digits."""

Int64Array = NDArray[np.int64]
Pick = slice | NDArray[np.bool_]


class Columns(NamedTuple):
    """Entries or incoming rows as columns.

    Attributes:
        keys: shape (n,), packed voxels.
        likelihoods: shape (n,).
        stamps: shape (n,) [ns].
        spreads: shape (n,) [m], 0 where the source gave none.
        single: shape (n,), whether the entry belongs to a cloud that describes one contact.
        forces: shape (f, 4) of sums Σpf [N], Σp for entries; Σp = 0 where there is no force.
            For incoming rows shape (n, 4) of f, 1 (or zeros), or (0, 4) when no row has a force.
    """

    keys: Int64Array
    likelihoods: NDArray[np.float32]
    stamps: Int64Array
    spreads: NDArray[np.float32]
    single: NDArray[np.bool_]
    forces: FloatArray

    def picked(self, rows: Pick, force_rows: Pick) -> "Columns":
        """Give some of the rows; a slice shares memory, a mask copies."""
        return Columns(
            self.keys[rows],
            self.likelihoods[rows],
            self.stamps[rows],
            self.spreads[rows],
            self.single[rows],
            self.forces[force_rows],
        )


@kernel
def rasterise(positions: FloatArray, inverse_side: float, keys: Int64Array) -> int:
    """Write the key of the voxel that each place lies in.

    Args:
        positions: shape (n, 3) [m].
        inverse_side: 1 / side of a voxel [1/m].
        keys: shape (n,), is overwritten.

    Returns:
        The first row whose voxel index reaches the limit, or -1.
    """
    for row in range(len(positions)):
        key = 0
        for axis in range(3):
            index = np.floor(positions[row, axis] * inverse_side)
            if not -VOXEL_LIMIT < index < VOXEL_LIMIT:
                return row
            key = (key << AXIS_BITS) | (int(index) + VOXEL_LIMIT)
        keys[row] = key
    return -1


def unpack(keys: Int64Array) -> Int64Array:
    """Give the voxel indices of packed keys, shape (n, 3)."""
    shifts = np.array([2 * AXIS_BITS, AXIS_BITS, 0])
    voxels: Int64Array = ((keys[:, None] >> shifts) & AXIS_MASK) - VOXEL_LIMIT
    return voxels


@kernel
def _sort_small(keys: Int64Array, begin: int, end: int, order: NDArray[np.int32]) -> None:
    for row in range(begin, end):
        at = row
        while at > begin and keys[order[at - 1]] > keys[row]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = row


@kernel
def _sort_large(keys: Int64Array, begin: int, end: int, order: NDArray[np.int32]) -> None:
    """Sort by counting digits of the cell number inside the rows' bounding box."""
    n = end - begin
    low = np.full(3, np.int64(AXIS_MASK))
    high = np.zeros(3, np.int64)
    for row in range(begin, end):
        for axis in range(3):
            index = (keys[row] >> (axis * AXIS_BITS)) & AXIS_MASK
            low[axis] = min(low[axis], index)
            high[axis] = max(high[axis], index)
    side_z, side_y = high[0] - low[0] + 1, high[1] - low[1] + 1
    cells = np.empty(n, np.int64)
    rows = np.empty(n, np.int32)
    for i in range(n):
        key = keys[begin + i]
        x = (key >> (2 * AXIS_BITS)) - low[2]
        y = ((key >> AXIS_BITS) & AXIS_MASK) - low[1]
        cells[i] = (x * side_y + y) * side_z + (key & AXIS_MASK) - low[0]
        rows[i] = begin + i
    digit_bits = 11 if n > 4096 else 8
    buckets = 1 << digit_bits
    start = np.empty(buckets, np.int64)
    other_cells, other_rows = np.empty_like(cells), np.empty_like(rows)
    remaining = (high[2] - low[2] + 1) * side_y * side_z - 1
    shift = 0
    while remaining > 0:
        start[:] = 0
        for i in range(n):
            start[(cells[i] >> shift) & (buckets - 1)] += 1
        total = 0
        for bucket in range(buckets):
            count = start[bucket]
            start[bucket] = total
            total += count
        for i in range(n):
            bucket = (cells[i] >> shift) & (buckets - 1)
            at = start[bucket]
            start[bucket] = at + 1
            other_cells[at], other_rows[at] = cells[i], rows[i]
        cells, other_cells = other_cells, cells
        rows, other_rows = other_rows, rows
        shift += digit_bits
        remaining >>= digit_bits
    order[begin:end] = rows


@kernel
def sort_rows(keys: Int64Array, begin: Int64Array) -> NDArray[np.int32]:
    """Sort the rows of each group by key, keeping the order of arrival among equals.

    Args:
        keys: shape (n,).
        begin: shape (k + 1,), where each group begins.

    Returns:
        Shape (n,): the rows in their new order.
    """
    order = np.empty(len(keys), np.int32)
    for group in range(len(begin) - 1):
        if begin[group + 1] - begin[group] <= SMALL:
            _sort_small(keys, begin[group], begin[group + 1], order)
        else:
            _sort_large(keys, begin[group], begin[group + 1], order)
    return order


@kernel
def merge(
    old: Columns,
    old_range: Int64Array,
    rows: Columns,
    row_begin: Int64Array,
    order: NDArray[np.int32],
    oldest: Int64Array,
    out: Columns,
) -> Int64Array:
    """Merge incoming rows into the entries, keep the newest of each voxel and source (SPEC §1).

    Per voxel and source the newest row wins; rows with one stamp give their largest likelihood;
    a likelihood of 0 removes an older entry. Entries older than `oldest` are left out.

    Args:
        old: the entries so far.
        old_range: shape (k, 3): for each source its entries' begin and end, and its first row in
            `old.forces` or -1.
        rows: incoming rows grouped by source, in order of arrival, stamps never falling.
        row_begin: shape (k + 1,), where the rows of each source begin.
        order: the rows of each source sorted by key.
        oldest: shape (k,) [ns], the oldest stamp that still lives, by source.
        out: room for all old entries and all rows; `forces` likewise for sources with force.

    Returns:
        Shape (k + 1, 2): where the entries of each source begin in `out`, and its first row in
        `out.forces` or -1; the last row holds both totals.
    """
    sources = len(old_range)
    starts = np.empty((sources + 1, 2), np.int64)
    count, force_count = 0, 0
    rows_have_forces = len(rows.forces) > 0
    for source in range(sources):
        at, end, force_at = old_range[source]
        next_row, last_row = row_begin[source], row_begin[source + 1]
        forceful = force_at >= 0
        if rows_have_forces and not forceful:
            for i in range(next_row, last_row):
                if rows.forces[i, 3] > 0.0:
                    forceful = True
                    break
        starts[source, 0] = count
        starts[source, 1] = force_count if forceful else -1
        first = at
        while at < end or next_row < last_row:
            likelihood, stamp = np.float32(0.0), np.int64(0)
            spread, single = np.float32(0.0), False
            fx, fy, fz, weight = 0.0, 0.0, 0.0, 0.0
            if next_row == last_row or (at < end and old.keys[at] <= rows.keys[order[next_row]]):
                key = old.keys[at]
                likelihood, stamp = old.likelihoods[at], old.stamps[at]
                spread, single = old.spreads[at], old.single[at]
                if force_at >= 0:
                    force = old.forces[force_at + at - first]
                    fx, fy, fz, weight = force[0], force[1], force[2], force[3]
                at += 1
            else:
                key = rows.keys[order[next_row]]
            while next_row < last_row and rows.keys[order[next_row]] == key:
                row = order[next_row]
                next_row += 1
                p = rows.likelihoods[row]
                newer = likelihood == 0.0 or rows.stamps[row] > stamp
                if p == 0.0:
                    if newer:
                        likelihood = np.float32(0.0)
                    continue
                if newer:
                    likelihood, stamp = p, rows.stamps[row]
                    spread, single = rows.spreads[row], rows.single[row]
                    fx, fy, fz, weight = 0.0, 0.0, 0.0, 0.0
                elif p > likelihood:
                    likelihood = p
                    spread, single = rows.spreads[row], rows.single[row]
                elif p == likelihood:
                    spread = max(spread, rows.spreads[row])
                    single = single or rows.single[row]
                if rows_have_forces and rows.forces[row, 3] > 0.0:
                    fx += p * rows.forces[row, 0]
                    fy += p * rows.forces[row, 1]
                    fz += p * rows.forces[row, 2]
                    weight += p
                else:
                    fx, fy, fz, weight = 0.0, 0.0, 0.0, 0.0
            if likelihood == 0.0 or stamp < oldest[source]:
                continue
            out.keys[count], out.likelihoods[count] = key, likelihood
            out.stamps[count], out.spreads[count] = stamp, spread
            out.single[count] = single
            if forceful:
                force = out.forces[force_count]
                force[0], force[1], force[2], force[3] = fx, fy, fz, weight
                force_count += 1
            count += 1
    starts[sources, 0], starts[sources, 1] = count, force_count
    return starts
