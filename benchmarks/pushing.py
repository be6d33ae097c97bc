"""Pushing: whole pushes felt by skin, the fused cycle among them, and pushes in the plane."""

import time
from collections.abc import Iterator

import numpy as np

from benchmarks.interleave import Spread
from benchmarks.table import Row
from contactfusion.controllers.pushing_parameters import SETS
from contactfusion_lab.experiments.push.plan import read_plan, read_targets
from contactfusion_lab.experiments.push.trial import Cost, run_trial
from contactfusion_lab.scenes.push.config import SkinConfig
from contactfusion_lab.tune_push.rating import random_pushes, rate_in_plane

TARGETS, SEED = "random:12", 7
"""Two pushes of each of the paper's objects and each friction."""
IN_PLANE = 60
"""Pushes in the plane of one round."""


def rows(rounds: int) -> Iterator[Row]:
    """Measure pushes by the set `tuned`, from random starts to random targets, in CPU time."""
    costs = _costs("skin", rounds)
    pushed = [60.0 / _cpu(some) * len(some) for some in costs]
    yield Row("pushes felt by skin, a minute", Spread.of(pushed), "", 80.0, True)
    cycles = [np.concatenate([one.fused for one in some]) for some in costs]
    shares = [float(one.sum()) / _cpu(some) for one, some in zip(cycles, costs, strict=True)]
    yield Row("  of it generators, fusion, controller", Spread.of(shares), "")
    yield Row("  a control cycle of these: p99", _tail(costs), "ms", 5.0)
    yield Row("a control cycle fused with LiDAR: p99", _tail(_costs("fused", rounds)), "ms", 6.0)
    plan, pushes = random_pushes(IN_PLANE, SEED)
    rates = []
    for _ in range(rounds + 1):
        start = time.process_time()
        rate_in_plane(plan, pushes, False, SETS["tuned"])
        rates.append(IN_PLANE / (time.process_time() - start))
    yield Row("pushes in the plane, a second", Spread.of(rates[1:]), "", 50.0, True)


def _costs(sensing: str, rounds: int) -> list[list[Cost]]:
    """What each push of each round costs by a sensor suite."""
    targets = read_targets(TARGETS)
    plan = read_plan(sensing, [], [], [], targets, "random", 12, SkinConfig(), (), SEED)
    pushes = plan.pushes()
    run_trial(plan, pushes[0], "tuned")  # compiles
    return [[run_trial(plan, push, "tuned")[1] for push in pushes] for _ in range(rounds)]


def _tail(costs: list[list[Cost]]) -> Spread:
    """The 99th percentile of the control cycles of each round [ms]."""
    cycles = [np.concatenate([one.fused for one in some]) for some in costs]
    return Spread.of([1e3 * float(np.quantile(one, 0.99)) for one in cycles])


def _cpu(costs: list[Cost]) -> float:
    return sum(one.cpu for one in costs)
