"""Arrays in npz files: read with errors that say what is missing, written whole."""

import io
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contactfusion.errors import ConfigurationError
from contactfusion.files import require_file, write_whole
from contactfusion.unpacking import require_arrays

BROKEN = (
    EOFError,
    MemoryError,
    NotImplementedError,
    OSError,
    RecursionError,
    TypeError,
    ValueError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What numpy and zipfile raise when a file is none of their own, or packed in an unknown way."""


def read_npz(path: Path, *names: str) -> list[NDArray[Any]]:
    """Read the arrays of these names.

    Raises:
        ConfigurationError: the file is missing, is no npz file, or lacks an array.
    """
    held = read_arrays(path, *names)
    return [held[name] for name in names]


def read_arrays(path: Path, *names: str) -> dict[str, NDArray[Any]]:
    """Read all arrays by their names; those of `names` must be there.

    Raises:
        ConfigurationError: the file is missing, is no npz file, or lacks an array.
    """
    require_file(path, ConfigurationError)
    try:
        require_arrays(path)
        with path.open("rb") as file, np.load(file) as arrays:
            held = {name: arrays[name] for name in arrays}
    except BROKEN as error:
        raise ConfigurationError(
            f"{path} is no npz file of numbers, or is cut off: {error}"
        ) from None
    if missing := [name for name in names if name not in held]:
        holds = ", ".join(held) or "nothing"
        raise ConfigurationError(f"{path} lacks {' and '.join(missing)}; it holds {holds}")
    return held


def write_npz(path: str | Path, **arrays: ArrayLike) -> None:
    """Write arrays by their names; the file appears whole or not at all."""
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **{name: np.asarray(a) for name, a in arrays.items()})
    write_whole(path, content.getvalue())
