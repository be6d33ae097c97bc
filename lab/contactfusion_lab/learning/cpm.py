"""`train cpm`: collects pushes, trains the contact networks, lets them drive, and tests them."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError
from contactfusion.figures import COLOURS, new_figure
from contactfusion.files import make_folder
from contactfusion.generators.lstm import Weights
from contactfusion.terminal import note, say
from contactfusion_lab.learning import training
from contactfusion_lab.learning.dataset import Dataset, LabelledTrial, content_of, load
from contactfusion_lab.learning.export import tested, write_networks
from contactfusion_lab.learning.networks import Name
from contactfusion_lab.learning.rollout import (
    AS_PRINTED,
    Course,
    Lesson,
    as_printed,
    driven_lessons,
    first_lessons,
    live,
)
from contactfusion_lab.learning.training import Trained, train
from contactfusion_lab.trials.executor import Executor, Local, ShippedFile
from contactfusion_lab.trials.folder import claim, save_figure, trial_file
from contactfusion_lab.trials.runner import Failure, Made, kept, ordered

SUFFIX = ".npz"
"""Suffix of the files of trials."""
RATE = 10.0
"""Rate of the cycles [Hz]."""
COLLECTION = 3
"""Counts up when lessons change, so that old ones are not taken for new."""
FILE = "cpm.safetensors"
"""The networks, in the folder of an iteration and in that of the training."""
LSTM_FILE = "cpm_lstm.safetensors"
"""With the preset, the networks whose type network is an LSTM, too."""
NAMES: tuple[Name, ...] = get_args(Name)
Round = dict[Name, Trained]
"""Both networks of a DAgger iteration."""
Task = tuple[Name, training.Options, Weights | None]
"""A network to train, how, and its first weights."""
PRINTED: dict[str, Any] = {
    "rate": 1e-3, "schedule": "constant", "mirrored": False, "begun": 0.0, "keenness": 1.0,
}  # fmt: skip
"""How the paper trains (O §III-B), without anything that it does not print."""
EVERY = 10
"""Epochs between two reports of the loss."""
TITLES = {
    "location": "location: mean square error of the scaled l",
    "type": "type: cross-entropy",
}


@dataclass(frozen=True)
class Options:
    """Options of the training.

    Attributes:
        rounds: DAgger iterations, in which the networks drive and learn from their rollouts.
        varied: pushes beside the paper's 156 + 36, driven by skin.
        driven: pushes of each iteration that the networks drive.
        tested: pushes of the test from each mounting; 0: no test.
        epochs: of the last iteration.
        early: epochs of the iterations before, each of which begins with the weights of the last.
        stride: an epoch sees every so-manieth window.
        seed: of all random draws.
        preset: "paper": pushes and training as printed, and the type network in both readings.
        executor: the workers that make the pushes.
    """

    rounds: int = 3
    varied: int = 360
    driven: int = 160
    tested: int = 60
    epochs: int = 150
    early: int = 50
    stride: int = 4
    seed: int = 0
    preset: str = ""
    executor: Executor = Local()

    @property
    def course(self) -> Course:
        """How pushes are seen, and when they end."""
        return AS_PRINTED if self.preset else Course()

    def how(self, iteration: int) -> dict[Name, training.Options]:
        """How each network is trained in an iteration."""
        fields = {
            **(PRINTED if self.preset else {}),
            "seed": self.seed,
            "epochs": self.epochs if iteration == self.rounds else self.early,
            "stride": self.stride,
        }
        how = training.Options(**fields)
        design = "dense" if self.preset else "lstm"
        return {"location": how, "type": how.model_copy(update={"design": design})}


PRESETS = {
    "": Options(),
    "paper": Options(rounds=0, varied=0, tested=0, epochs=200, preset="paper"),
}
"""Options by the name of their preset."""


def train_cpm(options: Options, out: Path) -> None:
    """Train the contact networks from nothing; goes on where it was stopped.

    In iteration 0 the skin drives; in each later one the networks of the one before drive, and
    their rollouts are learned with true labels (DAgger). The networks of an iteration begin with
    the weights of the last; those of the last are trained for all epochs. With the preset the
    type network has fully connected layers, and is trained as an LSTM once more.

    Args:
        options: of the training.
        out: the folder that takes the trials, checkpoints, learning curves, the tests, and
            `cpm.safetensors` with its card `cpm.json`; with the preset `cpm_lstm.safetensors`, too.

    Raises:
        ConfigurationError: an option is wrong, or `out` holds a training of other options.
        RobotError: a push could not be made, or a training diverged.
        DependencyError: torch, pybullet or open3d is not installed.
    """
    settings = {"collection": COLLECTION, **vars(options)}
    del settings["executor"]
    if not options.preset:
        del settings["preset"]
    claim(settings, out, (), "pushes")
    trials: list[LabelledTrial] = []
    rounds: list[tuple[Dataset, Round]] = []
    networks = None
    for iteration in range(options.rounds + 1):
        note(f"round {iteration} of {options.rounds}")
        trials += _collected(_lessons(iteration, options), networks, options.executor, out)
        data, folder = Dataset.of(trials), out / f"round_{iteration}"
        before = rounds[-1][1] if rounds else {}
        trained = _trained_round(
            data, options.how(iteration), before, options.executor.local, folder
        )
        rounds.append((data, trained))
        networks = _write(folder / FILE, data, trained, options, trials, {})
    histories = {
        str(name): [networks_of[name].history for _, networks_of in rounds] for name in NAMES
    }
    say(f"learning curves: {draw_curves(histories, out / 'curves.png')}")
    data, trained = rounds[-1]
    shipped = _write(out / FILE, data, trained, options, trials, {})
    if options.tested:
        figures = tested(
            shipped, options.course.mountings, options.tested, options.seed, options.executor,
            out / "test",
        )  # fmt: skip
        _write(shipped, data, trained, options, trials, figures)
    say(f"networks: {shipped}, their card: {shipped.with_suffix('.json')}")
    if options.preset:
        how: dict[Name, training.Options] = {"type": options.how(options.rounds)["location"]}
        as_lstm = _trained_round(data, how, {}, options.executor.local, out / "lstm")
        path = _write(out / LSTM_FILE, data, {**trained, **as_lstm}, options, trials, {})
        say(f"with the type network as an LSTM: {path}")


def _write(
    path: Path,
    data: Dataset,
    trained: Round,
    options: Options,
    trials: Sequence[LabelledTrial],
    figures: Mapping[str, float],
) -> Path:
    """Write the networks of an iteration with their model card; return the path."""
    card = write_networks(
        path, trained["location"], trained["type"], data, options.course.proximity, RATE,
        _described(trials, options), figures,
    )  # fmt: skip
    _report(", ".join(f"{name} {value:.4g}" for name, value in card.figures.items()))
    return path


def _lessons(iteration: int, options: Options) -> list[Lesson]:
    if iteration == 0:
        lessons = first_lessons(options.varied, options.seed)
    else:
        lessons = driven_lessons(options.driven, iteration, options.course.mountings, options.seed)
    return as_printed(lessons) if options.preset else lessons


def _described(trials: Sequence[LabelledTrial], options: Options) -> str:
    """Description of the training data."""
    cycles = sum(len(trial.stamp) for trial in trials)
    places = len(options.course.mountings)
    varied = f" and {options.varied} varied ones" if options.varied else ""
    driven = (
        f", then {options.driven} by networks in each of {options.rounds} rounds"
        if options.rounds
        else ""
    )
    return (
        f"{len(trials)} simulated pushes{' as printed' if options.preset else ''}, "
        f"{cycles} cycles, each seen from {places} place{'s' * (places != 1)}: "
        f"the 156 + 36 of the paper{varied} by skin{driven}; seed {options.seed}"
    )


def _collected(
    lessons: Sequence[Lesson], weights: Path | None, executor: Executor, out: Path
) -> list[LabelledTrial]:
    """Make the pushes that are not kept yet; the trials of all.

    Args:
        lessons: the pushes of an iteration.
        weights: of the networks that drive, when they do.
        executor: the workers.
        out: the folder that takes a file for each trial.

    Raises:
        RobotError: a push cannot be made.
    """
    tasks = {lesson.name: lesson for lesson in lessons}
    shipped = ShippedFile(weights) if weights else None
    for _, made in kept(partial(_made, shipped), tasks, out, SUFFIX, "pushes", executor):
        if isinstance(made, Failure):
            raise RobotError(f"{made.why}; start again to go on")
    return [load(trial_file(out, name, SUFFIX)) for name in tasks]


def _made(weights: Path | None, lesson: Lesson) -> Made:
    return Made(content_of(live(lesson, weights)))


def _trained_round(
    data: Dataset,
    how: Mapping[Name, training.Options],
    before: Round,
    executor: Executor,
    folder: Path,
) -> Round:
    """Train networks, each in a process, on from those of the iteration before.

    Args:
        data: of this iteration and all before.
        how: each is trained, by name.
        before: the networks of the iteration before, if any.
        executor: workers on this machine, as checkpoints are files of it.
        folder: takes the checkpoints.

    Raises:
        RobotError: a training diverged, or its checkpoint is another's.
    """
    make_folder(folder)
    tasks: dict[str, Task] = {
        name: (name, options, before[name].weights if name in before else None)
        for name, options in how.items()
    }
    trained = ordered(partial(_train, data, folder), tasks, executor)
    return dict(zip(how, trained, strict=True))


def _train(data: Dataset, folder: Path, task: Task) -> Trained:
    name, how, warm = task

    def report(epoch: int, learned: float, validated: float, left: float) -> None:
        if epoch % EVERY == 0:
            _report(
                f"{name}: epoch {epoch} of {how.epochs}, loss {learned:.5f}, "
                f"validation {validated:.5f}, {left:.0f} s left"
            )

    return train(name, data, how, folder, warm, report)


def _report(line: str) -> None:
    """Report how far it is, beside the output."""
    note(f"  {line}", file=sys.stderr)


def draw_curves(histories: Mapping[str, Sequence[FloatArray]], path: Path) -> Path:
    """Draw the losses of all epochs; iterations follow each other, each with its lowest marked.

    Args:
        histories: for each network those of its iterations, shape (epochs, 2): training, then
            validation.
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
    return save_figure(figure, path)
