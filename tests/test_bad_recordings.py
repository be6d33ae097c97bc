"""Recordings that go wrong in the ways of robots: what was found is kept, and a sentence says why.

Each way, in a bag of ROS 1 and in MCAP: cut off, of unknown types, with clocks that jump, frames of
which nobody tells, topics that never come or come twice, clouds of odd bytes, and a full disk.
"""

from collections.abc import Iterable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ContactFusionError, RecordingError, WritingError
from contactfusion.readings import Reading, Transform, Wrench
from contactfusion.recordings.messages import reading_messages, typestore
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import Window
from contactfusion.recordings.ros import RosConfig, RosRecording
from contactfusion.recordings.ros.order import LONGEST_LEAP, LONGEST_PAUSE
from contactfusion.run.asking import Source, ablate_recording, explain_recording
from contactfusion.run.execute import Pace, run_file
from tests.mcap_files import disk_of, read_by_mcap_ros2
from tests.ros_bags import EPOCH, FORMATS, SECOND, Said, Write, ros1, text, transforms, wrench
from tests.toys import offer_toys, point
from tests.toys import wrench as touch

writing = pytest.importorskip("mcap.writer")

PLACE = (0.1025, 0.0025, 0.0025)
STEP = SECOND // 20
CONFIG = """
generators:
  eye: {type: echo, sensor: eye}
  hand: {type: feeler, sensor: wrist}
integrator: {frame: base}
cycle: {every: 0.1}
"""
DAY = 24 * 3600 * SECOND


@pytest.fixture(autouse=True)
def _toys(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_toys(monkeypatch)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text(CONFIG)
    return path


@pytest.fixture(params=["ros1", "mcap"])
def write(request: pytest.FixtureRequest) -> Write:
    made: Write = FORMATS[request.param]
    return made


def drive(seconds: float = 2.0, frame: str = "base") -> list[Said]:
    """What an eye and a wrist tell, twenty times a second."""
    return [said for stamp in np.arange(0, seconds, 0.05).tolist() for said in told(stamp, frame)]


def told(stamp: float, frame: str = "base") -> Iterator[Said]:
    after = round(stamp * SECOND)
    eye = point(0.0, *PLACE, frame=frame, sensor="eye")
    wrist = touch(0.0, *PLACE, sensor="wrist")
    for reading in (eye, wrist):
        for topic, one in reading_messages(reading, f"/{reading.sensor}", EPOCH + after):
            yield topic, after, one


def moved(
    said: Iterable[Said], log: int, headers: int, since: float, topic: str = ""
) -> list[Said]:
    """Give messages of which the clocks of log and headers [ns] are set at a time [s]."""
    found = []
    for name, logged, one in said:
        other = deepcopy(one)
        if logged >= since * SECOND and topic in name:
            stamp = EPOCH + logged + headers
            other.header.stamp.sec, other.header.stamp.nanosec = divmod(stamp, SECOND)
            logged += log
        found.append((name, logged, other))
    return found


def played(config: Path, path: Path) -> tuple[int, str]:
    """Replay to MCAP: give how many steps it holds then, and what was wrong."""
    out, problem = config.with_name("out.mcap"), ""
    try:
        run_file(config, path, out=out)
    except ContactFusionError as error:
        problem = str(error)
    assert "\n" not in problem
    return len(read_by_mcap_ros2(out).get("/contactfusion/contacts", ())), problem


def places(config: Path, path: Path) -> list[Any]:
    """Give where contacts were found in a recording, and when."""
    out = config.with_name("out.csv")
    run_file(config, path, out=out)
    return [line.split(",")[:4] for line in out.read_text().splitlines()[1:]]


def read(path: Path) -> tuple[list[Reading], str]:
    """Give the readings of a recording, and what ended them."""
    found: list[Reading] = []
    try:
        for one in open_recording(path).readings():
            found.append(one)
    except RecordingError as error:
        return found, str(error)
    return found, ""


def raw_mcap(
    path: Path, profile: str, channels: dict[str, tuple[str, str, str, str]], said: Any
) -> Path:
    """Write MCAP with a writer that knows nothing of ROS.

    Args:
        path: the file.
        profile: what it calls itself.
        channels: by topic the name of its type, the encoding and the text of its definition, and
            the encoding of messages.
        said: topics, stamps after `EPOCH` [ns], and bytes.
    """
    with path.open("wb") as file:
        writer = writing.Writer(file, chunk_size=20_000)
        writer.start(profile=profile, library="test")
        numbers = {
            topic: writer.register_channel(
                topic, how, writer.register_schema(name, encoding, definition.encode())
            )
            for topic, (name, encoding, definition, how) in channels.items()
        }
        for topic, logged, raw in said:
            writer.add_message(numbers[topic], EPOCH + logged, raw, EPOCH + logged)
        writer.finish()
    return path


def in_small_chunks(path: Path, said: Iterable[Said]) -> Path:
    """Write MCAP of ROS 2, in chunks that are small enough to lose some of them."""
    channels, raw = {}, []
    for topic, logged, one in said:
        kind = one.__msgtype__
        if topic not in channels:
            definition = typestore().generate_msgdef(kind, ros_version=2)[0]
            channels[topic] = kind, "ros2msg", definition, "cdr"
        raw.append((topic, logged, bytes(typestore().serialize_cdr(one, kind))))
    return raw_mcap(path, "ros2", channels, raw)


# Cut off


@pytest.mark.parametrize("name", ["ros1", "mcap"])
def test_of_a_recording_that_is_cut_off_all_contacts_before_are_kept(
    config: Path, tmp_path: Path, name: str
) -> None:
    said = drive(20.0)
    if name == "ros1":
        path = ros1(tmp_path, said, size=20_000)
    else:
        path = in_small_chunks(tmp_path / "drive.mcap", said)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    steps, problem = played(config, path)
    heard = open_recording(path)
    assert isinstance(heard, RosRecording)
    messages = sum(topic.count for topic in heard.contents.values())
    assert len(said) // 4 < messages < len(said)
    assert steps >= messages // 4 - 1  # of an eye and a wrist, at 20 Hz, in steps of 0.1 s
    assert problem.startswith(f"{path} is cut off after {messages} messages; mend it by: ")


def test_a_cut_file_in_a_folder_of_rosbag2_leaves_all_before_it(
    config: Path, tmp_path: Path
) -> None:
    said = drive(10.0)
    folder = FORMATS["mcap_folder"](tmp_path, said)
    (cut,) = folder.glob("*.mcap")
    in_small_chunks(cut, said)
    assert played(config, folder) == (100, "")
    whole = cut.read_bytes()
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    steps, problem = played(config, folder)
    assert steps > 30
    assert problem.startswith(f"{cut} is cut off after ")


@pytest.mark.parametrize("seconds", [1.0, 20.0])
def test_garbage_within_mcap_ends_it_where_a_checksum_is_wrong(
    tmp_path: Path, seconds: float
) -> None:
    path = in_small_chunks(tmp_path / "drive.mcap", said := drive(seconds))
    raw = bytearray(path.read_bytes())
    middle = raw.index(b"zstd", len(raw) // 2 if seconds > 1.0 else 0) + 100
    raw[middle : middle + 20] = bytes(20)
    path.write_bytes(raw)
    found, problem = read(path)
    assert len(found) < len(said) and (len(found) > 100) == (seconds > 1.0)
    assert f"{path} is damaged after {len(found)} messages (" in problem


def test_of_split_files_one_that_is_empty_takes_nothing_from_the_others(
    config: Path, tmp_path: Path
) -> None:
    folder = FORMATS["mcap_folder"](tmp_path, drive())
    for name, told in (("later.mcap", "seems to be empty"), ("later.bag", "seems to be empty")):
        (folder / name).touch()
        (folder / "metadata.yaml").unlink(missing_ok=True)
        steps, problem = played(config, folder)
        assert steps >= 19
        assert f"{folder / name} can't be read: " in problem and told in problem
        (folder / name).unlink()


# Unknown types


def test_channels_that_no_ros_wrote_are_passed_over(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kind = wrench().__msgtype__
    definition = typestore().generate_msgdef(kind, ros_version=2)[0]
    channels = {
        "/log": ("foxglove.Log", "jsonschema", "{}", "json"),
        "/scan": ("foxglove.PointCloud", "protobuf", "?", "protobuf"),
        "/wrist": (kind, "ros2msg", definition, "cdr"),
    }
    raw = bytes(typestore().serialize_cdr(wrench(), kind))
    said = [("/log", 0, b"{}"), ("/scan", 1, b"?"), ("/wrist", 2, raw)]
    for profile in ("ros2", ""):
        path = raw_mcap(tmp_path / "mixed.mcap", profile, channels, said)
        recording = RosRecording(RosConfig(file=path))
        assert [one.sensor for one in recording.readings()] == ["wrist"]
        assert recording.contents["/log"].msgtype == "foxglove.Log as jsonschema"
    config.write_text(
        CONFIG.replace("  eye: {type: echo, sensor: eye}", "").replace(
            "frame: base", "frame: wrist"
        )
    )
    run_file(config, path, out=tmp_path / "out.mcap")
    told = capsys.readouterr().out
    assert "not copied: /log, as nothing defines foxglove.Log as jsonschema" in told
    assert "/wrist" in read_by_mcap_ros2(tmp_path / "out.mcap")
    path.write_bytes(path.read_bytes()[:-50])
    assert [one.sensor for one in read(path)[0]] == ["wrist"]


def test_a_file_of_nothing_that_ros_knows_says_what_it_holds(tmp_path: Path) -> None:
    channels = {"/scan": ("foxglove.PointCloud", "protobuf", "?", "protobuf")}
    path = raw_mcap(tmp_path / "scan.mcap", "", channels, [("/scan", 0, b"?")])
    with pytest.raises(RecordingError, match=r"holds: /scan \(foxglove.PointCloud as protobuf\)"):
        open_recording(path)


def test_an_mcap_of_ros_1_is_read_as_its_bag(config: Path, tmp_path: Path) -> None:
    from rosbags.typesys import Stores, get_typestore

    noetic, said = get_typestore(Stores.ROS1_NOETIC), drive()
    channels = {
        topic: (
            one.__msgtype__.replace("/msg/", "/"),
            "ros1msg",
            noetic.generate_msgdef(one.__msgtype__, ros_version=1)[0],
            "ros1",
        )
        for topic, _, one in said
    }
    raw = [
        (topic, logged, bytes(typestore().cdr_to_ros1(
            typestore().serialize_cdr(one, one.__msgtype__), one.__msgtype__)))
        for topic, logged, one in said
    ]  # fmt: skip
    path = raw_mcap(tmp_path / "ros1.mcap", "ros1", channels, raw)
    assert places(config, path) == places(config, ros1(tmp_path, said))
    assert played(config, path) == (20, "")


def test_a_sensor_of_an_unknown_type_is_missing_and_the_rest_is_played(
    config: Path, write: Write, tmp_path: Path
) -> None:
    said = [("/eye", at, text()) if topic == "/eye" else (topic, at, one)
            for topic, at, one in drive()]  # fmt: skip
    steps, problem = played(config, write(tmp_path, said))
    assert steps == 20
    assert "robot.yaml: generators.eye: the recording holds no PointCloud" in problem


# Clocks


@pytest.mark.parametrize("log", [0, -5 * SECOND])
def test_a_clock_that_is_set_back_ends_it_there(
    config: Path, write: Write, tmp_path: Path, log: int
) -> None:
    path = write(tmp_path, moved(drive(), log, -5 * SECOND, since=1.0))
    found, problem = read(path)
    assert problem == f"{path}, /eye: its clock jumps back by 4.95 s at 0.950 s"
    assert [round(one.stamp, 2) for one in found[::2]] == [round(0.05 * i, 2) for i in range(20)]
    steps, same = played(config, path)
    assert steps >= 9 and same == problem


def test_a_log_that_is_set_back_loses_nothing_while_headers_go_on(
    write: Write, tmp_path: Path
) -> None:
    found, problem = read(write(tmp_path, moved(drive(), -5 * SECOND, 0, since=1.0)))
    assert (len(found), problem) == (80, "")
    assert [one.stamp for one in found] == sorted(one.stamp for one in found)


def test_what_a_program_wrote_in_an_order_of_its_own_is_sorted(
    write: Write, tmp_path: Path
) -> None:
    said = drive(5.0)
    by_topic = sorted(said, key=lambda one: one[0])
    in_stripes = [one for i in range(7) for one in said[i::7]]
    for number, order in enumerate((by_topic, said[::-1], in_stripes)):
        found, problem = read(write(tmp_path / str(number), order))
        assert (len(found), problem) == (200, "")


def test_a_clock_that_is_set_when_the_network_comes_ends_it_there(
    config: Path, write: Write, tmp_path: Path
) -> None:
    path = write(tmp_path, moved(drive(), 3650 * DAY, 3650 * DAY, since=1.0))
    steps, problem = played(config, path)  # and does not step through ten years
    assert 9 <= steps <= 10
    assert f"{path}, all clocks leap ahead by 3650.0 days at 0.950 s" in problem
    later = RosRecording(RosConfig(file=path, start=LONGEST_PAUSE / SECOND))
    assert len(list(later.readings())) == 40


def test_of_one_clock_that_leaps_ahead_the_others_do_not_suffer(
    config: Path, write: Write, tmp_path: Path
) -> None:
    path = write(tmp_path, moved(drive(), 0, 30 * SECOND, since=1.0, topic="/eye"))
    steps, problem = played(config, path)
    assert problem == f"{path}, /eye: its clock jumps ahead by 30.05 s at 0.950 s"
    assert 9 <= steps <= 10
    found, _ = read(path)
    assert max(one.stamp for one in found) < 2.0


def test_of_a_clock_that_leaps_ahead_and_back_the_leap_is_told(
    config: Path, write: Write, tmp_path: Path
) -> None:
    said = moved(drive(1.0), 0, 30 * SECOND, since=0.95, topic="/eye")
    path = write(tmp_path, [*said, *moved(drive(2.0), 0, 0, since=1.0)[len(said) :]])
    steps, problem = played(config, path)
    assert problem == f"{path}, /eye: its clock jumps ahead by 30.05 s at 0.900 s"
    assert 8 <= steps <= 10  # not those of 30 seconds of nothing


def test_all_clocks_may_leap_together_as_that_of_a_simulator(write: Write, tmp_path: Path) -> None:
    for number, leap in enumerate((30 * SECOND, LONGEST_LEAP // 2)):
        said = moved(drive(), 0, leap, since=1.0)
        found, problem = read(write(tmp_path / str(number), said))
        assert (len(found), problem) == (80, "")


def test_what_is_on_its_way_when_all_clocks_leap_is_late_and_no_more(
    write: Write, tmp_path: Path
) -> None:
    said = moved(drive(), 0, 30 * SECOND, since=1.0, topic="/eye")
    path = write(tmp_path, moved(said, 0, 30 * SECOND, since=1.3, topic="/wrist"))
    recording = open_recording(path)
    assert isinstance(recording, RosRecording)
    assert len(list(recording.readings())) == 74
    assert recording.tally["/wrist"].refused == 6


def test_what_lags_after_a_leap_for_reasons_of_its_own_is_late_and_no_more(
    write: Write, tmp_path: Path
) -> None:
    lags = [(1.7, 20.0), (1.8, 22.0), (3.7, 31.5), (3.8, 31.6)]  # when, and of what stamp [s]
    said = moved(drive(4.0), 0, 30 * SECOND, since=1.0)
    for when, stamp in lags:
        said.append(("/slow", round(when * SECOND), wrench(round(stamp * SECOND))))
    recording = open_recording(write(tmp_path, sorted(said, key=lambda one: one[1])))
    assert isinstance(recording, RosRecording)
    assert len(list(recording.readings())) == 160
    assert recording.tally["/slow"].refused == 4


@pytest.mark.parametrize("late", [0.3, 1.3, 3.0])
def test_a_sensor_whose_headers_are_late_blames_nobody(
    write: Write, tmp_path: Path, late: float
) -> None:
    said = []
    for topic, logged, one in drive(4.0):
        lag = late if topic == "/wrist" else 0.02
        stamp = EPOCH + logged - round(lag * SECOND) + 4 * SECOND
        one.header.stamp.sec, one.header.stamp.nanosec = divmod(stamp, SECOND)
        said.append((topic, logged, one))
    said.sort(key=lambda it: (it[1], it[0] != "/wrist"))  # what is late comes first
    found, problem = read(write(tmp_path / "bag", said))
    assert problem == "" and sum(one.sensor == "eye" for one in found) == 80


def test_transforms_of_times_to_come_make_nothing_late(write: Write, tmp_path: Path) -> None:
    said = drive()
    ahead = 2 * SECOND  # as localisation tells them, so that nobody has to wait
    for i in range(40):
        said.append(("/tf", i * STEP, transforms((i * STEP + ahead, "map", "odom"))))
    recording = open_recording(write(tmp_path, sorted(said, key=lambda one: one[1])))
    assert isinstance(recording, RosRecording)
    assert len(list(recording.readings())) == 120
    assert {one.refused for one in recording.tally.values()} == {0}


# Frames


def test_a_frame_of_which_nobody_tells_is_named_with_those_that_are_known(
    config: Path, write: Write, tmp_path: Path
) -> None:
    said = [*drive(frame="lens"), ("/tf", 0, transforms((0, "base", "arm")))]
    steps, problem = played(config, write(tmp_path, said))
    assert steps == 20
    assert "every cloud of 'eye' was refused: unknown frame 'lens': the frames are: " in problem
    assert "arm, base" in problem


def test_what_comes_after_the_last_transform_is_refused_and_counted(
    config: Path, write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = [("/tf", i * STEP, transforms((i * STEP, "base", "lens"))) for i in range(20)]
    path = write(tmp_path, sorted([*drive(frame="lens"), *known], key=lambda one: one[1]))
    assert played(config, path) == (20, "")
    said = capsys.readouterr().out
    assert "missing transforms: 20 clouds of 'eye' were refused" in said
    assert "'lens' in 'base' is not known at 1.000 s: there is one from 0.000 to 0.950 s" in said


# Topics


def test_a_topic_that_never_comes_is_an_error_and_the_rest_is_kept(
    config: Path, write: Write, tmp_path: Path
) -> None:
    said = [one for one in drive() if one[0] == "/wrist"]
    steps, problem = played(config, write(tmp_path, said))
    assert steps == 20
    assert "generators.eye: the recording holds no PointCloud" in problem


def test_two_publishers_of_one_topic_are_both_heard_and_told(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said: list[Any] = [
        (("/eye", f"/driver_{i % 4 // 2}") if topic == "/eye" else topic, at, one)
        for i, (topic, at, one) in enumerate(drive())
    ]
    assert played(config, ros1(tmp_path, said)) == (20, "")
    table = capsys.readouterr().out.splitlines()
    eye = next(line.split() for line in table if line.startswith("eye "))
    assert eye == ["eye", "PointCloud", "40", "20", "0", "0.050", "2", "publishers"]


def test_two_publishers_of_one_topic_are_two_channels_of_mcap(tmp_path: Path) -> None:
    kind = wrench().__msgtype__
    definition = typestore().generate_msgdef(kind, ros_version=2)[0]
    path = tmp_path / "two.mcap"
    with path.open("wb") as file:
        writer = writing.Writer(file)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema(kind, "ros2msg", definition.encode())
        channels = [writer.register_channel("/wrist", "cdr", schema) for _ in range(2)]
        for i in range(10):
            raw = bytes(typestore().serialize_cdr(wrench(i), kind))
            writer.add_message(channels[i % 2], EPOCH + i, raw, EPOCH + i)
        writer.finish()
    recording = RosRecording(RosConfig(file=path))
    assert recording.contents["/wrist"].publishers == 2
    assert len(list(recording.readings())) == 10


# Clouds


def test_clouds_without_xyz_are_counted_with_the_fields_that_they_have(
    config: Path, write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = drive()
    for number, (topic, _, one) in enumerate(said):
        if topic == "/eye" and number % 4 == 0:
            for field, name in zip(one.fields, ("range", "azimuth", "ring"), strict=True):
                field.name = name
    assert played(config, write(tmp_path, said)) == (20, "")
    wrong = "20 unreadable: the cloud has no field 'x'; its fields are: range, azimuth, ring"
    assert wrong in capsys.readouterr().out


def test_clouds_of_big_endian_floats_are_where_they_were(
    config: Path, write: Write, tmp_path: Path
) -> None:
    said = drive()
    wanted = places(config, write(tmp_path / "little", said))
    for topic, _, one in said:
        if topic == "/eye":
            floats = np.frombuffer(one.data.tobytes(), "<f4").astype(">f4")
            one.data, one.is_bigendian = floats.view(np.uint8), True
    assert places(config, write(tmp_path / "big", said)) == wanted
    assert len(wanted) == 20 and float(wanted[5][1]) == pytest.approx(PLACE[0])


def test_a_sensor_of_which_less_than_half_can_be_used_is_an_error(
    config: Path, write: Write, tmp_path: Path
) -> None:
    said = drive(2.0)
    for name, logged, one in said:
        if name == "/eye" and logged >= 0.5 * SECOND:
            one.fields = one.fields[:2]
    steps, problem = played(config, write(tmp_path / "bag", said))
    assert steps == 20
    assert f"{config}: of 'eye' only 10 readings could be used: 30 unreadable: " in problem


def test_a_start_after_the_end_is_named_and_an_older_file_stays(
    config: Path, write: Write, tmp_path: Path
) -> None:
    path, out = write(tmp_path / "bag", drive(1.0)), tmp_path / "out.mcap"
    out.write_text("of old")
    with pytest.raises(ContactFusionError, match="--start, .* holds nothing from 100 s on$"):
        run_file(config, path, window=Window(start=100.0), out=out)
    with pytest.raises(ContactFusionError, match="--duration: .* nothing from 0 s on for 0 s$"):
        run_file(config, path, window=Window(duration=0.0), out=out)
    assert out.read_text() == "of old"


def test_questions_to_a_recording_that_is_cut_off_are_answered_before_that_is_told(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = FORMATS["mcap"](tmp_path / "bag", drive(2.0))
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole.read_bytes()[:-2000])
    source = Source(path, config)
    with pytest.raises(RecordingError, match="is cut off after"):
        ablate_recording(source, tmp_path / "ablation")
    assert (tmp_path / "ablation" / "ablation.csv").is_file()
    with pytest.raises(RecordingError, match="is cut off after"):
        explain_recording(source, 60.0, None, as_json=False, picture=None)
    capsys.readouterr()
    explain_recording(source, 0.5, None, as_json=False, picture=None)
    assert "0.500 s: 1 contact" in capsys.readouterr().out


def test_a_replay_of_what_a_broken_clock_left_is_no_longer_broken(
    config: Path, write: Write, tmp_path: Path
) -> None:
    path = write(tmp_path / "bag", moved(drive(2.0), 0, -7200 * SECOND, 1.0))
    first = played(config, path)
    assert first[0] == 10 and "jumps back" in first[1]
    again = config.with_name("again.mcap")
    run_file(config, config.with_name("out.mcap"), out=again)
    assert len(read_by_mcap_ros2(again)["/contactfusion/contacts"]) == 10


# A full disk


@pytest.mark.parametrize("suffix", [".mcap", ".csv", ".parquet"])
def test_on_a_full_disk_an_older_file_stays_and_what_was_written_is_kept_beside_it(
    config: Path, write: Write, tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, drive(15.0))
    out = tmp_path / "results" / f"out{suffix}"
    cut = out.with_suffix(f".cut{suffix}")
    out.parent.mkdir()
    out.write_text("of old")
    kept = "" if suffix == ".parquet" else f"what was written until then is {cut}"
    with disk_of(2_000), pytest.raises(WritingError, match=f"can't be written: .*{kept}"):
        run_file(config, path, out=out)
    assert out.read_text() == "of old"
    assert set(out.parent.iterdir()) == {out} | ({cut} if kept else set())
    assert " steps, " in capsys.readouterr().out
    if suffix == ".csv":
        whole = out.parent / "whole.csv"
        run_file(config, path, out=whole)
        assert whole.read_text().startswith(cut.read_text()) and len(cut.read_text()) > 1000


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_many_files_are_not_open_at_once_and_are_read_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.setattr("contactfusion.recordings.ros.files.MOST_OPEN", 2)
    folder, forces = tmp_path / "all", [float(number) for number in range(24)]
    folder.mkdir()
    for number in range(8):
        said = [
            ("/wrist", n * STEP, wrench(n * STEP, n)) for n in range(3 * number, 3 * number + 3)
        ]
        made = FORMATS[kind](tmp_path / str(number), said)
        made.rename(folder / f"part{(5 * number) % 8}{made.suffix}")  # not in the order of names
    descriptors, most = len(list(Path("/proc/self/fd").iterdir())), 0
    found = []
    for reading in open_recording(folder).readings():
        most = max(most, len(list(Path("/proc/self/fd").iterdir())))
        found.append(reading)
    assert [one.force[0] for one in found if isinstance(one, Wrench)] == forces
    assert most - descriptors <= 4


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_files_that_overlap_are_merged_however_many_are_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    folder = tmp_path / "all"
    folder.mkdir()
    for number in range(5):
        said = [("/wrist", n * STEP, wrench(n * STEP, n)) for n in range(number, 40, 1 + number)]
        made = FORMATS[kind](tmp_path / str(number), said)
        made.rename(folder / f"part{number}{made.suffix}")
    whole = [repr(one) for one in open_recording(folder).readings()]
    monkeypatch.setattr("contactfusion.recordings.ros.files.MOST_OPEN", 1)
    assert [repr(one) for one in open_recording(folder).readings()] == whole


def test_transforms_that_come_ahead_are_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    slept = list[float]()
    monkeypatch.setattr("time.sleep", slept.append)
    monkeypatch.setattr("time.perf_counter", lambda: 100.0)
    pace, still = Pace(1.0), np.array([0.0, 0.0, 0.0, 1.0])
    ahead = Transform(
        stamp=1.0, frame="map", child_frame="base", position=np.zeros(3), orientation=still
    )
    for reading in (touch(0.0, 0.0, 0.0, 1.0), ahead, touch(0.1, 0.0, 0.0, 1.0)):
        pace.wait(reading)
    assert slept == pytest.approx([0.0, 0.1])
    assert not list(pace.lines())
