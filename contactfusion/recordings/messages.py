"""ROS 2 messages: their types, and the parts that most of them are made of.

The types come from rosbags (extra `record`); those of `contactfusion_msgs` from the folder `msg`.
"""

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError, missing_extra
from contactfusion.time import NANOSECONDS_PER_SECOND, to_nanoseconds

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

DEFINITIONS = Path(__file__).parent / "msg"
LATEST_NS = 2**31 * NANOSECONDS_PER_SECOND
"""Headers hold seconds in 32 bits with a sign: stamps stay below this [ns]."""

Message = Any
"""A message of any type; rosbags makes their classes at run time."""
Posting = tuple[str, Message]
"""A topic, and the message that goes there."""


@cache
def typestore() -> "Typestore":
    """Give all types of messages, those of ROS 2 Jazzy and our own.

    Raises:
        DependencyError: rosbags is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise missing_extra("rosbags", "record") from None
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in sorted(DEFINITIONS.glob("*.msg")):
        name = f"contactfusion_msgs/msg/{path.stem}"
        store.register(get_types_from_msg(path.read_text(encoding="utf-8"), name))
    return store


def defined(msgtype: str) -> str:
    """Give the definition of a type, with those that it is made of.

    Args:
        msgtype: as ROS 2 calls it, e.g. "sensor_msgs/msg/Imu".

    Raises:
        RecordingError: neither ROS 2 nor this project has it.
    """
    if msgtype not in typestore().types:
        raise RecordingError(f"nothing defines the type {msgtype}")
    return typestore().generate_msgdef(msgtype, ros_version=2)[0]


@cache
def type_hash(msgtype: str, definition: str) -> str:
    """Give the hash by which ROS 2 knows a type.

    Raises:
        RecordingError: its definition can't be parsed.
    """
    from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(definition, msgtype))
        return store.hash_rihs01(msgtype)
    except (TypesysError, KeyError) as error:
        reason = str(error).splitlines()[0]
        raise RecordingError(f"the definition of {msgtype} can't be parsed: {reason}") from None


def message(kind: str, **fields: object) -> Message:
    """Give a message.

    Args:
        kind: its package and name, e.g. "geometry_msgs/Point".
        fields: all of its fields.
    """
    return _type(kind)(**fields)


@cache
def _type(kind: str) -> Any:
    return typestore().types[kind.replace("/", "/msg/")]


def recorded_stamp(seconds: float, epoch_ns: int) -> int:
    """Give a stamp as recordings hold it, in nanoseconds since 1970.

    Args:
        seconds: since the epoch of the readings [s].
        epoch_ns: the moment from which they count [ns].

    Raises:
        RecordingError: it lies before 1970 or after 2038, which ROS can't tell.
    """
    stamp = epoch_ns + to_nanoseconds(seconds)
    if not 0 <= stamp < LATEST_NS:
        raise RecordingError(
            f"the stamp {seconds} s, counted from {epoch_ns} ns, lies before 1970 or after 2038, "
            f"and ROS has no stamps there"
        )
    return stamp


def ros_time(stamp: int) -> Message:
    """Give builtin_interfaces/Time of a stamp [ns]."""
    sec, nanosec = divmod(stamp, NANOSECONDS_PER_SECOND)
    return message("builtin_interfaces/Time", sec=sec, nanosec=nanosec)


def header(stamp: int, frame: str) -> Message:
    """Give std_msgs/Header of a stamp [ns] and a frame."""
    return message("std_msgs/Header", stamp=ros_time(stamp), frame_id=frame)


def point(xyz: FloatArray) -> Message:
    """Give geometry_msgs/Point of shape (3,) [m]."""
    x, y, z = xyz.tolist()
    return message("geometry_msgs/Point", x=x, y=y, z=z)


def vector(xyz: FloatArray) -> Message:
    """Give geometry_msgs/Vector3 of shape (3,)."""
    x, y, z = xyz.tolist()
    return message("geometry_msgs/Vector3", x=x, y=y, z=z)


def quaternion(xyzw: FloatArray) -> Message:
    """Give geometry_msgs/Quaternion of shape (4,)."""
    x, y, z, w = xyzw.tolist()
    return message("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)


def pose(position: FloatArray, orientation: FloatArray) -> Message:
    """Give geometry_msgs/Pose.

    Args:
        position: shape (3,) [m].
        orientation: shape (4,), unit quaternion (x, y, z, w).
    """
    return message(
        "geometry_msgs/Pose", position=point(position), orientation=quaternion(orientation)
    )


def twist(linear: FloatArray | None, angular: FloatArray | None) -> Message:
    """Give geometry_msgs/Twist; what is not known is NaN, as ROS has no word for it.

    Args:
        linear: shape (3,) [m/s], or None.
        angular: shape (3,) [rad/s], or None.
    """
    unknown = np.full(3, np.nan)
    return message(
        "geometry_msgs/Twist",
        linear=vector(unknown if linear is None else linear),
        angular=vector(unknown if angular is None else angular),
    )


def numbers(values: FloatArray | Iterable[float] | None) -> FloatArray:
    """Give an array for a field of many numbers; nothing gives an empty one."""
    if isinstance(values, np.ndarray):
        return values
    return np.fromiter(() if values is None else values, np.float64)
