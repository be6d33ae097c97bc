"""The thresholds of `lidar_rule` for each place of a LiDAR: `python -m` this writes a table.

Every pair of thresholds makes a few pushes; the best make more, on other draws. The tables of
results use other seeds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import typer

from contactfusion.controllers.pushing_parameters import SETS
from contactfusion.files import make_folder, write_whole
from contactfusion.terminal import Progress, note
from contactfusion_lab.experiments.push.plan import Plan, Targets, read_plan
from contactfusion_lab.experiments.push.suites import Change
from contactfusion_lab.scenes.push.config import SkinConfig
from contactfusion_lab.trials.executor import Executor, Local
from contactfusion_lab.trials.runner import ordered
from contactfusion_lab.trials.tables import markdown
from contactfusion_lab.tune_push.rating import Rating, rate_in_bullet

SEED = 3100
"""Of the first draw of pushes; the second has the seed after it."""
MOUNTINGS = ("lidar", "lidar_side", "lidar_tilted")
"""The places of the LiDAR on the package's base."""
TOUCH = (0.007, 0.01, 0.03)
"""Tried values of `touch` [m]."""
NEAR = (0.002, 0.005, 0.01, 0.02, 0.03)
"""Tried values of `near` [m]."""
FIRST, KEPT, SECOND = 6, 3, 18
"""Pushes that each pair makes, how many pairs go on, and pushes that each of these makes."""
Thresholds = tuple[float, float]
"""`touch` and `near` [m]."""


def plan_of(lidar: str, pushes: int, seed: int) -> Plan:
    """Pushes of the paper's objects from random starts to random targets, seen by one LiDAR.

    Args:
        lidar: its name.
        pushes: how many.
        seed: of all chance.
    """
    targets = Targets("random", None, pushes)
    return read_plan(
        "rule", (), (), (), targets, "random", 12, SkinConfig(), (), seed, Change(lidar=lidar)
    )


def with_thresholds(plan: Plan, thresholds: Thresholds) -> Plan:
    """The same pushes, by other thresholds of the rule."""
    touch, near = thresholds
    options = plan.pipeline.generators["lidar"] | {"touch": touch, "near": near}
    pipeline = plan.pipeline.model_copy(update={"generators": {"lidar": options}})
    return replace(plan, sensing=replace(plan.sensing, pipeline=pipeline))


def _rated(plan: Plan, thresholds: Thresholds) -> Rating:
    return rate_in_bullet(with_thresholds(plan, thresholds), SETS["tuned"], plan.pushes())


def rated(
    plan: Plan, pairs: Sequence[Thresholds], executor: Executor, progress: Progress
) -> dict[Thresholds, Rating]:
    """What comes of the same pushes by each pair of thresholds, the best first.

    Raises:
        RobotError: a push could not be made.
    """
    found = dict[Thresholds, Rating]()
    tasks = {f"touch {touch:g}, near {near:g}": (touch, near) for touch, near in pairs}
    for pair, rating in zip(pairs, ordered(partial(_rated, plan), tasks, executor), strict=True):
        found[pair] = rating
        progress.add(len(rating.success))
    return dict(sorted(found.items(), key=lambda row: row[1].cost))


def tuned(
    lidar: str, pairs: Sequence[Thresholds], seed: int, executor: Executor
) -> dict[Thresholds, Rating]:
    """The pairs that went on, the best first.

    Args:
        lidar: its name.
        pairs: that are tried.
        seed: of the first draw of pushes.
        executor: the workers.

    Raises:
        RobotError: a push could not be made.
    """
    progress = Progress(f"pushes by {lidar}", FIRST * len(pairs) + SECOND * KEPT)
    first = rated(plan_of(lidar, FIRST, seed), pairs, executor, progress)
    return rated(plan_of(lidar, SECOND, seed + 1), list(first)[:KEPT], executor, progress)


def table_of(found: Mapping[str, Mapping[Thresholds, Rating]]) -> str:
    """The pairs that went on from each place, as Markdown."""
    rows = [
        [
            lidar,
            f"{touch:g}",
            f"{near:g}",
            f"{sum(rating.success)} of {len(rating.success)}",
            f"{rating.mean_time:.1f}",
        ]
        for lidar, ratings in found.items()
        for (touch, near), rating in ratings.items()
    ]
    return markdown(["LiDAR", "touch m", "near m", "true success", "mean time s"], rows)


def main(
    out: Annotated[Path, typer.Option(help="Output folder.")] = Path("out/tune_lidar_rule"),
    lidar: Annotated[list[str] | None, typer.Option(help="A LiDAR; may be repeated.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes.")] = 2,
) -> None:
    """Choose thresholds of the rule by pushes: writes table.md."""
    pairs: Any = list(product(TOUCH, NEAR))
    found = {name: tuned(name, pairs, SEED, Local(workers)) for name in lidar or MOUNTINGS}
    make_folder(out)
    write_whole(out / "table.md", table_of(found) + "\n")
    note(table_of(found), lines=True)


if __name__ == "__main__":
    typer.run(main)
