"""What comes of all pushes of a folder: measures, tables, comparisons and figures."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from contactfusion.errors import ConfigurationError
from contactfusion.files import write_whole
from contactfusion.terminal import note
from contactfusion_lab.experiments.push import figures, tables
from contactfusion_lab.experiments.push.outcomes import (
    Outcome,
    compare_all,
    comparisons_text,
    outcome,
    results_csv,
)
from contactfusion_lab.experiments.push.plan import Plan, Targets
from contactfusion_lab.experiments.push.tables import perception
from contactfusion_lab.experiments.push.trial import Track, load
from contactfusion_lab.scenes.push.config import FRICTIONS
from contactfusion_lab.trials.folder import TRIALS, as_json

Order = tuple[int, int, int, int]
"""Of a push among all: its targets, object and friction, and its number."""


@dataclass(frozen=True, eq=False)
class Made:
    """A push that was made.

    Attributes:
        track: of it.
        outcome: what came of it.
    """

    track: Track
    outcome: Outcome


Found = dict[str, list[Made]]
"""Pushes by SENSING/CONTROLLER."""


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
    made = _gathered(plan, settings, out)
    by_targets = _by_targets(made, settings["targets"])
    found = {label: [one.outcome for one in part] for label, part in made.items()}
    summaries = {label: tables.summary_of(part, plan.seed) for label, part in found.items()}
    perceived = {
        name: {
            label: perception([one.track for one in pushes], plan.seed)
            for label, pushes in part.items()
        }
        for name, part in by_targets.items()
    }
    comparisons = compare_all(found)
    summary = {
        "targets": list(by_targets),
        "starts": plan.starts,
        "reached": summaries,
        "perceived": {
            name: {label: asdict(one) for label, one in part.items()}
            for name, part in perceived.items()
        },
        "tests": [asdict(one) for one in comparisons],
        "not made": list(failed),
    }
    succeeded = {
        name: {label: [one.outcome for one in pushes] for label, pushes in part.items()}
        for name, part in by_targets.items()
    }
    success = _for_each(succeeded, tables.success_text, plan.starts)
    texts = ["## Success", success]
    texts += ["## Perception", _for_each(perceived, tables.perception_text, plan.starts)]
    texts += ["## Measures", tables.measures_text(summaries)]
    if comparisons:
        texts += ["## Compared push by push", comparisons_text(comparisons)]
    texts += ["## Failures", tables.failures_text(found)]
    if failed:
        texts += ["## Not made", "\n".join(f"- {one}" for one in failed)]
    write_whole(out / "results.csv", results_csv([one for part in found.values() for one in part]))
    write_whole(out / "summary.json", as_json(summary))
    write_whole(out / "table.md", "\n\n".join(texts) + "\n")
    for label, part in made.items():
        stem = label.replace("/", "_")
        figures.draw_map(found[label], out / f"map_{stem}.png")
        ways = [figures.Way.of(one.track, one.outcome) for one in part]
        figures.draw_ways(ways, out / f"paths_{stem}.png")
    figures.draw_bars(found, comparisons, out / "bars.png")
    note(success, end="\n\n")
    print(f"results: {out}/table.md, results.csv, summary.json, figures")


def _by_targets(made: Found, sets: Mapping[str, Any]) -> dict[str, Found]:
    """Deal pushes out to the sets of targets that have any, in their order."""
    dealt: dict[str, Found] = {name: {} for name in sets}
    for label, part in made.items():
        for one in part:
            dealt[one.track.push.targets].setdefault(label, []).append(one)
    return {name: part for name, part in dealt.items() if part}


def _for_each(
    by_targets: Mapping[str, Any], text: Callable[[Any, str, str], str], starts: str
) -> str:
    return "\n\n".join(
        f"Targets `{name}`:\n\n{text(part, name, starts)}" for name, part in by_targets.items()
    )


def _gathered(plan: Plan, settings: Mapping[str, Any], out: Path) -> dict[str, list[Made]]:
    """The pushes of each sensing and controller, by SENSING/CONTROLLER; of some if any.

    Args:
        plan: of pushes made last.
        settings: of the folder.
        out: the folder.

    Raises:
        ConfigurationError: a file holds none of these pushes, or another than its name says.
    """
    sets = {name: _targets(name, places) for name, places in settings["targets"].items()}
    plans = {name: replace(plan, targets=targets) for name, targets in sets.items()}
    found = {}
    for sensing, controller in product(settings["sensings"], settings["controllers"]):
        ordered = [
            (_order(track, path, plans, list(settings["objects"])), Made(track, outcome(track)))
            for path, track in _tracks(out, sensing, controller)
        ]
        if ordered:
            made = [one for _, one in sorted(ordered, key=lambda row: row[0])]
            found[f"{sensing}/{controller}"] = made
    return found


def _targets(name: str, places: Any) -> Targets:
    return Targets(name, None if isinstance(places, str) else tuple((x, y) for x, y in places))


def _tracks(out: Path, sensing: str, controller: str) -> Iterator[tuple[Path, Track]]:
    for path in sorted((out / TRIALS / sensing / controller).glob("*.npz")):
        track = load(path)
        told = track.sensing, track.controller, track.push.name
        if told != (sensing, controller, path.stem):
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
