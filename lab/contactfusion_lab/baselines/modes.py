"""The condensation `modes`: contacts are the modes of a belief (docs/baselines.md)."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field as FieldOf

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE, Contact
from contactfusion.hooks import hookimpl
from contactfusion.integrator import fields, kernels
from contactfusion.integrator.cells import cell_list, heaviest
from contactfusion.integrator.entries import Entries, Field
from contactfusion.integrator.estimates import force_near
from contactfusion.integrator.nearby import connected
from contactfusion.model import Model
from contactfusion.reason import Reason, Why, millimetres
from contactfusion.rule import Condensation, Neighbourhood
from contactfusion.thinning import voxel_downsample
from contactfusion.time import to_seconds
from contactfusion_lab.baselines.posterior import Belief, belief_of

SPACING = 0.005
"""The lengths below suit places this far apart or closer; with coarser ones they grow [m]."""
WIDTH = 0.008
"""Width of the kernel of mean shift [m]."""
HEAVY = 0.3
"""Places of at least this part of the heaviest are the core of a contact."""
LINK = 0.012
"""Parts of a core that are further apart belong to different contacts [m]."""
LONG = 0.03
"""A core that reaches further from its mean is a line [m]."""
BASIN = 0.02
"""What lies within so much of its core belongs to a contact [m]."""
MOST = 8
"""No more modes are contacts than this."""
FAINT = 1e-4
"""Places of less than this part of the heaviest do not make a mode."""
STEPS = 20
"""Of mean shift at most; along a line it may end before it has come to rest."""
LITTLE = 0.01
"""A place without hypotheses that holds less of a belief than this needs no reason."""


class ModesConfig(Model):
    """Which modes are contacts."""

    existence: float = FieldOf(default=0.5, gt=0, le=1)
    """There is a contact when it is at least so probable."""
    mode_share: float = FieldOf(default=0.42, gt=0, le=1)
    """A further mode is a contact when it takes at least this part of the belief."""


class Modes(Condensation):
    """Each mode of a belief is a contact, if it is likely enough; its likelihood is P(contact)."""

    Config = ModesConfig
    looks_at_voxels = False

    def __init__(self, config: ModesConfig, tolerance: float) -> None:
        super().__init__(config, tolerance)
        self._existence, self._share = config.existence, config.mode_share

    def condense(self, field: Field, verdicts: NDArray[np.uint8]) -> Iterable[Contact]:
        """The densest mode if a contact exists, and further ones that weigh enough."""
        belief = belief_of(field)
        if belief is None or belief.exists < self._existence - kernels.EDGE:
            return ()
        weights, scale = belief.weights.copy(), max(1.0, belief.spacing / SPACING)
        found: list[Contact] = []
        while len(found) < MOST and (not found or weights.sum() >= self._share):
            mode, basin = _mode(belief.places, weights, scale)
            mass = float(weights[basin].sum())
            if found and mass < self._share - kernels.EDGE:
                break
            found.append(_contact(field, belief, mode, basin, mass, scale))
            weights[basin] = 0.0
        return sorted(found, key=lambda contact: -round(contact.likelihood, 6))

    def explain(self, field: Field, around: Neighbourhood, contact: Contact | None) -> str:
        """The probability of any contact, and the part of the belief that lies here."""
        belief = belief_of(field)
        if belief is None:
            return ""
        here = belief.exists * belief.within(around.position, around.reach)
        likelihood = contact.likelihood if contact else here
        return (
            f"P(contact) {belief.exists:.2f} by all evidence, {likelihood / belief.exists:.0%} of "
            f"the belief lies here: {likelihood:.2f}"
        )

    def objections(
        self, field: Field, verdicts: NDArray[np.uint8], around: Neighbourhood
    ) -> Sequence[Reason]:
        """Existence first, then the part of the belief that lies here."""
        belief = belief_of(field)
        share = belief.within(around.position, around.reach) if belief else 0.0
        if around.best == NONE and share < LITTLE:
            return ()
        if belief is None:
            names = [*field.given(around.best)]
            sentence = f"predicted by {' and '.join(names)}, but no sensor felt anything"
            return [Reason(Why.SUPPORT_ONLY, sentence, names[0])]
        if belief.exists < self._existence:
            short = self._existence - belief.exists
            sentence = (
                f"the probability of any contact is {belief.exists:.2f}, {short:.2f} under the "
                f"existence {self._existence:g} that is asked for"
            )
            values = {"exists": belief.exists, "existence": self._existence, "short": short}
            return [Reason(Why.IMPROBABLE, sentence, values=values)]
        sentence = (
            f"{share:.0%} of the belief lies within {millimetres(around.reach)}; beside a likelier "
            f"place a contact needs {self._share:.0%}"
        )
        values = {"share": share, "mode_share": self._share}
        return [Reason("small_share", sentence, values=values)]


def _mode(
    places: FloatArray, weights: FloatArray, scale: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The place of the densest contact, shape (3,) [m], and what belongs to it, shape (c,).

    Connected heavy places are one contact, be it a point or a line; places near them belong to it.
    A point lies where mean shift leads from their mean, a line at their mean.

    Args:
        places: shape (c, 3) [m].
        weights: shape (c,).
        scale: of all lengths.
    """
    heavy = np.flatnonzero(weights >= HEAVY * weights.max())
    some = np.flatnonzero(weights >= FAINT * weights.max())
    tops, cells = places[heavy], cell_list(places[heavy], max(fields.TILE, scale * LINK))
    densities = np.empty(len(heavy))
    widths = np.full(len(some), (scale * WIDTH) ** 2)
    fields.kernel_density(tops, cells, places[some], weights[some], widths, True, 0.0, densities)
    densest = int(np.round(densities / densities.max(), 6).argmax())  # the first of equals
    reaches = np.full(len(tops), 0.5 * scale * LINK)
    joined = connected(tops, cells, weights[heavy], 0.0, densest, reaches)
    core, heights = tops[joined], weights[heavy][joined]
    cells = cell_list(core, fields.TILE)
    basin = heaviest(places, core, cells, heights, scale * BASIN) > 0.0
    basin &= weights > 0.0  # the rest belongs to an earlier mode
    place = heights @ core / heights.sum()
    if ((core - place) ** 2).sum(axis=1).max() > (scale * LONG) ** 2:
        return place, basin  # along a line mean shift would follow every unevenness
    around, pulls = places[basin], weights[basin]
    for _ in range(STEPS):
        squared = ((around - place) ** 2).sum(axis=1) / (scale * WIDTH) ** 2
        near = pulls * np.exp(-0.5 * squared)
        shifted = near @ around / near.sum()
        if np.abs(shifted - place).max() < 1e-6:
            break
        place = shifted
    return place, basin


def _contact(
    field: Field,
    belief: Belief,
    mode: FloatArray,
    basin: NDArray[np.bool_],
    mass: float,
    scale: float,
) -> Contact:
    """The contact of a mode: its place is the mode, its covariance that of its basin."""
    entries, side = field.entries, field.entries.grid.voxel_size
    weights = belief.weights[basin] / belief.weights[basin].sum()
    offsets = belief.places[basin] - mode
    moments = (offsets * weights[:, None]).T @ offsets
    longest = np.linalg.eigh(moments)[1][:, -1]
    along = offsets @ longest
    heavy = along[weights >= HEAVY * weights.max()]
    extent = mode + np.outer([heavy.min(), heavy.max()], longest)
    added = np.maximum(belief.told[:, basin] @ weights, 0.0)
    counted = entries.counted
    added = np.where(counted, added, 0.0)
    total = float(added.sum()) or 1.0
    shares = {
        source.name: float(share) / total
        for source, share, is_counted in zip(entries.sources, added, counted, strict=True)
        if is_counted
    }
    forces = force_near(entries, mode, belief.places[basin], scale * BASIN)
    covariance = moments + np.eye(3) * (side**2 / 12.0 + float(weights @ belief.variances[basin]))
    for array in (mode, moments, covariance, extent, forces):
        array.flags.writeable = False
    return Contact(
        position=mode,
        likelihood=belief.exists * mass,
        scatter=moments,
        covariance=covariance,
        extent=extent,
        force=forces,
        voxels=int(len(voxel_downsample(belief.places[basin], entries.grid))),
        shares=shares,
        stamp=to_seconds(_newest(entries, added)),
        frame=entries.grid.frame,
    )


def _newest(entries: Entries, added: FloatArray) -> int:
    """The newest stamp of the sources that have a part in a contact [ns]."""
    parts = [
        entries.columns.stamps[own].max()
        for part, (_, own) in zip(added, entries.by_source, strict=True)
        if part > 0.0 and own.stop > own.start
    ]
    return int(max(parts, default=entries.columns.stamps.max()))


@hookimpl
def contactfusion_condensations() -> Mapping[str, type[Condensation]]:
    """Offer the condensation."""
    return {"modes": Modes}
