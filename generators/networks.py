"""The contact networks: location and kind of a contact, from proximity (O §II-D, IV-A)."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self, final, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator
from safetensors import SafetensorError
from safetensors.numpy import load

from contactfusion.arrays import FloatArray, frozen_array
from contactfusion.errors import ConfigurationError, InvalidReadingError, name_hint
from contactfusion.files import read_json, require_file
from contactfusion.generator import ConfigT
from contactfusion.generators.lstm import (
    DENSE,
    Weights,
    dense_shapes,
    network_of,
    tensor_shapes,
)
from contactfusion.generators.perceived import FaceGenerator, Kind, Memory, PerceivedConfig, Percept
from contactfusion.generators.proximity import ProximityConfig
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.model import Model
from contactfusion.readings import Reading
from contactfusion.state import State

Kinds = tuple[Literal["none"], Literal["point"], Literal["line"]]
KINDS: Kinds = ("none", "point", "line")
"""Kinds of contact, in the order of the type network's outputs."""
OUTPUTS = {"location": 1, "type": len(KINDS)}
"""The networks, with the number of outputs of each."""
Shipped = Literal["contact", "paper", "paper_lstm"]
SHIPPED: tuple[Shipped, ...] = get_args(Shipped)
"""Networks of the package: `contact` by `train cpm`, the others by `train cpm --preset paper`, with
the type network as printed and as an LSTM."""
GAP = 0.5
"""The longest silence that is bridged; after a longer one the memory is cleared [s]."""


class Scale(Model):
    """The range of a quantity in the training set; scaled, it is 0 to 1."""

    minimum: float
    maximum: float

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.maximum <= self.minimum:
            raise ConfigurationError(f"is not above the minimum, {self.minimum:g}", "maximum")
        return self

    def scaled(self, values: ArrayLike) -> FloatArray:
        """Values scaled from the range to [0, 1]."""
        return (np.asarray(values, np.float64) - self.minimum) / (self.maximum - self.minimum)

    def unscaled(self, values: ArrayLike) -> FloatArray:
        """Values scaled back from [0, 1] to the range."""
        return self.minimum + np.asarray(values, np.float64) * (self.maximum - self.minimum)


class NetworksCard(Model):
    """The model card of two networks: task, training data, and figures of validation."""

    proximity: ProximityConfig
    """The region, and the cells of its proximity lengths."""
    window: int = Field(ge=1, le=1000)
    """Number of successive instants in a window."""
    rate: float = Field(gt=0)
    """Rate of these instants [Hz]."""
    kinds: Kinds = KINDS
    """Kinds of contact, in the order of the type network's outputs."""
    length: Scale
    """Range of the proximity lengths [m]."""
    lateral: Scale
    """Range of the location [m]."""
    sigma: dict[str, Annotated[float, Field(gt=0)]]
    """Root mean square error of the location over validation, where the true contact is a `point`
    and where it is a `line` [m]."""
    figures: dict[str, float]
    """Figures of the networks, by names that end in the unit."""
    seeds: dict[str, int]
    """Seeds of the training of each network."""
    data: str
    """Description of the training data."""
    data_sha256: str
    weights_sha256: str

    @model_validator(mode="after")
    def _both_kinds(self) -> Self:
        if set(self.sigma) != {"point", "line"}:
            raise ConfigurationError("needs a value for point and for line", "sigma")
        return self


def read_card(path: Path) -> NetworksCard:
    """A model card from its file.

    Raises:
        ConfigurationError: the file is missing, or is no card.
    """
    fields = read_json(path)
    if not isinstance(fields, dict):
        raise ConfigurationError(f"{path} holds no card of networks")
    try:
        return NetworksCard(**fields)
    except ConfigurationError as error:
        raise ConfigurationError(error.problem, f"{path}: {error.path}") from None


@dataclass(frozen=True, slots=True, eq=False)
class Perception:
    """Outputs of the networks for one window.

    Attributes:
        lateral: position of the contact if there is one, to the left [m].
        probabilities: shape (3,), of no contact, a point and a line.
    """

    lateral: float
    probabilities: FloatArray


@final
class ContactNetworks:
    """The location and the type estimator, each two layers and a read-out.

    Args:
        card: of the networks.
        weights: of the networks `location` and `type`.
    """

    def __init__(self, card: NetworksCard, weights: Mapping[str, Weights]) -> None:
        self.card = card
        self._location = network_of(weights["location"])
        self._type = network_of(weights["type"])

    @classmethod
    def load(cls, path: Path) -> Self:
        """Both networks, from their files.

        Args:
            path: the safetensors file; the card lies beside it, as a JSON file of the same name.

        Raises:
            ConfigurationError: a file is missing or damaged, or one does not fit the other.
        """
        return cls(*read_networks(path))

    def perceive(self, window: FloatArray) -> Perception:
        """The contact at the end of a window: location and probabilities of its kinds.

        Args:
            window: proximity lengths, the newest last, of the card's window and columns, as
                (20, 12) [m].

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


def shipped(name: str = SHIPPED[0]) -> Path:
    """Weights of the package, by name."""
    return Path(__file__).parent / "data" / f"{name}.safetensors"


def weights_file(weights: Path | str | None) -> Path:
    """The file of weights that are given by path, by name, or not at all.

    Raises:
        ConfigurationError: a name without a suffix is neither of the package nor a file.
    """
    if weights is None:
        return shipped()
    path = Path(weights)
    if str(weights) in SHIPPED:
        return shipped(str(weights))
    if not path.suffix and not path.exists():
        hint = name_hint(path.name, SHIPPED, "networks")
        raise ConfigurationError(
            f"unknown networks '{path.name}'; {hint}, or the name of a .safetensors file", "weights"
        )
    return path


def read_networks(path: Path) -> tuple[NetworksCard, dict[str, Weights]]:
    """The card and the weights of both networks; refuses those that do not match.

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
        raise ConfigurationError(f"{path} holds other weights than its card names")
    weights = {
        network: {
            name: _tensor(tensors, f"{network}.{name}", shape, path)
            for name, shape in _shapes(card, outputs, f"{network}.{DENSE}" in tensors).items()
        }
        for network, outputs in OUTPUTS.items()
    }
    return card, weights


def _shapes(card: NetworksCard, outputs: int, dense: bool) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the weights of a network."""
    columns = card.proximity.columns
    if dense:
        return dense_shapes(card.window * columns, outputs)
    return tensor_shapes(columns, outputs)


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


class LearnedConfig(PerceivedConfig):
    """The options of all generators that use the contact networks."""

    weights: Shipped | Path | None = Field(default=None)
    """The networks, as `contactfusion train cpm` writes them, or the name of networks of the
    package; None: `contact`."""


class LearnedFace(FaceGenerator[ConfigT]):
    """Regular, multi contact: P = 1 - softmax(none), l̂ by the location network (method §6)."""

    def __init__(self, name: str, config: ConfigT) -> None:
        super().__init__(name, config)
        assert isinstance(config, LearnedConfig)
        self._networks = ContactNetworks.load(weights_file(config.weights))
        card = self._networks.card
        self.proximity = card.proximity
        """The region in front of the face, and its cells, as in training."""
        self._memory = Memory(card.window, 1.0 / card.rate, GAP)

    def reset(self) -> None:
        """Clear the memory."""
        self._memory.clear()

    def perceived(
        self, reading: Reading, state: State, lengths: FloatArray
    ) -> Sequence[HypothesisCloud]:
        """The contact on the face; none for a reading that is not newer than the last.

        Args:
            reading: that the lengths follow from.
            state: of the robot.
            lengths: shape (S,), the proximity of each strip [m].
        """
        window = self._memory.window(reading.stamp, lengths)
        if window is None:
            return ()
        found = self._networks.perceive(window)
        none, point, line = found.probabilities.tolist()
        likelihood = 1.0 - none
        kind = Kind.POINT if point >= line else Kind.LINE
        sigma = self._networks.card.sigma[kind]
        percept = Percept(kind, found.lateral, likelihood, sigma)
        return (self.face_cloud(reading, state, percept, lengths, self.proximity),)
