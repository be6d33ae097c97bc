"""Rows and methods against each other, on the same touches."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from scipy.stats import wilcoxon

from contactfusion.arrays import FloatArray
from contactfusion_lab.experiments.measures import CONFIDENCE, RESAMPLES, mcnemar
from contactfusion_lab.experiments.touch.rows import SINGLE, Outcome


@dataclass(frozen=True)
class Comparison:
    """One row and method against another.

    Attributes:
        row: the name of the row.
        method: how it was fused.
        against_row: the row that it is compared with.
        against_method: how that was fused.
        touches: how many both went through.
        detected_by_it_only: touches.
        detected_by_the_other_only: touches.
        p_of_detection: by McNemar's exact test, on the touches that only one of them detects.
        both_report: touches in which both report a contact: ε is compared on these.
        median_difference: the median over touches of the difference of ε [m]; None without any.
        p_of_error: by Wilcoxon's signed ranks.
        difference_of_medians: of ε [m], less than 0 where it is better; None without any.
        low: the lower end of its 95 % interval [m].
        high: the upper end [m].
    """

    row: str
    method: str
    against_row: str
    against_method: str
    touches: int
    detected_by_it_only: int
    detected_by_the_other_only: int
    p_of_detection: float
    both_report: int
    median_difference: float | None
    p_of_error: float
    difference_of_medians: float | None
    low: float | None
    high: float | None


def compare(found: Sequence[Outcome], other: Sequence[Outcome], seed: int) -> Comparison:
    """Compare outcomes touch by touch; those in free air have no say.

    Args:
        found: of one row and method.
        other: of another, of the same touches in the same order.
        seed: of the interval, a bootstrap over touches; each comparison has chance of its own.
    """
    pairs = [
        (one, another)
        for one, another in zip(found, other, strict=True)
        if not one.touch.short and one.true_contacts
    ]
    only_it = sum(one.detected and not another.detected for one, another in pairs)
    only_other = sum(another.detected and not one.detected for one, another in pairs)
    errors = np.array([(one.error, another.error) for one, another in pairs]).reshape(-1, 2)
    errors = errors[np.isfinite(errors).all(axis=1)]
    differences = errors[:, 0] - errors[:, 1]
    names = (found[0].row, found[0].method, other[0].row, other[0].method)
    rng = np.random.default_rng([seed, crc32(", ".join(names).encode())])
    return Comparison(
        *names,
        len(pairs),
        only_it,
        only_other,
        mcnemar(only_it, only_other),
        len(errors),
        float(np.median(differences)) if len(errors) else None,
        float(wilcoxon(differences).pvalue) if differences.any() else 1.0,
        *(_difference_of_medians(errors, rng) if len(errors) else (None, None, None)),
    )


def _difference_of_medians(
    errors: FloatArray, rng: np.random.Generator
) -> tuple[float, float, float]:
    """Give the difference of two medians with its interval; pairs of shape (n, 2) are drawn."""
    drawn = np.median(errors[rng.integers(len(errors), size=(RESAMPLES, len(errors)))], axis=1)
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(drawn[:, 0] - drawn[:, 1], [tail, 1.0 - tail])
    one, other = np.median(errors, axis=0)
    return float(one - other), float(low), float(high)


def best_single(outcomes: Mapping[str, Sequence[Outcome]]) -> str:
    """Name the one of `SINGLE` that detects the most touches; by row, of one method."""

    def detected(row: str) -> int:
        return sum(one.detected for one in outcomes[row] if not one.touch.short)

    return max((row for row in SINGLE if row in outcomes), key=detected)


def comparisons_text(comparisons: Sequence[Comparison]) -> str:
    """Give comparisons of one method as Markdown; another method is named, if it is one."""
    lines = [
        "| row | against | detected by it only | by the other only | p | both report | "
        "ε median difference cm | p | difference of medians cm |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for one in comparisons:
        against = one.against_row if one.method == one.against_method else one.against_method
        lines.append(
            f"| {one.row} | {against} | {one.detected_by_it_only} | "
            f"{one.detected_by_the_other_only} | {one.p_of_detection:.2g} | {one.both_report} | "
            f"{_cm(one.median_difference)} | {one.p_of_error:.2g} | "
            f"{_cm(one.difference_of_medians)} [{_cm(one.low)}, {_cm(one.high)}] |"
        )
    return "\n".join(lines)


def _cm(metres: float | None) -> str:
    return "-" if metres is None else f"{metres * 100.0:.2f}"
