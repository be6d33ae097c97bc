"""The readers of rosbags for files that they refuse or read otherwise (extra `record`).

Files that a recorder left without an end: rosbags opens files by the index at their end; here a
scan makes the index for its readers. MCAP files of ROS 1, or with
channels that no ROS wrote. And files whose log goes back in time, as the recorder's clock was set:
readers sort by the log, and what was recorded after the clock was set back would come before what
was recorded earlier, unseen; they are read as they lie. Files that a program wrote in an order of
its own are sorted: their log falls often, or never within a topic. What rosbags unpacks is bounded.
"""

import bz2
import os
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import suppress
from functools import cache, partial
from importlib import import_module
from io import BytesIO
from os import SEEK_END
from pathlib import Path
from types import SimpleNamespace
from typing import IO, TYPE_CHECKING, Any, Final, Self, final

from contactfusion.recordings.checksums import FOOTER, require_checksums
from contactfusion.recordings.log import LONGEST_FALL
from contactfusion.recordings.ros.sqlite import bound_sqlite
from contactfusion.unpacking import Unpacker, most_bytes, unpacked

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag2.storage_mcap import McapReader

BAG_MAGIC = b"#ROSBAG V2.0\n"
CHUNK, CONNECTION, MESSAGE = 5, 7, 2
"""Records of a ROS 1 bag."""
MENDED_BY = {
    ".bag": "rosbag reindex {path}",
    ".active": "rosbag reindex {path}",
    ".mcap": "mcap recover {path} -o MENDED.mcap",
    ".db3": "ros2 bag reindex {path.parent}",
}
"""The commands that mend files, by suffix."""
MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
"""First and last bytes of a file."""
ROS1_IN_MCAP: Final = "ros1"
"""The encoding of a channel of ROS 1; `mcap convert` makes such files of bags."""
KNOWN: Final = ("ros2msg", "ros2idl", "omgidl", "")
"""The encodings of definitions that rosbags knows."""
LONGEST_QOS: Final = 2**14
"""The greatest length of the quality of service of a channel [characters]."""
MOST_FALLS = 2
"""Falls of the log by set clocks in one recording; more are an order of its own."""
Span = tuple[int, int]
"""Stamps in the log of the first and the last message of a chunk [ns]."""


def mended_by(path: Path) -> str:
    """The command that mends a file, or a folder of rosbag2."""
    command = "ros2 bag reindex {path}" if path.is_dir() else MENDED_BY[path.suffix]
    return command.format(path=path)


@final
class ScannedMcap:
    """An MCAP file without its end, read from its beginning as far as it goes.

    Args:
        path: the file; it is opened.
    """

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag2.storage_mcap import McapReader

        self.storage = McapReader(path)
        self.storage.schemas = Schemas()
        self.storage.bio = path.open("rb")
        self.storage.data_start = len(MCAP_MAGIC)
        self.storage.data_end = path.stat().st_size
        with suppress(Exception):  # the scan finds the end of what is whole by an error
            self.storage.meta_scan()
        counts: dict[int, int] = {}
        self.start_time = 2**63 - 1
        """The first stamp of its log [ns]."""
        self.end_time = 0
        """The last stamp of its log [ns]."""
        with suppress(Exception):
            for connection, stamp, _ in self.storage.messages_scan(self.storage.connections):
                counts[connection.id] = counts.get(connection.id, 0) + 1
                self.start_time = min(self.start_time, stamp)
                self.end_time = max(self.end_time, stamp)
        self.connections: list[Connection] = [
            connection._replace(msgcount=counts.get(connection.id, 0))
            for connection in self.storage.connections
        ]

    def messages(
        self, connections: "list[Connection]", start: int | None = None, stop: int | None = None
    ) -> "Iterator[tuple[Connection, int, bytes]]":
        """The messages in the order of the file, to its end or the first error."""
        return self.storage.messages_scan(connections, start, stop)

    def close(self) -> None:
        """Close the file."""
        self.storage.close()


def scanned_bag(path: Path) -> "Reader":
    """The reader of a ROS 1 bag that has no index, with that of its whole chunks.

    Args:
        path: the bag; it is opened.
    """
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import Header, read_uint32

    reader = Reader(path)
    reader.bio = file = path.open("rb")
    size = path.stat().st_size
    file.seek(len(BAG_MAGIC))
    with suppress(Exception):  # the first record that is not whole ends it
        while True:
            at = file.tell()
            op = Header.read(file).get_uint8("op")
            if op != CHUNK:
                file.seek(read_uint32(file), 1)
                continue
            file.seek(at)
            chunk = reader.read_chunk()
            if chunk.datapos + chunk.datasize > size:
                break
            file.seek(chunk.datapos)
            content = chunk.decompressor(file.read(chunk.datasize))
            reader.chunks[at] = chunk
            _index(reader, at, content)
            file.seek(chunk.datapos + chunk.datasize)
    stamps = [entry.time for index in reader.indexes.values() for entry in index]
    _set_times(reader, stamps)
    for number, connection in enumerate(reader.connections):
        index = reader.indexes.setdefault(connection.id, [])
        index.sort()
        reader.connections[number] = connection._replace(msgcount=len(index))
    return reader


def _index(reader: "Reader", at: int, content: bytes) -> None:
    """Add the connections and the messages of a chunk at a place in the file."""
    from rosbags.rosbag1.reader import Header, IndexData, read_uint32

    inside, file = BytesIO(content), reader.bio
    known = {connection.id for connection in reader.connections}
    while (offset := inside.tell()) < len(content):
        header: Any = Header.read(inside)
        if header.get_uint8("op") == CONNECTION:
            end = read_uint32(inside) + inside.tell()
            inside.seek(offset)
            reader.bio = inside
            connection = reader.read_connection()
            reader.bio = file
            if connection.id not in known:
                known.add(connection.id)
                reader.connections.append(connection)
        else:
            entry = IndexData(header.get_time("time"), at, offset)
            reader.indexes.setdefault(header.get_uint32("conn"), []).append(entry)
            end = read_uint32(inside) + inside.tell()
        inside.seek(end)


def _set_times(reader: "Reader", stamps: list[int]) -> None:
    from rosbags.rosbag1.reader import ChunkInfo

    if stamps:
        reader.chunk_infos.append(ChunkInfo(0, min(stamps), max(stamps) + 1, {}))


class Schemas(dict[int, Any]):
    """Definitions by number, as rosbags knows them; others get names that no type of ROS has."""

    def __setitem__(self, number: int, schema: Any) -> None:
        if schema.encoding == "ros1msg":
            name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/")
            schema = schema._replace(name=name, encoding="ros2msg")
        elif schema.encoding not in KNOWN:
            name = f"{schema.name} as {schema.encoding}"
            schema = schema._replace(name=name, encoding="", data="")
        super().__setitem__(number, schema)


@final
class AnyMcap:
    """An MCAP file with its end, whoever wrote it.

    Args:
        path: the file; it is opened.

    Raises:
        Exception: of many kinds: it does not hold together.
    """

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag2.storage_mcap import McapReader

        self.storage = reader = McapReader(path)
        reader.schemas = Schemas()
        reader.bio = file = path.open("rb")
        try:
            end = file.seek(-FOOTER, SEEK_END)
            summary = int.from_bytes(file.read()[9:17], "little")
            reader.data_start, reader.data_end = len(MCAP_MAGIC), summary or end
            if summary:
                reader.read_index()
            if not (reader.statistics and reader.schemas):
                reader.meta_scan()
            require_checksums(path, has_chunks=bool(reader.chunks))
        except Exception:
            reader.close()
            raise
        read_mcap_as_it_lies(reader)
        assert reader.statistics
        counts = reader.statistics.channel_message_counts
        self.start_time: int = reader.statistics.start_time
        """The first stamp of its log [ns]."""
        self.end_time: int = reader.statistics.end_time
        """The last stamp of its log [ns]."""
        self.connections: list[Connection] = [
            connection._replace(msgcount=counts.get(connection.id, 0))
            for connection in reader.connections
        ]

    def messages(
        self, connections: "list[Connection]", start: int | None = None, stop: int | None = None
    ) -> "Iterator[tuple[Connection, int, bytes]]":
        """The messages in the order of the log."""
        return self.storage.messages(connections, start, stop)

    def close(self) -> None:
        """Close the file."""
        self.storage.close()


def read_bag_as_it_lies(reader: "Reader") -> None:
    """Make the reader of a ROS 1 bag read in the order of the file if its log goes back."""
    infos = sorted(reader.chunk_infos, key=lambda info: info.pos)
    if _may_go_back([(info.start_time, info.end_time) for info in infos]):
        entries = _as_they_lie(reader, reader.indexes)
        if _was_set_back((number, entry.time) for entry, number in entries):
            _set_messages(reader, partial(_bag_messages, reader))


def read_mcap_as_it_lies(reader: "McapReader") -> None:
    """Make the reader of an MCAP file read in the order of the file if its log goes back.

    One without chunks is always read so, as there is no index by which it could be sorted.
    """
    chunks = sorted(reader.chunks, key=lambda chunk: chunk.chunk_start_offset)
    spans = [(chunk.message_start_time, chunk.message_end_time) for chunk in chunks]
    if chunks and not _may_go_back(spans):
        return
    with suppress(Exception):  # of many kinds; damage is reported when it is read
        messages = reader.messages_scan(reader.connections)
        if not chunks or _was_set_back((link.id, stamp) for link, stamp, _ in messages):
            _set_messages(reader, reader.messages_scan)


def _set_messages(reader: Any, messages: Any) -> None:
    reader.messages = messages


def _may_go_back(spans: list[Span]) -> bool:
    """Whether a chunk begins before an earlier one ends, or there is only one."""
    newest = 0
    for begin, end in spans:
        if begin < newest - LONGEST_FALL:
            return True
        newest = max(newest, end)
    return len(spans) == 1


def _was_set_back(logged: Iterable[tuple[int, int]]) -> bool:
    """Whether a clock was set back.

    Args:
        logged: channel number and stamp [ns] of each message, in the order of the file.
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
    """The entries of the index of some channels with their numbers."""
    entries = [(entry, number) for number in numbers for entry in reader.indexes[number]]
    return sorted(entries, key=lambda item: (item[0].chunk_pos, item[0].offset))


def _bag_messages(
    reader: Any,
    connections: "Collection[Connection]",
    start: int | None = None,
    stop: int | None = None,
) -> "Iterator[tuple[Connection, int, bytes]]":
    """The messages of a bag as rosbags reads them, but in the order of the file."""
    from rosbags.rosbag1.reader import Header, RecordType, read_bytes, read_uint32

    known = {connection.id: connection for connection in connections}
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


@cache
def bound_rosbags() -> None:
    """Bound what the readers of rosbags unpack by `contactfusion.unpacking`.

    A longer quality of service of a channel than any, which is YAML, is not parsed.
    """
    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import storage_mcap as mcap

    ros2: Any = import_module("rosbags.rosbag2.reader")
    zstd = ros2.zstd  # of the standard library, from Python 3.14 on
    unpackers = {
        "bz2": bz2.BZ2Decompressor,
        "lz4": LZ4FrameDecompressor,
        "zstd": zstd.ZstdDecompressor,
    }
    ros1.decompressors |= {
        name: partial(unpacked, unpacker=unpackers[name]) for name in ("bz2", "lz4")
    }
    bound_sqlite()
    for storage in ("storage_mcap", "storage_sqlite3"):
        module: Any = import_module(f"rosbags.rosbag2.{storage}")
        module.parse_qos = partial(_bounded_qos, module.parse_qos)
    mcap.DECOMPRESSORS |= {name: _of_chunk(unpackers[name]) for name in ("lz4", "zstd")}
    ros2.zstd = SimpleNamespace(
        decompress=partial(unpacked, unpacker=zstd.ZstdDecompressor),
        open=partial(_Bounded, zstd.ZstdFile),
    )


def _bounded_qos(parse: Callable[[Any], list[Any]], given: Any) -> list[Any]:
    """The quality of service of a channel as rosbags parses it; nothing of a longer text."""
    return [] if isinstance(given, str) and len(given) > LONGEST_QOS else parse(given)


def _of_chunk(unpacker: Callable[[], Unpacker]) -> Callable[[bytes, int], bytes]:
    """The decompressor of a chunk of MCAP, which states its size [bytes]."""
    return lambda packed, size: unpacked(packed, unpacker, size)


class _Bounded:
    """A file that is packed as a whole, to be read; use as a context manager.

    Args:
        kind: what unpacks files.
        packed: the file.
        mode: that of reading.
    """

    def __init__(self, kind: Any, packed: IO[bytes], mode: str) -> None:
        self._file = kind(packed, mode)
        self._room = most_bytes(os.fstat(packed.fileno()).st_size)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def read(self, size: int) -> bytes:
        """The next bytes.

        Raises:
            ValueError: there are more than there may be.
        """
        read: bytes = self._file.read(size)
        self._room -= len(read)
        if self._room < 0:
            raise ValueError("a packed file unpacks to too much")
        return read
