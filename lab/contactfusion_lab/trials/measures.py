"""Figures with their intervals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, bootstrap, rankdata

from contactfusion.arrays import FloatArray

RESAMPLES = 2000
CONFIDENCE = 0.95


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


def proportion(hits: NDArray[np.bool_]) -> tuple[float, float, float]:
    """A proportion with its Wilson interval."""
    n, k = len(hits), int(hits.sum())
    interval = binomtest(k, n).proportion_ci(CONFIDENCE, "wilson")
    return k / n, float(interval.low), float(interval.high)


def grouped(
    values: FloatArray,
    statistic: Callable[[FloatArray], float],
    groups: Sequence[object] | NDArray[np.generic],
    rng: np.random.Generator,
) -> tuple[float, float, float]:
    """A statistic with its bootstrap interval; whole groups are drawn.

    Args:
        values: shape (n,).
        statistic: of such values.
        groups: shape (n,), values of one group depend on each other (a trial, a place, a moment).
        rng: draws the groups.
    """
    _, number = np.unique(np.asarray(groups), return_inverse=True)
    members = [values[number == group] for group in range(number.max() + 1)]

    def of_groups(drawn: NDArray[np.int64]) -> float:
        return statistic(np.concatenate([members[group] for group in drawn]))

    rows = np.arange(len(members))
    return _bootstrap(rows, of_groups, rng, vectorized=False)


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
    values: NDArray[Any], statistic: Any, rng: np.random.Generator, *, vectorized: bool
) -> tuple[float, float, float]:
    value = float(statistic(values, axis=-1) if vectorized else statistic(values))
    if len(values) < 2:  # which scipy refuses
        return value, value, value
    interval = bootstrap(
        (values,), statistic, vectorized=vectorized, axis=-1, n_resamples=RESAMPLES, rng=rng,
        confidence_level=CONFIDENCE, method="percentile",
    ).confidence_interval  # fmt: skip
    return value, float(interval.low), float(interval.high)


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
