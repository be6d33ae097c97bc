"""Files that a recorder left without an end: what is whole is found by a scan (extra `record`).

rosbags opens files by the index at their end, and so none that lack it. Its readers are given here
what the index would have told them.
"""

from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from contactfusion.recordings.ros.mcap import MCAP_MAGIC, Schemas

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader

BAG_MAGIC = b"#ROSBAG V2.0\n"
CHUNK, CONNECTION, MESSAGE = 5, 7, 2
"""Records of a ROS 1 bag."""
MENDED_BY = {
    ".bag": "rosbag reindex {path}",
    ".active": "rosbag reindex {path}",
    ".mcap": "mcap recover {path} -o MENDED.mcap",
    ".db3": "ros2 bag reindex {path.parent}",
}
"""The commands that mend files, by how they end."""


def mended_by(path: Path) -> str:
    """Give the command that mends a file, or a folder of rosbag2."""
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

        self._reader = McapReader(path)
        self._reader.schemas = Schemas()
        self._reader.bio = path.open("rb")
        self._reader.data_start = len(MCAP_MAGIC)
        self._reader.data_end = path.stat().st_size
        with suppress(Exception):  # the scan finds the end of what is whole by an error
            self._reader.meta_scan()
        counts: dict[int, int] = {}
        self.start_time = 2**63 - 1
        """The first stamp of its log [ns]."""
        self.end_time = 0
        """The last stamp of its log [ns]."""
        with suppress(Exception):
            for connection, stamp, _ in self._reader.messages_scan(self._reader.connections):
                counts[connection.id] = counts.get(connection.id, 0) + 1
                self.start_time = min(self.start_time, stamp)
                self.end_time = max(self.end_time, stamp)
        self.connections: list[Connection] = [
            one._replace(msgcount=counts.get(one.id, 0)) for one in self._reader.connections
        ]

    def messages(
        self, connections: "list[Connection]", start: int | None = None, stop: int | None = None
    ) -> "Iterator[tuple[Connection, int, bytes]]":
        """Give the messages as they lie in the file, until it ends or an error tells so."""
        return self._reader.messages_scan(connections, start, stop)

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


def scanned_bag(path: Path) -> "Reader":
    """Give the reader of a ROS 1 bag that has no index, with that of its whole chunks.

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
    _tell_times(reader, stamps)
    for number, one in enumerate(reader.connections):
        index = reader.indexes.setdefault(one.id, [])
        index.sort()
        reader.connections[number] = one._replace(msgcount=len(index))
    return reader


def _index(reader: "Reader", at: int, content: bytes) -> None:
    """Add the connections and the messages of a chunk at a place in the file."""
    from rosbags.rosbag1.reader import Header, IndexData, read_uint32

    inside, file = BytesIO(content), reader.bio
    known = {one.id for one in reader.connections}
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


def _tell_times(reader: "Reader", stamps: list[int]) -> None:
    from rosbags.rosbag1.reader import ChunkInfo

    if stamps:
        reader.chunk_infos.append(ChunkInfo(0, min(stamps), max(stamps) + 1, {}))
