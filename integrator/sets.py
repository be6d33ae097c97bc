"""The rule `sets`: any number of contacts, each a point, a line or a patch (method §2).

The unknown is a set. A source of several contacts is a list of detections; a source of a single
contact is one detection, and with a force it is the resultant of all contacts. Greedily, as in
matching pursuit: a contact lies where the product of all fields is densest; the detections that it
explains are taken out, and what is left is searched again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import fields
from contactfusion.integrator.detections import LINK, Evidence, clouds_of
from contactfusion.integrator.entries import Entries, Field, Member, Source
from contactfusion.integrator.modes import force_near
from contactfusion.integrator.places import STEP, Basin, Places, Rows, moments
from contactfusion.integrator.posterior import TrustConfig, pushed
from contactfusion.integrator.resultant import Resultant, misfit
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
NEEDLESS = 0.02
"""The factor on the odds of a contact that the resultant of all is explained without."""
FAINT = 0.1
"""What is left is searched while a contact of it could be so probable."""
EVEN = 0.5
"""A contact that is less probable than that takes no part in the resultant."""
TINY = 1e-12
"""A mean normal of a smaller square has no direction."""
MOST = 32
"""No more contacts are searched."""

Taken = Mapping[int, NDArray[np.bool_]]
"""The hypotheses that a contact explains, shape (n,), by the row of their source."""


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
        if (measured := search.resultant()) is not None:
            members = needed(members, measured, self._friction)
        members.sort(key=lambda member: -round(member.contact.likelihood, 6))
        return Field(entries, partial(_by_voxel, entries, members), members=members)


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
        if self._evidence:
            self._places, heard = self._where(surface)
            shape = (len(self._clouds), len(self._places.points))
            self._fields, self._relative = np.zeros(shape), np.zeros(shape)
            self._fits = np.ones(shape)
            self._told, self._null = np.zeros(shape), np.zeros(shape[1])
            self._listen(heard, 1.0 / np.hypot(1.0, friction))

    def _where(self, surface: Surface | None) -> tuple[Places, dict[int, FloatArray]]:
        """The places, and the field of each source of evidence there.

        They are the surface where some evidence exceeds its floor, or the positions of evidence.
        """
        least = self._entries.grid.voxel_size / np.sqrt(12.0)
        if surface is not None and len(surface.points):
            spacing = max(surface.spacing, least)
            narrowest = max(NARROWEST * spacing, least)
            whole = Places.at(surface.points, surface.normals, spacing, narrowest)
            heard = {row: whole.field(each.cloud) for row, each in self._evidence.items()}
            reached = np.zeros(len(surface.points), np.bool_)
            for field in heard.values():
                reached |= (field > self._floor * field.max()) & (field > 0.0)
            if reached.any():
                return whole.where(reached), {row: field[reached] for row, field in heard.items()}
        points = np.concatenate([each.cloud.positions for each in self._evidence.values()])
        variance = min(each.variance for each in self._evidence.values())
        # places hang together as far apart as the hypotheses of a source do
        spacing = LINK / STEP * np.sqrt(variance)
        places = Places.at(points, None, spacing, least)
        return places, {row: places.field(each.cloud) for row, each in self._evidence.items()}

    def _listen(self, heard: Mapping[int, FloatArray], steepest: float) -> None:
        """Work out what each source says of each place.

        Args:
            heard: the fields of evidence, by row.
            steepest: the cosine between a force and the normal at the edge of the friction cone.
        """
        for row, cloud in enumerate(self._clouds):
            if not len(cloud.positions):
                continue
            field = heard[row] if row in heard else self._places.field(cloud)
            if cloud.kind == HypothesisKind.NULL:
                self._null += np.log1p(-(1.0 - self._floor) * np.minimum(field, 1.0))
                continue
            if cloud.force is not None and self._places.normals is not None:
                self._fits[row] = pushed(cloud.force, self._places.normals, steepest)
            self._believe(row, field)

    def _believe(self, row: int, field: FloatArray) -> None:
        """Take a source's field, shape (c,), over its highest; without any it says nothing."""
        self._fields[row] = field
        if highest := field.max(initial=0.0):
            self._relative[row] = field / highest
            self._told[row] = np.log(self._relative[row] + self._floor)
            self._told[row] += np.log(self._fits[row] + self._floor)
            return
        self._relative[row] = self._told[row] = 0.0
        if row in self._evidence:  # none of it is left, or all lies off the surface
            self._evidence[row].left[:] = False

    def members(self) -> list[Member]:
        """The contacts, in the order in which they are found."""
        found: list[Member] = []
        while len(found) < MOST and self._possible() >= FAINT:
            total = self._null + self._told.sum(axis=0)
            basin = self._places.densest(np.exp(total - total.max()))
            taken = self._explained(basin)
            found.append(self._member(basin, taken))
            for row, own in taken.items():
                self._take_out(row, own)
        return found

    def _take_out(self, row: int, taken: NDArray[np.bool_]) -> None:
        """Take hypotheses out of what a source says; `taken` has shape (n,)."""
        each, field, places = self._evidence[row], self._fields[row], self._places
        each.left &= ~taken
        if each.left.any():
            reach = fields.FAR * max(float(np.sqrt(each.cloud.variances.max())), places.narrowest)
            near = places.within(reach, each.cloud.positions[taken])
            field[near] = places.where(near).field(each.cloud_left) if near.any() else 0.0
        else:
            field[:] = 0.0
        self._believe(row, field)

    def resultant(self) -> Resultant | None:
        """What is measured of all contacts together."""
        for row, each in self._evidence.items():
            if each.cloud.force is not None:
                point = each.cloud.positions[each.cloud.likelihoods.argmax()]
                return Resultant(each.cloud.force, point, self._spread(row))
        return None

    def _possible(self) -> float:
        """The probability of a contact by all that is left."""
        missed = [1.0 - each.probability(each.left) for each in self._evidence.values()]
        return 1.0 - float(np.prod(missed))

    def _spread(self, row: int) -> float:
        """How unsure the positions of a source are, by axis [m]."""
        return max(float(np.sqrt(self._evidence[row].variance)), self._places.narrowest)

    def _explained(self, basin: Basin) -> Taken:
        """The hypotheses that a contact explains, with their detections."""
        left = [row for row, each in self._evidence.items() if each.left.any()]
        there = np.ix_(np.array(left), basin.rows)
        fits = (self._relative[there] * self._fits[there]) @ basin.weights
        rows = [row for row, fit in zip(left, fits, strict=True) if fit > EXPLAINED]
        core, sigmas = self._places.points[basin.core], np.sqrt(-2.0 * np.log(EXPLAINED))
        return {
            row: self._evidence[row].around(core, sigmas * self._spread(row))
            for row in rows or [left[int(fits.argmax())]]
        }

    def _member(self, basin: Basin, taken: Taken) -> Member:
        """The contact of a basin, by what it explains."""
        entries, places = self._entries, self._places
        points = places.points[basin.rows]
        area, weights = self._area(basin, taken)
        middle = weights @ places.points[area]
        scatter = moments(places.points[area] - middle, weights)
        lengths, axes = np.linalg.eigh(scatter)
        precision = sum(1.0 / self._spread(row) ** 2 for row in taken)
        is_large = lengths[-1] * precision > LARGE**2
        position = middle if is_large else places.mode(basin)
        normal = None if places.normals is None else basin.weights @ places.normals[basin.rows]
        unsure = np.eye(3) / precision
        if normal is not None and not is_large:  # along the surface a belief is as wide as spreads
            across = np.outer(normal, normal) / max(float(normal @ normal), TINY)
            unsure = across / precision + np.eye(3) * places.spacing**2 / 12.0
        covariance = unsure + (0.0 if is_large else places.moments(basin, position))
        covariance *= np.sqrt(len(taken))
        along = (places.points[area] - position) @ axes[:, -1]
        shares = self._shares(basin, taken)
        reach = 0.5 * STEP * places.spacing
        contact = Contact(
            position=position,
            likelihood=self._existence(basin, taken),
            scatter=scatter,
            covariance=covariance,
            extent=position + np.outer([along.min(), along.max()], axes[:, -1]),
            force=force_near(entries, position, points, 2.0 * reach),
            voxels=len(voxel_downsample(places.points[area], entries.grid)),
            shares={
                source.name: share
                for source, share, counts in zip(
                    entries.sources, shares.tolist(), entries.counted, strict=True
                )
                if counts
            },
            stamp=to_seconds(self._newest(shares)),
            frame=entries.grid.frame,
        )
        for array in (position, scatter, covariance, contact.extent, contact.force):
            array.flags.writeable = False
        names = [source.name for source in entries.sources]
        given = {names[row]: self._evidence[row].probability(own) for row, own in taken.items()}
        return Member(contact, points, basin.weights, normal, reach, given)

    def _existence(self, basin: Basin, taken: Taken) -> float:
        """The probability that a contact exists.

        By what it explains and by the support there, less silence and null: both are missed
        detections, by Bayes.
        """
        missed = 1.0
        for row, own in taken.items():
            missed *= 1.0 - self._evidence[row].probability(own)
        for row, cloud in enumerate(self._clouds):
            if cloud.kind == HypothesisKind.SUPPORT and len(cloud.positions):
                share = float(self._relative[row, basin.rows] @ basin.weights)
                missed *= 1.0 - share * float(cloud.likelihoods.max())
        free = np.exp(self._told[[*taken]][:, basin.rows].sum(axis=0))
        unseen = float(free @ np.exp(self._null[basin.rows]) / free.sum())
        unseen *= float(np.prod([source.misses for source in self._entries.sources]))
        kept = (1.0 - missed) * unseen
        return kept / (missed + kept)

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
            logarithms = np.log(self._relative[several] + self._floor).mean(axis=0)
            agreed = np.exp(logarithms - logarithms[basin.core].max() + self._null)
            best = basin.core[agreed[basin.core].argmax()]
            rows = np.union1d(np.flatnonzero(agreed >= AGREED), best)
            area = self._places.connected(rows, int(best))
            return area, agreed[area] / agreed[area].sum()
        inside = np.isin(basin.rows, basin.core)
        return basin.core, basin.weights[inside] / basin.weights[inside].sum()

    def _shares(self, basin: Basin, taken: Taken) -> FloatArray:
        """How much each source confirms the contact, shape (k,); they sum to 1."""
        added = np.zeros(len(self._clouds))
        for row, cloud in enumerate(self._clouds):
            is_support = cloud.kind == HypothesisKind.SUPPORT and self._relative[row].any()
            if is_support or row in taken:
                told = float(self._told[row, basin.rows] @ basin.weights)
                added[row] = max(told - np.log(self._floor), 0.0)
        if not added.any():  # a force from a place that its line misses
            added[[*taken]] = 1.0
        shares: FloatArray = added / added.sum()
        return shares

    def _newest(self, shares: FloatArray) -> int:
        """The newest stamp of the sources that have a share [ns]."""
        stamps = [
            self._entries.columns.stamps[own].max()
            for share, (_, own) in zip(shares, self._entries.by_source, strict=True)
            if share > 0.0
        ]
        return int(max(stamps))


def needed(members: Sequence[Member], measured: Resultant, friction: float) -> list[Member]:
    """The contacts, those less probable that the resultant of all is explained without.

    Args:
        members: the contacts.
        measured: what is measured of all together.
        friction: coefficient of friction.
    """
    judged, kept = [*members], [*members]
    for member in sorted(members, key=lambda member: member.contact.likelihood):
        if len(kept) == 1:
            break
        others = [other for other in kept if other is not member]
        gain = _misfit(others, measured, friction) - _misfit(kept, measured, friction)
        factor = np.clip(NEEDLESS * np.exp(min(gain / 2.0, 20.0)), NEEDLESS, 1.0 / NEEDLESS)
        exists = member.contact.likelihood
        probability = factor * exists / (1.0 - exists + factor * exists)
        contact = replace(member.contact, likelihood=float(probability))
        judged[judged.index(member)] = replace(member, contact=contact, factor=float(factor))
        if probability < EVEN:
            kept = others
    return judged


def _misfit(members: Sequence[Member], measured: Resultant, friction: float) -> float:
    positions = np.array([member.contact.position for member in members])
    normals = [member.normal for member in members if member.normal is not None]
    return misfit(measured, positions, np.array(normals) if normals else None, friction)


def _by_voxel(entries: Entries, members: Sequence[Member]) -> FloatArray:
    """The probability of the likeliest contact near each voxel's centre, shape (m,)."""
    likelihoods, counted = np.zeros(len(entries.keys)), entries.counted_voxels
    centres = entries.grid.centres(entries.voxels[counted])
    for member in members:
        reach = max(member.reach, entries.grid.voxel_size)
        cells = fields.cell_list(member.places, 2.0 * reach)
        heights = member.weights / member.weights.max() * member.contact.likelihood
        near = fields.heaviest(centres, member.places, cells, heights, reach)
        likelihoods[counted] = np.maximum(likelihoods[counted], near)
    return likelihoods
