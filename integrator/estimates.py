"""The estimate of a contact of a set: where it lies, how large it is, how probably it exists."""

import math
from collections.abc import Mapping

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE, Contact
from contactfusion.integrator.detections import CERTAIN
from contactfusion.integrator.entries import Entries, Member
from contactfusion.integrator.kernels import EDGE
from contactfusion.integrator.likelihood_fields import SURE, LikelihoodFields, Taken
from contactfusion.integrator.nearby import Rows
from contactfusion.integrator.places import BASIN, Basin, moments
from contactfusion.thinning import voxel_downsample
from contactfusion.time import to_seconds

AGREED = 0.3
"""Connected places where sources of several contacts agree so well are the area of a contact."""
LARGE = 2.0
"""A contact is a line or a patch when its area is wider than positions are unsure, by this factor.
"""
NEAR = 3.0
"""A single contact's positions are near a contact up to so many standard deviations from it."""
LEAST = float(np.finfo(np.float64).tiny)
"""No probability or agreement is less: that of hundreds of sources would be none."""

UNIT = np.eye(3)

Given = Mapping[str, float]
"""Numbers by the name of a source."""


def estimate(fields: LikelihoodFields, basin: Basin, taken: Taken) -> Member:
    """The contact of a basin, by the detections that it explains."""
    entries, places = fields.entries, fields.places
    area, weights = _area(fields, basin, taken)
    points, around = places.points[area], places.points[basin.rows]
    middle = weights @ points
    scatter = moments(points - middle, weights)
    lengths, axes = np.linalg.eigh(scatter)
    precision = sum(1.0 / fields.spread(row) ** 2 for row in taken)
    is_wide, is_vague = lengths[-1] * precision > LARGE**2, fields.is_vague(taken)
    own, size = _size(fields, taken, area)
    if is_wide and not is_vague:
        # points of sources that disagree are no line: its hypotheses are wider than they are unsure
        is_wide = np.linalg.eigvalsh(size)[-1] * precision > 1.0
    is_large = is_wide and not is_vague
    position = middle if is_wide else places.mode(basin)
    normal = places.normal(basin)
    if is_large or normal is None:
        covariance = UNIT * np.sqrt(len(taken)) / precision
    else:  # along the surface a belief is as wide as spreads
        across = normal[:, None] * normal / float(normal @ normal)
        covariance = across * places.narrowest**2 + UNIT * places.spacing**2 / 12.0
    if not is_large:
        covariance += places.moments(basin, position)
    extent = np.array((position, position))
    if not is_vague:  # otherwise the area is where it may lie, not how large it is
        along = np.append((own - position) @ axes[:, -1], 0.0)  # its position is among them
        extent += np.array(((along.min(),), (along.max(),))) * axes[:, -1]
        scatter = size if is_large else scatter
    shares, reach = _shares(fields, basin, taken), float(places.reaches[basin.rows].max())
    likelihood, given, factors = _existence(fields, basin, taken)
    contact = Contact(
        position=position,
        likelihood=likelihood,
        scatter=scatter,
        covariance=covariance,
        extent=extent,
        force=force_near(entries, position, around, 2.0 * reach),
        voxels=len(voxel_downsample(points, entries.grid)),
        shares={
            source.name: share
            for source, share, counts in zip(
                entries.sources, shares.tolist(), entries.counted, strict=True
            )
            if counts
        },
        stamp=to_seconds(int(fields.newest[shares > 0.0].max())),
        frame=entries.grid.frame,
    )
    for array in (position, scatter, covariance, extent, contact.force):
        array.flags.writeable = False
    weights = basin.weights
    if is_large:  # the basin is where its middle may be
        around = places.points[np.union1d(basin.rows, area)]
        weights = np.full(len(around), 1.0 / len(around))
    explains = fields.entries_of(taken)
    centres = _centres(fields, basin, taken) if len(taken) > 1 else {}
    lies = contact, around, weights, normal, reach, int(places.links[basin.top])
    return Member(*lies, given, factors, explains, is_large, centres)


def _existence(fields: LikelihoodFields, basin: Basin, taken: Taken) -> tuple[float, Given, Given]:
    """The probability that a contact exists, those by what it explains, and others' factors.

    By what it explains and by the support there, less silence and null: both are missed
    detections, by Bayes.
    """
    names, factors = [*fields.rows], dict[str, float]()
    given = {names[row]: fields.evidence[row].probability(own) for row, own in taken.items()}
    missed = min(math.prod(1.0 - each for each in given.values()), 1.0 - EDGE)
    missed = max(missed, LEAST)
    odds = (1.0 - missed) / missed
    for row, highest in fields.supports.items():
        wrong = 1.0 - min(highest, CERTAIN) * fields.supported(row, basin)
        factors[names[row]] = (1.0 - missed * wrong) / (wrong * (1.0 - missed))
        missed *= wrong
    # over where its own sources see it, so that the surer null is, the less is left
    belief, rows, top = fields.product(taken), basin.core, NONE
    for _ in range(2):  # null may have moved the core away from the top of the belief
        start, top = top, int(rows[belief[rows].argmax()])
        if top != start:
            rows = fields.places.connected(belief, BASIN * belief[top], top)
    if fields.is_vague(taken):  # it may lie elsewhere, too
        rows = np.flatnonzero(belief >= BASIN * belief.max())
    left = belief[rows]
    for row, free in fields.free.items():
        before, left = left, np.maximum(left * free[rows], LEAST)
        factors[names[row]] = float(left.sum() / before.sum())
    silent = [source for source in fields.entries.sources if source.misses < 1.0]
    factors |= {source.name: max(source.misses, EDGE) for source in silent}
    odds *= math.prod(factors.values())
    return odds / (1.0 + odds) if odds < math.inf else 1.0, given, factors


def _area(fields: LikelihoodFields, basin: Basin, taken: Taken) -> tuple[Rows, FloatArray]:
    """The area of a contact as rows of places, and the weight of each; they sum to 1.

    Where those sources agree that detect several contacts, and are sure; those of a single one
    only locate it. Where these agree nowhere it is the core.
    """
    several = [
        row
        for row, own in taken.items()
        if not fields.clouds[row].single and fields.evidence[row].probability(own) >= SURE
    ]
    if several:
        together, core = fields.product(several), basin.core
        highest = (together[core] * fields.agreeing(several, core)).max()
        least = max(AGREED ** len(several) * highest, LEAST)
        likely = np.flatnonzero(together >= least)
        together[likely] *= fields.agreeing(several, likely)
        if fields.free:
            together = together * fields.seen ** len(several)
        best = core[together[core].argmax()]
        if highest > 0.0:
            area = fields.places.connected(together, least, int(best))
            agreed = together[area] ** (1.0 / len(several))
            return area, agreed / agreed.sum()
    inside = np.isin(basin.rows, basin.core)
    return basin.core, basin.weights[inside] / basin.weights[inside].sum()


def _size(fields: LikelihoodFields, taken: Taken, area: Rows) -> tuple[FloatArray, FloatArray]:
    """The positions that are strongest somewhere in an area, shape (n, 3) [m], and their scatter.

    The area itself is wider, as far as positions are unsure.
    """
    found, scatter, precision = [np.empty((0, 3))], np.zeros((3, 3)), LEAST
    for row in taken:
        cloud = fields.clouds[row]
        if cloud.single or not len(which := fields.strongest(row, area)):
            continue
        positions, likelihoods = cloud.positions[which], cloud.likelihoods[which]
        weights = likelihoods / likelihoods.sum()
        trusted = 1.0 / fields.spread(row) ** 2
        scatter += trusted * moments(positions - weights @ positions, weights)
        precision += trusted
        found.append(positions)
    return np.concatenate(found), scatter / precision


def _centres(
    fields: LikelihoodFields, basin: Basin, taken: Taken
) -> dict[str, tuple[FloatArray, float]]:
    """Where each source alone locates a contact, and how unsure that is, by axis [m].

    Of a source of a single contact, that is near the basin: its line of force may go on.
    """
    names, found = [*fields.rows], dict[str, tuple[FloatArray, float]]()
    for row, own in taken.items():
        cloud, spread = fields.clouds[row], fields.spread(row)
        kept = own[fields.evidence[row].labels]
        if cloud.single:
            core = fields.places.points[basin.core] - basin.mean
            reach = NEAR * spread + float(np.sqrt(np.square(core).sum(axis=1).max()))
            kept = np.square(cloud.positions - basin.mean).sum(axis=1) <= reach**2
        if kept.any():
            weights = cloud.likelihoods[kept] / cloud.likelihoods[kept].sum()
            centre = weights @ cloud.positions[kept]
            scatter = weights @ np.square(cloud.positions[kept] - centre)
            found[names[row]] = centre, float(np.sqrt(spread**2 + scatter.max()))
    return found


def _shares(fields: LikelihoodFields, basin: Basin, taken: Taken) -> FloatArray:
    """How much each source confirms the contact, shape (k,); they sum to 1."""
    added, rows = np.zeros(len(fields.clouds)), np.array([*taken, *fields.supports])
    confirmed = np.log(fields.factors[rows[:, None], basin.rows]) @ basin.weights
    added[rows] = np.maximum(confirmed, 0.0)
    if not added.any():  # a force from a place that its line misses
        added[[*taken]] = 1.0
    shares: FloatArray = added / added.sum()
    return shares


def force_near(
    entries: Entries, position: FloatArray, around: FloatArray, reach: float
) -> FloatArray:
    """The force of the voxel nearest to a contact, shape (3,) [N]; NaN: none is measured there.

    Args:
        entries: what was fused.
        position: of the contact, shape (3,) [m].
        around: shape (b, 3) [m], the places that belong to it.
        reach: the greatest distance of a force from these [m].
    """
    rows, centres = entries.felt
    if not len(rows):
        return np.full(3, np.nan)
    nearest = int(((centres - position) ** 2).sum(axis=1).argmin())
    if ((around - centres[nearest]) ** 2).sum(axis=1).min() > reach**2:
        return np.full(3, np.nan)
    return np.asarray(entries.forces_in(rows[nearest : nearest + 1])[0])
