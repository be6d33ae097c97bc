"""Contacts from patches of taxels (F §V-C), and free space over a healthy patch (method §5)."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Annotated, Literal, Self

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
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, Note, Resultant
from contactfusion.patches import PatchConfig, TaxelAreas
from contactfusion.readings import Reading, TactileImage
from contactfusion.state import State
from contactfusion.units import Memory, Spread

PERSISTS = 0.2
"""Evidence of other sources that lasts longer than this silences a taxel [s]."""
ALIVE = 0.5
"""The share of taxels that must have changed for a patch to show noise."""
OFTEN = 10
"""So often half of the taxels must have changed before one that never did is stuck."""
STUCK = "{} of the taxels never change: stuck?"
"""A note on a cloud."""
MARGIN = 2.0
"""Distance in voxels within which a taxel may share a voxel with a contact, and can't exclude
it."""

POINT = 1e-4
"""The least standard deviation of the lever of a force [m]."""


class Health:
    """Health of a patch: a dead one reads zeros, or its last value, and must not exclude contacts.

    Args:
        taxels: their number.
        window: time for which a sign of life counts [s].
    """

    def __init__(self, taxels: int, window: float) -> None:
        self._window = window
        self._values: FloatArray | None = None
        self._changed = np.full(taxels, -np.inf)
        self._changes = np.zeros(taxels, np.int64)
        self._confirmed = -np.inf
        self._disputed_since = np.full(taxels, np.inf)

    def watch(self, stamp: float, values: FloatArray) -> None:
        """Register noise: a taxel that changes is alive.

        Args:
            stamp: of the reading [s].
            values: shape (n,), as measured.
        """
        if self._values is not None:
            changed = values != self._values
            self._changed[changed] = stamp
            self._changes += changed
        self._values = values

    def confirm(self, stamp: float) -> None:
        """Register a passed self-test, or a contact that another source confirms."""
        self._confirmed = stamp

    def healthy(self, stamp: float) -> bool:
        """Whether the patch has shown itself alive within the window."""
        noisy = float((stamp - self._changed <= self._window).mean()) >= ALIVE
        return noisy or stamp - self._confirmed <= self._window

    def stuck(self) -> NDArray[np.bool_]:
        """Taxels that have never changed while most others have, often, shape (n,)."""
        often = float(np.median(self._changes)) >= OFTEN
        return np.asarray((self._changes == 0) & often, np.bool_)

    def disputed(self, stamp: float, contradicted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Taxels over which another source has reported a contact for long, shape (n,).

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
    """The values of untouched taxels."""
    floor: float = Field(default=5.0, ge=1)
    """The least value of a contact, in standard deviations of the noise."""
    relative_to: Literal["reading", "neighbours"] = "neighbours"
    """The values over the largest of which a value is a likelihood: all of the reading (F Eq 4), or
    its own and those of the taxels that touch it, so that a light press beside a firm one counts.
    """
    p_max: float = Field(default=0.95, gt=0, le=1)
    """The largest likelihood; 1 would saturate a voxel for good."""
    noise: Spread = Field(default=0.004, ge=0)
    """Standard deviation, by axis, of the position of the patch and of the spread of a push in the
    skin, together [m]."""
    gain: float | None = Field(default=None, gt=0)
    """Force on a taxel per unit of its value [N per unit]; None: unknown. With it the sum of all
    forces, and so the centre of pressure, is known of a patch that covers all of its link that can
    be touched."""
    free: bool = False
    """Whether a healthy patch excludes contacts where it measures none, as Null."""
    health_window: Memory = Field(default=2.0, gt=0)
    """Time for which noise, a self-test or a confirmed contact shows that a patch is healthy
    [s]."""

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
    """Regular, multi contact: the value of each touched taxel over a largest one (F Eq 4).

    A taxel wider than a voxel gives hypotheses over its area, so that active neighbours form one
    cluster whose centroid lies between them. Output "free" is Null, p = 1, for taxels that are
    neither touched nor next to a touched one.
    """

    Config = TactileConfig
    readings = (TactileImage,)

    def __init__(self, name: str, config: TactileConfig) -> None:
        super().__init__(name, config)
        if config.free:
            self.outputs = {"": HypothesisKind.REGULAR, "free": HypothesisKind.NULL}
        self._centres = config.patch.centres()
        self._taxels = len(self._centres)
        self._areas = TaxelAreas(config.patch)
        self._baseline, self._noise = config.baseline.load(self._taxels)
        self._covered: tuple[float, FloatArray, NDArray[np.intp], FloatArray] | None = None
        self.reset()

    def reset(self) -> None:
        """Drop all signs of health."""
        self._health = Health(self._taxels, self.config.health_window)

    def most_hypotheses(self, grid: Grid) -> int:
        """The voxels that the taxels cover."""
        return self.config.patch.count(grid.voxel_size)

    def self_test_passed(self, stamp: float) -> None:
        """Register a passed self-test of the sensor."""
        self._health.confirm(stamp)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Hypotheses over the area of each touched taxel."""
        assert isinstance(reading, TactileImage)
        touch = self.touch(reading)
        self._health.watch(reading.stamp, reading.values)
        stuck = self._health.stuck() & (touch > 0.0)
        touch = np.where(stuck, 0.0, touch)
        positions, taxels, spreads = self._positions(state.grid.voxel_size)
        touched = touch >= self.config.floor * self._noise
        chosen = touched[taxels]
        felt = np.where(touched, touch, 0.0)
        likelihoods = np.minimum(felt / self._largest(felt), self.config.p_max)
        notes = (STUCK.format(stuck.sum()),) if stuck.any() and chosen.any() else ()
        clouds = [
            self.cloud(
                reading,
                positions[chosen],
                likelihoods[taxels[chosen]],
                spreads=spreads[taxels[chosen]],
                notes=notes,
                resultant=self._resultant(np.where(touched, touch, 0.0), reading, state),
            )
        ]
        if self.config.free:
            clouds.append(self._free(reading, state, touched))
        return clouds

    def _resultant(self, touch: FloatArray, reading: Reading, state: State) -> Resultant | None:
        """The sum of the forces on all taxels, in the patch's frame; None where none is known."""
        if self.config.gain is None or not touch.any():
            return None
        centres, normals = self._centres, self.config.patch.normals()
        forces = -self.config.gain * touch[:, None] * normals
        force, torque = forces.sum(axis=0), np.cross(centres, forces).sum(axis=0)
        noise = self.config.gain * self._noise * (touch > 0.0)
        levers = np.linalg.norm(centres - centres[touch > 0.0].mean(axis=0), axis=1)
        misplaced = self.config.noise * float(np.linalg.norm(force))
        by_torque = float(np.hypot(np.linalg.norm(noise * levers), misplaced))
        by_force = float(np.linalg.norm(noise))
        deviations = by_force, max(by_torque, POINT * by_force)
        links = state.links_of(reading.frame)
        return Resultant(force, torque, np.zeros(3), *deviations, links)

    def _largest(self, touch: FloatArray) -> FloatArray:
        """The signal with which each taxel's is compared, positive, shape (n,)."""
        if self.config.relative_to == "reading":
            largest = np.full_like(touch, touch.max())
        else:
            largest, (first, second) = touch.copy(), self._neighbours.T
            np.maximum.at(largest, first, touch[second])
            np.maximum.at(largest, second, touch[first])
        return np.maximum(largest, np.finfo(np.float64).tiny)

    @cached_property
    def _neighbours(self) -> NDArray[np.intp]:
        return self.config.patch.neighbours()

    def touch(self, reading: TactileImage) -> FloatArray:
        """The signal of touch of each taxel, at least 0, in the unit of the sensor.

        Raises:
            InvalidReadingError: the reading does not have one value a taxel.
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
        """Taxels without contact, unless the patch may be dead or another source disagrees."""
        stamp, side, near = reading.stamp, state.grid.voxel_size, self._areas.near
        others = state.evidence(without=self.name)
        if len(others):
            others = points_in(state.frames.pose(reading.frame, of=state.grid.frame), others)
        claimed = near(others, MARGIN * side)
        if (touched & claimed).any():
            self._health.confirm(stamp)
        disputed = self._health.disputed(stamp, claimed)
        if not self._health.healthy(stamp):
            return self.nothing(reading, output="free", notes=(Note.UNHEALTHY,))
        positions, taxels, _ = self._positions(side)
        felt = near(positions[touched[taxels]], MARGIN * side)
        return self.cloud(reading, positions[~(felt | disputed)[taxels]], 1.0, output="free")

    def _positions(self, side: float) -> tuple[FloatArray, NDArray[np.intp], FloatArray]:
        """Positions over the taxels, the taxel of each, and the spreads of those of each taxel."""
        if self._covered is None or self._covered[0] != side:
            spreads = np.hypot(self.config.patch.spreads(side), self.config.noise)
            self._covered = (side, *self.config.patch.covered(side), spreads)
        return self._covered[1:]


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[TactileConfig]]]:
    """The tactile generator."""
    return {"tactile": TactileGenerator}
