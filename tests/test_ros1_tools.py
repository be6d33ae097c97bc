"""A bag that the tools of ROS 1 wrote, not ours: Debian's python3-rosbag."""

import json
import subprocess
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.pipeline import Step
from contactfusion.readings import JointState, Reading, Transform, Wrench
from contactfusion.recordings.mcap import McapWriter
from contactfusion.run.configuration import Setting
from contactfusion.run.session import Session
from tests.toys import offer_toys

SYSTEM_PYTHON = Path("/usr/bin/python3")
WRITER = Path(__file__).with_name("write_ros1_bag.py")
EPOCH = 1_700_000_000_123_456_789
CONFIG: dict[str, Any] = {
    "generators": {"wrist": {"type": "feeler", "sensor": "ft"}},
    "cycle": {"every": 0.05},
}


@cache
def has_rosbag() -> bool:
    if not SYSTEM_PYTHON.exists():
        return False
    tried = subprocess.run([SYSTEM_PYTHON, "-c", "import rosbag"], capture_output=True, check=False)
    return tried.returncode == 0


pytestmark = pytest.mark.skipif(
    not has_rosbag(), reason="python3-rosbag is not installed: apt-get install python3-rosbag"
)


@pytest.fixture(autouse=True)
def _toys(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_toys(monkeypatch)


def readings() -> Iterator[Reading]:
    for index in range(40):
        stamp = 0.02 * index
        yield Transform(
            stamp=stamp,
            frame="base",
            child_frame="tool",
            sensor="tf",
            position=np.array([0.01 * index, 0.0, 0.0]),
            orientation=np.array([0.0, 0.0, 0.6, 0.8]),
        )
        yield JointState(
            stamp=stamp,
            frame="base",
            sensor="joints",
            names=("elbow", "wrist"),
            positions=np.array([0.1, 0.2 * stamp]),
        )
        force = np.array([0.1025, 0.0025, 0.0025])
        yield Wrench(stamp=stamp, frame="tool", sensor="ft", force=force, torque=np.zeros(3))


def xyz(values: Any) -> dict[str, float]:
    return dict(zip("xyzw", values.tolist(), strict=False))


def line(reading: Reading) -> str:
    stamp = EPOCH + round(reading.stamp * 1e9)
    header = {"frame_id": reading.frame}
    match reading:
        case Wrench():
            wrench = {"force": xyz(reading.force), "torque": xyz(reading.torque)}
            told: Any = ("/ft", "geometry_msgs/WrenchStamped", {"header": header, "wrench": wrench})
        case JointState():
            fields = {"name": reading.names, "position": reading.positions.tolist()}
            told = ("/joints", "sensor_msgs/JointState", {"header": header, **fields})
        case Transform():
            pose = {"translation": xyz(reading.position), "rotation": xyz(reading.orientation)}
            one = {"header": header, "child_frame_id": reading.child_frame, "transform": pose}
            told = ("/tf", "tf2_msgs/TFMessage", {"transforms": [one]})
        case _:
            raise AssertionError(reading)
    topic, kind, fields = told
    return json.dumps([topic, kind, stamp, fields])


def bag(path: Path, told: Iterable[Reading]) -> Path:
    lines = "\n".join(map(line, told))
    subprocess.run([SYSTEM_PYTHON, WRITER, path], input=lines, text=True, check=True)
    return path


def steps(path: Path) -> list[Step]:
    return list(Session(Setting(CONFIG, Path(), {}, Path("robot.yaml")), path).steps())


def test_its_readings_are_those_that_were_written(tmp_path: Path) -> None:
    recording = Session(
        Setting(CONFIG, Path(), {}, Path("robot.yaml")), bag(tmp_path / "a.bag", readings())
    ).stream
    assert recording.epoch_ns == EPOCH
    found, written = list(recording.readings()), list(readings())
    assert [type(one) for one in found] == [type(one) for one in written]
    for one, other in zip(found, written, strict=True):
        assert one.stamp == pytest.approx(other.stamp, abs=1e-9)
        assert (one.frame, one.sensor) == (other.frame, other.sensor)
    assert isinstance(found[-1], Wrench) and isinstance(written[-1], Wrench)
    np.testing.assert_array_equal(found[-1].force, written[-1].force)


def test_its_contacts_are_those_of_the_same_readings_in_mcap(tmp_path: Path) -> None:
    with McapWriter(tmp_path / "a.mcap", EPOCH) as writer:
        for reading in readings():
            writer.reading(reading)
    ours, theirs = steps(tmp_path / "a.mcap"), steps(bag(tmp_path / "a.bag", readings()))
    assert len(ours) == len(theirs) == 16
    for one, other in zip(ours, theirs, strict=True):
        assert (
            one.fusion.contacts[0].position.tolist() == other.fusion.contacts[0].position.tolist()
        )
