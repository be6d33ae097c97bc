"""Messages of ROS as readings: what makes which, and of which types."""

from collections.abc import Callable
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.readings import (
    JointCommand,
    JointState,
    Markers,
    ObjectPose,
    Odometry,
    PointCloud,
    Reading,
    Switch,
    TactileImage,
    Transform,
    Twist,
    Wrench,
)
from contactfusion.recordings.messages import Message
from contactfusion.recordings.range_messages import points_of
from contactfusion.time import NANOSECONDS_PER_SECOND

At = dict[str, Any]
"""The stamp [s], the frame and the sensor of a reading."""
Maker = Callable[[Message, At], Reading]
"""Makes a reading of a message; a RecordingError says why it is none."""
JOINTS = "joints"
"""The frame of joints whose header names none, as is usual: their values lie in no frame."""


def stamp_of(message: Message) -> int:
    """Give the stamp of the header of a message [ns]."""
    stamp = message.header.stamp
    nanoseconds: int = stamp.sec * NANOSECONDS_PER_SECOND + stamp.nanosec
    return nanoseconds


def transform(message: Message, at: At) -> Transform:
    """Make a reading of geometry_msgs/TransformStamped."""
    placed = message.transform
    return Transform(
        child_frame=message.child_frame_id.removeprefix("/"),
        position=_xyz(placed.translation),
        orientation=_xyzw(placed.rotation),
        **at,
    )


def object_pose(name: str) -> Maker:
    """Give what makes readings of geometry_msgs/PoseStamped.

    Args:
        name: what the object is called.
    """

    def make(message: Message, at: At) -> ObjectPose:
        pose = message.pose
        return ObjectPose(
            name=name, position=_xyz(pose.position), orientation=_xyzw(pose.orientation), **at
        )

    return make


def _wrench(message: Message, at: At) -> Wrench:
    wrench = message.wrench
    return Wrench(force=_xyz(wrench.force), torque=_xyz(wrench.torque), **at)


def _joint_state(message: Message, at: At) -> JointState:
    if not len(message.position):
        raise RecordingError("it tells no positions")
    at["frame"] = at["frame"] or JOINTS
    return JointState(
        names=tuple(message.name),
        positions=message.position,
        velocities=_told(message.velocity),
        efforts=_told(message.effort),
        **at,
    )


def _joint_command(message: Message, at: At) -> JointCommand:
    if not message.points:
        raise RecordingError("it has no point")
    at["frame"] = at["frame"] or JOINTS
    return JointCommand(
        names=tuple(message.joint_names), positions=message.points[-1].positions, **at
    )


def _point_cloud(message: Message, at: At) -> PointCloud:
    return PointCloud(points=points_of(message), **at)


def _laser_scan(message: Message, at: At) -> PointCloud:
    ranges = message.ranges.astype(np.float64)
    seen = (ranges >= message.range_min) & (ranges <= message.range_max)
    ranges[~seen] = np.nan
    angles = message.angle_min + message.angle_increment * np.arange(len(ranges))
    points = np.zeros((len(ranges), 3))
    points[:, 0], points[:, 1] = ranges * np.cos(angles), ranges * np.sin(angles)
    points[~seen, 2] = np.nan
    return PointCloud(points=points, **at)


def _odometry(message: Message, at: At) -> Odometry:
    pose, twist = message.pose.pose, message.twist.twist
    return Odometry(
        child_frame=message.child_frame_id.removeprefix("/"),
        position=_xyz(pose.position),
        orientation=_xyzw(pose.orientation),
        linear=_told(_xyz(twist.linear)),
        angular=_told(_xyz(twist.angular)),
        **at,
    )


def _twist(message: Message, at: At) -> Twist:
    return Twist(linear=_xyz(message.twist.linear), angular=_xyz(message.twist.angular), **at)


def _tactile_image(message: Message, at: At) -> TactileImage:
    return TactileImage(values=message.values, **at)


def _switch(message: Message, at: At) -> Switch:
    return Switch(closed=message.closed, **at)


def _markers(message: Message, at: At) -> Markers:
    positions = np.array([(point.x, point.y, point.z) for point in message.positions])
    return Markers(names=tuple(message.names), positions=positions.reshape(-1, 3), **at)


MAKERS: dict[str, tuple[type[Reading], Maker]] = {
    "geometry_msgs/msg/WrenchStamped": (Wrench, _wrench),
    "geometry_msgs/msg/TwistStamped": (Twist, _twist),
    "sensor_msgs/msg/JointState": (JointState, _joint_state),
    "sensor_msgs/msg/PointCloud2": (PointCloud, _point_cloud),
    "sensor_msgs/msg/LaserScan": (PointCloud, _laser_scan),
    "nav_msgs/msg/Odometry": (Odometry, _odometry),
    "trajectory_msgs/msg/JointTrajectory": (JointCommand, _joint_command),
    "contactfusion_msgs/msg/TactileImage": (TactileImage, _tactile_image),
    "contactfusion_msgs/msg/Switch": (Switch, _switch),
    "contactfusion_msgs/msg/Markers": (Markers, _markers),
}
"""The readings of types of which one message is one reading, and what makes them."""
POSE = "geometry_msgs/msg/PoseStamped"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
IMAGE = "sensor_msgs/msg/Image"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
READABLE = (*MAKERS, POSE, TRANSFORMS, f"{IMAGE} (of depth, with {CAMERA_INFO} beside it)")
"""All types of which readings are made."""


def _xyz(vector: Message) -> FloatArray:
    return np.array((vector.x, vector.y, vector.z))


def _xyzw(turn: Message) -> FloatArray:
    return np.array((turn.x, turn.y, turn.z, turn.w))


def _told(values: FloatArray) -> FloatArray | None:
    """Give values, or None when there are none or one of them is no number."""
    return values if len(values) and np.isfinite(values).all() else None
