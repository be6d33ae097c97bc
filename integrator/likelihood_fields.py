"""Likelihood fields: how well a contact at each place explains what each source says.

Detections that a contact explains are taken out, so that what is left can be searched again.
"""

import functools
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import fields
from contactfusion.integrator.detections import LINK, Evidence, clouds_of
from contactfusion.integrator.entries import Entries
from contactfusion.integrator.fields import WIDER
from contactfusion.integrator.nearby import Rows, labelled
from contactfusion.integrator.places import TAIL, Basin, Places, SourceField
from contactfusion.integrator.store import Int64Array, rasterise
from contactfusion.surface import Surface
from contactfusion.thinning import voxel_downsample

NARROWEST = 0.8
"""The least standard deviation of a hypothesis over a surface, in spacings of its points."""
HIDDEN = 1e-30
"""However many sources see nothing at a place, that much is left of it."""
SURE = 0.5
"""A source that is so sure of a contact tells its area."""
EXPLAINED = 0.1
"""A contact explains a detection whose field has this part of its highest there."""
APART = TAIL * float(np.exp(-0.5 * (LINK / WIDER) ** 2))
"""Likewise one by a source of several contacts that is sure: up to `LINK` standard deviations away.
What an unsure source says so far away is more likely clutter, and what a source of a single contact
says may fit another contact better: that is decided when all are found."""
FAR_OFF = float(np.exp(-4.5))
"""A prediction whose field is lower near evidence, in parts of its highest, lies elsewhere."""
MANY = 4_000_000
"""Without a surface, sources times places from which places of different sources that lie in one
voxel are one: otherwise a step would grow with the square of the number of sources."""
SOFT = 0.15
"""Softness of the edge of the friction cone, in cosines of the angle to the normal."""

Taken = Mapping[int, NDArray[np.bool_]]
"""The detections that a contact explains, shape (d,), by the row of their source."""
Hidden = Mapping[int, tuple[SourceField, NDArray[np.bool_]]]
"""The field of a source, and which detections were left, shape (d,), by its row."""


class LikelihoodFields:
    """The field of each source over the places where a contact may be.

    Args:
        entries: all live entries.
        surface: of the robot, or None.
        floor: what a source leaves to places that it does not believe in.
        friction: coefficient of friction.

    Attributes:
        clouds: the hypotheses of each source.
        evidence: what each source of evidence says, by row.
        rows: the row of each source by its name.
        places: where a contact may be; with evidence, as are all that follow.
        factors: shape (k, c), of each source on the weight of each place.
        seen: shape (c,), that of all that is null.
        free: that of each that is null, by row.
        supports: the largest likelihood of each support that lies near, by row.
    """

    def __init__(
        self, entries: Entries, surface: Surface | None, floor: float, friction: float
    ) -> None:
        self.entries, self._floor = entries, floor
        self.clouds, side = clouds_of(entries), entries.grid.voxel_size
        shared = entries.shared
        self.evidence = {
            row: Evidence(self.clouds[row], shared[own], side)
            for row, (source, own) in enumerate(entries.by_source)
            if source.kind == HypothesisKind.REGULAR and own.stop > own.start
        }
        self.rows = {source.name: row for row, source in enumerate(entries.sources)}
        if self.evidence:
            self.places, self._whole = self._where(surface)
            self._fields = [each.copy() for each in self._whole]
            self._listen(1.0 / np.hypot(1.0, friction))

    def _where(self, surface: Surface | None) -> tuple[Places, list[SourceField]]:
        """The places, and the field of each source there.

        They are the surface where some evidence exceeds its floor, or the positions of evidence.
        """
        least = self.entries.grid.voxel_size / np.sqrt(12.0)
        if surface is not None and len(surface.points):
            spacing = max(surface.spacing, least)
            narrowest = max(NARROWEST * spacing, least)
            whole = Places.on(surface, slice(None), spacing, narrowest)
            heard = {row: whole.field(each.cloud) for row, each in self.evidence.items()}
            reached = np.zeros(len(surface.points), np.bool_)
            for field in heard.values():
                reached |= field.heights > self._floor * field.heights.max()
            if reached.any():
                near = whole.where(reached)
                return near, [
                    heard[row].where(reached) if row in heard else near.field(cloud)
                    for row, cloud in enumerate(self.clouds)
                ]
        points = np.concatenate([each.cloud.positions for each in self.evidence.values()])
        # places hang together as far apart as the hypotheses of their source do
        reaches = np.concatenate([each.reaches for each in self.evidence.values()])
        if len(self.clouds) * len(points) > MANY:
            rows = voxel_downsample(points, self.entries.grid)
            points, reaches = points[rows], reaches[rows]
        links = np.zeros(len(points), np.int32)
        if surface is not None and len(surface.link_names) > 1 and len(surface.points):
            links = surface.links[surface.nearest(points)[1]]
        places = Places(points, None, 0.0, least, links, reaches)
        return places, [places.field(cloud) for cloud in self.clouds]

    def _listen(self, steepest: float) -> None:
        """Work out what each source says of each place.

        Args:
            steepest: the cosine between a force and the normal at the edge of the friction cone.
        """
        shape = (len(self.clouds), len(self.places.points))
        self.factors, self.seen = np.ones(shape), np.ones(shape[1])
        self.free: dict[int, FloatArray] = {}
        self._explains = np.zeros(shape, np.bool_)
        """Where a contact explains what is left of each source of evidence."""
        self._highest = np.ones(shape[0])
        self.supports: dict[int, float] = {}
        self._fits: dict[int, FloatArray] = {}
        for row, (cloud, field) in enumerate(zip(self.clouds, self._fields, strict=True)):
            if cloud.kind == HypothesisKind.NULL:
                if len(cloud.positions):
                    free = np.maximum(field.heights, self._within(row))
                    self.free[row] = 1.0 - (1.0 - self._floor) * np.minimum(free, 1.0)
                    self.seen = np.maximum(self.seen * self.free[row], HIDDEN)
                continue
            if cloud.force is not None and self.places.normals is not None:
                self._fits[row] = pushed(cloud.force, self.places.normals, steepest)
            if len(cloud.positions):
                self._believe(row)
            if cloud.kind == HypothesisKind.SUPPORT and field.heights.any():
                self.supports[row] = float(cloud.likelihoods.max())

    def _within(self, row: int) -> FloatArray:
        """What a source says of the voxel that each place lies in, shape (c,)."""
        columns, own = self.entries.columns, self.entries.by_source[row][1]
        keys, sought = columns.keys[own], np.empty(len(self.places.points), np.int64)
        rasterise(self.places.points, 1.0 / self.entries.grid.voxel_size, sought)
        at = np.minimum(np.searchsorted(keys, sought), len(keys) - 1)
        return np.asarray(columns.likelihoods[own][at] * (keys[at] == sought), np.float64)

    def _believe(self, row: int) -> None:
        """Take a source's field over its highest; without any it says nothing."""
        heights, factors = self._fields[row].heights, self.factors[row]
        if highest := heights.max(initial=0.0):
            if self.clouds[row].kind == HypothesisKind.SUPPORT:
                highest = max(highest, FAR_OFF * self.clouds[row].likelihoods.max())
            self._highest[row] = highest
            if row in self.evidence:
                np.greater(heights, EXPLAINED * highest, out=self._explains[row])
            np.multiply(heights, 1.0 / (highest * self._floor), out=factors)
            factors += 1.0  # in floors: a product of many sources does not vanish
            if row in self._fits:
                factors *= self._fits[row] + self._floor
            return
        factors[:], self._explains[row] = 1.0, False
        if row in self.evidence:  # none of it is left, or all lies off the surface
            self.evidence[row].left[:] = False

    def product(self, rows: Iterable[int]) -> FloatArray:
        """The product of the factors of some sources, shape (c,); as `product`."""
        return product(self.factors[[*rows]])

    def agreeing(self, rows: Sequence[int], places: Rows) -> NDArray[np.bool_]:
        """At which places all of some sources of several contacts explain what is left."""
        factors = self.factors[np.array(rows)[:, None], places]
        return np.asarray((factors >= 1.0 + APART / self._floor).all(axis=0))

    @property
    def rows_left(self) -> list[int]:
        """The rows of the sources of which detections are left."""
        return [row for row, each in self.evidence.items() if each.left.any()]

    def restore(self) -> None:
        """Take it that no contact explains anything yet."""
        self._fields = [each.copy() for each in self._whole]
        for row, each in self.evidence.items():
            each.left[:] = True
            self._believe(row)

    def sought(self, rows: Iterable[int]) -> NDArray[np.bool_]:
        """Where the surest of what is left of some sources is explained, shape (c,).

        Support alone makes no contact, and much that is faint hides none that is sure.
        """
        sure = {row: self.evidence[row].probability(self.evidence[row].left) for row in rows}
        least = SURE * max(sure.values())
        surest = [row for row, probability in sure.items() if probability >= least]
        return np.asarray(self._explains[surest].any(axis=0))

    def is_vague(self, rows: Iterable[int]) -> bool:
        """Whether each of some sources tells of a single contact."""
        return all(self.clouds[row].single for row in rows)

    def take_out(self, row: int, taken: NDArray[np.bool_]) -> None:
        """Take detections out of what a source says; `taken` has shape (d,)."""
        each, field = self.evidence[row], self._fields[row]
        each.left &= ~taken
        if each.cloud.single or not each.left.any():
            field.heights[:] = 0.0
        else:
            gone = labelled(field.which, each.labels, taken)
            if len(gone):
                widest = float(np.sqrt(each.cloud.variances.max()))
                reach = fields.FAR * max(widest, self.places.narrowest)
                rows = each.around(self.places.points[gone], reach)
                self.places.search(field, gone, each.cloud, rows)
        self._believe(row)

    def possible(self) -> float:
        """The probability of a contact by all that is left."""
        missed = [1.0 - each.probability(each.left) for each in self.evidence.values()]
        return 1.0 - math.prod(missed)

    def spread(self, row: int) -> float:
        """How unsure the positions of a source are, by axis [m]."""
        return max(float(np.sqrt(self.evidence[row].variance)), self.places.narrowest)

    def explained(self, basin: Basin) -> Taken:
        """The detections that a contact explains, by source."""
        left = self.rows_left
        rows = [row for row in left if self.agrees(row, basin)]
        rows = rows or [max(left, key=lambda row: self.agreement(row, basin))]
        if self.places.normals is None and len(rows) < len(left):
            rows = self._joined(rows, left, basin)
        return {row: self._near(row, basin) for row in rows}

    def _joined(self, rows: Sequence[int], left: Sequence[int], basin: Basin) -> list[int]:
        """Of what is left, the rows that agree with a contact where these do on average.

        Without a surface there is no place but where a source has a hypothesis.
        """
        nearest = [self.evidence[row].nearest(basin.mean) for row in rows]
        trusted = [1.0 / self.spread(row) ** 2 for row in rows]
        between = self.places.at(np.average(nearest, axis=0, weights=trusted))
        joined = [*rows]
        for row in left:
            if row not in rows:
                (height,) = between.field(self.evidence[row].cloud_left).heights
                if height > self._least(row) * self._highest[row]:
                    joined.append(row)
        return sorted(joined)

    def _least(self, row: int) -> float:
        """The agreement from which a contact explains what is left of a source."""
        each = self.evidence[row]
        is_sure = not each.cloud.single and each.probability(each.left) >= SURE
        return APART if is_sure else EXPLAINED

    def agrees(self, row: int, basin: Basin) -> bool:
        """Whether a contact explains something of what is left of a source."""
        return self.agreement(row, basin) > self._least(row)

    def agreement(self, row: int, basin: Basin) -> float:
        """How well a source agrees with a contact, at most 1."""
        relative = self._fields[row].heights[basin.rows] / self._highest[row]
        if row in self._fits:
            relative *= self._fits[row][basin.rows]
        return float(relative @ basin.weights)

    def supported(self, row: int, basin: Basin) -> float:
        """How well a prediction agrees with a contact, at most 1.

        That of several contacts by how far from the contact it is; the positions of one contact
        are likelihoods of places beside each other.
        """
        if self.clouds[row].single:
            return self.agreement(row, basin)
        return float(self._fields[row].heights[basin.rows] @ basin.weights) / self.supports[row]

    def strongest(self, row: int, places: Rows) -> Rows:
        """The hypotheses of a source of several contacts that are strongest at some places."""
        strongest = np.zeros(len(self.clouds[row].positions) + 1, np.bool_)  # the last: `NONE`
        strongest[self._fields[row].which[places]] = True
        return np.flatnonzero(strongest[:-1])

    def _near(self, row: int, basin: Basin) -> NDArray[np.bool_]:
        """The detections left of a source near a contact, shape (d,): at least the nearest.

        Of those that it tells apart, such as the presses of a skin, one contact explains one.
        """
        each = self.evidence[row]
        if each.cloud.single:
            return each.left.copy()
        reach = float(np.sqrt(-2.0 * np.log(EXPLAINED))) * self.spread(row)
        found = each.near(self.places.points[basin.core], reach)
        return each.first_of_groups(found, self.places.points[basin.top])

    def hide_rivals(self, taken: Taken) -> Hidden:
        """Take out what sources tell apart from detections, until it is put back."""
        hidden = dict[int, tuple[SourceField, NDArray[np.bool_]]]()
        for row, own in taken.items():
            each = self.evidence[row]
            if (rivals := each.rivals(own)).any():
                hidden[row] = self._fields[row].copy(), each.left.copy()
                self.take_out(row, rivals)
                if not each.left.any():  # what it explains lies off the surface
                    self.put_back({row: hidden.pop(row)})
        return hidden

    def put_back(self, hidden: Hidden) -> None:
        """Put back what was hidden."""
        for row, (field, left) in hidden.items():
            self._fields[row] = field
            self.evidence[row].left[:] = left
            self._believe(row)

    def entries_of(self, taken: Taken) -> Rows:
        """The entries of some detections."""
        rows = [np.empty(0, np.intp)]
        for row, own in taken.items():
            rows.append(self.entries.begin[row] + self.evidence[row].rows_of(own))
        return np.concatenate(rows)

    @functools.cached_property
    def newest(self) -> Int64Array:
        """The newest stamp of each source, shape (k,) [ns]; of one without any 0."""
        stamps = self.entries.columns.stamps
        newest = [stamps[own].max(initial=0) for _, own in self.entries.by_source]
        return np.array(newest, np.int64)


def product(factors: FloatArray) -> FloatArray:
    """The product of factors (k, c) over sources, shape (c,).

    Where so many agree that it is beyond what floats hold, it is in parts of the largest.
    """
    with np.errstate(over="ignore", under="ignore"):
        whole: FloatArray = factors.prod(axis=0)
    if np.isfinite(whole).all() and whole.any():
        return whole
    logarithms = np.log(np.maximum(factors, np.finfo(float).tiny)).sum(axis=0)
    return np.asarray(np.exp(logarithms - logarithms.max()), np.float64)


def pushed(force: FloatArray, normals: FloatArray, steepest: float) -> FloatArray:
    """How well a force fits the friction cone at each place, shape (c,), at most 1.

    Args:
        force: shape (3,) [N], on the robot.
        normals: shape (c, 3), out of the robot.
        steepest: the cosine between the force and the normal at the edge of the cone.
    """
    push = force / np.abs(force).max()
    cosines = normals @ (push / -np.linalg.norm(push))
    beyond = np.maximum(steepest - cosines, 0.0) / SOFT
    fits: FloatArray = np.exp(-0.5 * beyond**2)
    return fits
