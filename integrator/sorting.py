"""Kernels that sort incoming rows by voxel: a radix sort of words of a voxel's offset and a row."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.integrator.store import AXIS_BITS, AXIS_MASK, Columns, Int64Array
from contactfusion.jit import kernel

SMALL = 48
"""Up to this many rows, insertion sort is faster than counting digits."""
IN_CACHE, PART_BITS = 1 << 16, 10
"""More rows than the first are dealt by so many leading bits into parts that the cache holds."""


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
    """Give how many bits the numbers below `count` take."""
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
    """Order words by their bits from `low` up to `high`, stably; give the array they end up in."""
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
    """Give a column in a new order; one that holds a single value is shared."""
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
