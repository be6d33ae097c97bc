"""Clouds from MCAP files: as others lay them out, as McapWriter writes them, and what is wrong."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import RecordingError
from contactfusion.readings import PointCloud, Reading, Wrench
from contactfusion.recordings.log import LONGEST_FALL
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.mcap_reading import McapConfig, McapRecording
from contactfusion.recordings.messages import header, message, typestore
from contactfusion.recordings.point_clouds import points_of

rosbag2 = pytest.importorskip("rosbags.rosbag2")

EPOCH = 1_700_000_000_123_456_789
POINTS = np.array([[0.5, -0.25, 1.0], [np.nan, np.nan, np.nan], [2.0, 3.0, -4.0], [0.0, 0.0, 0.5]])
SECOND = 1_000_000_000
NUMBERS = {"f4": 7, "f8": 8, "u2": 4}


def cloud(
    points: Any = POINTS,
    stamp: int = EPOCH,
    *,
    order: str = "xyz",
    kind: str = "f4",
    big: bool = False,
    before: int = 0,
    after: int = 0,
    rows: int = 1,
    padding: int = 0,
    frame: str = "lidar",
    **changes: Any,
) -> Any:
    """Lay points out as bytes: fields in an order, with gaps around them, rows with padding."""
    formats = [(">" if big else "<") + kind] * len(order)
    size = np.dtype(formats[0]).itemsize
    offsets = [before + size * i for i in range(len(order))]
    step = before + size * len(order) + after
    layout = np.dtype(
        {"names": list(order), "formats": formats, "offsets": offsets, "itemsize": step}
    )
    grid = np.zeros((rows, len(points) // rows), layout)
    for name, values in zip("xyz", points.T, strict=True):
        if name in order:
            grid[name] = values.reshape(grid.shape)
    lines = [row.tobytes() + b"\xff" * padding for row in grid]
    fields = [
        message("sensor_msgs/PointField", name=n, offset=at, datatype=NUMBERS[kind], count=1)
        for n, at in zip(order, offsets, strict=True)
    ]
    parts: dict[str, Any] = {
        "header": header(stamp, frame),
        "height": rows,
        "width": len(points) // rows,
        "fields": fields,
        "is_bigendian": big,
        "point_step": step,
        "row_step": len(lines[0]),
        "data": np.frombuffer(b"".join(lines), np.uint8),
        "is_dense": False,
    }
    return message("sensor_msgs/PointCloud2", **{**parts, **changes})


def bag(folder: Path, messages: Sequence[tuple[str, int, Any]]) -> Path:
    """Write messages, each with its topic and the stamp of its log, as a robot's recorder does."""
    with rosbag2.Writer(
        folder / "bag", version=8, storage_plugin=rosbag2.StoragePlugin.MCAP
    ) as writer:
        channels: dict[str, Any] = {}
        for topic, logged, one in messages:
            kind = one.__msgtype__
            if topic not in channels:
                channels[topic] = writer.add_connection(topic, kind, typestore=typestore())
            writer.write(channels[topic], logged, typestore().serialize_cdr(one, kind))
    return folder / "bag" / "bag.mcap"


def read(path: Path, **sensors: str) -> list[Reading]:
    return list(McapRecording(McapConfig(file=path, sensors=sensors)).readings())


# The layout of points


@pytest.mark.parametrize("kind", ["f4", "f8"])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("order", ["xyz", "zyx", "ixyz", "yizx"])
def test_points_are_read_however_they_are_laid_out(kind: str, big: bool, order: str) -> None:
    for before, after, rows, padding in itertools.product((0, 4), (0, 6), (1, 2), (0, 10)):
        laid = cloud(
            kind=kind, big=big, order=order, before=before, after=after, rows=rows, padding=padding
        )
        np.testing.assert_array_equal(points_of(laid), POINTS)


def test_an_empty_cloud_has_no_points() -> None:
    assert points_of(cloud(np.empty((0, 3)))).shape == (0, 3)


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({"order": "xy"}, "no field 'z'; its fields are: x, y"),
        ({"fields": []}, "no field 'x'; its fields are: none"),
        (
            {"points": np.ones((4, 3)), "kind": "u2"},
            "'x' of the cloud is neither float32 nor float64: its type is 4",
        ),
        ({"width": 5}, "no 1 rows of 5 points"),
        ({"point_step": 8}, "no 1 rows of 4 points"),
        ({"point_step": 0}, "no 1 rows of 4 points"),
        ({"rows": 2, "row_step": 0}, "the rows overlap"),
        ({"rows": 2, "row_step": 4_000_000_000}, "no 2 rows of 2 points"),
        ({"data": np.zeros(0, np.uint8)}, "no 1 rows of 4 points"),
    ],
)
def test_a_cloud_that_does_not_hold_together_is_one_sentence(
    changes: dict[str, Any], wrong: str
) -> None:
    with pytest.raises(RecordingError, match=wrong):
        points_of(cloud(**changes))


# Files


def test_what_mcap_writer_wrote_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "scan.mcap"
    with McapWriter(path, epoch_ns=EPOCH) as writer:
        for stamp in (0.0, 0.1):
            at: dict[str, Any] = {"stamp": stamp, "frame": "lidar", "sensor": "front"}
            writer.reading(PointCloud(**at, points=POINTS))
    recording = McapRecording(McapConfig(file=Path("scan.mcap")), tmp_path)
    assert recording.epoch_ns == EPOCH
    for _ in range(2):  # a recording can be read more than once
        found = list(recording.readings())
        assert [(one.stamp, one.frame, one.sensor) for one in found] == [
            (0.0, "lidar", "front"),
            (0.1, "lidar", "front"),
        ]
        for one in found:
            assert isinstance(one, PointCloud)
            np.testing.assert_array_equal(one.points, POINTS)


def test_readings_come_in_the_order_of_their_headers(tmp_path: Path) -> None:
    late = [0.3, 0.0, 0.9, 0.5, 1.4, 1.2, 2.6, 3.0, 2.1]
    stamps = [EPOCH + round(one * SECOND) for one in late]
    path = bag(
        tmp_path,
        [(f"/{i % 2}", EPOCH + i, cloud(stamp=stamp)) for i, stamp in enumerate(stamps)],
    )
    recording = McapRecording(McapConfig(file=path))
    assert recording.epoch_ns == EPOCH
    assert [one.stamp for one in recording.readings()] == pytest.approx(sorted(late))


def test_a_clock_that_is_set_back_is_an_error(tmp_path: Path) -> None:
    stamps = (EPOCH + LONGEST_FALL + 1, EPOCH + 2 * LONGEST_FALL, EPOCH)
    path = bag(tmp_path, [("/lidar", i, cloud(stamp=stamp)) for i, stamp in enumerate(stamps)])
    with pytest.raises(RecordingError, match="/lidar: time falls by 2 s"):
        read(path)


def test_topics_get_the_names_of_sensors_that_are_asked_for(tmp_path: Path) -> None:
    path = bag(tmp_path, [("/a/points", 0, cloud()), ("/b/points", 1, cloud())])
    assert [one.sensor for one in read(path)] == ["a/points", "b/points"]
    assert [one.sensor for one in read(path, left="/b/points")] == ["left"]


def test_other_messages_are_passed_over_unless_they_are_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "both.mcap"
    at: dict[str, Any] = {"stamp": 0.0, "frame": "base"}
    with McapWriter(path) as writer:
        writer.reading(Wrench(**at, sensor="wrist", force=np.zeros(3), torque=np.zeros(3)))
        writer.reading(PointCloud(**at, sensor="lidar", points=POINTS))
    assert [one.sensor for one in read(path)] == ["lidar"]
    with pytest.raises(RecordingError, match="/wrist holds geometry_msgs/msg/WrenchStamped; what"):
        read(path, wrist="/wrist")
    with pytest.raises(RecordingError, match="no topic '/lidr'; did you mean '/lidar'"):
        read(path, lidar="/lidr")


def test_a_file_without_any_cloud_says_what_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "wrist.mcap"
    with McapWriter(path) as writer:
        writer.reading(Wrench(stamp=0.0, frame="w", force=np.zeros(3), torque=np.zeros(3)))
    with pytest.raises(RecordingError, match=r"holds: /wrench \(geometry_msgs/msg/WrenchStamped\)"):
        read(path)


def test_a_wrong_message_is_named_by_file_topic_and_stamp(tmp_path: Path) -> None:
    path = bag(tmp_path, [("/lidar", 0, cloud(order="xy"))])
    with pytest.raises(RecordingError, match=rf"bag.mcap, /lidar at {EPOCH} ns: .* no field 'z'"):
        read(path)
    nowhere = bag(tmp_path / "nowhere", [("/lidar", 0, cloud(frame=""))])
    with pytest.raises(RecordingError, match="needs the name of its frame"):
        read(nowhere)


@pytest.mark.parametrize("kept", [0, 7, 100, 300])
def test_a_file_that_is_cut_off_is_an_error(tmp_path: Path, kept: int) -> None:
    whole = bag(tmp_path, [("/lidar", 0, cloud())])
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:kept])
    with pytest.raises(RecordingError, match="cut.mcap can't be read: "):
        read(cut)


def test_a_file_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="there is no file 'scan.mcap'"):
        read(tmp_path / "scan.mcap")
