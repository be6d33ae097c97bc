"""Arrays in npz files: read with errors that say what is missing, written whole."""

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contactfusion.errors import ConfigurationError
from contactfusion.files import require_file, write_whole


def read_npz(path: Path, *names: str) -> list[NDArray[Any]]:
    """Read the arrays of these names.

    Raises:
        ConfigurationError: the file is missing, is no npz file, or lacks an array.
    """
    require_file(path, ConfigurationError)
    try:
        with np.load(path) as arrays:
            missing = [name for name in names if name not in arrays]
            if missing:
                held = ", ".join(arrays) or "nothing"
                raise ConfigurationError(f"{path} lacks {', '.join(missing)}; it holds {held}")
            return [arrays[name] for name in names]
    except (OSError, EOFError, TypeError, zipfile.BadZipFile):
        raise ConfigurationError(f"{path} is no npz file, or is cut off") from None
    except ValueError as error:
        if isinstance(error, ConfigurationError):
            raise
        raise ConfigurationError(f"{path} is no npz file of numbers") from None


def write_npz(path: Path, **arrays: ArrayLike) -> None:
    """Write arrays by their names; the file appears whole or not at all."""
    content = io.BytesIO()
    np.savez(content, **{name: np.asarray(array) for name, array in arrays.items()})
    write_whole(path, content.getvalue())
