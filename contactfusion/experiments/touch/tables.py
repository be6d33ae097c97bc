"""The table of the experiment: figures with their intervals, by row and method."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, wilcoxon

from contactfusion.arrays import FloatArray
from contactfusion.experiments.measures import CONFIDENCE, RESAMPLES, Measure, proportion
from contactfusion.experiments.touch.rows import SINGLE, Outcome

PUBLISHED = {
    "tactile": (0.209, 0.0125, 0.0020),
    "force": (0.791, 0.0537, 0.0118),
    "range": (0.581, 0.0374, 0.0073),
    "all": (0.907, 0.0431, 0.0110),
    "all + simulator": (0.907, 0.0333, 0.0111),
}
"""Detected, ε and σ [m] of F Table I."""


STATISTICS: dict[str, Callable[[FloatArray], Any]] = {
    "mean": partial(np.mean, axis=-1),
    "median": partial(np.median, axis=-1),
    "p90": partial(np.quantile, q=0.9, axis=-1),
}


def measures_of(outcomes: Sequence[Outcome], seed: int) -> Iterator[Measure]:
    """Measure one row under one method.

    Args:
        outcomes: of all touches and of their twins in free air.
        seed: of the intervals; each row and method has chance of its own.
    """
    row, method = outcomes[0].row, outcomes[0].method
    touches = [one for one in outcomes if not one.touch.short and one.true_contacts]
    in_air = [one for one in outcomes if one.touch.short and not one.true_contacts]
    case = f"{row}, {method}"
    rng = np.random.default_rng([seed, crc32(case.encode())])

    def share(metric: str, hits: Sequence[bool]) -> Iterator[Measure]:
        if hits:
            value, low, high = proportion(np.array(hits))
            yield Measure("touch", case, metric, value, low, high, "", len(hits))

    yield from share("detected", [one.detected for one in touches])
    yield from share("any contact", [one.contacts > 0 for one in touches])
    yield from share("false alarms in free air", [one.contacts > 0 for one in in_air])
    if touches:
        false = np.array([one.false for one in touches], np.float64)
        figures = resampled(false, "mean", rng)
        yield Measure("touch", case, "false contacts a touch", *figures, "", len(false))
    kinds: dict[str, Sequence[Outcome]] = {
        "": touches,
        " of one contact": [one for one in touches if one.true_contacts == 1],
        " of several contacts": [one for one in touches if one.true_contacts > 1],
    }
    for kind, chosen in kinds.items():
        errors = np.array([one.error for one in chosen if np.isfinite(one.error)])
        for name in STATISTICS:
            if len(errors) and (not kind or name != "mean"):
                figures = resampled(errors, name, rng)
                yield Measure("touch", case, f"ε {name}{kind}", *figures, "m", len(errors))
    sigmas = np.array([one.sigma for one in touches if np.isfinite(one.sigma)])
    if len(sigmas):
        figures = resampled(sigmas, "mean", rng)
        yield Measure("touch", case, "σ mean", *figures, "m", len(sigmas))


def resampled(
    values: FloatArray, statistic: str, rng: np.random.Generator
) -> tuple[float, float, float]:
    """Give a statistic with its bootstrap interval; touches are independent.

    Args:
        values: shape (n,), one a touch.
        statistic: one of `STATISTICS`.
        rng: draws the touches.
    """
    drawn = values[rng.integers(len(values), size=(RESAMPLES, len(values)))]
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(STATISTICS[statistic](drawn), [tail, 1.0 - tail])
    return float(STATISTICS[statistic](values)), float(low), float(high)


def best_single(outcomes: Mapping[str, Sequence[Outcome]]) -> str:
    """Name the one of `SINGLE` that detects the most touches; by row, of one method."""

    def detected(row: str) -> int:
        return sum(one.detected for one in outcomes[row] if not one.touch.short)

    return max((row for row in SINGLE if row in outcomes), key=detected)


def paired(better: Sequence[Outcome], single: Sequence[Outcome]) -> dict[str, Any]:
    """Compare a row with a single modality touch by touch.

    Detection by McNemar's exact test on the touches that only one of the two detects, ε by
    Wilcoxon's signed ranks on those in which both report a contact.

    Args:
        better: the outcomes of the row.
        single: those of the modality, of the same touches in the same order.
    """
    pairs = [
        (one, other)
        for one, other in zip(better, single, strict=True)
        if not one.touch.short and one.true_contacts
    ]
    only_one = sum(one.detected and not other.detected for one, other in pairs)
    only_other = sum(other.detected and not one.detected for one, other in pairs)
    errors = np.array([(one.error, other.error) for one, other in pairs]).reshape(-1, 2)
    errors = errors[np.isfinite(errors).all(axis=1)]
    differing = only_one + only_other
    unequal = bool(len(errors)) and bool((errors[:, 0] != errors[:, 1]).any())
    return {
        "row": better[0].row,
        "against": single[0].row,
        "detected by the row only": only_one,
        "detected by the modality only": only_other,
        "p of detection": float(binomtest(only_one, differing).pvalue) if differing else 1.0,
        "both report": len(errors),
        "median difference of ε": float(np.median(errors[:, 0] - errors[:, 1]))
        if len(errors)
        else None,
        "p of ε": float(wilcoxon(errors[:, 0], errors[:, 1]).pvalue) if unequal else 1.0,
    }


def sharing(shares: Sequence[Mapping[tuple[str, str], bool]]) -> list[Measure]:
    """Measure how often two modalities that both spoke share a voxel."""
    spoke: Counter[tuple[str, str]] = Counter()
    met: Counter[tuple[str, str]] = Counter()
    for touch in shares:
        spoke.update(touch.keys())
        met.update(pair for pair, hit in touch.items() if hit)
    measures = []
    for pair in sorted(spoke):
        hits: NDArray[np.bool_] = np.arange(spoke[pair]) < met[pair]
        value, low, high = proportion(hits)
        case = " & ".join(pair)
        measures.append(
            Measure("voxels", case, "touches that share one", value, low, high, "", len(hits))
        )
    return measures


def table_text(measures: Sequence[Measure], rows: Sequence[str], method: str) -> str:
    """Give the table of one method as Markdown, beside the papers' figures.

    Args:
        measures: as `measures_of` gives them.
        rows: which, in their order.
        method: which.
    """
    found = {(one.case, one.metric): one for one in measures}

    def cell(row: str, metric: str, form: Callable[[float], str]) -> str:
        one = found.get((f"{row}, {method}", metric))
        if one is None:
            return "-"
        return f"{form(one.value)} [{form(one.low)}, {form(one.high)}]"

    def percent(value: float) -> str:
        return f"{value * 100:.0f}"

    def cm(value: float) -> str:
        return f"{value * 100:.2f}"

    def number(value: float) -> str:
        return f"{value:.2f}"

    columns: list[tuple[str, str, Callable[[float], str]]] = [
        ("detected %", "detected", percent),
        ("any %", "any contact", percent),
        ("ε mean cm", "ε mean", cm),
        ("median", "ε median", cm),
        ("p90", "ε p90", cm),
        ("σ cm", "σ mean", cm),
        ("false a touch", "false contacts a touch", number),
        ("alarms in air %", "false alarms in free air", percent),
    ]
    lines = [
        f"| {method} | paper: detected %, ε, σ cm | " + " | ".join(c[0] for c in columns) + " |",
        "|" + "---|" * (len(columns) + 2),
    ]
    for row in rows:
        told = PUBLISHED.get(row)
        paper = f"{told[0] * 100:.1f}, {told[1] * 100:.2f}, {told[2] * 100:.2f}" if told else ""
        cells = [cell(row, metric, form) for _, metric, form in columns]
        lines.append(f"| {row} | {paper} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def tests_text(tests: Sequence[Mapping[str, Any]]) -> str:
    """Give the comparisons of `paired` as Markdown."""
    lines = [
        "| row | against | detected by it only | by the other only | p | both report | ε median "
        "difference cm | p |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for one in tests:
        difference = one["median difference of ε"]
        lines.append(
            f"| {one['row']} | {one['against']} | {one['detected by the row only']} | "
            f"{one['detected by the modality only']} | {float(one['p of detection']):.2g} | "
            f"{one['both report']} | {'-' if difference is None else f'{difference * 100:.2f}'} | "
            f"{float(one['p of ε']):.2g} |"
        )
    return "\n".join(lines)


def shares_text(measures: Sequence[Measure], experiment: str) -> str:
    """Give measures of proportions as Markdown, one line each.

    Args:
        measures: of any kind.
        experiment: which of them.
    """
    lines = ["| | | % | n |", "|---|---|---|---|"]
    for one in measures:
        if one.experiment == experiment:
            shares = f"{one.value * 100:.0f} [{one.low * 100:.0f}, {one.high * 100:.0f}]"
            lines.append(f"| {one.case} | {one.metric} | {shares} | {one.n} |")
    return "\n".join(lines)
