"""`python -m contactfusion_lab.experiments.touch.tuned`: settings of De Morgan, tuned on touches.

The touches are those of the seeds on which `posterior` was chosen: the settings are chosen on the
first seed, and checked on the second.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pandas as pd
import typer

from contactfusion.arrays import FloatArray
from contactfusion.cli.options import Out
from contactfusion.errors import RobotError
from contactfusion.files import write_whole
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.terminal import note
from contactfusion_lab.experiments.methods import (
    DE_MORGAN,
    DE_MORGAN_TUNED,
    POSTERIOR,
    TUNING_SEEDS,
    Method,
)
from contactfusion_lab.experiments.touch.experiment import TouchExperiment
from contactfusion_lab.experiments.touch.plan import DEFAULT, read_plan
from contactfusion_lab.experiments.touch.record import COARSEST
from contactfusion_lab.experiments.touch.rows import (
    ALL,
    ALL_AND_SIMULATOR,
    NEAR,
    everything,
    reported,
)
from contactfusion_lab.experiments.touch.trial import Trial, load
from contactfusion_lab.trials.executor import Executor, Local
from contactfusion_lab.trials.folder import as_json, claim, trial_file
from contactfusion_lab.trials.localisation import localisation
from contactfusion_lab.trials.measures import resampled
from contactfusion_lab.trials.runner import Failure, kept, ordered
from contactfusion_lab.trials.tables import as_csv, cell, markdown

VOXELS = (0.005, 0.01, 0.015, 0.02, COARSEST)
"""Sides of voxels that are tried [m]; the first is the papers', as in what follows."""
THRESHOLDS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8)
SIDES = (2.0, 1.0)
"""Distances at which voxels belong to one contact, in sides of a voxel."""
MASSES = (None, 0.5, 1.0)
"""Least sums of `cluster_mass`; None: `cluster_centroid`."""
CUTS = (1.0, 0.8, 0.5)
"""Likelihoods at which p is cut off; 1: as each generator does."""
NEARS: tuple[Literal["evidence", "support"], ...] = ("evidence", "support")
SHARES = (9, 3, 1)
"""Of so many trials one is evaluated in each round; a third of the settings go on to the next."""
NOISE = "prototype"
CHECKED = 5
"""Number of the best that are checked on the second seed."""


@dataclass(frozen=True)
class Options:
    """Options of the search.

    Attributes:
        directions: how many directions to come from.
        repeats: how often each.
        executor: the workers; they change nothing but the time.
    """

    directions: int = 15
    repeats: int = 5
    executor: Executor = Local()


def candidates() -> list[Method]:
    """All settings that are tried; those nearest to the papers' first."""
    return [
        Method(
            "de_morgan",
            "cluster_mass" if mass else "cluster_centroid",
            name=f"voxels {1e3 * side:g} mm, threshold {threshold:g}, linked within {sides:g} "
            f"sides, mass {mass or '-'}, p up to {cut:g}, range as {near}",
            options=(
                ("voxel_size", side),
                ("threshold", threshold),
                ("tolerance", sides * side),
                *([("condensation_options", (("mass_threshold", mass),))] if mass else []),
            ),
            p_max=cut,
            near=near,
        )
        for side, threshold, sides, mass, cut, near in itertools.product(
            VOXELS, THRESHOLDS, SIDES, MASSES, CUTS, NEARS
        )
    ]


def tune(options: Options, out: Path) -> Method:
    """Search, check, and write what was found; touches that are made already are kept.

    Args:
        options: how many touches.
        out: the folder that takes tried.csv, table.md, summary.json and a folder of each seed.

    Returns:
        The best settings on the first seed.

    Raises:
        ConfigurationError: `out` holds touches of other options.
        RobotError: a touch could not be made; the others are kept.
    """
    first, second = (_made(options, seed, out / f"seed_{seed}") for seed in TUNING_SEEDS)
    left, lines = candidates(), list[Mapping[str, object]]()
    for number, share in enumerate(SHARES):
        costs = {
            method: values.mean()
            for method, values in rated(left, first[::share], options.executor).items()
        }
        lines += [
            {"round": number, "touches": len(first[::share]), "settings": str(method),
             "gospa": cost}
            for method, cost in costs.items()
        ]  # fmt: skip
        left = sorted(left, key=costs.__getitem__)[: max(len(left) // 3, CHECKED)]
    shown = dict.fromkeys([*left[:CHECKED], DE_MORGAN, POSTERIOR, DE_MORGAN_TUNED])
    costs_by_seed = [rated(list(shown), files, options.executor) for files in (first, second)]
    table = [[str(method), *(_cell(costs[method]) for costs in costs_by_seed)] for method in shown]
    counts = [f"seed {seed}: GOSPA cm" for seed in TUNING_SEEDS]
    write_whole(out / "table.md", markdown(["", *counts], table) + "\n")
    write_whole(out / "tried.csv", as_csv(pd.DataFrame(lines)))
    summary = {
        str(method): [float(costs[method].mean()) for costs in costs_by_seed] for method in shown
    }
    write_whole(out / "summary.json", as_json({"best": str(left[0]), "gospa": summary}))
    note((out / "table.md").read_text(), lines=True)
    return left[0]


def rated(
    methods: Sequence[Method], files: Sequence[Path], executor: Executor
) -> dict[Method, FloatArray]:
    """The costs of methods, of each trial: its GOSPA, the mean over three rows [m].

    The rows are all, all + simulator and every generator.

    Args:
        methods: how hypotheses are fused.
        files: the trials, touches and their twins in free air.
        executor: the workers.
    """
    tasks = {f"settings {number}": method for number, method in enumerate(methods)}
    costs = ordered(partial(_costs, files=tuple(files)), tasks, executor.local)
    return dict(zip(methods, costs, strict=True))


def _costs(method: Method, files: Sequence[Path]) -> FloatArray:
    config = _pipeline()
    rows = (ALL, ALL_AND_SIMULATOR, everything(config))
    costs = [
        localisation(trial.places, reported(trial.last, row, method, config), NEAR).gospa
        for trial in map(_ending, files)
        for row in rows
    ]
    return np.asarray(np.reshape(costs, (-1, len(rows))).mean(axis=1))


@cache
def _pipeline() -> PipelineConfig:
    return read_plan(DEFAULT, [], 1, NOISE, (), 0)[0].pipeline


@cache
def _ending(path: Path) -> Trial:
    return load(path).ending


def _made(options: Options, seed: int, out: Path) -> list[Path]:
    """The files of the touches of a seed; those that are not there yet are made.

    Raises:
        ConfigurationError: `out` holds touches of other options.
        RobotError: a touch could not be made.
    """
    plan, targets = read_plan(DEFAULT, [], options.directions, NOISE, (), seed)
    experiment = TouchExperiment(plan, targets, options.repeats, (), (), 0.0)
    tasks, suffix = experiment.tasks(), experiment.suffix
    claim(experiment.settings(), out, experiment.addable, experiment.trials)
    made = kept(experiment.make, tasks, out, suffix, experiment.trials, options.executor)
    failed = [result.why for _, result in made if isinstance(result, Failure)]
    if failed:
        raise RobotError(f"{len(failed)} of {len(tasks)} touches were not made: {failed[0]}")
    return [trial_file(out, name, suffix) for name in tasks]


def _cell(costs: FloatArray) -> str:
    return cell(*resampled(costs, np.mean, np.random.default_rng(0)), scale=100.0, form=".2f")


def main(
    directions: Annotated[int, typer.Option(min=1, help="Number of approach directions.")] = 15,
    repeats: Annotated[int, typer.Option(min=1, help="Touches per direction and seed.")] = 5,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes.")] = 2,
    out: Out = Path("out/tune_touch"),
) -> None:
    """Tune De Morgan on touches; resumes where it stopped."""
    tune(Options(directions, repeats, Local(workers)), out)


if __name__ == "__main__":
    typer.run(main)
