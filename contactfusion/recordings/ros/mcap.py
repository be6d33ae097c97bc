"""MCAP files that rosbags does not open: of ROS 1, or with channels that no ROS wrote."""

from os import SEEK_END
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, final

from contactfusion.recordings.ros.backwards import read_mcap_as_it_lies

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosbags.interfaces import Connection

MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
"""What a file begins and ends with."""
FOOTER: Final = 37
"""How long the last record is, with the magic after it [bytes]."""
ROS1_IN_MCAP: Final = "ros1"
"""What a channel of ROS 1 calls its encoding; `mcap convert` makes such files of bags."""
KNOWN: Final = ("ros2msg", "ros2idl", "omgidl", "")
"""The encodings of definitions that rosbags knows."""


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

        self._reader = reader = McapReader(path)
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
            one._replace(msgcount=counts.get(one.id, 0)) for one in reader.connections
        ]

    def messages(
        self, connections: "list[Connection]", start: int | None = None, stop: int | None = None
    ) -> "Iterator[tuple[Connection, int, bytes]]":
        """Give the messages in the order of the log."""
        return self._reader.messages(connections, start, stop)

    def close(self) -> None:
        """Close the file."""
        self._reader.close()
