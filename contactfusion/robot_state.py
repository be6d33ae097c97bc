"""Robot state at a stamp: joints, base pose, frames and surface, from the readings so far."""

import functools
import math
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar, final

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from contactfusion.arrays import FloatArray
from contactfusion.errors import FrameError, RecordingError, RobotError
from contactfusion.frames import FrameTree, Parent, Pose, apart, pose_of
from contactfusion.grid import Grid
from contactfusion.integrator.fusion import Fusion
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import JointState, Odometry, Reading, Transform, Twist
from contactfusion.state import State
from contactfusion.surface import Surface

if TYPE_CHECKING:
    from contactfusion.robots.model import RobotModel
    from contactfusion.robots.posed import PosedRobot

SAME = 1e-3, 0.01
"""Poses of a link that lie, and are turned, by no more than this apart are the same [m, rad]."""
R = TypeVar("R", bound=Reading)
TURN = np.pi + 1e-3
"""Positions of a joint that is reported within one turn [rad]."""
LENGTH = 4096
"""So many readings of joints and odometry are remembered, and at least so many poses of a frame."""
MOST_FRAMES, MOST_SETS = 2000, 500
"""So many frames of transforms, and sets of joints, are remembered: a name for each object that is
seen makes new ones for ever."""
NEARLY_ALONG = 0.9995
"""From which cosine between two quaternions on a straight line stands for the arc."""
AHEAD = 1.0
"""Transforms of a recording come so much earlier than what needs them [s]: they are published late
and seldom."""
JUMP, PERIODS = 0.25, 3.0
"""Readings that lie so far ahead, and so many times the period before them, while a later one goes
on from there, are of another clock [s]."""
Quaternion = Sequence[float]
BasePose = tuple[str, str, Pose]
"""Parent frame, child frame, and the pose of the child in the parent."""
STAMPS = 16
"""The frames at so many stamps are kept: those of late clouds, beside those of the last state."""


class Robot:
    """Buffer of the robot's own readings, from which comes its state at a stamp.

    Args:
        config: its frames and its surface.
        grid: the frame and voxel size of the hypothesis space.
    """

    def __init__(self, config: PipelineConfig, grid: Grid) -> None:
        self._grid = grid
        self._fixed = config.frame_tree()
        self._body = config.surface.sampled(config.folder) if config.surface else None
        self.model = _model(config)
        """The robot of the URDF, or None."""
        if self.model is not None:  # what hangs on another link may stand far away in the world
            moved = self.model.moved_links
            self.model.require_mounted(
                {name: frame for name, frame in config.frames.items() if frame.parent in moved}
            )
        self._states = StateBuffer()
        self._transforms = TransformBuffer()
        self._known: State | None = None
        self._stray = ""
        self._placed_at = functools.lru_cache(STAMPS)(self._places)
        """Joints, base pose and frames at a stamp, until the next reading of the robot."""
        self._frames = self._fixed
        """The frames of the last lookup."""

    @property
    def misplaced(self) -> str:
        """A sentence on what stands elsewhere than the URDF says, or nothing.

        It is a frame with several parents, a joint far beyond its limits, or else the links that
        /tf_static places elsewhere. A link that a joint moves is where it was at the last lookup of
        frames.
        """
        differing = dict(self._differing())
        if self._transforms.disputed or self._stray or not differing:
            return self._transforms.disputed or self._stray
        (link, by), *others = differing.items()
        likewise = f"; likewise {', '.join(name for name, _ in others)}" if others else ""
        return (
            f"{link}: the URDF and /tf_static place it differently, {by}; the URDF counts{likewise}"
        )

    def add(self, reading: Reading) -> None:
        """Store joints, odometry, a twist or a transform; other readings are ignored."""
        if isinstance(reading, Transform):
            self._transforms.add(reading)
        elif isinstance(reading, JointState | Odometry | Twist):
            if isinstance(reading, JointState) and self.model and not self._stray:
                self._stray = self.model.stray(reading)
            self._states.add(reading)
        else:
            return
        self._forget()

    def leave_out(self, limit: float) -> Iterator[tuple[str, float]]:
        """Drop what is newer than a step can know: it is of another clock, and hides what is not.

        Args:
            limit: the newest stamp that counts, now and until the next call [s].

        Yields:
            What was dropped since the last call, and its newest stamp [s].
        """
        left_out = {**self._states.leave_out(limit), **self._transforms.leave_out(limit)}
        if left_out:
            self._forget()
            yield from left_out.items()

    def clear(self) -> None:
        """Forget all readings."""
        self._states.clear()
        self._transforms.clear()
        self._forget()

    def state(self, stamp: float, fusion: Fusion | None, lag: float = 0.0) -> State:
        """Robot state at a stamp [s], with the last step of the integrator.

        Args:
            stamp: [s].
            fusion: that step.
            lag: so long before the stamp the newest transforms may be [s].
        """
        known = self._known
        if known is None or known.now != stamp or lag:
            known = self._known = self._at(stamp, lag)
        self._frames = known.frames
        return known if known.fusion is fusion else replace(known, fusion=fusion)

    def frames(self, stamp: float) -> FrameTree:
        """The poses of all frames at a stamp [s]; unlike `state` it moves no surface."""
        _, _, self._frames = self._placed_at(stamp, 0.0)
        return self._frames

    def _forget(self) -> None:
        """Drop the states that were computed before a reading."""
        self._known = None
        self._placed_at.cache_clear()

    def _differing(self) -> Iterator[tuple[str, str]]:
        """Each link that /tf_static places elsewhere than the URDF, and by how much."""
        links = self.model.link_names if self.model else ()
        for link, (parent, static) in self._transforms.static.items():
            if parent not in links or link not in links:
                continue
            try:
                distance, angle = apart(self._frames.pose(parent, of=link), static)
            except FrameError:  # a joint that has not been reported lies between the two
                continue
            if distance > SAME[0] or angle > SAME[1]:
                yield link, f"{distance:.3g} m and {angle:.3g} rad apart"

    @property
    def roots(self) -> tuple[str, ...]:
        """The frame of the robot, or of the surface, if any."""
        if self.model is not None:
            return (self.model.root,)
        return () if self._body is None else (self._body.frame,)

    def _places(
        self, stamp: float, lag: float
    ) -> tuple[JointState | None, BasePose | None, FrameTree]:
        frames, joints = self._fixed, self._states.joints(stamp)
        if transforms := self._transforms.at(stamp, lag):
            frames = frames.under(transforms)
        base = self._states.base_pose(stamp)
        if base:
            parent, child, pose = base
            frames = frames.extended({child: (parent, pose)})
        if self.model is not None:
            positions, unknown = self.model.known_positions(joints)
            frames = frames.extended(self.model.frames_at(positions, unknown))
        return joints, base, frames

    def _at(self, stamp: float, lag: float) -> State:
        joints, base, frames = self._placed_at(stamp, lag)
        robot, surface, unplaced = None, None, ""
        try:
            if self.model is not None:
                robot = self._posed(self.model, self.model.positions(joints), frames)
            elif self._body is not None:
                surface = self._placed(self._body, frames)
        except (RobotError, FrameError) as error:
            unplaced = str(error)
        return State(
            now=stamp,
            grid=self._grid,
            frames=frames,
            joints=joints,
            base_pose=base[2] if base else None,
            surface=robot.surface if robot else surface,
            robot=robot,
            unplaced=unplaced,
        )

    def _posed(self, model: "RobotModel", positions: FloatArray, frames: FrameTree) -> "PosedRobot":
        from contactfusion.robots.posed import PosedRobot

        return PosedRobot(
            model, positions, self._grid.frame, self._pose("robot", model.root, frames)
        )

    def _placed(self, body: Surface, frames: FrameTree) -> Surface:
        if body.frame == self._grid.frame:
            return body
        return body.moved(self._pose("surface", body.frame, frames), self._grid.frame)

    def _pose(self, whose: str, frame: str, frames: FrameTree) -> Pose:
        """The pose of a frame in that of the space.

        Raises:
            FrameError: nothing joins the two.
        """
        try:
            return frames.pose(self._grid.frame, of=frame)
        except FrameError as error:
            raise FrameError(
                f"no transform joins the {whose}'s frame '{frame}' to the space: {error}"
            ) from None


def _model(config: PipelineConfig) -> "RobotModel | None":
    if config.robot is None:
        return None
    from contactfusion.robots.model import shared_robot

    return shared_robot(config.robot)


class StateBuffer:
    """State buffer: joints, odometry and twists of the base, interpolated, never extrapolated.

    A stamp before the oldest or after the newest reading gets that reading. After
    the last odometry the pose of the base is integrated from twists.
    """

    def __init__(self) -> None:
        self._joints: dict[tuple[str, ...], deque[JointState]] = {}
        self._odometry: deque[Odometry] = deque(maxlen=LENGTH)
        self._integrated: deque[tuple[float, Pose]] = deque(maxlen=LENGTH)
        self._limit = math.inf
        self._left_out: dict[str, float] = {}

    def add(self, reading: Reading) -> None:
        """Store a reading, unless it is older than the newest of its type."""
        if isinstance(reading, JointState):
            self._append(self._joints.setdefault(reading.names, deque(maxlen=LENGTH)), reading)
            if len(self._joints) > MOST_SETS:
                others = self._joints.keys() - {reading.names}
                del self._joints[min(others, key=lambda names: self._joints[names][-1].stamp)]
        elif isinstance(reading, Odometry):
            self._append(self._odometry, reading)
            if self._odometry[-1] is reading:
                self._integrated.clear()
        elif isinstance(reading, Twist):
            self._integrate(reading)

    def leave_out(self, limit: float) -> Mapping[str, float]:
        """Drop what is newer than a limit [s]; what was dropped since the last call, as `Robot`."""
        self._limit = limit
        self._drop(self._odometry)
        for readings in self._joints.values():
            self._drop(readings)
        self._drop_integrated()
        self._joints = {names: readings for names, readings in self._joints.items() if readings}
        left_out, self._left_out = self._left_out, {}
        return left_out

    def clear(self) -> None:
        """Forget all readings."""
        self._joints.clear()
        self._odometry.clear()
        self._integrated.clear()
        self._limit = math.inf
        self._left_out.clear()

    def _append(self, readings: deque[R], reading: R) -> None:
        if reading.stamp <= self._limit:
            self._drop(readings)
        for _ in range(_astray((each.stamp for each in reversed(readings)), reading.stamp)):
            self._leave_out(readings.pop())
        if not readings or reading.stamp >= readings[-1].stamp:
            readings.append(reading)

    def _drop_integrated(self) -> None:
        """Drop the poses by twists that are newer than the limit."""
        while self._integrated and self._integrated[-1][0] > self._limit:
            self._left_out.setdefault(Twist.__name__, self._integrated.pop()[0])

    def _drop(self, readings: deque[R]) -> None:
        """Drop what is newer than the limit."""
        while readings and readings[-1].stamp > self._limit:
            self._leave_out(readings.pop())

    def _leave_out(self, reading: Reading) -> None:
        self._left_out.setdefault(reading.label, reading.stamp)

    def joints(self, stamp: float) -> JointState | None:
        """The joints at a stamp [s]: positions in between, the rest of the nearer reading.

        Readings of different joints, as of an arm and of its hand, are put together; of a joint
        that several name, the set with the newest reading counts, the first of several. The stamp
        is that of the newest reading where it is older, and of several sets the oldest: it shows
        that a sensor is silent.
        """
        parts = [_joints_between(readings, stamp) for readings in self._joints.values()]
        return _together(parts) if parts else None

    def base_pose(self, stamp: float) -> BasePose | None:
        """Parent frame, child frame and pose of the base at a stamp [s].

        After the newest odometry it is integrated from the twists of its frame that came since;
        each holds from the twist before it.
        """
        around = _around(self._odometry, stamp)
        if around is None:
            return None
        before, after, part = around
        if (before.frame, before.child_frame) != (after.frame, after.child_frame):
            before = after = before if part < 0.5 else after
        if part == 0.0:
            integrated = self._integrated if before is self._odometry[-1] else ()
            pose = next((pose for when, pose in reversed(integrated) if when <= stamp), None)
            return before.frame, before.child_frame, before.pose if pose is None else pose
        position = (1.0 - part) * before.position + part * after.position
        ends = Rotation.from_quat(np.stack([before.orientation, after.orientation]))
        pose = pose_of(position, Slerp([0.0, 1.0], ends)(part).as_matrix())
        return after.frame, after.child_frame, pose

    def _integrate(self, twist: Twist) -> None:
        """Integrate the pose of the base by a twist that has held since its last pose."""
        if not self._odometry or twist.frame != self._odometry[-1].child_frame:
            return
        if twist.stamp <= self._limit:
            self._drop_integrated()
        last = self._odometry[-1]
        before, pose = self._integrated[-1] if self._integrated else (last.stamp, last.pose)
        period = twist.stamp - before
        if period > 0.0:
            vectors = np.outer((1.0, 0.5), period * twist.angular)
            rotation, half = Rotation.from_rotvec(vectors).as_matrix()
            pose = pose @ pose_of(half @ (period * twist.linear), rotation)
            self._integrated.append((twist.stamp, pose))


def _joints_between(readings: deque[JointState], stamp: float) -> JointState:
    """One set of joints at a stamp."""
    around = _around(readings, stamp)
    assert around is not None
    before, after, part = around
    nearer = before if part < 0.5 else after
    positions = (1.0 - part) * before.positions + part * after.positions
    ends = np.stack([before.positions, after.positions])
    # a turning joint passes ±π, and is not half a turn away in between
    leaps = (np.abs(np.diff(ends, axis=0)[0]) > np.pi) & (np.abs(ends) <= TURN).all(axis=0)
    positions[leaps] = nearer.positions[leaps]
    return replace(nearer, stamp=min(stamp, readings[-1].stamp), positions=positions)


def _together(parts: Sequence[JointState]) -> JointState:
    """Several sets of joints as one; a field that one of them lacks is left out."""
    if len(parts) == 1:
        return parts[0]
    first = parts[0]
    names = tuple(dict.fromkeys(name for part in parts for name in part.names))
    chosen: dict[str, tuple[JointState, int]] = {}
    for part in sorted(reversed(parts), key=lambda part: part.stamp):
        chosen |= {name: (part, row) for row, name in enumerate(part.names)}

    def column(field: str) -> FloatArray:
        return np.array([getattr(part, field)[row] for part, row in map(chosen.__getitem__, names)])

    # a set is spent once newer ones hold all of its joints
    parts = [part for part in parts if any(chosen[name][0] is part for name in part.names)]
    optional = {
        field: column(field)
        for field in ("velocities", "efforts")
        if all(getattr(part, field) is not None for part in parts)
    }
    return JointState(
        stamp=min(part.stamp for part in parts),
        frame=first.frame,
        sensor=first.sensor,
        names=names,
        positions=column("positions"),
        **optional,
    )


def _around(readings: deque[R], stamp: float) -> tuple[R, R, float] | None:
    """The readings before and after a stamp, and where it lies between them."""
    if not readings:
        return None
    after = readings[-1]
    for before in reversed(readings):
        if before.stamp <= stamp:
            span = after.stamp - before.stamp
            return before, after, min((stamp - before.stamp) / span, 1.0) if span > 0 else 0.0
        after = before
    return after, after, 0.0


def _astray(newest: Iterable[float], stamp: float) -> int:
    """How many readings lie beyond a leap that a later reading does not take part in.

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
        if self.static or not _astray(reversed(self.stamps), stamp):
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
        """Drop what is newer than a limit [s]; what was dropped since the last call, as `Robot`."""
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
