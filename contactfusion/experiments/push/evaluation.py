"""What comes of all pushes: measures, tables, comparisons and figures."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from contactfusion.errors import ConfigurationError
from contactfusion.experiments.push import figures, tables
from contactfusion.experiments.push.comparisons import compare, comparisons_text
from contactfusion.experiments.push.outcomes import Outcome, outcome, results_csv
from contactfusion.experiments.push.plan import Plan
from contactfusion.experiments.push.targets import Targets
from contactfusion.experiments.push.trial import Track, load
from contactfusion.files import write_whole
from contactfusion.simulation.push_objects import FRICTIONS

Order = tuple[int, int, int, int]
"""Of a push among all: its targets, object and friction, and its number."""
Found = dict[str, list[Outcome]]
"""Outcomes by controller."""


def evaluate(plan: Plan, settings: Mapping[str, Any], failed: Sequence[str], out: Path) -> None:
    """Measure every push that a folder holds; write tables, files and figures.

    Args:
        plan: of the pushes made last.
        settings: of the folder: its controllers, of which the others are compared with the first,
            its objects and its sets of targets.
        failed: a sentence for each push that could not be made.
        out: the folder with the pushes, which takes the results.

    Raises:
        ConfigurationError: a file holds none of these pushes, or another than its name says.
    """
    sets = {name: _targets(name, places) for name, places in settings["targets"].items()}
    plans = {name: replace(plan, targets=targets) for name, targets in sets.items()}
    found: Found = {}
    ways: dict[str, list[figures.Way]] = {}
    by_targets: dict[str, Found] = {name: {} for name in plans}
    for controller in settings["controllers"]:
        measured = []
        for path, track in _tracks(out, controller):
            order = _order(track, path, plans, list(settings["objects"]))
            one = outcome(track, plan.sensing)
            measured.append((order, track.push.targets, one, figures.Way.of(track, one)))
        for _, targets, one, way in sorted(measured, key=lambda row: row[0]):
            found.setdefault(controller, []).append(one)
            ways.setdefault(controller, []).append(way)
            by_targets[targets].setdefault(controller, []).append(one)
    by_targets = {name: part for name, part in by_targets.items() if part}
    summaries = {name: tables.summary_of(outcomes, plan.seed) for name, outcomes in found.items()}
    first, *others = found.values()
    comparisons = [compare(first, other) for other in others]
    summary = {
        "sensing": plan.sensing,
        "targets": list(by_targets),
        "starts": plan.starts,
        "controllers": summaries,
        "tests": [asdict(one) for one in comparisons],
        "not made": list(failed),
    }
    success = "\n\n".join(
        f"Targets `{name}`:\n\n{tables.success_text(part, name, plan.starts)}"
        for name, part in by_targets.items()
    )
    measures = tables.measures_text(summaries)
    texts = ["## Success", success, "## Measures", measures]
    if comparisons:
        texts += ["## Compared push by push", comparisons_text(comparisons)]
    texts += ["## Failures", tables.failures_text(found)]
    if failed:
        texts += ["## Not made", "\n".join(f"- {one}" for one in failed)]
    write_whole(out / "results.csv", results_csv([one for part in found.values() for one in part]))
    write_whole(out / "summary.json", as_json(summary))
    write_whole(out / "table.md", "\n\n".join(texts) + "\n")
    for name, outcomes in found.items():
        figures.draw_map(outcomes, out / f"map_{name}.png")
        figures.draw_ways(ways[name], out / f"paths_{name}.png")
    figures.draw_bars(found, comparisons, out / "bars.png")
    print(success, end="\n\n")
    print(f"results: {out}/table.md, results.csv, summary.json, figures")


def as_json(told: object) -> str:
    """Give JSON that any program reads: no NaN, nothing infinite, but null."""
    return json.dumps(_finite(told), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(told: Any) -> Any:
    if isinstance(told, Mapping):
        return {name: _finite(one) for name, one in told.items()}
    if isinstance(told, (list, tuple)):
        return [_finite(one) for one in told]
    return None if isinstance(told, float) and not math.isfinite(told) else told


def _targets(name: str, places: Any) -> Targets:
    return Targets(name, tuple((x, y) for x, y in places) if isinstance(places, list) else None)


def _tracks(out: Path, controller: str) -> Iterator[tuple[Path, Track]]:
    for path in sorted((out / "trials" / controller).glob("*.npz")):
        track = load(path)
        if (track.controller, track.push.name) != (controller, path.stem):
            raise _stranger(path)
        yield path, track


def _order(track: Track, path: Path, plans: Mapping[str, Plan], objects: Sequence[str]) -> Order:
    """Give the place of a push among all, after a look at whether it is the plan's.

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
