"""The surroundings of a place in the hypothesis space, and what each source says there."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.explaining.account import Said
from contactfusion.explaining.view import NOBODY, View
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.fusion import Fusion


@dataclass(frozen=True, slots=True)
class Spot:
    """A place with the voxels around it.

    Attributes:
        position: shape (3,) [m].
        reach: how far it reaches [m].
        inside: shape (m,), which voxels of the space lie in it.
        best: the row of the likeliest voxel in it, or `NOBODY`.
    """

    position: FloatArray
    reach: float
    inside: NDArray[np.bool_]
    best: int


def spot_at(view: View, position: FloatArray, reach: float) -> Spot:
    """Give what lies within reach of a place, and the voxel that the place lies in."""
    offsets = np.abs(view.centres - position)
    inside = (offsets**2).sum(axis=1) <= reach**2 + 1e-12
    inside |= (offsets <= 0.5 * view.fusion.field.entries.grid.voxel_size).all(axis=1)
    return Spot(position, reach, inside, _best(view, inside, position))


def spot_of(view: View, number: int) -> Spot:
    """Give the voxels that belong to a contact, by its row in the contacts."""
    contact, inside = view.fusion.contacts[number], view.owners == number
    reach = max(view.settings.tolerance, 2.0 * contact.dispersion)
    return Spot(contact.position, reach, inside, _best(view, inside, contact.position))


def said_at(view: View, spot: Spot) -> list[Said]:
    """Give what each source says in a spot, likelier first; those that say nothing are left out.

    Where a rule has a belief, sources that have a say in it are told of too.
    """
    entries, said = view.fusion.field.entries, []
    fits = fits_at(view.fusion, spot.position, view.settings.integrator.floor)
    for number, (source, (begin, end)) in enumerate(
        zip(entries.sources, itertools.pairwise(entries.begin.tolist()), strict=True)
    ):
        rows = begin + np.flatnonzero(spot.inside[entries.places[begin:end]])
        fit = float(fits[number]) if fits is not None and end > begin else np.nan
        if not len(rows) and np.isnan(fit):
            continue
        timeout = view.settings.timeout(source.name)
        if not len(rows):
            said.append(Said(source.name, source.kind, np.nan, np.nan, timeout, 0, 0.0, fit=fit))
            continue
        columns = entries.columns
        row = rows[columns.likelihoods[rows].argmax()]
        said.append(
            Said(
                source=source.name,
                kind=source.kind,
                likelihood=float(columns.likelihoods[row]),
                age=float(entries.now - columns.stamps[row]) / 1e9,
                timeout=timeout,
                voxels=len(rows),
                spread=float(columns.spreads[row]),
                fit=fit,
            )
        )
    return sorted(said, key=lambda one: -np.nan_to_num(one.likelihood))


def fits_at(fusion: Fusion, position: FloatArray, floor: float) -> FloatArray | None:
    """Tell how well a place fits what each source says, shape (k,); None without a belief.

    Of evidence and support: the source's factor at the place of the belief that is nearest, as a
    part of its largest; of null: the factor itself, which is what it leaves of the others' belief.
    """
    belief = fusion.field.belief
    if belief is None:
        return None
    here = int(((belief.places - position) ** 2).sum(axis=1).argmin())
    told = belief.told[:, here]
    null = fusion.field.entries.flags(HypothesisKind.NULL)
    fits: FloatArray = np.exp(told - belief.told.max(axis=1))
    fits[null] = np.minimum(floor * np.exp(told[null]), 1.0)
    return fits


def _best(view: View, wanted: NDArray[np.bool_], position: FloatArray) -> int:
    """Give the likeliest of the wanted voxels with more than null, of equals the nearest."""
    rows = np.flatnonzero(wanted & view.fusion.field.entries.counted_voxels)
    if not len(rows):
        return NOBODY
    likelihoods = np.round(view.fusion.field.likelihoods[rows], 6)
    tops = rows[likelihoods == likelihoods.max()]
    return int(tops[((view.centres[tops] - position) ** 2).sum(axis=1).argmin()])
