"""`experiment push`: pushes by several controllers, and what comes of them."""

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from contactfusion.errors import ConfigurationError, ContactFusionError, RobotError, name_hint
from contactfusion.experiments.push.costs import tell_costs
from contactfusion.experiments.push.evaluation import evaluate
from contactfusion.experiments.push.plan import Plan, Push, read_plan
from contactfusion.experiments.push.recorded import record
from contactfusion.experiments.push.steering import controller_options
from contactfusion.experiments.push.targets import read_targets
from contactfusion.experiments.push.trial import Cost, run_trial, save
from contactfusion.experiments.workers import Died, each
from contactfusion.fault_config import read_faults
from contactfusion.files import make_folder, write_whole
from contactfusion.pipeline import Pipeline
from contactfusion.simulation.push import PushScene
from contactfusion.simulation.push_config import SkinConfig

Task = tuple[str, Push]
"""A controller, and a push."""
ADDABLE = ("controllers", "objects", "targets")
"""Of these a folder may take more."""


@dataclass(frozen=True)
class Options:
    """What the experiment can be told.

    Attributes:
        sensing: what feels the object, by name.
        controllers: names of sets of parameters, or of installed controllers; the others are
            compared with the first.
        objects: names; none: those of the paper, unless there are files.
        files: of further objects, URDF or YAML.
        frictions: names; none: both.
        targets: `grid`, `validation`, `new`, `random:N`, or a YAML file.
        starts: `nominal` or `random`.
        taxels: of the front.
        skin: how well the skin feels.
        faults: a YAML file of faults, or None.
        seed: of all chance.
        workers: how many processes.
        record: trials to film and record: NAME, or CONTROLLER/NAME.
    """

    sensing: str = "skin"
    controllers: Sequence[str] = ("tuned",)
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
        RobotError: a push could not be made; the others are kept.
    """
    if twice := next((n for n in options.controllers if options.controllers.count(n) > 1), None):
        raise ConfigurationError(f"'{twice}' stands twice among the controllers")
    plan = read_plan(
        options.sensing,
        options.objects,
        options.files,
        options.frictions,
        read_targets(options.targets),
        options.starts,
        options.taxels,
        options.skin,
        read_faults(options.faults) if options.faults else (),
        options.seed,
    )
    for name in options.controllers:
        controller_options(name, (0.0, 0.0), plan.face)
    tasks = [(name, push) for name in options.controllers for push in plan.pushes()]
    recorded = [_recorded(name, tasks) for name in options.record]
    missing = [task for task in tasks if not trial_file(out, *task).is_file()]
    if missing:
        _check(plan, tasks[0][0])
    make_folder(out / "trials")
    _require_settings(plan.settings(options.controllers), out)
    print(f"{len(tasks)} pushes; {len(missing)} to make", flush=True)
    failed = _push_all(plan, missing, options.workers, out)
    made = [(task, path) for task in tasks if (path := trial_file(out, *task)).is_file()]
    if made:
        evaluate(plan, options.controllers, [path for _, path in made], failed, out)
    for controller, push in recorded:
        record(plan, push, controller, out / "recordings" / controller)
    if failed:
        raise RobotError(f"{len(failed)} of {len(tasks)} pushes were not made: {failed[0]}")


def trial_file(out: Path, controller: str, push: Push) -> Path:
    """Give the file of a trial."""
    return out / "trials" / controller / f"{push.name}.npz"


def _push_all(plan: Plan, missing: Sequence[Task], workers: int, out: Path) -> list[str]:
    """Make pushes; give a sentence for each that fails."""
    failed, costs, start = [], [], time.monotonic()
    for done, (task, made) in enumerate(each(partial(_make, plan, out), missing, workers), 1):
        if isinstance(made, Cost):
            costs.append(made)
        else:
            how = f"its process {made.how}, twice" if isinstance(made, Died) else made
            failed.append(f"{task[0]}/{task[1].name}: {how}")
        if sys.stderr.isatty() or done % 50 == 0:
            left = (time.monotonic() - start) / done * (len(missing) - done)
            end = "\r" if sys.stderr.isatty() else "\n"
            print(f"  {done} of {len(missing)}, {left:.0f} s left ", end=end, file=sys.stderr)
    if costs:
        tell_costs(costs, out)
    return failed


def _make(plan: Plan, out: Path, task: Task) -> Cost | str:
    """Make one push; give what it took, or why it failed."""
    controller, push = task
    try:
        track, cost = run_trial(plan, push, controller)
        save(track, trial_file(out, controller, push))
    except ContactFusionError as error:
        return str(error)
    except Exception as error:  # a plug-in may raise anything, and no other push may suffer
        return f"{type(error).__name__}: {error}"
    return cost


def _check(plan: Plan, controller: str) -> None:
    """Set up one push to each target and one of each object, apart: PyBullet may crash.

    Raises:
        ConfigurationError: a target cannot be reached, an object not be pushed, or a fault is for
            a sensor that there is not.
    """
    pushes = plan.pushes()
    chosen = {push.object: push for push in reversed(pushes)}
    if plan.targets.places:
        chosen |= {str(push.target): push for push in reversed(pushes)}
    for push, problem in each(partial(_problem, plan, controller), list(chosen.values()), 1):
        if isinstance(problem, Died):
            problem = f"a world with it cannot be set up: the process {problem.how}"
        if problem:
            raise ConfigurationError(f"{push.object} to {push.target}: {problem}")


def _problem(plan: Plan, controller: str, push: Push) -> str:
    """Give what stands against a push, or nothing."""
    try:
        readings = PushScene(plan.scene_of(push), plan.robot).readings()
        Pipeline(plan.pipeline_of(push, controller))
    except ContactFusionError as error:
        return str(error)
    sensors = [reading.sensor for reading in readings]
    for row, fault in enumerate(plan.pipeline.faults):
        if not any(fault.meets(reading) for reading in readings):
            hint = name_hint(str(fault.sensor), sensors, "sensors")
            return f"faults.{row}.sensor: no reading of '{fault.sensor}' comes; {hint}"
    return ""


def _recorded(told: str, tasks: Sequence[Task]) -> Task:
    """Find a trial by NAME or CONTROLLER/NAME; without a controller it is the first's."""
    names = {f"{controller}/{push.name}": (controller, push) for controller, push in tasks}
    name = told if "/" in told else f"{tasks[0][0]}/{told}"
    if name not in names:
        raise ConfigurationError(
            f"unknown trial '{told}'; {name_hint(name, names, 'trials')}"
            if len(names) <= 30
            else f"there is no trial '{told}' in this experiment; one is '{next(iter(names))}'"
        )
    return names[name]


def _require_settings(settings: dict[str, Any], out: Path) -> None:
    """Make sure that a folder holds pushes of these settings only; some may be added.

    Raises:
        ConfigurationError: it holds pushes of others, or of nobody knows what.
    """
    path, remedy = out / "settings.json", "give another --out, or remove it"
    if path.is_file():
        try:
            held = json.loads(path.read_text())
            fixed = {name: one for name, one in held.items() if name not in ADDABLE}
            other = [name for name in fixed if fixed[name] != settings[name]]
            for group in ADDABLE:
                added = {**held[group], **settings[group]}
                changed = [name for name in held[group] if added[name] != held[group][name]]
                other += [f"{group} '{name}'" for name in changed]
                settings[group] = added
            strange = held.keys() != settings.keys()
        except (ValueError, KeyError, TypeError, AttributeError):
            raise ConfigurationError(f"{path} is damaged: {remedy}") from None
        if other or strange:
            others = " and ".join(other) or "settings"
            raise ConfigurationError(f"{out} holds pushes of other {others}: {remedy}")
    elif any((out / "trials").iterdir()):
        raise ConfigurationError(f"{out} holds pushes, but no settings.json: {remedy}")
    write_whole(path, json.dumps(settings, indent=1) + "\n")
