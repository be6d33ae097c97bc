"""Channels: messages of one type on one topic from one publisher, of ROS 1 or 2 alike."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from contactfusion.errors import RecordingError
from contactfusion.recordings.ros.definitions import (
    RENAMED,
    cdr_of_ros1,
    header_of,
    is_standard,
    ros2_text,
    starts_with_header,
    types_in,
)
from contactfusion.recordings.ros.readings import TRANSFORMS

if TYPE_CHECKING:
    from rosbags.interfaces import Connection


@dataclass(frozen=True, eq=False)
class Channel:
    """Messages of one type on one topic from one publisher.

    Attributes:
        topic: the topic.
        msgtype: the type as ROS 2 calls it, e.g. "geometry_msgs/msg/WrenchStamped".
        count: how many messages there are.
        publisher: the node that sent them, or what stands for it where none is told.
        standard: whether the type is what ROS 2 or this project means by it.
        cdr: gives the CDR of bytes from the file; a RecordingError when nobody knows their layout.
        definition: gives the definition in .msg of ROS 2, with those that it is made of.
        header: gives the stamp [ns] and the frame of the first header in bytes from the file; None
            when the type has none, or its definition can't be parsed.
    """

    topic: str
    msgtype: str
    count: int
    publisher: str
    standard: bool
    cdr: Callable[[bytes], Any]
    definition: Callable[[], str]
    header: Callable[[bytes], tuple[int, str]] | None


def channel_of(one: "Connection", number: int, *, ros1: bool) -> Channel:
    """Give a connection of rosbags' as a channel; one with a wrong definition is not standard.

    Args:
        one: the connection.
        number: which of its topic's it is, for where no publisher is told.
        ros1: whether it is one of ROS 1.
    """
    msgtype = RENAMED.get(one.msgtype, one.msgtype)
    header = None
    try:
        types = types_in(one.msgdef, msgtype)
        standard = is_standard(msgtype, types)
        if msgtype == TRANSFORMS or starts_with_header(msgtype, types):
            header = partial(_header, at=8 if msgtype == TRANSFORMS else 4, ros1=ros1)
    except RecordingError:
        standard = False
    return Channel(
        topic=one.topic,
        msgtype=msgtype,
        count=one.msgcount,
        publisher=getattr(one.ext, "callerid", None) or f"publisher {number}",
        standard=standard,
        cdr=partial(cdr_of_ros1, definition=one.msgdef, msgtype=msgtype, standard=standard)
        if ros1
        else bytes,
        definition=partial(ros2_text, one.msgdef, msgtype, ros1=ros1),
        header=header,
    )


def _header(raw: bytes, at: int, ros1: bool) -> tuple[int, str]:
    return header_of(raw, at, big_endian=not ros1 and raw[1] == 0)
