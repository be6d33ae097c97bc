"""The table of the experiment: figures with their intervals, by row and method."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.pipeline_config import PipelineConfig
from contactfusion_lab.experiments.touch.rows import Outcome, modality_of
from contactfusion_lab.experiments.touch.trial import Trial
from contactfusion_lab.trials.measures import Measure, proportion, resampled

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
LEVELS = (0.68, 0.95)
"""So many true contacts should lie within."""
DRAWN = 1000
"""So many places are drawn from what a cloud states."""
LEAST = 1e-3
"""A place is not known better than to this [m]; keeps a spread of 0 from being a certainty."""


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
    """The table of one method as Markdown, beside the papers' figures.

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
    """ε of touches at one place and of those at several as Markdown; see `table_text`."""
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
    """Measures of proportions as Markdown, one line each.

    Args:
        measures: of any kind.
        experiment: which of them.
    """
    lines = ["| | | % | n |", "|---|---|---|---|"]
    for one in measures:
        if one.experiment == experiment:
            lines.append(f"| {one.case} | {one.metric} | {_percent(one)} | {one.n} |")
    return "\n".join(lines)


def level_of(cloud: HypothesisCloud, place: FloatArray, rng: np.random.Generator) -> float:
    """How far out a place lies in what a cloud states: 0 in its midst, 1 beyond all of it.

    The cloud is read as a mixture of Gaussians, one a hypothesis, weighted by likelihood, as wide
    as its spread; the level is the part of the mixture that is denser than the place. Levels of
    true contacts are uniform when spreads are honest.

    Args:
        cloud: what a source said; not empty, with spreads.
        place: shape (3,) [m], where the contact was.
        rng: draws from the mixture.
    """
    assert cloud.spreads is not None
    weights = cloud.likelihoods / cloud.likelihoods.sum()
    spreads = np.maximum(cloud.spreads, LEAST)
    rows = rng.choice(len(weights), size=DRAWN, p=weights)
    drawn = cloud.positions[rows] + spreads[rows, None] * rng.standard_normal((DRAWN, 3))
    places = np.concatenate([place[None], drawn])
    densities = np.empty(len(places))
    for begin in range(0, len(places), 100):
        part = places[begin : begin + 100]
        squared = ((part[:, None] - cloud.positions) ** 2).sum(axis=2) / spreads**2
        densities[begin : begin + 100] = np.exp(-0.5 * squared) @ (weights / spreads**3)
    return float((densities[1:] > densities[0]).mean())


def coverage(
    trials: Sequence[Trial], config: PipelineConfig, rng: np.random.Generator
) -> list[Measure]:
    """Measure for each modality how many true contacts lie within its spreads.

    Args:
        trials: of touches with one true contact; others are left out.
        config: the pipeline that felt them.
        rng: draws from what is stated.
    """
    grid = Grid(config.integrator.frame, config.integrator.voxel_size)
    levels: dict[str, list[float]] = {}
    ruled_out: list[bool] = []
    for trial in trials:
        if len(trial.places) != 1 or trial.touch.short:
            continue
        for name, cloud in trial.clouds.items():
            if cloud.kind == HypothesisKind.NULL:
                there = grid.voxels(cloud.positions) == grid.voxels(trial.places)
                ruled_out.append(bool(there.all(axis=1).any()))
            elif cloud.likelihoods.any() and cloud.spreads is not None:
                level = level_of(cloud, trial.places[0], rng)
                levels.setdefault(modality_of(config, name), []).append(level)
    measures = []
    for modality, found in levels.items():
        for asked in LEVELS:
            value, low, high = proportion(np.array(found) <= asked)
            metric = f"true contacts within {asked:.0%} of what is stated"
            measures.append(Measure("spreads", modality, metric, value, low, high, "", len(found)))
    if ruled_out:
        value, low, high = proportion(np.array(ruled_out))
        metric = "true contacts ruled out"
        measures.append(
            Measure("spreads", "free space", metric, value, low, high, "", len(ruled_out),
                    better="less")
        )  # fmt: skip
    return measures
