"""What the robot's own readings tell about its state at any recent stamp."""

from collections import deque
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from contactfusion.frames import Pose, pose_of
from contactfusion.readings import JointState, Odometry, Reading

R = TypeVar("R", bound=Reading)
LENGTH = 4096
"""So many readings of joints and odometry are remembered."""


class History:
    """Remembers joints and odometry, and interpolates them; never extrapolates.

    A stamp before the oldest or after the newest reading gets that reading.
    """

    def __init__(self) -> None:
        self._joints: deque[JointState] = deque(maxlen=LENGTH)
        self._odometry: deque[Odometry] = deque(maxlen=LENGTH)

    def add(self, reading: Reading) -> None:
        """Remember a reading, unless it is older than the newest of its type."""
        if isinstance(reading, JointState):
            _append(self._joints, reading)
        elif isinstance(reading, Odometry):
            _append(self._odometry, reading)

    def clear(self) -> None:
        """Forget all readings."""
        self._joints.clear()
        self._odometry.clear()

    def joints(self, stamp: float) -> JointState | None:
        """Give the joints at a stamp [s]: positions in between, the rest of the nearer reading."""
        around = _around(self._joints, stamp)
        if around is None:
            return None
        before, after, part = around
        nearer = before if part < 0.5 else after
        if before.names != after.names:
            return nearer
        positions = (1.0 - part) * before.positions + part * after.positions
        return JointState(
            stamp=stamp,
            frame=nearer.frame,
            sensor=nearer.sensor,
            names=nearer.names,
            positions=positions,
            velocities=nearer.velocities,
            efforts=nearer.efforts,
        )

    def base_pose(self, stamp: float) -> tuple[str, str, Pose] | None:
        """Give (parent frame, child frame, pose) of the base at a stamp [s]."""
        around = _around(self._odometry, stamp)
        if around is None:
            return None
        before, after, part = around
        if (before.frame, before.child_frame) != (after.frame, after.child_frame):
            before = after = before if part < 0.5 else after
        if part == 0.0:
            turn = Rotation.from_quat(before.orientation)
            return before.frame, before.child_frame, pose_of(before.position, turn.as_matrix())
        position = (1.0 - part) * before.position + part * after.position
        turns = Rotation.from_quat(np.stack([before.orientation, after.orientation]))
        pose = pose_of(position, Slerp([0.0, 1.0], turns)(part).as_matrix())
        return after.frame, after.child_frame, pose


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
