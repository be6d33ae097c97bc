"""Contacts as columns; each becomes an object when somebody looks at it."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.grid import VOXEL_LIMIT
from contactfusion.integrator import clusters, kernels
from contactfusion.integrator.entries import Field
from contactfusion.integrator.store import Int64Array
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
        self, field: Field, selected: Int64Array, labels: NDArray[np.int32], count: int
    ) -> None:
        entries = field.entries
        self._field, self._selected, self._labels = field, selected, labels
        self._kept = np.arange(count)
        self.sums = clusters.add_up(
            selected,
            labels,
            count,
            entries.keys,
            field.likelihoods,
            entries.rows,
            entries.columns.likelihoods,
            entries.columns.stamps,
            entries.counted,
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
        side, frame = entries.grid.voxel_size, entries.grid.frame
        centres, scatter, ends = clusters.outline(
            self._selected, self._labels, entries.keys, sums
        )
        positions = (centres - VOXEL_LIMIT + 0.5) * side
        extents = positions[:, None, :] + ends * side
        covariances = (scatter + np.eye(3) / 12.0) * side**2
        spread = np.einsum("cii->c", scatter).clip(min=0.0)
        dispersions = (np.sqrt(spread) * side).tolist()
        forces = self._forces()
        shares = (sums.shares / sums.shares.sum(axis=1, keepdims=True)).tolist()
        for array in (positions, covariances, extents, forces):
            array.flags.writeable = False
        likelihoods, voxels = sums.largest.tolist(), sums.voxels.tolist()
        stamps = sums.stamp.tolist()
        shared = [(s, entries.sources[s].name) for s in np.flatnonzero(entries.counted)]
        falling = np.argsort(-sums.largest[kept].round(LIKELIHOOD_STEP), kind="stable")
        for c in kept[falling].tolist():
            yield Contact(
                position=positions[c],
                likelihood=likelihoods[c],
                dispersion=dispersions[c],
                covariance=covariances[c],
                extent=extents[c],
                force=forces[c],
                voxels=voxels[c],
                shares={name: shares[c][s] for s, name in shared},
                stamp=to_seconds(stamps[c]),
                frame=frame,
            )

    def _forces(self) -> FloatArray:
        """Give the mean force of each cluster, shape (c, 3) [N], NaN where there is none."""
        entries = self._field.entries
        felt = np.flatnonzero(entries.bits[self._selected] & kernels.FORCE)
        voxels = self._selected[felt]
        weights, forces = self._field.likelihoods[voxels], entries.forces_in(voxels)
        return clusters.mean_forces(self._labels[felt], len(self.sums.voxels), weights, forces)
