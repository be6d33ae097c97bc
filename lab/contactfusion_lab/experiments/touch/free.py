"""Alarms in free motion: contacts that are reported where there is none, by row and method."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import chi2

from contactfusion.pipeline_config import PipelineConfig
from contactfusion.terminal import Progress
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.experiments.touch.course import reports
from contactfusion_lab.experiments.touch.rows import ROWS, everything
from contactfusion_lab.experiments.touch.trial import FreeTrial, load_free
from contactfusion_lab.trials.executor import Executor
from contactfusion_lab.trials.measures import CASE, CONFIDENCE, Measure, parts_of, resampled
from contactfusion_lab.trials.runner import ordered
from contactfusion_lab.trials.tables import cell, frame_of, markdown

MINUTE = 60.0


@dataclass(frozen=True)
class Alarms:
    """The alarms of a motion under a row and method.

    Attributes:
        motion: its name.
        object: that stands there, by name.
        row: the name of the row.
        method: how it was fused.
        seconds: how long it lasted [s].
        alarms: number of reports of a contact after none.
        share: of the cycles in which a contact is reported.
    """

    motion: str
    object: str
    row: str
    method: str
    seconds: float
    alarms: int
    share: float


def alarms_of(
    files: Sequence[Path], methods: Sequence[Method], config: PipelineConfig, executor: Executor
) -> pd.DataFrame:
    """Fuse every motion at 20 Hz by every row; motions that touched something are left out.

    Args:
        files: the motions.
        methods: how hypotheses are fused.
        config: the pipeline that received the readings.
        executor: workers on this machine.

    Returns:
        One row a motion, row and method; ROW, METHOD is the case.
    """
    tasks = {path.name: path for path in files}
    found, progress = list[Alarms](), Progress("free motions fused", len(files))
    for alarms in ordered(partial(_alarms_of, methods=methods, config=config), tasks, executor):
        found += alarms
        progress.add(1)
    frame = frame_of(found, Alarms)
    return frame.assign(**{CASE: frame["row"] + ", " + frame["method"]})


def _alarms_of(path: Path, methods: Sequence[Method], config: PipelineConfig) -> list[Alarms]:
    trial = load_free(path)
    if trial.touched:
        return []
    cycles = list(trial.record.cycles(0.0))
    return [
        _alarms(trial, str(method), row.name, [
            len(places) > 0 for _, places in reports(cycles, row, method, config)
        ])
        for method in methods
        for row in (*ROWS, everything(config))
    ]  # fmt: skip


def _alarms(trial: FreeTrial, method: str, row: str, flags: Sequence[bool]) -> Alarms:
    begun = np.diff(flags, prepend=False) & np.array(flags)
    motion, seconds = trial.motion, trial.record.end
    return Alarms(
        motion.name, motion.target, row, method, seconds, int(begun.sum()), float(np.mean(flags))
    )


def measures_of(alarms: pd.DataFrame, seed: int) -> Iterator[Measure]:
    """Measure the alarms a minute, and the share of time in alarm, of each row and method.

    Args:
        alarms: of all motions.
        seed: of the intervals of shares.
    """
    for case, part in parts_of(alarms).items():
        minutes, count = float(part["seconds"].sum()) / MINUTE, int(part["alarms"].sum())
        figures = count / minutes, *poisson(count, minutes)
        yield Measure("free", case, RATE, *figures, "1/min", len(part), better="less")
        shares = resampled(part["share"].to_numpy(), np.mean, np.random.default_rng([seed, 2]))
        yield Measure("free", case, SHARE, *shares, "", len(part), better="less")


RATE, SHARE = "alarms a minute", "time in alarm"


def poisson(count: int, exposure: float) -> tuple[float, float]:
    """The exact interval of the rate of a Poisson process (Garwood 1936).

    Args:
        count: the number of events.
        exposure: the time of observation.
    """
    beyond = (1.0 - CONFIDENCE) / 2.0
    low = chi2.ppf(beyond, 2 * count) / 2.0 if count else 0.0
    return float(low / exposure), float(chi2.isf(beyond, 2 * count + 2) / 2.0 / exposure)


def free_text(measures: Sequence[Measure], rows: Sequence[str], method: str) -> str:
    """The alarms of one method as Markdown; nothing without free motion.

    Args:
        measures: as `measures_of` gives them.
        rows: which, in their order.
        method: which.
    """
    found = {(each.case, each.metric): each for each in measures}
    lines = []
    for row in rows:
        rate = found.get((f"{row}, {method}", RATE))
        share = found.get((f"{row}, {method}", SHARE))
        if rate and share:
            alarms = cell(rate.value, rate.low, rate.high, form=".2f")
            lines.append([row, alarms, cell(share.value, share.low, share.high, 100.0, ".1f")])
    headings = [f"{method}, free motion", RATE, f"{SHARE} %"]
    return markdown(headings, lines) if lines else ""
