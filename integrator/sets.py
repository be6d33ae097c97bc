"""The rule `sets`: any number of contacts, each a point, a line or a patch (method §2).

The unknown is a set. A source of several contacts is a list of detections; a source of a single
contact is one detection, and with a force it is the resultant of all contacts. Greedily, as in
matching pursuit: a contact lies where the product of all fields is densest; the detections that it
explains are taken out, and what is left is searched again.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from pydantic import Field as FieldOf

from contactfusion.arrays import FloatArray
from contactfusion.integrator.detections import CERTAIN
from contactfusion.integrator.entries import Entries, Field, Member, Source
from contactfusion.integrator.estimates import estimate
from contactfusion.integrator.likelihood_fields import APART, LikelihoodFields, product
from contactfusion.integrator.members import FAINT, by_voxel, described_in
from contactfusion.integrator.places import Basin
from contactfusion.integrator.resultant import (
    Superposition,
    centred,
    measured,
    missing,
    needed,
    shared,
)
from contactfusion.model import Model
from contactfusion.rule import Rule
from contactfusion.surface import Surface

IDLE = 1e-4
"""Places that are less likely than that part of the likeliest are as good as none."""
MOST = 32
"""No more contacts are searched."""


class TrustConfig(Model):
    """How far sources are trusted."""

    floor: float = FieldOf(default=0.01, ge=1e-6, lt=1)
    """What a source leaves to places that it does not believe in, as a part of its highest."""
    friction: float = FieldOf(default=0.5, gt=0)
    """The coefficient of friction of contacts whose force is known."""


class Sets(Rule):
    """The contacts of a set one by one, each with its probability of existence (method §2)."""

    Config = TrustConfig
    finds_members = True
    needs_places = True

    def __init__(self, config: TrustConfig) -> None:
        super().__init__(config)
        self._floor, self._friction = config.floor, config.friction

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """The contacts over the surface near evidence, or over the evidence's positions."""
        search = Search(entries, surface, self._floor, self._friction)
        members = search.members()
        sums = [*search.sums.values()]
        if members:
            if len(sums) > 1:  # what is explained least is asked first, whatever its name
                sums.sort(key=lambda sum_of: -round(sum_of.left(members), 6))
            for sum_of in sums:
                members = needed(members, sum_of)
            for sum_of in sums:
                members += missing(members, sum_of, entries)
            for sum_of in sums:
                members = shared(members, sum_of)
        members = centred(members, sums)
        members.sort(key=lambda member: -round(member.contact.likelihood, 6))
        return Field(entries, partial(by_voxel, entries, members), members=members)

    def explain(self, field: Field, row: int) -> str:
        """The most probable contact near a voxel."""
        return described_in(field, row)


class Search:
    """The search for contacts in what all sources say.

    Args:
        entries: all live entries.
        surface: of the robot, or None.
        floor: what a source leaves to places that it does not believe in.
        friction: coefficient of friction.

    Attributes:
        sums: what is measured of all contacts together, by the row of its source.
    """

    def __init__(
        self, entries: Entries, surface: Surface | None, floor: float, friction: float
    ) -> None:
        self._fields, self._floor = LikelihoodFields(entries, surface, floor, friction), floor
        fields = self._fields
        self.sums = dict[int, Superposition]()
        for row, source in enumerate(entries.sources if fields.evidence else ()):
            own = fields.evidence.get(row)
            spread = fields.spread(row) if own else 0.0
            if found := measured(source, fields.clouds[row], spread):
                sure = CERTAIN if own is None or source.resultant else own.probability(own.left)
                given = source.name, found, surface, fields.places.narrowest, friction, sure
                self.sums[row] = Superposition(*given)

    def members(self) -> list[Member]:
        """The contacts, in the order in which they are found.

        Where a sum over them is measured, and sources of a single contact detect some, each is
        looked for once more beside the others.
        """
        if not self._fields.evidence:
            return []
        found = self._found(())
        if (
            self.sums
            and len(found) > 1
            and any(self._fields.is_vague(self._rows_of(member)) for _, member in found)
        ):
            self._fields.restore()
            found = self._found([member for _, member in found])
        self._fields.restore()
        summed = self._fields.entries_of(self._summed)
        return [
            replace(
                member,
                explains=np.append(member.explains, summed),
                covered_by=self._covering(basin, member),
            )
            for basin, member in self._fewest(found)
        ]

    def _covering(self, basin: Basin, member: Member) -> frozenset[str]:
        """The sources that agree with a contact beside those whose detections it explains."""
        others = [row for row in self._fields.evidence if row not in self._rows_of(member)]
        agreeing = [row for row in others if self._fields.agrees(row, basin)]
        return frozenset(self._fields.entries.sources[row].name for row in agreeing)

    def _found(self, before: Sequence[Member]) -> list[tuple[Basin, Member]]:
        """The contacts one by one, beside those found so far and the later ones of before."""
        found: list[tuple[Basin, Member]] = []
        self._summed: dict[int, NDArray[np.bool_]] = {}
        """The detections of several contacts together, by the row of their source."""
        while len(found) < MOST and self._fields.possible() >= FAINT:
            beside = [*(member for _, member in found), *before[len(found) + 1 :]]
            weights = self._weights(beside)
            basin = self._fields.places.densest(weights / weights.max())
            taken = self._fields.explained(basin)
            if self._fields.is_vague(taken):
                rest = [row for row in self._fields.rows_left if row not in taken]
                if rest:  # what it does not explain does not locate it
                    weights = self._weights(beside, rest)
                    basin = self._fields.places.densest(weights / weights.max())
                borne = self._borne(taken)
                if borne[basin.core].all():  # nor on links of which none of them tells
                    weights *= borne
                basin = self._fields.places.anywhere(basin, weights)
            hidden = self._fields.hide_rivals(taken)
            if hidden:
                within = np.zeros(len(weights))
                within[basin.rows] = self._weights(beside)[basin.rows]
                if highest := within.max():
                    basin = self._fields.places.densest(within / highest)
            found.append((basin, estimate(self._fields, basin, taken)))
            self._fields.put_back(hidden)
            for row, own in taken.items():
                self._fields.take_out(row, own)
            link = found[-1][1].link
            for row, each in self._fields.evidence.items():  # beside this one, it tells of a sum
                tells = each.cloud.force is not None and each.left.any()
                if tells and self.sums[row].carried[link]:
                    self._summed[row] = each.left.copy()
                    self._fields.take_out(row, self._summed[row])
        return found

    def _weights(self, beside: Sequence[Member], without: Sequence[int] = ()) -> FloatArray:
        """How well the next contact would explain all that is left, at each place, shape (c,).

        Args:
            beside: other contacts, that take part in what is measured of all together.
            without: the rows of sources of evidence that do not count.
        """
        fields = self._fields
        rows = [row for row in fields.rows_left if row not in without]
        sought = np.flatnonzero(fields.sought(rows))
        factors = np.delete(fields.factors, without, axis=0) if without else fields.factors
        whole, weights = product(factors[:, sought]), np.zeros(len(fields.seen))
        weights[sought] = whole * fields.seen[sought]
        if not weights.any():  # all of it is where hundreds of sources see nothing
            weights[sought] = whole
        is_vague = any(fields.clouds[row].single for row in rows)
        for sum_of in self.sums.values() if beside and is_vague else ():
            self._weigh(weights, sum_of, beside)
        return weights

    def _fewest(self, found: Sequence[tuple[Basin, Member]]) -> list[tuple[Basin, Member]]:
        """The contacts without those whose detections another one may explain.

        So is what a finger feels without a place that of the contact which its skin locates.
        """
        kept = dict(enumerate(found))
        for number, (_, member) in enumerate(found):
            rows = self._rows_of(member)
            if len(kept) == 1 or not self._fields.is_vague(rows):
                continue
            fits = {
                other: min(self._fields.agreement(row, basin) for row in rows)
                for other, (basin, _) in kept.items()
                if other != number
            }
            best = max(fits, key=lambda other: fits[other])
            if fits[best] > APART:
                del kept[number]
                basin, other = kept[best]
                missed = np.prod([1.0 - each for each in member.given.values()])
                likelihood = 1.0 - (1.0 - other.contact.likelihood) * float(missed)
                contact = replace(other.contact, likelihood=likelihood)
                given = {**other.given, **member.given}
                explains = np.append(other.explains, member.explains)
                kept[best] = basin, replace(other, contact=contact, given=given, explains=explains)
        return [*kept.values()]

    def _borne(self, rows: Iterable[int]) -> NDArray[np.bool_]:
        """Where a contact takes part in what one of some sources measures, shape (c,)."""
        links = self._fields.places.links
        borne = np.zeros(len(links), np.bool_)
        for row in rows:
            borne |= self.sums[row].carried[links] if row in self.sums else True
        return borne

    def _rows_of(self, member: Member) -> list[int]:
        """The rows of the sources of a contact."""
        return [self._fields.rows[name] for name in member.given]

    def _weigh(self, weights: FloatArray, sum_of: Superposition, found: Sequence[Member]) -> None:
        """Multiply weights (c,) by how well a contact there explains a sum beside those found."""
        found, normals = sum_of.borne(found), self._fields.places.normals
        rows = np.flatnonzero(weights > IDLE * weights.max())
        rows = rows[sum_of.carried[self._fields.places.links[rows]]]
        if not found or not len(rows):
            return
        across = None if normals is None else normals[rows]
        maps = sum_of.maps(self._fields.places.points[rows], across)
        gains = sum_of.gains(maps, sum_of.maps_of(found))
        weights[rows] *= np.exp(gains - gains.max()) + self._floor
