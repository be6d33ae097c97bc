"""Messages of ROS 2 in recordings: the types that are known there, and readings as messages."""

import re
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

from contactfusion.errors import RecordingError, name_hint
from contactfusion.readings import Reading
from contactfusion.readings.messages import Posting, header, known_types
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.definitions import parsed, store_of
from contactfusion.time import NANOSECONDS_PER_SECOND, to_nanoseconds

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

LATEST_NS = 2**31 * NANOSECONDS_PER_SECOND
"""Headers hold seconds in 32 bits with a sign: stamps stay below this [ns]."""


@cache
def typestore() -> "Typestore":
    """All types of messages: of ROS 2 Jazzy, of this project, and of the kinds of plug-ins.

    Raises:
        DependencyError: rosbags is not installed.
    """
    store = known_types()
    installed_kinds().all()  # which adds their definitions
    return store


@cache
def defined(msgtype: str) -> str:
    """The definition of a type, with those that it is made of.

    Args:
        msgtype: as ROS 2 calls it, e.g. "sensor_msgs/msg/Imu".

    Raises:
        RecordingError: nothing that is installed has it.
    """
    if msgtype not in typestore().types:
        raise RecordingError(f"nothing defines the type {msgtype}")
    return typestore().generate_msgdef(msgtype, ros_version=2)[0]


@cache
def type_hash(msgtype: str, definition: str) -> str:
    """The hash by which ROS 2 knows a type.

    Raises:
        RecordingError: its definition can't be parsed, or is not whole.
    """
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

    form = MessageDefinitionFormat.MSG
    types = parsed(MessageDefinition(form, definition), msgtype)
    try:
        return store_of(types, msgtype).hash_rihs01(msgtype)
    except KeyError as error:
        raise RecordingError(f"the definition of {msgtype} lacks {error}") from None


def recorded_stamp(seconds: float, epoch_ns: int) -> int:
    """A stamp as recordings hold it, in nanoseconds since 1970.

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


def reading_messages(reading: Reading, topic: str, stamp: int) -> Sequence[Posting]:
    """The messages of a reading, each with its topic.

    Args:
        reading: any kind of reading.
        topic: where it goes; a depth image takes topics below it.
        stamp: when it was measured [ns].

    Raises:
        RecordingError: there is no message for this kind of reading.
        PluginError: the plug-in of its kind makes none.
    """
    kinds = installed_kinds()
    codec = kinds.of(type(reading))
    if codec is None or not codec.messages:
        known = [codec.kind.__name__ for codec in kinds.all() if codec.messages]
        hint = name_hint(type(reading).__name__, known, "kinds that have one")
        raise RecordingError(f"there is no message for a {reading.label}; {hint}")
    with kinds.guard(codec):
        return tuple(codec.postings(reading, topic, header(stamp, reading.frame)))


def topic_of(reading: Reading, prefix: str = "") -> str:
    """The topic of a reading: its sensor, or what kind it is.

    The pose of an object goes by its name; that of a frame goes where ROS looks for it.

    Args:
        reading: the reading.
        prefix: comes first, e.g. "truth".
    """
    kinds = installed_kinds()
    codec = kinds.of(type(reading))
    if codec is None:
        parts: tuple[str, ...] = prefix, reading.sensor or type(reading).__name__
    else:
        with kinds.guard(codec):
            parts = codec.topic(reading, prefix)
    return "/" + "/".join(word for part in parts for word in part.split("/") if word)


def ros_name(topic: str) -> str:
    """A topic as ROS allows it: letters, digits and _, and no part begins with a digit."""
    return re.sub(r"/(?=\d)", "/_", re.sub(r"[^A-Za-z0-9_/]", "_", topic))
