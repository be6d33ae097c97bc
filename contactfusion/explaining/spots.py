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
from contactfusion.integrator.posterior import PosteriorConfig


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
    if view.settings.by_modes:
        near = spot_at(view, contact.position, view.settings.tolerance).inside
        inside |= near & (view.owners == NOBODY)
    return Spot(contact.position, reach, inside, _best(view, inside, contact.position))


def said_at(view: View, spot: Spot) -> list[Said]:
    """Give what each source says in a spot, likelier first; those that say nothing are left out.

    Where a rule has a belief, a source whose field reaches here from further away says something.
    """
    entries, said = view.fusion.field.entries, []
    positions = entries.positions
    options = view.settings.rule
    floor = (options if isinstance(options, PosteriorConfig) else PosteriorConfig()).floor
    fits, heard = heard_at(view.fusion, spot, floor)
    for number, (source, (begin, end)) in enumerate(
        zip(entries.sources, itertools.pairwise(entries.begin.tolist()), strict=True)
    ):
        rows = begin + np.flatnonzero(spot.inside[entries.places[begin:end]])
        if end == begin or not (len(rows) or heard[number]):
            continue
        columns = entries.columns
        away = np.linalg.norm(positions[begin:end] - spot.position, axis=1)
        row = rows[columns.likelihoods[rows].argmax()] if len(rows) else begin + away.argmin()
        said.append(
            Said(
                source=source.name,
                kind=source.kind,
                likelihood=float(columns.likelihoods[row]),
                age=float(entries.now - columns.stamps[row]) / 1e9,
                timeout=view.settings.timeout(source.name),
                voxels=len(rows),
                spread=float(columns.spreads[row]),
                away=float(away[row - begin]),
                fit=float(fits[number]),
            )
        )
    return sorted(said, key=lambda one: -np.nan_to_num(one.likelihood))


def heard_at(fusion: Fusion, spot: Spot, floor: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """How well a spot fits the evidence of each source, and whether its field stands out there.

    Of evidence and support: the source's factor at the place of the belief that is nearest, as a
    part of its largest; it stands out where the field exceeds its floor. Of null: the factor
    itself, which is what it leaves of the others' belief; it stands out where it takes some.

    Returns:
        Both of shape (k,); NaN and False where no place of a belief lies in the spot.
    """
    belief, entries = fusion.field.belief, fusion.field.entries
    unheard = np.full(len(entries.sources), np.nan), np.zeros(len(entries.sources), np.bool_)
    if belief is None:
        return unheard
    squared = ((belief.places - spot.position) ** 2).sum(axis=1)
    if squared.min() > spot.reach**2:
        return unheard
    told = belief.told[:, squared.argmin()]
    null = entries.flags(HypothesisKind.NULL)
    fits: FloatArray = np.exp(told - belief.told.max(axis=1))
    fits[null] = np.minimum(floor * np.exp(told[null]), 1.0)
    return fits, np.where(null, fits < 1.0 - floor, told > np.log(2.0))


def shares_at(fusion: Fusion, spot: Spot) -> dict[str, float]:
    """The share of each source in a belief in a spot, summing to 1; Null has none."""
    belief, entries = fusion.field.belief, fusion.field.entries
    assert belief is not None
    squared = ((belief.places - spot.position) ** 2).sum(axis=1)
    near = squared <= max(spot.reach**2, squared.min())
    added = np.maximum(belief.told[:, near] @ belief.weights[near], 0.0) * entries.counted
    parts = added / (added.sum() or 1.0)
    return {one.name: float(part) for one, part in zip(entries.sources, parts, strict=True)}


def _best(view: View, wanted: NDArray[np.bool_], position: FloatArray) -> int:
    """Give the likeliest of the wanted voxels with more than null, of equals the nearest."""
    rows = np.flatnonzero(wanted & view.fusion.field.entries.counted_voxels)
    if not len(rows):
        return NOBODY
    likelihoods = np.round(view.fusion.field.likelihoods[rows], 6)
    tops = rows[likelihoods == likelihoods.max()]
    return int(tops[((view.centres[tops] - position) ** 2).sum(axis=1).argmin()])
