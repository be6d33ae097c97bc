"""Recordings of ROS: all formats, order, clocks, transforms, taps, and files that are damaged."""

import math
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from shutil import copytree
from subprocess import run
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError, DependencyError, RecordingError
from contactfusion.readings import JointState, Odometry, PointCloud, Reading, Transform, Wrench
from contactfusion.readings.messages import known_types, message
from contactfusion.recordings import ouster
from contactfusion.recordings.log import LONGEST_FALL
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import RawMessage
from contactfusion.recordings.ros import RosConfig, RosRecording
from tests.real_data import real_data
from tests.ros_bags import (
    EPOCH,
    FORMATS,
    SECOND,
    Said,
    Write,
    joints,
    mcap,
    ros1,
    rosbag1,
    rosbag2,
    sqlite_folder,
    text,
    transforms,
    wrench,
)

NEVER = -EPOCH
"""The stamp of a header that nobody set, as the helpers count."""


@pytest.fixture(params=list(FORMATS.values()), ids=list(FORMATS))
def write(request: pytest.FixtureRequest) -> Write:
    made: Write = request.param
    return made


def opened(path: Path, start: float = 0.0, duration: float | None = None, **sensors: str) -> Any:
    config = RosConfig(file=path, sensors=sensors, start=start, duration=duration)
    return RosRecording(config)


def read(path: Path, **options: Any) -> list[Reading]:
    return list(opened(path, **options).readings())


def until_error(recording: RosRecording) -> tuple[list[Reading], str]:
    """Give the readings that come before an error, and what it says."""
    found: list[Reading] = []
    with pytest.raises(RecordingError) as error:
        for one in recording.readings():
            found.append(one)
    assert "\n" not in str(error.value)
    return found, str(error.value)


def stamps(readings: Sequence[Reading]) -> list[float]:
    return [round(one.stamp, 9) for one in readings]


# Formats


def test_every_format_gives_the_same(write: Write, tmp_path: Path) -> None:
    said = [
        ("/wrist", 0, wrench(0, 1.0)),
        ("/chatter", 1, text()),
        ("/joints", 2, joints(SECOND // 2)),
        ("/tf", 3, transforms((SECOND // 2, "/odom", "base"), (SECOND, "base", "arm"))),
        ("/wrist", 4, wrench(SECOND, 2.0)),
    ]
    path = write(tmp_path, said)
    recording = open_recording(path)
    assert isinstance(recording, RosRecording)
    assert recording.epoch_ns == EPOCH
    assert recording.topics == {"joints": JointState, "tf": Transform, "wrist": Wrench}
    assert [
        (one.name, one.msgtype, one.count, one.kind) for one in recording.contents.values()
    ] == [
        ("/chatter", "std_msgs/msg/String", 1, None),
        ("/joints", "sensor_msgs/msg/JointState", 1, JointState),
        ("/tf", "tf2_msgs/msg/TFMessage", 1, Transform),
        ("/wrist", "geometry_msgs/msg/WrenchStamped", 2, Wrench),
    ]
    for _ in range(2):  # a recording can be read more than once
        first, state, odom, arm, last = recording.readings()
        assert stamps([first, state, odom, arm, last]) == [0.0, 0.5, 0.5, 1.0, 1.0]
        assert isinstance(last, Wrench) and isinstance(state, JointState)
        assert (last.frame, last.sensor, last.force.tolist()) == ("wrist", "wrist", [2, 0, 0])
        assert (state.names, state.velocities) == (("a", "b"), None)
        assert isinstance(odom, Transform) and isinstance(arm, Transform)
        assert (odom.frame, odom.child_frame, odom.static) == ("odom", "base", False)
        assert (arm.frame, arm.child_frame, arm.position.tolist()) == ("base", "arm", [1, 0, 0])
        assert recording.tally["/wrist"].messages == recording.tally["/wrist"].readings == 2
        assert recording.tally["/wrist"].longest_gap == 1.0


def test_a_folder_of_split_files_is_read_in_order_of_time(tmp_path: Path) -> None:
    whole = tmp_path / "whole"
    whole.mkdir()
    for name, after in (("b", 0), ("a", 2 * SECOND)):  # names say nothing of time
        said = [("/wrist", after + i, wrench(after + i)) for i in range(3)]
        if name == "a":  # then /wrist has another number in the file
            said.insert(0, ("/joints", after, joints(after)))
        made = mcap(tmp_path / name, said)
        made.rename(whole / f"{name}.mcap")
    recording = open_recording(whole)
    assert isinstance(recording, RosRecording)
    assert recording.contents["/wrist"].count == 6
    assert recording.contents["/wrist"].publishers == 1
    assert len(found := list(recording.readings())) == 7
    assert stamps(found) == sorted(stamps(found)) and found[-1].stamp > 2.0


def test_compressed_bags_are_read(tmp_path: Path) -> None:
    store = typestore()
    for mode in ("FILE", "MESSAGE"):
        path = tmp_path / mode
        with rosbag2.Writer(
            path, version=8, storage_plugin=rosbag2.StoragePlugin.SQLITE3
        ) as writer:
            pass
        path = tmp_path / f"{mode}_z"
        writer = rosbag2.Writer(path, version=8, storage_plugin=rosbag2.StoragePlugin.SQLITE3)
        writer.set_compression(rosbag2.CompressionMode[mode], rosbag2.CompressionFormat.ZSTD)
        with writer:
            kind = "geometry_msgs/msg/WrenchStamped"
            channel = writer.add_connection("/wrist", kind, typestore=store)
            writer.write(channel, EPOCH, store.serialize_cdr(wrench(), kind))
        assert stamps(read(path)) == [0.0]


def test_what_mcap_writer_wrote_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "scan.mcap"
    points = np.array([[0.5, -0.25, 1.0], [np.nan, np.nan, np.nan]])
    with McapWriter(path, epoch_ns=EPOCH) as writer:
        for stamp in (0.0, 0.1):
            at: dict[str, Any] = {"stamp": stamp, "frame": "lidar", "sensor": "front"}
            writer.reading(PointCloud(**at, points=points))
    recording = RosRecording(RosConfig(file=Path("scan.mcap")), tmp_path)
    assert recording.epoch_ns == EPOCH
    found = list(recording.readings())
    assert [(one.stamp, one.frame, one.sensor) for one in found] == [
        (0.0, "lidar", "front"),
        (0.1, "lidar", "front"),
    ]


def test_a_description_opens_it_by_both_names_of_its_type(tmp_path: Path) -> None:
    path = mcap(tmp_path, [("/wrist", 0, wrench())])
    for kind in ("ros", "mcap"):
        found = open_recording({"type": kind, "file": path.name, "sensors": {"ft": "/wrist"}},
                               path.parent)  # fmt: skip
        assert [one.sensor for one in found.readings()] == ["ft"]
    with pytest.raises(ConfigurationError, match="start"):
        open_recording({"type": "ros", "file": path.name, "start": -1.0}, path.parent)


# Sensors


def test_topics_get_the_names_of_sensors_that_are_asked_for(write: Write, tmp_path: Path) -> None:
    said = [("/a/ft", 0, wrench()), ("/b/ft", 1, wrench(1)), ("/tf", 2, transforms((2, "o", "b")))]
    path = write(tmp_path, said)
    assert [one.sensor for one in read(path)] == ["a/ft", "b/ft", "tf"]
    assert [one.sensor for one in read(path, left="/b/ft")] == ["left", "tf"]
    assert opened(path, left="/b/ft").topics == {"left": Wrench, "tf": Transform}
    assert opened(path, left="a/ft").sensors == {"left": ("/a/ft",), "tf": ("/tf",)}
    assert opened(path, tf="/b/ft").topics == {"tf": Wrench, "/tf": Transform}
    assert opened(path, moving="/tf").topics == {"moving": Transform}


def test_what_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = mcap(tmp_path, [("/wrist", 0, wrench()), ("/chatter", 0, text())])
    assert [one.sensor for one in read(path)] == ["wrist"]
    with pytest.raises(RecordingError, match="no topic '/wrst'; did you mean '/wrist'"):
        opened(path, wrist="/wrst")
    with pytest.raises(RecordingError, match="/chatter holds std_msgs/msg/String; what can be"):
        opened(path, words="/chatter")
    with pytest.raises(RecordingError, match="'left' and 'right' are both /wrist"):
        opened(path, left="/wrist", right="/wrist")


def test_messages_without_a_header_are_no_readings(tmp_path: Path) -> None:
    wrenches = [("/w", 0, wrench().wrench), ("/words", 0, text())]
    with pytest.raises(RecordingError, match=r"holds: /w \(geometry_msgs/msg/Wrench\), /words"):
        opened(mcap(tmp_path, wrenches))


def test_nodes_that_publish_one_topic_are_counted(tmp_path: Path) -> None:
    said: list[Any] = [(("/wrist", "/left"), 0, wrench()), (("/wrist", "/right"), 1, wrench(1))]
    recording = opened(ros1(tmp_path, said))
    assert recording.contents["/wrist"].publishers == 2
    assert recording.contents["/wrist"].count == len(list(recording.readings())) == 2


def test_two_types_on_one_topic_are_an_error_when_they_are_read(tmp_path: Path) -> None:
    path = mcap(tmp_path, [("/x", 0, wrench()), ("/x", 1, text()), ("/wrist", 2, wrench(2))])
    with pytest.raises(RecordingError, match="/x holds messages of two types, geometry_msgs/msg/"):
        opened(path)
    assert len(read(path, wrist="/wrist")) == 1


def test_what_is_ignored_is_not_read_at_all(tmp_path: Path) -> None:
    path = mcap(tmp_path, [("/x", 0, wrench()), ("/x", 1, text()), ("/wrist", 2, wrench(2)),
                           ("/other", 3, wrench(3))])  # fmt: skip
    recording = RosRecording(RosConfig(file=path, ignored=("/x", "/other")))
    assert set(recording.topics) == {"wrist"}
    assert [one.sensor for one in recording.readings()] == ["wrist"]
    with pytest.raises(RecordingError, match="no topic '/othr' to ignore; did you mean '/other'"):
        recording.without(["/othr"])


def test_transforms_can_be_ignored(tmp_path: Path) -> None:
    path = mcap(tmp_path, [("/tf", 0, transforms((0, "map", "base"))), ("/wrist", 1, wrench(1))])
    assert {type(one) for one in opened(path).readings()} == {Transform, Wrench}
    ignoring = RosRecording(RosConfig(file=path, ignored=("/tf",)))
    assert {type(one) for one in ignoring.readings()} == {Wrench}


def test_what_contactfusion_did_is_no_reading(tmp_path: Path) -> None:
    stamped = message("geometry_msgs/TwistStamped", header=wrench().header,
                      twist=message("geometry_msgs/Twist", linear=wrench().wrench.force,
                                    angular=wrench().wrench.force))  # fmt: skip
    path = mcap(tmp_path, [("/cmd_vel", 0, stamped), ("/contactfusion/cmd_vel", 0, stamped)])
    assert set(opened(path).topics) == {"cmd_vel"}
    with pytest.raises(RecordingError, match="/cmd_vel holds .*, which contactfusion wrote"):
        opened(path, command="/contactfusion/cmd_vel")


def test_an_empty_recording_has_no_readings(tmp_path: Path) -> None:
    for number, plugin in enumerate(rosbag2.StoragePlugin):
        path = tmp_path / str(number)
        with rosbag2.Writer(path, version=8, storage_plugin=plugin) as writer:
            writer.add_connection("/wrist", wrench().__msgtype__, typestore=typestore())
        recording = opened(path, start=3.0, duration=1.0)
        assert (list(recording.readings()), recording.epoch_ns) == ([], 0)


# Order and clocks


def test_readings_come_in_the_order_of_their_headers(write: Write, tmp_path: Path) -> None:
    late = [0.3, 0.0, 0.9, 0.5, 1.4, 1.2, 2.1, 3.0, 2.6]
    path = write(
        tmp_path,
        [(f"/s{i % 2}", i, wrench(round(one * SECOND))) for i, one in enumerate(late)],
    )
    recording = opened(path)
    assert recording.epoch_ns == EPOCH
    assert stamps(list(recording.readings())) == sorted(late)
    assert recording.tally["/s0"].out_of_order == 0 and recording.tally["/s1"].out_of_order == 0
    assert (recording.tally["/s0"].first, recording.tally["/s0"].last) == (0.3, 2.6)


def test_headers_out_of_order_are_counted(tmp_path: Path) -> None:
    late = (0, 2, 1, 3, 2)
    recording = opened(mcap(tmp_path, [("/wrist", i, wrench(at)) for i, at in enumerate(late)]))
    assert len(list(recording.readings())) == 5
    assert recording.tally["/wrist"].out_of_order == 2


@pytest.mark.parametrize(
    ("jump", "told"),
    [
        (-LONGEST_FALL - SECOND, "/wrist: its clock jumps back by 2 s at 1.500 s"),
        (3601 * SECOND, "/wrist: its clock jumps ahead by 3601 s at 1.500 s"),
        (100 * 86400 * SECOND, "jumps ahead by 100.0 days"),
    ],
)
def test_a_clock_that_jumps_ends_it_after_all_before(tmp_path: Path, jump: int, told: str) -> None:
    good = [0, SECOND, 3 * SECOND // 2]
    said: list[Said] = [("/wrist", i, wrench(at)) for i, at in enumerate(good)]
    path = mcap(tmp_path, [*said, ("/wrist", 9, wrench(good[-1] + jump))])  # 9 ns later in the log
    found, problem = until_error(opened(path))
    assert stamps(found) == [0.0, 1.0, 1.5]
    assert told in problem and problem.startswith(str(path))


def test_a_pause_of_hours_is_no_jump(write: Write, tmp_path: Path) -> None:
    hours = (0, 3, 8)
    said = [("/wrist", 3600 * SECOND * at, wrench(3600 * SECOND * at)) for at in hours]
    said.append(("/late", 3600 * SECOND * 15, wrench(3600 * SECOND * 15)))
    assert stamps(read(write(tmp_path, said))) == [0.0, 10800.0, 28800.0, 54000.0]


def test_a_topic_with_a_clock_of_its_own_is_an_error(tmp_path: Path) -> None:
    path = mcap(tmp_path, [("/wrist", 0, wrench()), ("/boot", 1, wrench(SECOND - EPOCH))])
    found, problem = until_error(opened(path))
    assert "/boot: its clock is 19675.9 days behind the others', as if it counted from" in problem
    assert len(found) == 1
    assert len(read(path, boot="/boot")) == 1


def test_what_comes_too_late_is_refused_and_counted(tmp_path: Path) -> None:
    said = [("/wrist", i, wrench(i * SECOND)) for i in range(5)]
    path = mcap(tmp_path, [*said, ("/slow", 9, wrench(SECOND))])
    recording = opened(path)
    assert {one.sensor for one in recording.readings()} == {"wrist"}
    assert recording.tally["/slow"].refused == 1
    assert recording.tally["/slow"].why_refused == "it came 3 s after later stamps"


def test_a_header_that_was_never_set_is_counted(write: Write, tmp_path: Path) -> None:
    said = [("/wrist", 0, wrench(NEVER)), ("/wrist", 1, wrench(1)), ("/wrist", 2, wrench(NEVER))]
    recording = opened(write(tmp_path, said))
    assert recording.epoch_ns == EPOCH + 1
    assert len(list(recording.readings())) == 1
    assert recording.tally["/wrist"].unreadable == 2
    assert recording.tally["/wrist"].why_unreadable == "its header has no stamp"


def test_values_that_no_sensor_gives_are_refused(tmp_path: Path) -> None:
    said = [("/wrist", 0, wrench(0, math.nan)), ("/wrist", 1, wrench(1, frame="")),
            ("/wrist", 2, wrench(2))]  # fmt: skip
    recording = opened(mcap(tmp_path, said))
    assert len(list(recording.readings())) == 1
    assert recording.tally["/wrist"].refused == 2
    assert "is not finite" in recording.tally["/wrist"].why_refused


# A part of the time


def test_a_window_is_counted_from_the_first_message(write: Write, tmp_path: Path) -> None:
    said = [("/wrist", i * SECOND, wrench(i * SECOND)) for i in range(6)]
    recording = opened(write(tmp_path, said), start=2.0, duration=2.0)
    assert recording.epoch_ns == EPOCH  # whatever the window
    assert stamps(list(recording.readings())) == [2.0, 3.0]
    assert list(opened(write(tmp_path / "b", said), start=100.0).readings()) == []


def test_a_window_hours_after_the_beginning_is_no_jump(tmp_path: Path) -> None:
    hours = 5 * 3600 * SECOND
    said = [("/wrist", at, wrench(at)) for at in (0, hours, hours + SECOND)]
    said.insert(0, ("/tf_static", 0, transforms((NEVER, "base", "arm"))))
    recording = opened(mcap(tmp_path, said), start=100.0)
    assert stamps(list(recording.readings())) == [18000.0, 18000.0, 18001.0]


def test_static_transforms_from_before_the_window_come_first(write: Write, tmp_path: Path) -> None:
    said = [
        ("/tf_static", 0, transforms((NEVER, "base", "arm"), (0, "base", "eye"))),
        ("/tf", 0, transforms((0, "odom", "base"))),
        *[("/wrist", i * SECOND, wrench(i * SECOND)) for i in range(4)],
    ]
    recording = opened(write(tmp_path, said), start=2.0, ft="/wrist")
    arm, eye, first, last = recording.readings()
    assert stamps([arm, eye, first, last]) == [2.0, 2.0, 2.0, 3.0]
    assert isinstance(arm, Transform) and arm.static and arm.child_frame == "arm"
    assert (eye.sensor, first.sensor) == ("tf_static", "ft")


def test_static_transforms_come_at_any_time(tmp_path: Path) -> None:
    said = [
        ("/wrist", 0, wrench()),
        ("/robot/tf_static", 1, transforms((-(10**15), "base", "arm"))),
        ("/wrist", 2, wrench(3 * SECOND)),
        (
            "/robot/tf_static",
            3,
            transforms((NEVER, "base", "eye"), (3 * SECOND + 5, "base", "ear")),
        ),
    ]
    found = [one for one in read(mcap(tmp_path, said)) if isinstance(one, Transform)]
    assert [(one.child_frame, one.static) for one in found] == [
        ("arm", True), ("eye", True), ("ear", True)
    ]  # fmt: skip
    assert stamps(found) == [0.0, 3.0, 3.000000005]


def test_an_old_tree_of_frames_stops_nothing(tmp_path: Path) -> None:
    old = transforms((-(10**15), "map", "odom"), (0, "odom", "base"))
    recording = opened(mcap(tmp_path, [("/wrist", 0, wrench()), ("/tf", 1, old)]))
    assert [one.sensor for one in recording.readings()] == ["wrist", "tf"]
    assert recording.tally["/tf"].refused == 1
    assert "11.6 days behind the others'" in recording.tally["/tf"].why_refused


# Taps


def test_a_tap_hears_every_message_as_cdr(write: Write, tmp_path: Path) -> None:
    said = [("/chatter", 0, text()), ("/wrist", 1, wrench()), ("/wrist", SECOND, wrench(SECOND))]
    heard: list[RawMessage] = []
    recording = RosRecording(RosConfig(file=write(tmp_path, said)), tap=heard.append)
    assert not heard
    assert len(list(recording.readings())) == 2
    assert [(one.topic, one.log_stamp_ns - EPOCH) for one in heard] == [
        (topic, logged) for topic, logged, _ in said
    ]
    for one, (_, _, sent) in zip(heard, said, strict=True):
        assert one.msgtype == sent.__msgtype__
        assert one.cdr == bytes(typestore().serialize_cdr(sent, sent.__msgtype__))
    assert heard[0].definition.strip() == "string data"
    assert "std_msgs/Header header\n" in heard[1].definition
    assert "uint32 seq" not in heard[1].definition
    assert "MSG: builtin_interfaces/Time" in heard[1].definition
    assert recording.tally["/chatter"].messages == 1


def test_a_tap_hears_the_window_and_static_transforms_from_before_it(tmp_path: Path) -> None:
    said = [("/wrist", i * SECOND, wrench(i * SECOND)) for i in range(6)]
    said.insert(0, ("/tf_static", 0, transforms((0, "base", "arm"))))
    said.insert(1, ("/tf", 0, transforms((0, "odom", "base"))))
    heard: list[RawMessage] = []
    config = RosConfig(file=mcap(tmp_path, said), start=2.0, duration=2.0)
    assert len(list(RosRecording(config, tap=heard.append).readings())) == 3
    assert [one.topic for one in heard] == ["/tf_static", "/wrist", "/wrist"]


def test_what_a_simulation_tells_of_the_truth_is_read_only_when_asked_for(tmp_path: Path) -> None:
    said = [("/wrist", 0, wrench(0)), ("/truth/wrist", 0, wrench(0))]
    path = mcap(tmp_path, said)
    assert set(opened(path).topics) == {"wrist"}
    assert set(opened(path, known="/truth/wrist").topics) == {"known"}


def test_types_of_ones_own_never_stop_reading(tmp_path: Path) -> None:
    own = "Header header\nfloat32 level\nduration left\nPart[] parts\n"
    own += 80 * "=" + "\nMSG: my_msgs/Part\nuint8 KIND=3\nstring name\n"
    path = tmp_path / "own.bag"
    with rosbag1.Writer(path) as writer:
        kind = "geometry_msgs/msg/WrenchStamped"
        wrist = writer.add_connection("/wrist", kind, typestore=typestore())
        raw = typestore().serialize_cdr(wrench(), kind)
        mine = writer.add_connection("/mine", "my_msgs/msg/Mine", msgdef=own, md5sum="0" * 32)
        odd = writer.add_connection("/odd", "my_msgs/msg/Odd", msgdef="no {{ such", md5sum="1" * 32)
        part = writer.add_connection("/part", "my_msgs/msg/B", msgdef="C c\n", md5sum="2" * 32)
        stamp = bytes(4) + (17).to_bytes(4, "little") + bytes(4) + bytes(4)
        level = np.float32(0.5).tobytes() + (3).to_bytes(4, "little") + bytes(4)
        parts = (1).to_bytes(4, "little") + (2).to_bytes(4, "little") + b"hi"
        writer.write(mine, EPOCH, stamp + level + parts)
        writer.write(odd, EPOCH, b"?")
        writer.write(part, EPOCH, b"?")
        writer.write(wrist, EPOCH, typestore().cdr_to_ros1(raw, kind))
    heard: list[RawMessage] = []
    recording = RosRecording(RosConfig(file=path), tap=heard.append)
    assert [one.sensor for one in recording.readings()] == ["wrist"]
    last, first = heard
    assert first.cdr[:8] == b"\0\1\0\0\x11\0\0\0"
    assert first.cdr.endswith(b"hi\0")
    assert first.definition.startswith(
        "std_msgs/Header header\nfloat32 level\nbuiltin_interfaces/Du"
    )
    assert "MSG: my_msgs/Part\nuint8 KIND=3\nstring name" in first.definition
    assert last.topic == "/wrist"
    assert recording.tally["/odd"].unreadable == 1
    assert "definition of my_msgs/msg/Odd can't be parsed" in recording.tally["/odd"].why_unreadable
    assert "definition of my_msgs/msg/B is not whole" in recording.tally["/part"].why_unreadable


def test_a_standard_name_for_something_else_is_no_reading(tmp_path: Path) -> None:
    path = tmp_path / "odd.bag"
    with rosbag1.Writer(path) as writer:
        kind, other = "geometry_msgs/msg/WrenchStamped", "Header header\nfloat64 x\n"
        odd = writer.add_connection("/odd", kind, msgdef=other, md5sum="0" * 32)
        writer.write(odd, EPOCH, bytes(24))
    with pytest.raises(RecordingError, match="/odd holds .*, but what the file calls so is some"):
        opened(path, odd="/odd")


# Damage


@pytest.mark.parametrize("kept", [0, 7, 100, 300])
@pytest.mark.parametrize("name", ["mcap", "ros1"])
def test_of_a_file_that_is_cut_off_early_nothing_is_read(
    tmp_path: Path, name: str, kept: int
) -> None:
    whole = FORMATS[name](tmp_path, [("/wrist", 0, wrench())])
    cut = tmp_path / f"cut{whole.suffix}"
    cut.write_bytes(whole.read_bytes()[:kept])
    with pytest.raises(RecordingError, match="cut.* can't be read: ") as error:
        read(cut)
    assert "\n" not in str(error.value)


def cut_off(folder: Path, name: str) -> tuple[Path, str]:
    """Give a file that lacks its end, and the command that mends it."""
    said = [("/wrist", i, wrench(i)) for i in range(20_000)]
    if name == "ros1":
        path = ros1(folder, said, size=20_000)
        command = f"rosbag reindex {path}"
    else:
        path = mcap(folder, said)
        command = f"mcap recover {path} -o MENDED.mcap"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    return path, command


@pytest.mark.parametrize("name", ["mcap", "ros1"])
def test_of_a_file_that_is_cut_off_what_is_whole_is_read(tmp_path: Path, name: str) -> None:
    path, command = cut_off(tmp_path, name)
    recording = opened(path)
    found, problem = until_error(recording)
    assert 1000 < len(found) < 20_000
    assert stamps(found) == stamps(sorted(found, key=lambda one: one.stamp))
    assert problem == f"{path} is cut off after {len(found)} messages; mend it by: {command}"
    assert recording.contents["/wrist"].count == len(found)


def test_a_bag_that_was_never_indexed_is_read(tmp_path: Path) -> None:
    path = ros1(tmp_path, [("/wrist", i, wrench(i)) for i in range(100)], size=2000)
    raw = path.read_bytes()
    at = raw.index(b"index_pos=") + len(b"index_pos=")
    active = tmp_path / "robot.bag.active"
    active.write_bytes(raw[:at] + bytes(8) + raw[at + 8 :])
    found, problem = until_error(opened(active))
    assert len(found) == 100
    assert "is cut off after 100 messages; mend it by: rosbag reindex" in problem


def test_damage_within_a_file_is_told_after_what_comes_before(tmp_path: Path) -> None:
    path = ros1(tmp_path, [("/wrist", i, wrench(i)) for i in range(1000)], size=20_000)
    raw = bytearray(path.read_bytes())
    middle = raw.index(b"op=\x02", len(raw) // 2)
    raw[middle : middle + 4] = b"xx=y"
    path.write_bytes(raw)
    found, problem = until_error(opened(path))
    assert 100 < len(found) < 1000
    assert f"is damaged after {len(found)} messages (" in problem
    assert problem.endswith(f"mend it by: rosbag reindex {path}")


def test_of_split_files_only_the_one_that_is_cut_off_ends_early(tmp_path: Path) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    mcap(tmp_path / "a", [("/wrist", 0, wrench(0))]).rename(folder / "a.mcap")
    later = [("/wrist", SECOND + i, wrench(SECOND + i)) for i in range(20_000)]
    cut = mcap(tmp_path / "b", later).rename(folder / "b.mcap")
    cut.write_bytes(cut.read_bytes()[:2_000_000])
    found, problem = until_error(opened(folder))
    assert len(found) > 1000 and found[0].stamp == 0.0
    assert f"{cut} is cut off after {len(found) - 1} messages" in problem


def test_the_name_of_a_folder_says_nothing(tmp_path: Path) -> None:
    made = sqlite_folder(tmp_path, [("/wrist", i, wrench(i)) for i in range(5)])
    for name in ("drive.bag", "of_22.11"):
        whole = copytree(made, tmp_path / name)
        assert len(read(whole)) == 5
    raw = bytearray((whole / "made.db3").read_bytes())
    raw[4096 : len(raw)] = bytes(len(raw) - 4096)
    (whole / "made.db3").write_bytes(raw)
    with pytest.raises(RecordingError, match=f"{whole} (can't be read|is damaged)"):
        read(whole)


def test_a_folder_without_recordings_and_a_broken_one_are_errors(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"there is no \.bag, .* in the folder"):
        open_recording(tmp_path)
    with pytest.raises(RecordingError, match="there is no file 'scan.mcap'"):
        open_recording(tmp_path / "scan.mcap")
    made = sqlite_folder(tmp_path / "b", [("/wrist", 0, wrench())])
    broken = copytree(made, tmp_path / "broken")
    (broken / "metadata.yaml").write_text("nothing: here\n")
    with pytest.raises(RecordingError, match="broken can't be read: "):
        open_recording(broken)
    (broken / "metadata.yaml").unlink()
    assert len(list(open_recording(broken).readings())) == 1


@pytest.mark.parametrize("suffix", [".bag", ".mcap", ".db3"])
def test_what_is_no_recording_is_one_sentence(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"a{suffix}").write_bytes(b"something else entirely, and long enough for a header")
    with pytest.raises(RecordingError, match=f"a{suffix} can't be read: ") as error:
        open_recording(tmp_path / f"a{suffix}")
    assert "\n" not in str(error.value)


def test_without_rosbags_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = mcap(tmp_path, [("/wrist", 0, wrench())])
    typestore.cache_clear()
    monkeypatch.setattr("contactfusion.recordings.messages.known_types", known_types.__wrapped__)
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(DependencyError, match=r"pip install 'contactfusion\[record\]'"):
        opened(path)


# Ouster


def test_raw_packets_of_ouster_are_to_be_converted() -> None:
    with pytest.raises(RecordingError, match="raw packets .* by: contactfusion convert SOURCE"):
        open_recording(real_data("ouster/512x10_raw.bag"))


def test_a_file_of_ouster_is_converted_for_as_long_as_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Path] = []

    def convert(source: Path, out: Path) -> None:
        made.append(out)
        mcap(tmp_path, [("/wrist", 0, wrench())]).rename(out)

    monkeypatch.setattr("contactfusion.recordings.opening.convert", convert)
    (tmp_path / "a.pcap").touch()
    recording = open_recording(tmp_path / "a.pcap")
    assert isinstance(recording, RosRecording)
    assert len(list(recording.readings())) == 1
    part = recording.part({"ft": ["/wrist"]})
    del recording
    assert [one.sensor for one in part.readings()] == ["ft"]
    assert made[0].is_file()
    del part
    assert not made[0].parent.exists()


@pytest.mark.parametrize(
    ("name", "rows", "columns", "scans"),
    [
        ("OS-0-32-U1_v2.2.0_1024x10.pcap", 32, 1024, 1),
        ("osf_fw_3.2_10scans.osf", 8, 2048, 10),
    ],
)
def test_real_files_of_ouster_are_opened_like_any_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, rows: int, columns: int, scans: int
) -> None:
    if not ouster.is_ready():
        pytest.skip(f"there is no environment for Ouster files: {ouster.COMMAND}")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    recording = open_recording(real_data(f"ouster/{name}"))
    assert isinstance(recording, RosRecording)
    assert recording.topics == {"ouster/points": PointCloud}
    found = [one for one in recording.readings() if isinstance(one, PointCloud)]
    assert len(found) == scans and found[0].stamp == 0.0
    for one in found:
        assert (one.frame, one.sensor) == ("os_sensor", "ouster/points")
        assert one.points.shape == (rows * columns, 3)
        distances = np.linalg.norm(one.points[np.isfinite(one.points[:, 0])], axis=1)
        assert len(distances) > 0.1 * len(one.points) and 0.15 < distances.min() < 5.0
    assert len(list(tmp_path.iterdir())) == 1
    del recording
    assert not list(tmp_path.iterdir())  # what was made for it is gone


def test_without_the_environment_for_ouster_the_command_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ouster, "is_ready", lambda: False)
    (tmp_path / "a.osf").touch()
    with pytest.raises(DependencyError, match="make it by: contactfusion doctor --ouster"):
        open_recording(tmp_path / "a.osf")


# A real bag


def test_a_real_bag_of_ros_1_gives_its_odometry() -> None:
    heard: list[RawMessage] = []
    config = RosConfig(file=real_data("husky_bag/test1.bag"), start=10.0, duration=60.0)
    recording = RosRecording(config, tap=heard.append)
    assert recording.topics == {"husky_velocity_controller/odom": Odometry}
    found = list(recording.readings())
    assert len(found) == pytest.approx(600, abs=5)
    for one in found:
        assert isinstance(one, Odometry)
        assert (one.frame, one.child_frame) == ("odom", "base_link")
        assert one.linear is not None and abs(one.linear[0]) < 1.5
    assert np.diff(stamps(found)).min() >= 0.0
    kinds = {one.msgtype for one in heard}
    assert kinds == {"sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix", "nav_msgs/msg/Odometry"}
    for raw in heard[:100]:
        typestore().deserialize_cdr(raw.cdr, raw.msgtype)


@pytest.mark.parametrize("form", ["mcap_folder", "sqlite_folder"])
@pytest.mark.parametrize("is_named_by_its_metadata", [True, False])
def test_a_pipe_in_a_folder_is_no_file(
    form: str, is_named_by_its_metadata: bool, tmp_path: Path
) -> None:
    folder = FORMATS[form](tmp_path, [("/wrist", SECOND * i, wrench(i, 1.0)) for i in range(4)])
    (file,) = (path for path in folder.iterdir() if path.suffix != ".yaml")
    file.unlink()
    os.mkfifo(file)
    why = f"{file} is no regular file"
    if not is_named_by_its_metadata:
        (folder / "metadata.yaml").unlink()
        why = "there is no .*, .mcap, .db3 in the folder"
    command = [sys.executable, "-m", "contactfusion", "inspect", str(folder)]
    done = run(command, capture_output=True, text=True, timeout=30.0)
    assert done.returncode == 1
    assert re.search(why, done.stderr) and len(done.stderr.splitlines()) == 1
