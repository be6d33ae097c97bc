"""Poses: of a base by its odometry, of frames as /tf reports them, of objects."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import InvalidReadingError
from contactfusion.frames import Pose, pose_of
from contactfusion.readings.canvas import Canvas
from contactfusion.readings.codec import Codec, Role
from contactfusion.readings.columns import ColumnsConfig
from contactfusion.readings.messages import (
    Message,
    Posting,
    header,
    known,
    message,
    quaternion,
    twist,
    vector,
    xyz,
    xyzw,
)
from contactfusion.readings.messages import pose as pose_message
from contactfusion.readings.reading import At, Reading
from contactfusion.readings.values import Elements, Values

TRANSFORMS = "tf2_msgs/msg/TFMessage"
MOVING, STATIC = "tf", "tf_static"
"""The topics of ROS for the poses of frames: of those that move, and of those that never do."""
NO_TURN = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedReading(Reading):
    """A pose in `frame`.

    Attributes:
        position: shape (3,) [m], of the origin of what stands there.
        orientation: shape (4,), unit quaternion (x, y, z, w), from there to `frame`.
    """

    position: FloatArray
    orientation: FloatArray

    def _check(self) -> None:
        self._freeze("position", 3)
        self._freeze_turn()

    @cached_property
    def pose(self) -> Pose:
        """The pose of what stands there, in `frame`."""
        from scipy.spatial.transform import Rotation

        return pose_of(self.position, Rotation.from_quat(self.orientation).as_matrix())


P = TypeVar("P", bound=PosedReading)


@dataclass(frozen=True, kw_only=True, eq=False)
class Odometry(PosedReading):
    """The pose of a moving frame in `frame`.

    Attributes:
        child_frame: the frame that moves, e.g. "base".
        position: shape (3,) [m], of the child frame's origin in `frame`.
        orientation: shape (4,), unit quaternion (x, y, z, w), child frame to `frame`.
        linear: shape (3,) [m/s] in the child frame, or None.
        angular: shape (3,) [rad/s] in the child frame, or None.
    """

    child_frame: str
    linear: FloatArray | None = None
    angular: FloatArray | None = None

    def _check(self) -> None:
        if self.child_frame == self.frame:
            raise InvalidReadingError(f"{self.label} gives the pose of '{self.frame}' in itself")
        super()._check()
        for name in ("linear", "angular"):
            if getattr(self, name) is not None:
                self._freeze(name, 3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Transform(PosedReading):
    """The pose of a frame in its parent `frame`, as /tf and /tf_static of ROS report it.

    Attributes:
        child_frame: the frame whose pose it is.
        position: shape (3,) [m], of the child frame's origin in `frame`.
        orientation: shape (4,), unit quaternion (x, y, z, w), child frame to `frame`.
        static: whether it holds at all times.
    """

    child_frame: str
    static: bool = False

    def _check(self) -> None:
        if not self.child_frame:
            raise InvalidReadingError(f"{self.label} needs the name of its child frame")
        if self.child_frame == self.frame:
            raise InvalidReadingError(f"{self.label} gives the pose of '{self.frame}' in itself")
        super()._check()


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectPose(PosedReading):
    """The believed pose of an object in `frame`.

    Attributes:
        name: the object.
        position: shape (3,) [m], of its origin.
        orientation: shape (4,), unit quaternion (x, y, z, w), object to `frame`.
    """

    name: str

    def _check(self) -> None:
        if not self.name:
            raise InvalidReadingError(f"{self.label} needs the name of its object")
        super()._check()


class PoseValues(Values[P]):
    """Position and orientation of a pose."""

    counts = (3, 6)
    meaning = "3 or 6 numbers: x, y, z [m], and a turn about x, y, z [rad]"

    def zeroed(self, reading: P) -> P:
        """The identity, as a quaternion of zeros is none."""
        return replace(reading, position=np.zeros(3), orientation=np.array(NO_TURN))

    def changes(self, reading: P, amount: Sequence[float], elements: Elements) -> FloatArray:
        """A shift and a rotation vector about the axes of the frame, shape (6,)."""
        numbers = np.array(amount, dtype=np.float64)
        return np.pad(numbers, (0, 6 - len(numbers)))

    def added(self, reading: P, change: FloatArray) -> P:
        """The pose, shifted and turned."""
        orientation = _turned(reading.orientation, change[3:])
        position = reading.position + change[:3]
        return replace(reading, position=position, orientation=orientation)

    def moved(self, reading: P, pose: Pose) -> P:
        """The pose, moved."""
        from scipy.spatial.transform import Rotation

        turn, shift = pose[:3, :3], pose[:3, 3]
        turned = Rotation.from_matrix(turn) * Rotation.from_quat(reading.orientation)
        return replace(
            reading, position=turn @ reading.position + shift, orientation=turned.as_quat()
        )


class OdometryValues(PoseValues[Odometry]):
    """A pose with velocities in its own frame, which stay when it is shifted or moved."""

    def zeroed(self, reading: Odometry) -> Odometry:
        """The identity at rest."""
        return replace(
            super().zeroed(reading),
            linear=None if reading.linear is None else np.zeros(3),
            angular=None if reading.angular is None else np.zeros(3),
        )


class OdometryColumns(ColumnsConfig):
    """Position x, y, z [m], quaternion x, y, z, w, then, if known, a twist as `TwistColumns`."""

    angles = "some"

    child_frame: str = Field(min_length=1)
    """The frame that moves, e.g. `base`."""

    def counts(self) -> tuple[int, ...]:
        """Seven, and thirteen with a twist."""
        return (7, 13)

    def reading(self, at: At, row: FloatArray) -> Odometry:
        """The pose, and the twist when there is one."""
        return Odometry(
            child_frame=self.child_frame,
            position=row[:3],
            orientation=row[3:7],
            linear=row[7:10] if row.size > 7 else None,
            angular=row[10:] if row.size > 7 else None,
            **at,
        )


class ObjectPoseColumns(ColumnsConfig):
    """Position x, y, z [m], then the unit quaternion x, y, z, w."""

    angles = "some"

    name: str = Field(min_length=1)
    """The object."""

    def counts(self) -> tuple[int, ...]:
        """Seven."""
        return (7,)

    def reading(self, at: At, row: FloatArray) -> ObjectPose:
        """The pose."""
        return ObjectPose(name=self.name, position=row[:3], orientation=row[3:], **at)


class OdometryCodec(Codec[Odometry]):
    """Pose and velocity of a base."""

    name = "odometry"
    kind = Odometry
    role = Role.CONTEXT
    alone = True
    use = "pose of the base"
    messages = ("nav_msgs/msg/Odometry",)
    Columns = OdometryColumns
    values = OdometryValues()

    def from_message(self, message: Message, at: At) -> Odometry:
        """The pose of a nav_msgs/Odometry."""
        pose, twist = message.pose.pose, message.twist.twist
        return Odometry(
            child_frame=message.child_frame_id.removeprefix("/"),
            position=xyz(pose.position),
            orientation=xyzw(pose.orientation),
            linear=known(xyz(twist.linear)),
            angular=known(xyz(twist.angular)),
            **at,
        )

    def to_message(self, reading: Odometry, top: Message) -> Message:
        """A nav_msgs/Odometry without covariances."""
        unknown = np.zeros(36)
        moving = twist(reading.linear, reading.angular)
        standing = pose_message(reading.position, reading.orientation)
        return self.message(
            header=top,
            child_frame_id=reading.child_frame,
            pose=message("geometry_msgs/PoseWithCovariance", pose=standing, covariance=unknown),
            twist=message("geometry_msgs/TwistWithCovariance", twist=moving, covariance=unknown),
        )

    def postings(self, reading: Odometry, topic: str, top: Message) -> Iterator[Posting]:
        """The message, and the pose of the child frame as a transform."""
        yield topic, self.to_message(reading, top)
        yield f"/{MOVING}", message("tf2_msgs/TFMessage", transforms=[_stamped(reading, top)])

    def whose(self, reading: Odometry) -> tuple[str, ...]:
        """The frame that moves."""
        return (reading.child_frame,)

    def example(self, stamp: float, scale: float) -> Odometry:
        """A base that has turned."""
        return Odometry(
            stamp=stamp,
            frame="odom",
            child_frame="base",
            position=np.array([scale, 0.0, 0.0]),
            orientation=np.array([0.0, 0.0, np.sin(scale / 2.0), np.cos(scale / 2.0)]),
        )


class TransformCodec(Codec[Transform]):
    """Pose of a frame in its parent."""

    name = "transform"
    kind = Transform
    role = Role.FRAMES
    use = "frames"
    messages = (TRANSFORMS,)
    values = PoseValues()

    def from_message(self, message: Message, at: At) -> Transform:
        """The pose of one geometry_msgs/TransformStamped; `at` says whether it is static."""
        placed = message.transform
        return Transform(
            child_frame=message.child_frame_id.removeprefix("/"),
            position=xyz(placed.translation),
            orientation=xyzw(placed.rotation),
            **at,
        )

    def to_message(self, reading: Transform, top: Message) -> Message:
        """A tf2_msgs/TFMessage of one transform."""
        return self.message(transforms=[_stamped(reading, top)])

    def topic(self, reading: Transform, prefix: str) -> tuple[str, ...]:
        """The topic where ROS looks for it."""
        return prefix, STATIC if reading.static else MOVING

    def whose(self, reading: Transform) -> tuple[str, ...]:
        """The frame whose pose it is."""
        return (reading.child_frame,)

    def example(self, stamp: float, scale: float) -> Transform:
        """A sensor on a base."""
        return Transform(
            stamp=stamp,
            frame="base",
            child_frame="sensor",
            position=np.array([scale, 0.0, 0.0]),
            orientation=np.array(NO_TURN),
        )


class ObjectPoseCodec(Codec[ObjectPose]):
    """Believed pose of an object."""

    name = "object_pose"
    kind = ObjectPose
    role = Role.CONTEXT
    messages = ("geometry_msgs/msg/PoseStamped",)
    topic_field = "name"
    Columns = ObjectPoseColumns
    values = PoseValues()

    def from_message(self, message: Message, at: At) -> ObjectPose:
        """The pose of a geometry_msgs/PoseStamped; `at` holds the name of the object."""
        pose = message.pose
        return ObjectPose(position=xyz(pose.position), orientation=xyzw(pose.orientation), **at)

    def to_message(self, reading: ObjectPose, top: Message) -> Message:
        """A geometry_msgs/PoseStamped."""
        pose = pose_message(reading.position, reading.orientation)
        return self.message(header=top, pose=pose)

    def draw(self, canvas: Canvas, reading: ObjectPose) -> None:
        """Axes with the name of the object."""
        canvas.axes(reading.name, reading.pose)

    def example(self, stamp: float, scale: float) -> ObjectPose:
        """An object ahead of a base."""
        return ObjectPose(
            stamp=stamp,
            frame="base",
            name="object",
            position=np.array([scale, 0.0, 0.0]),
            orientation=np.array(NO_TURN),
        )


def transforms_message(readings: Iterable[Transform], stamp: int) -> Message:
    """The tf2_msgs/TFMessage of the poses of frames, at one stamp [ns]."""
    stamped = [_stamped(reading, header(stamp, reading.frame)) for reading in readings]
    return message("tf2_msgs/TFMessage", transforms=stamped)


def _stamped(reading: Odometry | Transform, top: Message) -> Message:
    """The geometry_msgs/TransformStamped of a child frame in its parent."""
    placed = message(
        "geometry_msgs/Transform",
        translation=vector(reading.position),
        rotation=quaternion(reading.orientation),
    )
    return message(
        "geometry_msgs/TransformStamped",
        header=top,
        child_frame_id=reading.child_frame,
        transform=placed,
    )


def _turned(orientation: FloatArray, turn: FloatArray) -> FloatArray:
    """A quaternion turned by a rotation vector [rad]."""
    if not turn.any():
        return orientation
    from scipy.spatial.transform import Rotation

    return (Rotation.from_rotvec(turn) * Rotation.from_quat(orientation)).as_quat()
