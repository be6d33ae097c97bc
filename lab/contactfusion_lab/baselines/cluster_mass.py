"""The condensation `cluster_mass`: clusters that are likely as a whole (docs/baselines.md)."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field as FieldOf

from contactfusion.contacts import NONE, Contacts
from contactfusion.hooks import hookimpl
from contactfusion.integrator import kernels
from contactfusion.integrator.condensations import clustered
from contactfusion.integrator.entries import Field
from contactfusion.model import Model
from contactfusion.reason import Reason, millimetres
from contactfusion.rule import Condensation, Neighbourhood

FAINTEST = 0.01
"""Voxels less likely than this are left out."""


class ClusterMassConfig(Model):
    """Which clusters are contacts."""

    mass_threshold: float = FieldOf(default=0.5, gt=0)
    """The sum of likelihoods from which a cluster is a contact."""


class ClusterMass(Condensation):
    """Clusters that are likely as a whole, however thinly their likelihood is spread.

    A source that describes one contact over 12 voxels gives each 1/12, under any useful threshold;
    its cluster still sums to 1.
    """

    Config = ClusterMassConfig

    def __init__(self, config: ClusterMassConfig, tolerance: float) -> None:
        super().__init__(config, tolerance)
        self._mass_threshold = config.mass_threshold

    def condense(self, field: Field, verdicts: NDArray[np.uint8]) -> Contacts:
        """One contact a cluster of enough mass."""
        table = clustered(field, _massive(field, verdicts), self.tolerance)
        return table.contacts(table.sums.weight >= self._mass_threshold)

    def objections(
        self, field: Field, verdicts: NDArray[np.uint8], around: Neighbourhood
    ) -> Sequence[Reason]:
        """Too little mass."""
        if around.best == NONE or not _judged(verdicts)[around.best]:
            return ()
        mass = float(field.likelihoods[around.inside & _massive(field, verdicts)].sum())
        sentence = (
            f"the likelihoods within {millimetres(around.reach)} sum to {mass:.2f}; a contact "
            f"needs a cluster of {self._mass_threshold:g}"
        )
        values = {"mass": mass, "mass_threshold": self._mass_threshold}
        return [Reason("too_little_mass", sentence, values=values)]


def _judged(verdicts: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Which voxels were judged by their likelihood, shape (m,)."""
    return np.asarray((verdicts == kernels.CONTACT) | (verdicts == kernels.BELOW_THRESHOLD))


def _massive(field: Field, verdicts: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Which voxels add to the mass of a cluster, shape (m,)."""
    return _judged(verdicts) & (field.likelihoods >= FAINTEST)


@hookimpl
def contactfusion_condensations() -> Mapping[str, type[Condensation]]:
    """Offer the condensation."""
    return {"cluster_mass": ClusterMass}
