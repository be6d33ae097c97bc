"""Trials of the iCub grasp set."""

from pathlib import Path

import numpy as np
import pytest

from contactfusion.errors import RecordingError
from contactfusion.readings import JointState, TactileImage
from contactfusion.recordings.icub import FINGERS, IcubConfig, IcubRecording
from contactfusion.recordings.opening import open_recording
from tests.real_data import real_data


def frame(offset: float) -> list[str]:
    encoders = " ".join(str(10.0 * joint + offset) for joint in range(9)) + " "
    fingers = [" ".join(f"{200 + 12 * k + i + offset:.1f}" for i in range(12)) for k in range(5)]
    return [encoders, "1.0 2.0 3.0 4.0 5.0", *fingers]


def trial(folder: Path, *lines: str, end: str = "\r\n") -> Path:
    path = folder / "none_1.txt"
    path.write_bytes((end.join(["-10000", *lines]) + end).encode())
    return path


def refusal(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        open_recording(path)
    return str(caught.value)


def test_each_frame_gives_the_joints_and_then_five_fingers(tmp_path: Path) -> None:
    recording = open_recording(trial(tmp_path, *frame(0.0), *frame(1.0)))
    readings = list(recording.readings())
    assert recording.topics == {reading.sensor: type(reading) for reading in readings}
    assert [reading.sensor for reading in readings] == ["hand", *FINGERS] * 2
    assert [reading.stamp for reading in readings] == [0.0] * 6 + [0.1] * 6
    joints, thumb, little = readings[6], readings[1], readings[11]
    assert isinstance(joints, JointState)
    np.testing.assert_allclose(joints.positions, np.radians(10.0 * np.arange(9) + 1.0))
    assert isinstance(thumb, TactileImage) and isinstance(little, TactileImage)
    assert thumb.frame == "thumb"
    np.testing.assert_array_equal(thumb.values, 200.0 + np.arange(12))
    np.testing.assert_array_equal(little.values, 249.0 + np.arange(12))


def test_the_period_can_be_given(tmp_path: Path) -> None:
    path = trial(tmp_path, *frame(0.0), *frame(0.0), end="\n")
    recording = IcubRecording(IcubConfig(file=Path(path.name), period=0.04), tmp_path)
    assert {reading.stamp for reading in recording.readings()} == {0.0, 0.04}


def test_broken_trials_are_refused(tmp_path: Path) -> None:
    lines = frame(0.0)
    assert "is cut off" in refusal(trial(tmp_path, *lines, *lines[:3]))
    assert "is cut off" in refusal(trial(tmp_path))
    whole = trial(tmp_path, *lines, *lines).read_bytes()
    cut = trial(tmp_path)
    cut.write_bytes(whole[:-5])  # the last number becomes 26, and was 260.0
    assert "is cut off: line 15 does not end, and so may its last number" in refusal(cut)
    assert "line 5: 11 numbers instead of 12" in refusal(
        trial(tmp_path, *lines[:3], lines[3].rpartition(" ")[0], *lines[4:])
    )
    assert "line 3: could not convert string to float: 'x'" in refusal(
        trial(tmp_path, lines[0], "1 2 3 4 x", *lines[2:])
    )
    other = tmp_path / "notes.txt"
    other.write_text("hello\n")
    assert "no trial of the iCub grasp set" in refusal(other)


def test_every_real_trial_is_read() -> None:
    folder = real_data("icub_grasp/iCubGraspDataset")
    trials = sorted(folder.glob("*.txt"))
    assert len(trials) == 230
    counts = {}
    for path in trials:
        readings = list(open_recording(path).readings())
        counts[path.stem] = len(readings) // 6
        images = [one.values for one in readings if isinstance(one, TactileImage)]
        assert {image.shape for image in images} == {(12,)}
        assert 0.0 <= np.min(images) and np.max(images) <= 255.0
    assert len([name for name in counts if name.startswith("none_")]) == 22
    assert min(counts.values()) == 4 and max(counts.values()) == 24
    assert counts["blue_bear_1"] == 12
