"""Files that go along with what is sent to workers, which may have no disk in common with us."""

import hashlib
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from contactfusion.files import write_whole

if TYPE_CHECKING:
    Native = Path
else:
    Native = type(Path())  # a bare Path cannot be derived from before Python 3.12


class ShippedFile(Native):
    """A path that takes its file along where it is pickled, and those beside it of the same stem.

    Where it arrives it is the same path, if the same files are there, and else that of a copy,
    which lasts as long as the process.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        files = sorted(self.parent.glob(f"{self.stem}.*"))
        return _arrived, (str(self), {path.name: path.read_bytes() for path in files})


def _arrived(path: str, files: dict[str, bytes]) -> ShippedFile:
    there = Path(path)
    beside = [there.with_name(name) for name in files]
    if all(one.is_file() and one.read_bytes() == files[one.name] for one in beside):
        return ShippedFile(there)
    digest = hashlib.sha256(b"".join(files.values())).hexdigest()
    folder = Path(_copies().name) / digest
    for name, content in files.items():
        if not (folder / name).is_file():
            write_whole(folder / name, content)
    return ShippedFile(folder / there.name)


@cache
def _copies() -> TemporaryDirectory[str]:
    """The folder of copies; it goes with the process."""
    return TemporaryDirectory(prefix="contactfusion_")
