"""The rules that combine the likelihoods of several sources in one voxel (method §2)."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field as FieldOf

from contactfusion.hooks import hookimpl
from contactfusion.integrator import kernels
from contactfusion.integrator.entries import Entries, Field, Source
from contactfusion.integrator.kernels import Likelihoods, Places
from contactfusion.integrator.posterior import Posterior
from contactfusion.integrator.store import Int64Array
from contactfusion.model import Model
from contactfusion.rule import Rule
from contactfusion.surface import Surface


class DeMorgan(Rule):
    """H = 1 - Π(1 - p): at least one source is right, and they err independently (F Eq 1)."""

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """Fuse by De Morgan's law."""
        return Field(entries, kernels.de_morgan(*_given(entries)))


class Largest(Rule):
    """The largest likelihood: the sources repeat each other."""

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """Fuse by the largest likelihood."""
        return Field(entries, kernels.largest(*_given(entries)))


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
        """Fuse by adding log odds."""
        return Field(entries, kernels.log_odds(*_given(entries), self._prior))


class DempsterShafer(Rule):
    """Dempster's rule over contact, no contact and unknown; tells the conflict of the sources."""

    Config = PriorConfig

    def __init__(self, config: PriorConfig) -> None:
        super().__init__(config)
        self._prior = config.prior

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """Fuse by Dempster's rule."""
        fused, conflict = kernels.dempster_shafer(*_given(entries), self._prior)
        return Field(entries, fused, {"conflict": conflict})


def _given(entries: Entries) -> tuple[Places, int, Int64Array, NDArray[np.bool_], Likelihoods]:
    """Give what every rule's kernel goes through."""
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
    }
