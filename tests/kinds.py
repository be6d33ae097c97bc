"""Kinds of reading that are installed for one test."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from contactfusion.readings.codec import Codec
from contactfusion.readings.registry import GROUP, installed_kinds
from contactfusion.recordings.messages import typestore


class Stranger:
    """A distribution that is installed for one test, and whose modules are written as it goes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        info = folder / "stranger-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
        self.points = info / "entry_points.txt"
        self.points.write_text(f"[{GROUP}]\n")

    def add(self, name: str, text: str, module: str = "") -> None:
        """Add a kind."""
        module = module or f"cf_{name}"
        (self.folder / f"{module}.py").write_text(text)
        with self.points.open("a") as file:
            file.write(f"{name} = {module}:TheCodec\n")
        installed_kinds.cache_clear()
        typestore.cache_clear()


def codec_of(name: str) -> Codec[Any]:
    """The codec of a kind that there is."""
    codec = installed_kinds().find(name)
    assert codec is not None
    return codec


@contextmanager
def installed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stranger]:
    """A stranger's distribution in a folder, which becomes the working folder."""
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.chdir(folder)
    yield Stranger(folder)
    for name in [name for name in sys.modules if name.startswith("cf_")]:
        del sys.modules[name]
    installed_kinds.cache_clear()
    typestore.cache_clear()
