"""Two networks that tell from proximity where an object touches, and how (O §II-D, IV-A)."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self, final

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load

from contactfusion.arrays import FloatArray, frozen_array
from contactfusion.errors import ConfigurationError, InvalidReadingError, name_hint
from contactfusion.files import require_file
from contactfusion.generators.lstm import Network, Weights, tensor_shapes
from contactfusion.generators.network_card import KINDS, NetworksCard, read_card

OUTPUTS = {"location": 1, "type": len(KINDS)}
"""The networks, and how many outputs each has."""


@dataclass(frozen=True, slots=True, eq=False)
class Perception:
    """What the networks say about one window.

    Attributes:
        lateral: where the object touches if it does, to the left [m].
        probabilities: shape (3,), of no contact, a point and a line.
    """

    lateral: float
    probabilities: FloatArray


@final
class ContactNetworks:
    """The location and the type estimator, each two LSTM layers and a read-out.

    Args:
        card: what they were trained for.
        weights: of the networks `location` and `type`.
    """

    def __init__(self, card: NetworksCard, weights: Mapping[str, Weights]) -> None:
        self.card = card
        self._location = Network.of(weights["location"])
        self._type = Network.of(weights["type"])

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read both networks.

        Args:
            path: the safetensors file; the card lies beside it, as a JSON file of the same name.

        Raises:
            ConfigurationError: a file is missing or damaged, or one does not fit the other.
        """
        return cls(*read_networks(path))

    def perceive(self, window: FloatArray) -> Perception:
        """Tell where and how an object touches at the end of a window.

        Args:
            window: shape (20, 12) [m], proximity lengths, the newest last.

        Raises:
            InvalidReadingError: the window has another shape, or a length is not finite.
        """
        shape = (self.card.window, self.card.proximity.columns)
        window = frozen_array(window, shape, "proximity lengths", InvalidReadingError)
        lengths = self.card.length.scaled(window)
        logits = self._type.outputs(lengths)
        odds = np.exp(logits - logits.max())
        lateral = float(self.card.lateral.unscaled(self._location.outputs(lengths)[0]))
        return Perception(lateral, odds / odds.sum())


def shipped() -> Path:
    """Give the weights that come with the package."""
    return Path(__file__).parent / "data" / "contact.safetensors"


def read_networks(path: Path) -> tuple[NetworksCard, dict[str, Weights]]:
    """Read the card and the weights of both networks, and make sure that they fit.

    Raises:
        ConfigurationError: a file is missing or damaged, or one does not fit the other.
    """
    require_file(path, ConfigurationError)
    card, content = read_card(path.with_suffix(".json")), path.read_bytes()
    try:
        tensors = load(content)
    except (SafetensorError, KeyError, TypeError, ValueError):
        raise ConfigurationError(f"{path} is no safetensors file, or is cut off") from None
    if hashlib.sha256(content).hexdigest() != card.weights_sha256:
        raise ConfigurationError(f"{path} holds other weights than its card tells of")
    columns = card.proximity.columns
    weights = {
        network: {
            name: _tensor(tensors, f"{network}.{name}", shape, path)
            for name, shape in tensor_shapes(columns, outputs).items()
        }
        for network, outputs in OUTPUTS.items()
    }
    return card, weights


def _tensor(tensors: Weights, name: str, shape: tuple[int, ...], path: Path) -> NDArray[np.float32]:
    if name not in tensors:
        hint = name_hint(name, tensors, "tensors")
        raise ConfigurationError(f"{path} lacks the tensor {name}; {hint}")
    tensor = tensors[name]
    if tensor.shape != shape:
        raise ConfigurationError(f"{path}: the tensor {name} has shape {tensor.shape}, not {shape}")
    if not np.isfinite(tensor).all():
        raise ConfigurationError(f"{path}: the tensor {name} holds weights that are not finite")
    return tensor
