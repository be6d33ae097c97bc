"""`experiment touch`: touches, each with a twin in free air, and what is made of them."""

import csv
import io
import json
import multiprocessing
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.errors import ConfigurationError, ContactFusionError, RobotError, name_hint
from contactfusion.experiments.measures import Measure
from contactfusion.experiments.touch import figures, tables
from contactfusion.experiments.touch.honesty import honesty
from contactfusion.experiments.touch.plan import DEFAULT, Plan, Touch, read_plan
from contactfusion.experiments.touch.rows import (
    EVERYTHING,
    ROWS,
    Method,
    Outcome,
    outcome,
    shared,
)
from contactfusion.experiments.touch.trial import Trial, load, run_trial, save
from contactfusion.fault_config import read_faults
from contactfusion.files import make_folder, write_whole
from contactfusion.pipeline_config import PipelineConfig

METHODS = (
    Method("de_morgan", "cluster_centroid"),
    Method("de_morgan", "cluster_mass"),
    Method("max", "cluster_centroid"),
    Method("log_odds", "cluster_centroid"),
    Method("dempster_shafer", "cluster_centroid"),
)
"""What the table is made for; the first is the papers'."""
WIDE = [row.name for row in ROWS if len(row.modalities) > 1]
"""The rows that are compared with the best single modality."""
WITHOUT = (next(row for row in ROWS if row.name == "all + simulator"), EVERYTHING)
"""The rows from which every modality is left out once."""


@dataclass(frozen=True)
class Options:
    """What the experiment can be told.

    Attributes:
        config: a YAML file as for `run`, with a scene of type `touch`.
        objects: names of objects of the scene, or files of others; none: those of the scene.
        directions: how many directions to come from.
        repeats: how often each.
        methods: how hypotheses are fused.
        noise: of the sensors, by name.
        faults: a YAML file of faults, or None.
        seed: of all chance.
        workers: how many processes.
        draw: touches to draw, by their names.
    """

    config: Path = DEFAULT
    objects: Sequence[str] = ()
    directions: int = 15
    repeats: int = 5
    methods: Sequence[Method] = METHODS
    noise: str = "prototype"
    faults: Path | None = None
    seed: int = 0
    workers: int = 2
    draw: Sequence[str] = ()


def run_touch(options: Options, out: Path) -> None:
    """Touch, compare with the truth, write tables and figures; goes on where it was stopped.

    Args:
        options: what is touched, and how it is felt and fused.
        out: the folder that takes the results: a file a touch, results.csv, summary.json, table.md
            and figures.

    Raises:
        ConfigurationError: an option is wrong, or `out` holds touches of other options.
        RobotError: a touch could not be made; the others are kept.
    """
    faults = read_faults(options.faults) if options.faults else ()
    plan, targets = read_plan(
        options.config, options.objects, options.directions, options.noise, faults, options.seed
    )
    touches = plan.touches(targets, options.repeats)
    _check_drawn(options.draw, touches)
    make_folder(out / "trials")
    _require_settings(plan, out)
    failed = _touch_all(plan, touches, options.workers, out)
    trials = [load(path) for touch in touches if (path := _file(out, touch)).is_file()]
    if trials:
        _evaluate(plan, trials, options, out)
    if failed:
        raise RobotError(f"{len(failed)} of {len(touches)} touches were not made: {failed[0]}")


def _touch_all(plan: Plan, touches: Sequence[Touch], workers: int, out: Path) -> list[str]:
    """Make the touches that are not there yet; give a sentence for each that fails."""
    missing = [touch for touch in touches if not _file(out, touch).is_file()]
    print(f"{len(touches)} touches, half of them in free air; {len(missing)} to make", flush=True)
    failed, start = [], time.monotonic()
    for done, problem in enumerate(_each(partial(_make, plan, out), missing, workers), 1):
        if problem:
            failed.append(problem)
        if sys.stderr.isatty() or done % 50 == 0:
            left = (time.monotonic() - start) / done * (len(missing) - done)
            end = "\r" if sys.stderr.isatty() else "\n"
            print(f"  {done} of {len(missing)}, {left:.0f} s left ", end=end, file=sys.stderr)
    return failed


def _each(make: Any, touches: Sequence[Touch], workers: int) -> Iterator[str]:
    """Make touches here, or in processes that share nothing with this one."""
    if workers == 1 or len(touches) < 2:
        yield from map(make, touches)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        yield from pool.map(make, touches)


def _make(plan: Plan, out: Path, touch: Touch) -> str:
    """Make one touch; give why it failed, or nothing."""
    try:
        save(run_trial(plan, touch), _file(out, touch))
    except ContactFusionError as error:
        return f"{touch.name}: {error}"
    return ""


def _evaluate(plan: Plan, trials: Sequence[Trial], options: Options, out: Path) -> None:
    """Fuse every touch by every row and method, and write what comes of it."""
    config, rng = plan.pipeline, np.random.default_rng([options.seed, 1])
    tests: list[dict[str, Any]] = []
    outcomes: list[Outcome] = []
    measures: list[Measure] = []
    tables_text = []
    for method in options.methods:
        found = _outcomes(trials, config, method)
        without = _left_out(trials, config, method)
        for each in (*found.values(), *without.values()):
            outcomes += each
            measures += tables.measures_of(each, rng)
        best = tables.best_single(found)
        for row in WIDE:
            tests.append({"method": str(method), **tables.paired(found[row], found[best])})
        names = list(found)
        tables_text.append(tables.table_text(measures, names, str(method)))
        tables_text.append(tables.table_text(measures, list(without), str(method)))
        tables_text.append(tables.tests_text(tests[-len(WIDE) :]))
        stem = str(method).replace("/", "_")
        papers = {row.name: found[row.name] for row in ROWS[:5]}
        figures.draw_touches(papers, out / f"touches_{stem}.png")
        figures.draw_rows(measures, [*names, *without], str(method), out / f"rows_{stem}.png")
    side = config.integrator.voxel_size
    met = [shared(one, config, side) for one in trials if not one.touch.short]
    measures += tables.sharing(met)
    measures += honesty(trials, config, rng)
    tables_text += [tables.shares_text(measures, "voxels"), tables.shares_text(measures, "spreads")]
    _write(trials, outcomes, measures, tests, tables_text, out)
    for name in options.draw or _first_of_each(trials):
        drawn = next(trial for trial in trials if trial.touch.name == name)
        for method in options.methods[:2]:
            stem = f"{name}_{str(method).replace('/', '_')}.png"
            figures.draw_touch(drawn, config, method, out / "pictures" / stem)
    print("\n\n".join(tables_text[:2]))
    print(f"results: {out}/table.md, results.csv, summary.json, figures")


def _outcomes(
    trials: Sequence[Trial], config: PipelineConfig, method: Method
) -> dict[str, list[Outcome]]:
    return {row.name: [outcome(one, row, method, config) for one in trials] for row in ROWS}


def _left_out(
    trials: Sequence[Trial], config: PipelineConfig, method: Method
) -> dict[str, list[Outcome]]:
    """Fuse again without each modality."""
    found: dict[str, list[Outcome]] = {}
    for row in WITHOUT:
        for modality in row.modalities:
            fewer = [outcome(trial, row, method, config, without=modality) for trial in trials]
            found[fewer[0].row] = fewer
    return found


def _write(
    trials: Sequence[Trial],
    outcomes: Sequence[Outcome],
    measures: Sequence[Measure],
    tests: Sequence[Mapping[str, Any]],
    tables_text: Sequence[str],
    out: Path,
) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    told = [field for field in Outcome.__dataclass_fields__ if field != "touch"]
    writer.writerow(["touch", "object", "direction", "repeat", "short", *told])
    for one in outcomes:
        touch = one.touch
        cells = [getattr(one, name) for name in told]
        writer.writerow(
            [touch.name, touch.target, touch.direction, touch.repeat, int(touch.short)]
            + [f"{cell:.6g}" if isinstance(cell, float) else cell for cell in cells]
        )
    made = [one for one in trials if not one.touch.short]
    refused = sorted({reason for one in trials for reason in one.refused})
    summary = {
        "touches": len(made),
        "missed": sum(not len(one.places) for one in made),
        "of several contacts": sum(len(one.places) > 1 for one in made),
        "not settled": sum(not one.steady for one in made),
        "in free air": len(trials) - len(made),
        "refused": refused,
        "measures": [asdict(one) for one in measures],
        "tests": list(tests),
    }
    write_whole(out / "results.csv", text.getvalue())
    write_whole(out / "summary.json", json.dumps(summary, indent=1, ensure_ascii=False) + "\n")
    write_whole(out / "table.md", "\n\n".join(tables_text) + "\n")


def _require_settings(plan: Plan, out: Path) -> None:
    """Make sure that a folder holds touches of these settings only.

    Raises:
        ConfigurationError: it holds touches of others.
    """
    path, settings = out / "settings.json", plan.settings()
    if not path.is_file():
        write_whole(path, json.dumps(settings, indent=1) + "\n")
        return
    held = json.loads(path.read_text())
    other = [name for name in settings if held.get(name) != settings[name]]
    if other:
        raise ConfigurationError(
            f"{out} holds touches of other {' and '.join(other)}: give another --out, or remove it"
        )


def _check_drawn(names: Sequence[str], touches: Sequence[Touch]) -> None:
    known = [touch.name for touch in touches]
    for name in names:
        if name not in known:
            raise ConfigurationError(f"unknown touch '{name}'; {name_hint(name, known, 'touches')}")


def _first_of_each(trials: Sequence[Trial]) -> list[str]:
    """Name one touch of each object."""
    made = [one.touch for one in trials if not one.touch.short and len(one.places)]
    return list({touch.target: touch.name for touch in reversed(made)}.values())


def _file(out: Path, touch: Touch) -> Path:
    return out / "trials" / f"{touch.name}.npz"
