"""Contacts on the face of a base by exteroceptive sensors: position, kind, likelihood (O §II-D)."""

from abc import abstractmethod
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.frames import points_in
from contactfusion.generator import ConfigT, Generator, GeneratorConfig
from contactfusion.generators.proximity import BoxConfig, ProximityConfig, Span, without
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import PointCloud, Reading
from contactfusion.state import State

LEAST_LINE = 0.05
"""The least length of a line (O §III-A) [m]."""
NEAR = 0.005
"""Strips further than the nearest by no more than this touch, too [m]."""


ROBOT = (BoxConfig(x=(0.20, 0.315), y=(-0.32, 0.32), z=(-0.45, -0.035)),)
"""The base of the package, with a margin for a LiDAR and its mounting, in its frame [m]."""

NOTHING_NEAR = "nothing in the region"
"""Note on a cloud; if it is permanent, the sensor's frame may be wrong."""
ROUNDING = 1e-9
"""Tolerance within which a length is that of an empty strip [m]."""


class Kind(StrEnum):
    """The kind of contact."""

    NONE = "none"
    POINT = "point"
    LINE = "line"


@dataclass(frozen=True, slots=True)
class Percept:
    """A perceived contact.

    Attributes:
        kind: of the contact.
        lateral: l̂, the middle of the contact, to the left of the robot's middle [m].
        likelihood: of any contact.
        sigma: standard deviation of l̂ [m].
    """

    kind: Kind
    lateral: float
    likelihood: float
    sigma: float


class PerceivedConfig(GeneratorConfig):
    """Options of all generators that perceive contacts on a face."""

    frame: str = "base"
    """The robot's frame, x forward; its face is upright and square to x."""
    height: Span = (-0.40, -0.05)
    """The lower and the upper end of the face in the robot's frame [m]."""
    robot: tuple[BoxConfig, ...] = ROBOT
    """Boxes around the robot's own parts that the sensor sees, in the robot's frame."""
    p_max: float = Field(default=0.95, gt=0, le=1)
    """The largest likelihood."""
    p_min: float = Field(default=0.5, ge=0, le=1)
    """The likelihood under which no contact is reported."""


class FaceGenerator(Generator[ConfigT]):
    """Regular, multi contact: a contact on the face, as a column or a strip of voxels."""

    outputs = {"": HypothesisKind.REGULAR}

    def face_cloud(
        self,
        reading: Reading,
        state: State,
        percept: Percept,
        lengths: FloatArray,
        proximity: ProximityConfig,
        near: float = NEAR,
    ) -> HypothesisCloud:
        """The contact on the face as a cloud; without hypotheses where the region is empty.

        A point is a column of voxels at l̂ over the face's height; a line reaches as far to either
        side of l̂ as the strips that are as near as the nearest.

        Args:
            reading: that the cloud follows from.
            state: of the robot.
            percept: the contact.
            lengths: shape (S,), the proximity of each strip [m].
            proximity: the region and its strips.
            near: strips of a line may be further than the nearest by this [m].
        """
        config = self.config
        assert isinstance(config, PerceivedConfig)
        if np.all(lengths >= proximity.empty - ROUNDING):
            return self.nothing(reading, notes=(NOTHING_NEAR,))
        likelihood = min(percept.likelihood, config.p_max)
        if percept.kind == Kind.NONE or likelihood < config.p_min:
            return self.nothing(reading)
        side = state.grid.voxel_size
        right, left = proximity.region.y
        middle = float(np.clip(percept.lateral, right, left))
        half = 0.0
        if percept.kind == Kind.LINE:
            half = min(half_length(lengths, proximity, near), left - middle, middle - right)
        y = _spaced(middle - half, middle + half, side)
        z = _spaced(config.height[0] + side / 2.0, config.height[1] - side / 2.0, side)
        positions = np.empty((len(y) * len(z), 3))
        positions[:, 0] = proximity.region.x[0]
        positions[:, 1], positions[:, 2] = np.repeat(y, len(z)), np.tile(z, len(y))
        spreads = np.full(len(positions), percept.sigma)
        return self.cloud(reading, positions, likelihood, frame=config.frame, spreads=spreads)

    @abstractmethod
    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The contact on the face."""


def points_before(reading: PointCloud, state: State, config: PerceivedConfig) -> FloatArray:
    """Points of a LiDAR without the robot itself, shape (n, 3) [m], in the robot's frame.

    Raises:
        FrameError: nothing joins the LiDAR's frame to the robot's.
    """
    pose = state.frames.pose(config.frame, of=reading.frame)
    return without(points_in(pose, reading.points), config.robot)


def half_length(lengths: FloatArray, proximity: ProximityConfig, near: float) -> float:
    """Half the span of the nearest strips, at least that of the shortest line [m]."""
    first, last = nearest_strips(lengths, near)
    return max((last - first) * proximity.cell[1], LEAST_LINE) / 2.0


def nearest_strips(lengths: FloatArray, near: float) -> tuple[int, int]:
    """The outermost of the strips that are as near as the nearest, from right to left.

    Args:
        lengths: shape (S,) [m].
        near: greatest difference from the nearest [m].
    """
    found = np.flatnonzero(lengths <= lengths.min() + near)
    return int(found[0]), int(found[-1])


class Memory:
    """The last descriptors, resampled to a fixed rate.

    Args:
        count: number of descriptors in a window.
        period: between two of a window [s].
        gap: the longest silence within a window; a longer one clears the memory [s].
    """

    def __init__(self, count: int, period: float, gap: float) -> None:
        self._ages = period * np.arange(count - 1, -1, -1)
        self._gap = gap
        self._held: deque[tuple[float, FloatArray]] = deque()

    def window(self, stamp: float, lengths: FloatArray) -> FloatArray | None:
        """The window that ends with a descriptor, which is added.

        Where one is missing, the nearest in time is repeated.

        Args:
            stamp: of it [s].
            lengths: shape (S,) [m].

        Returns:
            Shape (count, S) [m], the oldest first; None when the descriptor is not newer than the
            last.
        """
        held = self._held
        if held and stamp <= held[-1][0]:
            return None
        if held and stamp - held[-1][0] > self._gap:
            held.clear()
        held.append((stamp, lengths))
        while held[0][0] < stamp - self._ages[0] - self._gap:
            held.popleft()
        stamps = np.array([time for time, _ in held])
        wanted = stamp - self._ages
        nearest = np.searchsorted((stamps[1:] + stamps[:-1]) / 2.0, wanted)
        return np.stack([descriptor for _, descriptor in held])[nearest]

    def clear(self) -> None:
        """Drop all descriptors."""
        self._held.clear()


def _spaced(first: float, last: float, side: float) -> FloatArray:
    """Positions from first to last, no further apart than a voxel, shape (n,) [m]."""
    return np.linspace(first, last, int(np.ceil((last - first) / side - 1e-9)) + 1)
