"""Files whose log goes back in time, as the recorder's clock was set: they are read as they lie.

Readers sort by the log. What was recorded after the clock was set back would come before, or be
mixed with, what was recorded earlier, and nobody would know. Files that a program wrote in an order
of its own are sorted: their log falls often, or never within a topic.
"""

from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from functools import partial
from io import BytesIO
from typing import TYPE_CHECKING, Any

from contactfusion.recordings.log import LONGEST_FALL

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader as Bag1
    from rosbags.rosbag2.storage_mcap import McapReader

MOST_FALLS = 2
"""Nobody sets a clock back more often while something is recorded."""
Span = tuple[int, int]
"""When the first and the last message of a chunk were logged [ns]."""


def read_bag_as_it_lies(reader: "Bag1") -> None:
    """Let the reader of a ROS 1 bag give messages as they lie in it, if its log goes back."""
    infos = sorted(reader.chunk_infos, key=lambda one: one.pos)
    if _may_go_back([(one.start_time, one.end_time) for one in infos]):
        entries = _as_they_lie(reader, reader.indexes)
        if _was_set_back((number, entry.time) for entry, number in entries):
            _give(reader, partial(_bag_messages, reader))


def read_mcap_as_it_lies(reader: "McapReader") -> None:
    """Let the reader of an MCAP file give messages as they lie in it, if its log goes back.

    One without chunks is always read so, as there is no index by which it could be sorted.
    """
    chunks = sorted(reader.chunks, key=lambda one: one.chunk_start_offset)
    spans = [(one.message_start_time, one.message_end_time) for one in chunks]
    if chunks and not _may_go_back(spans):
        return
    with suppress(Exception):  # of many kinds; what is damaged is told when it is read
        messages = reader.messages_scan(reader.connections)
        if not chunks or _was_set_back((one.id, stamp) for one, stamp, _ in messages):
            _give(reader, reader.messages_scan)


def _give(reader: Any, messages: Any) -> None:
    reader.messages = messages


def _may_go_back(spans: list[Span]) -> bool:
    """Tell whether a chunk begins before an earlier one ends, or there is only one."""
    newest = 0
    for begin, end in spans:
        if begin < newest - LONGEST_FALL:
            return True
        newest = max(newest, end)
    return len(spans) == 1


def _was_set_back(logged: Iterable[tuple[int, int]]) -> bool:
    """Tell whether a clock was set back.

    Args:
        logged: the number of its channel and the stamp [ns] of each message, as they lie.
    """
    newest: dict[int, int] = {}
    last = falls = 0
    within = False
    for channel, stamp in logged:
        falls += stamp < last - LONGEST_FALL
        if falls > MOST_FALLS:
            return False
        before = newest.get(channel, 0)
        within = within or stamp < before - LONGEST_FALL
        newest[channel], last = max(before, stamp), stamp
    return falls > 0 and within


def _as_they_lie(reader: Any, numbers: Iterable[int]) -> list[tuple[Any, int]]:
    """Give the entries of the index of some channels with their numbers."""
    entries = [(entry, number) for number in numbers for entry in reader.indexes[number]]
    return sorted(entries, key=lambda one: (one[0].chunk_pos, one[0].offset))


def _bag_messages(
    reader: Any,
    connections: "Collection[Connection]",
    start: int | None = None,
    stop: int | None = None,
) -> "Iterator[tuple[Connection, int, bytes]]":
    """Give the messages of a bag as rosbags does, but as they lie."""
    from rosbags.rosbag1.reader import Header, RecordType, read_bytes, read_uint32

    known = {one.id: one for one in connections}
    at, chunk = -1, BytesIO()
    for entry, number in _as_they_lie(reader, known):
        if not (start or 0) <= entry.time < (stop or 2**63):
            continue
        if entry.chunk_pos != at:
            at, head = entry.chunk_pos, reader.chunks[entry.chunk_pos]
            reader.bio.seek(head.datapos)
            chunk = BytesIO(head.decompressor(read_bytes(reader.bio, head.datasize)))
        chunk.seek(entry.offset)
        while Header.read(chunk).get_uint8("op") == RecordType.CONNECTION:
            chunk.seek(read_uint32(chunk), 1)
        yield known[number], entry.time, read_bytes(chunk, read_uint32(chunk))
