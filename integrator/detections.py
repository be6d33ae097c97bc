"""Detections: what sources say about contacts, as groups of hypotheses that hang together."""

import itertools
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import clusters, fields
from contactfusion.integrator.clusters import Int32Array
from contactfusion.integrator.entries import Entries
from contactfusion.integrator.store import Int64Array

CERTAIN = 0.99
"""No detection counts as more probable."""
LINK = 3.6
"""Hypotheses belong to one detection when they are no further apart than so many standard
deviations: neighbours are that are √12 apart, as unsure as a position anywhere between them."""
PEAK = 0.5
"""A detection that is less likely than this part of its peak between two peaks is two."""


class Cloud(NamedTuple):
    """The live hypotheses of one source.

    Attributes:
        kind: evidence, support or null.
        single: whether it describes one contact somewhere.
        positions: shape (n, 3) [m].
        likelihoods: shape (n,).
        variances: shape (n,) [m²], of the positions by axis, as the source states them.
        force: shape (3,) [N], what the robot feels, of one that describes one contact; or None.
    """

    kind: HypothesisKind
    single: bool
    positions: FloatArray
    likelihoods: FloatArray
    variances: FloatArray
    force: FloatArray | None


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
        force = None
        if single and felt >= 0 and source.kind == HypothesisKind.REGULAR:
            mean = columns.forces[felt : felt + end - begin, :3].sum(axis=0)
            force = mean if mean.any() else None
        clouds.append(
            Cloud(source.kind, single, positions[begin:end], likelihoods, variances, force)
        )
    return clouds


class Evidence:
    """What a source of evidence says, and which of it no contact explains yet.

    Args:
        cloud: its hypotheses.
        keys: shape (n,), their voxels, ascending.
        side: of a voxel [m].
    """

    def __init__(self, cloud: Cloud, keys: Int64Array, side: float) -> None:
        self.cloud = cloud
        self.left = np.ones(len(keys), np.bool_)
        """Which hypotheses are left, shape (n,)."""
        self.variance = max(float(np.median(cloud.variances)), side**2 / 12.0)
        """Of the positions, by axis [m²]: at least that of a position anywhere in a voxel."""
        self._keys, self._side = keys, side

    @property
    def cloud_left(self) -> Cloud:
        """What is left."""
        positions, likelihoods, variances = (
            column[self.left]
            for column in (self.cloud.positions, self.cloud.likelihoods, self.cloud.variances)
        )
        return self.cloud._replace(
            positions=positions, likelihoods=likelihoods, variances=variances
        )

    def probability(self, of: NDArray[np.bool_]) -> float:
        """The probability of a contact by some of the hypotheses; `of` has shape (n,)."""
        likelihoods = self.cloud.likelihoods[of]
        total = likelihoods.sum() if self.cloud.single else likelihoods.max(initial=0.0)
        return min(float(total), CERTAIN)

    def around(self, core: FloatArray, reach: float) -> NDArray[np.bool_]:
        """The hypotheses left that belong to what lies near a contact, shape (n,).

        Those of a single contact belong together; of several contacts all of a detection do.

        Args:
            core: shape (c, 3) [m], where the contact lies.
            reach: greatest distance from it [m]; without any the nearest hypothesis counts.
        """
        if self.cloud.single:
            return self.left.copy()
        rows = np.flatnonzero(self.left)
        positions = self.cloud.positions[rows]
        cells, ones = fields.cell_list(core, reach), np.ones(len(core))
        near = fields.heaviest(positions, core, cells, ones, reach) > 0.0
        if not near.any():
            near[((positions - core.mean(axis=0)) ** 2).sum(axis=1).argmin()] = True
        wanted = np.zeros(int(self._detections.max()) + 1, np.bool_)
        wanted[self._detections[rows[near]]] = True
        return self.left & wanted[self._detections]

    @cached_property
    def _detections(self) -> Int32Array:
        return detections(self.cloud, self._keys, self.variance, self._side)


def detections(cloud: Cloud, keys: Int64Array, variance: float, side: float) -> Int32Array:
    """Which hypotheses of several contacts belong together, as labels of shape (n,).

    Those that lie no further apart than their spreads tell apart do; a group with several peaks
    falls into these where it is much less likely between them.

    Args:
        cloud: the hypotheses.
        keys: shape (n,), their voxels, ascending.
        variance: of the positions, by axis [m²].
        side: of a voxel [m].
    """
    from scipy.spatial import KDTree

    reach = clusters.reach_squared(LINK * np.sqrt(variance), side)
    groups, count = clusters.label(keys, reach)
    highest = np.zeros(count)
    np.maximum.at(highest, groups, cloud.likelihoods)
    high = cloud.likelihoods >= PEAK * highest[groups]
    if high.all():
        return groups
    labels = np.empty(len(keys), np.int32)
    labels[high], _ = clusters.label(keys[high], reach)
    nearest = KDTree(cloud.positions[high]).query(cloud.positions[~high])[1]
    labels[~high] = labels[high][nearest]
    return labels
