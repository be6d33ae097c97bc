"""Ratings of sets of parameters: the same random pushes for each, in several processes."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.controllers.pushing_parameters import PushingParameters
from contactfusion.controllers.reactive_pushing import ReactivePushing, ReactivePushingConfig
from contactfusion.errors import ConfigurationError
from contactfusion.files import read_json, write_whole
from contactfusion.pipeline import Pipeline
from contactfusion.terminal import Progress
from contactfusion_lab.experiments.push.plan import Plan, Push, Targets, read_plan
from contactfusion_lab.experiments.push.trial import push_cycles
from contactfusion_lab.scenes.push.config import FrictionConfig, PushConfig, SkinConfig
from contactfusion_lab.scenes.push.planar import planar_trial
from contactfusion_lab.scenes.push.scene import Ending
from contactfusion_lab.trials.executor import Executor
from contactfusion_lab.trials.measures import proportion
from contactfusion_lab.trials.runner import ordered

REPORTED = (500, 2025)
"""Seeds of trials that results are reported on; nothing is tuned on them."""
FAILED = 600.0
"""Time that counts for a push that fails: twice the longest [s]."""
VARIED = 0.2
"""Relative variation of each friction in the plane, so that none is fitted."""
CHUNK = 10
"""Pushes in PyBullet that one process makes at a time."""


@dataclass(frozen=True, slots=True)
class Rating:
    """Outcomes of pushes with one set of parameters.

    Attributes:
        success: of each push, whether it truly succeeded.
        time: of each push [s].
    """

    success: tuple[bool, ...]
    time: tuple[float, ...]

    @property
    def cost(self) -> float:
        """The mean time, failures at `FAILED` [s]: the smaller, the better."""
        return float(np.where(self.success, self.time, FAILED).mean())

    @property
    def rate(self) -> tuple[float, float, float]:
        """The rate of true success, and its Wilson interval."""
        return proportion(np.array(self.success, np.bool_))

    @property
    def mean_time(self) -> float:
        """Mean time of the pushes that succeed [s]; NaN if none does."""
        times = np.array(self.time)[np.array(self.success, np.bool_)]
        return float(times.mean()) if len(times) else float("nan")


def random_pushes(trials: int, seed: int) -> tuple[Plan, list[Push]]:
    """Draw pushes of the paper's objects from random starts to random targets.

    Raises:
        ConfigurationError: results are reported on this seed.
    """
    if seed in REPORTED:
        raise ConfigurationError(
            f"results are reported on the seeds {REPORTED[0]} and {REPORTED[1]}: nothing is tuned "
            "on them",
            "seed",
        )
    targets = Targets("random", None, trials)
    plan = read_plan("skin", [], [], [], targets, "random", 12, SkinConfig(), (), seed)
    return plan, plan.pushes()


def rate_in_plane(
    plan: Plan, pushes: Sequence[Push], vary: bool, parameters: PushingParameters
) -> Rating:
    """Push in the plane.

    Args:
        plan: of the pushes.
        pushes: what to push where.
        vary: whether frictions are varied.
        parameters: of the controller.
    """
    outcomes = []
    for push in pushes:
        config = plan.scene_of(push)
        options = ReactivePushingConfig(target=push.target, face=plan.face, parameters=parameters)
        outcomes.append(
            planar_trial(_varied(config, push) if vary else config, ReactivePushing(options))
        )
    return Rating(
        tuple(outcome.success_true for outcome in outcomes),
        tuple(outcome.time for outcome in outcomes),
    )


def rate_in_bullet(plan: Plan, parameters: PushingParameters, pushes: Sequence[Push]) -> Rating:
    """Push in PyBullet, through skin, generator and integrator."""
    success, times = [], []
    for push in pushes:
        options: dict[str, Any] = {
            "type": "reactive_pushing",
            "target": push.target,
            "face": plan.face.model_dump(),
            "parameters": parameters.model_dump(),
        }
        update = {"controller": options, "seed": push.seed}
        *_, last = push_cycles(plan, push, Pipeline(plan.pipeline.model_copy(update=update)))
        near = last.truth.distance <= plan.scene_of(push).within
        success.append(bool(near and last.ending == Ending.ARRIVED))
        times.append(float(last.truth.stamp))
    return Rating(tuple(success), tuple(times))


def _varied(config: PushConfig, push: Push) -> PushConfig:
    ground, robot = np.random.default_rng(push.seed).uniform(1.0 - VARIED, 1.0 + VARIED, 2)
    friction = FrictionConfig(
        ground=config.friction.ground * float(ground), robot=config.friction.robot * float(robot)
    )
    return config.model_copy(update={"friction": friction})


def drawn_seed(seed: int, purpose: int, number: int) -> int:
    """Draw a seed for pushes of one purpose."""
    return int(np.random.SeedSequence([seed, purpose, number]).generate_state(1)[0])


def rated_in_plane(
    sets: Sequence[PushingParameters],
    trials: int,
    seed: int,
    executor: Executor,
    progress: Progress,
    vary: bool = True,
) -> list[Rating]:
    """Rate sets of parameters on the same pushes, in the plane.

    Args:
        sets: the parameters.
        trials: how many pushes each makes.
        seed: of the pushes.
        executor: the workers.
        progress: counts the sets.
        vary: whether frictions are varied.

    Raises:
        RobotError: a set could not be rated.
    """
    plan, pushes = random_pushes(trials, seed)
    tasks = {f"set {row}": parameters for row, parameters in enumerate(sets)}
    ratings = []
    for rating in ordered(partial(rate_in_plane, plan, pushes, vary), tasks, executor):
        ratings.append(rating)
        progress.add(1)
    return ratings


def rated_in_bullet(
    parameters: PushingParameters, trials: int, seed: int, executor: Executor, progress: Progress
) -> Rating:
    """Rate a set of parameters in PyBullet.

    Args:
        parameters: the set.
        trials: how many pushes it makes.
        seed: of the pushes.
        executor: the workers.
        progress: counts the pushes.

    Raises:
        RobotError: a push could not be made.
    """
    plan, pushes = random_pushes(trials, seed)
    chunks = {f"push {row}": pushes[row : row + CHUNK] for row in range(0, len(pushes), CHUNK)}
    success, time = list[bool](), list[float]()
    for rating in ordered(partial(rate_in_bullet, plan, parameters), chunks, executor):
        success += rating.success
        time += rating.time
        progress.add(len(rating.time))
    return Rating(tuple(success), tuple(time))


def kept_in_bullet(
    parameters: PushingParameters,
    trials: int,
    seed: int,
    executor: Executor,
    progress: Progress,
    path: Path,
) -> Rating:
    """Rate a set of parameters in PyBullet, unless a file holds its rating; then keep it there.

    Args:
        parameters: the set.
        trials: how many pushes it makes.
        seed: of the pushes.
        executor: the workers.
        progress: counts the pushes.
        path: the file.

    Raises:
        RobotError: a push could not be made.
        ConfigurationError: the file is damaged.
    """
    if not path.is_file():
        rating = rated_in_bullet(parameters, trials, seed, executor, progress)
        write_whole(path, json.dumps(asdict(rating)) + "\n")
        return rating
    try:
        held = read_json(path)
        rating = Rating(tuple(held["success"]), tuple(held["time"]))
    except (ValueError, TypeError, KeyError):
        raise ConfigurationError(f"{path} is damaged: remove it, and it is made again") from None
    progress.skip(len(rating.time))
    return rating
