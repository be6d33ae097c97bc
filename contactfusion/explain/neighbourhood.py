"""A place in the hypothesis space: the part of each source, and where contacts are expected."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE
from contactfusion.explain.moment import View
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import clusters
from contactfusion.integrator.clusters import reach_squared
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.sources import SourceReport
from contactfusion.reason import Reason, Why, millimetres
from contactfusion.rule import Neighbourhood

MOST, MOST_DEAD = 3, 2
"""The most places that are found, and the most of them of contacts that died."""
APART = 2.0
"""The least distance of a place from contacts and other places, in tolerances."""
ORDER: tuple[str, ...] = (
    Why.WITHDRAWN,
    Why.EXPIRED,
    Why.SILENT,
    Why.NEVER_CAME,
    Why.FOUND_NOTHING,
    Why.ELSEWHERE,
)
"""The reasons of missing sources, the best explanation first."""


@dataclass(frozen=True, slots=True)
class Part:
    """The part of one source at a place.

    Attributes:
        source: its name.
        kind: what it stands on.
        likelihood: of its likeliest hypothesis within reach, or of its nearest if none is.
        age: of that hypothesis [s].
        timeout: how long it lives [s].
        voxels: number of voxels within reach with its hypotheses; 0: only its spread reaches here.
        spread: the standard deviation of that hypothesis's place [m], 0 if the source gave none.
        away: how far from the place that hypothesis lies [m].
        share: of the contact's likelihood; NaN where there is no contact.
    """

    source: str
    kind: HypothesisKind
    likelihood: float
    age: float
    timeout: float
    voxels: int
    spread: float
    away: float
    share: float = math.nan


def neighbourhood_at(view: View, position: FloatArray, reach: float) -> Neighbourhood:
    """What lies within reach of a place, and the voxel that the place lies in."""
    offsets = np.abs(view.centres - position)
    inside = (offsets**2).sum(axis=1) <= reach**2 + 1e-12
    inside |= (offsets <= 0.5 * view.fusion.field.entries.grid.voxel_size).all(axis=1)
    best = _best(view, inside, position)
    return Neighbourhood(position, reach, inside, best, view.fusion.contacts)


def neighbourhood_of(view: View, number: int) -> Neighbourhood:
    """The voxels of a contact, by its row in the contacts, and those of what it explains."""
    contacts, inside = view.fusion.contacts, view.owners == number
    contact = contacts[number]
    reach = max(view.settings.tolerance, 2.0 * contact.dispersion)
    if not view.fusion.condensation.looks_at_voxels:
        places, own = view.fusion.field.entries.places, view.explained == number
        near = neighbourhood_at(view, contact.position, view.settings.tolerance).inside
        near[places[(view.explained != NONE) & ~own]] = False
        inside |= near
        inside[places[own]] = True
    best = _best(view, inside, contact.position)
    return Neighbourhood(contact.position, reach, inside, best, contacts)


def parts_at(view: View, around: Neighbourhood, heard: Collection[str] = ()) -> list[Part]:
    """The part of each source at a place, likelier first; sources without one are left out.

    A source has a part from further away where it is one of those heard.
    """
    entries, found = view.fusion.field.entries, []
    positions = entries.positions
    parts = zip(entries.by_source, entries.parts(around.inside), strict=True)
    for (_, own), (source, rows) in parts:
        if own.stop == own.start or not (len(rows) or source.name in heard):
            continue
        columns = entries.columns
        away = np.linalg.norm(positions[own] - around.position, axis=1)
        row = rows[columns.likelihoods[rows].argmax()] if len(rows) else own.start + away.argmin()
        found.append(
            Part(
                source=source.name,
                kind=source.kind,
                likelihood=float(columns.likelihoods[row]),
                age=float(entries.now - columns.stamps[row]) / 1e9,
                timeout=view.settings.timeout(source.name),
                voxels=len(rows),
                spread=float(columns.spreads[row]),
                away=float(away[row - own.start]),
            )
        )
    return sorted(found, key=lambda part: -np.nan_to_num(part.likelihood))


def _best(view: View, wanted: NDArray[np.bool_], position: FloatArray) -> int:
    """The likeliest of the wanted voxels with more than null, of equals the nearest; or `NONE`."""
    rows = np.flatnonzero(wanted & view.fusion.field.entries.counted_voxels)
    if not len(rows):
        return NONE
    likelihoods = np.round(view.fusion.field.likelihoods[rows], 6)
    tops = rows[likelihoods == likelihoods.max()]
    return int(tops[((view.centres[tops] - position) ** 2).sum(axis=1).argmin()])


@dataclass(frozen=True, slots=True)
class Expected:
    """A place where a contact may be expected.

    Attributes:
        position: shape (3,) [m].
        last_contact: the time of the last step that had one there [s]; NaN: not lately.
    """

    position: FloatArray
    last_contact: float = np.nan


def expected_places(view: View) -> list[Expected]:
    """Places where contacts died lately, and where hypotheses came to nothing.

    Returns:
        A few contacts that died, the newest first; then a few places that are no such, evidence
        before prediction, the likeliest first.
    """
    died = [Expected(dead.contact.position, dead.stamp) for dead in view.past.dead(view.stamp)]
    places = _apart(view, died)[:MOST_DEAD]
    hopeless = [Expected(place) for place in _hopeless(view)]
    # what no contact of a set explains is a detection of its own, however near one is
    contacts = not view.fusion.condensation.needs_members
    return (places + _apart(view, hopeless, places, contacts))[:MOST]


def _hopeless(view: View) -> list[FloatArray]:
    """The likeliest voxel of each cluster of hypotheses without a contact, the best first.

    Null alone makes no place: no contact is expected there; nor does support alone that would
    stay under the threshold even with evidence.
    """
    entries, likelihoods = view.fusion.field.entries, view.fusion.field.likelihoods
    evidence, left = np.zeros(len(entries.keys), np.bool_), view.explained == NONE
    for source, own in entries.by_source:
        if source.kind == HypothesisKind.REGULAR:
            evidence[entries.places[own][left[own]]] = True
    wanted = evidence.copy()
    if not view.fusion.condensation.needs_members:
        wanted |= entries.counted_voxels & (likelihoods >= view.fusion.threshold)
    rows = np.flatnonzero(wanted & (view.owners == NONE))
    if not len(rows):
        return []
    config = view.settings.integrator
    reach = reach_squared(config.linking_distance, config.voxel_size)
    labels, _ = clusters.label(entries.keys[rows], reach)
    order = np.lexsort((rows, -np.round(likelihoods[rows], 6), ~evidence[rows]))
    _, first = np.unique(labels[order], return_index=True)
    return list(view.centres[rows[order[np.sort(first)]]])


def _apart(
    view: View, candidates: list[Expected], others: Sequence[Expected] = (), contacts: bool = True
) -> list[Expected]:
    """The places that lie apart from each other, and from every contact unless stated otherwise."""
    taken = [contact.position for contact in view.fusion.contacts]
    owned = np.concatenate([view.centres[view.owners != NONE], np.reshape(taken, (-1, 3))])
    tree = cKDTree(owned[: len(owned) * contacts])
    apart, found = APART * view.settings.tolerance, list(others)
    kept: list[Expected] = []
    for candidate in candidates:
        if len(kept) == MOST:
            break
        near = [np.linalg.norm(candidate.position - place.position) for place in found + kept]
        if tree.query(candidate.position)[0] > apart and all(far > apart for far in near):
            kept.append(candidate)
    return kept


def missing_at(view: View, around: Neighbourhood) -> list[Reason]:
    """Why sources of evidence or support have no part at a place, for each that has none.

    Sources that once reported the place come first.
    """
    entries, reasons = view.fusion.field.entries, []
    for source, rows in entries.parts(around.inside):
        if source.kind != HypothesisKind.NULL and not len(rows):
            reasons.append(_reason(view, around, source.name))
    return sorted(reasons, key=lambda reason: ORDER.index(reason.why))


def nearest_hypotheses(fusion: Fusion, place: FloatArray) -> list[tuple[float, str]]:
    """How far from a place, shape (3,) [m], each source's nearest hypothesis is [m]."""
    entries, found = fusion.field.entries, []
    centres = entries.grid.centres(entries.voxels)
    for source, own in entries.by_source:
        if own.stop > own.start:
            offsets = centres[entries.places[own]] - place
            found.append((float(np.sqrt((offsets**2).sum(axis=1).min())), source.name))
    return sorted(found)


def _reason(view: View, around: Neighbourhood, source: str) -> Reason:
    fusion, timeout = view.fusion, view.settings.timeout(source)
    report = fusion.report.sources[source]
    if math.isnan(report.age):
        return Reason(
            Why.NEVER_CAME, f"{source} has never reported anything{_refused(report)}", source
        )
    values = {"newest_age_s": report.age, "timeout_s": timeout}
    reported = view.past.last_reported(source, around.position, around.reach)
    if reported is not None:
        likelihood, stamp = reported
        age = fusion.field.entries.now / 1e9 - stamp
        values |= {"told_age_s": age, "told_likelihood": likelihood}
        sentence = f"{source} reported {likelihood:.2f} here {age:.2f} s ago"
        if age > timeout:
            since = "" if report.age < age - 1e-6 else ", and nothing came since"
            sentence += f"; its hypotheses live {timeout:g} s{since}"
            return Reason(Why.EXPIRED, sentence, source, values)
        if report.age < age - 1e-6:
            sentence += f", and took it back: {_now(fusion, around, source, report)}"
            return Reason(Why.WITHDRAWN, sentence, source, values)
    if report.age > timeout:
        sentence = f"{source} has been silent for {report.age:.2f} s; its hypotheses live"
        return Reason(Why.SILENT, f"{sentence} {timeout:g} s{_refused(report)}", source, values)
    away = _distance(fusion, around, source)
    why = Why.FOUND_NOTHING if away is None else Why.ELSEWHERE
    if away is not None:
        values["nearest_m"] = away
    return Reason(why, f"{source}: {_now(fusion, around, source, report)}", source, values)


def _now(fusion: Fusion, around: Neighbourhood, source: str, report: SourceReport) -> str:
    """What a source reported last."""
    away = _distance(fusion, around, source)
    notes = f" ({', '.join(report.notes)})" if report.notes else ""
    if away is None:
        return f"{report.age:.2f} s ago it found nothing{notes}"
    return f"its nearest hypothesis now is {millimetres(away)} away{notes}"


def _distance(fusion: Fusion, around: Neighbourhood, source: str) -> float | None:
    away = {name: far for far, name in nearest_hypotheses(fusion, around.position)}
    return away.get(source)


def _refused(report: SourceReport) -> str:
    refused = {"refused": report.invalid, "late": report.late}
    counts = [f"{count} {what}" for what, count in refused.items() if count]
    return f" ({' and '.join(counts)} so far)" if counts else ""
