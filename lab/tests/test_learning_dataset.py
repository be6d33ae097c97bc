"""Labelled trials, kept bit for bit, and their windows, as a naive loop makes them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.files import read_arrays, write_npz
from contactfusion_lab.learning.dataset import (
    ARRAYS,
    NAMED,
    Dataset,
    LabelledTrial,
    Windows,
    content_of,
    load,
)
from lab.tests.learning_toys import toy_trial, toy_trials

TRIAL = toy_trial(3, "validation", cycles=25)


def test_a_trial_is_read_as_it_was_written(tmp_path: Path) -> None:
    (tmp_path / "trial.npz").write_bytes(content_of(TRIAL))
    again = load(tmp_path / "trial.npz")
    assert [getattr(again, name) for name in NAMED] == [getattr(TRIAL, name) for name in NAMED]
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
    path.write_bytes(content_of(TRIAL))
    held: dict[str, Any] = read_arrays(path)
    write_npz(path, **(held | {"kind": held["kind"] + 9}))
    with pytest.raises(ConfigurationError, match=r"trial.npz: kind holds"):
        load(path)
    for text in ("[]", "3", "[" * 100_000):
        write_npz(path, **(held | {"told": text}))
        with pytest.raises(ConfigurationError, match=r"trial.npz is no labelled trial"):
            load(path)
    del held["stamp"]
    write_npz(path, **held)
    with pytest.raises(ConfigurationError, match="lacks stamp"):
        load(path)


def naive_windows(trials: list[LabelledTrial]) -> list[tuple[FloatArray, int, float]]:
    found = []
    for trial in trials:
        for mounting in range(len(trial.mountings)):
            for end in range(len(trial.stamp)):
                rows = [max(end - back, 0) for back in reversed(range(20))]
                window = np.array([trial.descriptors[mounting][row] for row in rows])
                found.append((window, int(trial.kind[end]), float(trial.lateral[end])))
    return found


def test_windows_are_those_of_a_naive_loop() -> None:
    trials = [
        toy_trial(0, "training", cycles=33),
        toy_trial(1, "training", cycles=1),
        toy_trial(2, "training", cycles=7, mountings=3),
    ]
    naive, windows = naive_windows(trials), Windows.of(trials)
    assert len(windows) == len(naive) == 2 * 33 + 2 + 3 * 7
    gathered = windows.gather(np.arange(len(windows)))
    assert gathered.tobytes() == np.array([window for window, _, _ in naive]).tobytes()
    assert windows.kind.tolist() == [kind for _, kind, _ in naive]
    assert windows.lateral == pytest.approx([at for _, _, at in naive], nan_ok=True)
    assert windows.touching.tolist() == [row for row, each in enumerate(naive) if each[1]]


def test_windows_are_gathered_in_the_order_that_is_asked_for() -> None:
    windows = Windows.of([toy_trial(0, "training")])
    everything = windows.gather(np.arange(len(windows)))
    assert np.array_equal(windows.gather(np.array([50, 3, 3])), everything[[50, 3, 3]])


def test_scales_come_from_the_training_trials_alone() -> None:
    trials = toy_trials(3, 2)
    trials[-1] = replace(
        trials[-1],
        descriptors=trials[-1].descriptors * 3.0,
        lateral=np.where(trials[-1].kind > 0, 0.9, np.nan),
    )
    data, training = Dataset.of(trials), trials[:3]
    assert data.length.minimum == min(trial.descriptors.min() for trial in training)
    assert data.length.maximum == max(trial.descriptors.max() for trial in training)
    assert data.lateral.minimum == min(np.nanmin(trial.lateral) for trial in training)
    assert data.lateral.maximum == max(np.nanmax(trial.lateral) for trial in training)
    assert data.length.scaled([data.length.minimum, data.length.maximum]).tolist() == [0.0, 1.0]
    assert data.lateral.unscaled(data.lateral.scaled(0.1)) == pytest.approx(0.1)


def test_splits_are_kept_apart_and_tests_left_out() -> None:
    trials = [*toy_trials(3, 2), toy_trial(0, "test")]
    data = Dataset.of(trials)
    assert len(data.training) == 3 * 2 * 60
    assert len(data.validation) == 2 * 2 * 60
    assert Dataset.of(trials[:-1]).sha256 == data.sha256


def test_the_hash_changes_with_any_change() -> None:
    trials = toy_trials(2, 1)
    hashes = {Dataset.of(trials).sha256, Dataset.of(trials[::-1]).sha256}
    stamp = trials[0].stamp + 1e-9
    hashes.add(Dataset.of([replace(trials[0], stamp=stamp), *trials[1:]]).sha256)
    hashes.add(Dataset.of([replace(trials[0], round=1), *trials[1:]]).sha256)
    assert len(hashes) == 4
    assert Dataset.of(toy_trials(2, 1)).sha256 in hashes


def test_data_that_cannot_be_learned_from_are_reported() -> None:
    with pytest.raises(ConfigurationError, match="none of the 0 trials for validation has"):
        Dataset.of(toy_trials(2, 0))
    never = replace(
        toy_trial(0, "training"), kind=np.zeros(60, np.uint8), lateral=np.full(60, np.nan)
    )
    with pytest.raises(ConfigurationError, match="none of the 1 trials for training has contact"):
        Dataset.of([never, toy_trial(0, "validation")])
    narrow = toy_trial(1, "training")
    narrow = replace(narrow, descriptors=narrow.descriptors[:, :, :11])
    with pytest.raises(ConfigurationError, match="training-1 has 11 proximity lengths"):
        Dataset.of([toy_trial(0, "training"), narrow])
    same = toy_trial(0, "training")
    same = replace(same, lateral=np.where(same.kind > 0, 0.1, np.nan))
    with pytest.raises(ConfigurationError, match="every location of the training trials is 0.1 m"):
        Dataset.of([same, toy_trial(0, "validation")])
