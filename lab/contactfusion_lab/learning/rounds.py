"""One round of training: lessons are lived, and networks trained, each in a process of its own."""

import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar, get_args

from contactfusion.errors import ContactFusionError
from contactfusion.files import make_folder
from contactfusion.generators.lstm import Weights
from contactfusion.terminal import note
from contactfusion_lab.experiments.workers import Died, each
from contactfusion_lab.learning import training
from contactfusion_lab.learning.collecting import live
from contactfusion_lab.learning.lessons import Lesson
from contactfusion_lab.learning.networks import Name
from contactfusion_lab.learning.training import Trained, train
from contactfusion_lab.learning.trials import LabelledTrial, load, save
from contactfusion_lab.learning.windows import Dataset

T = TypeVar("T")
R = TypeVar("R")
NAMES: tuple[Name, ...] = get_args(Name)
Round = dict[Name, Trained]
"""Both networks of a round."""
Task = tuple[Name, Weights | None]
"""A network to train, and its first weights."""
EVERY = 10
"""It tells how far it is after so many pushes, or epochs."""


@dataclass(frozen=True)
class Failure:
    """What a process gives in place of a result.

    Attributes:
        why: in a sentence.
    """

    why: str


def collected(
    lessons: Sequence[Lesson], weights: Path | None, workers: int, folder: Path
) -> list[LabelledTrial]:
    """Live the lessons that are not kept yet, and give the trials of all.

    Args:
        lessons: of a round.
        weights: of the networks that drive, when they do.
        workers: how many processes.
        folder: takes a file for each trial.

    Raises:
        ContactFusionError: one cannot be lived.
    """
    missing = [lesson for lesson in lessons if not _file(folder, lesson).is_file()]
    start, work = time.monotonic(), partial(_live, weights, folder)
    for done, _ in enumerate(_sound(each(work, missing, workers)), 1):
        if done % EVERY == 0 or done == len(missing):
            left = (time.monotonic() - start) / done * (len(missing) - done)
            say(f"{done} of {len(missing)} pushes, {left:.0f} s left")
    return [load(_file(folder, lesson)) for lesson in lessons]


def _live(weights: Path | None, folder: Path, lesson: Lesson) -> Failure | None:
    try:
        save(live(lesson, weights), _file(folder, lesson))
    except ContactFusionError as error:
        return Failure(f"{lesson.name}: {error}")
    except Exception as error:  # a plug-in may raise anything, and the push must be named
        return Failure(f"{lesson.name}: {type(error).__name__}: {error}")
    return None


def trained_round(
    data: Dataset, how: training.Options, before: Round | None, workers: int, folder: Path
) -> Round:
    """Train both networks, each in a process, on from those of the round before.

    Args:
        data: of this round and all before.
        how: they are trained.
        before: the networks of the round before, or None.
        workers: how many processes.
        folder: takes the checkpoints.

    Raises:
        ContactFusionError: a training diverged, or its checkpoint is another's.
    """
    make_folder(folder)
    tasks: list[Task] = [(name, before[name].weights if before else None) for name in NAMES]
    work = partial(_train, data, how, folder)
    return {one.name: one for _, one in _sound(each(work, tasks, workers))}


def _train(data: Dataset, how: training.Options, folder: Path, task: Task) -> Trained | Failure:
    name, warm = task

    def told(epoch: int, learned: float, validated: float, left: float) -> None:
        if epoch % EVERY == 0:
            say(
                f"{name}: epoch {epoch} of {how.epochs}, loss {learned:.5f}, "
                f"validation {validated:.5f}, {left:.0f} s left"
            )

    try:
        return train(name, data, how, folder, warm, told)
    except ContactFusionError as error:
        return Failure(str(error))


def _sound(results: Iterable[tuple[T, R | Failure | Died]]) -> Iterator[tuple[T, R]]:
    """Give results on, until one is a failure."""
    for task, made in results:
        if isinstance(made, Died):
            raise ContactFusionError(
                f"the process of a task {made.how}, twice; start again to go on"
            )
        if isinstance(made, Failure):
            raise ContactFusionError(made.why)
        yield task, made


def _file(folder: Path, lesson: Lesson) -> Path:
    return folder / f"{lesson.name}.npz"


def say(line: str) -> None:
    """Tell how far it is, beside the output."""
    note(f"  {line}", file=sys.stderr)
