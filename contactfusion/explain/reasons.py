"""Why there is a contact at a place, or none, as rule, condensation and verdicts say."""

import math
from collections.abc import Callable

import numpy as np

from contactfusion.contacts import NONE, Contact
from contactfusion.errors import PluginError
from contactfusion.explain.counterfactual import nearest
from contactfusion.explain.moment import View
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import kernels
from contactfusion.integrator.fusion import guarded
from contactfusion.reason import Reason, Why, counted, millimetres
from contactfusion.rule import Condensation, Neighbourhood, Rule


def explained_at(view: View, around: Neighbourhood, contact: Contact | None = None) -> str:
    """How the likelihood here comes about, as the condensation and the rule explain it.

    Args:
        view: of the moment.
        around: the place.
        contact: that there is; None: there is none.

    Returns:
        Empty where no source has a part, or one alone, whose likelihood it is. What a plug-in
        raises stands in place of its explanation.
    """
    fusion = view.fusion
    lines = [
        _words(
            fusion.condensation, lambda: fusion.condensation.explain(fusion.field, around, contact)
        )
    ]
    if not lines[0] and around.best != NONE and not fusion.condensation.needs_members:
        lines = [_words(fusion.rule, lambda: fusion.rule.explain(fusion.field, around.best))]
    if contact is not None:
        lines.append(view.trouble)
    return "; ".join(filter(None, lines))


def _words(part: Rule | Condensation, explain: Callable[[], str]) -> str:
    """The explanation of a rule or condensation, or the sentence on what it raised."""
    try:
        with guarded(part):
            if not isinstance(words := explain(), str):
                raise TypeError(f"`explain` gave {type(words).__name__}, not a str")
        return words
    except PluginError as error:  # the rest of the explanation stands
        return str(error)


def reasons_at(view: View, around: Neighbourhood) -> list[Reason]:
    """What kept the hypotheses at a place from being a contact, the main reason first.

    Returns:
        Empty where there are no hypotheses of evidence or support: then their absence is the
        reason.
    """
    if (contact := contact_at(view, around)) is not None:
        return [_contact_in(view, around, contact)]
    fusion, (reasons, trouble) = view.fusion, _objections(view, around)
    if around.best != NONE:
        code = int(fusion.verdict_codes[around.best])
        reasons = reasons or [_of_verdict(code, view, around)]
        if code != kernels.NULLED and fusion.condensation.looks_at_voxels:
            reasons += _nulled(view, around)
    return reasons + trouble


def _objections(view: View, around: Neighbourhood) -> tuple[list[Reason], list[Reason]]:
    """The objections of the condensation to a contact, and the reason of what it raised."""
    fusion, condensation = view.fusion, view.fusion.condensation
    try:
        with guarded(condensation):
            found = [*condensation.objections(fusion.field, fusion.verdict_codes, around)]
            if others := [item for item in found if not isinstance(item, Reason)]:
                raise TypeError(f"`objections` gave {type(others[0]).__name__}, not a Reason")
        return found, []
    except PluginError as error:  # the rest of the explanation stands
        return [], [Reason(Why.FAILED, str(error))]


def contact_at(view: View, around: Neighbourhood) -> Contact | None:
    """The contact that lies at a place, or reaches into it."""
    here = nearest(around.position, view.fusion.contacts)
    if here is not None and here[1] <= around.reach:
        return here[0]
    owner = NONE if around.best == NONE else int(view.owners[around.best])
    return None if owner == NONE else view.fusion.contacts[owner]


def _contact_in(view: View, around: Neighbourhood, contact: Contact) -> Reason:
    """That a place belongs to a contact."""
    number = next(n for n, own in enumerate(view.fusion.contacts, 1) if own is contact)
    away = float(np.linalg.norm(contact.position - around.position))
    sentence = (
        f"this is contact {number}, of likelihood {contact.likelihood:.2f}, whose middle is "
        f"{millimetres(away)} away"
    )
    values = {"distance_m": away, "likelihood": contact.likelihood}
    return Reason(Why.CONTACT, sentence, values=values)


def _of_verdict(code: int, view: View, around: Neighbourhood) -> Reason:
    """Why the likeliest voxel is no contact, by the verdict on it."""
    match code:
        case kernels.NULLED:
            return _nulled(view, around)[0]
        case kernels.SUPPORT_ONLY:
            names = [*view.fusion.field.given(around.best)]
            sentence = f"predicted by {' and '.join(names)}, but no sensor felt it"
            return Reason(Why.SUPPORT_ONLY, sentence, names[0])
        case kernels.BELOW_THRESHOLD:
            return _below(view, around)
        case _:
            voxels = int((view.fusion.verdict_codes[around.inside] == kernels.CONTACT).sum())
            sentence = (
                f"{counted(voxels, 'voxel')} over the threshold within "
                f"{millimetres(around.reach)}, of which {view.settings.integrator.condensation} "
                "made no contact"
            )
            return Reason(Why.NOT_CONDENSED, sentence, values={"voxels": float(voxels)})


def _nulled(view: View, around: Neighbourhood) -> list[Reason]:
    """Which sources rule out how much of the evidence and support at a place; empty: none does."""
    entries = view.fusion.field.entries
    held = around.inside & entries.counted_voxels
    ruled = held & (view.fusion.verdict_codes == kernels.NULLED)
    if not ruled.any():
        return []
    found = []
    for source, rows in entries.parts(ruled):
        if source.kind == HypothesisKind.NULL and len(rows):
            row = rows[entries.columns.stamps[rows].argmax()]
            age = float(entries.now - entries.columns.stamps[row]) / 1e9
            found.append((source.name, float(entries.columns.likelihoods[row]), age))
    who = " and ".join(f"{name} (likelihood {p:.2f}, {age:.2f} s old)" for name, p, age in found)
    part = f"{int(ruled.sum())} of {counted(int(held.sum()), 'voxel')}"
    values = {"nulled_voxels": float(ruled.sum()), "told_voxels": float(held.sum())}
    for name, likelihood, age in found:
        values |= {f"{name}.likelihood": likelihood, f"{name}.age_s": age}
    return [Reason(Why.NULLED, f"ruled out by {who} in {part}", found[0][0], values)]


def _below(view: View, around: Neighbourhood) -> Reason:
    likelihood = float(view.fusion.field.likelihoods[around.best])
    short = view.fusion.threshold - likelihood
    digits = 2 if short >= 0.005 else max(2, math.ceil(-math.log10(max(short, 1e-9))))
    return Reason(
        Why.BELOW_THRESHOLD,
        f"likelihood {likelihood:.{digits}f} is {short:.{digits}f} under the threshold "
        f"{view.fusion.threshold:g}",
        values={"likelihood": likelihood, "threshold": view.fusion.threshold, "short": short},
    )
