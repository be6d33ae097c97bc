"""Sensings and controllers against each other, push by push."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import wilcoxon

from contactfusion_lab.experiments.measures import mcnemar
from contactfusion_lab.experiments.push.outcomes import Outcome

COMPARED = ("lateral_true", "lateral_estimate", "swept", "time")
"""By Wilcoxon's signed ranks, over pushes that both bring to true success (O §III-C)."""
STARS = ((0.001, "***"), (0.01, "**"), (0.05, "*"))


@dataclass(frozen=True)
class Difference:
    """How one measure differs.

    Attributes:
        measure: its name in results.csv.
        pushes: how many pairs there are.
        median: of the differences, in the measure's unit; less than 0 where the first has less.
        p: by Wilcoxon's signed ranks, not corrected for the number of tests.
    """

    measure: str
    pushes: int
    median: float | None
    p: float

    @property
    def stars(self) -> str:
        """The p-value as figures tell it."""
        return next((stars for level, stars in STARS if self.p < level), "n.s.")


@dataclass(frozen=True)
class Comparison:
    """One sensing and controller against another.

    Attributes:
        first: SENSING/CONTROLLER.
        against: the other likewise.
        pushes: that both made.
        first_only: true successes of the first alone.
        other_only: true successes of the other alone.
        p_of_success: by McNemar's exact test.
        differences: of the measures `COMPARED`.
    """

    first: str
    against: str
    pushes: int
    first_only: int
    other_only: int
    p_of_success: float
    differences: tuple[Difference, ...]


def compare_all(found: Mapping[str, Sequence[Outcome]]) -> list[Comparison]:
    """Compare each sensing and controller but the first with one before it.

    That is the first with the same controller; without one, the first with the same sensing;
    without that, too, the first of all.

    Args:
        found: outcomes by sensing and controller.
    """
    comparisons, before = [], list[Sequence[Outcome]]()
    for outcomes in found.values():
        other = outcomes[0]
        alike = [one for one in before if one[0].controller == other.controller]
        alike += [one for one in before if one[0].sensing == other.sensing]
        if before:
            comparisons.append(compare([*alike, before[0]][0], outcomes))
        before.append(outcomes)
    return comparisons


def compare(first: Sequence[Outcome], other: Sequence[Outcome]) -> Comparison:
    """Compare two sensings or controllers on the pushes that both made."""
    by_name = {one.trial: one for one in other}
    pairs = [(one, by_name[one.trial]) for one in first if one.trial in by_name]
    first_only = sum(one.success_true > another.success_true for one, another in pairs)
    other_only = sum(one.success_true < another.success_true for one, another in pairs)
    both = [pair for pair in pairs if pair[0].success_true and pair[1].success_true]
    return Comparison(
        first[0].label,
        other[0].label,
        len(pairs),
        first_only,
        other_only,
        mcnemar(first_only, other_only),
        tuple(_difference(both, measure) for measure in COMPARED),
    )


def _difference(pairs: Sequence[tuple[Outcome, Outcome]], measure: str) -> Difference:
    found = np.array([getattr(one, measure) - getattr(other, measure) for one, other in pairs])
    found = found[np.isfinite(found)]
    changed = found[found != 0.0]
    p = float(wilcoxon(changed).pvalue) if len(changed) else 1.0
    return Difference(measure, len(found), float(np.median(found)) if len(found) else None, p)


def comparisons_text(comparisons: Sequence[Comparison]) -> str:
    """Give comparisons as Markdown."""
    lines = [
        "| | against | true success only it | only the other | p | both | "
        "Δ mean abs. l cm | p | Δ mean abs. l̂ cm | p | Δ swept rad/s | p | Δ time s | p |",
        "|" + "---|" * 14,
    ]
    for one in comparisons:
        cells = [one.first, one.against, f"{one.first_only}", f"{one.other_only}"]
        cells += [f"{one.p_of_success:.2g}", f"{one.differences[0].pushes}"]
        for each, (scale, form) in zip(
            one.differences,
            ((100.0, ".2f"), (100.0, ".2f"), (1.0, ".3f"), (1.0, ".1f")),
            strict=True,
        ):
            median = "-" if each.median is None else f"{each.median * scale:+{form}}"
            cells += [median, f"{each.p:.2g}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
