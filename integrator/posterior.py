"""The rule `posterior`: where a contact is, by a product of the sources' fields with floors.

De Morgan takes likelihoods of one voxel for independent events: sources that are a voxel apart
never meet, and a cloud that describes one contact counts as many. Here each source says of every
place on the robot's surface how well a contact there would explain it: a field, as wide as its
spreads. The fields multiply; a floor keeps a source that is wrong from overruling all others.
"""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import fields, kernels
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.integrator.entries import Belief, Entries, Field, Source
from contactfusion.surface import Surface

AROUND = 0.02
"""The surface is looked at in cells of this side with evidence, and in those next to them [m]."""
NARROWEST = 1e-3
"""No source knows a place better than this [m], and a voxel's own size besides."""


class Posterior:
    """log w = Σ log(field + floor) tells where, 1 - Π(1 - P) over evidence whether (method §2)."""

    gives_belief = True

    def __init__(self, config: IntegratorConfig) -> None:
        self._floor = config.floor

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """Fuse by a product of fields, over the surface near evidence, or over its voxels."""
        centres = entries.grid.centres(entries.voxels)
        evidence = centres[(entries.bits & kernels.REGULAR).astype(np.bool_)]
        exists = existence(entries)
        likelihoods = np.zeros(len(centres))
        if exists == 0.0:
            return Field(entries, likelihoods, belief=None)
        places = _candidates(evidence, surface)
        there = self._logarithms(entries, centres, places)
        total = there.sum(axis=0)
        highest = float(total.max())
        weights = np.exp(total - highest)
        exists = self._lowered(entries, exists, there)
        counted = (entries.bits & (kernels.REGULAR | kernels.SUPPORT)).astype(np.bool_)
        counted &= _within(centres, places, entries.grid.voxel_size)  # beyond, nothing is likely
        told = self._logarithms(entries, centres, centres[counted]).sum(axis=0)
        likelihoods[counted] = exists * np.exp(np.minimum(told - highest, 0.0))
        spoken = np.diff(entries.begin)[:, None] > 0
        added = np.where(spoken, there - np.log(self._floor), 0.0)
        belief = Belief(places, weights / weights.sum(), exists, added)
        return Field(entries, likelihoods, belief=belief)

    def _lowered(self, entries: Entries, exists: float, there: FloatArray) -> float:
        """Lower the probability of a contact by what null takes from its places (Bayes)."""
        null = entries.flags(HypothesisKind.NULL)
        if not null.any():
            return exists
        free = there[~null].sum(axis=0)
        left = np.exp(free + there[null].sum(axis=0) - free.max()).sum()
        kept = exists * float(left / np.exp(free - free.max()).sum())
        return kept / (1.0 - exists + kept)

    def _logarithms(self, entries: Entries, centres: FloatArray, places: FloatArray) -> FloatArray:
        """Give log(field + floor) of each source at each place, shape (k, c).

        A field is relative to its own highest value at these places, so that a source with many
        hypotheses says no more than one with few. What is null there speaks against a contact by
        as much as a floor: a likelihood, no veto.
        """
        logarithms = np.full((len(entries.sources), len(places)), np.log(self._floor))
        side = entries.grid.voxel_size
        for row, (begin, end) in enumerate(itertools.pairwise(entries.begin)):
            if begin == end:
                logarithms[row] = 0.0  # it says nothing of any place
                continue
            columns = slice(int(begin), int(end))
            positions = centres[entries.places[columns]]
            given = entries.columns.likelihoods[columns]
            spreads = np.maximum(entries.columns.spreads[columns], NARROWEST)
            variances = np.square(spreads.astype(np.float64)) + side**2 / 12.0
            single = bool(entries.columns.single[columns][0])
            field = np.empty(len(places))
            far = fields.REACH * np.sqrt(variances.max())
            felt = _within(positions, places, far)  # from beyond, no place is reached
            fields.spread_out(places, positions[felt], given[felt], variances[felt], single, field)
            if entries.sources[row].kind == HypothesisKind.NULL:
                logarithms[row] = np.log1p(-(1.0 - self._floor) * np.minimum(field, 1.0))
            else:
                highest = float(field.max(initial=np.finfo(np.float64).tiny))
                logarithms[row] = np.log(field / highest + self._floor)
        return logarithms


def existence(entries: Entries) -> float:
    """Give the probability that there is a contact at all, by evidence alone.

    1 - Π over Regular sources of 1 - Σp for one that describes a single contact, else 1 - max p.
    """
    missed = 1.0
    for source, (begin, end) in zip(
        entries.sources, itertools.pairwise(entries.begin), strict=True
    ):
        if source.kind == HypothesisKind.REGULAR and end > begin:
            given = entries.columns.likelihoods[begin:end].astype(np.float64)
            single = bool(entries.columns.single[begin])
            missed *= 1.0 - min(float(given.sum() if single else given.max()), 1.0)
    return 1.0 - missed


def _within(points: FloatArray, places: FloatArray, reach: float) -> NDArray[np.bool_]:
    """Tell which points lie in the box around places, widened by `reach` [m], shape (n,)."""
    if not len(places):
        return np.zeros(len(points), np.bool_)
    low, high = places.min(axis=0) - reach, places.max(axis=0) + reach
    inside: NDArray[np.bool_] = ((points >= low) & (points <= high)).all(axis=1)
    return inside


def _candidates(evidence: FloatArray, surface: Surface | None) -> FloatArray:
    """Give the places where the contact may be, shape (c, 3) [m].

    Args:
        evidence: shape (n, 3) [m], at least one.
        surface: the robot's, or None.
    """
    if surface is None or not len(surface.points):
        return evidence
    least = surface.points.min(axis=0) - 2.0 * AROUND
    most = surface.points.max(axis=0) + 2.0 * AROUND
    within = evidence[((evidence > least) & (evidence < most)).all(axis=1)]
    if not len(within):  # a source that is wrong may be kilometres away
        return evidence
    low = (np.floor(within.min(axis=0) / AROUND) - 2.0) * AROUND
    rows = np.floor((within - low) / AROUND).astype(np.int64)
    cells = np.zeros(rows.max(axis=0) + 3, np.bool_)
    for offset in itertools.product((-1, 0, 1), repeat=3):
        cells[tuple((rows + offset).T)] = True
    chosen: NDArray[np.bool_] = fields.near(surface.points, cells, low, AROUND)
    return surface.points[chosen] if chosen.any() else evidence
