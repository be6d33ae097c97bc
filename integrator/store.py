"""Kernels of the store: rows sorted by voxel, and the newest entry of each voxel and source.

A voxel's key packs its three indices, offset to be positive, into 63 bits, so that ascending keys
are ascending (ix, iy, iz). Entries stand grouped by source and sorted by key: a cloud is sorted
once, by a radix sort, and merged; a source is removed or replaced by leaving its group out, and
nothing that an earlier step has seen is ever written again.
"""

from typing import Any, NamedTuple

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
SMALL = 48
"""Up to this many rows, insertion sort is faster than counting digits."""
IN_CACHE, PART_BITS = 1 << 16, 10
"""From the first number of rows on, this number of leading bits makes parts that fit the cache."""

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
        """Some of the rows; a slice shares memory, a mask copies."""
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
        """Release the memory behind the first rows; these arrays may be held nowhere else yet."""
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
    """The mean place of the hypotheses of each entry, shape (n, 3) [m].

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
    """The voxel indices of packed keys, shape (n, 3)."""
    shifts = np.array([2 * AXIS_BITS, AXIS_BITS, 0])
    voxels: Int64Array = ((keys[:, None] >> shifts) & AXIS_MASK) - AXIS_ORIGIN
    return voxels


@kernel
def _sort_small(keys: Int64Array, begin: int, end: int, order: NDArray[np.uint32]) -> None:
    for row in range(begin, end):
        at = row
        while at > begin and keys[order[at - 1]] > keys[row]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = row


@kernel
def _bits(count: int | np.int64) -> int:
    """How many bits the numbers below `count` take."""
    bits = 0
    while (1 << bits) < count:
        bits += 1
    return bits


@kernel
def _scatter(
    words: Int64Array, out: Int64Array, shift: int, bits: int, ends: NDArray[np.uint32]
) -> None:
    """Order words by one digit, `bits` wide from `shift` on, stably; leave each digit's end."""
    mask = (1 << bits) - 1
    ends[: mask + 1] = 0
    for word in words:
        ends[np.uintp((word >> shift) & mask)] += np.uint32(1)
    total = np.uint32(0)
    for digit in range(mask + 1):
        count = ends[digit]
        ends[digit] = total
        total += count
    for word in words:
        place = np.uintp((word >> shift) & mask)
        at = ends[place]
        ends[place] = at + np.uint32(1)
        out[np.uintp(at)] = word


@kernel
def _sorted_words(words: Int64Array, spare: Int64Array, low: int, high: int) -> Int64Array:
    """Order words by their bits from `low` up to `high`, stably; returns their final array."""
    widest = 12 if len(words) > 4096 else 8
    passes = (high - low + widest - 1) // widest
    bits = (high - low + passes - 1) // passes if passes > 0 else 0
    ends = np.empty(1 << bits, np.uint32)
    for shift in range(low, low + passes * bits, max(bits, 1)):
        _scatter(words, spare, shift, bits, ends)
        words, spare = spare, words
    return words


@kernel
def _sort_large(
    keys: Int64Array,
    begin: int,
    end: int,
    order: NDArray[np.uint32],
    out: Int64Array,
    scratch: Int64Array,
) -> None:
    """Sort by counting digits of the voxels' offsets inside the rows' bounding box.

    An offset and its row make one word; `scratch` and `out` take turns to hold them. Many words are
    first dealt into parts that fit into the cache. Where an offset has too many bits to share a
    word with its row, its lower bits are sorted first.
    """
    n = end - begin
    low_x = low_y = low_z = np.int64(AXIS_MASK)
    high_x = high_y = high_z = np.int64(0)
    for key in keys[begin:end]:
        x, y, z = key >> (2 * AXIS_BITS), (key >> AXIS_BITS) & AXIS_MASK, key & AXIS_MASK
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
        low_z, high_z = min(low_z, z), max(high_z, z)
    corner = (low_x << (2 * AXIS_BITS)) | (low_y << AXIS_BITS) | low_z
    bits_z, bits_y = _bits(high_z - low_z + 1), _bits(high_y - low_y + 1)
    bits = _bits(high_x - low_x + 1) + bits_y + bits_z
    bits_yz, mask_y, mask_z = bits_y + bits_z, (1 << bits_y) - 1, (1 << bits_z) - 1
    row_bits = _bits(n)
    row_mask = (1 << row_bits) - 1
    words, spare, before = scratch[:n], out[begin:end], order[:0].copy()
    ends = np.empty(1 << PART_BITS, np.uint32)
    done = 0
    while True:
        room = min(bits - done, 63 - row_bits)
        for i in range(n):
            key = keys[begin + i] if done == 0 else keys[before[i]]
            key -= corner
            x, y, z = key >> (2 * AXIS_BITS), (key >> AXIS_BITS) & AXIS_MASK, key & AXIS_MASK
            offset = ((x << bits_yz) | (y << bits_z) | z) >> done
            words[i] = ((offset & ((1 << room) - 1)) << row_bits) | i
        top = min(room, PART_BITS) if n > IN_CACHE else 0
        split = row_bits + room - top
        if top > 0:
            _scatter(words, spare, split, top, ends)
            words, spare = spare, words
        else:
            ends[0] = n
        first = np.int64(0)
        for part in range(1 << top):
            last = np.int64(ends[part])
            ordered = _sorted_words(words[first:last], spare[first:last], row_bits, split)
            for i in range(last - first):
                word, at = ordered[i], np.uintp(begin + first + i)
                row = np.uintp(word & row_mask)
                if room == bits:
                    offset = word >> row_bits
                    x, y, z = offset >> bits_yz, (offset >> bits_z) & mask_y, offset & mask_z
                    out[at] = corner + ((x << (2 * AXIS_BITS)) | (y << AXIS_BITS) | z)
                    order[at] = begin + row
                else:
                    order[at] = before[row] if done > 0 else begin + row
                    out[at] = keys[np.uintp(order[at])]
            first = last
        done += room
        if done >= bits:
            return
        before = order[begin:end].copy()


@kernel
def _uniform(column: NDArray[Any]) -> bool:
    same = True
    for value in column:
        same &= value == column[0]
    return same


@kernel
def _pick(column: NDArray[Any], order: NDArray[np.uint32], out: NDArray[Any]) -> None:
    for i in range(len(order)):
        out[i] = column[np.uintp(order[i])]


def _reordered(column: NDArray[Any], order: NDArray[np.uint32]) -> NDArray[Any]:
    """A column in a new order; one that holds a single value is shared."""
    if _uniform(column):
        return column
    out = np.empty_like(column)
    _pick(column, order, out)
    return out


@kernel
def _sort_groups(
    keys: Int64Array,
    ranges: Int64Array,
    order: NDArray[np.uint32],
    out: Int64Array,
    scratch: Int64Array,
) -> None:
    for group in range(len(ranges)):
        begin, end = ranges[group, 0], ranges[group, 1]
        if end - begin <= SMALL:
            _sort_small(keys, begin, end, order)
            for i in range(begin, end):
                out[i] = keys[order[i]]
        else:
            _sort_large(keys, begin, end, order, out, scratch)


def sort_rows(rows: Columns, ranges: Int64Array) -> tuple[Columns, NDArray[np.uint32]]:
    """Sort the rows of each group by key, keeping the order of arrival among equals.

    Args:
        rows: n incoming rows.
        ranges: shape (k, 3), where each group begins and ends; the groups cover all rows.

    Returns:
        The rows in their new order, but for forces and offsets, and which row each was, shape (n,).
    """
    n = len(rows.keys)
    order = np.empty(n, np.uint32)  # by numpy, which asks for huge pages; a kernel's would be small
    keys, scratch = np.empty(n, np.int64), np.empty(n, np.int64)
    _sort_groups(rows.keys, ranges, order, keys, scratch)
    likelihoods, stamps, spreads, single = (_reordered(column, order) for column in rows[1:5])
    return Columns(keys, likelihoods, stamps, spreads, single, rows.forces, rows.offsets), order


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
