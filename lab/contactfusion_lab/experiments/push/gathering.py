"""The pushes that a folder holds, each measured, and in the order of the experiment."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from contactfusion.errors import ConfigurationError
from contactfusion_lab.experiments.push.folder import trial_files
from contactfusion_lab.experiments.push.outcomes import Outcome, outcome
from contactfusion_lab.experiments.push.plan import Plan
from contactfusion_lab.experiments.push.targets import Targets
from contactfusion_lab.experiments.push.trial import Track, load
from contactfusion_lab.scenes.push.config import FRICTIONS

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


def gathered(plan: Plan, settings: Mapping[str, Any], out: Path) -> dict[str, list[Made]]:
    """Give the pushes of each sensing and controller, by SENSING/CONTROLLER; of some if any.

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
    return Targets(name, tuple((x, y) for x, y in places) if isinstance(places, list) else None)


def _tracks(out: Path, sensing: str, controller: str) -> Iterator[tuple[Path, Track]]:
    for path in trial_files(out, sensing, controller):
        track = load(path)
        told = track.sensing, track.controller, track.push.name
        if told != (sensing, controller, path.stem):
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
