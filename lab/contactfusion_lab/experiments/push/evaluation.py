"""What comes of all pushes of a folder: measures, tables, comparisons and figures."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from contactfusion.errors import ConfigurationError
from contactfusion.terminal import note
from contactfusion_lab.experiments.push import figures, tables
from contactfusion_lab.experiments.push.outcomes import compare_all, outcomes_of
from contactfusion_lab.experiments.push.plan import Plan, Targets
from contactfusion_lab.experiments.push.tables import perception
from contactfusion_lab.experiments.push.trial import Track, load
from contactfusion_lab.scenes.push.config import FRICTIONS
from contactfusion_lab.trials.comparisons import comparisons_text
from contactfusion_lab.trials.folder import TRIALS
from contactfusion_lab.trials.tables import (
    bullets,
    measures_text,
    parts_of,
    summary_of,
    write_results,
)

Order = tuple[int, int, int, int]
"""Of a push among all: its targets, object and friction, and its number."""


def evaluate(plan: Plan, settings: Mapping[str, Any], failed: Sequence[str], out: Path) -> None:
    """Measure every push that a folder holds; write tables, files and figures.

    Args:
        plan: of pushes made last.
        settings: of the folder: its sensings and controllers, of which the others are compared with
            the first, its objects and its sets of targets.
        failed: a sentence for each push that could not be made.
        out: the folder with the pushes, which takes the results.

    Raises:
        ConfigurationError: a file holds none of these pushes, or another than its name says.
    """
    tracks = list(_gathered(plan, settings, out))
    frame = outcomes_of(tracks)
    sets = frame["trial"].map({track.push.name: track.push.targets for track in tracks})
    by_targets = {name: frame[sets == name] for name in settings["targets"] if (sets == name).any()}
    perceived = {
        name: {
            case: perception([tracks[row] for row in part.index], plan.seed)
            for case, part in parts_of(outcomes).items()
        }
        for name, outcomes in by_targets.items()
    }
    summaries = {case: _summary(part, plan.seed) for case, part in parts_of(frame).items()}
    comparisons = compare_all(frame, plan.seed)
    success = _for_each(by_targets, tables.success_text, plan.starts)
    write_results(
        out,
        frame,
        {
            "targets": list(by_targets),
            "starts": plan.starts,
            "reached": summaries,
            "perceived": {
                name: {case: asdict(each) for case, each in part.items()}
                for name, part in perceived.items()
            },
            "tests": [asdict(each) for each in comparisons],
            "not made": list(failed),
        },
        {
            "Success": success,
            "Perception": _for_each(perceived, tables.perception_text, plan.starts),
            "Measures": measures_text(summaries, "median", tables.MEASURES, tables.COUNTED),
            "Compared push by push": comparisons_text(comparisons, tables.DIFFERENCES),
            "Failures": tables.failures_text(frame),
            "Not made": bullets(failed),
        },
    )
    for case, part in parts_of(frame).items():
        stem = case.replace("/", "_")
        figures.draw_map(part, out / f"map_{stem}.png")
        ways = [figures.Way.of(tracks[row]) for row in part.index]
        figures.draw_ways(part, ways, out / f"paths_{stem}.png")
    figures.draw_bars(frame, comparisons, out / "bars.png")
    note(success, end="\n\n")


def _summary(part: pd.DataFrame, seed: int) -> dict[str, dict[str, Any]]:
    """What a case reached; of all pushes also how often its controller searched and escaped."""
    summary = summary_of(part, tables.GROUPED, tables.SUCCESSES, tables.MEASURES, "median", seed)
    summary["all"] |= {name: int(part[name].sum()) for name in tables.COUNTED}
    return summary


def _for_each(
    by_targets: Mapping[str, Any], text: Callable[[Any, str, str], str], starts: str
) -> str:
    return "\n\n".join(
        f"Targets `{name}`:\n\n{text(part, name, starts)}" for name, part in by_targets.items()
    )


def _gathered(plan: Plan, settings: Mapping[str, Any], out: Path) -> Iterator[Track]:
    """The pushes of a folder by sensing and controller, those of each in their order.

    Args:
        plan: of pushes made last.
        settings: of the folder.
        out: the folder.

    Raises:
        ConfigurationError: a file holds none of these pushes, or another than its name says.
    """
    sets = {name: _targets(name, places) for name, places in settings["targets"].items()}
    plans = {name: replace(plan, targets=targets) for name, targets in sets.items()}
    for sensing, controller in product(settings["sensings"], settings["controllers"]):
        ordered = [
            (_order(track, path, plans, list(settings["objects"])), track)
            for path, track in _tracks(out, sensing, controller)
        ]
        yield from (track for _, track in sorted(ordered, key=lambda row: row[0]))


def _targets(name: str, places: Any) -> Targets:
    return Targets(name, None if isinstance(places, str) else tuple((x, y) for x, y in places))


def _tracks(out: Path, sensing: str, controller: str) -> Iterator[tuple[Path, Track]]:
    for path in sorted((out / TRIALS / sensing / controller).glob("*.npz")):
        track = load(path)
        if (track.sensing, track.controller, track.push.name) != (sensing, controller, path.stem):
            raise _stranger(path)
        yield path, track


def _order(track: Track, path: Path, plans: Mapping[str, Plan], objects: Sequence[str]) -> Order:
    """The place of a push among all, after a look at whether it is the plan's.

    Raises:
        ConfigurationError: the plan has none of its name, or another one.
    """
    push = track.push
    try:
        rows = (
            list(plans).index(push.targets),
            objects.index(push.object),
            list(FRICTIONS).index(push.friction),
            push.number,
        )
        plan = plans[push.targets]
        if plan.targets.places or push.object in plan.objects:  # else where it is touched is gone
            planned = plan.push(push.object, push.friction, push.number)
        else:
            planned = push
    except (ValueError, IndexError):
        raise _stranger(path) from None
    if planned != push:
        raise _stranger(path)
    return rows


def _stranger(path: Path) -> ConfigurationError:
    return ConfigurationError(
        f"{path} holds another push than this experiment's of its name: remove it, or give "
        "another --out"
    )
