"""`experiment touch`: touches, each with a twin in free air, and what is made of them."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from contactfusion.errors import RobotError
from contactfusion.faults import read_faults
from contactfusion.files import make_folder, write_whole
from contactfusion.terminal import note
from contactfusion_lab.experiments.choices import require_known
from contactfusion_lab.experiments.folder import joined
from contactfusion_lab.experiments.methods import Method, with_spreads
from contactfusion_lab.experiments.touch.evaluation import evaluate
from contactfusion_lab.experiments.touch.plan import DEFAULT, Plan, Touch, read_plan
from contactfusion_lab.experiments.touch.trial import load, run_trial, save
from contactfusion_lab.experiments.workers import (
    each,
    failure,
    progress,
    reason_of,
    require_workers,
)

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
    require_known(options.draw, [touch.name for touch in touches], "touch", "touches")
    require_workers(options.workers)
    settings = joined(plan.settings(targets), out, ("objects",), "touches")
    make_folder(out)
    write_whole(out / "settings.json", json.dumps(settings, indent=1) + "\n")
    failed = _touch_all(plan, touches, options.workers, out)
    trials = [load(path) for touch in touches if (path := _file(out, touch)).is_file()]
    if trials:
        evaluate(plan, trials, methods, options.draw, out)
    if failed:
        raise RobotError(f"{len(failed)} of {len(touches)} touches were not made: {failed[0]}")


def _touch_all(plan: Plan, touches: Sequence[Touch], workers: int, out: Path) -> list[str]:
    """Make the touches that are not there yet; give a sentence for each that fails."""
    missing = [touch for touch in touches if not _file(out, touch).is_file()]
    note(f"{len(touches)} touches, half of them in free air; {len(missing)} to make")
    made = each(partial(_make, plan, out), missing, workers)
    return [failure(touch.name, one) for touch, one in progress(made, len(missing)) if one]


def _make(plan: Plan, out: Path, touch: Touch) -> str:
    """Make one touch; give why it failed, or nothing."""
    try:
        save(run_trial(plan, touch), _file(out, touch))
    except Exception as error:  # a plug-in may raise anything, and no other touch may suffer
        return reason_of(error)
    return ""


def _file(out: Path, touch: Touch) -> Path:
    return out / "trials" / f"{touch.name}.npz"
