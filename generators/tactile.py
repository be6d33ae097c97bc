"""Contacts from patches of taxels (F §V-C), and where a healthy patch feels none."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import InvalidReadingError
from contactfusion.frames import points_in
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.generators.health import Health
from contactfusion.generators.taxels import BaselineConfig, PatchConfig
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, Note
from contactfusion.readings import Reading, TactileImage
from contactfusion.state import State


class TactileConfig(GeneratorConfig):
    """The options of `tactile`."""

    patch: PatchConfig
    """The taxels, in the frame of the readings, in the order of their values."""
    baseline: BaselineConfig = Field(default_factory=BaselineConfig)
    """What the taxels read untouched."""
    floor: float = Field(default=5.0, ge=1)
    """No contact under so many standard deviations of the noise."""
    p_max: float = Field(default=0.95, gt=0, le=1)
    """The largest likelihood; 1 would saturate a voxel for good."""
    free: bool = False
    """Whether a healthy patch says where it feels nothing, as Null."""
    health_window: float = Field(default=2.0, gt=0)
    """How long noise, a self-test or a confirmed contact shows a patch to be healthy [s]."""


class TactileGenerator(Generator[TactileConfig]):
    """Regular, multi contact: the value of each taxel over the largest (F Eq 4).

    A taxel wider than a voxel gives hypotheses over its area, so that active neighbours form one
    cluster whose centroid lies between them. Output "free" is Null, p = 1, for untouched taxels.
    """

    Config = TactileConfig
    readings = (TactileImage,)

    def __init__(self, name: str, config: TactileConfig) -> None:
        super().__init__(name, config)
        if config.free:
            self.outputs = {"": HypothesisKind.REGULAR, "free": HypothesisKind.NULL}
        self._taxels = len(config.patch.centres())
        self._baseline, self._noise = config.baseline.load(self._taxels)
        self._covered: tuple[float, FloatArray, FloatArray] | None = None
        self.reset()

    def reset(self) -> None:
        """Forget all signs of health."""
        self._health = Health(self.config.health_window)

    def self_test_passed(self, stamp: float) -> None:
        """Note that the sensor's own test has shown the patch to be healthy."""
        self._health.confirm(stamp)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Give hypotheses over the area of each active taxel."""
        assert isinstance(reading, TactileImage)
        touch = self.touch(reading)
        places, taxels = self._places(state.grid.voxel_size)
        active = touch >= self.config.floor * self._noise
        chosen = active[taxels]
        spread = float(np.hypot(*self.config.patch.edges())) / np.sqrt(24.0)
        largest = touch.max(initial=0.0)
        likelihoods = np.minimum(touch[taxels[chosen]] / (largest or 1.0), self.config.p_max)
        clouds = [
            self.cloud(
                reading,
                places[chosen],
                likelihoods,
                spreads=np.full(int(chosen.sum()), spread),
            )
        ]
        if self.config.free:
            clouds += self._free(reading, state, ~active, places, taxels)
        return clouds

    def touch(self, reading: TactileImage) -> FloatArray:
        """Give how much each taxel is touched, at least 0, in the unit of the sensor.

        Raises:
            InvalidReadingError: the reading has not one value a taxel.
        """
        if len(reading.values) != self._taxels:
            raise InvalidReadingError(
                f"{reading.label} has {len(reading.values)} values, "
                f"but the patch of '{self.name}' has {self._taxels} taxels"
            )
        change = reading.values - self._baseline
        match self.config.baseline.touch:
            case "rises":
                return np.maximum(change, 0.0)
            case "falls":
                return np.maximum(-change, 0.0)
            case "either":
                return np.abs(change)

    def _free(
        self,
        reading: TactileImage,
        state: State,
        untouched: NDArray[np.bool_],
        places: FloatArray,
        taxels: NDArray[np.intp],
    ) -> list[HypothesisCloud]:
        """Say where nothing touches, unless the patch may be dead or another source objects."""
        self._health.watch(reading.stamp, reading.values)
        if any(_confirmed(contact.shares, self.name) for contact in state.contacts):
            self._health.confirm(reading.stamp)
        contradicted = self._contradicted(reading, state)
        undisputed = self._health.undisputed(reading.stamp, contradicted)
        if not self._health.healthy(reading.stamp):
            return [self.nothing(reading, output="free", notes=(Note.UNHEALTHY,))]
        chosen = (untouched & undisputed)[taxels]
        return [self.cloud(reading, places[chosen], 1.0, output="free")]

    def _contradicted(self, reading: TactileImage, state: State) -> NDArray[np.bool_]:
        """Tell over which taxels another source has evidence, shape (taxels,)."""
        contradicted = np.zeros(self._taxels, np.bool_)
        evidence = state.evidence(without=self.name)
        if len(evidence):
            pose = state.frames.pose(reading.frame, of=state.grid.frame)
            local = points_in(pose, evidence)
            reach = np.array(self.config.patch.edges()) / 2.0 + state.grid.voxel_size
            near = np.array([*reach, 2.0 * state.grid.voxel_size])
            for taxel, centre in enumerate(self.config.patch.centres()):
                contradicted[taxel] = (np.abs(local - centre) <= near).all(axis=1).any()
        return contradicted

    def _places(self, side: float) -> tuple[FloatArray, NDArray[np.intp]]:
        if self._covered is None or self._covered[0] != side:
            self._covered = (side, *self.config.patch.covered(side))
        return self._covered[1], self._covered[2]


def _confirmed(shares: Mapping[str, float], name: str) -> bool:
    """Tell whether a contact has a share of this source and of another."""
    return shares.get(name, 0.0) > 0.0 and any(
        share > 0.0 for other, share in shares.items() if other != name
    )


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[TactileConfig]]]:
    """Offer the tactile generator."""
    return {"tactile": TactileGenerator}
