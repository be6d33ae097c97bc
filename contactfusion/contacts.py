"""Contacts: what the hypotheses condense to."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray

NONE = -1
"""In place of a row: there is none."""


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """One contact with the world (F §III-C, method §3).

    Attributes:
        position: shape (3,) [m], where the sources agree best, of a line or a patch its middle; of
            voxels their centroid weighted by likelihood.
        likelihood: the probability that it exists; of voxels the largest fused likelihood.
        scatter: shape (3, 3) [m²], how large it is: the second moments of its area, or of its
            voxels weighted by likelihood, about the position.
        covariance: shape (3, 3) [m²], how unsure the position is; of voxels it holds the scatter,
            too.
        extent: shape (2, 3) [m], its two ends along its longest axis.
        force: shape (3,) [N] on the robot, NaN when no source felt one.
        voxels: how many voxels it fills.
        shares: how much each source confirms its position, or gave of its likelihood; sums to 1.
        stamp: the newest hypothesis in it [s].
        frame: the frame of all places and vectors.
        track: its number, the same as long as it lasts; 0: contacts are not followed.
        since: when it was made [s]; NaN: contacts are not followed.
    """

    position: FloatArray
    likelihood: float
    scatter: FloatArray
    covariance: FloatArray
    extent: FloatArray
    force: FloatArray
    voxels: int
    shares: Mapping[str, float]
    stamp: float
    frame: str
    track: int = 0
    since: float = float("nan")

    @property
    def dispersion(self) -> float:
        """The standard distance of its area, or of its voxels, from the position [m]."""
        return float(np.sqrt(max(np.trace(self.scatter), 0.0)))

    def __str__(self) -> str:
        """Place, likelihood and sources in one line."""
        x, y, z = self.position
        shares = sorted(self.shares.items(), key=lambda item: -item[1])
        sources = ", ".join(f"{name} {share:.0%}" for name, share in shares if share > 0)
        return (
            f"contact at ({x:.3f}, {y:.3f}, {z:.3f}) m in '{self.frame}', "
            f"likelihood {self.likelihood:.2f}, from {sources}"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Contacts:
    """The contacts of a field, and the voxels that each is made of.

    Attributes:
        contacts: the most likely first.
        owners: works out, when someone looks, the contact that each voxel of the field belongs to:
            a row of `contacts` or `NONE`, shape (m,).
    """

    contacts: tuple[Contact, ...]
    owners: Callable[[], NDArray[np.intp]]

    def __iter__(self) -> Iterator[Contact]:
        """The contacts, the most likely first."""
        return iter(self.contacts)
