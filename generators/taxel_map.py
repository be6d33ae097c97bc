"""Contact location learned from calibrated presses, for skins without separate taxels."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, InvalidReadingError
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.readings import Reading, TactileImage
from contactfusion.state import State

if TYPE_CHECKING:
    from scipy.spatial import KDTree

RIDGE = 1e-3
"""Shrinks the local plane towards the mean, relative to the neighbours' own scatter."""


@dataclass(frozen=True, eq=False)
class TaxelMap:
    """Calibrated presses: what the sensor read, and where it was pressed.

    Attributes:
        signals: shape (m, c), readings less their untouched value; all non-zero.
        places: shape (m, 3) [m], in the frame of the sensor.
        neighbours: how many presses a location follows from.
        sigma: standard deviation of a location by axis [m], on presses that were left out.
    """

    signals: FloatArray
    places: FloatArray
    neighbours: int = 30
    sigma: float = 0.0

    @cached_property
    def tree(self) -> "KDTree":
        """A k-d tree over the directions of the signals."""
        from scipy.spatial import KDTree

        return KDTree(_directions(self.signals))

    def locate(self, signal: FloatArray) -> FloatArray:
        """Locate one press, shape (3,) [m].

        The direction of the signal tells the place, its length tells the force. A plane is fitted
        to the places of the nearest presses, weighted by nearness; it never leaves their bounds.
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
        np.savez(
            path,
            signals=self.signals,
            places=self.places,
            neighbours=self.neighbours,
            sigma=self.sigma,
        )

    @staticmethod
    def load(path: Path) -> "TaxelMap":
        """Read a map from an npz file.

        Raises:
            ConfigurationError: the file is missing, or holds no map.
        """
        try:
            with np.load(path) as arrays:
                return TaxelMap(
                    arrays["signals"],
                    arrays["places"],
                    int(arrays["neighbours"]),
                    float(arrays["sigma"]),
                )
        except (OSError, KeyError, ValueError) as error:
            raise ConfigurationError(f"the taxel map {path} cannot be read: {error}") from None


class TaxelMapConfig(GeneratorConfig):
    """The options of `taxel_map`."""

    map: Path
    """The npz file of a `TaxelMap`."""
    baseline: tuple[float, ...] | float = 0.0
    """What the channels read untouched."""
    min_signal: float = Field(gt=0)
    """No contact under this length of the signal; at least five standard deviations of noise."""
    p_max: float = Field(default=0.95, gt=0, le=1)
    """The likelihood of a contact when there is a signal."""


class TaxelMapGenerator(Generator[TaxelMapConfig]):
    """Regular, single contact: the place that calibrated presses with like signals had."""

    Config = TaxelMapConfig
    readings = (TactileImage,)

    def __init__(self, name: str, config: TaxelMapConfig) -> None:
        super().__init__(name, config)
        self._map = TaxelMap.load(config.map)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Give the one place that is pressed, if any is."""
        assert isinstance(reading, TactileImage)
        channels = self._map.signals.shape[1]
        if len(reading.values) != channels:
            raise InvalidReadingError(
                f"{reading.label} has {len(reading.values)} channels, "
                f"but the map of '{self.name}' has {channels}"
            )
        signal = reading.values - np.asarray(self.config.baseline)
        if np.linalg.norm(signal) < self.config.min_signal:
            return (self.nothing(reading),)
        place = self._map.locate(signal)
        return (
            self.cloud(
                reading,
                place[None],
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
    """Offer the taxel map."""
    return {"taxel_map": TaxelMapGenerator}
