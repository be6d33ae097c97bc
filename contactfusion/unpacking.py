"""Limits of packed files: a few kilobytes can unpack to more than any memory."""

import math
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from tokenize import TokenError
from typing import IO, Final, Protocol

import numpy as np

from contactfusion.limits import raised

TIMES: Final = 100
"""The greatest ratio of unpacked to packed size, unless it is small."""
SMALL: Final = 2**28
"""The size up to which any ratio is allowed [bytes]."""
TOO_MANY: Final = f"more than {TIMES} times as many"
STEP: Final = 2**22
"""The size of a step of unpacking [bytes]."""


class Unpacker(Protocol):
    """The unpacker of one stream, as those of bz2, lz4 and zstd."""

    @property
    def eof(self) -> bool:
        """Whether the stream has ended."""
        ...

    @property
    def needs_input(self) -> bool:
        """Whether no more can be unpacked of the input so far."""
        ...

    @property
    def unused_data(self) -> bytes | None:
        """The input after its end."""
        ...

    def decompress(self, data: bytes, max_length: int = -1) -> bytes:
        """At most this number of bytes of the stream."""
        ...


def most_bytes(packed: int) -> int:
    """The greatest size to which packed bytes may unpack [bytes]."""
    return round(raised(max(SMALL, TIMES * packed)))


def unpacked(packed: bytes, unpacker: Callable[[], Unpacker], most: int | None = None) -> bytes:
    """The content of packed bytes, of one stream or of several.

    Args:
        packed: the bytes.
        unpacker: makes the unpacker of one stream.
        most: size of the content by the file [bytes]; None: the file does not hold it.

    Raises:
        ValueError: there are more bytes than the file declares, or than allowed; or a stream is cut
            off.
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
                raise ValueError(
                    f"{len(packed)} packed bytes unpack to more than the {most} stated"
                )
            if size > limit:
                raise ValueError(f"{len(packed)} packed bytes unpack to over {limit}, {TOO_MANY}")
        rest = stream.unused_data or b""
    return b"".join(parts)


def require_zip(archive: zipfile.ZipFile, size: int) -> None:
    """Refuse a zip file of some size [bytes] that would unpack to more than allowed.

    Raises:
        ValueError: it does.
    """
    whole = sum(member.file_size for member in archive.infolist())
    if whole > most_bytes(size):
        raise ValueError(f"{size} packed bytes that would unpack to {whole}, {TOO_MANY}")


def require_arrays(path: Path) -> None:
    """Refuse an `.npy` or `.npz` with fewer numbers than its shapes declare.

    Raises:
        ValueError: it has fewer, or is no file of NumPy; the latter is also reported by `OSError`,
            `zlib.error` and `zipfile.BadZipFile`.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        if not zipfile.is_zipfile(file):
            file.seek(0)
            _require_array(file, size, "it")
            return
        with zipfile.ZipFile(file) as archive:
            require_zip(archive, size)
            for entry in archive.infolist():
                with archive.open(entry) as member:
                    label = f"'{entry.filename.removesuffix('.npy')}'"
                    _require_array(member, entry.file_size, label)


def _require_array(file: IO[bytes], size: int, label: str) -> None:
    form = np.lib.format
    version = form.read_magic(file)
    read = form.read_array_header_1_0 if version == (1, 0) else form.read_array_header_2_0
    try:
        shape, _, dtype = read(file)
    except TokenError as error:
        raise ValueError(f"the header of {label} is damaged: {error.args[0]}") from None
    for length in shape:
        if not 0 <= length <= sys.maxsize:  # NumPy meets it with errors of other kinds
            raise ValueError(f"{label} promises an axis of {length} numbers")
    promised, held = math.prod(shape) * max(dtype.itemsize, 1), size - file.tell()
    if promised > held and not dtype.hasobject:
        raise ValueError(
            f"{label} promises {' x '.join(map(str, shape))} of {dtype}, that is {promised} bytes, "
            f"and holds {held}"
        )
