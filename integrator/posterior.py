"""The rule `posterior`: where a contact is, by a product of the sources' fields with floors.

De Morgan takes likelihoods of one voxel for independent events: sources that are a voxel apart
never meet, and a cloud that describes one contact counts as many. Here each source says of every
place on the robot's surface how well a contact there would explain it: a field, as wide as its
spreads. The fields multiply; a floor keeps a source that is wrong from overruling all others.
"""

import itertools
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from pydantic import Field as FieldOf

from contactfusion.arrays import FloatArray
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import fields
from contactfusion.integrator.entries import Belief, Entries, Field, Source
from contactfusion.model import Model
from contactfusion.rule import Rule, by_sources
from contactfusion.surface import Surface

NARROWEST = 4e-3
"""No source knows a place better than this [m], about as far apart as the points of a surface."""
TAIL = 0.1
"""Spreads may be stated too small: a second Gaussian, so high and three times as wide, is added."""
SOFT = 0.15
"""The edge of the friction cone is so soft, in cosines of the angle to the normal."""


class Claims(NamedTuple):
    """What one source says.

    Attributes:
        kind: what it stands on.
        single: whether it describes one contact somewhere.
        positions: shape (n, 3) [m].
        likelihoods: shape (n,).
        variances: shape (n,) [m²], of the positions by axis, as the source states them.
        force: shape (3,) [N], what the robot feels, of one that describes one contact; or None.
    """

    kind: HypothesisKind
    single: bool
    positions: FloatArray
    likelihoods: FloatArray
    variances: FloatArray
    force: FloatArray | None


class Candidates(NamedTuple):
    """The places where a contact may be.

    Attributes:
        places: shape (c, 3) [m], c > 0 when there is evidence.
        spacing: how far neighbouring places lie apart [m].
        variances: shape (c,) [m²], of a contact at each place around it.
        normals: of the surface there, shape (c, 3); None without it.
        told: shape (k, c), the field of each source.
    """

    places: FloatArray
    spacing: float
    variances: FloatArray
    normals: FloatArray | None
    told: FloatArray


class PosteriorConfig(Model):
    """How far sources are trusted."""

    floor: float = FieldOf(default=0.01, ge=1e-6, lt=1)
    """What a source leaves to places that it does not believe in, as a part of its highest."""
    friction: float = FieldOf(default=0.5, gt=0)
    """The coefficient of friction of contacts whose force is known."""


class Posterior(Rule):
    """log w = Σ log(field + floor) tells where, 1 - Π(1 - P) over evidence whether (method §2)."""

    Config = PosteriorConfig
    gives_belief = True
    needs_places = True

    def __init__(self, config: PosteriorConfig) -> None:
        super().__init__(config)
        self._floor = config.floor
        self._steepest = 1.0 / np.hypot(1.0, config.friction)

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """The product of fields, over the surface near evidence, or over the evidence's places."""
        claims = claimed(entries)
        exists = existence(claims, sources)
        if exists == 0.0:
            return Field(entries, np.zeros(len(entries.keys)))
        found = _candidates(claims, surface, self._floor, entries.grid.voxel_size)
        there = self._logarithms(claims, found.told, found.normals)
        total = there.sum(axis=0)
        weights = np.exp(total - total.max())
        exists = self._lowered(claims, exists, there)
        spoken = np.array([[len(claim.positions) > 0] for claim in claims])
        added = np.where(spoken, there - np.log(self._floor), 0.0)
        belief = Belief(
            found.places,
            found.spacing,
            weights / weights.sum(),
            found.variances,
            exists,
            added,
            self._floor,
        )
        return Field(entries, partial(_by_voxel, entries, belief), belief=belief)

    def explain(self, field: Field, row: int) -> str:
        """The probability of any contact, and how the voxel compares to the likeliest place."""
        if (belief := field.belief) is None:
            return by_sources(field, row, _of_support)
        fused = float(field.likelihoods[row])
        return (
            f"P(contact) {belief.exists:.2f} by all evidence, {fused / belief.exists:.0%} as "
            f"likely here as at the likeliest place: {fused:.2f}"
        )

    def _lowered(self, claims: Sequence[Claims], exists: float, there: FloatArray) -> float:
        """The probability of a contact, less what null takes from the places of evidence.

        By Bayes; support has no say in whether there is a contact.
        """
        null, evidence = (
            np.array([claim.kind == kind for claim in claims])
            for kind in (HypothesisKind.NULL, HypothesisKind.REGULAR)
        )
        if not null.any():
            return exists
        free = there[evidence].sum(axis=0)
        left = np.exp(free + there[null].sum(axis=0) - free.max()).sum()
        kept = exists * float(left / np.exp(free - free.max()).sum())
        return kept / (1.0 - exists + kept)

    def _logarithms(
        self, claims: Sequence[Claims], told: FloatArray, normals: FloatArray | None
    ) -> FloatArray:
        """The log(field + floor) of each source at each place, shape (k, c).

        A field is relative to its own highest value, so that a source with many hypotheses says no
        more than one with few. What is null at a place speaks against a contact there by as much
        as a floor: a likelihood, no veto. The force of one contact pushes into the surface, within
        the cone of friction: that is a second field of its source, with a floor of its own.
        """
        logarithms = np.zeros_like(told)
        for row, (claim, field) in enumerate(zip(claims, told, strict=True)):
            if claim.kind == HypothesisKind.NULL:
                logarithms[row] = np.log1p(-(1.0 - self._floor) * np.minimum(field, 1.0))
            elif len(claim.positions):
                highest = float(field.max(initial=np.finfo(np.float64).tiny))
                logarithms[row] = np.log(field / highest + self._floor)
                if claim.force is not None and normals is not None:
                    logarithms[row] += np.log(self._pushed(claim.force, normals) + self._floor)
        return logarithms

    def _pushed(self, force: FloatArray, normals: FloatArray) -> FloatArray:
        """How well a force fits the friction cone at each place, shape (c,), at most 1."""
        push = force / np.abs(force).max()
        cosines = normals @ (push / -np.linalg.norm(push))
        beyond = np.maximum(self._steepest - cosines, 0.0) / SOFT
        fits: FloatArray = np.exp(-0.5 * beyond**2)
        return fits


def _of_support(given: Sequence[float], fused: float) -> str:
    return f"posterior of {', '.join(f'{p:.2f}' for p in given)} = {fused:.2f}"


def _by_voxel(entries: Entries, belief: Belief) -> FloatArray:
    """The likelihood of the likeliest place within a side of each voxel's centre, shape (m,)."""
    likelihoods, counted = np.zeros(len(entries.keys)), entries.counted_voxels
    side, heights = entries.grid.voxel_size, belief.weights / belief.weights.max()
    dealt = fields.deal(belief.places, 2.0 * side)
    centres = entries.grid.centres(entries.voxels[counted])
    near = fields.heaviest(centres, belief.places, dealt, heights, side)
    likelihoods[counted] = belief.exists * near
    return likelihoods


def claimed(entries: Entries) -> list[Claims]:
    """What each source says, the hypotheses where they were measured."""
    positions, columns = entries.positions, entries.columns
    claims = []
    for source, ((begin, felt), (end, _)) in zip(
        entries.sources, itertools.pairwise(entries.starts.tolist()), strict=True
    ):
        single = bool(end > begin and columns.single[begin])
        given = columns.offsets[begin:end, 3] if single else columns.likelihoods[begin:end]
        variances = np.square(columns.spreads[begin:end].astype(np.float64))
        likelihoods = given.astype(np.float64)
        force = None
        if single and felt >= 0 and source.kind == HypothesisKind.REGULAR:
            mean = columns.forces[felt : felt + end - begin, :3].sum(axis=0)
            force = mean if mean.any() else None
        claims.append(
            Claims(source.kind, single, positions[begin:end], likelihoods, variances, force)
        )
    return claims


def existence(claims: Sequence[Claims], sources: Sequence[Source]) -> float:
    """The probability that there is a contact at all, by evidence alone.

    e = 1 - Π(1 - P) over Regular sources, P = Σp for one that describes a single contact, else the
    largest p. Sources that would have told of a contact and say nothing lower it by Bayes: with μ
    the probability that all of them miss one, it becomes e μ / (1 - e + e μ).
    """
    missed = silent = 1.0
    for claim, source in zip(claims, sources, strict=True):
        if not len(claim.positions):
            silent *= source.misses
        elif claim.kind == HypothesisKind.REGULAR:
            total = claim.likelihoods.sum() if claim.single else claim.likelihoods.max()
            missed *= 1.0 - min(float(total), 1.0)
    kept = (1.0 - missed) * silent
    return kept / (missed + kept) if kept else 0.0


def _candidates(
    claims: Sequence[Claims], surface: Surface | None, floor: float, side: float
) -> Candidates:
    """The places where a contact may be, and the field of each source over them.

    They are the points of the surface of which some evidence says more than its floor; without
    any, where evidence lies: then each is as uncertain as its hypothesis, and neighbours are a
    voxel apart, `side` [m].
    """
    evidence = [claim.kind == HypothesisKind.REGULAR for claim in claims]
    if surface is not None and len(surface.points):
        told = _fields(claims, surface.points, evidence)
        highest = told.max(axis=1, keepdims=True)
        reached = ((told > floor * highest) & (highest > 0.0)).any(axis=0)
        if reached.any():
            places = surface.points[reached]
            others = [not is_evidence for is_evidence in evidence]
            told = told[:, reached] + _fields(claims, places, others)
            exact = np.zeros(len(places))  # the fields are as wide as the spreads
            return Candidates(places, surface.spacing, exact, surface.normals[reached], told)
    regular = [claim for claim in claims if claim.kind == HypothesisKind.REGULAR]
    places = np.concatenate([claim.positions for claim in regular])
    variances = np.concatenate([claim.variances for claim in regular])
    return Candidates(places, side, variances, None, _fields(claims, places, [True] * len(claims)))


def _fields(claims: Sequence[Claims], places: FloatArray, wanted: Sequence[bool]) -> FloatArray:
    """The fields of some sources, shape (k, c); 0 for the others."""
    told = np.zeros((len(claims), len(places)))
    tiles = fields.deal(places, fields.TILE)
    for claim, field, is_wanted in zip(claims, told, wanted, strict=True):
        if is_wanted:
            variances = np.maximum(claim.variances, NARROWEST**2)
            given = (claim.positions, claim.likelihoods, variances, claim.single)
            tail = 0.0 if claim.kind == HypothesisKind.NULL else TAIL
            fields.spread_out(places, tiles, *given, tail, field)
    return told
