"""`experiment push`: pushes by several controllers, and what comes of them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.files import make_folder, write_whole
from contactfusion.terminal import note
from contactfusion_lab.experiments.choices import require_once, trial_called
from contactfusion_lab.experiments.folder import joined
from contactfusion_lab.experiments.push.checks import check
from contactfusion_lab.experiments.push.costs import tell_costs
from contactfusion_lab.experiments.push.evaluation import evaluate
from contactfusion_lab.experiments.push.failing import read_failing
from contactfusion_lab.experiments.push.folder import ADDABLE, settings_of, trial_file
from contactfusion_lab.experiments.push.plan import Plan, Push, read_plan
from contactfusion_lab.experiments.push.recorded import record
from contactfusion_lab.experiments.push.sensings import Change, Sensing
from contactfusion_lab.experiments.push.steering import controller_options
from contactfusion_lab.experiments.push.targets import read_targets
from contactfusion_lab.experiments.push.trial import run_trial, save
from contactfusion_lab.experiments.push.watches import Cost
from contactfusion_lab.experiments.threads import one_thread_each
from contactfusion_lab.experiments.workers import (
    each,
    failure,
    progress,
    reason_of,
    require_workers,
)
from contactfusion_lab.scenes.push.config import SkinConfig

Task = tuple[str, str, Push]
"""What feels, by its label; a controller; and a push."""
Plans = Mapping[str, Plan]
"""By the label of what feels."""


@dataclass(frozen=True)
class Options:
    """What the experiment can be told.

    Attributes:
        sensings: what feels the object, by name; the others are compared with the first.
        controllers: names of sets of parameters, or of installed controllers; the others are
            compared with the first.
        rules: how it is fused, RULE or RULE/CONDENSATION; none: as the file of a sensing says.
        without: sources that nobody listens to.
        lidar: the LiDAR that takes the place of any other.
        camera: the camera likewise.
        weights: of contact networks; None: those of the package.
        objects: names; none: those of the paper, unless there are files.
        files: of further objects, URDF or YAML.
        frictions: names; none: both.
        targets: `grid`, `validation`, `new`, `random:N`, or a YAML file.
        starts: `nominal` or `random`.
        taxels: of the front.
        skin: how well the skin feels.
        faults: a YAML file of how sensors fail, or None.
        seed: of all chance.
        workers: how many processes.
        record: trials to film and record: NAME, CONTROLLER/NAME or SENSING/CONTROLLER/NAME.
    """

    sensings: Sequence[str] = ("skin",)
    controllers: Sequence[str] = ("tuned",)
    rules: Sequence[str] = ()
    without: Sequence[str] = ()
    lidar: str = ""
    camera: str = ""
    weights: Path | None = None
    objects: Sequence[str] = ()
    files: Sequence[Path] = ()
    frictions: Sequence[str] = ()
    targets: str = "grid"
    starts: str = "nominal"
    taxels: int = 12
    skin: SkinConfig = SkinConfig()
    faults: Path | None = None
    seed: int = 0
    workers: int = 2
    record: Sequence[str] = ()


def run_push(options: Options, out: Path) -> None:
    """Push, measure, write tables and figures; goes on where it was stopped.

    Args:
        options: what is pushed, where to, by whom.
        out: the folder that takes the results: a file a push and controller, results.csv,
            summary.json, table.md, figures.

    Raises:
        ConfigurationError: an option is wrong, or `out` holds pushes of other options.
        RobotError: a push or a recording could not be made; the others are kept.
    """
    require_once(options.controllers, "controllers")
    require_workers(options.workers)
    plans = read_plans(options)
    first, *_ = plans.values()
    for name in options.controllers:
        controller_options(name, (0.0, 0.0), first.face)
    pushes = first.pushes()
    tasks = [
        (label, name, push) for label in plans for name in options.controllers for push in pushes
    ]
    by_name = {_name(task): task for task in tasks}
    recorded = list(dict.fromkeys(trial_called(name, by_name) for name in options.record))
    settings = settings_of(plans, options.controllers)
    joined(settings, out, ADDABLE, "pushes")
    missing = [task for task in tasks if not trial_file(out, *task).is_file()]
    if missing:
        check(plans, options.controllers[0])
    make_folder(out)
    settings = joined(settings, out, ADDABLE, "pushes")
    write_whole(out / "settings.json", json.dumps(settings, indent=1) + "\n")
    note(f"{len(tasks)} pushes; {len(missing)} to make")
    with one_thread_each():
        failed = _push_all(plans, missing, options.workers, out)
    if any(out.glob("trials/*/*/*.npz")):
        evaluate(first, settings, failed, out)
    unrecorded = _record_all(plans, recorded, out)
    problems = []
    if failed:
        problems.append(f"{len(failed)} of {len(tasks)} pushes were not made: {failed[0]}")
    if unrecorded:
        problems.append(
            f"{len(unrecorded)} of {len(recorded)} recordings were not made: {unrecorded[0]}"
        )
    if problems:
        raise RobotError("; ".join(problems))


def read_plans(options: Options) -> dict[str, Plan]:
    """Give a plan for each sensing by each rule, by the label of what feels.

    Raises:
        ContactFusionError: an option is wrong.
    """
    require_once(options.sensings, "sensings")
    require_once(options.rules, "rules")
    require_once(options.without, "sources that are left out")
    faults, misplaced = read_failing(options.faults) if options.faults else ((), {})
    change = Change("", tuple(options.without), options.lidar, options.camera, options.weights)
    targets, plans = read_targets(options.targets), {}
    for sensing, rule in product(options.sensings, options.rules or [""]):
        plan = read_plan(
            sensing,
            options.objects,
            options.files,
            options.frictions,
            targets,
            options.starts,
            options.taxels,
            options.skin,
            faults,
            options.seed,
            replace(change, rule=rule),
            misplaced,
        )
        plans[plan.sensing.label] = plan
    _require_use(options, [plan.sensing for plan in plans.values()])
    return plans


def _require_use(options: Options, sensings: Sequence[Sensing]) -> None:
    """Make sure that nothing is chosen that no sensing uses."""
    used = {name for sensing in sensings for name in sensing.sees}
    told = " and ".join(sensing.label for sensing in sensings)
    for name in filter(None, (options.lidar, options.camera)):
        if name not in used:
            raise ConfigurationError(f"'{name}' was chosen, but what feels here is {told}")
    if options.weights and not any(sensing.networks for sensing in sensings):
        raise ConfigurationError(
            f"{options.weights} was given, but there are no networks in {told}"
        )


def _push_all(plans: Plans, missing: Sequence[Task], workers: int, out: Path) -> list[str]:
    """Make pushes; give a sentence for each that fails."""
    failed, costs = [], dict[str, list[Cost]]()
    made = each(partial(_make, plans, out), missing, workers)
    for task, one in progress(made, len(missing)):
        if isinstance(one, Cost):
            costs.setdefault(task[0], []).append(one)
        else:
            failed.append(failure(_name(task), one))
    if costs:
        tell_costs(costs, out)
    return failed


def _make(plans: Plans, out: Path, task: Task) -> Cost | str:
    """Make one push; give what it took, or why it failed."""
    label, controller, push = task
    try:
        track, cost = run_trial(plans[label], push, controller)
        save(track, trial_file(out, *task))
    except Exception as error:  # a plug-in may raise anything, and no other push may suffer
        return reason_of(error)
    return cost


def _name(task: Task) -> str:
    label, controller, push = task
    return f"{label}/{controller}/{push.name}"


def _record_all(plans: Plans, recorded: Sequence[Task], out: Path) -> list[str]:
    """Make recordings of pushes that were made; give a sentence for each that fails."""
    failed, tasks = [], []
    for task in recorded:
        if trial_file(out, *task).is_file():
            tasks.append(task)
        else:
            note(f"not recorded: {_name(task)}, which was not made")
    for task, made in each(partial(_record, plans, out), tasks, 1):
        if isinstance(made, tuple):
            print(f"recorded: {made[0]} and {made[1]}")
        else:
            failed.append(failure(_name(task), made))
    return failed


def _record(plans: Plans, out: Path, task: Task) -> tuple[Path, Path] | str:
    """Film and record one push; give both files, or why it failed."""
    label, controller, push = task
    try:
        return record(plans[label], push, controller, out / "recordings" / label / controller)
    except Exception as error:  # a plug-in may raise anything, and what there is must be told
        return reason_of(error)
