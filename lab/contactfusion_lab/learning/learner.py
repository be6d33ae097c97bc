"""A network while it learns, with all that a checkpoint must hold to go on bit for bit."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from contactfusion.errors import ConfigurationError
from contactfusion.files import read_arrays, write_npz
from contactfusion.generators.lstm import Weights
from contactfusion_lab.learning.backend import torch
from contactfusion_lab.learning.networks import ContactNetwork, Name, put_weights, weights_of

MOMENTS = ("step", "exp_avg", "exp_avg_sq")
"""What Adam keeps of each tensor."""


@final
class Learner:
    """A network, its optimiser, and what came of each epoch.

    Args:
        name: of the network.
        columns: S, the proximity lengths of an instant.
        seed: of the first weights and of the order of the windows.
        warm: weights to begin with instead; None: drawn ones.

    Raises:
        ConfigurationError: the weights to begin with are those of another network.
    """

    def __init__(self, name: Name, columns: int, seed: int, warm: Weights | None) -> None:
        self.generator = torch.Generator().manual_seed(seed)
        self.network = ContactNetwork(name, columns, self.generator)
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
        self.history = [(float(one), float(other)) for one, other in held["history"]]


def _require_same(path: Path, held: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
    names = {**held, **settings}
    if other := [name for name in names if held.get(name) != settings.get(name)]:
        raise ConfigurationError(
            f"{path} is the checkpoint of a training with other {' and '.join(other)}: "
            "remove it, or choose another folder"
        )
