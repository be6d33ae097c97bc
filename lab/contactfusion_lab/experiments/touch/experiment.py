"""`experiment touch`: touches, each with a twin in free air, and what comes of them."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, final

import numpy as np
import pandas as pd

from contactfusion.errors import ConfigurationError
from contactfusion.faults import read_faults
from contactfusion.files import write_whole
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.terminal import Progress, note
from contactfusion_lab.experiments.methods import (
    DE_MORGAN,
    DE_MORGAN_TUNED,
    DEFAULT_METHOD,
    POSTERIOR,
    TUNING_SEEDS,
    Method,
    with_spreads,
)
from contactfusion_lab.experiments.touch import figures, free, tables
from contactfusion_lab.experiments.touch.course import course_of
from contactfusion_lab.experiments.touch.plan import DEFAULT, Free, Plan, Touch, read_plan
from contactfusion_lab.experiments.touch.rows import (
    ALL_AND_SIMULATOR,
    PAPERS,
    ROWS,
    TIMED,
    Outcome,
    Row,
    compare_all,
    everything,
    outcome,
    shared,
)
from contactfusion_lab.experiments.touch.trial import (
    Trial,
    content_of,
    content_of_free,
    load,
    run_free,
    run_trial,
)
from contactfusion_lab.trials.choices import require_known
from contactfusion_lab.trials.executor import Executor, Local
from contactfusion_lab.trials.folder import trial_file
from contactfusion_lab.trials.measures import CASE, parts_of
from contactfusion_lab.trials.runner import Experiment, Made, ordered, run
from contactfusion_lab.trials.tables import (
    Units,
    as_csv,
    bullets,
    comparisons_text,
    frame_of,
    write_results,
)

METHODS = (DEFAULT_METHOD, DE_MORGAN, DE_MORGAN_TUNED, POSTERIOR)
"""Methods of the table; the others are compared with the first."""
TUNED_ON = (
    f"`{DE_MORGAN_TUNED}`: settings chosen by a search on the seeds "
    f"{' and '.join(map(str, TUNING_SEEDS))}, of which no other figure is."
)
"""Caption of the table of that method."""
DRAWN = 2
"""Number of methods, the first, by which touches are drawn and tables printed."""
UNITS: Units = {
    "detected": ("detected", 1.0, "g"),
    "gospa": ("GOSPA cm, all touches", 100.0, ".2f"),
    "error": ("ε cm, both report", 100.0, ".2f"),
}
"""Units of the compared measures."""


@dataclass(frozen=True)
class Options:
    """Options of the experiment.

    Attributes:
        config: a YAML file as for `run`, with a scene of type `touch`.
        objects: names of objects of the scene, or files of others; none: those of the scene.
        directions: how many directions to come from.
        repeats: how often each.
        methods: how hypotheses are fused.
        spreads: methods that look at spreads fuse once more with them multiplied by each of these.
        noise: of the sensors, by name; None: the scene's.
        faults: a YAML file of faults, or None.
        seed: of all chance.
        preset: the preset that replaces options of the file; empty: none.
        executor: the workers.
        draw: touches to draw, by their names; none: one of each object.
        free: how long the hand moves in free air, in all [min].
        places: number of places at which the hand is touched at once; None: as in the scene.
    """

    config: Path = DEFAULT
    objects: Sequence[str] = ()
    directions: int = 15
    repeats: int = 5
    methods: Sequence[Method] = METHODS
    spreads: Sequence[float] = ()
    noise: str | None = None
    faults: Path | None = None
    seed: int = 0
    preset: str = ""
    executor: Executor = Local()
    draw: Sequence[str] = ()
    free: float = 1.0
    places: int | None = None


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
    if not 0.0 <= options.free < np.inf:
        raise ConfigurationError(f"free motion lasts 0 minutes or more, not {options.free:g}")
    methods = with_spreads(options.methods, options.spreads)
    faults = read_faults(options.faults) if options.faults else ()
    plan, targets = read_plan(
        options.config, options.objects, options.directions, options.noise, faults, options.seed,
        options.preset, options.places,
    )  # fmt: skip
    experiment = TouchExperiment(
        plan, targets, options.repeats, methods, options.draw, options.free, options.executor
    )
    require_known(options.draw, experiment.touches(), "touch", "touches")
    run(experiment, options.executor, out)


@final
@dataclass(frozen=True)
class TouchExperiment(Experiment[Touch | Free]):
    """Touches of objects from all sides, each with a twin in free air, and free motion.

    Attributes:
        plan: how each is made.
        targets: the names of the objects.
        repeats: of each direction.
        methods: how hypotheses are fused.
        draw: touches to draw, by their names; none: one of each object.
        minutes: of free motion.
        executor: the workers that fuse.
    """

    plan: Plan
    targets: Sequence[str]
    repeats: int
    methods: Sequence[Method]
    draw: Sequence[str]
    minutes: float
    executor: Executor = Local()
    trials = "touches"
    suffix = ".npz"
    addable = ("objects",)

    def touches(self) -> dict[str, Touch]:
        """The touches by name."""
        return {touch.name: touch for touch in self.plan.touches(self.targets, self.repeats)}

    def motions(self) -> dict[str, Free]:
        """The free motions by name."""
        return {each.name: each for each in self.plan.motions(self.targets, self.minutes)}

    def tasks(self) -> dict[str, Touch | Free]:
        """The touches and the free motions by name."""
        return {**self.touches(), **self.motions()}

    def settings(self) -> dict[str, Any]:
        """The settings of the plan."""
        return self.plan.settings(self.targets)

    def make(self, task: Touch | Free) -> Made:
        """Touch once, or move once in free air."""
        if isinstance(task, Free):
            return Made(content_of_free(run_free(self.plan, task)))
        return Made(content_of(run_trial(self.plan, task)))

    def evaluate(self, out: Path, settings: Mapping[str, Any], failed: Sequence[str]) -> None:
        """Evaluate the touches and the free motions of this plan."""
        touches, motions = self._files(out, self.touches()), self._files(out, self.motions())
        if touches:
            workers = self.executor.local
            _evaluate(
                self.plan, touches, motions, self.methods, self.draw, workers, out, failed
            )  # fmt: skip

    def _files(self, out: Path, names: Iterable[str]) -> list[Path]:
        files = (trial_file(out, name, self.suffix) for name in names)
        return [path for path in files if path.is_file()]


def _evaluate(
    plan: Plan,
    touched: Sequence[Path],
    motions: Sequence[Path],
    methods: Sequence[Method],
    draw: Sequence[str],
    executor: Executor,
    out: Path,
    failed: Sequence[str],
) -> None:
    """Fuse every touch and every motion by every row and method; write tables, files and figures.

    Args:
        plan: the experiment.
        touched: the files of its touches.
        motions: those of its free motions.
        methods: how hypotheses are fused.
        draw: touches to draw, by their names; none: one of each object.
        executor: workers on this machine.
        out: the folder that takes the results.
        failed: a sentence for each touch or motion that could not be made.
    """
    config = plan.pipeline
    frame, trials = outcomes_of(touched, methods, config, executor)
    touches = [trial for trial in trials if not trial.touch.short]
    alarms = free.alarms_of(motions, methods, config, executor)
    measures = [
        measure
        for _, part in parts_of(frame).items()
        for measure in tables.measures_of(part, plan.seed)
    ]
    measures += free.measures_of(alarms, plan.seed)
    comparisons = compare_all(frame, methods, config, plan.seed)
    rows = [row.name for row in (*ROWS, everything(config))]
    texts = {"Touches": tables.forces_text([trial.force for trial in touches])}
    for method in methods:
        part = frame[frame["method"] == str(method)]
        names = list(part["row"].unique())
        fewer = [name for name in names if name not in rows]
        chosen = [each for each in comparisons if each.case.endswith(f", {method}")]
        parts = [
            tables.table_text(measures, rows, str(method)),
            TUNED_ON if method == DE_MORGAN_TUNED else "",
            tables.sets_text(measures, rows, str(method)),
            tables.contacts_text(measures, rows, str(method)),
            tables.time_text(measures, rows, str(method)),
            tables.force_text(measures, rows, str(method)),
            free.free_text(measures, rows, str(method)),
            tables.table_text(measures, fewer, str(method)),
            comparisons_text(chosen, UNITS),
        ]
        texts[str(method)] = "\n\n".join(filter(None, parts))
        papers = part[part["row"].isin([row.name for row in PAPERS])]
        figures.draw_touches(papers, out / f"touches_{method.stem}.png")
        figures.draw_rows(measures, names, str(method), out / f"rows_{method.stem}.png")
    measures += tables.sharing([shared(trial, config) for trial in touches])
    measures += tables.coverage(touches, config, np.random.default_rng([plan.seed, 1]))
    shares = [tables.shares_text(measures, kind) for kind in ("voxels", "spreads")]
    texts["by any method"] = "\n\n".join(shares)
    texts["Not made"] = bullets(failed)
    by_name = {trial.touch.name: trial for trial in trials}
    for name in draw or _first_of_each(touches):
        if name not in by_name:
            note(f"not drawn: {name}, which was not made")
        for method in methods[:DRAWN] if name in by_name else ():
            path = out / "pictures" / f"{name}_{method.stem}.png"
            figures.draw_touch(by_name[name], config, method, path)
    for method in methods[:DRAWN]:
        note(tables.table_text(measures, rows, str(method)), end="\n\n", lines=True)
    summary = _summary(trials) | {
        "not made": list(failed),
        "free motions": len(motions),
        "touched though in free motion": len(motions) - alarms["motion"].nunique(),
        "measures": [asdict(measure) for measure in measures],
        "tests": [asdict(comparison) for comparison in comparisons],
    }
    if len(alarms):
        write_whole(out / "free.csv", as_csv(alarms.drop(columns=CASE)))
    write_results(out, frame, summary, texts, missing="nan")


def outcomes_of(
    files: Sequence[Path], methods: Sequence[Method], config: PipelineConfig, executor: Executor
) -> tuple[pd.DataFrame, list[Trial]]:
    """Fuse every touch by every row, and again without each modality of two rows.

    Args:
        files: the touches.
        methods: how hypotheses are fused.
        config: the pipeline that received the readings of the touches.
        executor: workers on this machine.

    Returns:
        One row an outcome; ROW, METHOD is the case. And the end of each touch.
    """
    every = everything(config)
    fewer = [(row, name) for row in (ALL_AND_SIMULATOR, every) for name in row.modalities]
    cases = [
        (method, row, without)
        for method in methods
        for row, without in [*((row, "") for row in (*ROWS, every)), *fewer]
    ]
    tasks = {path.name: path for path in files}
    found, progress = list[tuple[list[Outcome], Trial]](), Progress("touches fused", len(files))
    for fused in ordered(partial(_outcomes, cases=cases, config=config), tasks, executor):
        found.append(fused)
        progress.add(1)
    by_case = zip(*(outcomes for outcomes, _ in found), strict=True)
    frame = frame_of(itertools.chain.from_iterable(by_case), Outcome)
    frame = frame.assign(**{CASE: frame["row"] + ", " + frame["method"]})
    return frame, [ending for _, ending in found]


def _outcomes(
    path: Path, cases: Sequence[tuple[Method, Row, str]], config: PipelineConfig
) -> tuple[list[Outcome], Trial]:
    """What comes of a touch in each case, and its end."""
    trial, outcomes = load(path), list[Outcome]()
    for method, row, without in cases:
        found = outcome(trial, row, method, config, without=without)
        if row.name in TIMED and not without and not trial.touch.short:
            found = replace(found, **asdict(course_of(trial, row, method, config)))
        outcomes.append(found)
    return outcomes, trial.ending


def _summary(trials: Sequence[Trial]) -> dict[str, Any]:
    touches = [trial for trial in trials if not trial.touch.short]
    in_air = [trial for trial in trials if trial.touch.short]
    return {
        "touches": len(touches),
        "missed": sum(not len(trial.places) for trial in touches),
        "of several contacts": sum(len(trial.places) > 1 for trial in touches),
        "not settled": sum(not trial.steady for trial in touches),
        "in free air": len(in_air),
        "touched though in free air": sum(bool(len(trial.places)) for trial in in_air),
        "refused": sorted({reason for trial in trials for reason in trial.record.refused}),
    }


def _first_of_each(touches: Sequence[Trial]) -> list[str]:
    """One touch of each object, by name."""
    made = [trial.touch for trial in touches if len(trial.places)]
    return list({touch.target: touch.name for touch in reversed(made)}.values())
