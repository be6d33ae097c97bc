"""How much a packed file may hold: a few kilobytes can stand for more than any memory."""

import math
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Final, Protocol

import numpy as np

TIMES: Final = 100
"""What unpacks to so many times its size is refused, unless it is small."""
SMALL: Final = 2**28
"""Up to so much, anything may be unpacked [bytes]."""
TOO_MANY: Final = f"more than {TIMES} times as many"
STEP: Final = 2**22
"""So much is unpacked at once [bytes]."""


class Unpacker(Protocol):
    """What unpacks one stream, as those of bz2, lz4 and zstd do."""

    @property
    def eof(self) -> bool:
        """Whether the stream has come to its end."""
        ...

    @property
    def needs_input(self) -> bool:
        """Whether no more can be unpacked of what was given."""
        ...

    @property
    def unused_data(self) -> bytes | None:
        """What stood behind its end."""
        ...

    def decompress(self, data: bytes, max_length: int = -1) -> bytes:
        """At most so many bytes of the stream."""
        ...


def most_bytes(packed: int) -> int:
    """The most that so many bytes may unpack to [bytes]."""
    return max(SMALL, TIMES * packed)


def unpacked(packed: bytes, unpacker: Callable[[], Unpacker], most: int | None = None) -> bytes:
    """What stands in packed bytes, of one stream or of several.

    Args:
        packed: the bytes.
        unpacker: makes what unpacks one stream.
        most: how many bytes the file says that there are; None: it does not say.

    Raises:
        ValueError: there are more than the file says, or than may be; or a stream is cut off.
    """
    limit = most_bytes(len(packed))
    if most is not None and most > limit:
        raise ValueError(f"{len(packed)} packed bytes that would unpack to {most}, {TOO_MANY}")
    size, parts, rest = 0, list[bytes](), packed
    while rest:
        stream = unpacker()
        while not stream.eof:
            if not rest and stream.needs_input:
                raise ValueError("what is packed is cut off")
            parts.append(stream.decompress(rest, STEP))
            rest, size = b"", size + len(parts[-1])
            if most is not None and size > most:
                raise ValueError(f"{len(packed)} packed bytes unpack to more than the {most} told")
            if size > limit:
                raise ValueError(f"{len(packed)} packed bytes unpack to over {limit}, {TOO_MANY}")
        rest = stream.unused_data or b""
    return b"".join(parts)


def require_zip(archive: zipfile.ZipFile, size: int) -> None:
    """Make sure that a zip file of so many bytes does not unpack to more than it may.

    Raises:
        ValueError: it does.
    """
    whole = sum(one.file_size for one in archive.infolist())
    if whole > most_bytes(size):
        raise ValueError(f"{size} packed bytes that would unpack to {whole}, {TOO_MANY}")


def require_arrays(path: Path) -> None:
    """Make sure that an `.npy` or `.npz` holds as many numbers as the shapes in it promise.

    Raises:
        ValueError: it does not, or it is no file of NumPy; so say `OSError`, `zlib.error` and
            `zipfile.BadZipFile`, too.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        if not zipfile.is_zipfile(file):
            file.seek(0)
            _require_array(file, size, "it")
            return
        with zipfile.ZipFile(file) as archive:
            require_zip(archive, size)
            for one in archive.infolist():
                with archive.open(one) as member:
                    _require_array(member, one.file_size, f"'{one.filename.removesuffix('.npy')}'")


def _require_array(file: IO[bytes], size: int, label: str) -> None:
    form = np.lib.format
    version = form.read_magic(file)
    read = form.read_array_header_1_0 if version == (1, 0) else form.read_array_header_2_0
    shape, _, dtype = read(file)
    promised, held = math.prod(shape) * max(dtype.itemsize, 1), size - file.tell()
    if promised > held and not dtype.hasobject:
        raise ValueError(
            f"{label} promises {' x '.join(map(str, shape))} of {dtype}, that is {promised} bytes, "
            f"and holds {held}"
        )
