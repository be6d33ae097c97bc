"""`experiment grasp`: the same grasps by several sources and rules, and what comes of them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.faults import read_faults
from contactfusion.files import make_folder, write_whole
from contactfusion.terminal import note
from contactfusion_lab.experiments.choices import require_once, trial_called
from contactfusion_lab.experiments.folder import as_json, joined
from contactfusion_lab.experiments.grasp import tables
from contactfusion_lab.experiments.grasp.film import film_all
from contactfusion_lab.experiments.grasp.plan import (
    DEFAULT,
    NONE,
    Column,
    Grasp,
    Plan,
    check_columns,
    read_plan,
)
from contactfusion_lab.experiments.grasp.trial import (
    Row,
    load,
    results_csv,
    run_trial,
    save,
    trial_file,
)
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.experiments.workers import (
    each,
    failure,
    one_thread_each,
    progress,
    reason_of,
    require_workers,
)

DE_MORGAN, POSTERIOR = Method("de_morgan", "cluster_centroid"), Method("posterior", "modes")
COLUMNS = (
    Column("force_torque+motion", DE_MORGAN),
    Column(NONE, DE_MORGAN),
    Column("tactile", DE_MORGAN),
    Column("force_torque", DE_MORGAN),
    Column("all", DE_MORGAN),
    Column("all", POSTERIOR),
)
"""What the table is made for; the first is the paper's, the others are compared with it."""
ADDABLE = ("columns", "objects")
"""Of these a folder may take more."""
Task = tuple[Column, Grasp]


@dataclass(frozen=True)
class Options:
    """What the experiment can be told.

    Attributes:
        config: a YAML file as for `run`, with a scene of type `grasp`, and `objects`.
        objects: names of these objects; none: the first.
        repeats: how often each object is grasped.
        sources: by what the hand feels: names or types of generators with "+" between them, `none`
            (it goes ahead and closes) or `all`.
        rules: how that is fused.
        noise: of the sensors, by name; None: the scene's.
        faults: a YAML file of faults, or None.
        seed: of all chance.
        workers: how many processes.
        record: grasps to film: COLUMN/NAME, or NAME for the first column.
    """

    config: Path = DEFAULT
    objects: Sequence[str] = ()
    repeats: int = 20
    sources: Sequence[str] = ()
    rules: Sequence[Method] = ()
    noise: str | None = None
    faults: Path | None = None
    seed: int = 0
    workers: int = 2
    record: Sequence[str] = ()


def run_grasp(options: Options, out: Path) -> None:
    """Grasp, measure, write tables and figures; goes on where it was stopped.

    Args:
        options: what is grasped, and by what it is felt.
        out: the folder that takes the results: a file a grasp and column, results.csv,
            summary.json, table.md, figures.

    Raises:
        ConfigurationError: an option is wrong, or `out` holds grasps of other options, or damaged
            ones.
        RobotError: a grasp or a film could not be made; the others are kept.
    """
    require_workers(options.workers)
    if options.repeats < 1:
        raise ConfigurationError(f"it takes 1 grasp or more, not {options.repeats}", "repeats")
    require_once(options.objects, "objects")
    columns = columns_of(options.sources, options.rules)
    faults = read_faults(options.faults) if options.faults else ()
    plan = read_plan(options.config, options.objects, faults, options.noise, options.seed)
    check_columns(plan, columns, options.config)
    settings = joined(plan.settings(columns), out, ADDABLE, "grasps")
    grasps = plan.grasps(list(plan.scenes), options.repeats)
    tasks = [(column, grasp) for grasp in grasps for column in columns]
    by_name = {_name(task): task for task in tasks}
    recorded = list(dict.fromkeys(trial_called(name, by_name) for name in options.record))
    _found(columns, grasps, out)  # so that a damaged file is told before anything is made
    missing = [task for task in tasks if not trial_file(out, *task).is_file()]
    make_folder(out)
    write_whole(out / "settings.json", json.dumps(settings, indent=1) + "\n")
    note(f"{len(tasks)} grasps; {len(missing)} to make")
    with one_thread_each():
        failed = _grasp_all(plan, missing, options.workers, out)
    found = _found(columns, grasps, out)
    if any(found.values()):
        evaluate(found, failed, plan.seed, out)
    unfilmed = film_all(plan, recorded, out)
    problems = []
    if failed:
        problems.append(f"{len(failed)} of {len(tasks)} grasps were not made: {failed[0]}")
    if unfilmed:
        problems.append(f"{len(unfilmed)} of {len(recorded)} films were not made: {unfilmed[0]}")
    if problems:
        raise RobotError("; ".join(problems))


def columns_of(sources: Sequence[str], rules: Sequence[Method]) -> Sequence[Column]:
    """The columns of the table: all sources by all rules; without any, `COLUMNS`."""
    if not sources and not rules:
        return COLUMNS
    chosen = sources or list(dict.fromkeys(column.sources for column in COLUMNS))
    pairs = [
        Column(source, rule if source != NONE else DE_MORGAN)
        for source, rule in product(chosen, rules or [DE_MORGAN])
    ]
    return list(dict.fromkeys(pairs))


def evaluate(
    found: Mapping[str, Sequence[Row]], failed: Sequence[str], seed: int, out: Path
) -> None:
    """Write tables, files and figures.

    Args:
        found: grasps by column, of which the others are compared with the first; a column without
            any is left out.
        failed: a sentence for each grasp that could not be made.
        seed: of the bootstrap.
        out: the folder that takes the results.
    """
    compared = tables.comparisons_of(found)
    found = {name: rows for name, rows in found.items() if rows}
    summaries = {name: tables.summary_of(rows, seed) for name, rows in found.items()}
    success = tables.success_text(found, summaries)
    texts = ["## Success", success]
    if compared:
        texts += ["## Compared grasp by grasp", tables.comparisons_text(compared)]
    texts += ["## Failures", tables.failures_text(found)]
    if failed:
        texts += ["## Not made", "\n".join(f"- {one}" for one in failed)]
    summary: dict[str, Any] = {"reached": summaries, "tests": compared, "not made": list(failed)}
    write_whole(out / "results.csv", results_csv([row for rows in found.values() for row in rows]))
    write_whole(out / "summary.json", as_json(summary))
    write_whole(out / "table.md", "\n\n".join(texts) + "\n")
    tables.draw_success(summaries, out / "success.png")
    tables.draw_places(found, out / "places.png")
    note(success, end="\n\n")
    print(f"results: {out}/table.md, results.csv, summary.json, success.png, places.png")


def _found(columns: Sequence[Column], grasps: Sequence[Grasp], out: Path) -> dict[str, list[Row]]:
    """The grasps that are there, by column."""
    return {
        column.name: [
            load(path, column, grasp)
            for grasp in grasps
            if (path := trial_file(out, column, grasp)).is_file()
        ]
        for column in columns
    }


def _grasp_all(plan: Plan, missing: Sequence[Task], workers: int, out: Path) -> list[str]:
    """Make grasps; give a sentence for each that fails."""
    made = each(partial(_make, plan, out), missing, workers)
    return [failure(_name(task), one) for task, one in progress(made, len(missing)) if one]


def _make(plan: Plan, out: Path, task: Task) -> str:
    """Make one grasp; give why it failed, or nothing."""
    try:
        save(run_trial(plan, *task), trial_file(out, *task))
    except Exception as error:  # a plug-in may raise anything, and no other grasp may suffer
        return reason_of(error)
    return ""


def _name(task: Task) -> str:
    column, grasp = task
    return f"{column.name}/{grasp.name}"
