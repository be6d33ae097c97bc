"""Real recordings for tests; they stay out of the repository."""

import os
from pathlib import Path

import pytest


def real_data(name: str) -> Path:
    """Give a file or folder of the real recordings, or skip the test when it is not there."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("CONTACTFUSION_DATA") or beside)
    if not (folder / name).exists():
        pytest.skip(f"no {folder / name}: set CONTACTFUSION_DATA to the folder of real recordings")
    return folder / name
