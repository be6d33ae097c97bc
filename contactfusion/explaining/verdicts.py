"""Why there is no contact at a place where one might be expected."""

import itertools
import math

import numpy as np

from contactfusion.explaining.combination import belief_share, given_in
from contactfusion.explaining.reason import Reason, Why
from contactfusion.explaining.remains import nearest
from contactfusion.explaining.spots import Spot
from contactfusion.explaining.view import NOBODY, View
from contactfusion.explaining.words import counted, millimetres
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import kernels
from contactfusion.integrator.condensations import (
    FAINTEST,
    ClusterCentroidConfig,
    ClusterMassConfig,
)
from contactfusion.integrator.modes import ModesConfig


def verdict(view: View, spot: Spot) -> list[Reason]:
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


def _part_of(view: View, spot: Spot) -> Reason | None:
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


def _of_voxel(code: int, view: View, spot: Spot) -> Reason:
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


def _nulled(view: View, spot: Spot) -> Reason | None:
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


def _support_only(view: View, spot: Spot) -> Reason:
    names, _ = given_in(view.fusion, spot.best)
    sentence = f"predicted by {' and '.join(names)}, but no sensor felt it"
    return Reason(Why.SUPPORT_ONLY, sentence, names[0])


def _below(view: View, spot: Spot) -> Reason:
    likelihood = float(view.fusion.field.likelihoods[spot.best])
    short = view.fusion.threshold - likelihood
    digits = 2 if short >= 0.005 else max(2, math.ceil(-math.log10(max(short, 1e-9))))
    return Reason(
        Why.BELOW_THRESHOLD,
        f"likelihood {likelihood:.{digits}f} is {short:.{digits}f} under the threshold "
        f"{view.fusion.threshold:g}",
        values={"likelihood": likelihood, "threshold": view.fusion.threshold, "short": short},
    )


def _too_few(view: View, spot: Spot) -> Reason:
    voxels = int((view.fusion.verdict_codes[spot.inside] == kernels.CONTACT).sum())
    options = view.settings.condensation
    least = options.min_voxels if isinstance(options, ClusterCentroidConfig) else 1
    return Reason(
        Why.TOO_FEW_VOXELS,
        f"{counted(voxels, 'voxel')} over the threshold within {millimetres(spot.reach)}, where "
        f"{view.settings.integrator.condensation} wants {least} that hang together",
        values={"voxels": float(voxels), "min_voxels": float(least)},
    )


def _too_little_mass(view: View, spot: Spot, least: float) -> Reason:
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


def _believed(view: View, spot: Spot) -> bool:
    """Whether at least 1 % of a belief lies in a spot, hypotheses or none."""
    return belief_share(view.fusion, spot.position, spot.reach) >= 0.01


def _by_belief(view: View, spot: Spot, config: ModesConfig) -> list[Reason]:
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
