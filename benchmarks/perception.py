"""Perceiving contact without a skin: the descriptor, the networks, and whole pushes by LiDAR."""

from collections.abc import Iterator

import numpy as np

from benchmarks.interleave import Rounds, Spread, interleave, timed
from benchmarks.table import Row
from contactfusion.generators.networks import ContactNetworks, shipped
from contactfusion.generators.proximity import ProximityConfig
from contactfusion_lab.experiments.ouster import by_loops
from contactfusion_lab.experiments.push.plan import read_plan, read_targets
from contactfusion_lab.experiments.push.trial import run_trial
from contactfusion_lab.scenes.push.config import SkinConfig

TARGETS, SEED = "random:12", 7
"""Two pushes of each of the paper's objects and each friction."""
POINTS = 5000
"""Of a cloud, two in three before the face."""
EVERY = 20
"""So many clouds, or windows, are read in a round."""


def rows(rounds: int) -> Iterator[Row]:
    """Measure single readings, and pushes by LiDAR and by skin, LiDAR and motion, in CPU time."""
    rng, config = np.random.default_rng(0), ProximityConfig()
    points = rng.uniform((0.2, -0.35, -0.45), (0.7, 0.35, 0.55), (POINTS, 3))
    networks = ContactNetworks.load(shipped())
    window = rng.uniform(0.0, config.empty, (networks.card.window, config.columns))
    networks.perceive(window)  # compiles
    runs = {
        "lengths": timed(lambda: config.lengths_of_cloud(points)),
        "loops": timed(lambda: by_loops(points, config)),
        "networks": timed(lambda: networks.perceive(window)),
    }
    times = interleave(runs, rounds=rounds, repeats={"lengths": EVERY, "networks": EVERY})
    yield Row("descriptor of 5,000 points", _ms(times, "lengths"), "ms", 0.3)
    yield Row("  plain loops against it", times.ratio("loops", "lengths"), "x")
    yield Row("both networks, one window", _ms(times, "networks"), "ms", 0.3)
    yield from _pushes("lidar", 45.0, 10.0, rounds)
    yield from _pushes("fused", None, 6.0, rounds)


def _ms(times: Rounds, name: str) -> Spread:
    taken = times.time(name)
    return Spread(*(1e3 * seconds for seconds in (taken.median, taken.low, taken.high)))


def _pushes(sensing: str, asked: float | None, tail: float, rounds: int) -> Iterator[Row]:
    targets = read_targets(TARGETS)
    plan = read_plan(sensing, [], [], [], targets, "random", 12, SkinConfig(), (), SEED)
    pushes = plan.pushes()
    run_trial(plan, pushes[0], "tuned")  # compiles
    costs = [[run_trial(plan, push, "tuned")[1] for push in pushes] for _ in range(rounds)]
    pushed = [60.0 * len(some) / sum(one.cpu for one in some) for some in costs]
    yield Row(f"pushes by {sensing}, a minute", Spread.of(pushed), "", asked, True)
    cycles = [np.concatenate([one.fused for one in some]) for some in costs]
    tails = [1e3 * float(np.quantile(one, 0.99)) for one in cycles]
    yield Row("  a control cycle: p99", Spread.of(tails), "ms", tail)
