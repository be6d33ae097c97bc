"""The rules that combine the likelihoods of several sources in one voxel (method §2)."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field as FieldOf

from contactfusion.hooks import hookimpl
from contactfusion.integrator import kernels
from contactfusion.integrator.entries import Entries, Field, Source
from contactfusion.integrator.kernels import CLIP, Likelihoods, Places
from contactfusion.integrator.posterior import Posterior
from contactfusion.integrator.sets import Sets
from contactfusion.integrator.store import Int64Array
from contactfusion.model import Model
from contactfusion.rule import Rule, by_sources
from contactfusion.surface import Surface


class DeMorgan(Rule):
    """H = 1 - Π(1 - p): at least one source is right, and they err independently (F Eq 1)."""

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """The likelihoods by De Morgan's law."""
        return Field(entries, kernels.de_morgan(*_given(entries)))

    def explain(self, field: Field, row: int) -> str:
        """The product of what each source leaves."""

        def formula(given: Sequence[float], fused: float) -> str:
            return f"1 - {''.join(f'(1 - {p:.2f})' for p in given)} = {fused:.2f}"

        return by_sources(field, row, formula)


class Largest(Rule):
    """The largest likelihood: the sources repeat each other."""

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """The largest likelihoods."""
        return Field(entries, kernels.largest(*_given(entries)))

    def explain(self, field: Field, row: int) -> str:
        """The likelihoods, of which the largest counts."""

        def formula(given: Sequence[float], fused: float) -> str:
            return f"max({', '.join(f'{p:.2f}' for p in given)}) = {fused:.2f}"

        return by_sources(field, row, formula)


class PriorConfig(Model):
    """What is expected without evidence."""

    prior: float = FieldOf(default=0.05, gt=0, lt=1)
    """The probability of a contact without any evidence."""


class LogOdds(Rule):
    """Adds log odds over a prior: likelihoods under the prior speak against a contact."""

    Config = PriorConfig

    def __init__(self, config: PriorConfig) -> None:
        super().__init__(config)
        self._prior = config.prior

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """The likelihoods by the sum of log odds."""
        return Field(entries, kernels.log_odds(*_given(entries), self._prior))

    def explain(self, field: Field, row: int) -> str:
        """The log odds that each source adds to those of the prior."""

        def formula(given: Sequence[float], fused: float) -> str:
            prior = _log_odds(self._prior)
            odds = [_log_odds(p) - prior for p in given]
            terms = "".join(f" {'-' if odd < 0 else '+'} {abs(odd):.2f}" for odd in odds)
            return f"log odds {prior:.2f}{terms} = {prior + sum(odds):.2f}, that is {fused:.2f}"

        return by_sources(field, row, formula)


class DempsterShafer(Rule):
    """Dempster's rule over contact, no contact and unknown, with the conflict of the sources."""

    Config = PriorConfig

    def __init__(self, config: PriorConfig) -> None:
        super().__init__(config)
        self._prior = config.prior

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """The likelihoods by Dempster's rule, and the conflict of the sources."""
        fused, conflict = kernels.dempster_shafer(*_given(entries), self._prior)
        return Field(entries, fused, {"conflict": conflict})

    def explain(self, field: Field, row: int) -> str:
        """The mass that each source gives, and their conflict."""

        def formula(given: Sequence[float], fused: float) -> str:
            masses = ", ".join(_mass(p, self._prior) for p in given)
            return f"{masses}; {fused:.2f}, conflict {field.details['conflict'][row]:.2f}"

        return by_sources(field, row, formula)


def _log_odds(p: float) -> float:
    p = min(max(p, CLIP), 1.0 - CLIP)
    return math.log(p / (1.0 - p))


def _mass(p: float, prior: float) -> str:
    if p >= prior:
        return f"{(p - prior) / (1.0 - prior):.2f} for a contact"
    return f"{(prior - p) / prior:.2f} against one"


def _given(entries: Entries) -> tuple[Places, int, Int64Array, NDArray[np.bool_], Likelihoods]:
    """The arguments of every rule's kernel."""
    likelihoods = entries.columns.likelihoods
    return entries.places, len(entries.keys), entries.begin, entries.counted, likelihoods


@hookimpl
def contactfusion_rules() -> Mapping[str, type[Rule]]:
    """Offer the rules of method §2."""
    return {
        "de_morgan": DeMorgan,
        "max": Largest,
        "log_odds": LogOdds,
        "dempster_shafer": DempsterShafer,
        "posterior": Posterior,
        "sets": Sets,
    }
