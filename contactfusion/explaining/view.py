"""A moment with all that is needed to explain it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from contactfusion.arrays import FloatArray
from contactfusion.explaining.moment import Moment
from contactfusion.explaining.past import Past
from contactfusion.explaining.settings import Settings
from contactfusion.integrator import clusters, kernels
from contactfusion.integrator.condensations import FAINTEST, reach_squared
from contactfusion.integrator.fusion import Fusion

NOBODY = -1
SIGMAS = 3.0
"""A box that is filled evenly reaches so many standard deviations from its middle, its corners."""


@dataclass(frozen=True)
class View:
    """A step, what was before, and how hypotheses live and fuse."""

    moment: Moment
    settings: Settings

    @property
    def stamp(self) -> float:
        """The time of the step [s]."""
        return self.moment.step.stamp

    @property
    def fusion(self) -> Fusion:
        """What the step made of the live hypotheses."""
        return self.moment.step.fusion

    @property
    def past(self) -> Past:
        """What was before, the step included."""
        return self.moment.past

    @cached_property
    def centres(self) -> FloatArray:
        """The centres of all voxels, shape (m, 3) [m]."""
        entries = self.fusion.field.entries
        return entries.grid.centres(entries.voxels)

    @cached_property
    def owners(self) -> NDArray[np.intp]:
        """The contact that each voxel belongs to, as a row of the contacts or `NOBODY`, (m,)."""
        match self.settings.integrator.condensation:
            case "threshold" | "cluster_centroid" | "cluster_mass":
                return self._by_cluster()
            case _:
                return self._by_ellipsoid()

    def _by_cluster(self) -> NDArray[np.intp]:
        """Cluster the voxels again, and find the contact at the centroid of each cluster."""
        fusion, config = self.fusion, self.settings.integrator
        codes, likelihoods = fusion.verdict_codes, fusion.field.likelihoods
        wanted = codes == kernels.CONTACT
        if config.condensation == "cluster_mass":
            wanted |= (codes == kernels.BELOW_THRESHOLD) & (likelihoods >= FAINTEST)
        rows = np.flatnonzero(wanted)
        owners = np.full(len(codes), NOBODY, np.intp)
        if not fusion.contacts or not len(rows):
            return owners
        keys, labels = fusion.field.entries.keys[rows], np.arange(len(rows))
        if config.condensation != "threshold":
            reach = reach_squared(config.linking_distance, config.voxel_size)
            labels = clusters.label(keys, reach)[0].astype(np.intp)
        weights = likelihoods[rows]
        sums = [np.bincount(labels, weights * x) for x in self.centres[rows].T]
        centroids = np.stack(sums, axis=1) / np.bincount(labels, weights)[:, None]
        away, nearest = cKDTree([one.position for one in fusion.contacts]).query(centroids)
        of_cluster = np.where(away < 1e-3 * config.voxel_size, nearest, NOBODY)
        owners[rows] = of_cluster[labels]
        return owners

    def _by_ellipsoid(self) -> NDArray[np.intp]:
        """Deal voxels to the likeliest contact within whose covariance they lie."""
        owners = np.full(len(self.centres), NOBODY, np.intp)
        for number, contact in reversed(list(enumerate(self.fusion.contacts))):
            offsets = self.centres - contact.position
            squared = (offsets * np.linalg.solve(contact.covariance, offsets.T).T).sum(axis=1)
            owners[squared <= SIGMAS**2] = number
        return owners
