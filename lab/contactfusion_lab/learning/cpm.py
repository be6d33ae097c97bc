"""`train cpm`: collects pushes, trains the contact networks, lets them drive, and tests them."""

import io
import json
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar, get_args

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, ContactFusionError
from contactfusion.figures import COLOURS, new_figure
from contactfusion.files import make_folder, write_whole
from contactfusion.generators.lstm import Weights
from contactfusion.terminal import note
from contactfusion_lab.experiments.workers import Died, each, require_workers
from contactfusion_lab.learning import training
from contactfusion_lab.learning.dataset import Dataset, LabelledTrial, load, save
from contactfusion_lab.learning.export import tested, write_networks
from contactfusion_lab.learning.networks import Name
from contactfusion_lab.learning.rollout import (
    MOUNTINGS,
    PROXIMITY,
    Lesson,
    driven_lessons,
    first_lessons,
    live,
)
from contactfusion_lab.learning.training import Trained, train

RATE = 10.0
"""Of the cycles [Hz]."""
COLLECTION = 3
"""Counts up when lessons change, so that old ones are not taken for new."""
FILE = "cpm.safetensors"
"""The networks, in the folder of a round and in that of the whole."""
T = TypeVar("T")
R = TypeVar("R")
NAMES: tuple[Name, ...] = get_args(Name)
Round = dict[Name, Trained]
"""Both networks of a round."""
Task = tuple[Name, Weights | None]
"""A network to train, and its first weights."""
EVERY = 10
"""It tells how far it is after so many pushes, or epochs."""
TITLES = {
    "location": "location: mean square error of the scaled l",
    "type": "type: cross-entropy",
}


@dataclass(frozen=True)
class Options:
    """What the training can be told.

    Attributes:
        rounds: how often the networks drive, and learn from what came of it.
        varied: pushes beside the paper's 156 + 36, driven by skin.
        driven: pushes of each round that the networks drive.
        tested: pushes of the test from each mounting.
        epochs: of the last training.
        early: epochs of the trainings before, each of which begins with the weights of the last.
        stride: an epoch sees every so-manieth window.
        seed: of all chance.
        workers: how many processes.
    """

    rounds: int = 3
    varied: int = 360
    driven: int = 160
    tested: int = 60
    epochs: int = 150
    early: int = 50
    stride: int = 4
    seed: int = 0
    workers: int = 2


def train_cpm(options: Options, out: Path) -> None:
    """Train the contact networks from nothing; goes on where it was stopped.

    In round 0 the skin drives; in each later round the networks of the one before drive, and what
    they get into is learned with its true labels (DAgger). The networks of a round begin with the
    weights of the last; the last round is trained for all epochs.

    Args:
        options: how much of everything.
        out: the folder that takes the trials, checkpoints, learning curves, the tests, and
            `cpm.safetensors` with its card `cpm.json`.

    Raises:
        ConfigurationError: an option is wrong, or `out` holds a training of other options.
        ContactFusionError: a push could not be made, or a training diverged.
        DependencyError: torch, pybullet or open3d is not installed.
    """
    require_workers(options.workers)
    _claim(options, out)
    trials: list[LabelledTrial] = []
    rounds: list[tuple[Dataset, Round]] = []
    networks = None
    for turn in range(options.rounds + 1):
        note(f"round {turn} of {options.rounds}")
        trials += _collected(_lessons(turn, options), networks, options.workers, out / "trials")
        data, folder = Dataset.of(trials), out / f"round_{turn}"
        how = training.Options(
            seed=options.seed,
            epochs=options.epochs if turn == options.rounds else options.early,
            stride=options.stride,
        )
        before = rounds[-1][1] if rounds else None
        trained = _trained_round(data, how, before, options.workers, folder)
        rounds.append((data, trained))
        networks = _write(folder / FILE, data, trained, _told(trials, options), {})
    histories = {str(name): [one[name].history for _, one in rounds] for name in NAMES}
    print(f"learning curves: {draw_curves(histories, out / 'curves.png')}", flush=True)
    data, trained = rounds[-1]
    shipped = _write(out / FILE, data, trained, _told(trials, options), {})
    figures = tested(shipped, options.tested, options.seed, options.workers, out / "test")
    _write(shipped, data, trained, _told(trials, options), figures)
    print(f"networks: {shipped}, their card: {shipped.with_suffix('.json')}")


def _write(
    path: Path, data: Dataset, trained: Round, told: str, figures: Mapping[str, float]
) -> Path:
    """Write the networks of a round with their card; give the path."""
    card = write_networks(
        path, trained["location"], trained["type"], data, PROXIMITY, RATE, told, figures
    )
    _report(", ".join(f"{name} {value:.4g}" for name, value in card.figures.items()))
    return path


def _lessons(turn: int, options: Options) -> list[Lesson]:
    if turn == 0:
        return first_lessons(options.varied, options.seed)
    return driven_lessons(options.driven, turn, MOUNTINGS, options.seed)


def _claim(options: Options, out: Path) -> None:
    """Take a folder that is empty, or that holds a training of the same options."""
    told = {"collection": COLLECTION, **asdict(options)}
    del told["workers"]
    path = out / "settings.json"
    if path.is_file():
        try:
            held = json.loads(path.read_text())
        except ValueError:
            held = None
        if held != told:
            raise ConfigurationError(
                f"{out} holds another training: give another --out, or remove it"
            )
        return
    if out.is_dir() and any(out.iterdir()):
        raise ConfigurationError(f"{out} holds files, but no training: give another --out")
    make_folder(out)
    write_whole(path, json.dumps(told, indent=1) + "\n")


def _told(trials: Sequence[LabelledTrial], options: Options) -> str:
    """What networks were trained on."""
    cycles = sum(len(trial.stamp) for trial in trials)
    return (
        f"{len(trials)} simulated pushes, {cycles} cycles, each seen from {len(MOUNTINGS)} places: "
        f"the 156 + 36 of the paper and {options.varied} varied ones by skin, then "
        f"{options.driven} by networks in each of {options.rounds} rounds; seed {options.seed}"
    )


@dataclass(frozen=True)
class Failure:
    """What a process gives in place of a result.

    Attributes:
        why: in a sentence.
    """

    why: str


def _collected(
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
            _report(f"{done} of {len(missing)} pushes, {left:.0f} s left")
    return [load(_file(folder, lesson)) for lesson in lessons]


def _live(weights: Path | None, folder: Path, lesson: Lesson) -> Failure | None:
    try:
        save(live(lesson, weights), _file(folder, lesson))
    except ContactFusionError as error:
        return Failure(f"{lesson.name}: {error}")
    except Exception as error:  # a plug-in may raise anything, and the push must be named
        return Failure(f"{lesson.name}: {type(error).__name__}: {error}")
    return None


def _trained_round(
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
            _report(
                f"{name}: epoch {epoch} of {how.epochs}, loss {learned:.5f}, "
                f"validation {validated:.5f}, {left:.0f} s left"
            )

    try:
        return train(name, data, how, folder, warm, told)
    except ContactFusionError as error:
        return Failure(str(error))


def _sound(results: Iterable[tuple[T, R | Failure | Died]]) -> Iterator[tuple[T, R]]:
    """Pass results on, until one is a failure."""
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


def _report(line: str) -> None:
    """Report how far it is, beside the output."""
    note(f"  {line}", file=sys.stderr)


def draw_curves(histories: Mapping[str, Sequence[FloatArray]], path: Path) -> Path:
    """Draw the losses of all epochs; rounds follow each other, each with its lowest one marked.

    Args:
        histories: for each network those of its rounds, shape (epochs, 2): training, validation.
        path: the PNG to write.

    Returns:
        The path.
    """
    figure = new_figure(6.0 * len(histories), 4.0)
    panels = figure.subplots(1, len(histories), squeeze=False)[0]
    for axes, (name, rounds) in zip(panels, histories.items(), strict=True):
        before = 0
        for number, history in enumerate(rounds):
            epochs = before + np.arange(1, len(history) + 1)
            best = int(np.argmin(history[:, 1]))
            first = number == 0
            for column, what in enumerate(("training", "validation")):
                label = what if first else None
                axes.plot(epochs, history[:, column], color=COLOURS[column], label=label)
            axes.scatter([epochs[best]], [history[best, 1]], color=COLOURS[2], zorder=3,
                         label="lowest of the round" if first else None)  # fmt: skip
            axes.axvline(before + 0.5, color="#999999", linewidth=0.5)
            axes.annotate(f"round {number}", (before + 0.5, 1.0), (3.0, -10.0), fontsize=8,
                          xycoords=("data", "axes fraction"), textcoords="offset points",
                          color="#555555")  # fmt: skip
            before += len(history)
        axes.set(title=TITLES.get(name, name), xlabel="epoch", yscale="log")
        axes.grid(which="both", linewidth=0.2)
        axes.legend(fontsize="small", loc="upper right", bbox_to_anchor=(1.0, 0.94))
    content = io.BytesIO()
    figure.savefig(content, dpi=110, format="png")
    write_whole(path, content.getvalue())
    return path
