"""Trains a network: Adam, checkpoints, the weights of the lowest validation loss (O §IV)."""

import hashlib
import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self, final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, ContactFusionError
from contactfusion.files import read_arrays, write_npz
from contactfusion.generators.lstm import Weights
from contactfusion.model import Model
from contactfusion_lab.learning.backend import repeatable, torch
from contactfusion_lab.learning.dataset import Dataset, Windows
from contactfusion_lab.learning.networks import (
    CHUNK,
    KEENNESS,
    Design,
    Name,
    drawn_network,
    gathered,
    put_weights,
    scaled_rows,
    weights_of,
)

RISE = 0.3
"""The part of the epochs in which the rate of one cycle rises."""
Report = Callable[[int, float, float, float], None]
"""Called after each epoch: its number from 1, training and validation loss, seconds left."""
Batch = tuple[torch.Tensor, torch.Tensor]
"""Windows, and the targets of a network."""
MOMENTS = ("step", "exp_avg", "exp_avg_sq")
"""State of Adam for each tensor."""


class Options(Model):
    """Hyperparameters of a training."""

    seed: int = Field(default=0, ge=0)
    """Seed of the first weights and of the order of the windows."""
    epochs: int = Field(default=200, ge=1)
    batch: int = Field(default=256, ge=1)
    """Windows for one step of Adam."""
    rate: float = Field(default=6e-3, gt=0)
    """Greatest learning rate. With 1e-3 throughout, as in the paper, the location erred by 4.25 cm
    on validation in place of 3.96, after 30 epochs of every twelfth window, with one seed."""
    schedule: Literal["constant", "one_cycle"] = "one_cycle"
    """Learning rate over time: constant, or up along half a cosine and then down to 0."""
    stride: int = Field(default=1, ge=1)
    """An epoch sees every so-manieth window, the next one those beside them."""
    mirrored: bool = True
    """Whether half of the windows of a batch are seen with left and right changed over."""
    begun: float = Field(default=0.15, ge=0, le=1)
    """The share of windows that are seen as if a trial, or sight, had just begun within them."""
    design: Design = "lstm"
    """Layers of the network."""
    keenness: float = Field(default=KEENNESS, gt=0)
    """Factor on torch's initial weights of the lengths."""


@dataclass(frozen=True, eq=False)
class Trained:
    """A network that has been trained.

    Attributes:
        name: which.
        weights: of the lowest validation loss.
        history: shape (epochs, 2), the training and the validation loss of each epoch: the mean
            square error of the scaled location, or the cross-entropy of the type.
        options: how it was trained.
    """

    name: Name
    weights: Weights
    history: FloatArray
    options: Options

    @property
    def best(self) -> int:
        """The epoch that the weights are of, from 1."""
        return int(np.argmin(self.history[:, 1])) + 1


def train(
    name: Name,
    data: Dataset,
    options: Options,
    folder: Path,
    warm: Weights | None = None,
    report: Report | None = None,
) -> Trained:
    """Train a network; the same seed gives the same weights, however often it was stopped between.

    Args:
        name: of the network. Location learns from the windows that end in contact, type from all.
        data: the windows.
        options: how.
        folder: takes the checkpoint `<name>.npz`, from which it goes on when it was stopped.
        warm: initial weights, such as those of the iteration before; None: random ones.
        report: takes each epoch.

    Raises:
        ConfigurationError: the folder holds a checkpoint that is damaged or of another training.
        ContactFusionError: the training diverged.
    """
    path, settings = folder / f"{name}.npz", _settings(name, data, options, warm)
    training, validation = (
        _Share.of(name, data.training, data),
        _Share.of(name, data.validation, data),
    )
    with repeatable():
        learner = Learner(name, data.training.rows.shape[1], options, warm)
        if path.is_file():
            learner.restore(path, settings)
        start, before = time.perf_counter(), len(learner.history)
        for epoch in range(before, options.epochs):
            learned = _learn(learner, training, options, epoch)
            validated = _loss(learner, validation, options.stride)
            if not math.isfinite(learned + validated):
                raise ContactFusionError(f"the training of {name} diverged in epoch {epoch + 1}")
            learner.note(learned, validated)
            learner.save(path, settings)
            if report:
                pace = (time.perf_counter() - start) / (epoch + 1 - before)
                report(epoch + 1, learned, validated, pace * (options.epochs - epoch - 1))
    return Trained(name, learner.best, np.array(learner.history), options)


@final
class Learner:
    """A network, its optimiser, and the losses of each epoch.

    Args:
        name: of the network.
        columns: S, the proximity lengths of an instant.
        options: how it is trained.
        warm: weights to begin with in place of drawn ones, or None.

    Raises:
        ConfigurationError: the weights to begin with are those of another network.
    """

    def __init__(self, name: Name, columns: int, options: Options, warm: Weights | None) -> None:
        self.generator = torch.Generator().manual_seed(options.seed)
        self.network = drawn_network(
            name, columns, self.generator, options.design, options.keenness
        )
        if warm is not None:
            try:
                put_weights(self.network, warm)
            except RuntimeError:
                raise ConfigurationError(
                    f"the weights that {name} is to begin with are of another network"
                ) from None
        self.optimiser = torch.optim.Adam(self.network.parameters(), fused=True)
        self.best = weights_of(self.network)
        """The weights of the lowest validation loss so far."""
        self.history: list[tuple[float, float]] = []
        """The training and the validation loss of each epoch."""

    def note(self, training: float, validation: float) -> None:
        """Note the losses of an epoch; keep the weights when there were none so good."""
        if all(validation < earlier for _, earlier in self.history):
            self.best = weights_of(self.network)
        self.history.append((training, validation))

    def save(self, path: Path, settings: Mapping[str, Any]) -> None:
        """Write a checkpoint; the file appears whole or not at all."""
        arrays: dict[str, NDArray[Any]] = {
            "history": np.array(self.history),
            "generator": self.generator.get_state().numpy(),
        }
        arrays |= {f"now.{name}": array for name, array in weights_of(self.network).items()}
        arrays |= {f"best.{name}": array for name, array in self.best.items()}
        for name, parameter in self.network.named_parameters():
            for moment in MOMENTS:
                arrays[f"{moment}.{name}"] = self.optimiser.state[parameter][moment].numpy()
        write_npz(path, settings=json.dumps(settings), **arrays)

    def restore(self, path: Path, settings: Mapping[str, Any]) -> None:
        """Go on from a checkpoint.

        Raises:
            ConfigurationError: the file is damaged, or of other settings.
        """
        parts = ("now", "best", *MOMENTS)
        names = [f"{part}.{name}" for part in parts for name in self.best]
        held = read_arrays(path, "settings", "history", "generator", *names)
        try:
            _require_same(path, json.loads(str(held["settings"])), settings)
            self._put(held)
        except ConfigurationError:
            raise
        except (AttributeError, RuntimeError, TypeError, ValueError):
            raise ConfigurationError(f"{path} is no checkpoint of a training: remove it") from None

    def _put(self, held: Mapping[str, NDArray[Any]]) -> None:
        for name, array in self.best.items():
            for part in ("best", "exp_avg", "exp_avg_sq"):  # torch checks the others
                if held[f"{part}.{name}"].shape != array.shape:
                    raise ValueError
        put_weights(self.network, {name: held[f"now.{name}"] for name in self.best})
        self.best = {name: held[f"best.{name}"] for name in self.best}
        for name, parameter in self.network.named_parameters():
            self.optimiser.state[parameter] = {
                moment: torch.tensor(held[f"{moment}.{name}"]) for moment in MOMENTS
            }
        self.generator.set_state(torch.tensor(held["generator"]))
        self.history = [
            (float(training), float(validation)) for training, validation in held["history"]
        ]


class _Share(NamedTuple):
    """The windows of one split that a network learns from, and their targets."""

    name: Name
    rows: torch.Tensor
    starts: torch.Tensor
    targets: torch.Tensor
    middle: float

    @classmethod
    def of(cls, name: Name, windows: Windows, data: Dataset) -> Self:
        if name == "location":
            which = windows.touching
            targets = data.lateral.scaled(windows.lateral[which]).astype(np.float32)[:, None]
        else:
            which = np.arange(len(windows))
            targets = windows.kind.astype(np.int64)
        rows, starts = scaled_rows(windows, data.length), torch.tensor(windows.starts[which])
        return cls(name, rows, starts, torch.tensor(targets), float(data.lateral.scaled(0.0)))

    def windows(self, which: torch.Tensor) -> Batch:
        return gathered(self.rows, self.starts[which]), self.targets[which]

    def loss(self, learner: Learner, batch: Batch) -> torch.Tensor:
        windows, targets = batch
        outputs = learner.network(windows)
        if self.name == "location":
            return torch.nn.functional.mse_loss(outputs, targets)
        return torch.nn.functional.cross_entropy(outputs, targets)


def _learn(learner: Learner, share: _Share, options: Options, epoch: int) -> float:
    """Go once through the windows of an epoch, in an order that is drawn; give the mean loss."""
    for group in learner.optimiser.param_groups:
        group["lr"] = _rate(options, epoch)
    count = len(share.starts)
    which = torch.arange(epoch % min(options.stride, count), count, options.stride)
    which = which[torch.randperm(len(which), generator=learner.generator)]
    total = 0.0
    for batch in which.split(options.batch):
        loss = share.loss(learner, _varied(share, batch, options, learner.generator))
        learner.optimiser.zero_grad()
        loss.backward()
        learner.optimiser.step()
        total += loss.item() * len(batch)
    return total / len(which)


def _varied(
    share: _Share, which: torch.Tensor, options: Options, generator: torch.Generator
) -> Batch:
    """Windows as they are, or as they might as well have been."""
    windows, targets = share.windows(which)
    count, length = windows.shape[:2]
    chance = torch.rand(2, count, 1, generator=generator)
    first = torch.randint(length, (count, 1), generator=generator)
    rows = torch.arange(length).expand(count, length)
    rows = torch.where(chance[0] < options.begun, torch.maximum(rows, first), rows)
    windows = torch.take_along_dim(windows, rows[:, :, None], dim=1)
    if options.mirrored:
        turned = chance[1] < 0.5
        windows = torch.where(turned[:, :, None], windows.flip(2), windows)
        if share.name == "location":
            targets = torch.where(turned, 2.0 * share.middle - targets, targets)
    return windows, targets


def _loss(learner: Learner, share: _Share, stride: int) -> float:
    """The mean loss of every so-manieth window, the same ones each time."""
    which = torch.arange(0, len(share.starts), stride)
    total = 0.0
    with torch.no_grad():
        for part in which.split(CHUNK):
            total += share.loss(learner, share.windows(part)).item() * len(part)
    return total / len(which)


def _rate(options: Options, epoch: int) -> float:
    if options.schedule == "constant":
        return options.rate
    part = (epoch + 0.5) / options.epochs
    phase = part / RISE if part < RISE else (1.0 - part) / (1.0 - RISE)
    return options.rate * 0.5 * (1.0 - math.cos(math.pi * phase))


def _settings(
    name: Name, data: Dataset, options: Options, warm: Weights | None
) -> dict[str, object]:
    """All that the weights depend on, for the checkpoint."""
    first = hashlib.sha256()
    for key, array in sorted((warm or {}).items()):
        first.update(key.encode() + array.tobytes())
    sums = {"network": name, "data": data.sha256, "first weights": first.hexdigest()}
    held = options.model_dump(mode="json")
    for option in ("design", "keenness"):  # checkpoints from before these were options stay good
        if held[option] == Options.model_fields[option].default:
            del held[option]
    return {**held, **sums}


def _require_same(path: Path, held: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
    names = {**held, **settings}
    if other := [name for name in names if held.get(name) != settings.get(name)]:
        raise ConfigurationError(
            f"{path} is the checkpoint of a training with other {' and '.join(other)}: "
            "remove it, or choose another folder"
        )
