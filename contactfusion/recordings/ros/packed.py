"""What rosbags unpacks is bounded: its own readers unpack whatever a file stands for."""

import bz2
import os
from collections.abc import Callable
from functools import cache, partial
from importlib import import_module
from types import SimpleNamespace
from typing import IO, Any, Self

from contactfusion.unpacking import Unpacker, most_bytes, unpacked


@cache
def bound_rosbags() -> None:
    """Let the readers of rosbags unpack no more than `contactfusion.unpacking` allows."""
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
    mcap.DECOMPRESSORS |= {name: _of_chunk(unpackers[name]) for name in ("lz4", "zstd")}
    ros2.zstd = SimpleNamespace(
        decompress=partial(unpacked, unpacker=zstd.ZstdDecompressor),
        open=partial(_Bounded, zstd.ZstdFile),
    )


def _of_chunk(unpacker: Callable[[], Unpacker]) -> Callable[[bytes, int], bytes]:
    """What unpacks a chunk of MCAP, which says how many bytes it holds."""
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
