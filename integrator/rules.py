"""The rules that combine the likelihoods of several sources in one voxel (method §2)."""

from collections.abc import Mapping, Sequence

from contactfusion.hooks import hookimpl
from contactfusion.integrator import kernels
from contactfusion.integrator.entries import Entries, Field, Source
from contactfusion.integrator.sets import Sets
from contactfusion.rule import Rule, by_sources
from contactfusion.surface import Surface


class DeMorgan(Rule):
    """H = 1 - Π(1 - p): at least one source is right, and they err independently (F Eq 1)."""

    def fuse(self, entries: Entries, sources: Sequence[Source], surface: Surface | None) -> Field:
        """The likelihoods by De Morgan's law."""
        given = entries.begin, entries.counted, entries.columns.likelihoods
        return Field(entries, kernels.de_morgan(entries.places, len(entries.keys), *given))

    def explain(self, field: Field, row: int) -> str:
        """The product of what each source leaves."""

        def formula(given: Sequence[float], fused: float) -> str:
            return f"1 - {''.join(f'(1 - {p:.2f})' for p in given)} = {fused:.2f}"

        return by_sources(field, row, formula)


@hookimpl
def contactfusion_rules() -> Mapping[str, type[Rule]]:
    """Offer the rules of method §2."""
    return {"de_morgan": DeMorgan, "sets": Sets}
