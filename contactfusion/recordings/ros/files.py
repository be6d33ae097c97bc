"""Bags of ROS 1 and 2 and MCAP files as one: their channels and messages (extra `record`)."""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from heapq import heappop, heappush
from os import SEEK_END
from pathlib import Path
from types import TracebackType
from typing import Any, Self, final

from contactfusion.errors import RecordingError
from contactfusion.files import require_file
from contactfusion.recordings.checksums import require_checksums
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.ros.channels import Channel, channel_of
from contactfusion.recordings.ros.readers import (
    BAG_MAGIC,
    MCAP_MAGIC,
    ROS1_IN_MCAP,
    AnyMcap,
    ScannedMcap,
    bound_rosbags,
    mended_by,
    read_bag_as_it_lies,
    read_mcap_as_it_lies,
    scanned_bag,
)
from contactfusion.yaml_files import LARGEST

ROS1 = (".bag", ".active")
"""Suffixes of bags of ROS 1; `.bag.active` is one whose recorder was killed."""
ROS2 = (".mcap", ".db3")
MOST_OPEN = 32
"""The number of files of a folder that stay open; others are opened when they are due."""
Logged = tuple[Channel, int, bytes]
"""A message: its channel, its stamp in the log [ns], and its bytes as in the file."""


@dataclass(eq=False)
class _File:
    """A file: its reader, of rosbags, its channels, its stamps, and what is wrong with it."""

    path: Path
    reader: Any
    is_cut: bool
    is_open: bool = True
    channels: dict[int, Channel] = field(default_factory=dict)
    first_ns: int = 0
    last_ns: int = 0
    problem: str = ""

    def __post_init__(self) -> None:
        """Make the channels."""
        self.first_ns, self.last_ns = self.reader.start_time, self.reader.end_time
        alike: Counter[str] = Counter()
        for connection in self.reader.connections:
            alike[connection.topic] += 1
            ros1 = _is_ros1(self.path) or connection.ext.serialization_format == ROS1_IN_MCAP
            number = alike[connection.topic]
            self.channels[connection.id] = channel_of(connection, number, ros1=ros1)

    @property
    def count(self) -> int:
        """The number of its messages."""
        return sum(channel.count for channel in self.channels.values())


@final
class Bag:
    """A recording of ROS of one file or of a folder of several; use as a context manager.

    Args:
        path: a `.bag`, `.db3` or `.mcap`, a folder of rosbag2, or one of files without metadata.

    Raises:
        DependencyError: rosbags is not installed.
        RecordingError: there is no such file, or none of it can be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: list[Channel] = []
        """All channels."""
        self.first_ns = 0
        """Stamp of its first message in the log [ns]."""
        self.last_ns = 0
        """Stamp of its last message in the log [ns]."""
        self._files: list[_File] = []
        self._lost: list[str] = []
        """Problems of files that can't be read at all."""
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        """Open all files; of many, the later ones are closed until their messages are due."""
        typestore()
        bound_rosbags()
        with ExitStack() as stack:
            for path in _files_in(self.path):
                try:
                    file = _opened(path)
                except RecordingError as error:  # of several files, the others are read
                    self._lost.append(str(error))
                    continue
                self._files.append(file)
                if len(self._files) <= MOST_OPEN:
                    stack.callback(file.reader.close)
                else:
                    file.reader.close()
                    file.is_open = False
            if not self._files:
                raise RecordingError(self._lost[0])
            self._stack = stack.pop_all()
        self.channels = [channel for file in self._files for channel in file.channels.values()]
        filled = [file for file in self._files if file.count]
        self.first_ns = min((file.first_ns for file in filled), default=0)
        self.last_ns = max((file.last_ns for file in filled), default=0)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close all files."""
        self._stack.close()

    def messages(
        self, channels: Collection[Channel], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Logged]:
        """The messages in the order of the log.

        Args:
            channels: of this bag.
            start_ns: earliest stamp in the log [ns].
            stop_ns: stamp in the log before which messages end [ns].

        Raises:
            RecordingError: at the end, when a file is cut off or damaged.
        """
        parts = [self._messages(file, channels, start_ns, stop_ns) for file in self._files]
        yield from _merged([file.first_ns for file in self._files], parts)
        for problem in filter(None, (*(file.problem for file in self._files), *self._lost)):
            raise RecordingError(problem)

    def _messages(
        self, file: _File, channels: Collection[Channel], start: int | None, stop: int | None
    ) -> Iterator[Logged]:
        table = file.channels
        if not any(channel in channels for channel in table.values()):
            return
        given, reader = 0, file.reader
        mend = mended_by(file.path)
        file.problem = (
            f"{file.path} is cut off after {file.count} messages; mend it by: {mend}"
            if file.is_cut
            else ""
        )
        try:
            with ExitStack() as stack:
                if not file.is_open:
                    reader = _opened(file.path).reader
                    stack.callback(reader.close)
                wanted = [link for link in reader.connections if table[link.id] in channels]
                for connection, stamp, raw in reader.messages(wanted, start, stop):
                    given += 1
                    yield table[connection.id], stamp, raw
        except Exception as error:  # rosbags raises errors of many kinds for damage
            why = f"{_why(error).rstrip('.')}{_chunk_of(reader)}"
            file.problem = file.problem or (
                f"{file.path} is damaged after {given} messages ({why}); mend it by: {mend}"
            )


def _merged(first_ns: Sequence[int], parts: Sequence[Iterator[Logged]]) -> Iterator[Logged]:
    """Messages of files in the order of the log; none is begun before its first one is due.

    Args:
        first_ns: the first stamp of each file [ns].
        parts: its messages.
    """
    later = sorted(range(len(parts)), key=first_ns.__getitem__, reverse=True)
    due: list[tuple[int, int, Logged]] = []

    def take(number: int) -> None:
        if (logged := next(parts[number], None)) is not None:
            heappush(due, (logged[1], number, logged))

    while due or later:
        while later and (not due or first_ns[later[-1]] <= due[0][0]):
            take(later.pop())
        if due:
            _, number, logged = heappop(due)
            yield logged
            take(number)


def _is_ros1(path: Path) -> bool:
    return path.suffix in ROS1 and path.is_file()


def _files_in(path: Path) -> list[Path]:
    """The paths that rosbags opens: a file, a folder of rosbag2, or each file of another folder."""
    if not path.is_dir():
        require_file(path, RecordingError)
        return [path]
    whole = not any(_lacks_its_end(file) for file in path.glob("*.mcap") if file.is_file())
    metadata = path / "metadata.yaml"
    if whole and metadata.is_file() and metadata.stat().st_size <= LARGEST:
        for entry in path.iterdir():  # the metadata may name any of them
            if not entry.is_dir() and entry.exists():
                require_file(entry, RecordingError)
        return [path]
    kinds = (*ROS1, *ROS2)
    files = sorted(file for file in path.iterdir() if file.suffix in kinds and file.is_file())
    if not files:
        raise RecordingError(f"there is no {', '.join(kinds)} in the folder {path}")
    return files


def _opened(path: Path) -> _File:
    from rosbags.rosbag1 import Reader as Bag1
    from rosbags.rosbag2 import Reader as Bag2

    try:
        with ExitStack() as stack:
            reader = Bag1(path) if _is_ros1(path) else Bag2(path)
            reader.open()
            stack.callback(reader.close)
            _checked(reader)
            opened = _File(path, reader, is_cut=False)
            stack.pop_all()
            return opened
    except Exception as error:  # of many kinds
        file = _of_others(path) or _scanned(path)
        if file is None:
            raise RecordingError(f"{path} can't be read: {_why(error)}") from None
        if file.is_cut and not file.count:
            file.reader.close()
            raise RecordingError(
                f"{path} can't be read: it is cut off before its first message; "
                f"what may mend it: {mended_by(path)}"
            ) from None
        return file


def _why(error: Exception) -> str:
    """The problem that rosbags reported; for records longer than the file it has no words."""
    return " ".join(str(error).split()) or "it promises more than fits into memory"


def _checked(reader: Any) -> None:
    """Require checksums to fit, and keep messages after a clock was set back in their place."""
    from rosbags.rosbag1 import Reader as Bag1

    if isinstance(reader, Bag1):
        read_bag_as_it_lies(reader)
    for storage in _mcaps(reader):
        require_checksums(Path(storage.path), has_chunks=bool(storage.chunks))
        read_mcap_as_it_lies(storage)


def _mcaps(reader: Any) -> list[Any]:
    """The readers of MCAP files of a reader."""
    from rosbags.rosbag2.storage_mcap import McapReader

    storage = getattr(reader, "storage", None)
    storages = getattr(storage, "storages", (storage,))
    return [each for each in storages if isinstance(each, McapReader)]


def _chunk_of(reader: Any) -> str:
    """The clause on the chunk of an MCAP file that was read last; empty for others."""
    mcaps = _mcaps(reader)
    if len(mcaps) != 1 or not mcaps[0].chunks or not mcaps[0].bio:
        return ""
    at = mcaps[0].bio.tell()
    starts = [chunk.chunk_start_offset for chunk in mcaps[0].chunks]
    before = sum(start < at for start in starts)
    return f", in chunk {before} of {len(starts)}, which ends at byte {at}"


def _of_others(path: Path) -> _File | None:
    """An MCAP file that is complete, but not of ROS 2 alone."""
    if path.suffix == ".mcap" and path.is_file() and not _lacks_its_end(path):
        with suppress(Exception), ExitStack() as stack:  # of many kinds: then it is no such file
            reader = AnyMcap(path)
            stack.callback(reader.close)
            file = _File(path, reader, is_cut=False)
            stack.pop_all()
            return file
    return None


def _scanned(path: Path) -> _File | None:
    """A file that lacks its end; None when it is none of which a part can be read."""
    if _lacks_its_end(path) and _begins(path, MCAP_MAGIC):
        return _File(path, ScannedMcap(path), is_cut=True)
    if path.suffix in ROS1 and _begins(path, BAG_MAGIC):
        reader = scanned_bag(path)
        read_bag_as_it_lies(reader)
        return _File(path, reader, is_cut=True)
    return None


def _lacks_its_end(path: Path) -> bool:
    """Whether this is the beginning of an MCAP file, or an empty file."""
    if path.suffix != ".mcap" or not path.is_file():
        return False
    with suppress(OSError), path.open("rb") as file:
        begins = file.read(len(MCAP_MAGIC))
        file.seek(-min(len(MCAP_MAGIC), path.stat().st_size), SEEK_END)
        return begins in (MCAP_MAGIC, b"") and file.read() != MCAP_MAGIC
    return False


def _begins(path: Path, magic: bytes) -> bool:
    with suppress(OSError), path.open("rb") as file:
        return file.read(len(magic)) == magic
    return False
