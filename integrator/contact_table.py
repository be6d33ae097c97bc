"""Contacts as columns; each becomes an object when somebody looks at it."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import kernels, outlines
from contactfusion.integrator.entries import Field
from contactfusion.time import to_seconds

LIKELIHOOD_STEP = 6
"""Contacts are ordered by their likelihood rounded to this many decimals, then by first voxel."""


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
        self._kept = np.arange(count)
        self.sums = outlines.add_up(
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

    def keep(self, wanted: NDArray[np.bool_]) -> "ContactTable":
        """Leave out the clusters that are not wanted; `wanted` has shape (count,)."""
        self._kept = np.flatnonzero(wanted)
        return self

    def __iter__(self) -> Iterator[Contact]:
        """Give the contacts by falling likelihood, then by first voxel."""
        sums, entries, kept = self.sums, self._field.entries, self._kept
        if not len(kept):
            return
        grid = entries.grid
        found = outlines.outline(self._selected, self._labels, entries.keys, sums, grid.voxel_size)
        forces = self._forces()
        for array in (found.positions, found.covariances, found.extents, forces):
            array.flags.writeable = False
        shares = (sums.shares / sums.shares.sum(axis=1, keepdims=True))[:, entries.counted].tolist()
        shared = [source.name for source in entries.sources if source.kind != HypothesisKind.NULL]
        likelihoods, dispersions = sums.largest.tolist(), found.dispersions.tolist()
        voxels, stamps = sums.voxels.tolist(), sums.stamp.tolist()
        falling = np.argsort(-sums.largest[kept].round(LIKELIHOOD_STEP), kind="stable")
        for c in kept[falling].tolist():
            yield Contact(
                position=found.positions[c],
                likelihood=likelihoods[c],
                dispersion=dispersions[c],
                covariance=found.covariances[c],
                extent=found.extents[c],
                force=forces[c],
                voxels=voxels[c],
                shares=dict(zip(shared, shares[c], strict=True)),
                stamp=to_seconds(stamps[c]),
                frame=grid.frame,
            )

    def _forces(self) -> FloatArray:
        """Give the mean force of each cluster, shape (c, 3) [N], NaN where there is none."""
        entries, cluster_of = self._field.entries, self.sums.cluster_of
        clusters = len(self.sums.voxels)
        felt = (entries.bits & kernels.FORCE).astype(np.bool_) & (cluster_of < clusters)
        voxels = np.flatnonzero(felt)
        weights, forces = self._field.likelihoods[voxels], entries.forces_in(voxels)
        return outlines.mean_forces(cluster_of[voxels], clusters, weights, forces)
