"""Readings as ROS 2 messages: standard ones, or our own where there is none."""

import re
from collections.abc import Iterable, Iterator

import numpy as np

from contactfusion.errors import RecordingError, name_hint
from contactfusion.readings import (
    READING_TYPES,
    DepthImage,
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
from contactfusion.recordings.messages import (
    Message,
    Posting,
    header,
    message,
    numbers,
    point,
    pose,
    quaternion,
    twist,
    vector,
)
from contactfusion.recordings.range_messages import depth_image, point_cloud

MOVING, STATIC = "tf", "tf_static"
"""The topics of ROS for the poses of frames: of those that move, and of those that never do."""


def reading_messages(reading: Reading, topic: str, stamp: int) -> Iterator[Posting]:
    """Give the messages of a reading, each with its topic.

    Args:
        reading: any kind of reading.
        topic: where it goes; a depth image takes topics below it.
        stamp: when it was measured [ns].

    Raises:
        RecordingError: there is no message for this kind of reading.
    """
    top = header(stamp, reading.frame)
    match reading:
        case DepthImage():
            yield from depth_image(reading, topic, top)
        case Odometry():
            yield topic, _odometry(reading, top)
            yield f"/{MOVING}", message("tf2_msgs/TFMessage", transforms=[_stamped(reading, top)])
        case Transform():
            yield topic, transforms([reading], stamp)
        case _:
            yield topic, _message(reading, top)


def transforms(readings: Iterable[Transform], stamp: int) -> Message:
    """Give tf2_msgs/TFMessage of the poses of frames, at one stamp [ns]."""
    stamped = [_stamped(reading, header(stamp, reading.frame)) for reading in readings]
    return message("tf2_msgs/TFMessage", transforms=stamped)


def topic_of(reading: Reading, prefix: str = "") -> str:
    """Give the topic of a reading: its sensor, or what kind it is.

    The pose of an object goes by its name; that of a frame goes where ROS looks for it.

    Args:
        reading: the reading.
        prefix: comes first, e.g. "truth".
    """
    if isinstance(reading, ObjectPose):
        parts = [prefix, reading.sensor or ("" if prefix else "object_pose"), reading.name]
    elif isinstance(reading, Transform):
        parts = [prefix, STATIC if reading.static else MOVING]
    else:
        parts = [prefix, reading.sensor or _kind(reading)]
    return "/" + "/".join(word for part in parts for word in part.split("/") if word)


def ros_name(topic: str) -> str:
    """Give a topic as ROS allows it: letters, digits and _, and no part begins with a digit."""
    return re.sub(r"/(?=\d)", "/_", re.sub(r"[^A-Za-z0-9_/]", "_", topic))


def _kind(reading: Reading) -> str:
    for name, kind in READING_TYPES.items():
        if isinstance(reading, kind):
            return name
    return type(reading).__name__


def _message(reading: Reading, top: Message) -> Message:
    match reading:
        case Wrench():
            force, torque = vector(reading.force), vector(reading.torque)
            wrench = message("geometry_msgs/Wrench", force=force, torque=torque)
            return message("geometry_msgs/WrenchStamped", header=top, wrench=wrench)
        case TactileImage():
            return message("contactfusion_msgs/TactileImage", header=top, values=reading.values)
        case Switch():
            return message("contactfusion_msgs/Switch", header=top, closed=bool(reading.closed))
        case PointCloud():
            return point_cloud(reading, top)
        case JointState():
            return message(
                "sensor_msgs/JointState",
                header=top,
                name=list(reading.names),
                position=reading.positions,
                velocity=numbers(reading.velocities),
                effort=numbers(reading.efforts),
            )
        case JointCommand():
            return _joint_command(reading, top)
        case Twist():
            moving = twist(reading.linear, reading.angular)
            return message("geometry_msgs/TwistStamped", header=top, twist=moving)
        case ObjectPose():
            place = pose(reading.position, reading.orientation)
            return message("geometry_msgs/PoseStamped", header=top, pose=place)
        case Markers():
            return message(
                "contactfusion_msgs/Markers",
                header=top,
                names=list(reading.names),
                positions=[point(position) for position in reading.positions],
            )
    kinds = [kind.__name__ for kind in READING_TYPES.values()]
    hint = name_hint(type(reading).__name__, kinds, "kinds that have one")
    raise RecordingError(f"there is no message for a {reading.label}; {hint}")


def _joint_command(reading: JointCommand, top: Message) -> Message:
    goal = message(
        "trajectory_msgs/JointTrajectoryPoint",
        positions=reading.positions,
        velocities=numbers(None),
        accelerations=numbers(None),
        effort=numbers(None),
        time_from_start=message("builtin_interfaces/Duration", sec=0, nanosec=0),
    )
    return message(
        "trajectory_msgs/JointTrajectory",
        header=top,
        joint_names=list(reading.names),
        points=[goal],
    )


def _odometry(reading: Odometry, top: Message) -> Message:
    unknown = np.zeros(36)
    moving = twist(reading.linear, reading.angular)
    place = pose(reading.position, reading.orientation)
    return message(
        "nav_msgs/Odometry",
        header=top,
        child_frame_id=reading.child_frame,
        pose=message("geometry_msgs/PoseWithCovariance", pose=place, covariance=unknown),
        twist=message("geometry_msgs/TwistWithCovariance", twist=moving, covariance=unknown),
    )


def _stamped(reading: Odometry | Transform, top: Message) -> Message:
    """Give geometry_msgs/TransformStamped of the child frame in its parent."""
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
