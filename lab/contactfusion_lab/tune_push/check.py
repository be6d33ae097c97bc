"""Whether the planar model ranks sets of parameters as PyBullet does."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from contactfusion.controllers.pushing_parameters import SETS, PushingParameters
from contactfusion.files import make_folder, require_settings, write_whole
from contactfusion.terminal import Progress, note
from contactfusion_lab.tune_push.rating import Rating
from contactfusion_lab.tune_push.work import (
    drawn_seed,
    kept_in_bullet,
    rated_in_plane,
)

CHECKING = 3
"""What pushes are drawn for."""
CHANGED: dict[str, dict[str, Any]] = {
    "length_0.15": {"length": 0.15},
    "length_0.30": {"length": 0.30},
    "no_search": {"search": None},
    "no_escape": {"escape": None},
    "plain": {"search": None, "escape": None},
    "slow_turning": {"fastest_turn": 0.15},
}
"""Sets that differ from `tuned`."""
NAMED = (
    "paper",
    "paper_lateral_only",
    "paper_realign_only",
    "paper_neither",
    "tuned",
    "tuned_neither",
)


def check_sets() -> dict[str, PushingParameters]:
    """Give the sets that are compared, from good to bad."""
    tuned, paper = SETS["tuned"], SETS["paper"]
    changed = {name: tuned.model_copy(update=change) for name, change in CHANGED.items()}
    faster = paper.model_copy(update={"fastest": 0.3, "slowest": 0.08})
    return {**{name: SETS[name] for name in NAMED}, **changed, "paper_faster": faster}


def correlation(one: Sequence[float], other: Sequence[float]) -> float:
    """Give Spearman's rank correlation; NaN if one of them is constant."""
    if np.ptp(one) == 0.0 or np.ptp(other) == 0.0:
        return float("nan")
    return float(spearmanr(one, other).statistic)


def check_ranking(trials: int, seed: int, workers: int, out: Path) -> None:
    """Rate the same sets on the same pushes in both, compare, and tell.

    Args:
        trials: pushes of each set.
        seed: of all that is drawn.
        workers: how many processes.
        out: takes check.csv, check.md and check.json.
    """
    sets, drawn = check_sets(), drawn_seed(seed, CHECKING, 0)
    make_folder(out)
    dumped = {name: one.model_dump(mode="json") for name, one in sets.items()}
    require_settings({"seed": seed, "trials": trials, "sets": dumped}, out)
    progress = Progress("sets rated in the plane", len(sets))
    plane = rated_in_plane(list(sets.values()), trials, drawn, workers, progress, vary=False)
    progress = Progress("pushes in PyBullet", len(sets) * trials)
    bullet = [
        kept_in_bullet(one, trials, drawn, workers, progress, out / "bullet" / f"{name}.json")
        for name, one in sets.items()
    ]
    _tell(dict(zip(sets, zip(plane, bullet, strict=True), strict=True)), out)


def _tell(ratings: Mapping[str, tuple[Rating, Rating]], out: Path) -> None:
    """Write rates, costs and their correlations."""
    rates = [[one.rate[0] for one in pair] for pair in ratings.values()]
    costs = [[one.cost for one in pair] for pair in ratings.values()]
    by_rate, by_cost = (correlation(*zip(*rows, strict=True)) for rows in (rates, costs))
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["set", "rate_plane", "rate_bullet", "cost_plane_s", "cost_bullet_s"])
    lines = [
        "| set | true success, plane | PyBullet | cost, plane | PyBullet |",
        "|---|---|---|---|---|",
    ]
    for name, rate, cost in zip(ratings, rates, costs, strict=True):
        table.writerow([name, *rate, *cost])
        lines.append(
            f"| {name} | {rate[0]:.1%} | {rate[1]:.1%} | {cost[0]:.0f} s | {cost[1]:.0f} s |"
        )
    lines += ["", f"Spearman's rank correlation: {by_rate:.2f} of rates, {by_cost:.2f} of costs."]
    told = {"spearman_rate": by_rate, "spearman_cost": by_cost, "sets": len(ratings)}
    write_whole(out / "check.csv", text.getvalue())
    write_whole(out / "check.md", "\n".join(lines) + "\n")
    write_whole(out / "check.json", json.dumps(told, indent=1) + "\n")
    note("\n".join(lines))
