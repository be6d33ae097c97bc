"""Contacts as columns; each becomes an object when somebody looks at it."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.grid import VOXEL_LIMIT
from contactfusion.integrator import clusters
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
            entries.forces,
        )

    def keep(self, wanted: NDArray[np.bool_]) -> "ContactTable":
        """Leave out the clusters that are not wanted; `wanted` has shape (count,)."""
        self._kept = np.flatnonzero(wanted)
        return self

    def __iter__(self) -> Iterator[Contact]:
        """Give the contacts by falling likelihood, then by first voxel."""
        sums, entries = self.sums, self._field.entries
        side, frame = entries.grid.voxel_size, entries.grid.frame
        if not len(self._kept):
            return
        mean = sums.first / sums.weight[:, None]
        scatter = self._scatter(mean)
        axes = np.linalg.eigh(scatter)[1][:, :, 2]
        leading = axes[np.arange(len(axes)), np.abs(axes).argmax(axis=1)]
        axes *= np.sign(leading)[:, None]
        centres = sums.anchor + mean
        ends = clusters.reach_along(self._selected, self._labels, entries.keys, centres, axes)
        positions = (centres - VOXEL_LIMIT + 0.5) * side
        extents = positions[:, None, :] + ends[:, :, None] * axes[:, None, :] * side
        covariances = (scatter + np.eye(3) / 12.0) * side**2
        dispersions = np.sqrt(np.trace(scatter, axis1=1, axis2=2).clip(min=0.0)) * side
        with np.errstate(invalid="ignore"):
            forces = sums.force[:, :3] / sums.force[:, 3:]
        shares = sums.shares / sums.shares.sum(axis=1, keepdims=True)
        for array in (positions, covariances, extents, forces):
            array.flags.writeable = False
        names = [source.name for source in entries.sources]
        shared = np.flatnonzero(entries.counted)
        falling = np.argsort(-sums.largest[self._kept].round(LIKELIHOOD_STEP), kind="stable")
        for c in self._kept[falling]:
            yield Contact(
                position=positions[c],
                likelihood=float(sums.largest[c]),
                dispersion=float(dispersions[c]),
                covariance=covariances[c],
                extent=extents[c],
                force=forces[c],
                voxels=int(sums.voxels[c]),
                shares={names[s]: float(shares[c, s]) for s in shared},
                stamp=to_seconds(int(sums.stamp[c])),
                frame=frame,
            )

    def _scatter(self, mean: FloatArray) -> FloatArray:
        """Give the weighted covariance of each cluster, shape (c, 3, 3) [voxels²]."""
        full = (self.sums.second / self.sums.weight[:, None])[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]]
        return full.reshape(-1, 3, 3) - mean[:, :, None] * mean[:, None, :]
