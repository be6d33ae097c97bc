"""Kernels of condensation: Euclidean clusters of voxels on integer offsets, and their sums.

Single linkage: two voxels belong together when dx² + dy² + dz² ≤ reach² (method §3), in units of
the voxel's side. Sorted voxels of one (x, y) row fall into segments without gaps; two segments of
neighbouring rows are linked exactly when they overlap after one is widened by the reach that the
row offset leaves along z. Segments are joined by union-find.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.integrator.jit import kernel
from contactfusion.integrator.store import AXIS_BITS, AXIS_MASK, AXIS_ORIGIN, ONE, Int64Array

Int32Array = NDArray[np.int32]
UintArray = NDArray[np.uintp]

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


class Outlines(NamedTuple):
    """The places and shapes of clusters.

    Attributes:
        positions: shape (c, 3) [m], the weighted centroids.
        dispersions: shape (c,) [m], the weighted standard distances from the centroids.
        covariances: shape (c, 3, 3) [m²], weighted, with side²/12 on the diagonal.
        extents: shape (c, 2, 3) [m], the two ends along the longest axis.
    """

    positions: FloatArray
    dispersions: FloatArray
    covariances: FloatArray
    extents: FloatArray


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
    """Give the eigenvector of the largest eigenvalue by Jacobi's rotations; overwrites `matrix`.

    Of the two directions it gives the one whose largest component is positive.
    """
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
    longest = leading = 0
    for i in range(1, 3):
        if matrix[i, i] > matrix[longest, longest]:
            longest = i
    for i in range(1, 3):
        if abs(axes[i, longest]) > abs(axes[leading, longest]):
            leading = i
    sign = np.sign(axes[leading, longest])
    axis = np.empty(3)
    for i in range(3):
        axis[i] = sign * axes[i, longest]
    return axis


@kernel
def outline(
    selected: Int64Array, labels: Int32Array, keys: Int64Array, sums: Sums, side: float
) -> Outlines:
    """Find where each cluster lies, how it is spread and how far it reaches.

    Args:
        selected: shape (n,), rows of the voxels that are labelled.
        labels: shape (n,).
        keys: shape (m,), of all voxels.
        sums: of the clusters.
        side: of a voxel [m].
    """
    clusters = len(sums.weight)
    centres, axes = np.empty((clusters, 3)), np.empty((clusters, 3))
    least, most = np.full(clusters, np.inf), np.full(clusters, -np.inf)
    positions, dispersions = np.empty((clusters, 3)), np.empty(clusters)
    covariances, extents = np.empty((clusters, 3, 3)), np.empty((clusters, 2, 3))
    scatter = np.empty((3, 3))
    for c in range(clusters):
        weight, k = sums.weight[c], 0
        for i in range(3):
            for j in range(i, 3):
                product = sums.first[c, i] * sums.first[c, j] / weight**2
                scatter[i, j] = scatter[j, i] = sums.second[c, k] / weight - product
                k += 1
        trace = scatter[0, 0] + scatter[1, 1] + scatter[2, 2]
        dispersions[c] = np.sqrt(max(trace, 0.0)) * side
        for i in range(3):
            centres[c, i] = sums.anchor[c, i] + sums.first[c, i] / weight
            positions[c, i] = (centres[c, i] - AXIS_ORIGIN + 0.5) * side
            for j in range(3):
                own = 1.0 / 12.0 if i == j else 0.0
                covariances[c, i, j] = (scatter[i, j] + own) * side * side
        axis = _longest_axis(scatter)
        for i in range(3):
            axes[c, i] = axis[i]
    for i in range(len(selected)):
        at, key = np.uintp(labels[i]), keys[np.uintp(selected[i])]
        along = (
            (float(key >> (2 * AXIS_BITS)) - centres[at, 0]) * axes[at, 0]
            + (float((key >> AXIS_BITS) & AXIS_MASK) - centres[at, 1]) * axes[at, 1]
            + (float(key & AXIS_MASK) - centres[at, 2]) * axes[at, 2]
        )
        least[at], most[at] = min(least[at], along), max(most[at], along)
    for c in range(clusters):
        for i in range(3):
            extents[c, 0, i] = positions[c, i] + least[c] * axes[c, i] * side
            extents[c, 1, i] = positions[c, i] + most[c] * axes[c, i] * side
    return Outlines(positions, dispersions, covariances, extents)
