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
from contactfusion.jit import kernel

AXIS_BITS = 21
AXIS_MASK = (1 << AXIS_BITS) - 1
AXIS_ORIGIN = VOXEL_LIMIT - 1
"""What is added to an index, so that the least is 0 and no key is `BEYOND`."""
BEYOND = (1 << 63) - 1
"""A key after all others."""
ONE = np.uintp(1)

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
            Incoming rows have f and 1, or zeros. Sources without any force have no rows here.
        offsets: shape (n, 4) of sums Σp(x - c) [m], Σp over the hypotheses x of an entry, c the
            centre of its voxel; incoming rows have x - c and 1. No rows where no rule asks.
    """

    keys: Int64Array
    likelihoods: NDArray[np.float32]
    stamps: Int64Array
    spreads: NDArray[np.float32]
    single: NDArray[np.bool_]
    forces: FloatArray
    offsets: NDArray[np.float32]

    def picked(self, rows: Pick, force_rows: Pick) -> "Columns":
        """Give some of the rows; a slice shares memory, a mask copies."""
        return Columns(
            self.keys[rows],
            self.likelihoods[rows],
            self.stamps[rows],
            self.spreads[rows],
            self.single[rows],
            self.forces[force_rows],
            self.offsets[rows] if len(self.offsets) else self.offsets,
        )

    def shrink(self, rows: int, force_rows: int) -> None:
        """Give the memory behind the first rows back; nobody else may hold these arrays yet."""
        for column in self[:5]:
            column.resize(rows, refcheck=False)
        self.forces.resize((force_rows, 4), refcheck=False)
        if len(self.offsets):
            self.offsets.resize((rows, 4), refcheck=False)


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
            key = (key << AXIS_BITS) | (int(index) + AXIS_ORIGIN)
        keys[row] = key
    return -1


@kernel
def offset_from_centres(positions: FloatArray, side: float, offsets: NDArray[np.float32]) -> None:
    """Write how far places lie from the centres of their voxels.

    Args:
        positions: shape (n, 3) [m].
        side: of a voxel [m].
        offsets: shape (n, 4), is overwritten: x - c [m], and 1.
    """
    for row in range(len(positions)):
        for axis in range(3):
            place = positions[row, axis]
            offsets[row, axis] = place - (np.floor(place * (1.0 / side)) + 0.5) * side
        offsets[row, 3] = 1.0


@kernel
def mean_places(keys: Int64Array, offsets: NDArray[np.float32], side: float) -> FloatArray:
    """Give the mean place of the hypotheses of each entry, shape (n, 3) [m].

    Args:
        keys: shape (n,), packed voxels.
        offsets: shape (n, 4) of sums Σp(x - c) [m], Σp; or without rows: then the voxels' centres.
        side: of a voxel [m].
    """
    places = np.empty((len(keys), 3))
    for row in range(len(keys)):
        for axis in range(3):
            index = ((keys[row] >> (AXIS_BITS * (2 - axis))) & AXIS_MASK) - AXIS_ORIGIN
            places[row, axis] = (index + 0.5) * side
            if len(offsets):
                places[row, axis] += offsets[row, axis] / offsets[row, 3]
    return places


def unpack(keys: Int64Array) -> Int64Array:
    """Give the voxel indices of packed keys, shape (n, 3)."""
    shifts = np.array([2 * AXIS_BITS, AXIS_BITS, 0])
    voxels: Int64Array = ((keys[:, None] >> shifts) & AXIS_MASK) - AXIS_ORIGIN
    return voxels


@kernel
def merge(
    old: Columns,
    old_range: Int64Array,
    rows: Columns,
    row_range: Int64Array,
    order: NDArray[np.uint32],
    oldest: Int64Array,
    out: Columns,
) -> Int64Array:
    """Merge incoming rows into the entries, keep the newest of each voxel and source (method §1).

    Per voxel and source the newest row wins; rows with one stamp give their largest likelihood;
    a likelihood of 0 removes an older entry. Entries older than `oldest` are left out. Every entry
    is written; the next is written over it unless it counts.

    Args:
        old: the entries so far.
        old_range: shape (k, 3): for each source its entries' begin and end, and its first row in
            `old.forces` or -1.
        rows: incoming rows grouped by source and sorted by key, stamps never falling within one.
        row_range: shape (k, 3), likewise for the incoming rows.
        order: shape (n,), which row each was in the order of arrival, in which `rows.forces` and
            `rows.offsets` are.
        oldest: shape (k,) [ns], the oldest stamp that still lives, by source.
        out: room for all old entries and all rows; `forces` likewise for sources with force.

    Returns:
        Shape (k + 1, 2): where the entries of each source begin in `out`, and its first row in
        `out.forces` or -1; the last row holds both totals.
    """
    # attributes would count references
    keys, likelihoods, stamps, spreads, singles, forces, offsets = out
    old_keys, old_likelihoods, old_stamps, old_spreads, old_singles, old_forces, old_offsets = old
    row_keys, row_likelihoods, row_stamps, row_spreads, row_singles, row_forces, row_offsets = rows
    sources, placed = len(old_range), len(offsets) > 0
    offset = np.zeros(4)
    starts = np.empty((sources + 1, 2), np.int64)
    count, force_count = (
        np.uintp(0),
        np.int64(0),
    )  # unsigned: no index is looked at for being negative
    for source in range(sources):
        at, end = np.uintp(old_range[source, 0]), np.uintp(old_range[source, 1])
        next_row, last_row = np.uintp(row_range[source, 0]), np.uintp(row_range[source, 1])
        old_force, row_force = old_range[source, 2], row_range[source, 2]
        forceful, eldest = old_force >= 0 or row_force >= 0, oldest[source]
        starts[source, 0], starts[source, 1] = count, force_count if forceful else -1
        to_old = np.uintp(old_force) - at  # unsigned numbers wrap around, and so do sums with them
        to_row, to_force = np.uintp(row_force) - next_row, np.uintp(force_count) - count
        while at < end or next_row < last_row:
            key = row_keys[next_row] if next_row < last_row else BEYOND
            while at < end and old_keys[at] < key:
                keys[count], likelihoods[count] = old_keys[at], old_likelihoods[at]
                stamps[count], spreads[count] = old_stamps[at], old_spreads[at]
                singles[count] = old_singles[at]
                if forceful:
                    for i in range(4):
                        forces[to_force + count, i] = (
                            old_forces[to_old + at, i] if old_force >= 0 else 0.0
                        )
                if placed:
                    for i in range(4):
                        offsets[count, i] = old_offsets[at, i]
                count += np.uintp(old_stamps[at] >= eldest)
                at += ONE
            if next_row == last_row:
                break
            likelihood, stamp = np.float32(0.0), np.int64(0)
            spread, single = np.float32(0.0), False
            fx, fy, fz, weight = 0.0, 0.0, 0.0, 0.0
            offset[:] = 0.0
            if at < end and old_keys[at] == key:
                likelihood, stamp = old_likelihoods[at], old_stamps[at]
                spread, single = old_spreads[at], old_singles[at]
                if old_force >= 0:
                    force = old_forces[to_old + at]
                    fx, fy, fz, weight = force[0], force[1], force[2], force[3]
                if placed:
                    offset[:] = old_offsets[at]
                at += ONE
            while next_row < last_row and row_keys[next_row] == key:
                row = next_row
                next_row += ONE
                p = row_likelihoods[row]
                newer = likelihood == 0.0 or row_stamps[row] > stamp
                if p == 0.0:
                    if newer:
                        likelihood = p
                    continue
                if newer or p > likelihood:
                    likelihood, stamp = p, row_stamps[row]
                    spread, single = row_spreads[row], row_singles[row]
                elif p == likelihood:
                    spread = max(spread, row_spreads[row])
                    single = single or row_singles[row]
                if placed:
                    given = row_offsets[np.uintp(order[row])]
                    for i in range(4):
                        offset[i] = (0.0 if newer else offset[i]) + p * given[i]
                if forceful:
                    force_row = to_row + order[row]
                    felt = row_force >= 0 and row_forces[force_row, 3] > 0.0
                    if newer or not felt:
                        fx, fy, fz, weight = 0.0, 0.0, 0.0, 0.0
                    if felt:
                        force = row_forces[force_row]
                        fx += p * force[0]
                        fy += p * force[1]
                        fz += p * force[2]
                        weight += p
            keys[count], likelihoods[count] = key, likelihood
            stamps[count], spreads[count], singles[count] = stamp, spread, single
            if forceful:
                force = forces[to_force + count]
                force[0], force[1], force[2], force[3] = fx, fy, fz, weight
            if placed:
                for i in range(4):
                    offsets[count, i] = offset[i]
            count += np.uintp(likelihood > 0.0 and stamp >= eldest)
        if forceful:
            force_count = np.int64(to_force + count)
    starts[sources, 0], starts[sources, 1] = count, force_count
    return starts
