"""What the robot's own readings tell about its state at any recent stamp."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, pose_of
from contactfusion.readings import JointState, Odometry, Reading, Twist

R = TypeVar("R", bound=Reading)
LENGTH = 4096
"""So many readings of joints and odometry are remembered."""


class History:
    """Remembers joints, odometry and twists of the base, and interpolates; never extrapolates.

    A stamp before the oldest or after the newest reading gets that reading. Twists go on where
    odometry falls silent: the base has gone as they say since its last reading.
    """

    def __init__(self) -> None:
        self._joints: dict[tuple[str, ...], deque[JointState]] = {}
        self._odometry: deque[Odometry] = deque(maxlen=LENGTH)
        self._gone: deque[tuple[float, Pose]] = deque(maxlen=LENGTH)

    def add(self, reading: Reading) -> None:
        """Remember a reading, unless it is older than the newest of its type."""
        if isinstance(reading, JointState):
            _append(self._joints.setdefault(reading.names, deque(maxlen=LENGTH)), reading)
        elif isinstance(reading, Odometry):
            _append(self._odometry, reading)
            if self._odometry[-1] is reading:
                self._gone.clear()
        elif isinstance(reading, Twist):
            self._go_on(reading)

    def clear(self) -> None:
        """Forget all readings."""
        self._joints.clear()
        self._odometry.clear()
        self._gone.clear()

    def joints(self, stamp: float) -> JointState | None:
        """Give the joints at a stamp [s]: positions in between, the rest of the nearer reading.

        Readings of different joints, as of an arm and of its hand, are put together; of a joint
        that several name, the one that was heard of first counts. The stamp is that of the newest
        reading where it is older, and of several the oldest: so one knows who has fallen silent.
        """
        parts = [_between(readings, stamp) for readings in self._joints.values()]
        return _together(parts) if parts else None

    def base_pose(self, stamp: float) -> tuple[str, str, Pose] | None:
        """Give (parent frame, child frame, pose) of the base at a stamp [s].

        After the newest odometry it is moved on by the twists of its frame that came since; each
        held since the one before it.
        """
        around = _around(self._odometry, stamp)
        if around is None:
            return None
        before, after, part = around
        if (before.frame, before.child_frame) != (after.frame, after.child_frame):
            before = after = before if part < 0.5 else after
        if part == 0.0:
            gone = self._gone if before is self._odometry[-1] else ()
            pose = next((pose for when, pose in reversed(gone) if when <= stamp), None)
            return before.frame, before.child_frame, before.pose if pose is None else pose
        position = (1.0 - part) * before.position + part * after.position
        turns = Rotation.from_quat(np.stack([before.orientation, after.orientation]))
        pose = pose_of(position, Slerp([0.0, 1.0], turns)(part).as_matrix())
        return after.frame, after.child_frame, pose

    def _go_on(self, twist: Twist) -> None:
        """Move the base on from where it was last, by a twist that has held since."""
        if not self._odometry or twist.frame != self._odometry[-1].child_frame:
            return
        last = self._odometry[-1]
        before, pose = self._gone[-1] if self._gone else (last.stamp, last.pose)
        period = twist.stamp - before
        if period > 0.0:
            turns = np.outer((1.0, 0.5), period * twist.angular)
            turn, half = Rotation.from_rotvec(turns).as_matrix()
            pose = pose @ pose_of(half @ (period * twist.linear), turn)
            self._gone.append((twist.stamp, pose))


def _between(readings: deque[JointState], stamp: float) -> JointState:
    """Give one set of joints at a stamp."""
    around = _around(readings, stamp)
    assert around is not None
    before, after, part = around
    nearer = before if part < 0.5 else after
    positions = (1.0 - part) * before.positions + part * after.positions
    return replace(nearer, stamp=min(stamp, readings[-1].stamp), positions=positions)


def _together(parts: Sequence[JointState]) -> JointState:
    """Put several sets of joints together; what not all of them tell is left out."""
    if len(parts) == 1:
        return parts[0]
    first = parts[0]
    names = tuple(dict.fromkeys(name for part in parts for name in part.names))
    chosen: dict[str, tuple[JointState, int]] = {}
    for part in reversed(parts):
        chosen |= {name: (part, row) for row, name in enumerate(part.names)}

    def column(field: str) -> FloatArray:
        return np.array([getattr(part, field)[row] for part, row in map(chosen.__getitem__, names)])

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


def _append(readings: deque[R], reading: R) -> None:
    if not readings or reading.stamp >= readings[-1].stamp:
        readings.append(reading)


def _around(readings: deque[R], stamp: float) -> tuple[R, R, float] | None:
    """Give the readings before and after a stamp, and where it lies between them."""
    if not readings:
        return None
    after = readings[-1]
    for before in reversed(readings):
        if before.stamp <= stamp:
            span = after.stamp - before.stamp
            return before, after, min((stamp - before.stamp) / span, 1.0) if span > 0 else 0.0
        after = before
    return after, after, 0.0
