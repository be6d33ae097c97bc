"""Why a source says nothing at a place."""

import itertools
import math

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.explaining.account import SourceAccount
from contactfusion.explaining.reason import Reason, Why
from contactfusion.explaining.spots import Spot
from contactfusion.explaining.view import View
from contactfusion.explaining.words import millimetres
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.sources import SourceReport

ORDER = (
    Why.WITHDRAWN,
    Why.EXPIRED,
    Why.SILENT,
    Why.NEVER_CAME,
    Why.FOUND_NOTHING,
    Why.ELSEWHERE,
)
"""What explains most comes first."""


def missing_at(view: View, spot: Spot) -> list[Reason]:
    """Tell of each source of evidence or support that says nothing in a spot, why it does not.

    Those come first that once spoke of the place.
    """
    entries, reasons = view.fusion.field.entries, []
    for source, (begin, end) in zip(
        entries.sources, itertools.pairwise(entries.begin.tolist()), strict=True
    ):
        if source.kind == HypothesisKind.NULL or spot.inside[entries.places[begin:end]].any():
            continue
        reasons.append(_reason(view, spot, source.name))
    return sorted(reasons, key=lambda reason: ORDER.index(reason.why))


def nearest_hypotheses(fusion: Fusion, place: FloatArray) -> list[tuple[float, str]]:
    """Give how far from a place, shape (3,) [m], each source's nearest hypothesis is [m]."""
    entries, found = fusion.field.entries, []
    centres = entries.grid.centres(entries.voxels)
    for source, (begin, end) in zip(
        entries.sources, itertools.pairwise(entries.begin.tolist()), strict=True
    ):
        if end > begin:
            offsets = centres[entries.places[begin:end]] - place
            found.append((float(np.sqrt((offsets**2).sum(axis=1).min())), source.name))
    return sorted(found)


def sources_of(view: View) -> list[SourceAccount]:
    """Tell how each source does."""
    fusion = view.fusion
    entries, accounts = fusion.field.entries, []
    live = np.diff(entries.begin)
    for source, hypotheses in zip(entries.sources, live.tolist(), strict=True):
        report = fusion.report.sources[source.name]
        accounts.append(
            SourceAccount(
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
    return accounts


def _reason(view: View, spot: Spot, source: str) -> Reason:
    fusion, timeout = view.fusion, view.settings.timeout(source)
    report = fusion.report.sources[source]
    if math.isnan(report.age):
        return Reason(Why.NEVER_CAME, f"{source} has never told anything{_refused(report)}", source)
    values = {"newest_age_s": report.age, "timeout_s": timeout}
    told = view.past.last_told(source, spot.position, spot.reach)
    if told is not None:
        likelihood, stamp = told
        age = fusion.field.entries.now / 1e9 - stamp
        values |= {"told_age_s": age, "told_likelihood": likelihood}
        sentence = f"{source} told {likelihood:.2f} here {age:.2f} s ago"
        if age > timeout:
            since = "" if report.age < age - 1e-6 else ", and nothing came since"
            sentence += f"; its hypotheses live {timeout:g} s{since}"
            return Reason(Why.EXPIRED, sentence, source, values)
        if report.age < age - 1e-6:
            sentence += f", and took it back: {_now(fusion, spot, source, report)}"
            return Reason(Why.WITHDRAWN, sentence, source, values)
    if report.age > timeout:
        sentence = f"{source} has been silent for {report.age:.2f} s; its hypotheses live"
        return Reason(Why.SILENT, f"{sentence} {timeout:g} s{_refused(report)}", source, values)
    away = _distance(fusion, spot, source)
    why = Why.FOUND_NOTHING if away is None else Why.ELSEWHERE
    if away is not None:
        values["nearest_m"] = away
    return Reason(why, f"{source}: {_now(fusion, spot, source, report)}", source, values)


def _now(fusion: Fusion, spot: Spot, source: str, report: SourceReport) -> str:
    """Say what a source told last."""
    away = _distance(fusion, spot, source)
    notes = f" ({', '.join(report.notes)})" if report.notes else ""
    if away is None:
        return f"{report.age:.2f} s ago it found nothing{notes}"
    return f"its nearest hypothesis now is {millimetres(away)} away{notes}"


def _distance(fusion: Fusion, spot: Spot, source: str) -> float | None:
    away = {name: far for far, name in nearest_hypotheses(fusion, spot.position)}
    return away.get(source)


def _refused(report: SourceReport) -> str:
    told = {"refused": report.invalid, "late": report.late}
    counts = [f"{count} {what}" for what, count in told.items() if count]
    return f" ({' and '.join(counts)} so far)" if counts else ""
