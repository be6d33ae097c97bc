"""Checksums of MCAP files: written into ours, and required to fit where any file has them.

Chunks, the index and the whole of the data have one each (CRC-32, https://mcap.dev/spec). rosbags
writes none, and checks those of chunks; the others are checked here.
"""

import struct
from functools import cache
from os import SEEK_END
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, NamedTuple
from zlib import crc32

if TYPE_CHECKING:
    from rosbags.rosbag2 import Writer

FOOTER: Final = 37
"""Length of the last record, with the magic after it [bytes]."""
DATA_END: Final = 13
"""Length of the record that ends the data [bytes]."""
IN_CHUNK: Final = 33
"""Offset of the checksum in the record of a chunk [bytes]."""
PIECE: Final = 2**22
"""The size of a step of reading [bytes]."""


class _Ends(NamedTuple):
    """The ends of the parts of a file [bytes], and the checksums in it; 0 where there is none.

    Attributes:
        data: the end of what the checksum of the data is of.
        summary: the start of the index; 0 where there is none.
        footer: the end of what the checksum of the index is of.
        of_data: checksum.
        of_summary: checksum.
    """

    data: int
    summary: int
    footer: int
    of_data: int
    of_summary: int


def require_checksums(path: Path, has_chunks: bool) -> None:
    """Refuse an MCAP file whose index does not fit its checksum; without chunks, also its data.

    Args:
        path: a file with its end.
        has_chunks: whether its messages lie in chunks, which have checksums of their own.

    Raises:
        ValueError: it does not fit.
    """
    with path.open("rb") as file:
        ends = _ends(file)
        if ends.of_summary and ends.of_summary != _checksum(file, ends.summary, ends.footer):
            raise ValueError("its index does not fit its checksum")
        if ends.of_data and not has_chunks and ends.of_data != _checksum(file, 0, ends.data):
            raise ValueError("its data do not fit their checksum")


@cache
def writer_with_checksums() -> "type[Writer]":
    """The writer of rosbag2 whose MCAP files have checksums."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.rosbag2.storage_mcap import McapWriter

    class Checked(McapWriter):
        def close_chunk(self) -> None:
            checksum, start = crc32(self.chunk.bio.getbuffer()), self.bio.tell()
            super().close_chunk()
            end = self.bio.tell()
            _put(self.bio, start + IN_CHUNK, checksum)
            self.bio.seek(end)

        def close(self, version: int, metadata: str) -> None:
            super().close(version, metadata)
            with self.path.open("r+b") as file:
                ends = _ends(file)
                _put(file, ends.data + 9, _checksum(file, 0, ends.data))
                _put(file, ends.footer, _checksum(file, ends.summary, ends.footer))

    class CheckedWriter(Writer):
        STORAGE_PLUGINS: Any = {StoragePlugin.MCAP: Checked}

    return CheckedWriter


def _ends(file: IO[bytes]) -> _Ends:
    footer = file.seek(-FOOTER, SEEK_END)
    summary, of_summary = struct.unpack_from("<Q8xI", file.read(), 9)
    data = (summary or footer) - DATA_END
    file.seek(max(data, 0))
    kind, length, of_data = struct.unpack("<BQI", file.read(DATA_END))
    if (kind, length) != (0x0F, 4):
        data = of_data = 0
    return _Ends(data, summary, footer + 25, of_data, of_summary)


def _checksum(file: IO[bytes], start: int, end: int) -> int:
    """The checksum of the bytes from one place to another."""
    file.seek(start)
    checksum, left = 0, end - start
    while left > 0 and (piece := file.read(min(PIECE, left))):
        checksum, left = crc32(piece, checksum), left - len(piece)
    return checksum


def _put(file: IO[bytes], at: int, checksum: int) -> None:
    file.seek(at)
    file.write(struct.pack("<I", checksum))
