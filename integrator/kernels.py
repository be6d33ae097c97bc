"""Kernels of fusion: line up the sources voxel by voxel, and combine their likelihoods.

`rows[v, s]` is the entry of source s in voxel v, or -1. Likelihoods are the stored float32 taken as
float64; null entries never take part (method §2).
"""

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.integrator.jit import kernel
from contactfusion.integrator.store import BEYOND, Int64Array

REGULAR, SUPPORT, NULL, FORCE = 1, 2, 4, 8
"""Bits of the kinds of hypothesis that are alive in a voxel, and of regular ones with a force."""

CLIP = 1e-6
"""Likelihoods of 0 and 1 have no finite log odds: they are clipped by this much."""

SUPPORT_ONLY, BELOW_THRESHOLD, CONTACT, NULLED = 0, 1, 2, 3
"""Codes of the verdicts on a voxel."""

EDGE = 1.000001e-6
"""A likelihood 1e-6 under the threshold still reaches it: 1 - (1 - 0.1) is less than 0.1."""

Rows = NDArray[np.int32]
Bits = NDArray[np.uint8]


@kernel
def align(
    keys: Int64Array, begin: Int64Array, kinds: Bits, voxel_keys: Int64Array, rows: Rows, bits: Bits
) -> int:
    """Find every voxel that has an entry, in ascending order, and each source's entry there.

    Args:
        keys: shape (n,), the entries' voxels, ascending within each source.
        begin: shape (k + 1,), where the entries of each source begin.
        kinds: shape (k,), the bit of each source's kind.
        voxel_keys: shape (n,), is overwritten.
        rows: shape (n, k), is overwritten.
        bits: shape (n,), is overwritten: the kinds that are alive in the voxel.

    Returns:
        The number of voxels m; the first m rows of the outputs hold them.
    """
    sources = len(kinds)
    rows.fill(-1)
    head, front = begin[:-1].copy(), np.empty(sources, np.int64)
    for source in range(sources):
        begins = head[source] < begin[source + 1]
        front[source] = keys[head[source]] if begins else BEYOND
    count = 0
    while True:
        first, key, second = 0, BEYOND, BEYOND
        for source in range(sources):
            if front[source] < key:
                first, key, second = source, front[source], key
            else:
                second = min(second, front[source])
        if key == BEYOND:
            return count
        if key < second:  # one source alone, up to the next voxel of any other
            at, end = head[first], begin[first + 1]
            while key < second:
                voxel_keys[count], bits[count], rows[count, first] = key, kinds[first], at
                count += 1
                at += 1
                key = keys[at] if at < end else BEYOND
            head[first], front[first] = at, key
        else:
            voxel_keys[count], bits[count] = key, 0
            for source in range(sources):
                if front[source] == key:
                    at = head[source]
                    rows[count, source] = at
                    bits[count] |= kinds[source]
                    at += 1
                    head[source] = at
                    front[source] = keys[at] if at < begin[source + 1] else BEYOND
            count += 1


@kernel
def newest_stamps(rows: Rows, stamps: Int64Array) -> Int64Array:
    """Give the newest stamp of each voxel, shape (m,) [ns]."""
    newest = np.empty(len(rows), np.int64)
    for voxel in range(len(rows)):
        stamp = np.int64(np.iinfo(np.int64).min)
        for source in range(rows.shape[1]):
            row = rows[voxel, source]
            if row >= 0:
                stamp = max(stamp, stamps[row])
        newest[voxel] = stamp
    return newest


@kernel
def judge(likelihoods: FloatArray, bits: Bits, threshold: float) -> NDArray[np.uint8]:
    """Judge each voxel: null first, then missing evidence, then the threshold (method §2)."""
    verdicts = np.empty(len(bits), np.uint8)
    most = 1.0 - threshold + EDGE
    for voxel in range(len(bits)):  # free of branches, so that it runs on vectors
        reaches = (1.0 - likelihoods[voxel] <= most) & (likelihoods[voxel] > 0.0)
        verdict = np.uint8(CONTACT if reaches else BELOW_THRESHOLD)
        verdict = verdict if bits[voxel] & REGULAR else np.uint8(SUPPORT_ONLY)
        verdicts[voxel] = np.uint8(NULLED) if bits[voxel] & NULL else verdict
    return verdicts


@kernel
def voxel_forces(
    voxels: Int64Array,
    rows: Rows,
    likelihoods: NDArray[np.float32],
    starts: Int64Array,
    regular: NDArray[np.bool_],
    forces: FloatArray,
) -> FloatArray:
    """Give the force in some voxels: the mean over regular sources, weighted by likelihood.

    Args:
        voxels: shape (n,), rows of `rows`.
        rows: shape (m, k).
        likelihoods: of the entries.
        starts: shape (k + 1, 2), each source's first entry, and its first row in `forces` or -1.
        regular: shape (k,), which sources are evidence.
        forces: shape (f, 4), Σpf [N] and Σp.

    Returns:
        Shape (n, 3) [N], NaN where no source felt a force.
    """
    mean = np.full((len(voxels), 3), np.nan)
    felt = np.flatnonzero(regular & (starts[:-1, 1] >= 0))
    for i in range(len(voxels)):
        x, y, z, total = 0.0, 0.0, 0.0, 0.0
        for source in felt:
            row = rows[voxels[i], source]
            if row < 0:
                continue
            at = starts[source, 1] + row - starts[source, 0]
            if forces[at, 3] > 0.0:
                weight = np.float64(likelihoods[row])
                x += weight * forces[at, 0] / forces[at, 3]
                y += weight * forces[at, 1] / forces[at, 3]
                z += weight * forces[at, 2] / forces[at, 3]
                total += weight
        if total > 0.0:
            mean[i, 0], mean[i, 1], mean[i, 2] = x / total, y / total, z / total
    return mean


@kernel
def de_morgan(
    rows: Rows, likelihoods: NDArray[np.float32], counts: NDArray[np.bool_]
) -> FloatArray:
    """Fuse by De Morgan's law, H = 1 - Π(1 - p) (F Eq 1), sources in ascending order of name.

    Args:
        rows: shape (m, k).
        likelihoods: shape (n,), of the entries.
        counts: shape (k,), which sources take part: all but null.

    Returns:
        Shape (m,).
    """
    fused = np.empty(len(rows))
    for voxel in range(len(rows)):
        miss = 1.0
        for source in range(rows.shape[1]):
            row = rows[voxel, source]
            if row >= 0 and counts[source]:
                miss *= 1.0 - np.float64(likelihoods[row])
        fused[voxel] = 1.0 - miss
    return fused


@kernel
def largest(rows: Rows, likelihoods: NDArray[np.float32], counts: NDArray[np.bool_]) -> FloatArray:
    """Fuse by the largest likelihood; arguments and result as `de_morgan`."""
    fused = np.zeros(len(rows))
    for voxel in range(len(rows)):
        for source in range(rows.shape[1]):
            row = rows[voxel, source]
            if row >= 0 and counts[source]:
                fused[voxel] = max(fused[voxel], np.float64(likelihoods[row]))
    return fused


@kernel
def log_odds(
    rows: Rows, likelihoods: NDArray[np.float32], counts: NDArray[np.bool_], prior: float
) -> FloatArray:
    """Fuse by adding log odds, H = σ(l0 + Σ(logit p - l0)), l0 = logit of the prior.

    Arguments and result as `de_morgan`; `prior` is the probability of a contact without evidence.
    """
    fused = np.zeros(len(rows))
    base = np.log(prior / (1.0 - prior))
    for voxel in range(len(rows)):
        odds = base
        known = False
        for source in range(rows.shape[1]):
            row = rows[voxel, source]
            if row >= 0 and counts[source]:
                p = min(max(np.float64(likelihoods[row]), CLIP), 1.0 - CLIP)
                odds += np.log(p / (1.0 - p)) - base
                known = True
        if known:
            fused[voxel] = 1.0 / (1.0 + np.exp(-odds))
    return fused


@kernel
def dempster_shafer(
    rows: Rows, likelihoods: NDArray[np.float32], counts: NDArray[np.bool_], prior: float
) -> tuple[FloatArray, FloatArray]:
    """Fuse by Dempster's rule over contact, no contact and unknown.

    A likelihood above the prior p0 gives the mass (p - p0) / (1 - p0) to contact, one below gives
    (p0 - p) / p0 to no contact, the rest to unknown. Sources that agree combine like De Morgan;
    the product of the two sides is their conflict, which Dempster's rule divides out.

    Returns:
        H = m(contact) + p0 · m(unknown) and the conflict, both of shape (m,). When all is
        conflict, nothing is known and H is the prior.
    """
    fused = np.zeros(len(rows))
    conflict = np.zeros(len(rows))
    for voxel in range(len(rows)):
        not_for, not_against = 1.0, 1.0
        known = False
        for source in range(rows.shape[1]):
            row = rows[voxel, source]
            if row >= 0 and counts[source]:
                p = np.float64(likelihoods[row])
                known = True
                if p >= prior:
                    not_for *= 1.0 - (p - prior) / (1.0 - prior)
                else:
                    not_against *= 1.0 - (prior - p) / prior
        if known:
            clash = (1.0 - not_for) * (1.0 - not_against)
            conflict[voxel] = clash
            if clash < 1.0:
                contact = (1.0 - not_for) * not_against / (1.0 - clash)
                fused[voxel] = contact + prior * not_for * not_against / (1.0 - clash)
            else:
                fused[voxel] = prior
    return fused, conflict
