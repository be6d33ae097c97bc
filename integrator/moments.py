"""Kernels of condensation: the moments of each cluster of voxels, its place and its shape."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.integrator.store import AXIS_BITS, AXIS_MASK, AXIS_ORIGIN, ONE, Int64Array
from contactfusion.jit import kernel

Int32Array = NDArray[np.int32]

MOST_ROTATIONS = 60
"""Jacobi's rotations of a 3x3 matrix converge in about ten."""


class Sums(NamedTuple):
    """What each cluster adds up to; w is the weight of a voxel, x its offset from `anchor`.

    Attributes:
        cluster_of: shape (m,), the cluster of each voxel, or c.
        anchor: shape (c, 3), the voxel of each cluster's first row.
        voxels: shape (c,), how many.
        largest: shape (c,), the largest w.
        weight: shape (c,), Σ w.
        first: shape (c, 3), Σ w x in voxels.
        second: shape (c, 6), Σ w of xx, xy, xz, yy, yz, zz.
        spread: shape (c,), Σ w v [m²], v the mean variance of the hypotheses, weighted by p.
        stamp: shape (c,) [ns], the newest entry.
        shares: shape (c, k), Σ p by source.
    """

    cluster_of: Int32Array
    anchor: Int64Array
    voxels: Int64Array
    largest: FloatArray
    weight: FloatArray
    first: FloatArray
    second: FloatArray
    spread: FloatArray
    stamp: Int64Array
    shares: FloatArray


class Outlines(NamedTuple):
    """The places and shapes of clusters.

    Attributes:
        positions: shape (c, 3) [m], the weighted centroids.
        scatters: shape (c, 3, 3) [m²], the weighted second moments about the centroids.
        covariances: shape (c, 3, 3) [m²], of the mixture of the hypotheses: scatter of the voxels,
            on the diagonal plus side²/12 and the mean of the squared spreads.
        extents: shape (c, 2, 3) [m], the two ends along the longest axis.
    """

    positions: FloatArray
    scatters: FloatArray
    covariances: FloatArray
    extents: FloatArray


@kernel
def add_up(
    selected: Int32Array,
    labels: Int32Array,
    clusters: int,
    keys: Int64Array,
    weights: FloatArray,
    places: Int32Array,
    begin: Int64Array,
    shared: NDArray[np.bool_],
    likelihoods: NDArray[np.float32],
    spreads: NDArray[np.float32],
    stamps: Int64Array,
) -> Sums:
    """Add up the voxels of each cluster.

    Args:
        selected: shape (n,), rows of the voxels that are labelled.
        labels: shape (n,).
        clusters: the number of labels.
        keys: shape (m,), of all voxels.
        weights: shape (m,), of all voxels.
        places: shape (n,), the voxel of each entry.
        begin: shape (k + 1,), where the entries of each source begin.
        shared: shape (k,), which sources have a share: all but null.
        likelihoods: of the entries.
        spreads: of the entries [m].
        stamps: of the entries [ns].
    """
    anchor, voxels = np.zeros((clusters, 3), np.int64), np.zeros(clusters, np.int64)
    largest, weight = np.zeros(clusters), np.zeros(clusters)
    first, second = np.zeros((clusters, 3)), np.zeros((clusters, 6))
    end, at = np.uintp(len(selected)), np.uintp(0)
    while at < end:  # one round for each cluster's voxels of one (x, y) row
        label, key = labels[at], keys[np.uintp(selected[at])]
        c, row = np.uintp(label), key >> AXIS_BITS
        ix, iy, iz = row >> AXIS_BITS, row & AXIS_MASK, key & AXIS_MASK
        if voxels[c] == 0:
            anchor[c, 0], anchor[c, 1], anchor[c, 2] = ix, iy, iz
        x, y, from_z = float(ix - anchor[c, 0]), float(iy - anchor[c, 1]), anchor[c, 2]
        begun, most, w_sum, wz_sum, wzz_sum = at, 0.0, 0.0, 0.0, 0.0
        while at < end and labels[at] == label and key >> AXIS_BITS == row:
            w, z = weights[np.uintp(selected[at])], float((key & AXIS_MASK) - from_z)
            most = max(most, w)
            w_sum += w
            wz_sum += w * z
            wzz_sum += w * z * z
            at += ONE
            if at < end:
                key = keys[np.uintp(selected[at])]
        voxels[c] += np.int64(at - begun)
        largest[c] = max(largest[c], most)
        weight[c] += w_sum
        first[c, 0] += w_sum * x
        first[c, 1] += w_sum * y
        first[c, 2] += wz_sum
        second[c, 0] += w_sum * x * x
        second[c, 1] += w_sum * x * y
        second[c, 2] += wz_sum * x
        second[c, 3] += w_sum * y * y
        second[c, 4] += wz_sum * y
        second[c, 5] += wzz_sum
    cluster_of = np.full(len(keys), clusters, np.int32)
    for i in range(len(selected)):
        cluster_of[np.uintp(selected[i])] = labels[i]
    # Voxels of no cluster add to one row too many.
    stamps_of = np.full(clusters + 1, np.iinfo(np.int64).min)
    shares_of = np.zeros((clusters + 1, len(shared)))
    moments = np.zeros((len(keys), 2))  # Σ p and Σ p spread² by voxel
    for source in range(len(shared)):
        if shared[source]:
            for entry in range(begin[source], begin[source + 1]):
                voxel = np.uintp(places[entry])
                c, p = np.uintp(cluster_of[voxel]), np.float64(likelihoods[entry])
                shares_of[c, source] += p
                stamps_of[c] = max(stamps_of[c], stamps[entry])
                moments[voxel, 0] += p
                moments[voxel, 1] += p * np.float64(spreads[entry]) ** 2
    spread = np.zeros(clusters)
    for i in range(len(selected)):
        voxel = np.uintp(selected[i])
        spread[np.uintp(labels[i])] += weights[voxel] * moments[voxel, 1] / moments[voxel, 0]
    stamp, shares = stamps_of[:clusters], shares_of[:clusters]
    return Sums(cluster_of, anchor, voxels, largest, weight, first, second, spread, stamp, shares)


@kernel
def mean_forces(
    labels: Int32Array, clusters: int, weights: FloatArray, forces: FloatArray
) -> FloatArray:
    """Each cluster's mean force, over its voxels that have one.

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
    """The eigenvector of the largest eigenvalue by Jacobi's rotations; overwrites `matrix`.

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
    selected: Int32Array, labels: Int32Array, keys: Int64Array, sums: Sums, side: float
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
    positions, scatters = np.empty((clusters, 3)), np.empty((clusters, 3, 3))
    covariances, extents = np.empty((clusters, 3, 3)), np.empty((clusters, 2, 3))
    scatter = np.empty((3, 3))
    for c in range(clusters):
        weight, k = sums.weight[c], 0
        for i in range(3):
            for j in range(i, 3):
                product = sums.first[c, i] * sums.first[c, j] / weight**2
                scatter[i, j] = scatter[j, i] = sums.second[c, k] / weight - product
                k += 1
        for i in range(3):
            centres[c, i] = sums.anchor[c, i] + sums.first[c, i] / weight
            positions[c, i] = (centres[c, i] - AXIS_ORIGIN + 0.5) * side
            for j in range(3):
                scatters[c, i, j] = scatter[i, j] * side * side
                own = 1.0 / 12.0 if i == j else 0.0
                covariances[c, i, j] = (scatter[i, j] + own) * side * side
            covariances[c, i, i] += sums.spread[c] / weight
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
    return Outlines(positions, scatters, covariances, extents)
