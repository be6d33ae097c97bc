"""Messages of ROS 2 in memory: their types, and the parts that most of them are made of.

The types come from rosbags (extra `record`); those of `contactfusion_msgs` from the folder `msg`,
those of plug-ins from the definitions of their codecs.
"""

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import missing_extra
from contactfusion.time import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

DEFINITIONS = Path(__file__).parent / "msg"

Message = Any
"""A message of any type; rosbags makes their classes at run time."""
Posting = tuple[str, Message]
"""A topic, and the message that goes there."""


@cache
def known_types() -> "Typestore":
    """The types of ROS 2 Jazzy, those of this project, and all that were defined since.

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


@cache
def define(msgtype: str, definition: str) -> None:
    """Add a type, with those that it is made of; what is known already stays.

    Args:
        msgtype: as ROS 2 calls it, e.g. "my_msgs/msg/Sound".
        definition: in .msg, the types that it is made of below it as in bags.

    Raises:
        DependencyError: rosbags is not installed.
        Exception: of rosbags, of many kinds: it can't be parsed, or a type is another one already.
    """
    from rosbags.typesys import get_types_from_msg

    store = known_types()
    store.register(get_types_from_msg(definition, msgtype))
    store.generate_msgdef(msgtype, ros_version=2)  # refuses types that nothing defines


def message(kind: str, **fields: object) -> Message:
    """A message of ROS 2.

    Args:
        kind: its package and name, e.g. "geometry_msgs/Point".
        fields: all of its fields.

    Raises:
        DependencyError: rosbags is not installed.
    """
    return _type(kind)(**fields)


@cache
def _type(kind: str) -> Any:
    return known_types().types[kind if "/msg/" in kind else kind.replace("/", "/msg/")]


def ros_time(stamp: int) -> Message:
    """The builtin_interfaces/Time of a stamp [ns]."""
    sec, nanosec = divmod(stamp, NANOSECONDS_PER_SECOND)
    return message("builtin_interfaces/Time", sec=sec, nanosec=nanosec)


def header(stamp: int, frame: str) -> Message:
    """The std_msgs/Header of a stamp [ns] and a frame."""
    return message("std_msgs/Header", stamp=ros_time(stamp), frame_id=frame)


def point(xyz: FloatArray) -> Message:
    """The geometry_msgs/Point of shape (3,) [m]."""
    x, y, z = xyz.tolist()
    return message("geometry_msgs/Point", x=x, y=y, z=z)


def vector(xyz: FloatArray) -> Message:
    """The geometry_msgs/Vector3 of shape (3,)."""
    x, y, z = xyz.tolist()
    return message("geometry_msgs/Vector3", x=x, y=y, z=z)


def quaternion(xyzw: FloatArray) -> Message:
    """The geometry_msgs/Quaternion of shape (4,)."""
    x, y, z, w = xyzw.tolist()
    return message("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)


def pose(position: FloatArray, orientation: FloatArray) -> Message:
    """A geometry_msgs/Pose.

    Args:
        position: shape (3,) [m].
        orientation: shape (4,), unit quaternion (x, y, z, w).
    """
    return message(
        "geometry_msgs/Pose", position=point(position), orientation=quaternion(orientation)
    )


def twist(linear: FloatArray | None, angular: FloatArray | None) -> Message:
    """A geometry_msgs/Twist; what is not known is NaN, as ROS has no word for it.

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
    """An array for a field of many numbers; empty where there is nothing."""
    if isinstance(values, np.ndarray):
        return values
    return np.fromiter(() if values is None else values, np.float64)


def xyz(of: Message) -> FloatArray:
    """The numbers of a point or a vector, shape (3,)."""
    return np.array((of.x, of.y, of.z))


def xyzw(of: Message) -> FloatArray:
    """The numbers of a quaternion, shape (4,)."""
    return np.array((of.x, of.y, of.z, of.w))


def known(values: FloatArray) -> FloatArray | None:
    """Numbers of a message; None where there are none, or one of them is no number."""
    return values if len(values) and np.isfinite(values).all() else None
