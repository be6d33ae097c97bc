"""How well sets of parameters push: the same random pushes for each, in several processes."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.controllers.pushing_parameters import PushingParameters
from contactfusion.controllers.reactive_pushing import ReactivePushing, ReactivePushingConfig
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.files import write_whole
from contactfusion.pipeline import Pipeline
from contactfusion.terminal import Progress
from contactfusion_lab.experiments.measures import proportion
from contactfusion_lab.experiments.push.plan import Plan, Push, Targets, read_plan
from contactfusion_lab.experiments.push.trial import push_cycles
from contactfusion_lab.experiments.workers import Died, each
from contactfusion_lab.scenes.push.config import FrictionConfig, PushConfig, SkinConfig
from contactfusion_lab.scenes.push.planar import planar_trial
from contactfusion_lab.scenes.push.scene import Ending

REPORTED = (500, 2025)
"""Seeds of trials that results are reported on; nothing is tuned on them."""
FAILED = 600.0
"""A push that fails counts as if it had taken so long: twice the longest [s]."""
VARIED = 0.2
"""In the plane each friction is varied by so much either way, so that none is fitted."""
CHUNK = 10
"""Pushes in PyBullet that one process makes at a time."""


@dataclass(frozen=True, slots=True)
class Rating:
    """What came of pushes with one set of parameters.

    Attributes:
        success: of each push, whether it was a true one.
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
        """Of the pushes that succeed [s]; NaN if none does."""
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
    return Rating(tuple(one.success_true for one in outcomes), tuple(one.time for one in outcomes))


def rate_in_bullet(plan: Plan, pushes: Sequence[Push], parameters: PushingParameters) -> Rating:
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
    workers: int,
    progress: Progress,
    vary: bool = True,
) -> list[Rating]:
    """Rate sets of parameters on the same pushes, in the plane.

    Args:
        sets: the parameters.
        trials: how many pushes each makes.
        seed: of the pushes.
        workers: how many processes.
        progress: is told of each set.
        vary: whether frictions are varied.

    Raises:
        RobotError: a process has died twice.
    """
    plan, pushes = random_pushes(trials, seed)
    rate = partial(_one_in_plane, plan, pushes, vary)
    tasks = list(enumerate(sets))
    done: dict[int, Rating] = {}
    pairs = ((task, rate(task)) for task in tasks) if workers == 1 else each(rate, tasks, workers)
    for (row, _), rating in pairs:
        done[row] = _alive(rating)
        progress.add(1)
    return [done[row] for row in range(len(sets))]


def rated_in_bullet(
    parameters: PushingParameters, trials: int, seed: int, workers: int, progress: Progress
) -> Rating:
    """Rate a set of parameters in PyBullet.

    Args:
        parameters: the set.
        trials: how many pushes it makes.
        seed: of the pushes.
        workers: how many processes.
        progress: is told of each push.

    Raises:
        RobotError: a process has died twice.
    """
    plan, pushes = random_pushes(trials, seed)
    chunks = [(row, tuple(pushes[row : row + CHUNK])) for row in range(0, len(pushes), CHUNK)]
    done: dict[int, Rating] = {}
    for (row, chunk), rating in each(partial(_chunk, plan, parameters), chunks, workers):
        done[row] = _alive(rating)
        progress.add(len(chunk))
    ratings = [done[row] for row, _ in chunks]
    return Rating(
        tuple(one for rating in ratings for one in rating.success),
        tuple(one for rating in ratings for one in rating.time),
    )


def _alive(rating: Rating | Died) -> Rating:
    if isinstance(rating, Died):
        raise RobotError(f"a process that pushed {rating.how}, twice; start again to go on")
    return rating


def kept_in_bullet(
    parameters: PushingParameters,
    trials: int,
    seed: int,
    workers: int,
    progress: Progress,
    path: Path,
) -> Rating:
    """Rate a set of parameters in PyBullet, unless a file holds its rating; then keep it there.

    Args:
        parameters: the set.
        trials: how many pushes it makes.
        seed: of the pushes.
        workers: how many processes.
        progress: is told of each push.
        path: the file.

    Raises:
        RobotError: a process has died twice.
        ConfigurationError: the file is damaged.
    """
    if not path.is_file():
        rating = rated_in_bullet(parameters, trials, seed, workers, progress)
        write_whole(path, json.dumps(asdict(rating)) + "\n")
        return rating
    try:
        held = json.loads(path.read_text())
        rating = Rating(tuple(held["success"]), tuple(held["time"]))
    except (ValueError, TypeError, KeyError):
        raise ConfigurationError(f"{path} is damaged: remove it, and it is made again") from None
    progress.skip(len(rating.time))
    return rating


def _one_in_plane(
    plan: Plan, pushes: Sequence[Push], vary: bool, task: tuple[int, PushingParameters]
) -> Rating:
    return rate_in_plane(plan, pushes, vary, task[1])


def _chunk(
    plan: Plan, parameters: PushingParameters, chunk: tuple[int, tuple[Push, ...]]
) -> Rating:
    return rate_in_bullet(plan, chunk[1], parameters)
