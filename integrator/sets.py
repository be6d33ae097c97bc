"""The rule `sets`: any number of contacts, each a point, a line or a patch (method §2).

The unknown is a set. A source of several contacts is a list of detections; a source of a single
contact is one detection, and with a force it is the resultant of all contacts. Greedily, as in
matching pursuit: a contact lies where the product of all fields is densest; the detections that it
explains are taken out, and what is left is searched again.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE, Contact
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import fields
from contactfusion.integrator.detections import CERTAIN, LINK, Evidence, clouds_of
from contactfusion.integrator.entries import Entries, Field, Member, Source
from contactfusion.integrator.kernels import EDGE
from contactfusion.integrator.members import FAINT, by_voxel, told_in
from contactfusion.integrator.modes import force_near
from contactfusion.integrator.nearby import Rows, near
from contactfusion.integrator.places import BASIN, STEP, Basin, Places, SourceField, moments
from contactfusion.integrator.posterior import TrustConfig, pushed
from contactfusion.integrator.resultant import Superposition, measured, missing, needed, shared
from contactfusion.integrator.store import Int64Array, rasterise
from contactfusion.rule import Rule
from contactfusion.surface import Surface
from contactfusion.thinning import voxel_downsample
from contactfusion.time import to_seconds

NARROWEST = 0.8
"""The least standard deviation of a hypothesis over a surface, in spacings of its points."""
AGREED = 0.3
"""Connected places where sources of several contacts agree so well are the area of a contact."""
SURE = 0.5
"""A source that is so sure of a contact tells its area."""
LARGE = 2.0
"""A contact is a line or a patch when its area is wider than positions are unsure, by this factor.
"""
EXPLAINED = 0.1
"""A contact explains a detection whose field has this part of its highest there."""
IDLE = 1e-4
"""Places that are less likely than that part of the likeliest are as good as none."""
TINY = 1e-12
"""A mean normal of a smaller square has no direction."""
MOST = 32
"""No more contacts are searched."""

Given = Mapping[str, float]
"""Numbers by the name of a source."""
Taken = Mapping[int, NDArray[np.bool_]]
"""The detections that a contact explains, shape (d,), by the row of their source."""


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
        for sum_of in search.sums if members else ():
            members = needed(members, sum_of)
            members += missing(members, sum_of, entries)
            members = shared(members, sum_of)
        members.sort(key=lambda member: -round(member.contact.likelihood, 6))
        return Field(entries, partial(by_voxel, entries, members), members=members)

    def explain(self, field: Field, row: int) -> str:
        """The most probable contact near a voxel."""
        return told_in(field, row)


class Search:
    """The search for contacts in what all sources say.

    Args:
        entries: all live entries.
        surface: of the robot, or None.
        floor: what a source leaves to places that it does not believe in.
        friction: coefficient of friction.
    """

    def __init__(
        self, entries: Entries, surface: Surface | None, floor: float, friction: float
    ) -> None:
        self._entries, self._floor = entries, floor
        self._clouds, side = clouds_of(entries), entries.grid.voxel_size
        self._evidence = {
            row: Evidence(self._clouds[row], entries.columns.keys[own], side)
            for row, (source, own) in enumerate(entries.by_source)
            if source.kind == HypothesisKind.REGULAR and own.stop > own.start
        }
        self._rows = {source.name: row for row, source in enumerate(entries.sources)}
        self.sums: list[Superposition] = []
        """What is measured of all contacts together."""
        if self._evidence:
            self._places, self._fields = self._where(surface)
            self._listen(1.0 / np.hypot(1.0, friction))
            spread = {row: self._spread(row) for row in self._evidence}
            self.sums = [
                Superposition(source.name, found, surface, self._places.narrowest, friction)
                for row, source in enumerate(entries.sources)
                if (found := measured(source, self._clouds[row], spread.get(row, 0.0)))
            ]

    def _where(self, surface: Surface | None) -> tuple[Places, list[SourceField]]:
        """The places, and the field of each source there.

        They are the surface where some evidence exceeds its floor, or the positions of evidence.
        """
        least = self._entries.grid.voxel_size / np.sqrt(12.0)
        if surface is not None and len(surface.points):
            spacing = max(surface.spacing, least)
            narrowest = max(NARROWEST * spacing, least)
            whole = Places(surface.points, surface.normals, spacing, narrowest)
            heard = {row: whole.field(each.cloud) for row, each in self._evidence.items()}
            reached = np.zeros(len(surface.points), np.bool_)
            for field in heard.values():
                reached |= field.heights > self._floor * field.heights.max()
            if reached.any():
                near = whole.where(reached)
                return near, [
                    heard[row].where(reached) if row in heard else near.field(cloud)
                    for row, cloud in enumerate(self._clouds)
                ]
        points = np.concatenate([each.cloud.positions for each in self._evidence.values()])
        variance = min(each.variance for each in self._evidence.values())
        # places hang together as far apart as the hypotheses of a source do
        places = Places(points, None, LINK / STEP * np.sqrt(variance), least)
        return places, [places.field(cloud) for cloud in self._clouds]

    def _listen(self, steepest: float) -> None:
        """Work out what each source says of each place.

        Args:
            steepest: the cosine between a force and the normal at the edge of the friction cone.
        """
        shape = (len(self._clouds), len(self._places.points))
        self._factors, self._seen = np.ones(shape), np.ones(shape[1])
        """The factor of each source on the weight of each place, and that of all that is null."""
        self._free: dict[int, FloatArray] = {}
        """The factor of each that is null."""
        self._explains = np.zeros(shape, np.bool_)
        """Where a contact explains what is left of each source of evidence."""
        self._highest = np.ones(shape[0])
        self._supports: dict[int, float] = {}
        """The largest likelihood of each support that lies near."""
        self._fits: dict[int, FloatArray] = {}
        for row, (cloud, field) in enumerate(zip(self._clouds, self._fields, strict=True)):
            if cloud.kind == HypothesisKind.NULL:
                if len(cloud.positions):
                    free = np.maximum(field.heights, self._within(row))
                    self._free[row] = 1.0 - (1.0 - self._floor) * np.minimum(free, 1.0)
                    self._seen *= self._free[row]
                continue
            if cloud.force is not None and self._places.normals is not None:
                self._fits[row] = pushed(cloud.force, self._places.normals, steepest)
            if len(cloud.positions):
                self._believe(row)
            if cloud.kind == HypothesisKind.SUPPORT and field.heights.any():
                self._supports[row] = float(cloud.likelihoods.max())

    def _within(self, row: int) -> FloatArray:
        """What a source says of the voxel that each place lies in, shape (c,)."""
        columns, own = self._entries.columns, self._entries.by_source[row][1]
        keys, sought = columns.keys[own], np.empty(len(self._places.points), np.int64)
        rasterise(self._places.points, 1.0 / self._entries.grid.voxel_size, sought)
        at = np.minimum(np.searchsorted(keys, sought), len(keys) - 1)
        return np.asarray(columns.likelihoods[own][at] * (keys[at] == sought), np.float64)

    def _believe(self, row: int) -> None:
        """Take a source's field over its highest; without any it says nothing."""
        heights, factors = self._fields[row].heights, self._factors[row]
        if highest := heights.max(initial=0.0):
            self._highest[row] = highest
            if row in self._evidence:
                np.greater(heights, EXPLAINED * highest, out=self._explains[row])
            np.multiply(heights, 1.0 / (highest * self._floor), out=factors)
            factors += 1.0  # in floors: a product of many sources does not vanish
            if row in self._fits:
                factors *= self._fits[row] + self._floor
            return
        factors[:], self._explains[row] = 1.0, False
        if row in self._evidence:  # none of it is left, or all lies off the surface
            self._evidence[row].left[:] = False

    def members(self) -> list[Member]:
        """The contacts, in the order in which they are found.

        Where a sum over them is measured, and sources of a single contact tell of some, each is
        looked for once more beside the others.
        """
        if not self._evidence:
            return []
        heard = [each.copy() for each in self._fields]
        found = self._found(())
        if (
            self.sums
            and len(found) > 1
            and any(self._is_vague(self._rows_of(member)) for _, member in found)
        ):
            self._hear(heard)
            found = self._found([member for _, member in found])
        self._hear(heard)
        members = self._fewest(found)
        told = self._entries_of(self._summed)
        return [replace(each, explains=np.append(each.explains, told)) for each in members]

    def _hear(self, fields_: Sequence[SourceField]) -> None:
        """Take it that no contact explains anything yet."""
        self._fields = [each.copy() for each in fields_]
        for row, each in self._evidence.items():
            each.left[:] = True
            self._believe(row)

    def _found(self, before: Sequence[Member]) -> list[tuple[Basin, Member]]:
        """The contacts one by one, beside those found so far and the later ones of before."""
        found: list[tuple[Basin, Member]] = []
        self._summed: dict[int, NDArray[np.bool_]] = {}
        """The detections that tell of several contacts together, by the row of their source."""
        while len(found) < MOST and self._possible() >= FAINT:
            weights = self._seen * self._factors.prod(axis=0)
            weights[~self._sought()] = 0.0
            beside = [*(member for _, member in found), *before[len(found) + 1 :]]
            is_vague = any(
                each.cloud.single and each.left.any() for each in self._evidence.values()
            )
            for sum_of in self.sums if beside and is_vague else ():
                self._weigh(weights, sum_of, beside)
            basin = self._places.densest(weights / weights.max())
            taken = self._explained(basin)
            if self._is_vague(taken):
                basin = self._places.anywhere(basin, weights)
            found.append((basin, self._member(basin, taken)))
            for row, own in taken.items():
                self._take_out(row, own)
            for row, each in self._evidence.items():  # beside this one, it tells of a sum
                if each.cloud.force is not None and each.left.any():
                    self._summed[row] = each.left.copy()
                    self._take_out(row, self._summed[row])
        return found

    def _sought(self) -> NDArray[np.bool_]:
        """Where the surest of what is left is explained, shape (c,).

        Support alone makes no contact, and much that is faint hides none that is sure.
        """
        sure = {row: each.probability(each.left) for row, each in self._evidence.items()}
        least = SURE * max(sure.values())
        rows = [row for row, probability in sure.items() if probability >= least]
        return np.asarray(self._explains[rows].any(axis=0))

    def _fewest(self, found: Sequence[tuple[Basin, Member]]) -> list[Member]:
        """The contacts without those of which every source may tell of another one.

        So is what a finger feels without a place that of the contact which its skin locates.
        """
        kept = dict(enumerate(found))
        for number, (_, member) in enumerate(found):
            rows = self._rows_of(member)
            if len(kept) == 1 or not self._is_vague(rows):
                continue
            fits = {
                other: min(self._agreement(row, basin) for row in rows)
                for other, (basin, _) in kept.items()
                if other != number
            }
            best = max(fits, key=lambda other: fits[other])
            if fits[best] >= AGREED:
                del kept[number]
                basin, other = kept[best]
                missed = np.prod([1.0 - each for each in member.given.values()])
                likelihood = 1.0 - (1.0 - other.contact.likelihood) * float(missed)
                contact = replace(other.contact, likelihood=likelihood)
                given = {**other.given, **member.given}
                explains = np.append(other.explains, member.explains)
                kept[best] = basin, replace(other, contact=contact, given=given, explains=explains)
        return [member for _, member in kept.values()]

    def _is_vague(self, rows: Iterable[int]) -> bool:
        """Whether each of some sources tells of a single contact."""
        return all(self._clouds[row].single for row in rows)

    def _rows_of(self, member: Member) -> list[int]:
        """The rows of the sources of a contact."""
        return [self._rows[name] for name in member.given]

    def _weigh(self, weights: FloatArray, sum_of: Superposition, found: Sequence[Member]) -> None:
        """Multiply weights (c,) by how well a contact there explains a sum beside those found."""
        found, normals = sum_of.borne(found), self._places.normals
        rows = np.flatnonzero(weights > IDLE * weights.max())
        rows = rows[sum_of.bears(self._places.points[rows])]
        if not found or not len(rows):
            return
        across = None if normals is None else normals[rows]
        maps = sum_of.maps(self._places.points[rows], across)
        gains = sum_of.gains(maps, sum_of.maps_of(found))
        weights[rows] *= np.exp(gains - gains.max()) + self._floor

    def _take_out(self, row: int, taken: NDArray[np.bool_]) -> None:
        """Take detections out of what a source says; `taken` has shape (d,)."""
        each, field = self._evidence[row], self._fields[row]
        each.left &= ~taken
        if each.cloud.single or not each.left.any():
            field.heights[:] = 0.0
        else:
            gone = taken[each.labels[field.which]] & (field.which != NONE)
            if gone.any():
                widest = float(np.sqrt(each.cloud.variances.max()))
                reach = fields.FAR * max(widest, self._places.narrowest)
                rows = each.around(self._places.points[gone], reach)
                self._places.search(field, gone, each.cloud, rows)
        self._believe(row)

    def _possible(self) -> float:
        """The probability of a contact by all that is left."""
        missed = [1.0 - each.probability(each.left) for each in self._evidence.values()]
        return 1.0 - float(np.prod(missed))

    def _spread(self, row: int) -> float:
        """How unsure the positions of a source are, by axis [m]."""
        return max(float(np.sqrt(self._evidence[row].variance)), self._places.narrowest)

    def _explained(self, basin: Basin) -> Taken:
        """The detections that a contact explains, by source."""
        left = [row for row, each in self._evidence.items() if each.left.any()]
        fits = [self._agreement(row, basin) for row in left]
        rows = [row for row, fit in zip(left, fits, strict=True) if fit > EXPLAINED]
        return {row: self._near(row, basin.core) for row in rows or [left[int(np.argmax(fits))]]}

    def _agreement(self, row: int, basin: Basin) -> float:
        """How well a source agrees with a contact, at most 1."""
        relative = self._fields[row].heights[basin.rows] / self._highest[row]
        if row in self._fits:
            relative *= self._fits[row][basin.rows]
        return float(relative @ basin.weights)

    def _near(self, row: int, core: Rows) -> NDArray[np.bool_]:
        """The detections left of a source near a contact, shape (d,): at least the nearest."""
        each = self._evidence[row]
        if each.cloud.single:
            return each.left.copy()
        wanted, points = np.zeros(len(each.left), np.bool_), self._places.points[core]
        reach = float(np.sqrt(-2.0 * np.log(EXPLAINED))) * self._spread(row)
        rows = each.around(points, reach)
        wanted[each.labels[rows[near(each.cloud.positions[rows], points, reach)]]] = True
        if not wanted.any():
            squared = ((each.cloud.positions - points.mean(axis=0)) ** 2).sum(axis=1)
            wanted[each.labels[np.where(each.left[each.labels], squared, np.inf).argmin()]] = True
        return wanted

    def _entries_of(self, taken: Taken) -> Rows:
        """The entries of some detections."""
        rows = [np.empty(0, np.intp)]
        for row, own in taken.items():
            rows.append(self._entries.begin[row] + np.flatnonzero(own[self._evidence[row].labels]))
        return np.concatenate(rows)

    def _member(self, basin: Basin, taken: Taken) -> Member:
        """The contact of a basin, by what it explains."""
        entries, places = self._entries, self._places
        points = places.points[basin.rows]
        area, weights = self._area(basin, taken)
        middle = weights @ places.points[area]
        scatter = moments(places.points[area] - middle, weights)
        lengths, axes = np.linalg.eigh(scatter)
        precision = sum(1.0 / self._spread(row) ** 2 for row in taken)
        is_wide, is_vague = lengths[-1] * precision > LARGE**2, self._is_vague(taken)
        is_large = is_wide and not is_vague
        position = middle if is_wide else places.mode(basin)
        normal = None if places.normals is None else basin.weights @ places.normals[basin.rows]
        covariance = np.eye(3) * np.sqrt(len(taken)) / precision
        if not is_large and normal is not None:  # along the surface a belief is as wide as spreads
            across = np.outer(normal, normal) / max(float(normal @ normal), TINY)
            covariance = across * places.narrowest**2 + np.eye(3) * places.spacing**2 / 12.0
        if not is_large:
            covariance += places.moments(basin, position)
        along = (places.points[area] - position) @ axes[:, -1]
        # the area ends beyond the outermost hypotheses, where their field has fallen to `AGREED`
        beyond = np.sqrt(2.0 * np.log(1.0 / AGREED) * len(taken) / precision)
        ends = np.minimum(along.min() + beyond, 0.0), np.maximum(along.max() - beyond, 0.0)
        if is_vague:  # that is where it may lie, not how large it is
            ends = 0.0, 0.0
        shares = self._shares(basin, taken)
        reach = 0.5 * STEP * places.spacing
        likelihood, given, factors = self._existence(basin, taken)
        contact = Contact(
            position=position,
            likelihood=likelihood,
            scatter=scatter,
            covariance=covariance,
            extent=position + np.outer(ends, axes[:, -1]),
            force=force_near(entries, position, points, 2.0 * reach),
            voxels=len(voxel_downsample(places.points[area], entries.grid)),
            shares={
                source.name: share
                for source, share, counts in zip(
                    entries.sources, shares.tolist(), entries.counted, strict=True
                )
                if counts
            },
            stamp=to_seconds(int(self._stamps[shares > 0.0].max())),
            frame=entries.grid.frame,
        )
        for array in (position, scatter, covariance, contact.extent, contact.force):
            array.flags.writeable = False
        rows, weights = basin.rows, basin.weights
        if is_large:  # the basin is where its middle may be
            rows = np.union1d(rows, area)
            weights = np.full(len(rows), 1.0 / len(rows))
        where, explains = places.points[rows], self._entries_of(taken)
        return Member(contact, where, weights, normal, reach, given, factors, explains)

    def _existence(self, basin: Basin, taken: Taken) -> tuple[float, Given, Given]:
        """The probability that a contact exists, those by what it explains, and others' factors.

        By what it explains and by the support there, less silence and null: both are missed
        detections, by Bayes.
        """
        names, factors = [*self._rows], dict[str, float]()
        given = {names[row]: self._evidence[row].probability(own) for row, own in taken.items()}
        missed = min(float(np.prod([1.0 - each for each in given.values()])), 1.0 - EDGE)
        odds = (1.0 - missed) / missed
        for row, highest in self._supports.items():
            wrong = 1.0 - min(highest, CERTAIN) * self._agreement(row, basin)
            factors[names[row]] = (1.0 - missed * wrong) / (wrong * (1.0 - missed))
            missed *= wrong
        # over where its own sources see it, so that the surer null is, the less is left
        belief = self._factors[[*taken]].prod(axis=0)
        rows = basin.core
        for _ in range(2):  # null may have moved the core away from the top of the belief
            top = int(rows[belief[rows].argmax()])
            rows = self._places.connected(belief, BASIN * belief[top], top)
        if self._is_vague(taken):  # it may lie elsewhere, too
            rows = np.flatnonzero(belief >= BASIN * belief.max())
        left = belief[rows]
        for row, free in self._free.items():
            before, left = left, left * free[rows]
            factors[names[row]] = float(left.sum() / before.sum())
        silent = [source for source in self._entries.sources if source.misses < 1.0]
        factors |= {source.name: max(source.misses, EDGE) for source in silent}
        odds *= float(np.prod([*factors.values()]))
        return odds / (1.0 + odds), given, factors

    def _area(self, basin: Basin, taken: Taken) -> tuple[Rows, FloatArray]:
        """The area of a contact as rows of places, and the weight of each; they sum to 1.

        Where those sources agree that tell of several contacts, and are sure; those of a single one
        only tell where it lies.
        """
        several = [
            row
            for row, own in taken.items()
            if not self._clouds[row].single and self._evidence[row].probability(own) >= SURE
        ]
        if several:
            together = self._factors[several].prod(axis=0)
            least = AGREED ** len(several) * together[basin.core].max()
            together *= self._seen ** len(several)
            best = basin.core[together[basin.core].argmax()]
            area = self._places.connected(together, least, int(best))
            agreed = together[area] ** (1.0 / len(several))
            return area, agreed / agreed.sum()
        inside = np.isin(basin.rows, basin.core)
        return basin.core, basin.weights[inside] / basin.weights[inside].sum()

    def _shares(self, basin: Basin, taken: Taken) -> FloatArray:
        """How much each source confirms the contact, shape (k,); they sum to 1."""
        added, rows = np.zeros(len(self._clouds)), np.array([*taken, *self._supports])
        confirmed = np.log(self._factors[np.ix_(rows, basin.rows)]) @ basin.weights
        added[rows] = np.maximum(confirmed, 0.0)
        if not added.any():  # a force from a place that its line misses
            added[[*taken]] = 1.0
        shares: FloatArray = added / added.sum()
        return shares

    @cached_property
    def _stamps(self) -> Int64Array:
        """The newest stamp of each source, shape (k,) [ns]; of one without any 0."""
        stamps = self._entries.columns.stamps
        newest = [stamps[own].max(initial=0) for _, own in self._entries.by_source]
        return np.array(newest, np.int64)
