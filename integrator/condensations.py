"""The condensations, which make contacts of a field (F §III-C, method §3)."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field as FieldOf

from contactfusion.contacts import NONE, Contacts
from contactfusion.hooks import hookimpl
from contactfusion.integrator import clusters, kernels
from contactfusion.integrator.clusters import ContactTable
from contactfusion.integrator.entries import Field
from contactfusion.integrator.members import Members
from contactfusion.integrator.store import Int64Array, unpack
from contactfusion.model import Model
from contactfusion.reason import Reason, Why, counted, millimetres
from contactfusion.rule import Condensation, Neighbourhood

WIDE = 64
"""Beyond so many sides a tolerance may span all there is."""


class Threshold(Condensation):
    """Each voxel over the threshold is a contact (F §III-C 1)."""

    def condense(self, field: Field, verdicts: NDArray[np.uint8]) -> Contacts:
        """One contact a voxel."""
        selected, _ = _chosen(field, verdicts == kernels.CONTACT)
        labels = np.arange(len(selected), dtype=np.int32)
        return ContactTable(field, selected, labels, len(selected)).contacts()


class ClusterCentroidConfig(Model):
    """Which clusters are contacts."""

    min_voxels: int = FieldOf(default=1, ge=1)
    """Clusters of fewer voxels are no contacts."""


class ClusterCentroid(Condensation):
    """Clusters of voxels over the threshold, at their weighted centroids (F §III-C 2)."""

    Config = ClusterCentroidConfig

    def __init__(self, config: ClusterCentroidConfig, tolerance: float) -> None:
        super().__init__(config, tolerance)
        self._min_voxels = config.min_voxels

    def condense(self, field: Field, verdicts: NDArray[np.uint8]) -> Contacts:
        """One contact a cluster of enough voxels."""
        table = clustered(field, verdicts == kernels.CONTACT, self.tolerance)
        return table.contacts(table.sums.voxels >= self._min_voxels)

    def objections(
        self, field: Field, verdicts: NDArray[np.uint8], around: Neighbourhood
    ) -> Sequence[Reason]:
        """Too few voxels over the threshold."""
        if around.best == NONE or verdicts[around.best] != kernels.CONTACT:
            return ()
        voxels = int((verdicts[around.inside] == kernels.CONTACT).sum())
        sentence = (
            f"{counted(voxels, 'voxel')} over the threshold within {millimetres(around.reach)}, "
            f"where cluster_centroid wants {self._min_voxels} that hang together"
        )
        values = {"voxels": float(voxels), "min_voxels": float(self._min_voxels)}
        return [Reason(Why.TOO_FEW_VOXELS, sentence, values=values)]


def _chosen(field: Field, wanted: NDArray[np.bool_]) -> tuple[NDArray[np.int32], Int64Array]:
    """The rows of the wanted voxels, and their keys."""
    keys = field.entries.keys
    rows, row_keys = np.empty(len(keys), np.int32), np.empty(len(keys), np.int64)
    count = kernels.choose(wanted, keys, rows, row_keys)
    return rows[:count], row_keys[:count]


def clustered(field: Field, wanted: NDArray[np.bool_], tolerance: float) -> ContactTable:
    """The wanted voxels, shape (m,), as clusters of those at most a tolerance [m] apart."""
    selected, keys = _chosen(field, wanted)
    reach = clusters.reach_squared(tolerance, field.entries.grid.voxel_size)
    if reach > WIDE**2 and len(keys):
        span = np.ptp(unpack(keys), axis=0)
        if int(span @ span) <= reach:  # every pair is linked
            return ContactTable(field, selected, np.zeros(len(keys), np.int32), 1)
    labels, count = clusters.label(keys, reach)
    return ContactTable(field, selected, labels, count)


@hookimpl
def contactfusion_condensations() -> Mapping[str, type[Condensation]]:
    """Offer the condensations of method §3."""
    return {
        "threshold": Threshold,
        "cluster_centroid": ClusterCentroid,
        "members": Members,
    }
