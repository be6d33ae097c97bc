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

MOST_ROTATIONS = 60
"""Jacobi's rotations of a 3x3 matrix converge in about ten."""


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
    """

    anchor: Int64Array
    voxels: Int64Array
    largest: FloatArray
    weight: FloatArray
    first: FloatArray
    second: FloatArray
    stamp: Int64Array
    shares: FloatArray


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
    n, reach = len(keys), _root(reach_squared)
    segments, rows = 1, 1
    for i in range(1, n):
        segments += keys[i] != keys[i - 1] + 1 or reach == 0
        rows += keys[i] >> AXIS_BITS != keys[i - 1] >> AXIS_BITS
    begin, row_begin = np.empty(segments + 1, np.uint32), np.empty(rows + 1, np.uint32)
    low, high = np.empty(segments, np.int32), np.empty(segments, np.int32)
    row_key, parent = np.empty(rows, np.int64), np.arange(segments)
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
        span = _root(reach_squared - dx * dx)
        for dy in range(span + 1):
            slack[dy] = _root(reach_squared - dx * dx - dy * dy)
        nearest = 0
        for row in range(rows):
            y = row_key[row] & AXIS_MASK
            slice_begin = row_key[row] - y - (dx << AXIS_BITS)
            while row_key[nearest] < slice_begin + max(y - span, 0):
                nearest += 1
            farthest = slice_begin + (min(y + span, AXIS_MASK) if dx > 0 else y - 1)
            other = nearest
            while row_key[other] <= farthest:
                apart = slack[abs(row_key[other] - slice_begin - y)]
                a, b = row_begin[row], row_begin[other]
                while a < row_begin[row + 1] and b < row_begin[other + 1]:
                    near = (low[b] - high[a] <= apart) & (low[a] - high[b] <= apart)
                    if near and parent[a] != parent[b]:
                        _join(parent, a, b)
                    if high[a] < high[b]:
                        a += 1
                    else:
                        b += 1
                other += 1

    clusters = 0
    labels, number = np.empty(n, np.int32), np.empty(segments, np.int32)
    for s in range(segments):
        root = _find(parent, s)
        if root == s:
            number[s] = clusters
            clusters += 1
        for i in range(begin[s], begin[s + 1]):
            labels[i] = number[root]
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
    """
    sources = rows.shape[1]
    anchor, voxels = np.zeros((clusters, 3), np.int64), np.zeros(clusters, np.int64)
    largest, weight = np.zeros(clusters), np.zeros(clusters)
    first, second = np.zeros((clusters, 3)), np.zeros((clusters, 6))
    stamp = np.full(clusters, np.iinfo(np.int64).min)
    shares = np.zeros((clusters, sources))
    for i in range(len(selected)):
        voxel, c = np.uintp(selected[i]), np.uintp(labels[i])
        w, key = weights[voxel], keys[voxel]
        ix, iy, iz = key >> (2 * AXIS_BITS), (key >> AXIS_BITS) & AXIS_MASK, key & AXIS_MASK
        if voxels[c] == 0:
            anchor[c, 0], anchor[c, 1], anchor[c, 2] = ix, iy, iz
        x, y, z = float(ix - anchor[c, 0]), float(iy - anchor[c, 1]), float(iz - anchor[c, 2])
        voxels[c] += 1
        largest[c] = max(largest[c], w)
        weight[c] += w
        first[c, 0] += w * x
        first[c, 1] += w * y
        first[c, 2] += w * z
        second[c, 0] += w * x * x
        second[c, 1] += w * x * y
        second[c, 2] += w * x * z
        second[c, 3] += w * y * y
        second[c, 4] += w * y * z
        second[c, 5] += w * z * z
        for source in range(sources):
            row = rows[voxel, source]
            if row >= 0 and shared[source]:
                entry = np.uintp(row)
                shares[c, source] += likelihoods[entry]
                stamp[c] = max(stamp[c], stamps[entry])
    return Sums(anchor, voxels, largest, weight, first, second, stamp, shares)


@kernel
def mean_forces(
    labels: Int32Array, clusters: int, weights: FloatArray, forces: FloatArray
) -> FloatArray:
    """Give each cluster's mean force, over its voxels that have one.

    Args:
        labels: shape (f,), of the voxels that may have a force.
        clusters: the number of labels.
        weights: shape (f,).
        forces: shape (f, 3) [N], NaN where there is none.

    Returns:
        Shape (c, 3) [N], NaN where no voxel has one.
    """
    mean, total = np.zeros((clusters, 3)), np.zeros(clusters)
    for i in range(len(labels)):
        if np.isnan(forces[i, 0]):
            continue
        for axis in range(3):
            mean[labels[i], axis] += weights[i] * forces[i, axis]
        total[labels[i]] += weights[i]
    for c in range(clusters):
        for axis in range(3):
            mean[c, axis] = mean[c, axis] / total[c] if total[c] > 0.0 else np.nan
    return mean


@kernel
def _turn(matrix: FloatArray, p: int, q: int, cosine: float, sine: float) -> None:
    for i in range(3):
        along, across = matrix[i, p], matrix[i, q]
        matrix[i, p] = cosine * along - sine * across
        matrix[i, q] = sine * along + cosine * across


@kernel
def _longest_axis(matrix: FloatArray) -> FloatArray:
    """Give the eigenvector of the largest eigenvalue by Jacobi's rotations; overwrites `matrix`."""
    axes = np.eye(3)
    trace = matrix[0, 0] + matrix[1, 1] + matrix[2, 2]
    for _ in range(MOST_ROTATIONS):
        p, q = 0, 1
        for i, j in ((0, 2), (1, 2)):
            if abs(matrix[i, j]) > abs(matrix[p, q]):
                p, q = i, j
        if abs(matrix[p, q]) <= 1e-16 * trace:
            break
        angle = 0.5 * np.arctan2(2.0 * matrix[p, q], matrix[q, q] - matrix[p, p])
        cosine, sine = np.cos(angle), np.sin(angle)
        _turn(matrix, p, q, cosine, sine)
        _turn(matrix.T, p, q, cosine, sine)
        _turn(axes, p, q, cosine, sine)
    longest = 0
    for i in range(1, 3):
        if matrix[i, i] > matrix[longest, longest]:
            longest = i
    return axes[:, longest]


@kernel
def outline(
    selected: Int64Array, labels: Int32Array, keys: Int64Array, sums: Sums
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Find where each cluster lies and how far it reaches along its longest axis.

    Args:
        selected: shape (n,), rows of the voxels that are labelled.
        labels: shape (n,).
        keys: shape (m,), of all voxels.
        sums: of the clusters.

    Returns:
        The centroids, shape (c, 3), in packed voxel indices; the weighted covariances, shape
        (c, 3, 3) [voxels²]; from the centroid to the two ends, shape (c, 2, 3) [voxels].
    """
    clusters = len(sums.weight)
    centres, scatter = np.empty((clusters, 3)), np.empty((clusters, 3, 3))
    axes, ends = np.empty((clusters, 3)), np.empty((clusters, 2, 3))
    least, most = np.full(clusters, np.inf), np.full(clusters, -np.inf)
    for c in range(clusters):
        mean = sums.first[c] / sums.weight[c]
        centres[c] = sums.anchor[c] + mean
        k = 0
        for i in range(3):
            for j in range(i, 3):
                scatter[c, i, j] = sums.second[c, k] / sums.weight[c] - mean[i] * mean[j]
                scatter[c, j, i] = scatter[c, i, j]
                k += 1
        axis = _longest_axis(scatter[c].copy())
        axes[c] = axis * np.sign(axis[np.argmax(np.abs(axis))])
    for i in range(len(selected)):
        c, key = np.uintp(labels[i]), keys[np.uintp(selected[i])]
        along = (
            (float(key >> (2 * AXIS_BITS)) - centres[c, 0]) * axes[c, 0]
            + (float((key >> AXIS_BITS) & AXIS_MASK) - centres[c, 1]) * axes[c, 1]
            + (float(key & AXIS_MASK) - centres[c, 2]) * axes[c, 2]
        )
        least[c], most[c] = min(least[c], along), max(most[c], along)
    for c in range(clusters):
        ends[c, 0], ends[c, 1] = least[c] * axes[c], most[c] * axes[c]
    return centres, scatter, ends
