"""Kernels of condensation: Euclidean clusters of voxels on integer offsets, and their sums.

Single linkage: two voxels belong together when dx² + dy² + dz² ≤ reach² (SPEC §3), in units of the
voxel's side. Sorted voxels of one (x, y) row fall into segments without gaps; two segments of
neighbouring rows are linked exactly when they overlap after one is widened by the reach that the
row offset leaves along z. Segments are joined by union-find.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.integrator.jit import kernel
from contactfusion.integrator.store import AXIS_BITS, AXIS_MASK, Int64Array

Int32Array = NDArray[np.int32]


class Sums(NamedTuple):
    """What each cluster adds up to; w is the weight of a voxel, x its offset from `anchor`.

    Attributes:
        anchor: shape (c, 3), the voxel of each cluster's first row.
        voxels: shape (c,), how many.
        largest: shape (c,), the largest w.
        weight: shape (c,), Σ w.
        first: shape (c, 3), Σ w x in voxels.
        second: shape (c, 6), Σ w of xx, xy, xz, yy, yz, zz.
        stamp: shape (c,) [ns], the newest entry.
        shares: shape (c, k), Σ p by source.
        force: shape (c, 4), Σ w f [N] and Σ w over voxels that have a force.
    """

    anchor: Int64Array
    voxels: Int64Array
    largest: FloatArray
    weight: FloatArray
    first: FloatArray
    second: FloatArray
    stamp: Int64Array
    shares: FloatArray
    force: FloatArray


@kernel
def _find(parent: Int64Array, at: int) -> int:
    while parent[at] != at:
        parent[at] = parent[parent[at]]
        at = parent[at]
    return at


@kernel
def _join(parent: Int64Array, one: int, other: int) -> None:
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
    n = len(keys)
    segment_of = np.empty(n, np.int64)
    low, high = np.empty(n, np.int64), np.empty(n, np.int64)
    row_key, row_begin = np.empty(n, np.int64), np.empty(n + 1, np.int64)
    segments, rows = 0, 0
    for i in range(n):
        key = keys[i]
        if i == 0 or key != keys[i - 1] + 1:
            row, z = key >> AXIS_BITS, key & AXIS_MASK
            if rows == 0 or row_key[rows - 1] != row:
                row_key[rows], row_begin[rows] = row, segments
                rows += 1
            low[segments] = high[segments] = z
            segments += 1
        else:
            high[segments - 1] += 1
        segment_of[i] = segments - 1
    row_begin[rows] = segments
    parent = np.arange(segments)

    reach = _root(reach_squared)
    for row in range(rows):
        for s in range(row_begin[row] + 1, row_begin[row + 1]):
            if low[s] - high[s - 1] <= reach:
                _join(parent, s - 1, s)
    for dx in range(reach + 1):
        span = _root(reach_squared - dx * dx)
        for dy in range(1 if dx == 0 else -span, span + 1):
            slack = _root(reach_squared - dx * dx - dy * dy)
            step = (dx << AXIS_BITS) + dy
            other = 0
            for row in range(rows):
                y = (row_key[row] & AXIS_MASK) + dy
                target = row_key[row] + step
                while other < rows and row_key[other] < target:
                    other += 1
                if other == rows:
                    break
                if row_key[other] != target or not 0 < y <= AXIS_MASK:
                    continue
                a, a_end = row_begin[row], row_begin[row + 1]
                b, b_end = row_begin[other], row_begin[other + 1]
                while a < a_end and b < b_end:
                    if high[a] + slack < low[b]:
                        a += 1
                    elif high[b] + slack < low[a]:
                        b += 1
                    else:
                        _join(parent, a, b)
                        if high[a] < high[b]:
                            a += 1
                        else:
                            b += 1

    clusters = 0
    number = np.empty(segments, np.int32)
    for s in range(segments):
        root = _find(parent, s)
        if root == s:
            number[s] = clusters
            clusters += 1
        else:
            number[s] = number[root]
    labels = np.empty(n, np.int32)
    for i in range(n):
        labels[i] = number[segment_of[i]]
    return labels, clusters


@kernel
def add_up(
    selected: Int64Array,
    labels: Int32Array,
    clusters: int,
    keys: Int64Array,
    weights: FloatArray,
    rows: Int32Array,
    likelihoods: NDArray[np.float32],
    stamps: Int64Array,
    shared: NDArray[np.bool_],
    forces: FloatArray,
) -> Sums:
    """Add up the voxels of each cluster.

    Args:
        selected: shape (n,), rows of the voxels that are labelled.
        labels: shape (n,).
        clusters: the number of labels.
        keys: shape (m,), of all voxels.
        weights: shape (m,), of all voxels.
        rows: shape (m, k), each source's entry in each voxel, or -1.
        likelihoods: of the entries.
        stamps: of the entries [ns].
        shared: shape (k,), which sources have a share: all but null.
        forces: shape (m, 3) [N], NaN where there is none, or (0, 3) when no source has forces.
    """
    sums = Sums(
        np.zeros((clusters, 3), np.int64),
        np.zeros(clusters, np.int64),
        np.zeros(clusters),
        np.zeros(clusters),
        np.zeros((clusters, 3)),
        np.zeros((clusters, 6)),
        np.full(clusters, np.iinfo(np.int64).min),
        np.zeros((clusters, rows.shape[1])),
        np.zeros((clusters, 4)),
    )
    for i in range(len(selected)):
        voxel, c = selected[i], labels[i]
        w, key = weights[voxel], keys[voxel]
        ix, iy, iz = key >> (2 * AXIS_BITS), (key >> AXIS_BITS) & AXIS_MASK, key & AXIS_MASK
        anchor = sums.anchor[c]
        if sums.voxels[c] == 0:
            anchor[0], anchor[1], anchor[2] = ix, iy, iz
        x, y, z = float(ix - anchor[0]), float(iy - anchor[1]), float(iz - anchor[2])
        sums.voxels[c] += 1
        sums.largest[c] = max(sums.largest[c], w)
        sums.weight[c] += w
        first, second = sums.first[c], sums.second[c]
        first[0] += w * x
        first[1] += w * y
        first[2] += w * z
        second[0] += w * x * x
        second[1] += w * x * y
        second[2] += w * x * z
        second[3] += w * y * y
        second[4] += w * y * z
        second[5] += w * z * z
        for source in range(rows.shape[1]):
            row = rows[voxel, source]
            if row >= 0 and shared[source]:
                sums.shares[c, source] += likelihoods[row]
                sums.stamp[c] = max(sums.stamp[c], stamps[row])
        if len(forces) and not np.isnan(forces[voxel, 0]):
            for axis in range(3):
                sums.force[c, axis] += w * forces[voxel, axis]
            sums.force[c, 3] += w
    return sums


@kernel
def reach_along(
    selected: Int64Array,
    labels: Int32Array,
    keys: Int64Array,
    centres: FloatArray,
    axes: FloatArray,
) -> FloatArray:
    """Find how far each cluster reaches along its axis, from its centre.

    Args:
        selected: shape (n,), rows of the voxels that are labelled.
        labels: shape (n,).
        keys: shape (m,), of all voxels.
        centres: shape (c, 3), in packed voxel indices.
        axes: shape (c, 3), unit vectors.

    Returns:
        Shape (c, 2), the least and greatest offset of a voxel's centre [voxels].
    """
    ends = np.empty((len(centres), 2))
    ends[:, 0], ends[:, 1] = np.inf, -np.inf
    for i in range(len(selected)):
        c, key = labels[i], keys[selected[i]]
        centre, axis = centres[c], axes[c]
        along = (
            (float(key >> (2 * AXIS_BITS)) - centre[0]) * axis[0]
            + (float((key >> AXIS_BITS) & AXIS_MASK) - centre[1]) * axis[1]
            + (float(key & AXIS_MASK) - centre[2]) * axis[2]
        )
        ends[c, 0] = min(ends[c, 0], along)
        ends[c, 1] = max(ends[c, 1], along)
    return ends
