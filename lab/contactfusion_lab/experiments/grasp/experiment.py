"""`experiment grasp`: the same grasps by several sources and rules, and their outcomes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, final

from contactfusion.errors import ConfigurationError
from contactfusion.faults import read_faults
from contactfusion_lab.experiments.grasp.film import film
from contactfusion_lab.experiments.grasp.plan import (
    ALL,
    DEFAULT,
    NONE,
    Column,
    Grasp,
    Plan,
    check_columns,
    read_plan,
)
from contactfusion_lab.experiments.grasp.tables import evaluate
from contactfusion_lab.experiments.grasp.trial import Row, content_of, load, run_trial
from contactfusion_lab.experiments.methods import DE_MORGAN, DEFAULT_METHOD, POSTERIOR, Method
from contactfusion_lab.trials.choices import require_once
from contactfusion_lab.trials.executor import Executor, Local
from contactfusion_lab.trials.folder import trial_file
from contactfusion_lab.trials.runner import Experiment, Made, run

COLUMNS = (
    Column(ALL, DEFAULT_METHOD),
    Column("force_torque+motion", DE_MORGAN),
    Column(NONE, DE_MORGAN),
    Column("tactile", DE_MORGAN),
    Column("force_torque", DE_MORGAN),
    Column(ALL, DE_MORGAN),
    Column(ALL, POSTERIOR),
)
"""Columns of the table; the others are compared with the first. The second is the paper's."""
Task = tuple[Column, Grasp]


@dataclass(frozen=True)
class Options:
    """Options of the experiment.

    Attributes:
        config: a YAML file as for `run`, with a scene of type `grasp`, and `objects`.
        objects: names of these objects; none: the first.
        repeats: how often each object is grasped.
        sources: by what the hand feels: names or types of generators with "+" between them, `none`
            (open loop) or `all`.
        rules: how that is fused; none: as the integrator does by default.
        noise: of the sensors, by name; None: the scene's.
        faults: a YAML file of faults, or None.
        seed: of all chance.
        executor: the workers.
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
    executor: Executor = Local()
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
    if options.repeats < 1:
        raise ConfigurationError(f"it takes 1 grasp or more, not {options.repeats}", "repeats")
    require_once(options.objects, "objects")
    columns = columns_of(options.sources, options.rules)
    faults = read_faults(options.faults) if options.faults else ()
    plan = read_plan(options.config, options.objects, faults, options.noise, options.seed)
    check_columns(plan, columns, options.config)
    experiment = GraspExperiment(plan, columns, options.repeats)
    run(experiment, options.executor, out, options.record)


@final
@dataclass(frozen=True)
class GraspExperiment(Experiment[Task]):
    """The same grasps by several columns.

    Attributes:
        plan: how each is made.
        columns: by what it is felt; the others are compared with the first.
        repeats: of each object.
    """

    plan: Plan
    columns: Sequence[Column]
    repeats: int
    trials = "grasps"
    suffix = ".json"
    addable = ("columns", "objects")

    def tasks(self) -> dict[str, Task]:
        """Each grasp by each column: COLUMN/NAME."""
        grasps = self.plan.grasps(list(self.plan.scenes), self.repeats)
        return {
            f"{column.name}/{grasp.name}": (column, grasp)
            for grasp in grasps
            for column in self.columns
        }

    def settings(self) -> dict[str, Any]:
        """The settings of the plan."""
        return self.plan.settings(self.columns)

    def check(self, out: Path, missing: Sequence[str], executor: Executor) -> None:
        """Read the grasps that there are, so that a damaged file is named before any is made."""
        self._found(out)

    def make(self, task: Task) -> Made:
        """Grasp once."""
        return Made(content_of(run_trial(self.plan, *task)))

    def evaluate(self, out: Path, settings: Mapping[str, Any], failed: Sequence[str]) -> None:
        """Evaluate the grasps of this plan."""
        if found := self._found(out):
            names = [column.name for column in self.columns]
            evaluate(found, names, failed, self.plan.seed, out)

    def film(self, task: Task, out: Path) -> tuple[Path, Path]:
        """Grasp once more."""
        return film(self.plan, *task, out / "films" / task[0].name)

    def _found(self, out: Path) -> list[Row]:
        """The grasps that there are, column by column."""
        files = {name: trial_file(out, name, self.suffix) for name in self.tasks()}
        return [
            load(files[name], *task)
            for column in self.columns
            for name, task in self.tasks().items()
            if task[0] == column and files[name].is_file()
        ]


def columns_of(sources: Sequence[str], rules: Sequence[Method]) -> Sequence[Column]:
    """The columns of the table: all sources by all rules; without any, `COLUMNS`.

    Without rules by that of the integrator; with no sources nothing is fused.
    """
    if not sources and not rules:
        return COLUMNS
    chosen = sources or list(dict.fromkeys(column.sources for column in COLUMNS))
    pairs = [
        Column(source, rule if source != NONE else DE_MORGAN)
        for source, rule in product(chosen, rules or [DEFAULT_METHOD])
    ]
    return list(dict.fromkeys(pairs))
