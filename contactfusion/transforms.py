"""Frames over time, as /tf and /tf_static tell them: interpolated, never guessed beyond."""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, final

import numpy as np

from contactfusion.errors import FrameError, RecordingError
from contactfusion.frames import Parent, Pose, pose_of
from contactfusion.readings import Reading, Transform

LENGTH = 4096
"""At least so many poses of a frame are remembered."""
NEARLY_ALONG = 0.9995
"""From which cosine between two quaternions on a straight line stands for the arc."""
AHEAD = 1.0
"""Transforms of a recording come so much earlier than what needs them [s]: they are published late
and seldom."""
Quaternion = Sequence[float]


@dataclass
class _Series:
    """The poses of one frame in one parent, by rising stamps."""

    parent: str
    static: bool
    stamps: list[float] = field(default_factory=list)
    transforms: list[Transform] = field(default_factory=list)

    def add(self, transform: Transform) -> None:
        if self.stamps and transform.stamp <= self.stamps[-1]:
            return
        self.stamps.append(transform.stamp)
        self.transforms.append(transform)
        if len(self.stamps) >= 2 * LENGTH:
            del self.stamps[:LENGTH], self.transforms[:LENGTH]

    def around(self, stamp: float) -> "_Series":
        """Give the first and the last pose, and the two next to a stamp: no other counts then."""
        after = bisect_right(self.stamps, stamp)
        count = len(self.stamps)
        rows = sorted({0, after - 1, after, count - 1} & {*range(count)})
        return _Series(
            self.parent,
            self.static,
            [self.stamps[row] for row in rows],
            [self.transforms[row] for row in rows],
        )

    def pose(self, stamp: float) -> Pose:
        """Give the pose at a stamp that lies between the first and the last."""
        if self.static:
            return _pose(self.transforms[-1])
        after = bisect_right(self.stamps, stamp)
        if after == len(self.stamps):
            return _pose(self.transforms[-1])
        return _between(self.transforms[after - 1], self.transforms[after], stamp)


@final
class Transforms:
    """Remembers transforms; between two of them a frame moves evenly, as in ROS (tf2).

    Places go straight and turns by the shortest arc. (pytransform3d has screws, which end at the
    same poses by another way.)
    """

    def __init__(self) -> None:
        self._series: dict[str, _Series] = {}
        self._frames: frozenset[str] = frozenset()

    def add(self, transform: Transform) -> None:
        """Remember a transform, unless one of the frame as new is known.

        A frame that gets another parent hangs under that one only from then on.
        """
        series = self._series.get(transform.child_frame)
        if series is None or (series.parent, series.static) != (transform.frame, transform.static):
            series = self._series[transform.child_frame] = _Series(
                transform.frame, transform.static
            )
            self._frames = frozenset(self._series) | {one.parent for one in self._series.values()}
        if series.static:  # said again; the newest holds
            series.stamps.clear()
            series.transforms.clear()
        series.add(transform)

    def clear(self) -> None:
        """Forget all."""
        self._series.clear()
        self._frames = frozenset()

    @property
    def static(self) -> dict[str, Parent]:
        """By frame that stands still in its parent the parent, and the frame's pose there."""
        return {
            frame: (series.parent, _pose(series.transforms[-1]))
            for frame, series in self._series.items()
            if series.static
        }

    def at(self, stamp: float) -> "TransformsAt | None":
        """Give the frames as they are at a stamp [s]; None while there are none."""
        return TransformsAt(self._series, self._frames, stamp) if self._series else None


def transforms_ahead(readings: Iterable[Reading]) -> Iterator[Reading]:
    """Readings of a recording, its transforms a second before what else is measured then.

    Live, a pipeline would wait for the transforms that a cloud needs; here they are known.

    Raises:
        RecordingError: the recording breaks off; what came before it is given first.
    """
    held: deque[Reading] = deque()
    broken: RecordingError | None = None
    try:
        for reading in readings:
            if isinstance(reading, Transform):
                yield reading
            else:
                held.append(reading)
            while held and held[0].stamp < reading.stamp - AHEAD:
                yield held.popleft()
    except RecordingError as error:  # what came before it counts
        broken = error
    yield from held
    if broken:
        raise broken


@final
@dataclass(frozen=True)
class TransformsAt:
    """The frames at one stamp: for a `FrameTree`, which asks for those that it needs."""

    _series: dict[str, _Series]
    frames: frozenset[str]
    """All frames that a transform has named."""
    stamp: float
    """[s]"""
    clamped: bool = False
    """Whether a pose before the first or after the last transform is that of the first or last."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to another process with what is known at the stamp, without all that was told."""
        near = {name: series.around(self.stamp) for name, series in self._series.items()}
        return TransformsAt, (near, self.frames, self.stamp, self.clamped)

    def nearest(self) -> "TransformsAt":
        """The same frames, with unknown poses as they were known nearest in time."""
        return replace(self, clamped=True)

    def parent_of(self, frame: str) -> Parent | None:
        """Give the parent of a frame and its pose there; None for one that no transform places.

        Raises:
            FrameError: the stamp lies outside the time for which transforms tell of the frame.
        """
        series = self._series.get(frame)
        if series is None:
            return None
        first, last = series.stamps[0], series.stamps[-1]
        stamp = min(max(self.stamp, first), last)
        if not series.static and not self.clamped and stamp != self.stamp:
            raise FrameError(
                f"the transform of '{frame}' in '{series.parent}' is not known at "
                f"{self.stamp:.3f} s: there is one from {first:.3f} to {last:.3f} s"
            )
        return series.parent, series.pose(stamp)


def _between(before: Transform, after: Transform, stamp: float) -> Pose:
    part = (stamp - before.stamp) / (after.stamp - before.stamp)
    if part == 0.0:
        return _pose(before)
    place = (1.0 - part) * before.position + part * after.position
    turn = _slerp(before.orientation.tolist(), after.orientation.tolist(), part)
    return pose_of(place, _matrix(turn))


def _pose(transform: Transform) -> Pose:
    return pose_of(transform.position, _matrix(transform.orientation.tolist()))


def _slerp(one: Quaternion, other: Quaternion, part: float) -> Quaternion:
    """Turn from one unit quaternion to another by the shorter arc (K. Shoemake 1985)."""
    cosine = sum(a * b for a, b in zip(one, other, strict=True))
    sign = -1.0 if cosine < 0.0 else 1.0
    if abs(cosine) > NEARLY_ALONG:
        before, after = 1.0 - part, sign * part
    else:
        angle = math.acos(abs(cosine))
        before = math.sin((1.0 - part) * angle) / math.sin(angle)
        after = sign * math.sin(part * angle) / math.sin(angle)
    return [before * a + after * b for a, b in zip(one, other, strict=True)]


def _matrix(turn: Quaternion) -> Pose:
    """Give the rotation, shape (3, 3), of a quaternion (x, y, z, w) of any length."""
    x, y, z, w = turn
    s = 2.0 / (x * x + y * y + z * z + w * w)
    return np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)],
        ]
    )
