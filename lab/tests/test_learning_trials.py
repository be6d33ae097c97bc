"""Labelled trials: kept bit for bit, and refused when their arrays do not fit."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError
from contactfusion.npz_files import read_arrays, write_npz
from contactfusion_lab.learning.dataset import ARRAYS, TOLD, load, save
from lab.tests.learning_toys import toy_trial

TRIAL = toy_trial(3, "validation", cycles=25)


def test_a_trial_is_read_as_it_was_written(tmp_path: Path) -> None:
    save(TRIAL, tmp_path / "trial.npz")
    again = load(tmp_path / "trial.npz")
    assert [getattr(again, name) for name in TOLD] == [getattr(TRIAL, name) for name in TOLD]
    for name in ARRAYS:
        assert getattr(again, name).dtype == getattr(TRIAL, name).dtype
        assert getattr(again, name).tobytes() == getattr(TRIAL, name).tobytes()


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"split": "trainig"}, "did you mean 'training'"),
        ({"lateral": TRIAL.lateral[:-1]}, r"lateral have shape \(24,\), not \(25,\)"),
        ({"mountings": ("lidar",)}, r"descriptors have shape \(2, 25, 12\)"),
        ({"descriptors": TRIAL.descriptors * np.nan}, "descriptors is not finite"),
        ({"kind": np.full(25, 3)}, "kind holds 3"),
        ({"lateral": np.zeros(25)}, "a number in contact, and NaN without"),
        ({"mountings": (), "descriptors": np.zeros((0, 25, 12))}, "no cycle, or no mounting"),
    ],
)
def test_trials_that_cannot_be_are_refused(changes: dict[str, Any], what: str) -> None:
    with pytest.raises(ConfigurationError, match=what):
        replace(TRIAL, **changes)


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "trial.npz"
    save(TRIAL, path)
    held: dict[str, Any] = read_arrays(path)
    write_npz(path, **(held | {"kind": held["kind"] + 9}))
    with pytest.raises(ConfigurationError, match=r"trial.npz: kind holds"):
        load(path)
    write_npz(path, **(held | {"told": "[]"}))
    with pytest.raises(ConfigurationError, match=r"trial.npz is no labelled trial"):
        load(path)
    del held["stamp"]
    write_npz(path, **held)
    with pytest.raises(ConfigurationError, match="lacks stamp"):
        load(path)
