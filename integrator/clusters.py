"""Clusters of voxels, and each as a contact.

Single linkage: two voxels belong together when dx² + dy² + dz² ≤ reach² (method §3), in units of
the voxel's side. Sorted voxels of one (x, y) row fall into segments without gaps; two segments of
neighbouring rows are linked exactly when they overlap after one is widened by the reach that the
row offset leaves along z. Segments are joined by union-find. A key is a number in which x counts
more than y and y more than z, so a segment is an interval of keys, and a row offset shifts it.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE, Contact, Contacts
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import kernels, moments
from contactfusion.integrator.entries import Field
from contactfusion.integrator.store import AXIS_BITS, AXIS_MASK, BEYOND, ONE, Int64Array
from contactfusion.jit import kernel
from contactfusion.time import to_seconds

Int32Array = NDArray[np.int32]
UintArray = NDArray[np.uintp]

WIDEST = float(1 << 22)
"""More sides of a voxel than the space has."""
SHORT = 3
"""Up to this reach each row offset is followed on its own; they grow with the reach squared."""
WIDE = 32
"""From this reach on it is asked whether all voxels lie within it [voxels]."""
LIKELIHOOD_STEP = 6
"""Contacts are ordered by their likelihood rounded to this many decimals, then by first voxel."""


@kernel
def _find(parent: UintArray, at: np.uintp) -> np.uintp:
    while parent[at] != at:
        parent[at] = parent[parent[at]]
        at = parent[at]
    return at


@kernel
def _join(parent: UintArray, first: np.uintp, second: np.uintp) -> None:
    first, second = _find(parent, first), _find(parent, second)
    if first < second:
        parent[second] = first
    else:
        parent[first] = second


@kernel
def _root(square: int) -> int:
    """The largest integer whose square is at most `square`."""
    root = int(np.sqrt(float(square)))
    while root * root > square:
        root -= 1
    while (root + 1) * (root + 1) <= square:
        root += 1
    return root


@kernel
def _count(keys: Int64Array, reach: int) -> int:
    segments = 1
    for i in range(1, len(keys)):
        segments += keys[i] != keys[i - 1] + 1 or reach == 0
    return segments


@kernel
def _cut(
    keys: Int64Array,
    reach: int,
    begin: UintArray,
    low: Int64Array,
    high: Int64Array,
    parent: UintArray,
) -> None:
    """Cut voxels into s segments; write where each begins, its first and last key, and its parent.

    All have shape (s + 1,): behind the last segment stands one beyond all others. Segments of one
    row whose gap is within the reach are joined at once.
    """
    at, last = np.uintp(0), keys[0]
    begin[0], low[0], parent[0] = 0, last, 0
    for i in range(1, len(keys)):
        key = keys[i]
        if key != last + 1 or reach == 0:
            high[at] = last
            at += ONE
            begin[at], low[at], parent[at] = i, key, at
            if key - last <= reach and key >> AXIS_BITS == last >> AXIS_BITS:
                parent[at] = parent[at - ONE]
        last = key
    high[at] = last
    at += ONE
    begin[at], low[at], high[at], parent[at] = len(keys), BEYOND, BEYOND, at


@kernel
def _link_by_offset(
    low: Int64Array, high: Int64Array, parent: UintArray, least: Int64Array, most: Int64Array
) -> None:
    """Join segments that lie within the reach; each row offset keeps its place among them.

    Args:
        low: shape (s + 1,), the first key of each segment.
        high: shape (s + 1,), the last.
        parent: shape (s + 1,), is changed.
        least: shape (o,), for each row offset the least difference of keys that links.
        most: shape (o,), the largest.
    """
    place = np.zeros(len(least), np.uintp)
    for number in range(len(low) - 1):
        segment = np.uintp(number)
        root = parent[segment]
        for offset in range(len(least)):
            other, nearest = place[offset], low[segment] - most[offset]
            while high[other] < nearest:
                other += ONE
            place[offset] = other
            farthest = high[segment] - least[offset]
            while low[other] <= farthest:
                if parent[other] != root:
                    _join(parent, segment, other)
                    root = parent[segment] = parent[other] = _find(parent, segment)
                other += ONE


@kernel
def _link_by_row(low: Int64Array, high: Int64Array, parent: UintArray, reach_squared: int) -> None:
    """Join segments that lie within a long reach: only rows that exist are looked at.

    Arguments as `_link_by_offset`.
    """
    segments, reach = len(low) - 1, _root(reach_squared)
    row_key, row_begin = np.empty(segments, np.int64), np.empty(segments + 1, np.uintp)
    rows = 0
    for s in range(segments):
        if rows == 0 or low[s] >> AXIS_BITS != row_key[rows - 1]:
            row_key[rows], row_begin[rows] = low[s] >> AXIS_BITS, s
            rows += 1
    row_begin[rows] = segments
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
                shift = (row_key[row] - row_key[other]) << AXIS_BITS
                a, a_end = np.uintp(row_begin[row]), np.uintp(row_begin[row + ONE])
                b, b_end = np.uintp(row_begin[other]), np.uintp(row_begin[other + ONE])
                while a < a_end and b < b_end:
                    ahead = low[b] + shift - high[a] > apart
                    behind = low[a] - high[b] - shift > apart
                    if not (ahead | behind) and parent[a] != parent[b]:
                        _join(parent, a, b)
                    sooner = high[a] < high[b] + shift
                    a += np.uintp(sooner)
                    b += np.uintp(not sooner)
                other += ONE


@kernel
def _is_clear(low: Int64Array) -> bool:
    """Whether no segment is so near the least y or z that it could meet the row before."""
    clear = True
    for key in low[:-1]:
        clear &= (key & AXIS_MASK >= SHORT) & ((key >> AXIS_BITS) & AXIS_MASK >= SHORT)
    return clear


@kernel
def _offsets(reach_squared: int) -> tuple[Int64Array, Int64Array]:
    """The differences of keys that each earlier row within the reach allows, from and to."""
    reach = _root(reach_squared)
    room = (reach + 1) * (2 * reach + 1)
    least, most = np.empty(room, np.int64), np.empty(room, np.int64)
    count = 0
    for dx in range(reach + 1):
        span = _root(reach_squared - dx * dx)
        for dy in range(-span if dx > 0 else 1, span + 1):
            apart = _root(reach_squared - dx * dx - dy * dy)
            shift = (dx << (2 * AXIS_BITS)) + (dy << AXIS_BITS)
            least[count], most[count] = shift - apart, shift + apart
            count += 1
    return least[:count], most[:count]


@kernel
def _link(low: Int64Array, high: Int64Array, parent: UintArray, reach_squared: int) -> None:
    """Join all segments that lie within the reach."""
    if _root(reach_squared) <= SHORT and _is_clear(low):
        least, most = _offsets(reach_squared)
        _link_by_offset(low, high, parent, least, most)
    else:
        _link_by_row(low, high, parent, reach_squared)


@kernel
def _number(begin: UintArray, parent: UintArray, labels: Int32Array) -> int:
    """Write the label of each voxel; give the number of clusters."""
    clusters = 0
    number = np.empty(len(parent) - 1, np.int32)
    for s in range(np.uintp(len(parent) - 1)):
        root = _find(parent, np.uintp(s))
        if root == s:
            number[s] = clusters
            clusters += 1
        for i in range(begin[s], begin[s + ONE]):
            labels[i] = number[root]
    return clusters


def _diagonal_squared(keys: Int64Array) -> int:
    """The squared diagonal of the box around voxels [voxels²]."""
    axes = (keys >> 2 * AXIS_BITS, keys >> AXIS_BITS & AXIS_MASK, keys & AXIS_MASK)
    return sum(int(axis.max() - axis.min()) ** 2 for axis in axes)


def label(keys: Int64Array, reach_squared: int) -> tuple[Int32Array, int]:
    """Label voxels by cluster.

    Args:
        keys: shape (n,), ascending and distinct.
        reach_squared: the largest squared offset that links two voxels [voxels²].

    Returns:
        Labels of shape (n,), numbered in the order of the clusters' first rows, and their number.
    """
    labels = np.empty(len(keys), np.int32)
    if len(keys) == 0:
        return labels, 0
    reach = _root(reach_squared)
    if reach > WIDE and _diagonal_squared(keys) <= reach_squared:
        labels[:] = 0
        return labels, 1
    rows = _count(keys, reach) + 1  # arrays by numpy, which asks for huge pages
    begin, parent = np.empty(rows, np.uintp), np.empty(rows, np.uintp)
    low, high = np.empty(rows, np.int64), np.empty(rows, np.int64)
    _cut(keys, reach, begin, low, high, parent)
    _link(low, high, parent, reach_squared)
    return labels, _number(begin, parent, labels)


def reach_squared(tolerance: float, voxel_size: float) -> int:
    """The largest squared offset that links two voxels, in voxels², rounded once (method §3).

    Args:
        tolerance: the greatest distance of linked voxels [m].
        voxel_size: the side of a voxel [m].
    """
    return int(np.floor(min(tolerance / voxel_size, WIDEST) ** 2 + 1e-6))


class ContactTable:
    """The clusters of a field as contacts, the most likely first.

    Args:
        field: the fused likelihoods.
        selected: shape (n,), the rows of the voxels that belong to a cluster.
        labels: shape (n,), the cluster of each, numbered by first row.
        count: the number of clusters.
    """

    def __init__(
        self, field: Field, selected: NDArray[np.int32], labels: NDArray[np.int32], count: int
    ) -> None:
        entries = field.entries
        self._field, self._selected, self._labels = field, selected, labels
        self.sums = moments.add_up(
            selected,
            labels,
            count,
            entries.keys,
            field.likelihoods,
            entries.places,
            entries.begin,
            entries.counted,
            entries.columns.likelihoods,
            entries.columns.spreads,
            entries.columns.stamps,
        )

    def contacts(self, wanted: NDArray[np.bool_] | None = None) -> Contacts:
        """The contacts by falling likelihood, then by first voxel.

        Args:
            wanted: shape (count,), which clusters are contacts; None: all.
        """
        largest, cluster_of = self.sums.largest, self.sums.cluster_of
        kept = np.arange(len(largest)) if wanted is None else np.flatnonzero(wanted)
        order = kept[np.argsort(-largest[kept].round(LIKELIHOOD_STEP), kind="stable")]
        return Contacts(tuple(self._made(order)), partial(_owners, cluster_of, order, len(largest)))

    def _made(self, order: NDArray[np.intp]) -> Iterator[Contact]:
        """The contacts of some clusters, in their order."""
        sums, entries = self.sums, self._field.entries
        if not len(order):
            return
        grid = entries.grid
        found = moments.outline(self._selected, self._labels, entries.keys, sums, grid.voxel_size)
        forces = self._forces()
        for array in (found.positions, found.scatters, found.covariances, found.extents, forces):
            array.flags.writeable = False
        shares = (sums.shares / sums.shares.sum(axis=1, keepdims=True))[:, entries.counted].tolist()
        shared = [source.name for source in entries.sources if source.kind != HypothesisKind.NULL]
        likelihoods = sums.largest.tolist()
        voxels, stamps = sums.voxels.tolist(), sums.stamp.tolist()
        for c in order.tolist():
            yield Contact(
                position=found.positions[c],
                likelihood=likelihoods[c],
                scatter=found.scatters[c],
                covariance=found.covariances[c],
                extent=found.extents[c],
                force=forces[c],
                voxels=voxels[c],
                shares=dict(zip(shared, shares[c], strict=True)),
                stamp=to_seconds(stamps[c]),
                frame=grid.frame,
            )

    def _forces(self) -> FloatArray:
        """The mean force of each cluster, shape (c, 3) [N], NaN where there is none."""
        entries, cluster_of = self._field.entries, self.sums.cluster_of
        clusters = len(self.sums.voxels)
        felt = (entries.bits & kernels.FORCE).astype(np.bool_) & (cluster_of < clusters)
        voxels = np.flatnonzero(felt)
        weights, forces = self._field.likelihoods[voxels], entries.forces_in(voxels)
        return moments.mean_forces(cluster_of[voxels], clusters, weights, forces)


def _owners(cluster_of: Int32Array, order: NDArray[np.intp], clusters: int) -> NDArray[np.intp]:
    """The contact of each voxel, shape (m,): its place in `order`, or `NONE`.

    Args:
        cluster_of: shape (m,), the cluster of each voxel, or the number of clusters.
        order: the clusters that are contacts, in the order of these.
        clusters: how many there are.
    """
    contact_of = np.full(clusters + 1, NONE, np.intp)
    contact_of[order] = np.arange(len(order))
    return contact_of[cluster_of]
