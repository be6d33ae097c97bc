"""The rule `posterior`: where one contact is, by a product of the sources' fields with floors.

De Morgan takes likelihoods of one voxel for independent events: sources that are a voxel apart
never meet, and a cloud that describes one contact counts as many. Here each source has a field over
the robot's surface: how well a contact at each place would explain it, as wide as its spreads. The
fields multiply; a floor keeps a source that is wrong from overruling all others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import fields
from contactfusion.integrator.cells import cell_list, heaviest
from contactfusion.integrator.detections import Cloud, clouds_of
from contactfusion.integrator.entries import Entries, Field, Source
from contactfusion.integrator.likelihood_fields import pushed
from contactfusion.integrator.places import TAIL
from contactfusion.integrator.sets import TrustConfig
from contactfusion.rule import Rule, by_sources
from contactfusion.surface import Surface

NARROWEST = 4e-3
"""The least standard deviation of a source [m], about the spacing of a surface's points."""


@dataclass(frozen=True, eq=False)
class Belief:
    """The belief in one contact: its position, and its existence.

    Attributes:
        places: shape (c, 3) [m], in the grid's frame.
        spacing: how far neighbouring places lie apart [m].
        weights: shape (c,), the probability of each place if there is a contact; they sum to 1.
        variances: shape (c,) [m²], by axis, of a contact at each place around it: over a surface 0,
            for there the weights are as wide as the spreads.
        exists: the probability that there is a contact.
        told: shape (k, c), the addend of each source to the logarithm of each weight.
    """

    places: FloatArray
    spacing: float
    weights: FloatArray
    variances: FloatArray
    exists: float
    told: FloatArray

    def within(self, position: FloatArray, reach: float) -> float:
        """The part of the belief that lies within reach [m] of a place, shape (3,) [m]."""
        near = ((self.places - position) ** 2).sum(axis=1) <= reach**2
        return float(self.weights[near].sum())


class BeliefField(Field):
    """The fused likelihoods of `posterior`, and the belief that they come of.

    Args:
        entries: what it was made of.
        belief: where there may be a contact; None without evidence.
    """

    def __init__(self, entries: Entries, belief: Belief | None) -> None:
        nothing = np.zeros(len(entries.keys))
        super().__init__(entries, partial(_by_voxel, entries, belief) if belief else nothing)
        self.belief = belief


def belief_of(field: Field) -> Belief | None:
    """The belief of a field; None without evidence.

    Raises:
        ConfigurationError: another rule than `posterior` fused it.
    """
    if not isinstance(field, BeliefField):
        raise ConfigurationError("'modes' needs the rule 'posterior'", "integrator.condensation")
    return field.belief


class Candidates(NamedTuple):
    """The places where a contact may be.

    Attributes:
        places: shape (c, 3) [m], c > 0 when there is evidence.
        spacing: how far neighbouring places lie apart [m].
        variances: shape (c,) [m²], of a contact at each place around it.
        normals: of the surface there, shape (c, 3); None without it.
        densities: shape (k, c), the field of each source there.
    """

    places: FloatArray
    spacing: float
    variances: FloatArray
    normals: FloatArray | None
    densities: FloatArray


class Posterior(Rule):
    """log w = Σ log(field + floor) tells where, 1 - Π(1 - P) over evidence whether."""

    Config = TrustConfig
    needs_places = True

    def __init__(self, config: TrustConfig) -> None:
        super().__init__(config)
        self._floor = config.floor
        self._steepest = 1.0 / np.hypot(1.0, config.friction)

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """The product of fields, over the surface near evidence, or over the evidence's places."""
        clouds = clouds_of(entries)
        exists = existence(clouds, sources)
        if exists == 0.0:
            return BeliefField(entries, None)
        found = _candidates(clouds, surface, self._floor, entries.grid.voxel_size)
        there = self._logarithms(clouds, found.densities, found.normals)
        total = there.sum(axis=0)
        weights = np.exp(total - total.max())
        exists = self._lowered(clouds, exists, there)
        has_cloud = np.array([[len(cloud.positions) > 0] for cloud in clouds])
        added = np.where(has_cloud, there - np.log(self._floor), 0.0)
        belief = Belief(
            found.places,
            found.spacing,
            weights / weights.sum(),
            found.variances,
            exists,
            added,
        )
        return BeliefField(entries, belief)

    def explain(self, field: Field, row: int) -> str:
        """The probability of any contact, and how the voxel compares to the likeliest place."""
        if (belief := belief_of(field)) is None:
            return by_sources(field, row, _of_support)
        fused = float(field.likelihoods[row])
        return (
            f"P(contact) {belief.exists:.2f} by all evidence, {fused / belief.exists:.0%} as "
            f"likely here as at the likeliest place: {fused:.2f}"
        )

    def _lowered(self, clouds: Sequence[Cloud], exists: float, there: FloatArray) -> float:
        """The probability of a contact, less what null takes from the places of evidence.

        By Bayes; support does not count for whether there is a contact.
        """
        null, evidence = (
            np.array([cloud.kind == kind for cloud in clouds])
            for kind in (HypothesisKind.NULL, HypothesisKind.REGULAR)
        )
        if not null.any():
            return exists
        free = there[evidence].sum(axis=0)
        left = np.exp(free + there[null].sum(axis=0) - free.max()).sum()
        kept = exists * float(left / np.exp(free - free.max()).sum())
        return kept / (1.0 - exists + kept)

    def _logarithms(
        self, clouds: Sequence[Cloud], densities: FloatArray, normals: FloatArray | None
    ) -> FloatArray:
        """The log(field + floor) of each source at each place, shape (k, c).

        A field is relative to its own highest value, so that many hypotheses of a source weigh no
        more than few. Null at a place lowers the weight of a contact there by as much as a floor:
        a likelihood, no veto. The force of one contact pushes into the surface, within the cone of
        friction: that is a second field of its source, with a floor of its own.
        """
        logarithms = np.zeros_like(densities)
        for row, (cloud, field) in enumerate(zip(clouds, densities, strict=True)):
            if cloud.kind == HypothesisKind.NULL:
                logarithms[row] = np.log1p(-(1.0 - self._floor) * np.minimum(field, 1.0))
            elif len(cloud.positions):
                highest = float(field.max(initial=np.finfo(np.float64).tiny))
                logarithms[row] = np.log(field / highest + self._floor)
                if cloud.force is not None and normals is not None:
                    logarithms[row] += np.log(
                        pushed(cloud.force, normals, self._steepest) + self._floor
                    )
        return logarithms


def _of_support(given: Sequence[float], fused: float) -> str:
    return f"posterior of {', '.join(f'{p:.2f}' for p in given)} = {fused:.2f}"


def _by_voxel(entries: Entries, belief: Belief) -> FloatArray:
    """The likelihood of the likeliest place within a side of each voxel's centre, shape (m,)."""
    likelihoods, counted = np.zeros(len(entries.keys)), entries.counted_voxels
    side, heights = entries.grid.voxel_size, belief.weights / belief.weights.max()
    cells = cell_list(belief.places, 2.0 * side)
    centres = entries.grid.centres(entries.voxels[counted])
    near = heaviest(centres, belief.places, cells, heights, side)
    likelihoods[counted] = belief.exists * near
    return likelihoods


def existence(clouds: Sequence[Cloud], sources: Sequence[Source]) -> float:
    """The probability that there is a contact at all, by evidence alone.

    e = 1 - Π(1 - P) over Regular sources, P = Σp for one that describes a single contact, else the
    largest p. Sources that found nothing and would have detected a contact lower it by Bayes: with
    μ the probability that all of them miss one, it becomes e μ / (1 - e + e μ).
    """
    missed = silent = 1.0
    for cloud, source in zip(clouds, sources, strict=True):
        if not len(cloud.positions):
            silent *= source.misses
        elif cloud.kind == HypothesisKind.REGULAR:
            total = cloud.likelihoods.sum() if cloud.single else cloud.likelihoods.max()
            missed *= 1.0 - min(float(total), 1.0)
    kept = (1.0 - missed) * silent
    return kept / (missed + kept) if kept else 0.0


def _candidates(
    clouds: Sequence[Cloud], surface: Surface | None, floor: float, side: float
) -> Candidates:
    """The places where a contact may be, and the field of each source over them.

    They are the points of the surface at which some evidence exceeds its floor; without any, the
    positions of evidence: then each is as uncertain as its hypothesis, and neighbours are a
    voxel apart, `side` [m].
    """
    evidence = [cloud.kind == HypothesisKind.REGULAR for cloud in clouds]
    if surface is not None and len(surface.points):
        densities = _fields(clouds, surface.points, evidence)
        highest = densities.max(axis=1, keepdims=True)
        reached = ((densities > floor * highest) & (highest > 0.0)).any(axis=0)
        if reached.any():
            places = surface.points[reached]
            others = [not is_evidence for is_evidence in evidence]
            densities = densities[:, reached] + _fields(clouds, places, others)
            exact = np.zeros(len(places))  # the fields are as wide as the spreads
            return Candidates(places, surface.spacing, exact, surface.normals[reached], densities)
    regular = [cloud for cloud in clouds if cloud.kind == HypothesisKind.REGULAR]
    places = np.concatenate([cloud.positions for cloud in regular])
    variances = np.concatenate([cloud.variances for cloud in regular])
    return Candidates(places, side, variances, None, _fields(clouds, places, [True] * len(clouds)))


def _fields(clouds: Sequence[Cloud], places: FloatArray, wanted: Sequence[bool]) -> FloatArray:
    """The fields of some sources, shape (k, c); 0 for the others."""
    densities = np.zeros((len(clouds), len(places)))
    tiles = cell_list(places, fields.TILE)
    for cloud, field, is_wanted in zip(clouds, densities, wanted, strict=True):
        if is_wanted:
            variances = np.maximum(cloud.variances, NARROWEST**2)
            given = (cloud.positions, cloud.likelihoods, variances, cloud.single)
            tail = 0.0 if cloud.kind == HypothesisKind.NULL else TAIL
            fields.kernel_density(places, tiles, *given, tail, field)
    return densities


@hookimpl
def contactfusion_rules() -> Mapping[str, type[Rule]]:
    """Offer the rule."""
    return {"posterior": Posterior}
