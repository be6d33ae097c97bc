"""`experiment touch`: touches, each with a twin in free air, and what comes of them."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, final

import numpy as np

from contactfusion.faults import read_faults
from contactfusion.files import write_whole
from contactfusion.terminal import note
from contactfusion_lab.experiments.methods import Method, with_spreads
from contactfusion_lab.experiments.touch import figures, tables
from contactfusion_lab.experiments.touch.plan import DEFAULT, Plan, Touch, read_plan
from contactfusion_lab.experiments.touch.rows import (
    ALL,
    ALL_AND_SIMULATOR,
    PAPERS,
    ROWS,
    Comparison,
    Outcome,
    best_single,
    compare,
    comparisons_text,
    everything,
    outcome,
    shared,
)
from contactfusion_lab.experiments.touch.tables import coverage
from contactfusion_lab.experiments.touch.trial import Trial, content_of, load, run_trial
from contactfusion_lab.trials.choices import require_known
from contactfusion_lab.trials.executor import Executor, Local
from contactfusion_lab.trials.folder import trial_file
from contactfusion_lab.trials.measures import Measure
from contactfusion_lab.trials.runner import Experiment, Made, run

METHODS = (
    Method("de_morgan", "cluster_centroid"),
    Method("posterior", "modes"),
    Method("de_morgan", "cluster_mass"),
    Method("max", "cluster_centroid"),
    Method("log_odds", "cluster_centroid"),
    Method("dempster_shafer", "cluster_centroid"),
)
"""What the table is made for; the first is the papers', the others are compared with it."""
DRAWN = 2
"""Touches are drawn, and tables printed, by so many methods, the first."""
Found = dict[str, list[Outcome]]
"""The outcomes of all touches by one method, by row."""


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
        executor: the workers.
        draw: touches to draw, by their names; none: one of each object.
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
    executor: Executor = Local()
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
    methods = with_spreads(options.methods, options.spreads)
    faults = read_faults(options.faults) if options.faults else ()
    plan, targets = read_plan(
        options.config, options.objects, options.directions, options.noise, faults, options.seed
    )
    experiment = TouchExperiment(plan, targets, options.repeats, methods, options.draw)
    require_known(options.draw, experiment.tasks(), "touch", "touches")
    run(experiment, options.executor, out)


@final
@dataclass(frozen=True)
class TouchExperiment(Experiment[Touch]):
    """Touches of objects from all sides, each with a twin in free air.

    Attributes:
        plan: how each is made.
        targets: the names of the objects.
        repeats: of each direction.
        methods: how hypotheses are fused.
        draw: touches to draw, by their names; none: one of each object.
    """

    plan: Plan
    targets: Sequence[str]
    repeats: int
    methods: Sequence[Method]
    draw: Sequence[str]
    trials = "touches"
    suffix = ".npz"
    addable = ("objects",)

    def tasks(self) -> dict[str, Touch]:
        """The touches by name."""
        return {touch.name: touch for touch in self.plan.touches(self.targets, self.repeats)}

    def settings(self) -> dict[str, Any]:
        """The settings of the plan."""
        return self.plan.settings(self.targets)

    def make(self, task: Touch) -> Made:
        """Touch once."""
        return Made(content_of(run_trial(self.plan, task)))

    def evaluate(self, out: Path, settings: Mapping[str, Any], failed: Sequence[str]) -> None:
        """Evaluate the touches of this plan."""
        files = [trial_file(out, name, self.suffix) for name in self.tasks()]
        if trials := [load(path) for path in files if path.is_file()]:
            _evaluate(self.plan, trials, self.methods, self.draw, out)


@dataclass
class Results:
    """What gathers while rows and methods are gone through.

    Attributes:
        outcomes: one a touch, row and method.
        measures: of rows by methods, of shared voxels, of spreads.
        comparisons: rows against the best single modality, and against the first method.
        texts: tables as Markdown.
    """

    outcomes: list[Outcome] = field(default_factory=list)
    measures: list[Measure] = field(default_factory=list)
    comparisons: list[Comparison] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)


def _evaluate(
    plan: Plan, trials: Sequence[Trial], methods: Sequence[Method], draw: Sequence[str], out: Path
) -> None:
    """Fuse every touch by every row and method; write tables, files and figures.

    Args:
        plan: the experiment.
        trials: its touches.
        methods: how hypotheses are fused.
        draw: touches to draw, by their names; none: one of each object.
        out: the folder that takes the results.
    """
    results, config = Results(), plan.pipeline
    first: Found = {}
    for method in methods:
        results.texts.append(f"## {method}")
        found = _by_method(results, trials, method, plan, out)
        first = first or found
        _compare(results, found, first, plan)
    touches = [one for one in trials if not one.touch.short]
    results.measures += tables.sharing([shared(one, config) for one in touches])
    results.measures += coverage(touches, config, np.random.default_rng([plan.seed, 1]))
    shares = [tables.shares_text(results.measures, kind) for kind in ("voxels", "spreads")]
    results.texts += ["## by any method", *shares]
    write_whole(out / "results.csv", _csv(results.outcomes))
    summary = _summary(trials, results)
    write_whole(out / "summary.json", json.dumps(summary, indent=1, ensure_ascii=False) + "\n")
    write_whole(out / "table.md", "\n\n".join(results.texts) + "\n")
    by_name = {one.touch.name: one for one in trials}
    for name in draw or _first_of_each(touches):
        for method in methods[:DRAWN] if name in by_name else ():
            path = out / "pictures" / f"{name}_{method.stem}.png"
            figures.draw_touch(by_name[name], config, method, path)
    for method in methods[:DRAWN]:
        rows = [row.name for row in (*ROWS, everything(config))]
        note(tables.table_text(results.measures, rows, str(method)), end="\n\n")
    print(f"results: {out}/table.md, results.csv, summary.json, figures")


def _by_method(
    results: Results, trials: Sequence[Trial], method: Method, plan: Plan, out: Path
) -> Found:
    """Fuse every touch by every row, and again without each modality of two rows."""
    config, every = plan.pipeline, everything(plan.pipeline)
    found = {
        row.name: [outcome(one, row, method, config) for one in trials] for row in (*ROWS, every)
    }
    without: Found = {}
    for row in (ALL_AND_SIMULATOR, every):
        for modality in row.modalities:
            fewer = [outcome(one, row, method, config, without=modality) for one in trials]
            without[fewer[0].row] = fewer
    for outcomes in (*found.values(), *without.values()):
        results.outcomes += outcomes
        results.measures += tables.measures_of(outcomes, plan.seed)
    for text in (tables.table_text, tables.contacts_text):
        results.texts.append(text(results.measures, list(found), str(method)))
    results.texts.append(tables.table_text(results.measures, list(without), str(method)))
    papers = {row.name: found[row.name] for row in PAPERS}
    figures.draw_touches(papers, out / f"touches_{method.stem}.png")
    names = [*found, *without]
    figures.draw_rows(results.measures, names, str(method), out / f"rows_{method.stem}.png")
    return found


def _compare(results: Results, found: Found, first: Found, plan: Plan) -> None:
    """Compare rows with the best single modality, and with the same rows by the first method."""
    wide = [row.name for row in (*ROWS, everything(plan.pipeline)) if len(row.modalities) > 1]
    best = best_single(found)
    pairs = [(found[row], found[best]) for row in wide]
    pairs.append((found[ALL_AND_SIMULATOR.name], found[ALL.name]))
    if found is not first:
        pairs += [(found[row], first[row]) for row in wide]
    comparisons = [compare(one, other, plan.seed) for one, other in pairs]
    results.comparisons += comparisons
    results.texts.append(comparisons_text(comparisons))


def _csv(outcomes: Sequence[Outcome]) -> str:
    """One line an outcome; lengths in m."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    told = [name for name in Outcome.__dataclass_fields__ if name != "touch"]
    writer.writerow(["touch", "object", "direction", "repeat", "short", *told])
    for one in outcomes:
        touch = one.touch
        cells = [getattr(one, name) for name in told]
        writer.writerow(
            [touch.name, touch.target, touch.direction, touch.repeat, int(touch.short)]
            + [_cell(cell) for cell in cells]
        )
    return text.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, float):
        return f"{value:.6g}"
    return int(value) if isinstance(value, bool) else value


def _summary(trials: Sequence[Trial], results: Results) -> dict[str, Any]:
    touches = [one for one in trials if not one.touch.short]
    in_air = [one for one in trials if one.touch.short]
    return {
        "touches": len(touches),
        "missed": sum(not len(one.places) for one in touches),
        "of several contacts": sum(len(one.places) > 1 for one in touches),
        "not settled": sum(not one.steady for one in touches),
        "in free air": len(in_air),
        "touched though in free air": sum(bool(len(one.places)) for one in in_air),
        "refused": sorted({reason for one in trials for reason in one.refused}),
        "measures": [asdict(one) for one in results.measures],
        "tests": [asdict(one) for one in results.comparisons],
    }


def _first_of_each(touches: Sequence[Trial]) -> list[str]:
    """Name one touch of each object."""
    made = [one.touch for one in touches if len(one.places)]
    return list({touch.target: touch.name for touch in reversed(made)}.values())
