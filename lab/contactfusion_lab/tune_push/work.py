"""Many pushes in several processes; what comes of them does not depend on how many."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

from contactfusion.controllers.pushing_parameters import PushingParameters
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.files import write_whole
from contactfusion.terminal import Progress
from contactfusion_lab.experiments.push.plan import Plan, Push
from contactfusion_lab.experiments.workers import Died, each
from contactfusion_lab.tune_push.rating import Rating, random_pushes, rate_in_bullet, rate_in_plane

CHUNK = 10
"""Pushes in PyBullet that one process makes at a time."""


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
