"""Channels: messages of one type on one topic from one publisher, of ROS 1 or 2 alike."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from contactfusion.errors import RecordingError
from contactfusion.recordings.ros.definitions import (
    RENAMED,
    cdr_of_ros1,
    is_standard,
    ros2_text,
    types_in,
)

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
    """

    topic: str
    msgtype: str
    count: int
    publisher: str
    standard: bool
    cdr: Callable[[bytes], Any]
    definition: Callable[[], str]


def channel_of(one: "Connection", number: int, *, ros1: bool) -> Channel:
    """Give a connection of rosbags' as a channel; one with a wrong definition is not standard.

    Args:
        one: the connection.
        number: which of its topic's it is, for where no publisher is told.
        ros1: whether it is one of ROS 1.
    """
    msgtype = RENAMED.get(one.msgtype, one.msgtype)
    try:
        standard = is_standard(msgtype, types_in(one.msgdef, msgtype))
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
    )
