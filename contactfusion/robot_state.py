"""Robot state at a stamp: joints, base pose, frames and surface, from the readings so far."""

import functools
import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from contactfusion.arrays import FloatArray
from contactfusion.errors import FrameError, RobotError
from contactfusion.frames import FrameTree, Pose, apart, pose_of
from contactfusion.grid import Grid
from contactfusion.integrator.fusion import Fusion
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import JointState, Odometry, Reading, Transform, Twist
from contactfusion.state import State
from contactfusion.surface import Surface
from contactfusion.transform_buffer import LENGTH, TransformBuffer, count_astray

if TYPE_CHECKING:
    from contactfusion.robots.model import RobotModel
    from contactfusion.robots.posed import PosedRobot

SAME = 1e-3, 0.01
"""Poses of a link that lie, and are turned, by no more than this apart are the same [m, rad]."""
R = TypeVar("R", bound=Reading)
MOST_SETS = 500
"""So many sets of joints are remembered."""
TURN = np.pi + 1e-3
"""Positions of a joint that is reported within one turn [rad]."""
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
        self._stray = self._left_out = ""
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
        self._stray = self._left_out = ""
        self._frames = self._fixed
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
        frames, joints, self._left_out = self._fixed, self._states.joints(stamp), ""
        if transforms := self._transforms.at(stamp, lag):
            frames = frames.under(transforms)
        base = self._states.base_pose(stamp)
        if base:
            parent, child, pose = base
            try:
                frames = frames.extended({child: (parent, pose)})
            except FrameError as error:  # the configuration places the parent on the base
                base, self._left_out = None, f"the odometry of '{child}' is left out: {error}"
        if self.model is not None:
            positions, unknown = self.model.known_positions(joints)
            frames = frames.extended(self.model.frames_at(positions, unknown))
        return joints, base, frames

    def _at(self, stamp: float, lag: float) -> State:
        joints, base, frames = self._placed_at(stamp, lag)
        robot, surface, unplaced = None, None, self._left_out
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

    model = shared_robot(config.robot)
    if model.solids:  # takes seconds, for which the first reading of a running robot can't wait
        _ = model.parts
    return model


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
        for _ in range(count_astray((each.stamp for each in reversed(readings)), reading.stamp)):
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
