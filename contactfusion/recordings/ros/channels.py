"""Channels: messages of one type on one topic from one publisher, of ROS 1 or 2, as CDR."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from struct import unpack_from
from typing import TYPE_CHECKING, Any

from contactfusion.errors import RecordingError
from contactfusion.readings.poses import TRANSFORMS
from contactfusion.recordings.messages import typestore
from contactfusion.time import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, MessageDefinition
    from rosbags.typesys.store import Typestore

Types = dict[str, Any]
"""By the names of types: their constants and their fields, as rosbags holds them."""
HEADER = "std_msgs/msg/Header"
SAME_IN_BOTH = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
"""Types that ROS 1 has no definition of, as they are built in."""
RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
"""Types of ROS 1 that ROS 2 calls otherwise."""
RULE = 80 * "=" + "\n"
"""What stands between the parts of a definition."""


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
    """A connection of rosbags' as a channel; one with a wrong definition is not standard.

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
        if msgtype == TRANSFORMS or _starts_with_header(msgtype, types):
            header = partial(_header, at=8 if msgtype == TRANSFORMS else 4, ros1=ros1)
    except RecordingError:
        standard = False
    return Channel(
        topic=one.topic,
        msgtype=msgtype,
        count=one.msgcount,
        publisher=getattr(one.ext, "callerid", None) or f"publisher {number}",
        standard=standard,
        cdr=partial(_cdr_of_ros1, definition=one.msgdef, msgtype=msgtype, standard=standard)
        if ros1
        else bytes,
        definition=partial(ros2_text, one.msgdef, msgtype, ros1=ros1),
        header=header,
    )


def _header(raw: bytes, at: int, ros1: bool) -> tuple[int, str]:
    return _header_of(raw, at, big_endian=not ros1 and raw[1] == 0)


@lru_cache(maxsize=256)
def types_in(definition: "MessageDefinition", msgtype: str) -> Types:
    """The types that a definition defines; those of ROS 2 when there is no definition.

    Args:
        definition: in .msg or .idl, with those that it is made of.
        msgtype: what it defines.

    Raises:
        RecordingError: it can't be parsed.
    """
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import TypesysError, get_types_from_msg

    if definition.format == MessageDefinitionFormat.NONE or not definition.data.strip():
        return typestore().fielddefs
    try:
        if definition.format == MessageDefinitionFormat.MSG:
            return get_types_from_msg(definition.data, msgtype)
        return _types_in_idl(definition.data)
    except TypesysError as error:
        reason = str(error).splitlines()[0]
        raise RecordingError(f"the definition of {msgtype} can't be parsed: {reason}") from None


def is_standard(msgtype: str, types: Types) -> bool:
    """Whether a type, and all that it is made of, is what ROS 2 or this project means by it.

    Args:
        msgtype: the type.
        types: what a file says of types.
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
        at: where the seconds are [bytes].
        big_endian: the order of bytes in it.

    Raises:
        struct.error: the message ends before.
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
        definition: that of its type.
        msgtype: its type.
        standard: whether the type is a standard one.

    Raises:
        RecordingError: the definition does not hold together.
    """
    store = typestore() if standard else _store(definition, msgtype)
    return store.ros1_to_cdr(raw, msgtype)


def ros2_text(definition: "MessageDefinition", msgtype: str, *, ros1: bool) -> str:
    """A definition as ROS 2 writes it in .msg; nothing when nobody knows it.

    Args:
        definition: as it stands in the file.
        msgtype: the type.
        ros1: whether the file is one of ROS 1.
    """
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import TypesysError

    if definition.format == MessageDefinitionFormat.MSG and definition.data and not ros1:
        return definition.data
    try:
        standard = is_standard(msgtype, types_in(definition, msgtype))
        store = typestore() if standard else _store(definition, msgtype)
        return store.generate_msgdef(msgtype, ros_version=2)[0]
    except (RecordingError, TypesysError):
        return ""


def _types_in_idl(text: str) -> Types:
    from rosbags.typesys import get_types_from_idl

    if not text.startswith(f"{RULE}IDL: "):
        return get_types_from_idl(text)
    types: Types = {}
    for part in text.split(RULE)[1:]:
        types.update(get_types_from_idl(part.split("\n", 1)[1]))
    return types


@lru_cache(maxsize=256)
def _store(definition: "MessageDefinition", msgtype: str) -> "Typestore":
    """A store of the types of a definition, with the header of ROS 2."""
    from rosbags.typesys import Stores, get_typestore

    types = types_in(definition, msgtype)
    store = get_typestore(Stores.EMPTY)
    mine = {name: fields for name, fields in types.items() if name not in SAME_IN_BOTH}
    store.register({**mine, HEADER: typestore().fielddefs[HEADER]})
    try:
        store.get_msgdef(msgtype)
    except Exception as error:  # of many kinds
        raise RecordingError(f"the definition of {msgtype} is not whole: {error}") from None
    return store


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
