"""The table of the experiment: figures with their intervals, by row and method."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from contactfusion_lab.experiments.measures import Measure, proportion, resampled
from contactfusion_lab.experiments.touch.rows import Outcome

PUBLISHED = {
    "tactile": (0.209, 0.0125, 0.0020),
    "force": (0.791, 0.0537, 0.0118),
    "range": (0.581, 0.0374, 0.0073),
    "all": (0.907, 0.0431, 0.0110),
    "all + simulator": (0.907, 0.0333, 0.0111),
}
"""Detected, ε and σ [m] of F Table I."""
STATISTICS: dict[str, Callable[..., Any]] = {
    "mean": np.mean,
    "median": np.median,
    "p90": partial(np.quantile, q=0.9),
}


Column = tuple[str, str, Callable[[Measure], str]]
"""A heading, a metric, and how it is told."""


def _percent(one: Measure) -> str:
    return f"{one.value * 100:.0f} [{one.low * 100:.0f}, {one.high * 100:.0f}]"


def _number(one: Measure) -> str:
    return f"{one.value:.2f} [{one.low:.2f}, {one.high:.2f}]"


def _cm(one: Measure) -> str:
    return f"{one.value * 100:.2f} [{one.low * 100:.2f}, {one.high * 100:.2f}]"


def _count(one: Measure) -> str:
    return str(one.n)


COLUMNS: tuple[Column, ...] = (
    ("detected %", "detected", _percent),
    ("any %", "any contact", _percent),
    ("ε mean cm", "ε mean", _cm),
    ("median", "ε median", _cm),
    ("p90", "ε p90", _cm),
    ("σ cm", "σ mean", _cm),
    ("false a touch", "false contacts a touch", _number),
    ("alarms in air %", "false alarms in free air", _percent),
)
BY_CONTACTS: tuple[Column, ...] = (
    ("one contact: n", "ε median of one contact", _count),
    ("ε median cm", "ε median of one contact", _cm),
    ("p90", "ε p90 of one contact", _cm),
    ("several contacts: n", "ε median of several contacts", _count),
    ("ε median cm", "ε median of several contacts", _cm),
    ("p90", "ε p90 of several contacts", _cm),
)


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
        figures = resampled(false, np.mean, rng)
        yield Measure("touch", case, "false contacts a touch", *figures, "", len(false))
    kinds: dict[str, Sequence[Outcome]] = {
        "": touches,
        " of one contact": [one for one in touches if one.true_contacts == 1],
        " of several contacts": [one for one in touches if one.true_contacts > 1],
    }
    for kind, chosen in kinds.items():
        errors = np.array([one.error for one in chosen if np.isfinite(one.error)])
        for name, statistic in STATISTICS.items():
            if len(errors) and (not kind or name != "mean"):
                figures = resampled(errors, statistic, rng)
                yield Measure("touch", case, f"ε {name}{kind}", *figures, "m", len(errors))
    sigmas = np.array([one.sigma for one in touches if np.isfinite(one.sigma)])
    if len(sigmas):
        figures = resampled(sigmas, np.mean, rng)
        yield Measure("touch", case, "σ mean", *figures, "m", len(sigmas))


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
    cells = _cells(measures, rows, method, COLUMNS)
    return _markdown(
        [method, "paper: detected %, ε, σ cm", *(heading for heading, _, _ in COLUMNS)],
        [[row, _published(row), *own] for row, own in zip(rows, cells, strict=True)],
    )


def contacts_text(measures: Sequence[Measure], rows: Sequence[str], method: str) -> str:
    """Give ε of touches at one place and of those at several as Markdown; see `table_text`."""
    cells = _cells(measures, rows, method, BY_CONTACTS)
    return _markdown(
        [method, *(heading for heading, _, _ in BY_CONTACTS)],
        [[row, *own] for row, own in zip(rows, cells, strict=True)],
    )


def _cells(
    measures: Sequence[Measure], rows: Sequence[str], method: str, columns: Sequence[Column]
) -> list[list[str]]:
    found = {(one.case, one.metric): one for one in measures}
    cells = []
    for row in rows:
        told = [(found.get((f"{row}, {method}", metric)), form) for _, metric, form in columns]
        cells.append(["-" if one is None else form(one) for one, form in told])
    return cells


def _published(row: str) -> str:
    told = PUBLISHED.get(row)
    return f"{told[0] * 100:.1f}, {told[1] * 100:.2f}, {told[2] * 100:.2f}" if told else ""


def _markdown(headings: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    ruled = "|" + "---|" * len(headings)
    return "\n".join([_line(headings), ruled, *map(_line, lines)])


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def shares_text(measures: Sequence[Measure], experiment: str) -> str:
    """Give measures of proportions as Markdown, one line each.

    Args:
        measures: of any kind.
        experiment: which of them.
    """
    lines = ["| | | % | n |", "|---|---|---|---|"]
    for one in measures:
        if one.experiment == experiment:
            lines.append(f"| {one.case} | {one.metric} | {_percent(one)} | {one.n} |")
    return "\n".join(lines)
