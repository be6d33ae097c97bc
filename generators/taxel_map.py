"""Contact location learned from calibrated presses, for skins without separate taxels."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray, frozen_array
from contactfusion.errors import ConfigurationError, InvalidReadingError
from contactfusion.files import read_npz, write_npz
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.readings import Reading, TactileImage
from contactfusion.state import State

if TYPE_CHECKING:
    from scipy.spatial import KDTree

FOLDS = 5
"""Folds of the cross-validation over positions."""
RIDGE = 1e-3
"""Shrinks the local plane towards the mean, relative to the neighbours' own scatter."""


@dataclass(frozen=True, eq=False)
class TaxelMap:
    """Calibrated presses: signals and positions.

    Attributes:
        signals: shape (m, c), readings less their untouched value; none is zero.
        places: positions, shape (m, 3) [m], in the frame of the sensor.
        neighbours: number of presses from which a location is interpolated.
        sigma: standard deviation of a location by axis [m], cross-validated.
    """

    signals: FloatArray
    places: FloatArray
    neighbours: int = 30
    sigma: float = 0.0

    def __post_init__(self) -> None:
        """Check every field and freeze the arrays."""
        keep, error = object.__setattr__, ConfigurationError
        keep(self, "signals", frozen_array(self.signals, (None, None), "signals of a map", error))
        shape = (len(self.signals), 3)
        keep(self, "places", frozen_array(self.places, shape, "places of a map", error))
        if not self.signals.any(axis=1).all():
            raise ConfigurationError("a press of a taxel map has no signal: leave it out")
        if not len(self.signals) or self.neighbours < 1 or not 0.0 <= self.sigma < np.inf:
            raise ConfigurationError("a taxel map needs presses, neighbours and a sigma")

    @staticmethod
    def fit(signals: FloatArray, places: FloatArray, neighbours: int = 30) -> "TaxelMap":
        """Learn a map from presses; its sigma is cross-validated over positions.

        Args:
            signals: shape (m, c), readings less their untouched value; none is zero.
            places: positions, shape (m, 3) [m], each pressed once or several times.
            neighbours: number of presses from which a location is interpolated.

        Raises:
            ConfigurationError: the arrays do not fit each other, a press has no signal, or all
                presses are at one position.
        """
        whole = TaxelMap(signals, places, neighbours)
        position = np.unique(places, axis=0, return_inverse=True)[1].ravel()
        if not position.any():
            raise ConfigurationError("a taxel map needs presses at two places or more")
        offsets = []
        for fold in range(FOLDS):
            left_out = position % FOLDS == fold
            rest = TaxelMap(signals[~left_out], places[~left_out], neighbours)
            offsets += [
                rest.locate(signal) - truth
                for signal, truth in zip(signals[left_out], places[left_out], strict=True)
            ]
        axes = np.count_nonzero(np.ptp(places, axis=0))
        square = float(np.square(offsets).sum(axis=1).mean()) / axes
        return replace(whole, sigma=float(np.sqrt(square)))

    @cached_property
    def tree(self) -> "KDTree":
        """A k-d tree over the directions of the signals."""
        from scipy.spatial import KDTree

        return KDTree(_directions(self.signals))

    def locate(self, signal: FloatArray) -> FloatArray:
        """The location of one press, shape (3,) [m], by its signal of shape (c,).

        The direction of the signal depends on the location, its length on the force. A plane is
        fitted to the positions of the nearest presses, weighted by nearness; results stay within
        their bounds.
        """
        direction = _directions(signal[None])[0]
        wanted = np.arange(1, min(self.neighbours, len(self.places)) + 1)
        distance, nearest = (np.asarray(v) for v in self.tree.query(direction, k=wanted))
        near, places = self.tree.data[nearest], self.places[nearest]
        weights = np.exp(-0.5 * (distance / max(float(distance.mean()), 1e-12)) ** 2)
        weights /= weights.sum()
        centre, middle = weights @ near, weights @ places
        offsets = near - centre
        scatter = (offsets * weights[:, None]).T @ offsets
        ridge = RIDGE * np.trace(scatter) + 1e-12
        slopes = np.linalg.solve(
            scatter + ridge * np.eye(len(scatter)),
            (offsets * weights[:, None]).T @ (places - middle),
        )
        located: FloatArray = middle + (direction - centre) @ slopes
        return np.clip(located, places.min(axis=0), places.max(axis=0))

    def save(self, path: Path) -> None:
        """Write the map to an npz file."""
        write_npz(
            path,
            signals=self.signals,
            places=self.places,
            neighbours=self.neighbours,
            sigma=self.sigma,
        )

    @staticmethod
    def load(path: Path) -> "TaxelMap":
        """A map from an npz file.

        Raises:
            ConfigurationError: the file is missing, or holds no map.
        """
        names = ("signals", "places", "neighbours", "sigma")
        held = read_npz(path, *names)
        for name, array in zip(names, held, strict=True):
            if array.dtype.kind not in "biuf":
                raise ConfigurationError(f"{path}: {name} holds {array.dtype}, not real numbers")
        signals, places, neighbours, sigma = held
        if neighbours.size != 1 or sigma.size != 1 or not np.isfinite(neighbours).all():
            raise ConfigurationError(f"{path}: neighbours and sigma are not a number each")
        return TaxelMap(signals, places, int(neighbours.item()), float(sigma.item()))


class TaxelMapConfig(GeneratorConfig):
    """The options of `taxel_map`."""

    map: Path
    """The npz file of a `TaxelMap`."""
    baseline: tuple[float, ...] | float = 0.0
    """The untouched value of all channels, or of each."""
    min_signal: float = Field(gt=0)
    """The length of the signal under which there is no contact, in the unit of the sensor; well
    above that of its noise."""
    p_max: float = Field(default=0.95, gt=0, le=1)
    """The likelihood of a contact when there is a signal."""


class TaxelMapGenerator(Generator[TaxelMapConfig]):
    """Regular, single contact: the position of calibrated presses with similar signals."""

    Config = TaxelMapConfig
    readings = (TactileImage,)

    def __init__(self, name: str, config: TaxelMapConfig) -> None:
        super().__init__(name, config)
        self._map = TaxelMap.load(config.map)
        self._baseline = np.asarray(config.baseline, np.float64)
        channels = self._map.signals.shape[1]
        if self._baseline.ndim and len(self._baseline) != channels:
            raise ConfigurationError(
                f"{len(self._baseline)} numbers, but the map has {channels} channels", "baseline"
            )

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The position that is pressed, if any."""
        assert isinstance(reading, TactileImage)
        channels = self._map.signals.shape[1]
        if len(reading.values) != channels:
            raise InvalidReadingError(
                f"{reading.label} has {len(reading.values)} channels, "
                f"but the map of '{self.name}' has {channels}"
            )
        signal = reading.values - self._baseline
        if np.linalg.norm(signal) < self.config.min_signal:
            return (self.nothing(reading),)
        position = self._map.locate(signal)
        return (
            self.cloud(
                reading,
                position[None],
                self.config.p_max,
                spreads=np.array([self._map.sigma]),
                single=True,
            ),
        )


def _directions(signals: FloatArray) -> FloatArray:
    directions: FloatArray = signals / np.linalg.norm(signals, axis=1, keepdims=True)
    return directions


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[TaxelMapConfig]]]:
    """The taxel map."""
    return {"taxel_map": TaxelMapGenerator}
