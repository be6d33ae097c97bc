"""Contacts from patches of taxels (F §V-C), and where a healthy patch feels none (method §5)."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from contactfusion.arrays import FloatArray
from contactfusion.errors import InvalidReadingError
from contactfusion.frames import points_in
from contactfusion.generator import Generator, GeneratorConfig, OfRobot
from contactfusion.generators.baselines import BaselineConfig
from contactfusion.grid import Grid
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, Note
from contactfusion.patches import PatchConfig, TaxelAreas
from contactfusion.readings import Reading, TactileImage
from contactfusion.state import State
from contactfusion.units import Memory, Spread

PERSISTS = 0.2
"""Evidence of others that lasts longer than this silences a taxel [s]."""
ALIVE = 0.5
"""A patch shows noise when at least this part of its taxels has changed."""
MARGIN = 2.0
"""A taxel so many voxels from a contact may share a voxel with it, and does not rule it out."""


class Health:
    """Watches a patch: a dead one reads zeros, or its last value, and must not forbid contacts.

    Args:
        taxels: how many there are.
        window: how long a sign of life counts [s].
    """

    def __init__(self, taxels: int, window: float) -> None:
        self._window = window
        self._values: FloatArray | None = None
        self._changed = np.full(taxels, -np.inf)
        self._confirmed = -np.inf
        self._disputed_since = np.full(taxels, np.inf)

    def watch(self, stamp: float, values: FloatArray) -> None:
        """Look for noise: a taxel that changes is alive.

        Args:
            stamp: of the reading [s].
            values: shape (n,), as the sensor gives them.
        """
        if self._values is not None:
            self._changed[values != self._values] = stamp
        self._values = values

    def confirm(self, stamp: float) -> None:
        """Note that a self-test passed, or that another source confirmed a contact."""
        self._confirmed = stamp

    def healthy(self, stamp: float) -> bool:
        """Whether the patch has shown itself alive within the window."""
        noisy = float((stamp - self._changed <= self._window).mean()) >= ALIVE
        return noisy or stamp - self._confirmed <= self._window

    def disputed(self, stamp: float, contradicted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Over which taxels another source has seen a contact for long, shape (n,).

        Args:
            stamp: of the reading [s].
            contradicted: shape (n,), where another source has evidence of a contact now.
        """
        since = np.minimum(self._disputed_since, stamp)
        self._disputed_since = np.where(contradicted, since, np.inf)
        return stamp - self._disputed_since > PERSISTS


class TactileConfig(GeneratorConfig):
    """The options of `tactile`."""

    patch: Annotated[PatchConfig, OfRobot("patches")]
    """The taxels, in the frame of the readings, in the order of their values."""
    baseline: BaselineConfig = Field(default_factory=BaselineConfig)
    """What the taxels read untouched."""
    floor: float = Field(default=5.0, ge=1)
    """No contact under so many standard deviations of the noise."""
    p_max: float = Field(default=0.95, gt=0, le=1)
    """The largest likelihood; 1 would saturate a voxel for good."""
    noise: Spread = Field(default=0.004, ge=0)
    """Standard deviation, by axis, of where the robot believes the patch to be, and of how far a
    push spreads in the skin, together [m]."""
    free: bool = False
    """Whether a healthy patch says where it feels nothing, as Null."""
    health_window: Memory = Field(default=2.0, gt=0)
    """How long noise, a self-test or a confirmed contact shows a patch to be healthy [s]."""

    @model_validator(mode="after")
    def _forgets(self) -> Self:
        if self.free and not self.replace:
            raise ValueError("free needs replace: a touched taxel must withdraw what it ruled out")
        if self.free and self.timeout is not None and self.timeout > self.health_window:
            raise ValueError(
                "with free, timeout may not exceed health_window: a patch that falls "
                "silent rules contacts out for as long"
            )
        return self


class TactileGenerator(Generator[TactileConfig]):
    """Regular, multi contact: the value of each touched taxel over the largest (F Eq 4).

    A taxel wider than a voxel gives hypotheses over its area, so that active neighbours form one
    cluster whose centroid lies between them. Output "free" is Null, p = 1, for taxels that are not
    touched, nor next to one that is.
    """

    Config = TactileConfig
    readings = (TactileImage,)

    def __init__(self, name: str, config: TactileConfig) -> None:
        super().__init__(name, config)
        if config.free:
            self.outputs = {"": HypothesisKind.REGULAR, "free": HypothesisKind.NULL}
        self._taxels = len(config.patch.centres())
        self._areas = TaxelAreas(config.patch)
        self._spreads = np.hypot(config.patch.spreads(), config.noise)
        self._baseline, self._noise = config.baseline.load(self._taxels)
        self._covered: tuple[float, FloatArray, NDArray[np.intp]] | None = None
        self.reset()

    def reset(self) -> None:
        """Forget all signs of health."""
        self._health = Health(self._taxels, self.config.health_window)

    def most_hypotheses(self, grid: Grid) -> int:
        """The voxels that the taxels cover."""
        return self.config.patch.count(grid.voxel_size)

    def self_test_passed(self, stamp: float) -> None:
        """Note that the sensor's own test has shown the patch to be healthy."""
        self._health.confirm(stamp)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Hypotheses over the area of each touched taxel."""
        assert isinstance(reading, TactileImage)
        touch = self.touch(reading)
        places, taxels = self._places(state.grid.voxel_size)
        touched = touch >= self.config.floor * self._noise
        chosen = touched[taxels]
        largest = touch[touched].max(initial=0.0)
        likelihoods = np.minimum(touch[taxels[chosen]] / largest, self.config.p_max)
        clouds = [
            self.cloud(
                reading,
                places[chosen],
                likelihoods,
                spreads=self._spreads[taxels[chosen]],
            )
        ]
        if self.config.free:
            clouds.append(self._free(reading, state, touched))
        return clouds

    def touch(self, reading: TactileImage) -> FloatArray:
        """How much each taxel is touched, at least 0, in the unit of the sensor.

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
        self, reading: TactileImage, state: State, touched: NDArray[np.bool_]
    ) -> HypothesisCloud:
        """Say where nothing touches, unless the patch may be dead or another source objects."""
        stamp, side, near = reading.stamp, state.grid.voxel_size, self._areas.near
        others = state.evidence(without=self.name)
        if len(others):
            others = points_in(state.frames.pose(reading.frame, of=state.grid.frame), others)
        claimed = near(others, MARGIN * side)
        self._health.watch(stamp, reading.values)
        if (touched & claimed).any():
            self._health.confirm(stamp)
        disputed = self._health.disputed(stamp, claimed)
        if not self._health.healthy(stamp):
            return self.nothing(reading, output="free", notes=(Note.UNHEALTHY,))
        places, taxels = self._places(side)
        felt = near(places[touched[taxels]], MARGIN * side)
        return self.cloud(reading, places[~(felt | disputed)[taxels]], 1.0, output="free")

    def _places(self, side: float) -> tuple[FloatArray, NDArray[np.intp]]:
        if self._covered is None or self._covered[0] != side:
            self._covered = (side, *self.config.patch.covered(side))
        return self._covered[1], self._covered[2]


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[TactileConfig]]]:
    """Offer the tactile generator."""
    return {"tactile": TactileGenerator}
