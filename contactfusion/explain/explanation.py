"""The explanation of one moment: why there are contacts, and why there is none elsewhere."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE, Contact
from contactfusion.errors import ContactFusionError
from contactfusion.explain.counterfactual import Without, nearest, reach_of, without
from contactfusion.explain.moment import Moment, Settings, View
from contactfusion.explain.neighbourhood import (
    Expected,
    Part,
    expected_places,
    missing_at,
    nearest_hypotheses,
    neighbourhood_at,
    neighbourhood_of,
    parts_at,
)
from contactfusion.explain.reasons import contact_at, explained_at, reasons_at
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.fusion import Fusion
from contactfusion.reason import Reason, Why, millimetres, place_words
from contactfusion.rule import Neighbourhood

MOST = 8
"""The most contacts that are explained in full."""
ROUNDED = 0.005
"""Shares and changes that are smaller are as good as none."""
FAR = 0.05
"""The greatest distance from a hypothesis at which a place can be explained [m]."""
Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ContactExplanation:
    """One contact and its reasons.

    Attributes:
        position: in the explanation's frame [m].
        likelihood: of the contact.
        spread: standard deviation of its position along an axis, √(trace covariance / 3) [m].
        dispersion: its standard distance [m].
        voxels: number of its voxels.
        force: on the robot [N]; NaN where none was measured.
        combination: how its likelihood follows from those of the sources.
        said: the part of each source here, larger shares first.
        missing: why other sources of evidence and support have no part here.
        without: the counterfactual without each source in `said`.
    """

    position: Place
    likelihood: float
    spread: float
    dispersion: float
    voxels: int
    force: Place
    combination: str
    said: tuple[Part, ...]
    missing: tuple[Reason, ...]
    without: tuple[Without, ...]


@dataclass(frozen=True, slots=True)
class PlaceExplanation:
    """A place where a contact might be expected, and why there is none.

    Attributes:
        position: in the explanation's frame [m].
        reach: radius of the neighbourhood that is explained [m].
        asked: whether this place was asked for.
        likelihood: the highest fused likelihood here; NaN: no source has a part.
        combination: how that follows from the likelihoods of the sources, or "".
        reasons: why there is no contact, the main one first; `Why.CONTACT`: there is one.
        said: the part of each source here, likelier ones first.
        missing: why other sources of evidence and support have no part here.
        without: the counterfactual without each source in `said`.
        last_contact: time since the last contact here [s]; NaN: not lately.
    """

    position: Place
    reach: float
    asked: bool
    likelihood: float
    combination: str
    reasons: tuple[Reason, ...]
    said: tuple[Part, ...]
    missing: tuple[Reason, ...]
    without: tuple[Without, ...]
    last_contact: float


@dataclass(frozen=True, slots=True)
class SourceExplanation:
    """The state of a source.

    Attributes:
        source: its name.
        kind: evidence, support or null.
        age: since its newest cloud [s]; NaN: none ever came.
        timeout: lifetime of its hypotheses [s].
        rate: clouds a second; NaN before the second.
        active: whether a cloud came within `stale_after`.
        hypotheses: number of voxels with a live one.
        accepted: clouds that were taken, so far.
        late: clouds that were dropped because a newer one had come.
        early: clouds that were held back.
        refused: clouds that could not be used.
        notes: remarks on its newest cloud.
        events: its latest event, with the time since.
    """

    source: str
    kind: HypothesisKind
    age: float
    timeout: float
    rate: float
    active: bool
    hypotheses: int
    accepted: int
    late: int
    early: int
    refused: int
    notes: tuple[str, ...]
    events: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why there are contacts at one moment, and why not elsewhere.

    Attributes:
        stamp: of the step [s].
        frame: of all places and forces.
        rule: that fused.
        condensation: that made contacts.
        threshold: from which likelihood on a voxel, or a contact of a set, is a contact; NaN: the
            condensation has none.
        tolerance: linking distance of voxels [m]; NaN: contacts do not come of voxels.
        contacts: the likeliest first.
        omitted: number of further contacts.
        places: without a contact; the one asked for, or the most conspicuous ones.
        sources: by name.
    """

    stamp: float
    frame: str
    rule: str
    condensation: str
    threshold: float
    tolerance: float
    contacts: tuple[ContactExplanation, ...]
    omitted: int
    places: tuple[PlaceExplanation, ...]
    sources: tuple[SourceExplanation, ...]


def as_json(explanation: Explanation) -> str:
    """An explanation as JSON: names as in the classes, m, s and N, null for NaN."""
    fields = _plain(asdict(explanation))
    return json.dumps(fields, indent=1, ensure_ascii=False, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value


def _sources(view: View) -> list[SourceExplanation]:
    """The state of each source."""
    fusion = view.fusion
    entries, found = fusion.field.entries, []
    live = np.diff(entries.begin)
    for source, hypotheses in zip(entries.sources, live.tolist(), strict=True):
        report = fusion.report.sources[source.name]
        found.append(
            SourceExplanation(
                source=source.name,
                kind=source.kind,
                age=report.age,
                timeout=view.settings.timeout(source.name),
                rate=report.rate,
                active=report.active,
                hypotheses=hypotheses,
                accepted=report.accepted,
                late=report.late,
                early=report.early,
                refused=report.invalid,
                notes=report.notes,
                events=tuple(
                    f"{view.stamp - at:.2f} s ago: {event.message}"
                    for at, event in view.past.events(source.name)[-1:]
                ),
            )
        )
    return found


def explanation_of(
    moment: Moment, settings: Settings, at: Sequence[float] | None = None
) -> Explanation:
    """The explanation of a moment.

    Args:
        moment: the step and what was before.
        settings: of the pipeline that gave it.
        at: shape (3,) [m], the place that is asked for, in the frame of the space; None: those
            where a contact may be expected.

    Raises:
        ContactFusionError: `at` is no place, or nothing is or was near it.
    """
    view, config = View(moment, settings), settings.integrator
    contacts, condensation = view.fusion.contacts, view.fusion.condensation
    wanted = expected_places(view) if at is None else [_asked(view, at)]
    has_threshold = condensation.looks_at_voxels or condensation.needs_members
    return Explanation(
        stamp=view.stamp,
        frame=config.frame,
        rule=config.rule,
        condensation=config.condensation,
        threshold=view.fusion.threshold if has_threshold else np.nan,
        tolerance=settings.tolerance if condensation.looks_at_voxels else np.nan,
        contacts=tuple(_contact(view, number) for number in range(min(len(contacts), MOST))),
        omitted=max(len(contacts) - MOST, 0),
        places=tuple(_place(view, place, at is not None) for place in wanted),
        sources=tuple(_sources(view)),
    )


def _asked(view: View, at: Sequence[float]) -> Expected:
    """The place that was asked for, with the last contact there."""
    place = np.asarray(at, np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ContactFusionError(f"{at} is no place: give x, y and z in m")
    _require_near(view, place)
    reach = view.settings.tolerance
    for dead in view.past.dead(view.stamp):
        if _distance(dead.contact, place) <= reach:
            return Expected(place, dead.stamp)
    return Expected(place)


def _require_near(view: View, place: FloatArray) -> None:
    """Make sure that something is, or was lately, near a place."""
    fusion, far = view.fusion, max(FAR, view.settings.tolerance)
    sources = fusion.field.entries.sources
    around = nearest_hypotheses(fusion, place)
    here = nearest(place, fusion.contacts)
    if (around and around[0][0] <= far) or (here and here[1] <= far):
        return
    if any(view.past.last_reported(source.name, place, far) for source in sources):
        return
    raise ContactFusionError(
        f"nothing was within {far * 100.0:.0f} cm of {place_words(place)} in "
        f"'{view.settings.integrator.frame}' at {view.stamp:.9g} s; "
        f"{_nearest_words(fusion, place)}"
    )


def _contact(view: View, number: int) -> ContactExplanation:
    contact, around = view.fusion.contacts[number], neighbourhood_of(view, number)
    parts = [
        replace(part, share=contact.shares.get(part.source, np.nan))
        for part in parts_at(view, around, _heard(view.fusion, number))
    ]
    parts.sort(key=lambda part: -np.nan_to_num(part.share))
    limit = reach_of(contact, view.settings.integrator.voxel_size)
    return ContactExplanation(
        position=_place_of(contact.position),
        likelihood=contact.likelihood,
        spread=float(np.sqrt(np.trace(contact.covariance) / 3.0)),
        dispersion=contact.dispersion,
        voxels=contact.voxels,
        force=_place_of(contact.force),
        combination=explained_at(view, around, contact),
        said=tuple(parts),
        missing=tuple(_missing(view, around, parts)),
        without=_withouts(view, parts, around, limit),
    )


def _heard(fusion: Fusion, number: int) -> set[str]:
    """The sources that speak for or against a contact of a set, wherever their hypotheses lie."""
    if (member := fusion.found.get(number)) is None:
        return set()
    shares, factors = fusion.contacts[number].shares, member.factors
    heard = {name for name, share in shares.items() if share >= ROUNDED}
    return heard | {name for name, factor in factors.items() if abs(factor - 1.0) >= ROUNDED}


def _place(view: View, wanted: Expected, asked: bool) -> PlaceExplanation:
    fusion = view.fusion
    around = neighbourhood_at(view, wanted.position, view.settings.tolerance)
    parts = parts_at(view, around)
    missing = _missing(view, around, parts)
    contact, reasons = contact_at(view, around), reasons_at(view, around)
    here = around  # without a source the contact of a place may be where it was, and not here
    if contact is not None:
        reach = reach_of(contact, view.settings.integrator.voxel_size)
        here = replace(around, position=contact.position, reach=reach)
    if not reasons or reasons[0].why == Why.FAILED:
        reasons.insert(0, _nothing(fusion, around, parts, missing))
    likelihood = np.nan if around.best == NONE else float(fusion.field.likelihoods[around.best])
    return PlaceExplanation(
        position=_place_of(wanted.position),
        reach=around.reach,
        asked=asked,
        likelihood=likelihood,
        combination=explained_at(view, around),
        reasons=tuple(reasons),
        said=tuple(parts),
        missing=tuple(missing),
        without=_withouts(view, parts, here, here.reach),
        last_contact=view.stamp - wanted.last_contact,
    )


def _nearest_words(fusion: Fusion, place: FloatArray) -> str:
    """The hypothesis nearest to a place where no source has a part, in words."""
    nearest_of = nearest_hypotheses(fusion, place)
    if not nearest_of:
        return "no hypothesis is alive anywhere"
    away, source = nearest_of[0]
    return f"the nearest hypothesis is {millimetres(away)} away, of {source}"


def _missing(view: View, around: Neighbourhood, parts: Sequence[Part]) -> list[Reason]:
    """Why sources have no part here, but for those that reach here from elsewhere."""
    reach_here = {part.source for part in parts}
    return [reason for reason in missing_at(view, around) if reason.source not in reach_here]


def _nothing(
    fusion: Fusion, around: Neighbourhood, parts: Sequence[Part], missing: Sequence[Reason]
) -> Reason:
    """That no hypothesis lies here, with the best reason of those that might have."""
    if missing and missing[0].why in (Why.EXPIRED, Why.WITHDRAWN):
        return missing[0]
    what = (
        f"no hypothesis lies within {millimetres(around.reach)}"
        if parts
        else "no source says anything here"
    )
    return Reason(Why.NOTHING, f"{what}; {_nearest_words(fusion, around.position)}")


def _withouts(
    view: View, parts: Sequence[Part], around: Neighbourhood, reach: float
) -> tuple[Without, ...]:
    alone = view.fusion.alone if parts else view.fusion
    return tuple(without(alone, part.source, around.position, reach) for part in parts)


def _distance(contact: Contact, place: FloatArray) -> float:
    return float(np.linalg.norm(contact.position - place))


def _place_of(values: FloatArray) -> Place:
    x, y, z = (float(value) for value in values)
    return x, y, z
