"""Cases compared trial by trial: paired tests, their corrections, and the table of them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
import pandas as pd
from scipy.stats import bootstrap, wilcoxon
from statsmodels.stats.multitest import multipletests

from contactfusion.arrays import FloatArray
from contactfusion_lab.trials.measures import CONFIDENCE, RESAMPLES, mcnemar
from contactfusion_lab.trials.tables import TRIAL, Units, cell, markdown, parts_of

STARS = ((0.001, "***"), (0.01, "**"), (0.05, "*"))


@dataclass(frozen=True)
class Comparison:
    """One case against another in one column, on the trials that both made.

    Attributes:
        case: what is compared.
        against: what it is compared with.
        measure: the column of results.csv.
        trials: in which both have a value.
        only_it: of flags, the trials in which only the case has it; None of numbers.
        only_other: the trials in which only the other has it.
        difference: of numbers, the median over trials of the differences, less than 0 where the
            case has less; None of flags, and without trials.
        of_medians: the difference of the medians likewise.
        low: the lower end of its 95 % interval, a bootstrap over trials.
        high: the upper end.
        p: of flags by McNemar's exact test, of numbers by Wilcoxon's signed ranks.
        p_holm: as it counts among all comparisons in this column (Holm 1979).
    """

    case: str
    against: str
    measure: str
    trials: int
    only_it: int | None
    only_other: int | None
    difference: float | None
    of_medians: float | None
    low: float | None
    high: float | None
    p: float
    p_holm: float = np.nan

    @property
    def stars(self) -> str:
        """The corrected p-value as figures show it."""
        return next((stars for level, stars in STARS if self.p_holm < level), "n.s.")


def compared(
    frame: pd.DataFrame,
    pairs: Iterable[tuple[str, str]],
    success: str,
    measures: Sequence[str],
    seed: int,
) -> list[Comparison]:
    """Compare cases in a success and in measures, where these are finite in both.

    Args:
        frame: of all trials.
        pairs: each a case and what it is compared with.
        success: a column of flags.
        measures: columns of numbers.
        seed: of the intervals; each comparison has chance of its own.
    """
    cases = {case: part.set_index(TRIAL) for case, part in parts_of(frame).items()}
    found = list[Comparison]()
    for case, against in pairs:
        both = cases[case].index.intersection(cases[against].index, sort=False)
        one, other, names = cases[case].loc[both], cases[against].loc[both], (case, against)
        found.append(_of_flags(*names, success, one[success], other[success]))
        for measure in measures:
            values = np.stack([one[measure], other[measure]], axis=1).astype(np.float64)
            values = values[np.isfinite(values).all(axis=1)]
            rng = np.random.default_rng([seed, crc32(", ".join((*names, measure)).encode())])
            found.append(_of_numbers(*names, measure, values, rng))
    for column in (success, *measures):
        found = _corrected(found, column)
    return found


def _of_flags(
    case: str, against: str, column: str, one: "pd.Series[bool]", other: "pd.Series[bool]"
) -> Comparison:
    only_it, only_other = int((one & ~other).sum()), int((other & ~one).sum())
    p = mcnemar(only_it, only_other)
    return Comparison(
        case, against, column, len(one), only_it, only_other, None, None, None, None, p
    )


def _of_numbers(
    case: str, against: str, column: str, values: FloatArray, rng: np.random.Generator
) -> Comparison:
    n, differences = len(values), values[:, 0] - values[:, 1]
    changed = differences[differences != 0.0]
    p = float(wilcoxon(changed).pvalue) if len(changed) else 1.0
    difference = float(np.median(differences)) if n else None
    medians, low, high = _of_medians(values, rng) if n else (None, None, None)
    return Comparison(case, against, column, n, None, None, difference, medians, low, high, p)


def _of_medians(values: FloatArray, rng: np.random.Generator) -> tuple[float, float, float]:
    """The difference of two medians with its interval; pairs of shape (n, 2) are drawn."""

    def statistic(one: FloatArray, other: FloatArray, axis: int = -1) -> FloatArray:
        found: FloatArray = np.median(one, axis=axis) - np.median(other, axis=axis)
        return found

    value = float(statistic(*values.T))
    if len(values) < 2:
        return value, value, value
    drawn = bootstrap(
        tuple(values.T), statistic, paired=True, n_resamples=RESAMPLES, rng=rng,
        confidence_level=CONFIDENCE, method="percentile",
    ).confidence_interval  # fmt: skip
    return value, float(drawn.low), float(drawn.high)


def _corrected(comparisons: Sequence[Comparison], column: str) -> list[Comparison]:
    """The comparisons, those in one column with their corrected p-values."""
    rows = [row for row, each in enumerate(comparisons) if each.measure == column]
    found = list(comparisons)
    if rows:
        values = multipletests([found[row].p for row in rows], method="holm")[1]
        for row, p in zip(rows, values.tolist(), strict=True):
            found[row] = replace(found[row], p_holm=p)
    return found


def comparisons_text(comparisons: Sequence[Comparison], units: Units) -> str:
    """Comparisons as Markdown; nothing without any.

    Args:
        comparisons: one row each.
        units: of their columns; one that is not named is told by its name.
    """
    lines = []
    for each in comparisons:
        heading, scale, form = units.get(each.measure, (each.measure, 1.0, "g"))
        counts = ["" if n is None else str(n) for n in (each.only_it, each.only_other)]
        difference = medians = ""
        if each.only_it is None:
            difference = "-" if each.difference is None else f"{each.difference * scale:+{form}}"
            low, high = each.low or 0.0, each.high or 0.0
            medians = cell(each.of_medians, low, high, scale, f"+{form}")
        lines.append(
            [each.case, each.against, heading, str(each.trials), *counts, difference, medians,
             f"{each.p:.2g}", f"{each.p_holm:.2g}"]
        )  # fmt: skip
    headings = ["", "against", "in", "trials", "only it", "only the other", "median difference"]
    return markdown([*headings, "difference of medians", "p", "p (Holm)"], lines) if lines else ""
