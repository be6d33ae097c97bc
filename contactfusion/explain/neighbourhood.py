"""A place in the hypothesis space: what each source says there, and why there is no contact."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from contactfusion.arrays import FloatArray
from contactfusion.explain.counterfactual import nearest
from contactfusion.explain.moment import NOBODY, Settings, View
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import clusters, kernels
from contactfusion.integrator.condensations import (
    FAINTEST,
    ClusterCentroidConfig,
    ClusterMassConfig,
    reach_squared,
)
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.kernels import CLIP
from contactfusion.integrator.modes import ModesConfig
from contactfusion.integrator.posterior import PosteriorConfig
from contactfusion.integrator.rules import PriorConfig
from contactfusion.integrator.sources import SourceReport
from contactfusion.reason import Reason, Why, counted, millimetres

MOST, MOST_DEAD = 3, 2
"""So many places are found at most, so many of them of contacts that died."""
APART = 2.0
"""What lies within so many tolerances of a contact, or of another place, is no place of its own."""
ORDER = (
    Why.WITHDRAWN,
    Why.EXPIRED,
    Why.SILENT,
    Why.NEVER_CAME,
    Why.FOUND_NOTHING,
    Why.ELSEWHERE,
)
"""What explains most comes first."""


@dataclass(frozen=True, slots=True)
class Neighbourhood:
    """A place with the voxels around it.

    Attributes:
        position: shape (3,) [m].
        reach: how far it reaches [m].
        inside: shape (m,), which voxels of the space lie in it.
        best: the row of the likeliest voxel in it, or `NOBODY`.
    """

    position: FloatArray
    reach: float
    inside: NDArray[np.bool_]
    best: int


@dataclass(frozen=True, slots=True)
class Part:
    """What one source says at a place.

    Attributes:
        source: its name.
        kind: what it stands on.
        likelihood: of its likeliest hypothesis within reach, or of its nearest if none is.
        age: of that hypothesis [s].
        timeout: how long it lives [s].
        voxels: in how many voxels within reach it says something; 0: only by its spread.
        spread: the standard deviation of that hypothesis's place [m], 0 if the source gave none.
        away: how far from the place that hypothesis lies [m].
        share: of the contact's likelihood; NaN where there is no contact.
        fit: with a rule that has a belief, how well the place fits what the source says: as a part
            of what its best place has, and for null what it leaves of the others' belief; else NaN.
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
    fit: float = math.nan


def neighbourhood_at(view: View, position: FloatArray, reach: float) -> Neighbourhood:
    """Give what lies within reach of a place, and the voxel that the place lies in."""
    offsets = np.abs(view.centres - position)
    inside = (offsets**2).sum(axis=1) <= reach**2 + 1e-12
    inside |= (offsets <= 0.5 * view.fusion.field.entries.grid.voxel_size).all(axis=1)
    return Neighbourhood(position, reach, inside, _best(view, inside, position))


def neighbourhood_of(view: View, number: int) -> Neighbourhood:
    """Give the voxels that belong to a contact, by its row in the contacts."""
    contact, inside = view.fusion.contacts[number], view.owners == number
    reach = max(view.settings.tolerance, 2.0 * contact.dispersion)
    if view.settings.by_modes:
        near = neighbourhood_at(view, contact.position, view.settings.tolerance).inside
        inside |= near & (view.owners == NOBODY)
    return Neighbourhood(contact.position, reach, inside, _best(view, inside, contact.position))


def said_at(view: View, spot: Neighbourhood) -> list[Part]:
    """Give what each source says in a spot, likelier first; those that say nothing are left out.

    Where a rule has a belief, a source whose field reaches here from further away says something.
    """
    entries, said = view.fusion.field.entries, []
    positions = entries.positions
    options = view.settings.rule
    floor = (options if isinstance(options, PosteriorConfig) else PosteriorConfig()).floor
    fits, heard = heard_at(view.fusion, spot, floor)
    for number, (source, (begin, end)) in enumerate(
        zip(entries.sources, itertools.pairwise(entries.begin.tolist()), strict=True)
    ):
        rows = begin + np.flatnonzero(spot.inside[entries.places[begin:end]])
        if end == begin or not (len(rows) or heard[number]):
            continue
        columns = entries.columns
        away = np.linalg.norm(positions[begin:end] - spot.position, axis=1)
        row = rows[columns.likelihoods[rows].argmax()] if len(rows) else begin + away.argmin()
        said.append(
            Part(
                source=source.name,
                kind=source.kind,
                likelihood=float(columns.likelihoods[row]),
                age=float(entries.now - columns.stamps[row]) / 1e9,
                timeout=view.settings.timeout(source.name),
                voxels=len(rows),
                spread=float(columns.spreads[row]),
                away=float(away[row - begin]),
                fit=float(fits[number]),
            )
        )
    return sorted(said, key=lambda one: -np.nan_to_num(one.likelihood))


def heard_at(
    fusion: Fusion, spot: Neighbourhood, floor: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """How well a spot fits the evidence of each source, and whether its field stands out there.

    Of evidence and support: the source's factor at the place of the belief that is nearest, as a
    part of its largest; it stands out where the field exceeds its floor. Of null: the factor
    itself, which is what it leaves of the others' belief; it stands out where it takes some.

    Returns:
        Both of shape (k,); NaN and False where no place of a belief lies in the spot.
    """
    belief, entries = fusion.field.belief, fusion.field.entries
    unheard = np.full(len(entries.sources), np.nan), np.zeros(len(entries.sources), np.bool_)
    if belief is None:
        return unheard
    squared = ((belief.places - spot.position) ** 2).sum(axis=1)
    if squared.min() > spot.reach**2:
        return unheard
    told = belief.told[:, squared.argmin()]
    null = entries.flags(HypothesisKind.NULL)
    fits: FloatArray = np.exp(told - belief.told.max(axis=1))
    fits[null] = np.minimum(floor * np.exp(told[null]), 1.0)
    return fits, np.where(null, fits < 1.0 - floor, told > np.log(2.0))


def shares_at(fusion: Fusion, spot: Neighbourhood) -> dict[str, float]:
    """The share of each source in a belief in a spot, summing to 1; Null has none."""
    belief, entries = fusion.field.belief, fusion.field.entries
    assert belief is not None
    squared = ((belief.places - spot.position) ** 2).sum(axis=1)
    near = squared <= max(spot.reach**2, squared.min())
    added = np.maximum(belief.told[:, near] @ belief.weights[near], 0.0) * entries.counted
    parts = added / (added.sum() or 1.0)
    return {one.name: float(part) for one, part in zip(entries.sources, parts, strict=True)}


def _best(view: View, wanted: NDArray[np.bool_], position: FloatArray) -> int:
    """Give the likeliest of the wanted voxels with more than null, of equals the nearest."""
    rows = np.flatnonzero(wanted & view.fusion.field.entries.counted_voxels)
    if not len(rows):
        return NOBODY
    likelihoods = np.round(view.fusion.field.likelihoods[rows], 6)
    tops = rows[likelihoods == likelihoods.max()]
    return int(tops[((view.centres[tops] - position) ** 2).sum(axis=1).argmin()])


@dataclass(frozen=True, slots=True)
class Expected:
    """A place where one might expect a contact.

    Attributes:
        position: shape (3,) [m].
        last_contact: the time of the last step that told one there [s]; NaN: not lately.
    """

    position: FloatArray
    last_contact: float = np.nan


def expected_places(view: View) -> list[Expected]:
    """Find the places where contacts died lately, and where hypotheses came to nothing.

    Returns:
        A few contacts that died, the newest first; then a few places that are no such, evidence
        before prediction, the likeliest first.
    """
    dead = [Expected(one.contact.position, one.stamp) for one in view.past.dead(view.stamp)]
    places = _apart(view, dead)[:MOST_DEAD]
    places += _apart(view, [Expected(one) for one in _hopeless(view)], places)
    return places[:MOST]


def _hopeless(view: View) -> list[FloatArray]:
    """Give the likeliest voxel of each cluster of hypotheses without a contact, the best first.

    Null alone makes no place: nobody expects a contact there; nor does support alone that would
    stay under the threshold even with evidence.
    """
    entries, likelihoods = view.fusion.field.entries, view.fusion.field.likelihoods
    evidence = (entries.bits & kernels.REGULAR) > 0
    wanted = entries.counted_voxels & (evidence | (likelihoods >= view.fusion.threshold))
    rows = np.flatnonzero(wanted & (view.owners == NOBODY))
    if not len(rows):
        return []
    config = view.settings.integrator
    reach = reach_squared(config.linking_distance, config.voxel_size)
    labels, _ = clusters.label(entries.keys[rows], reach)
    order = np.lexsort((rows, -np.round(likelihoods[rows], 6), ~evidence[rows]))
    _, first = np.unique(labels[order], return_index=True)
    return list(view.centres[rows[order[np.sort(first)]]])


def _apart(
    view: View, candidates: list[Expected], others: list[Expected] | None = None
) -> list[Expected]:
    """Give the places that lie apart from every contact and from each other, in order."""
    owned = view.centres[view.owners != NOBODY]
    taken = [one.position for one in view.fusion.contacts]
    tree = cKDTree(np.concatenate([owned, np.reshape(taken, (-1, 3))]))
    apart, found = APART * view.settings.tolerance, list(others or [])
    kept: list[Expected] = []
    for one in candidates:
        if len(kept) == MOST:
            break
        near = [np.linalg.norm(one.position - place.position) for place in found + kept]
        if tree.query(one.position)[0] > apart and all(far > apart for far in near):
            kept.append(one)
    return kept


def missing_at(view: View, spot: Neighbourhood) -> list[Reason]:
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


def _reason(view: View, spot: Neighbourhood, source: str) -> Reason:
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


def _now(fusion: Fusion, spot: Neighbourhood, source: str, report: SourceReport) -> str:
    """Say what a source told last."""
    away = _distance(fusion, spot, source)
    notes = f" ({', '.join(report.notes)})" if report.notes else ""
    if away is None:
        return f"{report.age:.2f} s ago it found nothing{notes}"
    return f"its nearest hypothesis now is {millimetres(away)} away{notes}"


def _distance(fusion: Fusion, spot: Neighbourhood, source: str) -> float | None:
    away = {name: far for far, name in nearest_hypotheses(fusion, spot.position)}
    return away.get(source)


def _refused(report: SourceReport) -> str:
    told = {"refused": report.invalid, "late": report.late}
    counts = [f"{count} {what}" for what, count in told.items() if count]
    return f" ({' and '.join(counts)} so far)" if counts else ""


def combined(view: View, spot: Neighbourhood, likelihood: float | None = None) -> str:
    """Write how the likelihood of a spot's likeliest voxel comes about.

    Args:
        view: of the moment.
        spot: the place.
        likelihood: of the contact there, if there is one.

    Returns:
        "" when nobody says anything there, or one source alone, whose likelihood it is.
    """
    fusion, belief = view.fusion, view.fusion.field.belief
    if belief is not None and view.settings.by_modes:
        if likelihood is None:
            likelihood = belief.exists * belief_share(fusion, spot.position, spot.reach)
        return (
            f"P(contact) {belief.exists:.2f} by all evidence, {likelihood / belief.exists:.0%} of "
            f"the belief lies here: {likelihood:.2f}"
        )
    if spot.best == NOBODY:
        return ""
    if belief is not None:
        fused = float(fusion.field.likelihoods[spot.best])
        return (
            f"P(contact) {belief.exists:.2f} by all evidence, {fused / belief.exists:.0%} as "
            f"likely here as at the likeliest place: {fused:.2f}"
        )
    names, given = given_in(fusion, spot.best)
    if len(given) == 1 and abs(given[0] - fusion.field.likelihoods[spot.best]) < 1e-6:
        return ""
    return f"{' and '.join(names)}: {_formula(fusion, spot.best, given, view.settings)}"


def given_in(fusion: Fusion, row: int) -> tuple[list[str], list[float]]:
    """Give the sources that take part in a voxel's fused likelihood, and what they gave."""
    entries, names, given = fusion.field.entries, [], []
    for source, takes_part, (begin, end) in zip(
        entries.sources, entries.counted, itertools.pairwise(entries.begin.tolist()), strict=True
    ):
        here = begin + (entries.places[begin:end] == row).nonzero()[0]
        if takes_part and len(here):
            names.append(source.name)
            given.append(float(entries.columns.likelihoods[here[0]]))
    return names, given


def belief_share(fusion: Fusion, position: FloatArray, reach: float) -> float:
    """Give the part of the belief that lies within reach [m] of a place, shape (3,) [m]."""
    belief = fusion.field.belief
    if belief is None:
        return 0.0
    near = ((belief.places - position) ** 2).sum(axis=1) <= reach**2
    return float(belief.weights[near].sum())


def _formula(fusion: Fusion, row: int, given: Sequence[float], settings: Settings) -> str:
    fused = fusion.field.likelihoods[row]
    told = [f"{p:.2f}" for p in given]
    match settings.integrator.rule, settings.rule:
        case "de_morgan", _:
            return f"1 - {''.join(f'(1 - {p})' for p in told)} = {fused:.2f}"
        case "max", _:
            return f"max({', '.join(told)}) = {fused:.2f}"
        case "log_odds", PriorConfig(prior=expected):
            prior = _log_odds(expected)
            odds = [_log_odds(p) - prior for p in given]
            sum_ = prior + sum(odds)
            terms = "".join(f" {'-' if odd < 0 else '+'} {abs(odd):.2f}" for odd in odds)
            return f"log odds {prior:.2f}{terms} = {sum_:.2f}, that is {fused:.2f}"
        case "dempster_shafer", PriorConfig(prior=expected):
            masses = ", ".join(_mass(p, expected) for p in given)
            conflict = float(fusion.field.details["conflict"][row])
            return f"{masses}; {fused:.2f}, conflict {conflict:.2f}"
        case rule, _:
            return f"{rule} of {', '.join(told)} = {fused:.2f}"


def _log_odds(p: float) -> float:
    p = min(max(p, CLIP), 1.0 - CLIP)
    return math.log(p / (1.0 - p))


def _mass(p: float, prior: float) -> str:
    if p >= prior:
        return f"{(p - prior) / (1.0 - prior):.2f} for a contact"
    return f"{(prior - p) / prior:.2f} against one"


def verdict(view: View, spot: Neighbourhood) -> list[Reason]:
    """Tell what kept the hypotheses in a spot from being a contact, the main reason first.

    Returns:
        Nothing where there are no hypotheses of evidence or support: then their absence is the
        reason.
    """
    if (contact := _part_of(view, spot)) is not None:
        return [contact]
    options = view.settings.condensation
    if isinstance(options, ModesConfig) and (spot.best != NOBODY or _believed(view, spot)):
        return _by_belief(view, spot, options)
    if spot.best == NOBODY:
        return []
    code = int(view.fusion.verdict_codes[spot.best])
    reasons = [_of_voxel(code, view, spot)]
    if code != kernels.NULLED and (nulled := _nulled(view, spot)) is not None:
        reasons.append(nulled)
    return reasons


def _part_of(view: View, spot: Neighbourhood) -> Reason | None:
    """Tell which contact lies in a spot, or reaches into it."""
    contacts = view.fusion.contacts
    here = nearest(spot.position, contacts)
    if here is not None and here[1] <= spot.reach:
        contact, away = here
    elif spot.best != NOBODY and view.owners[spot.best] != NOBODY:
        contact = contacts[view.owners[spot.best]]
        away = float(np.linalg.norm(contact.position - spot.position))
    else:
        return None
    number = next(n for n, one in enumerate(contacts, 1) if one is contact)
    sentence = (
        f"this is contact {number}, of likelihood {contact.likelihood:.2f}, whose middle is "
        f"{millimetres(away)} away"
    )
    values = {"distance_m": away, "likelihood": contact.likelihood}
    return Reason(Why.CONTACT, sentence, values=values)


def _of_voxel(code: int, view: View, spot: Neighbourhood) -> Reason:
    """Tell why the likeliest voxel is no contact."""
    options = view.settings.condensation
    if isinstance(options, ClusterMassConfig) and code in (
        kernels.CONTACT,
        kernels.BELOW_THRESHOLD,
    ):
        return _too_little_mass(view, spot, options.mass_threshold)
    match code:
        case kernels.NULLED:
            nulled = _nulled(view, spot)
            assert nulled is not None
            return nulled
        case kernels.SUPPORT_ONLY:
            return _support_only(view, spot)
        case kernels.BELOW_THRESHOLD:
            return _below(view, spot)
        case _:
            return _too_few(view, spot)


def _nulled(view: View, spot: Neighbourhood) -> Reason | None:
    """Tell who rules out how much of what is told in a spot; None: nobody does."""
    entries = view.fusion.field.entries
    told = spot.inside & entries.counted_voxels
    ruled = told & (view.fusion.verdict_codes == kernels.NULLED)
    if not ruled.any():
        return None
    found = []
    for source, (begin, end) in zip(
        entries.sources, itertools.pairwise(entries.begin.tolist()), strict=True
    ):
        rows = begin + np.flatnonzero(ruled[entries.places[begin:end]])
        if source.kind == HypothesisKind.NULL and len(rows):
            row = rows[entries.columns.stamps[rows].argmax()]
            age = float(entries.now - entries.columns.stamps[row]) / 1e9
            found.append((source.name, float(entries.columns.likelihoods[row]), age))
    who = " and ".join(f"{name} (likelihood {p:.2f}, {age:.2f} s old)" for name, p, age in found)
    part = f"{int(ruled.sum())} of {counted(int(told.sum()), 'voxel')}"
    values = {"nulled_voxels": float(ruled.sum()), "told_voxels": float(told.sum())}
    for name, likelihood, age in found:
        values |= {f"{name}.likelihood": likelihood, f"{name}.age_s": age}
    return Reason(Why.NULLED, f"ruled out by {who} in {part}", found[0][0], values)


def _support_only(view: View, spot: Neighbourhood) -> Reason:
    names, _ = given_in(view.fusion, spot.best)
    sentence = f"predicted by {' and '.join(names)}, but no sensor felt it"
    return Reason(Why.SUPPORT_ONLY, sentence, names[0])


def _below(view: View, spot: Neighbourhood) -> Reason:
    likelihood = float(view.fusion.field.likelihoods[spot.best])
    short = view.fusion.threshold - likelihood
    digits = 2 if short >= 0.005 else max(2, math.ceil(-math.log10(max(short, 1e-9))))
    return Reason(
        Why.BELOW_THRESHOLD,
        f"likelihood {likelihood:.{digits}f} is {short:.{digits}f} under the threshold "
        f"{view.fusion.threshold:g}",
        values={"likelihood": likelihood, "threshold": view.fusion.threshold, "short": short},
    )


def _too_few(view: View, spot: Neighbourhood) -> Reason:
    voxels = int((view.fusion.verdict_codes[spot.inside] == kernels.CONTACT).sum())
    options = view.settings.condensation
    least = options.min_voxels if isinstance(options, ClusterCentroidConfig) else 1
    return Reason(
        Why.TOO_FEW_VOXELS,
        f"{counted(voxels, 'voxel')} over the threshold within {millimetres(spot.reach)}, where "
        f"{view.settings.integrator.condensation} wants {least} that hang together",
        values={"voxels": float(voxels), "min_voxels": float(least)},
    )


def _too_little_mass(view: View, spot: Neighbourhood, least: float) -> Reason:
    codes = view.fusion.verdict_codes
    judged = spot.inside & ((codes == kernels.CONTACT) | (codes == kernels.BELOW_THRESHOLD))
    likelihoods = view.fusion.field.likelihoods[judged]
    mass = float(likelihoods[likelihoods >= FAINTEST].sum())
    return Reason(
        Why.TOO_LITTLE_MASS,
        f"the likelihoods within {millimetres(spot.reach)} sum to {mass:.2f}; a contact needs a "
        f"cluster of {least:g}",
        values={"mass": mass, "mass_threshold": least},
    )


def _believed(view: View, spot: Neighbourhood) -> bool:
    """Whether at least 1 % of a belief lies in a spot, hypotheses or none."""
    return belief_share(view.fusion, spot.position, spot.reach) >= 0.01


def _by_belief(view: View, spot: Neighbourhood, config: ModesConfig) -> list[Reason]:
    """Tell what a belief makes of a spot: existence is asked first, then the share of the place."""
    belief = view.fusion.field.belief
    if belief is None:
        names, _ = given_in(view.fusion, spot.best)
        sentence = f"predicted by {' and '.join(names)}, but no sensor felt anything"
        return [Reason(Why.SUPPORT_ONLY, sentence, names[0])]
    if belief.exists < config.existence:
        short = config.existence - belief.exists
        sentence = (
            f"the probability of any contact is {belief.exists:.2f}, {short:.2f} under the "
            f"existence {config.existence:g} that is asked for"
        )
        values = {"exists": belief.exists, "existence": config.existence, "short": short}
        return [Reason(Why.IMPROBABLE, sentence, values=values)]
    share = belief_share(view.fusion, spot.position, spot.reach)
    sentence = (
        f"{share:.0%} of the belief lies within {millimetres(spot.reach)}; beside a likelier place "
        f"a contact needs {config.mode_share:.0%}"
    )
    values = {"share": share, "mode_share": config.mode_share}
    return [Reason(Why.SMALL_SHARE, sentence, values=values)]
