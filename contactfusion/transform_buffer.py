"""Transforms of frames over time, interpolated between their stamps."""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, final

import numpy as np

from contactfusion.errors import FrameError, RecordingError
from contactfusion.frames import Parent, Pose, pose_of
from contactfusion.readings import Reading, Transform

LENGTH = 4096
"""So many readings of joints and odometry are remembered, and at least so many poses of a frame."""
MOST_FRAMES = 2000
"""So many frames are remembered: a name for each object that is seen makes new ones for ever."""
NEARLY_ALONG = 0.9995
"""From which cosine between two quaternions on a straight line stands for the arc."""
AHEAD = 1.0
"""Transforms of a recording come so much earlier than what needs them [s]: they are published late
and seldom."""
JUMP, PERIODS = 0.25, 3.0
"""Readings that lie so far ahead, and so many times the period before them, while a later one goes
on from there, are of another clock [s]."""
Quaternion = Sequence[float]


@dataclass
class _Series:
    """The poses of one frame in one parent, by rising stamps."""

    parent: str
    static: bool
    stamps: list[float] = field(default_factory=list)
    transforms: list[Transform] = field(default_factory=list)

    def add(self, transform: Transform) -> None:
        """Store a transform, unless one is as new."""
        if self.stamps and transform.stamp <= self.stamps[-1]:
            return
        self.stamps.append(transform.stamp)
        self.transforms.append(transform)
        if len(self.stamps) >= 2 * LENGTH:
            del self.stamps[:LENGTH], self.transforms[:LENGTH]

    def drop_astray(self, stamp: float) -> float | None:
        """Drop what a transform at a stamp [s] shows to be of another clock, as `drop` does."""
        if self.static or not count_astray(reversed(self.stamps), stamp):
            return None
        return self.drop(stamp)

    def drop(self, limit: float) -> float | None:
        """Drop what is newer than a limit [s]; the newest stamp, or None where nothing is."""
        newest = self.stamps[-1] if self.stamps else -math.inf
        if self.static or newest <= limit:
            return None
        first = bisect_right(self.stamps, limit)
        del self.stamps[first:], self.transforms[first:]
        return newest

    def around(self, stamp: float) -> "_Series":
        """The first and the last pose, and the two next to a stamp: no other counts then."""
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
        """The pose at a stamp that lies between the first and the last."""
        if self.static:
            return _pose_there(self.transforms[-1])
        after = bisect_right(self.stamps, stamp)
        if after == len(self.stamps):
            return _pose_there(self.transforms[-1])
        return _pose_between(self.transforms[after - 1], self.transforms[after], stamp)


@final
class TransformBuffer:
    """Transform buffer; between two transforms a frame moves evenly, as in ROS (tf2).

    Positions are interpolated linearly, rotations by the shortest arc. (pytransform3d has screws,
    which end at the same poses by another path.)
    """

    def __init__(self) -> None:
        self._series: dict[str, _Series] = {}
        self._frames: frozenset[str] = frozenset()
        self._limit = math.inf
        self._left_out: dict[str, float] = {}
        self._parents: dict[str, dict[str, None]] = {}
        """The parents of each frame that ever had another."""
        self.disputed = ""
        """A sentence on a frame that several publishers place, each under its own parent."""

    def add(self, transform: Transform) -> None:
        """Store a transform, unless one of the frame is as new.

        A frame that gets another parent has only that parent from then on.
        """
        series = self._series.get(transform.child_frame)
        if series is None or (series.parent, series.static) != (transform.frame, transform.static):
            if series is not None and series.parent != transform.frame:
                self._dispute(transform, series)
            series = self._series[transform.child_frame] = _Series(
                transform.frame, transform.static
            )
            if len(self._series) > MOST_FRAMES:
                self._evict(transform.child_frame)
            self._name()
        if series.static:  # published again; the newest holds
            series.stamps.clear()
            series.transforms.clear()
        if transform.stamp <= self._limit:
            self._drop(transform.child_frame, series)
        if (newest := series.drop_astray(transform.stamp)) is not None:
            self._left_out[f"the transform of '{transform.child_frame}'"] = newest
        series.add(transform)

    def leave_out(self, limit: float) -> Mapping[str, float]:
        """Drop what is newer than a limit [s]; what was dropped since the last call, by name."""
        self._limit = limit
        for frame, series in self._series.items():
            self._drop(frame, series)
        if not all(series.stamps for series in self._series.values()):
            self._series = {frame: each for frame, each in self._series.items() if each.stamps}
            self._name()
        left_out, self._left_out = self._left_out, {}
        return left_out

    def clear(self) -> None:
        """Forget all transforms."""
        self._series.clear()
        self._frames = frozenset()
        self._limit = math.inf
        self._left_out.clear()
        self._parents.clear()
        self.disputed = ""

    def _dispute(self, transform: Transform, series: _Series) -> None:
        """Take note of another parent, unless a frame is handed over once, as by a grasp."""
        frame, parent = transform.child_frame, transform.frame
        if len(self._parents) > MOST_FRAMES:
            self._parents.clear()
        known = self._parents.setdefault(frame, {series.parent: None})
        if parent in known or series.static or transform.static:
            self.disputed = self.disputed or (
                f"the frame '{frame}' is placed in '{series.parent}' and in '{parent}', by turns: "
                "the last one counts"
            )
        elif len(known) < MOST_FRAMES:
            known[parent] = None

    def _evict(self, kept: str) -> None:
        """Forget the frame that has moved least lately, but for one; fixed ones only if all are."""
        known = [(each.static, each.stamps[-1], name) for name, each in self._series.items()
                 if name != kept and each.stamps]  # fmt: skip
        if known:
            del self._series[min(known)[-1]]

    def _drop(self, frame: str, series: _Series) -> None:
        """Drop what is newer than the limit."""
        newest = series.drop(self._limit)
        if newest is not None:
            self._left_out[f"the transform of '{frame}'"] = newest

    def _name(self) -> None:
        """Take note of all frames that a transform names."""
        parents = {known.parent for known in self._series.values()}
        self._frames = frozenset(self._series) | parents

    @property
    def static(self) -> dict[str, Parent]:
        """The parent of each frame that is fixed in it, and the frame's pose there."""
        return {
            frame: (series.parent, _pose_there(series.transforms[-1]))
            for frame, series in self._series.items()
            if series.static
        }

    def at(self, stamp: float, lag: float = 0.0) -> "TransformsAt | None":
        """The frames at a stamp [s]; None while there are none.

        Args:
            stamp: [s].
            lag: so long before the stamp the newest transform of a frame may be [s].
        """
        return TransformsAt(self._series, self._frames, stamp, lag=lag) if self._series else None


def transforms_ahead(readings: Iterable[Reading]) -> Iterator[Reading]:
    """Readings of a recording, its transforms a second before the other readings of their time.

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
    lag: float = 0.0
    """So long after the last transform its pose holds [s]."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the transforms that are next to the stamp, without the rest of the buffer."""
        near = {name: series.around(self.stamp) for name, series in self._series.items()}
        return TransformsAt, (near, self.frames, self.stamp, self.clamped, self.lag)

    def nearest(self) -> "TransformsAt":
        """The same frames, with unknown poses as they were known nearest in time."""
        return replace(self, clamped=True)

    def parent_of(self, frame: str) -> Parent | None:
        """The parent of a frame and its pose there; None for one that no transform places.

        Raises:
            FrameError: the stamp lies outside the time span of the frame's transforms.
        """
        series = self._series.get(frame)
        if series is None:
            return None
        first, last = series.stamps[0], series.stamps[-1]
        stamp = min(max(self.stamp, first), last)
        held = self.clamped or 0.0 <= self.stamp - stamp <= self.lag
        if not series.static and not held and stamp != self.stamp:
            raise FrameError(
                f"the transform of '{frame}' in '{series.parent}' is not known at "
                f"{self.stamp:.3f} s: there is one from {first:.3f} to {last:.3f} s"
            )
        return series.parent, series.pose(stamp)


def _pose_between(before: Transform, after: Transform, stamp: float) -> Pose:
    part = (stamp - before.stamp) / (after.stamp - before.stamp)
    if part == 0.0:
        return _pose_there(before)
    position = (1.0 - part) * before.position + part * after.position
    rotation = _slerp(before.orientation.tolist(), after.orientation.tolist(), part)
    return pose_of(position, _matrix(rotation))


def _pose_there(transform: Transform) -> Pose:
    return pose_of(transform.position, _matrix(transform.orientation.tolist()))


def _slerp(first: Quaternion, second: Quaternion, part: float) -> Quaternion:
    """Spherical interpolation of unit quaternions by the shorter arc (K. Shoemake 1985)."""
    cosine = sum(a * b for a, b in zip(first, second, strict=True))
    sign = -1.0 if cosine < 0.0 else 1.0
    if abs(cosine) > NEARLY_ALONG:
        before, after = 1.0 - part, sign * part
    else:
        angle = math.acos(abs(cosine))
        before = math.sin((1.0 - part) * angle) / math.sin(angle)
        after = sign * math.sin(part * angle) / math.sin(angle)
    return [before * a + after * b for a, b in zip(first, second, strict=True)]


def _matrix(quaternion: Quaternion) -> Pose:
    """The rotation, shape (3, 3), of a quaternion (x, y, z, w) of any length."""
    x, y, z, w = quaternion
    s = 2.0 / (x * x + y * y + z * z + w * w)
    return np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)],
        ]
    )


def count_astray(newest: Iterable[float], stamp: float) -> int:
    """Return how many readings lie beyond a leap that a later reading does not take part in.

    Args:
        newest: stamps of the readings before it, the newest first [s].
        stamp: of the later reading [s].
    """
    count, nearest, stamps = 0, stamp, iter(newest)
    for known in stamps:
        if known <= stamp:
            period = known - next(stamps, -math.inf)
            return count if nearest - stamp > max(JUMP, PERIODS * period) else 0
        count, nearest = count + 1, known
    return 0
