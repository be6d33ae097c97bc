"""`experiment push`: pushes by several controllers, and what comes of them."""

import json
import sys
import time
from collections.abc import Mapping, Sequence
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
from contactfusion.experiments.push.things import require_once
from contactfusion.experiments.push.trial import Cost, run_trial, save
from contactfusion.experiments.workers import Died, each, require_workers
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
        RobotError: a push or a recording could not be made; the others are kept.
    """
    require_once(options.controllers, "controllers")
    require_workers(options.workers)
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
    pushes = plan.pushes()
    tasks = [(name, push) for name in options.controllers for push in pushes]
    recorded = list(dict.fromkeys(_recorded(name, tasks) for name in options.record))
    settings = plan.settings(options.controllers)
    _joined(settings, out)
    missing = [task for task in tasks if not trial_file(out, *task).is_file()]
    if missing:
        _check(plan, tasks[0][0])
    make_folder(out)
    settings = _joined(settings, out)
    write_whole(out / "settings.json", json.dumps(settings, indent=1) + "\n")
    print(f"{len(tasks)} pushes; {len(missing)} to make", flush=True)
    failed = _push_all(plan, missing, options.workers, out)
    if any(list((out / "trials" / name).glob("*.npz")) for name in settings["controllers"]):
        evaluate(plan, settings, failed, out)
    unrecorded = _record_all(plan, recorded, out)
    problems = []
    if failed:
        problems.append(f"{len(failed)} of {len(tasks)} pushes were not made: {failed[0]}")
    if unrecorded:
        problems.append(
            f"{len(unrecorded)} of {len(recorded)} recordings were not made: {unrecorded[0]}"
        )
    if problems:
        raise RobotError("; ".join(problems))


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
            failed.append(_failure(task, made))
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


def _failure(task: Task, told: Died | str) -> str:
    how = f"its process {told.how}, twice" if isinstance(told, Died) else told
    return f"{task[0]}/{task[1].name}: {how}"


def _record_all(plan: Plan, recorded: Sequence[Task], out: Path) -> list[str]:
    """Make recordings of pushes that were made; give a sentence for each that fails."""
    failed, tasks = [], []
    for task in recorded:
        if trial_file(out, *task).is_file():
            tasks.append(task)
        else:
            print(f"not recorded: {task[0]}/{task[1].name}, which was not made")
    for task, made in each(partial(_record, plan, out), tasks, 1):
        if isinstance(made, tuple):
            print(f"recorded: {made[0]} and {made[1]}")
        else:
            failed.append(_failure(task, made))
    return failed


def _record(plan: Plan, out: Path, task: Task) -> tuple[Path, Path] | str:
    """Film and record one push; give both files, or why it failed."""
    controller, push = task
    try:
        return record(plan, push, controller, out / "recordings" / controller)
    except ContactFusionError as error:
        return str(error)
    except Exception as error:  # a plug-in may raise anything, and what there is must be told
        return f"{type(error).__name__}: {error}"


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
    except Exception as error:  # as in `_make`
        return f"{type(error).__name__}: {error}"
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


def _joined(settings: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """Add settings to those of a folder; change nothing in it.

    Raises:
        ConfigurationError: it holds pushes of others, another experiment, or nobody knows what.
    """
    path, joined = out / "settings.json", dict(settings)
    remedy = "give another --out, or remove it"
    if not path.is_file():
        if out.is_dir() and any(map(_is_held, out.iterdir())):
            raise ConfigurationError(f"{out} holds files, but no settings.json: give another --out")
        return joined
    try:
        held = json.loads(path.read_text())
    except ValueError:
        held = None
    if not isinstance(held, dict):
        raise ConfigurationError(f"{path} is damaged: {remedy}")
    if held.keys() != settings.keys():
        raise ConfigurationError(f"{out} holds another experiment: give another --out")
    other = [name for name in settings if name not in ADDABLE and held[name] != settings[name]]
    for group in ADDABLE:
        if not isinstance(held[group], dict):
            raise ConfigurationError(f"{path} is damaged: {remedy}")
        joined[group] = {**held[group], **settings[group]}
        changed = [name for name in held[group] if joined[group][name] != held[group][name]]
        other += [f"{group} '{name}'" for name in changed]
    if other:
        raise ConfigurationError(f"{out} holds pushes of other {' and '.join(other)}: {remedy}")
    return joined


def _is_held(path: Path) -> bool:
    """Say whether what lies in a folder is somebody's: other folders may hold other experiments."""
    return path.name == "trials" or (path.is_file() and not path.name.startswith("."))
