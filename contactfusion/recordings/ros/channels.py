"""Channels: messages of one type on one topic from one publisher, of ROS 1 or 2, as CDR."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from struct import unpack_from
from typing import TYPE_CHECKING, Any

from contactfusion.errors import RecordingError
from contactfusion.readings.poses import TRANSFORMS
from contactfusion.recordings.definitions import Types, parsed, store_of
from contactfusion.recordings.messages import typestore
from contactfusion.time import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, MessageDefinition
    from rosbags.typesys.store import Typestore

HEADER = "std_msgs/msg/Header"
SAME_IN_BOTH = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
"""Built-in types of ROS 1, which have no definition there."""
RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
"""Types of ROS 1 with another name in ROS 2."""


@dataclass(frozen=True, eq=False)
class Channel:
    """Messages of one type on one topic from one publisher.

    Attributes:
        topic: the topic.
        msgtype: the type's name in ROS 2, e.g. "geometry_msgs/msg/WrenchStamped".
        count: number of messages.
        publisher: the node that sent them, or a number where the file names none.
        standard: whether the type is defined as in ROS 2 or in this project.
        cdr: the CDR of bytes from the file; a RecordingError when their layout is unknown.
        definition: the definition in .msg of ROS 2, with those of its parts.
        header: the stamp [ns] and the frame of the first header in bytes from the file; None when
            the type has none, or its definition can't be parsed.
    """

    topic: str
    msgtype: str
    count: int
    publisher: str
    standard: bool
    cdr: Callable[[bytes], Any]
    definition: Callable[[], str]
    header: Callable[[bytes], tuple[int, str]] | None


def channel_of(connection: "Connection", number: int, *, ros1: bool) -> Channel:
    """A connection of rosbags' as a channel; one with a wrong definition is not standard.

    Args:
        connection: of rosbags.
        number: its number among those of its topic, for where no publisher is named.
        ros1: whether it is one of ROS 1.
    """
    msgtype = RENAMED.get(connection.msgtype, connection.msgtype)
    header = None
    try:
        types = types_in(connection.msgdef, msgtype)
        standard = is_standard(msgtype, types)
        if msgtype == TRANSFORMS or _starts_with_header(msgtype, types):
            header = partial(_header, at=8 if msgtype == TRANSFORMS else 4, ros1=ros1)
    except RecordingError:
        standard = False
    return Channel(
        topic=connection.topic,
        msgtype=msgtype,
        count=connection.msgcount,
        publisher=getattr(connection.ext, "callerid", None) or f"publisher {number}",
        standard=standard,
        cdr=partial(_cdr_of_ros1, definition=connection.msgdef, msgtype=msgtype, standard=standard)
        if ros1
        else bytes,
        definition=partial(ros2_text, connection.msgdef, msgtype, ros1=ros1),
        header=header,
    )


def _header(raw: bytes, at: int, ros1: bool) -> tuple[int, str]:
    return _header_of(raw, at, big_endian=not ros1 and raw[1] == 0)


def types_in(definition: "MessageDefinition", msgtype: str) -> Types:
    """The types that a definition defines; those of ROS 2 when there is no definition.

    Args:
        definition: in .msg or .idl, with those of its parts.
        msgtype: its type.

    Raises:
        RecordingError: it can't be parsed, or is larger than any.
    """
    from rosbags.interfaces import MessageDefinitionFormat

    if definition.format == MessageDefinitionFormat.NONE or not definition.data.strip():
        return typestore().fielddefs
    return parsed(definition, msgtype)


def is_standard(msgtype: str, types: Types) -> bool:
    """Whether a type, and all its parts, are defined as in ROS 2 or in this project.

    Args:
        msgtype: the type.
        types: as a file defines them.
    """
    known = typestore().fielddefs
    if types is known:
        return msgtype in known
    if msgtype not in types or msgtype not in known:
        return msgtype in SAME_IN_BOTH
    fields, wanted = _fields(msgtype, types), _fields(msgtype, known)
    return fields == wanted and all(is_standard(name, types) for name in _named(fields))


def _header_of(raw: bytes, at: int, *, big_endian: bool) -> tuple[int, str]:
    """The stamp [ns] and the frame of a header, without decoding the message.

    CDR and the encoding of ROS 1 both have the seconds four bytes after the message's start, or
    after the number of elements where the header is that of the first element of a sequence.

    Args:
        raw: the message as the file holds it.
        at: offset of the seconds [bytes].
        big_endian: the byte order.

    Raises:
        struct.error: the message is too short.
    """
    seconds, nanoseconds, length = unpack_from(">III" if big_endian else "<III", raw, at)
    frame = bytes(raw[at + 12 : at + 12 + length]).rstrip(b"\0").decode(errors="replace")
    return seconds * NANOSECONDS_PER_SECOND + nanoseconds, frame.removeprefix("/")


def _starts_with_header(msgtype: str, types: Types) -> bool:
    """Whether the first field of a type is a std_msgs/Header."""
    from rosbags.interfaces import Nodetype

    fields = types[msgtype][1] if msgtype in types else []
    return bool(fields) and fields[0][1] == (Nodetype.NAME, HEADER)


def _cdr_of_ros1(
    raw: bytes, definition: "MessageDefinition", msgtype: str, *, standard: bool
) -> memoryview:
    """The CDR of a message of ROS 1; the number in headers is lost, as ROS 2 has none.

    Args:
        raw: the message as a bag holds it.
        definition: of its type.
        msgtype: its type.
        standard: whether the type is a standard one.

    Raises:
        RecordingError: the definition is not complete.
    """
    store = typestore() if standard else _store(definition, msgtype)
    usual = store.max_sequence_length
    store.max_sequence_length = len(raw)  # sizes are added up before anything is read
    try:
        return store.ros1_to_cdr(raw, msgtype)
    finally:
        store.max_sequence_length = usual


def ros2_text(definition: "MessageDefinition", msgtype: str, *, ros1: bool) -> str:
    """A definition as ROS 2 writes it in .msg; empty when it is unknown.

    Args:
        definition: as in the file.
        msgtype: the type.
        ros1: whether the file is one of ROS 1.
    """
    from rosbags.interfaces import MessageDefinitionFormat

    if definition.format == MessageDefinitionFormat.MSG and definition.data and not ros1:
        return definition.data
    try:
        standard = is_standard(msgtype, types_in(definition, msgtype))
        store = typestore() if standard else _store(definition, msgtype)
        return store.generate_msgdef(msgtype, ros_version=2)[0]
    except Exception:  # of many kinds
        return ""


@lru_cache(maxsize=256)
def _store(definition: "MessageDefinition", msgtype: str) -> "Typestore":
    """A store of the types of a definition, with the header of ROS 2."""
    types = types_in(definition, msgtype)
    mine = {name: fields for name, fields in types.items() if name not in SAME_IN_BOTH}
    return store_of({**mine, HEADER: typestore().fielddefs[HEADER]}, msgtype)


def _fields(msgtype: str, types: Types) -> list[tuple[str, Any]]:
    """Names and kinds of the fields; ROS 1 has upper case, and a number in its header."""
    fields = [(name.lower(), kind) for name, kind in types[msgtype][1]]
    return [field for field in fields if msgtype != HEADER or field[0] != "seq"]


def _named(fields: list[tuple[str, Any]]) -> Iterator[str]:
    """The types that fields are made of, but for numbers and strings."""
    from rosbags.interfaces import Nodetype

    for _, (node, of) in fields:
        kind, name = of[0] if node in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (node, of)
        if kind == Nodetype.NAME:
            yield name
