"""Figures with their intervals, and cases compared trial by trial by paired tests."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal
from zlib import crc32

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import binomtest, bootstrap, norm, rankdata, wilcoxon
from scipy.stats import t as student
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.proportion import proportion_confint

from contactfusion.arrays import FloatArray

RESAMPLES = 2000
CONFIDENCE = 0.95
STARS = ((0.001, "***"), (0.01, "**"), (0.05, "*"))
CASE, TRIAL = "case", "trial"
"""The columns of a data frame that name what is compared, and the trial that all make."""


@dataclass(frozen=True, slots=True)
class Measure:
    """One figure of an experiment.

    Attributes:
        experiment: e.g. "force_plates".
        case: what it was measured on, e.g. "plate_1".
        metric: what was measured.
        value: the figure.
        low: the lower end of its 95 % interval.
        high: the upper end.
        unit: of all three; "" for a proportion.
        n: how many samples it is from.
        asked: what is asked of it, e.g. 0.99, or None.
        better: whether more or less is better.
        note: how it is to be read.
    """

    experiment: str
    case: str
    metric: str
    value: float
    low: float
    high: float
    unit: str
    n: int
    asked: float | None = None
    better: Literal["more", "less"] = "more"
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the figure is what was asked; None when nothing was."""
        if self.asked is None:
            return None
        return self.value >= self.asked if self.better == "more" else self.value <= self.asked

    def __str__(self) -> str:
        verdict = {None: "", True: ", met", False: ", NOT met"}[self.met]
        sign = "≥" if self.better == "more" else "≤"
        asked = "" if self.asked is None else f" (asked {sign} {self.asked:g}{verdict})"
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"{self.experiment}, {self.case}: {self.metric} {self.value:.4g}{unit} "
            f"[{self.low:.4g}, {self.high:.4g}], n = {self.n}{asked}"
        )


def proportion(
    hits: NDArray[np.bool_], groups: Sequence[object] | NDArray[np.generic] | None = None
) -> tuple[float, float, float]:
    """A proportion with its Wilson interval; NaN of nothing.

    Args:
        hits: shape (n,).
        groups: shape (n,), hits of one group depend on each other; None: all are independent. The
            interval is that of an effective number of independent hits: as many as would give the
            proportion the variance that the groups give it, fewer where few groups tell it (Korn &
            Graubard 1998; Dean & Pagano 2015), or, where all hits are alike, as there are groups.
    """
    n = len(hits)
    if not n:
        return np.nan, np.nan, np.nan
    share, effective = float(np.mean(hits)), float(n)
    if groups is not None:
        number = np.unique(np.asarray(groups), return_inverse=True)[1].ravel()
        deviations = np.bincount(number, hits - share)
        count = len(deviations)
        if share in (0.0, 1.0) or count == 1:
            effective = float(count)
        elif variance := float(np.square(deviations).sum()) * count / (count - 1) / n**2:
            quantile = 0.5 + CONFIDENCE / 2.0
            known = float(norm.ppf(quantile) / student.ppf(quantile, count - 1)) ** 2
            effective = min(share * (1.0 - share) / variance * known, float(n))
    ends = proportion_confint(share * effective, effective, 1.0 - CONFIDENCE, "wilson")
    low, high = np.asarray(ends, np.float64).tolist()
    return share, min(max(low, 0.0), share), max(min(high, 1.0), share)


def grouped(
    values: FloatArray,
    statistic: Callable[[FloatArray], float],
    groups: Sequence[object] | NDArray[np.generic],
    rng: np.random.Generator,
    *,
    is_biased: bool = False,
) -> tuple[float, float, float]:
    """A statistic with its bootstrap interval, NaN of nothing; whole groups are drawn.

    Args:
        values: shape (n,).
        statistic: of such values.
        groups: shape (n,), values of one group depend on each other (a trial, a place, a moment).
        rng: draws the groups.
        is_biased: whether the statistic grows with the variance of what is drawn, such as a square:
            then the interval is moved by as much as the mean of the drawn ones differs.
    """
    if not len(values):
        return np.nan, np.nan, np.nan
    _, number = np.unique(np.asarray(groups), return_inverse=True)
    members = [values[number == group] for group in range(number.max() + 1)]

    def of_groups(drawn: NDArray[np.int64]) -> float:
        return statistic(np.concatenate([members[group] for group in drawn]))

    rows = np.arange(len(members))
    return _bootstrap(rows, of_groups, rng, vectorized=False, is_biased=is_biased)


def resampled(
    values: FloatArray, statistic: Callable[..., Any], rng: np.random.Generator
) -> tuple[float, float, float]:
    """A statistic with its bootstrap interval; values are independent.

    Args:
        values: shape (n,).
        statistic: of the last axis of an array; takes `axis`.
        rng: draws the values.
    """
    return _bootstrap(values, statistic, rng, vectorized=True)


def _bootstrap(
    values: NDArray[Any],
    statistic: Any,
    rng: np.random.Generator,
    *,
    vectorized: bool,
    is_biased: bool = False,
) -> tuple[float, float, float]:
    value = float(statistic(values, axis=-1) if vectorized else statistic(values))
    if len(values) < 2:  # which scipy refuses
        return value, value, value
    drawn = bootstrap(
        (values,), statistic, vectorized=vectorized, axis=-1, n_resamples=RESAMPLES, rng=rng,
        confidence_level=CONFIDENCE, method="percentile",
    )  # fmt: skip
    interval = drawn.confidence_interval
    bias = float(drawn.bootstrap_distribution.mean()) - value if is_biased else 0.0
    return value, float(interval.low) - bias, float(interval.high) - bias


def mcnemar(only_one: int, only_other: int) -> float:
    """The p-value of McNemar's exact test.

    Args:
        only_one: in so many pairs only the first has succeeded.
        only_other: in so many only the second.
    """
    differing = only_one + only_other
    return float(binomtest(only_one, differing).pvalue) if differing else 1.0


def auc(positive: FloatArray, negative: FloatArray) -> float:
    """The area under the ROC curve: how often a positive scores above a negative."""
    ranks = rankdata(np.concatenate([positive, negative]))[: len(positive)]
    n, m = len(positive), len(negative)
    return float((ranks.sum() - n * (n + 1) / 2.0) / (n * m))


def p50(values: FloatArray) -> float:
    """The median."""
    return float(np.median(values))


def p90(values: FloatArray) -> float:
    """The 90th percentile."""
    return float(np.quantile(values, 0.9))


def parts_of(frame: pd.DataFrame, by: str | Sequence[str] = CASE) -> dict[Any, pd.DataFrame]:
    """The parts of a data frame by the value, or values, of columns, in their order."""
    return dict(iter(frame.groupby(by if isinstance(by, str) else list(by), sort=False)))


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
        if case not in cases or against not in cases:
            continue
        both = cases[case].index.intersection(cases[against].index, sort=False)
        first, second, names = cases[case].loc[both], cases[against].loc[both], (case, against)
        found.append(_of_flags(*names, success, first[success], second[success]))
        for measure in measures:
            values = np.stack([first[measure], second[measure]], axis=1).astype(np.float64)
            values = values[np.isfinite(values).all(axis=1)]
            rng = np.random.default_rng([seed, crc32(", ".join((*names, measure)).encode())])
            found.append(_of_numbers(*names, measure, values, rng))
    for column in (success, *measures):
        found = _corrected(found, column)
    return found


def _of_flags(
    case: str, against: str, column: str, first: "pd.Series[bool]", second: "pd.Series[bool]"
) -> Comparison:
    only_it, only_other = int((first & ~second).sum()), int((second & ~first).sum())
    p = mcnemar(only_it, only_other)
    return Comparison(
        case, against, column, len(first), only_it, only_other, None, None, None, None, p
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

    def statistic(first: FloatArray, second: FloatArray, axis: int = -1) -> FloatArray:
        found: FloatArray = np.median(first, axis=axis) - np.median(second, axis=axis)
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
        values = np.asarray(multipletests([found[row].p for row in rows], method="holm")[1])
        for row, p in zip(rows, values.tolist(), strict=True):
            found[row] = replace(found[row], p_holm=p)
    return found
