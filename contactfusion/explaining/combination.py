"""How the likelihood of a voxel comes of those of the sources, as a formula with its numbers."""

import itertools
import math
from collections.abc import Sequence

from contactfusion.arrays import FloatArray
from contactfusion.explaining.settings import Settings
from contactfusion.explaining.spots import Spot
from contactfusion.explaining.view import NOBODY, View
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.kernels import CLIP
from contactfusion.integrator.rules import PriorConfig


def combined(view: View, spot: Spot, likelihood: float | None = None) -> str:
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
    for source, counted, (begin, end) in zip(
        entries.sources, entries.counted, itertools.pairwise(entries.begin.tolist()), strict=True
    ):
        here = begin + (entries.places[begin:end] == row).nonzero()[0]
        if counted and len(here):
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
