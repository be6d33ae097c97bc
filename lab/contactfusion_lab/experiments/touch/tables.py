"""The table of the experiment: figures with their intervals, by row and method."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any
from zlib import crc32

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.pipeline_config import PipelineConfig
from contactfusion_lab.experiments.methods import TUNING_SEEDS
from contactfusion_lab.experiments.touch.rows import TIMED, felt, modality_of
from contactfusion_lab.experiments.touch.trial import Trial
from contactfusion_lab.trials.calibration import brier, squared_calibration_error
from contactfusion_lab.trials.measures import CASE, Measure, grouped, proportion, resampled
from contactfusion_lab.trials.tables import cell, markdown

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
Column = tuple[str, str, tuple[float, str]]
"""A heading, a metric, its scale and its form; "n": how many it is from."""
LEVELS = (0.68, 0.95)
"""Share of the true contacts that should lie within."""
DRAWN = 1000
"""Number of positions drawn from the density that a cloud states."""
LEAST = 1e-3
"""A place is not known better than to this [m]; keeps a spread of 0 from being a certainty."""


PERCENT, CM, NUMBER = (100.0, ".0f"), (100.0, ".2f"), (1.0, ".2f")
COUNT = (1.0, "n")
SETS = (
    ("GOSPA", "gospa", "m"),
    ("GOSPA distance", "gospa_distance", "m"),
    ("GOSPA missed", "gospa_missed", ""),
    ("GOSPA false", "gospa_false", ""),
    ("recall", "recall", ""),
)
"""Means over touches: metric, column of results.csv, unit."""
Score = Callable[[FloatArray, NDArray[np.bool_]], float]
"""Of probabilities and events."""
SECONDS = (1.0, ".2f")
FORCES = {"under 2 N": 2.0, "2 to 4 N": 4.0, "4 to 8 N": 8.0, "over 8 N": np.inf}
"""Bins of press force, and the upper end of each [N]."""
COLUMNS: tuple[Column, ...] = (
    ("detected %", "detected", PERCENT),
    ("any %", "any contact", PERCENT),
    ("ε mean cm", "ε mean", CM),
    ("median", "ε median", CM),
    ("p90", "ε p90", CM),
    ("σ cm", "σ mean", CM),
    ("false a touch", "false contacts a touch", NUMBER),
    ("alarms in air %", "false alarms in free air", PERCENT),
)

BY_CONTACTS: tuple[Column, ...] = (
    ("one contact: n", "ε median of one contact", COUNT),
    ("ε median cm", "ε median of one contact", CM),
    ("p90", "ε p90 of one contact", CM),
    ("several contacts: n", "ε median of several contacts", COUNT),
    ("ε median cm", "ε median of several contacts", CM),
    ("p90", "ε p90 of several contacts", CM),
)
BY_SETS: tuple[Column, ...] = (
    ("GOSPA cm", "GOSPA", CM),
    ("distance in it cm", "GOSPA distance", CM),
    ("missed a touch", "GOSPA missed", NUMBER),
    ("false a touch", "GOSPA false", NUMBER),
    ("recall %", "recall", PERCENT),
    ("in 68 % region: %", "within 68%", PERCENT),
    ("in 95 % region: %", "within 95%", PERCENT),
    ("radius of 95 % cm", "radius of 95 %", CM),
    ("Brier of P(contact)", "Brier", (1.0, ".3f")),
    ("ECE of it", "ECE", (1.0, ".3f")),
)
BY_TIME: tuple[Column, ...] = (
    ("first report: touches", "latency median", COUNT),
    ("median s", "latency median", SECONDS),
    ("p90", "latency p90", SECONDS),
    ("never %", "never reported", PERCENT),
    ("lost a report", "lost again", (1.0, ".3f")),
)


def measures_of(outcomes: pd.DataFrame, seed: int) -> Iterator[Measure]:
    """Measure a row under a method.

    Args:
        outcomes: of all touches and of their twins in free air.
        seed: of the intervals; each row and method has chance of its own.
    """
    case = str(outcomes[CASE].iloc[0])
    touches = felt(outcomes)
    in_air = outcomes[outcomes["short"] & (outcomes["true_contacts"] == 0)]
    rng = np.random.default_rng([seed, crc32(case.encode())])

    def share(metric: str, hits: "pd.Series[bool]") -> Iterator[Measure]:
        if len(hits):
            figures = proportion(hits.to_numpy())
            yield Measure("touch", case, metric, *figures, "", len(hits))

    def figure(metric: str, values: FloatArray, statistic: Any, unit: str) -> Iterator[Measure]:
        if len(values):
            figures = resampled(values, statistic, rng)
            yield Measure("touch", case, metric, *figures, unit, len(values))

    yield from share("detected", touches["detected"])
    yield from share("any contact", touches["contacts"] > 0)
    yield from share("false alarms in free air", in_air["contacts"] > 0)
    false = touches["false"].to_numpy(np.float64)
    yield from figure("false contacts a touch", false, np.mean, "")
    kinds = {
        "": touches,
        " of one contact": touches[touches["true_contacts"] == 1],
        " of several contacts": touches[touches["true_contacts"] > 1],
    }
    for kind, chosen in kinds.items():
        errors = chosen["error"].dropna().to_numpy()
        for name, statistic in STATISTICS.items():
            if not kind or name != "mean":
                yield from figure(f"ε {name}{kind}", errors, statistic, "m")
    for bin_, chosen in by_force(touches).items():
        yield from share(f"detected at {bin_}", chosen["detected"])
        errors = chosen["error"].dropna().to_numpy()
        for name in ("median", "p90"):
            yield from figure(f"ε {name} at {bin_}", errors, STATISTICS[name], "m")
    for metric, column, unit in SETS:
        yield from figure(metric, touches[column].dropna().to_numpy(), np.mean, unit)
    levels = touches["level"].dropna()
    for asked in LEVELS:
        yield from share(f"within {asked:.0%}", levels <= asked)
    radii = touches["radius"].dropna().to_numpy()
    yield from figure("radius of 95 %", radii, np.median, "m")
    yield from _calibration(case, pd.concat([touches, in_air]), rng)
    if outcomes["row"].iloc[0] in TIMED:
        latencies = touches["latency"]
        for name in ("median", "p90"):
            found = latencies.dropna().to_numpy()
            yield from figure(f"latency {name}", found, STATISTICS[name], "s")
        yield from share("never reported", latencies.isna())
        lost = touches.loc[latencies.notna(), "lost"].to_numpy(np.float64)
        yield from figure("lost again", lost, np.mean, "")
    yield from figure("σ mean", touches["sigma"].dropna().to_numpy(), np.mean, "m")


def _calibration(case: str, outcomes: pd.DataFrame, rng: np.random.Generator) -> Iterator[Measure]:
    """Brier score and calibration error of P(contact), which is that of the likeliest contact.

    A touch and its twin in free air are drawn together.
    """
    stated = outcomes["probability"].to_numpy(np.float64)
    events = (outcomes["true_contacts"] > 0).to_numpy(np.bool_)
    groups = outcomes.groupby(["object", "direction", "repeat"], sort=False).ngroup().to_numpy()
    for metric, score in (("Brier", brier), ("ECE", squared_calibration_error)):

        def of_rows(rows: FloatArray, score: Score = score) -> float:
            chosen = rows.astype(np.intp)
            return score(stated[chosen], events[chosen])

        if len(stated) > 1:
            is_squared = score is squared_calibration_error
            rows = np.arange(len(stated), dtype=np.float64)
            figures = np.array(grouped(rows, of_rows, groups, rng, is_biased=is_squared))
            if is_squared:
                figures = np.sqrt(np.maximum(figures, 0.0))
            value, low, high = figures.tolist()
            yield Measure("touch", case, metric, value, low, high, "", len(stated), better="less")


def by_force(touches: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The touches by bins of press force; none where all lie in one."""
    rows = np.searchsorted(list(FORCES.values()), touches["force"], "right")
    parts = {name: touches[rows == row] for row, name in enumerate(FORCES) if (rows == row).any()}
    return parts if len(parts) > 1 else {}


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
    return markdown(
        [method, "paper: detected %, ε, σ cm", *(heading for heading, _, _ in COLUMNS)],
        [[row, _published(row), *own] for row, own in zip(rows, cells, strict=True)],
    )


def sets_text(measures: Sequence[Measure], rows: Sequence[str], method: str) -> str:
    """Contacts as sets, covariances and probabilities as Markdown; see `table_text`."""
    cells = _cells(measures, rows, method, BY_SETS)
    return markdown(
        [method, *(heading for heading, _, _ in BY_SETS)],
        [[row, *own] for row, own in zip(rows, cells, strict=True)],
    )


def contacts_text(measures: Sequence[Measure], rows: Sequence[str], method: str) -> str:
    """ε of touches at one place and of those at several as Markdown; see `table_text`."""
    cells = _cells(measures, rows, method, BY_CONTACTS)
    return markdown(
        [method, *(heading for heading, _, _ in BY_CONTACTS)],
        [[row, *own] for row, own in zip(rows, cells, strict=True)],
    )


def time_text(measures: Sequence[Measure], rows: Sequence[str], method: str) -> str:
    """The time from the first contact to the first report as Markdown; see `table_text`.

    Args:
        measures: as `measures_of` gives them.
        rows: which may be evaluated, in their order.
        method: which.
    """
    timed = {each.case for each in measures if each.metric == "never reported"}
    chosen = [row for row in rows if f"{row}, {method}" in timed]
    cells = _cells(measures, chosen, method, BY_TIME)
    return markdown(
        [method, *(heading for heading, _, _ in BY_TIME)],
        [[row, *own] for row, own in zip(chosen, cells, strict=True)],
    )


def forces_text(forces: Sequence[float]) -> str:
    """Caption of all tables: how hard was pressed, and what was chosen before.

    Args:
        forces: of the touches [N].
    """
    low, middle, high = np.quantile(forces, (0.1, 0.5, 0.9)) if forces else (np.nan,) * 3
    seeds = " and ".join(map(str, TUNING_SEEDS))
    return (
        f"{len(forces)} touches, pressed with {middle:.1f} N (median; 10 % with less than "
        f"{low:.1f} N, 10 % with more than {high:.1f} N). Rules and condensations were chosen on "
        f"touches of the seeds {seeds}, spreads of generators on 45 to 163 touches of other seeds, "
        "all of the box, the cylinder and the sprayer."
    )


def force_text(measures: Sequence[Measure], rows: Sequence[str], method: str) -> str:
    """Detection and ε by press force as Markdown; nothing where all forces lie in one bin.

    Args:
        measures: as `measures_of` gives them.
        rows: which, in their order.
        method: which.
    """
    metrics = {each.metric for each in measures}
    lines = []
    for row in rows:
        for name in FORCES:
            columns = (
                ("n", f"detected at {name}", COUNT),
                ("detected %", f"detected at {name}", PERCENT),
                ("ε median cm", f"ε median at {name}", CM),
                ("p90", f"ε p90 at {name}", CM),
            )
            if f"detected at {name}" in metrics:
                lines.append([row, name, *_cells(measures, [row], method, columns)[0]])
    headings = [method, "press force", "n", "detected %", "ε median cm", "p90"]
    return markdown(headings, lines) if lines else ""


def _cells(
    measures: Sequence[Measure], rows: Sequence[str], method: str, columns: Sequence[Column]
) -> list[list[str]]:
    found = {(each.case, each.metric): each for each in measures}
    return [
        [_cell(found.get((f"{row}, {method}", metric)), *unit) for _, metric, unit in columns]
        for row in rows
    ]


def _cell(measure: Measure | None, scale: float, form: str) -> str:
    if measure is None:
        return "-"
    if form == "n":
        return str(measure.n)
    return cell(measure.value, measure.low, measure.high, scale, form)


def _published(row: str) -> str:
    return ", ".join(
        f"{figure * 100:.{digits}f}"
        for figure, digits in zip(PUBLISHED.get(row, ()), (1, 2, 2), strict=False)
    )


def shares_text(measures: Sequence[Measure], experiment: str) -> str:
    """Measures of proportions as Markdown, one line each.

    Args:
        measures: of any kind.
        experiment: which of them.
    """
    lines = [
        [each.case, each.metric, _cell(each, *PERCENT), str(each.n)]
        for each in measures
        if each.experiment == experiment
    ]
    return markdown(["", "", "%", "n"], lines)


def level_of(cloud: HypothesisCloud, place: FloatArray, rng: np.random.Generator) -> float:
    """Quantile of a position in the density that a cloud states: 0 in its midst, 1 outside.

    The cloud is read as a mixture of Gaussians, one a hypothesis, weighted by likelihood, as wide
    as its spread; the level is the part of the mixture that is denser than the place. Levels of
    true contacts are uniform when spreads are honest.

    Args:
        cloud: of a source; not empty, with spreads.
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
