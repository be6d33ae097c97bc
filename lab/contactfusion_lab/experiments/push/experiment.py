"""`experiment push`: pushes by several controllers, and what comes of them."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

from contactfusion.errors import ConfigurationError, ContactFusionError, RobotError, name_hint
from contactfusion.files import make_folder, write_whole
from contactfusion.pipeline import Pipeline
from contactfusion.terminal import note
from contactfusion_lab.experiments.choices import require_once, trial_called
from contactfusion_lab.experiments.folder import joined
from contactfusion_lab.experiments.push.evaluation import ADDABLE, evaluate, settings_of, trial_file
from contactfusion_lab.experiments.push.failing import read_failing
from contactfusion_lab.experiments.push.film import record
from contactfusion_lab.experiments.push.plan import Plan, Push, read_plan, read_targets
from contactfusion_lab.experiments.push.suites import Change, Sensing, controller_options
from contactfusion_lab.experiments.push.timers import Cost, tell_costs
from contactfusion_lab.experiments.push.trial import run_trial, save
from contactfusion_lab.experiments.workers import (
    Died,
    each,
    failure,
    one_thread_each,
    progress,
    reason_of,
    require_workers,
)
from contactfusion_lab.scenes.push.config import SkinConfig
from contactfusion_lab.scenes.push.scene import PushScene

Task = tuple[str, str, Push]
"""What feels, by its label; a controller; and a push."""
Plans = Mapping[str, Plan]
"""By the label of what feels."""
KINDS = ("point_cloud", "depth_image")
"""What LiDARs and cameras give; where none is switched on, none comes."""


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
    """A plan for each sensing by each rule, by the label of what feels.

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


@dataclass(frozen=True)
class Found:
    """What setting up a push has shown.

    Attributes:
        problem: what stands against it, or nothing.
        sensors: what reads in it, by name.
        failing: which of the faults change a reading in it.
    """

    problem: str
    sensors: frozenset[str] = frozenset()
    failing: frozenset[int] = frozenset()


def check(plans: Mapping[str, Plan], controller: str) -> None:
    """Set up pushes, apart: PyBullet may crash.

    By the first sensing those to each target and of each object, by the others of each object.

    Args:
        plans: by the label of what feels.
        controller: by name.

    Raises:
        ConfigurationError: a target cannot be reached, an object not be pushed, or what fails or is
            misplaced is no sensor that there is.
    """
    sensors, failing = set[str](), set[int]()
    for number, plan in enumerate(plans.values()):
        pushes = plan.pushes()
        chosen = {push.object: push for push in reversed(pushes)}
        if plan.targets.places and number == 0:
            chosen |= {str(push.target): push for push in reversed(pushes)}
        for push, found in each(partial(_found, plan, controller), list(chosen.values()), 1):
            if isinstance(found, Died):
                found = Found(f"a world with it cannot be set up: the process {found.how}")
            if found.problem:
                raise ConfigurationError(f"{push.object} to {push.target}: {found.problem}")
            sensors |= found.sensors
            failing |= found.failing
    _require_sensors(plans, sensors, failing)


def _require_sensors(
    plans: Mapping[str, Plan], sensors: Collection[str], failing: Collection[int]
) -> None:
    """Make sure that what fails or is misplaced is there; tell of what is switched off.

    Args:
        plans: by the label of what feels.
        sensors: what reads.
        failing: which of the faults change a reading.
    """
    (plan, *_) = plans.values()
    robot, seen = plan.robot, {name for one in plans.values() for name in one.sensing.sees}
    eyes = {*robot.lidars, *robot.cameras}
    told = [
        (f"faults.{number}.sensor", str(fault.told.get("sensor")))
        for number, fault in enumerate(plan.faults)
        if number not in failing
    ]
    for path, name in told:
        if name not in {*eyes, *KINDS}:
            hint = name_hint(name, {*sensors, *eyes}, "sensors")
            raise ConfigurationError(f"no reading of '{name}' comes; {hint}", path)
    misplaced = [(f"misplaced.{name}", name) for name in plan.misplaced if name not in seen]
    for path, name in misplaced:
        if name not in eyes:
            hint = name_hint(name, eyes, "LiDARs and cameras of the robot")
            raise ConfigurationError(f"the robot has no '{name}'; {hint}", path)
    for path, name in told + misplaced:
        note(f"{path}: no sensing here uses '{name}', so that it changes nothing")


def _found(plan: Plan, controller: str, push: Push) -> Found:
    """Set up one push."""
    try:
        readings = PushScene(plan.scene_of(push), plan.robot).readings()
        pipeline = Pipeline(plan.pipeline_of(push, controller))
        pipeline.close()
    except ContactFusionError as error:
        return Found(str(error))
    except Exception as error:  # a plug-in may raise anything
        return Found(f"{type(error).__name__}: {error}")
    heard = {(reading.sensor, type(reading)) for reading in readings}
    faults = enumerate(pipeline.config.faults)
    return Found(
        "",
        frozenset(sensor for sensor, _ in heard),
        frozenset(row for row, fault in faults if any(fault.meets(*one) for one in heard)),
    )
