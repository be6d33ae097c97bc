"""Kernels of fusion: line up the sources voxel by voxel, and combine their likelihoods.

Entries stand grouped by source; `places[i]` is the voxel of entry i. Going through them one source
after the other combines the sources of each voxel in the order of their names. Likelihoods are the
stored float32 taken as float64; null entries never take part (method §2).
"""

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.integrator.store import BEYOND, Int64Array
from contactfusion.jit import kernel

REGULAR, SUPPORT, NULL, FORCE = 1, 2, 4, 8
"""Bits of the kinds of hypothesis that are alive in a voxel, and of regular ones with a force."""

SUPPORT_ONLY, BELOW_THRESHOLD, CONTACT, NULLED = 0, 1, 2, 3
"""Codes of the verdicts on a voxel."""

EDGE = 1.000001e-6
"""A likelihood 1e-6 under the threshold still reaches it: 1 - (1 - 0.1) is less than 0.1."""

Places = NDArray[np.int32]
Likelihoods = NDArray[np.float32]
Bits = NDArray[np.uint8]


@kernel
def align(
    keys: Int64Array,
    begin: Int64Array,
    kinds: Bits,
    voxel_keys: Int64Array,
    places: Places,
    bits: Bits,
) -> int:
    """Find every voxel that has an entry, in ascending order, and the voxel of each entry.

    Args:
        keys: shape (n,), the entries' voxels, ascending within each source.
        begin: shape (k + 1,), where the entries of each source begin.
        kinds: shape (k,), the bit of each source's kind.
        voxel_keys: shape (n,), is overwritten.
        places: shape (n,), is overwritten: the row in `voxel_keys` of each entry.
        bits: shape (n,), is overwritten: the kinds that are alive in the voxel.

    Returns:
        The number of voxels m; the first m rows of `voxel_keys` and `bits` hold them.
    """
    sources = len(kinds)
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
                voxel_keys[count], bits[count], places[at] = key, kinds[first], count
                count += 1
                at += 1
                key = keys[at] if at < end else BEYOND
            head[first], front[first] = at, key
        else:
            voxel_keys[count], bits[count] = key, 0
            for source in range(sources):
                if front[source] == key:
                    at = head[source]
                    places[at] = count
                    bits[count] |= kinds[source]
                    at += 1
                    head[source] = at
                    front[source] = keys[at] if at < begin[source + 1] else BEYOND
            count += 1


@kernel
def newest_stamps(places: Places, voxels: int, stamps: Int64Array) -> Int64Array:
    """The newest stamp of each of so many voxels, shape (m,) [ns]."""
    newest = np.full(voxels, np.iinfo(np.int64).min)
    for entry in range(len(places)):
        voxel = np.uintp(places[entry])
        newest[voxel] = max(newest[voxel], stamps[entry])
    return newest


@kernel
def judge(likelihoods: FloatArray, bits: Bits, threshold: float) -> NDArray[np.uint8]:
    """The verdict on each voxel: null, then missing evidence, then the threshold (method §2)."""
    verdicts = np.empty(len(bits), np.uint8)
    most = 1.0 - threshold + EDGE
    for voxel in range(len(bits)):  # free of branches, so that it runs on vectors
        reaches = (1.0 - likelihoods[voxel] <= most) & (likelihoods[voxel] > 0.0)
        verdict = np.uint8(CONTACT if reaches else BELOW_THRESHOLD)
        verdict = verdict if bits[voxel] & REGULAR else np.uint8(SUPPORT_ONLY)
        verdicts[voxel] = np.uint8(NULLED) if bits[voxel] & NULL else verdict
    return verdicts


@kernel
def choose(wanted: NDArray[np.bool_], keys: Int64Array, rows: Places, row_keys: Int64Array) -> int:
    """Write the rows of the wanted voxels, and their keys; returns their number.

    Args:
        wanted: shape (m,).
        keys: shape (m,).
        rows: shape (m,), is overwritten.
        row_keys: shape (m,), is overwritten.
    """
    count = np.uintp(0)
    for voxel in range(np.uintp(len(keys))):  # written again unless it is wanted: no branch
        rows[count], row_keys[count] = voxel, keys[voxel]
        count += np.uintp(wanted[voxel])
    return int(count)


@kernel
def voxel_forces(
    voxels: Int64Array,
    places: Places,
    likelihoods: Likelihoods,
    starts: Int64Array,
    regular: NDArray[np.bool_],
    forces: FloatArray,
) -> FloatArray:
    """The force in some voxels: the mean over regular sources, weighted by likelihood.

    Args:
        voxels: shape (v,), ascending.
        places: shape (n,), the voxel of each entry.
        likelihoods: of the entries.
        starts: shape (k + 1, 2), each source's first entry, and its first row in `forces` or -1.
        regular: shape (k,), which sources are evidence.
        forces: shape (f, 4), Σpf [N] and Σp.

    Returns:
        Shape (v, 3) [N], NaN where no source felt a force.
    """
    mean, total = np.zeros((len(voxels), 3)), np.zeros(len(voxels))
    for source in range(len(regular)):
        begin, end = starts[source, 0], starts[source + 1, 0]
        if not regular[source] or starts[source, 1] < 0:
            continue
        i = 0
        for entry in range(begin, end):  # both ascend by voxel
            while i < len(voxels) and voxels[i] < places[entry]:
                i += 1
            felt = starts[source, 1] + entry - begin
            if i < len(voxels) and voxels[i] == places[entry] and forces[felt, 3] > 0.0:
                weight = np.float64(likelihoods[entry])
                for axis in range(3):
                    mean[i, axis] += weight * forces[felt, axis] / forces[felt, 3]
                total[i] += weight
    for i in range(len(voxels)):
        for axis in range(3):
            mean[i, axis] = mean[i, axis] / total[i] if total[i] > 0.0 else np.nan
    return mean


@kernel
def de_morgan(
    places: Places,
    voxels: int,
    begin: Int64Array,
    counts: NDArray[np.bool_],
    likelihoods: Likelihoods,
) -> FloatArray:
    """Fuse by De Morgan's law, H = 1 - Π(1 - p) (F Eq 1), sources in ascending order of name.

    Args:
        places: shape (n,), the voxel of each entry.
        voxels: the number of voxels m.
        begin: shape (k + 1,), where the entries of each source begin.
        counts: shape (k,), which sources take part: all but null.
        likelihoods: shape (n,), of the entries.

    Returns:
        Shape (m,).
    """
    fused = np.ones(voxels)
    for source in range(len(counts)):
        if counts[source]:
            for entry in range(begin[source], begin[source + 1]):
                fused[np.uintp(places[entry])] *= 1.0 - np.float64(likelihoods[entry])
    for voxel in range(voxels):
        fused[voxel] = 1.0 - fused[voxel]
    return fused
