"""Detections: what sources say about contacts, as groups of hypotheses that hang together."""

import itertools
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.cells import Dealt, cell_list, grouped, nearest, sparse_cells
from contactfusion.integrator.entries import Entries
from contactfusion.integrator.nearby import Barrier, around, linked, nearest_left, reached, spacings
from contactfusion.integrator.store import Int64Array

CERTAIN = 0.99
"""No detection counts as more probable."""
LINK = 3.6
"""Hypotheses belong to one detection when they are no further apart than so many standard
deviations: neighbours are that are √12 apart, as unsure as a position anywhere between them."""
CELL = 4.0
"""The side of the cells of hypotheses, in standard deviations of a position."""
ALIKE = 0.999
"""A single contact's hypotheses state one force when their mean has that part of their strength."""
SAMPLES = 256
"""Of at most so many hypotheses, of more at least of half as many, the spacing is measured."""
SPACING, REGULAR = 0.9, 1.2
"""The spacing of a source's hypotheses: that part of them have a neighbour that is no further. It
samples regularly, as a skin, where as many have none that is nearer than the spacing over this."""
SAMPLED, UNSURE = 1.9, 1.5 / (0.5 * LINK)
"""A detection of such a source goes on over steps of so many spacings, or sides of voxels: beside
and across a corner of a grid, but over no hypothesis that is missing; or of one and a half standard
deviations, in reaches; or to the next row, which may be further away than the next in a row."""
ROW = 1.2
"""A step to the next row is at most so many of their spacings."""
VALLEY = 1.0 / 3.0
"""What is less likely than this part of the peak of its group parts such a detection."""
WITHIN = 0.75 / (0.5 * LINK)
"""What is less likely counts as likely up to three quarters of a standard deviation beside what is,
in reaches: it may be there."""
PEAK = 0.5
"""A detection of any other source that is less likely than this part of its peak between two peaks
is two."""


class Cloud(NamedTuple):
    """The live hypotheses of one source.

    Attributes:
        kind: evidence, support or null.
        single: whether it describes one contact somewhere.
        positions: shape (n, 3) [m].
        likelihoods: shape (n,).
        variances: shape (n,) [m²], of the positions by axis, as the source states them.
        force: shape (3,) [N], what the robot feels, of one that describes one contact; or None.
        measured: shape (h, 3) [m], the newest positions, before those of a voxel become one.
    """

    kind: HypothesisKind
    single: bool
    positions: FloatArray
    likelihoods: FloatArray
    variances: FloatArray
    force: FloatArray | None
    measured: FloatArray

    def picked(self, rows: NDArray[np.intp]) -> "Cloud":
        """Some of the hypotheses."""
        columns = (self.positions, self.likelihoods, self.variances)
        positions, likelihoods, variances = (column.take(rows, axis=0) for column in columns)
        return self._replace(positions=positions, likelihoods=likelihoods, variances=variances)


def clouds_of(entries: Entries) -> list[Cloud]:
    """The live hypotheses of each source, at their measured positions."""
    positions, columns = entries.positions, entries.columns
    clouds = []
    for source, ((begin, felt), (end, _)) in zip(
        entries.sources, itertools.pairwise(entries.starts.tolist()), strict=True
    ):
        single = bool(end > begin and columns.single[begin])
        given = columns.offsets[begin:end, 3] if single else columns.likelihoods[begin:end]
        variances = np.square(columns.spreads[begin:end].astype(np.float64))
        likelihoods = given.astype(np.float64)
        own, force = positions[begin:end], None
        if single and felt >= 0 and source.kind == HypothesisKind.REGULAR:
            forces = columns.forces[felt : felt + end - begin, :3]
            mean, sizes = forces.sum(axis=0), np.linalg.norm(forces, axis=1).sum()
            # where the force depends on the position, as by joint torques, it is of no use here
            force = mean if np.linalg.norm(mean) > ALIKE * sizes else None
        clouds.append(
            Cloud(source.kind, single, own, likelihoods, variances, force, source.positions)
        )
    return clouds


class Evidence:
    """What a source of evidence says, and which of it no contact explains yet.

    Args:
        cloud: its hypotheses.
        shared: shape (n,), the part of each that is of others in its voxel.
        side: of a voxel [m].
    """

    def __init__(self, cloud: Cloud, shared: FloatArray, side: float) -> None:
        self.cloud = cloud
        self.variance = max(float(np.median(cloud.variances)), side**2 / 12.0)
        """Of the positions, by axis [m²]: at least that of a position anywhere in a voxel."""
        own = 0.5 * LINK * float(np.sqrt(self.variance))
        self.reaches = own + side * np.minimum(shared, 0.5)
        """Hypotheses that are no further apart than the sum of theirs hang together, shape (n,)
        [m]; those of a voxel are one, and were up to half of its side away from it."""
        self.labels = np.zeros(len(shared), np.int32)
        """The detection of each hypothesis, shape (n,); those of a single contact are one."""
        self._groups = np.zeros(1, np.int32)
        """The group of each detection, shape (d,): between those of one it is much less likely."""
        if not cloud.single:
            self.labels, self._groups = detections(cloud, self.reaches, side)
        self._is_split = len(np.unique(self._groups)) < len(self._groups)
        self.peaks = np.zeros(int(self.labels.max()) + 1)
        """The probability of a contact by each detection, shape (d,)."""
        combine = np.add if cloud.single else np.maximum
        combine.at(self.peaks, self.labels, cloud.likelihoods)
        np.minimum(self.peaks, CERTAIN, out=self.peaks)
        self.left = np.ones(len(self.peaks), np.bool_)
        """Which detections are left, shape (d,)."""

    def around(self, points: FloatArray, reach: float) -> NDArray[np.intp]:
        """The hypotheses left in a box as large as some points (m, 3) [m] and a reach [m]."""
        return around(self.cloud.positions, self._cells, self.labels, self.left, points, reach)

    def near(self, points: FloatArray, reach: float) -> NDArray[np.bool_]:
        """The detections left within reach [m] of points (m, 3) [m], at least the nearest."""
        left = (self.cloud.positions, self._cells, self.labels, self.left)
        wanted = reached(*left, points, reach)
        if not wanted.any():
            wanted[self.labels[nearest_left(*left, points.mean(axis=0))]] = True
        return wanted

    def first_of_groups(self, found: NDArray[np.bool_], place: FloatArray) -> NDArray[np.bool_]:
        """Of each group among some detections the one that is nearest to a place, shape (d,).

        Args:
            found: shape (d,), which detections.
            place: shape (3,) [m].
        """
        labels = np.flatnonzero(found)
        if not self._is_split or len(np.unique(self._groups[labels])) == len(labels):
            return found
        rows, away = self.rows_of(found), np.full(len(found), np.inf)
        squared = np.square(self.cloud.positions[rows] - place).sum(axis=1)
        np.minimum.at(away, self.labels[rows], squared)
        labels = labels[np.argsort(away[labels], kind="stable")]
        first = np.zeros(len(found), np.bool_)
        first[labels[np.unique(self._groups[labels], return_index=True)[1]]] = True
        return first

    def rivals(self, taken: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The detections left that are told apart from some, both of shape (d,)."""
        if not self._is_split:
            return np.zeros(len(taken), np.bool_)
        return self.left & ~taken & np.isin(self._groups, self._groups[taken])

    def nearest(self, place: FloatArray) -> FloatArray:
        """The position left that is nearest to a place, both of shape (3,) [m]."""
        left = (self.cloud.positions, self._cells, self.labels, self.left)
        position: FloatArray = self.cloud.positions[nearest_left(*left, place)]
        return position

    @property
    def cloud_left(self) -> Cloud:
        """The hypotheses left."""
        return self.cloud.picked(self.rows_of(self.left))

    def rows_of(self, taken: NDArray[np.bool_]) -> NDArray[np.intp]:
        """The hypotheses of some detections, ascending; `taken` has shape (d,)."""
        rows, begins = self._by_detection
        found = [rows[begins[label] : begins[label + 1]] for label in np.flatnonzero(taken)]
        return found[0] if len(found) == 1 else np.sort(np.concatenate(found))

    @cached_property
    def _by_detection(self) -> tuple[Int64Array, Int64Array]:
        return grouped(self.labels, len(self.peaks))

    @cached_property
    def _cells(self) -> Dealt:
        return cell_list(self.cloud.positions, CELL * float(np.sqrt(self.variance)))

    def probability(self, of: NDArray[np.bool_]) -> float:
        """The probability of a contact by some of the detections; `of` has shape (d,)."""
        return float(self.peaks[of].max(initial=0.0))


def detections(
    cloud: Cloud, reaches: FloatArray, side: float
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Which hypotheses of several contacts belong together.

    Those that lie no further apart than their spreads tell apart are a group. That of a source
    which samples regularly falls into several detections where nothing is between them, or what is
    much less likely; of another one where that is further than their spreads tell apart.

    Args:
        cloud: the hypotheses.
        reaches: shape (n,), they are no further apart than the sum of theirs [m].
        side: of a voxel [m].

    Returns:
        The detection of each hypothesis, shape (n,), and the group of each detection, shape (d,).
    """
    away, places = 2.0 * float(reaches.max()), cloud.positions
    cells = cell_list(places, away)
    nothing = Barrier(places, cells, np.full(len(places), np.inf))
    groups, count = linked(places, cells, reaches, nothing)
    near, beside = _spacings(places, cells, away)
    spacing, is_regular = _regular(near)
    if not is_regular and spacing <= REGULAR * side:  # voxels mix what is so dense
        dealt = cell_list(cloud.measured, side)
        is_regular = _regular(_spacings(cloud.measured, dealt, 2.0 * side)[0])[1]
    peak = np.zeros(count)
    np.maximum.at(peak, groups, cloud.likelihoods)
    high = cloud.likelihoods >= (VALLEY if is_regular else PEAK) * peak[groups]
    steps, valleys, lump = reaches, nothing, away
    if is_regular:
        step = max(SAMPLED * max(spacing, side), UNSURE * float(np.median(reaches)))
        if (row := float(np.median(beside))) < away:
            step = max(step, ROW * row)
        steps, lump = np.minimum(reaches, 0.5 * step), max(spacing, side)
        high, valleys = _valleys(places, high, WITHIN * reaches, lump)
    elif high.all():
        return groups, np.arange(count, dtype=np.int32)
    labels, tops = np.empty(len(high), np.int32), places[high]
    labels[high], peaks = linked(tops, cell_list(tops, away), steps[high], valleys)
    lowest, highest = np.full(count, peaks, np.int32), np.full(count, NONE, np.int32)
    np.minimum.at(lowest, groups[high], labels[high])
    np.maximum.at(highest, groups[high], labels[high])
    labels[~high] = lowest[groups[~high]]
    several = (lowest != highest)[groups]
    between, within = np.flatnonzero(several & ~high), np.flatnonzero(several & high)
    if len(between):  # the rest belongs to the nearest peak, near neighbours together
        tops = cloud.positions[within]
        dealt = cell_list(cloud.positions[between], lump)
        counts = np.diff(dealt.begins)
        begins, counts = dealt.begins[:-1][counts > 0], counts[counts > 0]
        rows = between[dealt.rows]
        middles = np.add.reduceat(cloud.positions[rows], begins, axis=0) / counts[:, None]
        own = within[nearest(middles, tops, sparse_cells(tops, away))]
        labels[rows] = np.repeat(labels[own], counts)
    if not is_regular:
        return labels, np.arange(peaks, dtype=np.int32)
    owners = np.empty(peaks, np.int32)
    owners[labels[high]] = groups[high]
    return labels, owners


def _spacings(places: FloatArray, cells: Dealt, most: float) -> FloatArray:
    """`spacings` of a sample of places, shape (2, at most `SAMPLES`)."""
    sample = np.arange(0, len(places), 1 + len(places) // SAMPLES)
    return spacings(places, cells, sample, most).T


def _regular(near: FloatArray) -> tuple[float, bool]:
    """The spacing [m], and whether it is regular, by distances to the nearest, shape (n,) [m]."""
    least, spacing = np.quantile(near, (1.0 - SPACING, SPACING)).tolist()
    return spacing, spacing <= REGULAR * least


def _valleys(
    places: FloatArray, high: NDArray[np.bool_], within: FloatArray, side: float
) -> tuple[NDArray[np.bool_], Barrier]:
    """What parts peaks.

    Args:
        places: shape (n, 3) [m].
        high: shape (n,), which are likely.
        within: shape (n,), how far from what is likely others are, too [m].
        side: of the cells by which they are searched [m].

    Returns:
        Which are likely, shape (n,), and the others.
    """
    tops = places[high]
    offsets = places - tops[nearest(places, tops, sparse_cells(tops, side))]
    high = np.linalg.norm(offsets, axis=1) <= np.where(high, np.inf, within)
    if high.all():
        return high, Barrier(places, cell_list(places, side), np.full(len(places), np.inf))
    tops, lows = places[high], places[~high]
    cells = sparse_cells(lows, side)
    clear = np.linalg.norm(tops - lows[nearest(tops, lows, cells)], axis=1)
    return high, Barrier(lows, cells, clear)
