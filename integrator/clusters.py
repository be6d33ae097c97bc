"""Kernel of condensation: Euclidean clusters of voxels on integer offsets.

Single linkage: two voxels belong together when dx² + dy² + dz² ≤ reach² (method §3), in units of
the voxel's side. Sorted voxels of one (x, y) row fall into segments without gaps; two segments of
neighbouring rows are linked exactly when they overlap after one is widened by the reach that the
row offset leaves along z. Segments are joined by union-find.
"""

import numpy as np
from numpy.typing import NDArray

from contactfusion.integrator.jit import kernel
from contactfusion.integrator.store import AXIS_BITS, AXIS_MASK, ONE, Int64Array

Int32Array = NDArray[np.int32]
UintArray = NDArray[np.uintp]


@kernel
def _find(parent: UintArray, at: np.uintp) -> np.uintp:
    while parent[at] != at:
        parent[at] = parent[parent[at]]
        at = parent[at]
    return at


@kernel
def _join(parent: UintArray, one: np.uintp, other: np.uintp) -> None:
    one, other = _find(parent, one), _find(parent, other)
    if one < other:
        parent[other] = one
    else:
        parent[one] = other


@kernel
def _root(square: int) -> int:
    """Give the largest integer whose square is at most `square`."""
    root = int(np.sqrt(float(square)))
    while root * root > square:
        root -= 1
    while (root + 1) * (root + 1) <= square:
        root += 1
    return root


@kernel
def label(keys: Int64Array, reach_squared: int) -> tuple[Int32Array, int]:
    """Label voxels by cluster.

    Args:
        keys: shape (n,), ascending and distinct.
        reach_squared: the largest squared offset that links two voxels [voxels²].

    Returns:
        Labels of shape (n,), numbered in the order of the clusters' first rows, and their number.
    """
    n, reach = len(keys), _root(reach_squared)
    segments, rows = 1, 1
    for i in range(1, n):
        segments += keys[i] != keys[i - 1] + 1 or reach == 0
        rows += keys[i] >> AXIS_BITS != keys[i - 1] >> AXIS_BITS
    begin, row_begin = np.empty(segments + 1, np.uint32), np.empty(rows + 1, np.uint32)
    low, high = np.empty(segments, np.int32), np.empty(segments, np.int32)
    row_key, parent = np.empty(rows, np.int64), np.arange(segments).astype(np.uintp)
    segments, rows, row, expected = 0, 0, -1, -1
    for i in range(n):
        key = keys[i]
        if key != expected or reach == 0:
            if key >> AXIS_BITS != row:
                row = key >> AXIS_BITS
                row_key[rows], row_begin[rows] = row, segments
                rows += 1
            elif key - expected < reach:
                parent[segments] = parent[segments - 1]
            begin[segments], low[segments] = i, key & AXIS_MASK
            segments += 1
        expected = key + 1
    begin[segments], row_begin[rows] = n, segments
    for s in range(segments):
        high[s] = low[s] + begin[s + 1] - begin[s] - 1

    slack = np.empty(reach + 1, np.int64)
    for dx in range(reach + 1):
        for s in range(np.uintp(segments)):  # no parent comes after its child
            parent[s] = parent[parent[s]]
        span = _root(reach_squared - dx * dx)
        for dy in range(span + 1):
            slack[dy] = _root(reach_squared - dx * dx - dy * dy)
        nearest = np.uintp(0)
        for row in range(np.uintp(rows)):
            y = row_key[row] & AXIS_MASK
            slice_begin = row_key[row] - y - (dx << AXIS_BITS)
            while row_key[nearest] < slice_begin + max(y - span, 0):
                nearest += ONE
            farthest = slice_begin + (min(y + span, AXIS_MASK) if dx > 0 else y - 1)
            other = nearest
            while row_key[other] <= farthest:
                apart = slack[np.uintp(abs(row_key[other] - slice_begin - y))]
                a, a_end = np.uintp(row_begin[row]), np.uintp(row_begin[row + ONE])
                b, b_end = np.uintp(row_begin[other]), np.uintp(row_begin[other + ONE])
                while a < a_end and b < b_end:
                    near = (low[b] - high[a] <= apart) & (low[a] - high[b] <= apart)
                    if near & (parent[a] != parent[b]):  # one branch, seldom taken
                        _join(parent, a, b)
                    sooner = high[a] < high[b]
                    a += np.uintp(sooner)
                    b += np.uintp(not sooner)
                other += ONE

    clusters = 0
    labels, number = np.empty(n, np.int32), np.empty(segments, np.int32)
    for s in range(segments):
        root = _find(parent, np.uintp(s))
        if root == s:
            number[s] = clusters
            clusters += 1
        for i in range(begin[s], begin[s + 1]):
            labels[i] = number[root]
    return labels, clusters
