"""The force and torque of all contacts together, and what they say of each (method §2).

A wrench is the sum over the contacts, so that what is known of some says where others are. The
force of a contact is unknown: a Gaussian as wide as the force of all, narrower across the normal
where friction is low, and it pushes.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from contactfusion.arrays import FloatArray, frozen
from contactfusion.contacts import Contact
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisKind, Resultant
from contactfusion.integrator.detections import CERTAIN, Cloud, clouds_of
from contactfusion.integrator.entries import Entries, Member, Source
from contactfusion.integrator.kernels import EDGE
from contactfusion.integrator.likelihood_fields import HIDDEN
from contactfusion.integrator.places import Places
from contactfusion.surface import Surface
from contactfusion.thinning import voxel_downsample

LEAST = 0.2
"""Standard deviation of a force of which its source does not state the noise [N]."""
RELATIVE = 0.1
"""Standard deviation of a measured force, as a part of it, beside that of its noise."""
LEVER = 2.0
"""Standard deviation of the lever of a force, in those of the positions of contacts."""
PRESSED = 0.5
"""Standard deviation of the centre of a patch's pressure from its middle, in that of its area."""
STRENGTH = 2.0
"""Standard deviation of the force of a contact, in forces of all together: they may oppose."""
NEEDLESS = 0.02
"""The least factor on the odds of a contact that a sum is explained without."""
EVEN = 0.5
"""A contact that is less probable than that takes no part in a sum."""
RARE = 0.1
"""The odds, before a sum is looked at, of a contact of which only the sum tells."""
DOUBT = 0.05
"""What a prediction, or free space, leaves there to places that it speaks against."""
COARSE = 2.0
"""Such a contact is looked for in steps of so many spacings of the surface."""


class Maps(NamedTuple):
    """What contacts add to a sum.

    Attributes:
        wrenches: shape (c, 6, k), of a unit of each unknown, in standard deviations: of the force
            along each axis, then of the lever of a patch.
        roots: shape (c, 3, k) [N], what a unit of each is of force.
        normals: shape (c, 3), out of the robot; None: forces of any direction.
    """

    wrenches: FloatArray
    roots: FloatArray
    normals: FloatArray | None

    def at(self, rows: Sequence[int]) -> "Maps":
        """Those of some contacts."""
        chosen = np.array(rows, np.intp)
        normals = None if self.normals is None else self.normals[chosen]
        return Maps(self.wrenches[chosen], self.roots[chosen], normals)


class Superposition:
    """A resultant as a sum over contacts.

    Args:
        source: that measures it.
        resultant: of all contacts.
        surface: of the robot, or None.
        deviation: standard deviation of the positions of contacts, by axis [m].
        friction: coefficient of friction.
        sure: the probability of any contact, by its source.
    """

    def __init__(
        self,
        source: str,
        resultant: Resultant,
        surface: Surface | None,
        deviation: float,
        friction: float,
        sure: float = CERTAIN,
    ) -> None:
        self.source, self.surface, self.sure = source, surface, sure
        names = surface.link_names if surface else ("",)
        self.carried = np.array([not resultant.links or each in resultant.links for each in names])
        """Whether contacts on each link of the surface take part, shape (links,)."""
        self.deviation = LEVER * deviation
        strength = float(np.linalg.norm(resultant.force))
        self._by_force = float(np.hypot(resultant.force_deviation, RELATIVE * strength))
        by_torque = float(np.hypot(resultant.torque_deviation, self.deviation * strength))
        self._scale = np.repeat([1.0 / self._by_force, 1.0 / by_torque], 3)
        self._wrench = np.concatenate([resultant.force, resultant.torque]) * self._scale
        self._resultant, self._strength = resultant, STRENGTH * strength
        self._across = min(friction / 2.0, 1.0)
        self._penalty = 0.5 * (self._strength / self._by_force) ** 2

    def maps(self, positions: FloatArray, normals: FloatArray | None) -> Maps:
        """What contacts at some places add.

        Args:
            positions: shape (c, 3) [m].
            normals: shape (c, 3), out of the robot; None: forces of any direction.
        """
        roots = np.broadcast_to(self._strength * np.eye(3), (len(positions), 3, 3))
        if normals is not None:
            along = normals[:, :, None] * normals[:, None, :]
            roots = self._strength * (self._across * np.eye(3) + (1.0 - self._across) * along)
        levers = (positions - self._resultant.origin)[:, :, None]
        torques = np.cross(levers, roots, axis=1)
        wrenches = np.concatenate([roots, torques], axis=1) * self._scale[:, None]
        return Maps(wrenches, roots, normals)

    def maps_of(self, members: Sequence[Member]) -> Maps:
        """What the contacts of a set add; the pressure of a patch has its centre anywhere on it."""
        positions = np.reshape([member.contact.position for member in members], (-1, 3))
        normals = [member.normal for member in members if member.normal is not None]
        if len(normals) < len(members):
            return self.maps(positions, None)
        units = np.reshape(normals, (-1, 3))
        units = units / np.linalg.norm(units, axis=1, keepdims=True)
        maps = self.maps(positions, units)
        if not any(member.is_large for member in members):
            return maps
        levers = np.zeros((len(members), 3, 3))
        for row, member in enumerate(members):
            if member.is_large:
                lengths, axes = np.linalg.eigh(member.contact.scatter)
                levers[row] = PRESSED * axes * np.sqrt(np.maximum(lengths, 0.0))
        turned = self._strength * np.cross(levers, units[:, :, None], axis=1) * self._scale[3]
        free = np.concatenate([np.zeros_like(turned), turned], axis=1)
        roots = np.concatenate([maps.roots, np.zeros_like(maps.roots)], axis=2)
        return Maps(np.concatenate([maps.wrenches, free], axis=2), roots, units)

    def gains(self, tried: Maps, found: Maps) -> FloatArray:
        """By how much a further contact explains the sum better, shape (c,).

        The logarithm of the factor on the probability of what is measured.

        Args:
            tried: what the further contact adds, at each of c places.
            found: what the contacts add that are known.
        """
        inverse = np.linalg.inv(_covariance(found.wrenches))
        left = inverse @ self._wrench
        across = inverse @ tried.wrenches
        gains, forces = self._gains(left[None], across, tried.wrenches)
        pulls = _pulls(forces, tried.normals)
        if found.normals is not None:
            residuals = left - (across @ forces[:, :, None])[:, :, 0]
            pulls += self._all_pull(residuals, found).sum(axis=1)
        return np.asarray(gains - self._penalty * pulls, np.float64)

    def gains_of(self, found: Maps) -> FloatArray:
        """By how much each of some contacts explains the sum better beside the others, shape (c,).

        Args:
            found: what the contacts add.
        """
        wrenches = found.wrenches
        own = wrenches @ np.swapaxes(wrenches, 1, 2)
        whole = _covariance(wrenches)
        inverses = np.linalg.inv(whole - own)
        left = inverses @ self._wrench
        gains, forces = self._gains(left, inverses @ wrenches, wrenches)
        if found.normals is None:
            return gains
        before = self._all_pull(left, found)
        pulls = _pulls(forces, found.normals).sum() - (before.sum(axis=1) - before.diagonal())
        return np.asarray(gains - self._penalty * pulls, np.float64)

    def _gains(
        self, left: FloatArray, across: FloatArray, wrenches: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The gains of contacts that may pull, shape (c,), and their unknowns, shape (c, k)."""
        precisions = np.eye(wrenches.shape[2]) + np.swapaxes(wrenches, 1, 2) @ across
        given = (left[:, None, :] @ wrenches)[:, 0]
        forces = np.linalg.solve(precisions, given[:, :, None])[:, :, 0]
        gains = 0.5 * (given * forces).sum(axis=1) - 0.5 * np.linalg.slogdet(precisions)[1]
        return np.asarray(gains, np.float64), np.asarray(forces, np.float64)

    def _all_pull(self, residuals: FloatArray, found: Maps) -> FloatArray:
        """How much each contact pulls by what is left of the sum, (c, 6), shape (c, k)."""
        assert found.normals is not None
        along = (found.wrenches[:, :, :3] @ found.normals[:, :, None])[:, :, 0]
        return np.asarray(np.square(np.maximum(residuals @ along.T, 0.0)), np.float64)

    def forces(self, found: Maps) -> FloatArray:
        """The likeliest forces of contacts that explain the sum together, shape (c, 3) [N]."""
        left = np.linalg.solve(_covariance(found.wrenches), self._wrench)
        units = left @ found.wrenches
        return np.asarray((found.roots @ units[:, :, None])[:, :, 0], np.float64)

    def left(self, members: Sequence[Member]) -> float:
        """What the contacts that bear the sum leave of it, as `unexplained`."""
        return self.unexplained(self.maps_of(self.borne(members)))

    def unexplained(self, found: Maps) -> float:
        """The sum that contacts leave, as half of χ²."""
        left = np.linalg.solve(_covariance(found.wrenches), self._wrench)
        return 0.5 * float(self._wrench @ left)

    def centre_of_pressure(
        self, position: FloatArray, normal: FloatArray
    ) -> tuple[FloatArray, float] | None:
        """Where on a plane the sum has no torque but about the normal, and its deviation [m].

        Args:
            position: shape (3,), on the plane [m].
            normal: shape (3,), out of the robot.

        Returns:
            Its offset from the position, shape (3,) [m], and the standard deviation along the
            plane; None of a sum that pulls.
        """
        pushes = -float(self._resultant.force @ normal)
        if pushes <= self._resultant.force_deviation:
            return None
        lever = position - self._resultant.origin
        torque = self._resultant.torque - np.cross(lever, self._resultant.force)
        offset = -np.cross(normal, torque) / pushes
        by_force = float(np.linalg.norm(lever + offset)) * self._resultant.force_deviation
        return offset, float(np.hypot(self._resultant.torque_deviation, by_force)) / pushes

    def borne(self, members: Sequence[Member]) -> list[Member]:
        """The contacts of a set that take part in the sum."""
        return [member for member in members if self.carried[member.link]]


def _covariance(wrenches: FloatArray) -> FloatArray:
    """The covariance of a sum of contacts, in that of what is measured, shape (6, 6)."""
    columns = np.swapaxes(wrenches, 0, 1).reshape(6, -1)
    return np.asarray(np.eye(6) + columns @ columns.T, np.float64)


def _pulls(forces: FloatArray, normals: FloatArray | None) -> FloatArray:
    """How much each contact pulls, shape (c,): the square of its force out of the robot."""
    if normals is None:
        return np.zeros(len(forces))
    return np.asarray(np.square(np.maximum((normals * forces[:, :3]).sum(axis=1), 0.0)), np.float64)


def measured(source: Source, cloud: Cloud, spread: float) -> Resultant | None:
    """What evidence measures of all contacts, as it says or by the force of its single contact.

    Args:
        source: that measures.
        cloud: its hypotheses.
        spread: how unsure their positions are, by axis [m].
    """
    if source.kind != HypothesisKind.REGULAR:
        return None
    if source.resultant or cloud.force is None:
        return source.resultant
    point = cloud.positions[cloud.likelihoods.argmax()]
    deviations = LEAST, float(np.linalg.norm(cloud.force)) * spread
    return Resultant(cloud.force, np.zeros(3), point, *deviations)


def needed(members: Sequence[Member], sum_of: Superposition) -> list[Member]:
    """The contacts, those less probable that a sum over them is explained without.

    What only its own source tells of is asked first: along its line it would explain itself.

    Args:
        members: the contacts.
        sum_of: what is measured of all together.
    """
    judged, maps = [*members], sum_of.maps_of(members)
    kept = [row for row, member in enumerate(members) if sum_of.carried[member.link]]
    own = [{*member.given} == {sum_of.source} for member in members]
    gains, least = dict[int, float](), float(np.log(NEEDLESS))
    for row in sorted(kept, key=lambda row: (not own[row], members[row].contact.likelihood)):
        if len(kept) == 1:
            break
        if not gains:
            gains = dict(zip(kept, sum_of.gains_of(maps.at(kept)).tolist(), strict=True))
        factor = float(np.exp(min(max(gains[row], least), -least)))
        exists = members[row].contact.likelihood
        before = exists / max(1.0 - exists, EDGE)
        odds = RARE if own[row] else before
        probability = factor * odds / (1.0 + factor * odds)
        contact = replace(members[row].contact, likelihood=probability)
        factors = {**members[row].factors, sum_of.source: factor * odds / max(before, EDGE)}
        judged[row] = replace(members[row], contact=contact, factors=factors)
        if probability < EVEN:
            kept.remove(row)
            gains.clear()
    return judged


def missing(members: Sequence[Member], sum_of: Superposition, entries: Entries) -> list[Member]:
    """A further contact without which a sum is not explained; none if it is.

    No other evidence speaks for it: it lies where the sum and support agree.

    Args:
        members: the contacts that evidence speaks for.
        sum_of: what is measured of all together.
        entries: what was fused.
    """
    surface = sum_of.surface
    source = sum_of.source  # of what it is not sure of itself, it makes no surer contact
    counted = [
        each
        for each in members
        if each.contact.likelihood >= EVEN or each.given.get(source, CERTAIN) < EVEN
    ]
    known = sum_of.maps_of(sum_of.borne(counted))
    if surface is None or sum_of.unexplained(known) < -np.log(RARE):
        return []
    spacing = COARSE * (surface.spacing or entries.grid.voxel_size)
    rows = np.flatnonzero(sum_of.carried[surface.links])
    if not len(rows):
        return []
    rows = rows[voxel_downsample(surface.points[rows], Grid(entries.grid.frame, spacing))]
    places = Places.on(surface, rows, spacing, spacing)
    weights, free, added = _predicted(places, entries)
    weights *= free
    gains = sum_of.gains(sum_of.maps(places.points, places.normals), known)
    best = gains.max()
    joint = weights * np.exp(gains - best)
    odds = RARE * float(np.exp(min(best, 50.0)) * joint.sum() / weights.sum())
    basin = places.densest(joint / joint.max())
    odds = min(odds, sum_of.sure / (1.0 - sum_of.sure))
    odds *= float(joint[basin.rows].sum() / (joint / free)[basin.rows].sum())
    odds *= math.prod(max(each.misses, EDGE) for each in entries.sources)
    here = float(joint[basin.rows].sum() / joint.sum())
    probability = min(odds / (1.0 + odds), CERTAIN) * here
    position = places.mode(basin)
    confirmed = {name: float(basin.weights @ field[basin.rows]) for name, field in added.items()}
    confirmed[source] = 1.0
    total = sum(confirmed.values())
    contact = Contact(
        position=position,
        likelihood=probability,
        scatter=np.zeros((3, 3)),
        covariance=places.moments(basin, position) + np.eye(3) * sum_of.deviation**2,
        extent=np.stack([position, position]),
        force=np.full(3, np.nan),
        voxels=1,
        shares={
            source.name: confirmed.get(source.name, 0.0) / total
            for source, counts in zip(entries.sources, entries.counted, strict=True)
            if counts
        },
        stamp=max(member.contact.stamp for member in members),
        frame=entries.grid.frame,
    )
    for array in (position, contact.scatter, contact.covariance, contact.extent, contact.force):
        array.flags.writeable = False
    normal = places.normal(basin)
    points, reach = places.points[basin.rows], float(places.reaches[basin.rows].max())
    given, link = {source: probability}, int(places.links[basin.top])
    return [Member(contact, points, basin.weights, normal, reach, link, given)]


def shared(members: Sequence[Member], sum_of: Superposition) -> list[Member]:
    """The contacts, each with its part of a sum where several bear it; their own force otherwise.

    Args:
        members: the contacts.
        sum_of: what is measured of all together.
    """
    probable = [member for member in members if member.contact.likelihood >= EVEN]
    bearing = sum_of.borne(probable)
    if len(bearing) < 2:
        return [*members]
    parts = frozen(sum_of.forces(sum_of.maps_of(bearing)))
    forces = dict(zip(map(id, bearing), parts, strict=True))
    found = []
    for member in members:
        force = forces.get(id(member))
        if force is not None and (
            sum_of.source in member.given or np.isnan(member.contact.force).any()
        ):
            member = replace(member, contact=replace(member.contact, force=force))
        found.append(member)
    return found


def centred(members: Sequence[Member], sums: Sequence[Superposition]) -> list[Member]:
    """The contacts; a line or a patch that alone bears a sum lies at its centre of pressure.

    Args:
        members: the contacts.
        sums: all that is measured of all together.
    """
    probable = [member for member in members if member.contact.likelihood >= EVEN]
    found = []
    for member in members:
        alone = [sum_of for sum_of in sums if [*map(id, sum_of.borne(probable))] == [id(member)]]
        if member.is_large and member.normal is not None and alone:
            contact, centres = _centred(member.contact, member.normal, alone)
            member = replace(member, contact=contact, centres={**member.centres, **centres})
        found.append(member)
    return found


def _centred(
    contact: Contact, normal: FloatArray, sums: Sequence[Superposition]
) -> tuple[Contact, dict[str, tuple[FloatArray, float]]]:
    """A contact where its area and the sums that it bears alone put the centre of its pressure.

    Second, by the source of each sum, where that alone puts it, and how unsure that is [m].
    """
    normal = normal / np.linalg.norm(normal)
    along = np.linalg.svd(normal[None])[2][1:]  # two unit vectors along the plane
    precision = np.linalg.inv(along @ (PRESSED**2 * contact.scatter + contact.covariance) @ along.T)
    weighted, centres = np.zeros(2), {}
    for sum_of in sums:
        if (found := sum_of.centre_of_pressure(contact.position, normal)) is not None:
            offset, deviation = found
            centres[sum_of.source] = contact.position + offset, deviation
            precision = precision + np.eye(2) / deviation**2
            weighted = weighted + along @ offset / deviation**2
    covariance = np.linalg.inv(precision)
    position = contact.position + covariance @ weighted @ along
    across = float(normal @ contact.covariance @ normal) * np.outer(normal, normal)
    both = along.T @ covariance @ along + across
    return replace(contact, position=frozen(position), covariance=frozen(both)), centres


def _predicted(
    places: Places, entries: Entries
) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
    """How likely a contact is at each place by support, what null leaves, and each support.

    All of shape (c,).
    """
    weights, free, added = np.ones(len(places.points)), np.ones(len(places.points)), {}
    for source, cloud in zip(entries.sources, clouds_of(entries), strict=True):
        if cloud.kind == HypothesisKind.REGULAR or not len(cloud.positions):
            continue
        heights = places.field(cloud).heights
        if cloud.kind == HypothesisKind.NULL:
            free = np.maximum(free * (1.0 - (1.0 - DOUBT) * np.minimum(heights, 1.0)), HIDDEN)
        elif heights.any():
            added[source.name] = heights / heights.max() + DOUBT
            weights *= added[source.name]
    return weights, free, added
