"""An explanation as text that is read in ten seconds."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from contactfusion.contacts import Contact
from contactfusion.explain.counterfactual import Without, reach_of, without
from contactfusion.explain.explanation import (
    ContactExplanation,
    Explanation,
    PlaceExplanation,
    SourceExplanation,
    explanation_of,
)
from contactfusion.explain.moment import Settings, moment_at
from contactfusion.explain.neighbourhood import Part
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.fusion import Fusion
from contactfusion.pipeline import Pipeline
from contactfusion.readings import Reading
from contactfusion.reason import Reason, Why, counted, millimetres, place_words
from contactfusion.terminal import printable

KINDS = {
    HypothesisKind.REGULAR: "evidence",
    HypothesisKind.SUPPORT: "support",
    HypothesisKind.NULL: "null",
}
USUAL = (Why.ELSEWHERE, Why.FOUND_NOTHING)
"""Sources without a part for these reasons share a line."""


REASONS = {
    "below_threshold": "too unlikely",
    "support_only": "predicted, but no sensor felt them",
    "nulled": "ruled out",
}
NO_VETO = {"nulled": "with null"}
"""Where contacts do not come of voxels, null rules none out."""


def as_text(explanation: Explanation) -> str:
    """An explanation as text: contacts, then places without one, then sources in trouble."""
    total = len(explanation.contacts) + explanation.omitted
    lines = [
        f"{explanation.stamp:.3f} s: {counted(total, 'contact') if total else 'no contact'} in "
        f"'{explanation.frame}' ({', '.join(_law(explanation))})"
    ]
    for number, contact in enumerate(explanation.contacts, 1):
        lines += ["", *_contact(number, contact)]
    if explanation.omitted:
        lines += ["", f"and {counted(explanation.omitted, 'further contact')}, less likely"]
    for place in explanation.places:
        lines += ["", *_place(place)]
    lines.append("")
    empty = [one.source for one in explanation.sources if not (one.hypotheses or _troubles(one))]
    if empty and not total and not explanation.places:
        lines.append(f"found nothing: {', '.join(empty)}")
    lines += _sources(explanation.sources)
    return "\n".join(map(printable, lines))


def _law(explanation: Explanation) -> Iterator[str]:
    """How contacts come about."""
    yield from (explanation.rule, explanation.condensation)
    if not math.isnan(explanation.threshold):
        yield f"threshold {explanation.threshold:g}"
    if not math.isnan(explanation.tolerance):
        yield f"tolerance {millimetres(explanation.tolerance)}"


def _contact(number: int, contact: ContactExplanation) -> Iterator[str]:
    force = math.hypot(*contact.force)
    felt = "" if math.isnan(force) else f", {force:.1f} N"
    yield (
        f"contact {number} at {place_words(contact.position)}, likelihood "
        f"{contact.likelihood:.2f}, ± {millimetres(contact.spread)}, "
        f"{counted(contact.voxels, 'voxel')}{felt}"
    )
    if contact.combination:
        yield f"  {contact.combination}"
    yield from _parts(contact.said, contact.without, True, contact.likelihood)
    yield from _missing(contact.missing)


def _place(place: PlaceExplanation) -> Iterator[str]:
    here = place.reasons[0].why == Why.CONTACT
    words = "asked for:" if here else "no contact at"
    yield f"{words} {place_words(place.position)}: {place.reasons[0].sentence}"
    for reason in place.reasons[1:]:
        yield f"  also: {reason.sentence}"
    if not math.isnan(place.last_contact):
        yield f"  the last contact here was reported {place.last_contact:.2f} s ago"
    if place.combination and not here:
        yield f"  {place.combination}"
    yield from _parts(place.said, place.without, here, place.likelihood)
    shown = [reason for reason in place.missing if reason.sentence != place.reasons[0].sentence]
    yield from _missing(shown)


def _parts(
    parts: Sequence[Part], without: Sequence[Without], there: bool, likelihood: float
) -> Iterator[str]:
    """A line for each source that has a part."""
    rest: Mapping[str, Without] = {left.source: left for left in without}
    for part in parts:
        words = [_likelihood(part)]
        if not math.isnan(part.share):
            words.append(f"share {part.share:.0%}")
        remains = _remains(rest[part.source], there, likelihood)
        yield f"  {part.source} ({KINDS[part.kind]}): {', '.join(words)}{remains}"


def _likelihood(part: Part) -> str:
    spread = f" ± {millimetres(part.spread)}" if part.spread else ""
    if not part.voxels:
        return (
            f"reaches here from {millimetres(part.away)}: {part.likelihood:.2f}{spread}, "
            f"{part.age:.2f} s old"
        )
    many = f" in {part.voxels} voxels" if part.voxels > 1 else ""
    most = "up to " if part.voxels > 1 else ""
    return f"{most}{part.likelihood:.2f}{spread}{many}, {part.age:.2f} s old"


def _remains(without: Without, there: bool, likelihood: float) -> str:
    """The counterfactual without a source, as the end of its line.

    Args:
        without: that source.
        there: whether there is a contact with it.
        likelihood: of that contact, perhaps over time.
    """
    if without.contact:
        if without.moved < 5e-5 and abs(without.likelihood - without.before) < 0.005:
            return "; without it: the same"
        moved = f", {millimetres(without.moved)} from here" if without.moved >= 5e-5 else ""
        is_other = abs(without.before - likelihood) >= 0.005  # by this step alone
        before = f" in place of {without.before:.2f}" if is_other else ""
        return f"; without it: a contact of likelihood {without.likelihood:.2f}{before}{moved}"
    if not there:
        return ""
    if math.isnan(without.before):
        return "; this step by itself has no contact here, with or without it"
    if math.isnan(without.moved):
        return "; without it: no contact"
    return f"; without it: none here, the nearest is {millimetres(without.moved)} away"


def _missing(missing: Sequence[Reason]) -> Iterator[str]:
    """A line for each source that is missing, and one for all that look elsewhere."""
    usual = [reason for reason in missing if reason.why in USUAL]
    for reason in missing:
        if reason not in usual or len(usual) == 1:
            yield f"  {reason.sentence}"
    if len(usual) > 1:
        yield f"  nothing here from {', '.join(reason.source for reason in usual)}"


def _sources(sources: Sequence[SourceExplanation]) -> Iterator[str]:
    """A line for each source in trouble, and one for all others."""
    sound = [source.age for source in sources if not _troubles(source)]
    for source in sources:
        if troubles := _troubles(source):
            yield f"{source.source}: {'; '.join(troubles)}"
    if sound:
        every = "every" if len(sound) == len(sources) else "every other"
        yield f"the newest cloud of {every} source is at most {max(sound):.2f} s old"


def _troubles(source: SourceExplanation) -> list[str]:
    """The problems of a source, in words."""
    troubles = []
    if math.isnan(source.age):
        troubles.append("never came")
    elif not source.active or source.age > source.timeout:
        stale = "" if source.active else ", stale"
        troubles.append(
            f"silent for {source.age:.2f} s{stale}; its hypotheses live {source.timeout:g} s"
        )
    counts = {"late": source.late, "early": source.early, "refused": source.refused}
    if refused := [f"{count} {what}" for what, count in counts.items() if count]:
        troubles.append(f"clouds {', '.join(refused)} so far")
    troubles += source.events
    troubles += [f"remarks: {note}" for note in source.notes]
    return troubles


def explain_moment(pipeline: Pipeline, readings: Iterable[Reading], time: float) -> str:
    """Explanation of the last step until a time, as `contactfusion explain` prints it.

    Args:
        pipeline: it receives the readings until then.
        readings: in order of their stamps.
        time: [s].

    Returns:
        For each contact the parts of its sources, their ages, and the counterfactual without each;
        where a contact might be expected, why there is none; then sources that are in trouble.

    Raises:
        TimeError: the time lies outside the steps, or there are none.
    """
    settings = Settings.of(pipeline)
    moment = moment_at(pipeline.run(readings), time, settings.tolerance)
    return as_text(explanation_of(moment, settings))


def explain_fusion(fusion: Fusion) -> str:
    """Short explanation of a single fusion, which needs no pipeline.

    Returns:
        One line a contact, a line for each of its sources with what would remain without it, and
        one line on all other voxels.
    """
    lines, alone = [], fusion.alone
    for contact in fusion.contacts:
        lines.append(str(contact))
        for source in sorted(name for name, share in contact.shares.items() if share > 0.0):
            lines.append(f"  without {source}: {_without(alone, contact, source)}")
    if not lines:
        lines.append("no contact")
    verdicts = Counter(str(verdict) for verdict in fusion.space.verdicts)
    reasons = REASONS if fusion.condensation.looks_at_voxels else {**REASONS, **NO_VETO}
    others = [f"{verdicts[key]} {words}" for key, words in reasons.items() if verdicts[key]]
    if others:
        lines.append(f"other voxels: {', '.join(others)}")
    lines += [f"{source} remarks: {note}" for source, note in fusion.report.notes]
    return "\n".join(lines)


def _without(fusion: Fusion, contact: Contact, source: str) -> str:
    """The counterfactual of a contact of a step by itself without one source, in words."""
    reach = reach_of(contact, fusion.field.entries.grid.voxel_size)
    rest = without(fusion, source, contact.position, reach)
    if rest.contact:
        return f"likelihood {rest.likelihood:.2f}, {rest.moved * 1000:.1f} mm from where it is now"
    if np.isnan(rest.before):
        return "this step by itself has no contact here, with or without it"
    if np.isnan(rest.moved):
        return "no contact remains"
    return f"no contact remains here; the nearest is {rest.moved * 100:.1f} cm away"
