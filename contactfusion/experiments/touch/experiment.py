"""`experiment touch`: touches, each with a twin in free air, and what is made of them."""

import json
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from contactfusion.errors import ConfigurationError, ContactFusionError, RobotError, name_hint
from contactfusion.experiments.methods import Method, with_spreads
from contactfusion.experiments.touch.evaluation import evaluate
from contactfusion.experiments.touch.plan import DEFAULT, Plan, Touch, read_plan
from contactfusion.experiments.touch.trial import load, run_trial, save
from contactfusion.fault_config import read_faults
from contactfusion.files import make_folder, write_whole

METHODS = (
    Method("de_morgan", "cluster_centroid"),
    Method("posterior", "modes"),
    Method("de_morgan", "cluster_mass"),
    Method("max", "cluster_centroid"),
    Method("log_odds", "cluster_centroid"),
    Method("dempster_shafer", "cluster_centroid"),
)
"""What the table is made for; the first is the papers', the others are compared with it."""


@dataclass(frozen=True)
class Options:
    """What the experiment can be told.

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
        workers: how many processes.
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
    methods = with_spreads(options.methods, options.spreads)
    faults = read_faults(options.faults) if options.faults else ()
    plan, targets = read_plan(
        options.config, options.objects, options.directions, options.noise, faults, options.seed
    )
    touches = plan.touches(targets, options.repeats)
    _require_known(options.draw, touches)
    make_folder(out / "trials")
    _require_settings(plan, targets, out)
    failed = _touch_all(plan, touches, options.workers, out)
    trials = [load(path) for touch in touches if (path := _file(out, touch)).is_file()]
    if trials:
        evaluate(plan, trials, methods, options.draw, out)
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


def _each(make: Callable[[Touch], str], touches: Sequence[Touch], workers: int) -> Iterator[str]:
    """Make touches here, or in processes that share nothing with this one.

    Raises:
        RobotError: a process has ended.
    """
    if workers == 1 or len(touches) < 2:
        yield from map(make, touches)
        return
    context = multiprocessing.get_context("spawn")
    try:
        with ProcessPoolExecutor(workers, mp_context=context) as pool:
            yield from pool.map(make, touches)
    except BrokenProcessPool:
        raise RobotError("a process that made touches has ended; start again to go on") from None


def _make(plan: Plan, out: Path, touch: Touch) -> str:
    """Make one touch; give why it failed, or nothing."""
    try:
        save(run_trial(plan, touch), _file(out, touch))
    except ContactFusionError as error:
        return f"{touch.name}: {error}"
    return ""


def _require_settings(plan: Plan, targets: Sequence[str], out: Path) -> None:
    """Make sure that a folder holds touches of these settings only; objects may be added.

    Raises:
        ConfigurationError: it holds touches of others, or of nobody knows what.
    """
    path, settings = out / "settings.json", plan.settings(targets)
    remedy = "give another --out, or remove it"
    if path.is_file():
        try:
            held = json.loads(path.read_text())
            objects = held.pop("objects")
            added = {**objects, **settings["objects"]}
        except (ValueError, KeyError, TypeError, AttributeError):
            raise ConfigurationError(f"{path} is damaged: {remedy}") from None
        other = [name for name in settings if name in held and held[name] != settings[name]]
        other += [name for name in objects if added[name] != objects[name]]
        if other or held.keys() != settings.keys() - {"objects"}:
            others = " and ".join(other) or "settings"
            raise ConfigurationError(f"{out} holds touches of other {others}: {remedy}")
        settings["objects"] = added
    elif any((out / "trials").iterdir()):
        raise ConfigurationError(f"{out} holds touches, but no settings.json: {remedy}")
    write_whole(path, json.dumps(settings, indent=1) + "\n")


def _require_known(names: Sequence[str], touches: Sequence[Touch]) -> None:
    known = [touch.name for touch in touches]
    for name in names:
        if name not in known:
            raise ConfigurationError(f"unknown touch '{name}'; {name_hint(name, known, 'touches')}")


def _file(out: Path, touch: Touch) -> Path:
    return out / "trials" / f"{touch.name}.npz"
