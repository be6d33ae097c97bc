"""`train cpm`: collects pushes, trains the contact networks, lets them drive, and tests them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from contactfusion.errors import ConfigurationError
from contactfusion.files import make_folder, write_whole
from contactfusion.terminal import note
from contactfusion_lab.experiments.workers import require_workers
from contactfusion_lab.learning import training
from contactfusion_lab.learning.collecting import PROXIMITY
from contactfusion_lab.learning.curves import draw_curves
from contactfusion_lab.learning.lessons import MOUNTINGS, Lesson, driven_lessons, first_lessons
from contactfusion_lab.learning.rounds import NAMES, Round, collected, say, trained_round
from contactfusion_lab.learning.shipping import write_networks
from contactfusion_lab.learning.testing import tested
from contactfusion_lab.learning.trials import LabelledTrial
from contactfusion_lab.learning.windows import Dataset

RATE = 10.0
"""Of the cycles [Hz]."""
COLLECTION = 3
"""Counts up when lessons change, so that old ones are not taken for new."""
FILE = "cpm.safetensors"
"""The networks, in the folder of a round and in that of the whole."""


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
        trials += collected(_lessons(turn, options), networks, options.workers, out / "trials")
        data, folder = Dataset.of(trials), out / f"round_{turn}"
        how = training.Options(
            seed=options.seed,
            epochs=options.epochs if turn == options.rounds else options.early,
            stride=options.stride,
        )
        before = rounds[-1][1] if rounds else None
        trained = trained_round(data, how, before, options.workers, folder)
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
    say(", ".join(f"{name} {value:.4g}" for name, value in card.figures.items()))
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
    """Say what networks were trained on."""
    cycles = sum(len(trial.stamp) for trial in trials)
    return (
        f"{len(trials)} simulated pushes, {cycles} cycles, each seen from {len(MOUNTINGS)} places: "
        f"the 156 + 36 of the paper and {options.varied} varied ones by skin, then "
        f"{options.driven} by networks in each of {options.rounds} rounds; seed {options.seed}"
    )
