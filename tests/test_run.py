"""Replays: a recording in, contacts out, and everything that can be wrong with either."""

import csv
import re
from collections import Counter
from collections.abc import Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pyarrow import parquet

from contactfusion.check import check_file
from contactfusion.cli import main
from contactfusion.errors import ConfigurationError, RecordingError, WritingError
from contactfusion.loop import Observer
from contactfusion.pipeline import Step
from contactfusion.readings import (
    DepthImage,
    JointState,
    ObjectPose,
    PointCloud,
    Reading,
    Transform,
)
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.recording import RawMessage, Window
from contactfusion.recordings.ros import RosConfig, RosRecording
from contactfusion.run.configuration import setting_of_file, setting_of_recording
from contactfusion.run.execute import run_file
from contactfusion.run.session import Session
from tests.toys import offer_toys, point, wrench

EPOCH = 1_700_000_000_000_000_000
K = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
PLACE = (0.1025, 0.0025, 0.0025)
CONFIG = """
generators:
  eye: {type: echo, sensor: eye}
  hand: {type: feeler}
integrator: {frame: base}
cycle: {every: 0.1}
"""


@pytest.fixture(autouse=True)
def _toys(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_toys(monkeypatch)


def touching(seconds: float = 1.0, frame: str = "base") -> Iterable[Reading]:
    for stamp in np.arange(0.0, seconds + 1e-9, 0.05).tolist():
        yield point(stamp, *PLACE, sensor="eye", frame=frame)
        yield wrench(stamp, *PLACE, sensor="wrist")


def recorded(path: Path, readings: Iterable[Reading]) -> Path:
    with McapWriter(path, EPOCH) as writer:
        for reading in readings:
            writer.reading(reading)
    return path


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text(CONFIG)
    return path


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return recorded(tmp_path / "drive.mcap", touching())


def messages(path: Path) -> dict[str, list[Any]]:
    """Read with a reader that is not ours."""
    found: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append(message)
    return found


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_recording_keeps_its_topics_and_gets_contacts(config: Path, recording: Path) -> None:
    out = config.with_name("out.mcap")
    run_file(config, recording, out=out)
    before, after = messages(recording), messages(out)
    assert {topic: len(sent) for topic, sent in before.items()} == {"/eye": 21, "/wrist": 21}
    for topic, sent in before.items():
        assert [str(one) for one in after[topic]] == [str(one) for one in sent]
    contacts = after["/contactfusion/contacts"]
    assert len(contacts) == 10
    where = contacts[3].contacts[0].position
    assert (where.x, where.y, where.z) == pytest.approx(PLACE)
    assert "/contactfusion/contacts/markers" in after
    cloud = after["/contactfusion/contacts/voxels"][3]
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "likelihood", "verdict"]


def test_of_one_sensor_all_topics_are_heard_those_of_another_kind_by_their_own_names(
    config: Path, tmp_path: Path
) -> None:
    """A camera that tells clouds and images, and a tracker of two objects."""
    seen: list[Reading] = []
    for stamp in (0.0, 0.1, 0.2):
        seen.append(point(stamp, *PLACE, sensor="eye"))
        seen.append(
            DepthImage(stamp=stamp, frame="base", sensor="eye", depth=np.ones((2, 3)), intrinsics=K)
        )
        seen += [
            ObjectPose(stamp=stamp, frame="base", sensor="tracker", name=name, position=np.zeros(3),
                       orientation=np.array([0.0, 0.0, 0.0, 1.0]))
            for name in ("box", "cup")
        ]  # fmt: skip
    path = recorded(tmp_path / "seen.mcap", seen)
    session = Session(setting_of_file(config), path, watched=True)
    heard = [(type(one), one.sensor) for one in session.readings()]
    assert Counter(heard) == {
        (PointCloud, "eye"): 3,
        (DepthImage, "eye/depth"): 3,
        (ObjectPose, "tracker"): 6,
    }


def test_of_several_topics_of_a_sensor_the_one_that_is_of_no_use_is_named(
    config: Path, tmp_path: Path
) -> None:
    poses = [
        ObjectPose(stamp=stamp, frame="base", sensor="tracker", name=name,
                   position=np.zeros(3), orientation=np.array([0.0, 0.0, 0.0, 1.0]))
        for stamp in (0.0, 0.1)
        for name in ("box", "cup")
    ]  # fmt: skip
    path = recorded(tmp_path / "seen.mcap", [*touching(0.2), *poses])
    listening = ["generators.seen.type=follower", "generators.seen.sensor=tracker"]
    session = Session(setting_of_file(config, listening), path)
    assert len(list(session.readings())) > 0
    played = session.stream
    assert isinstance(played, RosRecording)
    tally = played.tally["/tracker/cup"]
    tally.readings, tally.refused, tally.why_refused = 0, 2, "odd"
    assert list(session.losses()) == [
        "of 'tracker', /tracker/cup, nothing could be used: 2 refused: odd"
    ]
    assert [one.note for one in played.troubles()] == ["/tracker/cup: 2 refused: odd"]


def without_frames(recording: Path, topic: str) -> Path:
    """The same recording, in which the headers of a topic name no frame."""
    store, path = typestore(), recording.with_name("frameless.mcap")
    heard: list[RawMessage] = []
    list(RosRecording(RosConfig(file=recording), tap=heard.append).readings())
    with McapWriter(path) as writer:
        for one in heard:
            if one.topic == topic:
                message: Any = store.deserialize_cdr(one.cdr, one.msgtype)
                message.header.frame_id = ""
                one = one._replace(cdr=bytes(store.serialize_cdr(message, one.msgtype)))
            writer.copy(one)
    return path


@pytest.fixture
def tracked(tmp_path: Path) -> Path:
    """A recording with a tracker that tells poses in no frame."""
    poses = [
        ObjectPose(stamp=one.stamp, frame="x", sensor="tracker", name="cup",
                   position=np.zeros(3), orientation=np.array([0.0, 0.0, 0.0, 1.0]))
        for one in touching()
    ]  # fmt: skip
    readings = sorted([*touching(), *poses], key=lambda one: one.stamp)
    return without_frames(recorded(tmp_path / "tracked.mcap", readings), "/tracker/cup")


def test_what_nothing_listens_to_is_noted_and_no_failure(
    config: Path, tracked: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_file(config, tracked)
    told = capsys.readouterr().out
    assert "42 refused: ObjectPose of 'tracker' needs the name of its frame" in told
    with pytest.raises(ConfigurationError, match="of 'tracker' nothing could be used: 42 refused"):
        run_file(config, tracked, overrides=["generators.seen.type=follower"])


def test_joints_that_no_robot_needs_are_no_failure(config: Path, tmp_path: Path) -> None:
    joints = JointState(stamp=0.0, frame="x", sensor="gripper", names=("a",), positions=np.zeros(1))
    session = Session(setting_of_file(config), recorded(tmp_path / "a.mcap", [joints, *touching()]))
    list(session.readings())
    played = session.stream
    assert isinstance(played, RosRecording)
    tally = played.tally["/gripper"]
    tally.readings, tally.unreadable, tally.why_unreadable = 0, 1, "it tells no positions"
    assert list(session.losses()) == []


def test_a_topic_can_be_ignored(
    config: Path, tracked: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = config.with_name("out.mcap")
    run_file(config, tracked, out=out, ignored=["tracker/cup"])
    assert "tracker" not in capsys.readouterr().out
    assert len(messages(out)["/tracker/cup"]) == 42, "it is kept, as all that was recorded"
    assert setting_of_recording(out).ignored == ("tracker/cup",)
    with pytest.raises(RecordingError, match="no topic '/tracker/cap' to ignore; did you mean '/t"):
        run_file(config, tracked, ignored=["/tracker/cap"])


def log_of(folder: Path) -> Path:
    """A log of two wrenches and a description of it."""
    rows = np.column_stack(
        [np.arange(1.0, 2.0, 0.05), np.tile([*PLACE, 0, 0, 0, *np.ones(6)], (20, 1))]
    )
    np.savetxt(folder / "log.csv", rows, delimiter=",")
    columns = "{type: wrench, frame: base, columns: "
    (folder / "log.yaml").write_text(
        "type: log\nfile: log.csv\ntime: {column: 1}\nreadings:\n"
        f"  ft/1: {columns}2..7}}\n  ft/other: {columns}8..13}}\n"
    )
    return folder / "log.yaml"


@pytest.mark.parametrize("sensor", [None, "palm"])
def test_a_chosen_topic_of_a_log_is_found_in_what_a_replay_wrote(
    tmp_path: Path, sensor: str | None
) -> None:
    """There it is called like the sensor that it feeds, and as ROS allows."""
    config, out = tmp_path / "robot.yaml", tmp_path / "out.mcap"
    options = "" if sensor is None else f", sensor: {sensor}"
    config.write_text(
        f"generators: {{hand: {{type: feeler{options}}}}}\nintegrator: {{frame: base}}\n"
    )
    log = log_of(tmp_path)
    run_file(config, log, topics={sensor or "hand": "/ft/1"}, out=out)
    chosen = setting_of_file(config).choosing({sensor or "hand": "ft/1"}, ())
    first, second = Session(chosen, log), Session(setting_of_recording(out), out)
    found = [[len(step.fusion.contacts) for step in one.steps()] for one in (first, second)]
    assert found[0] == found[1] and sum(found[0]) > 0


def test_of_a_log_a_topic_can_be_ignored(tmp_path: Path) -> None:
    config, out, log = tmp_path / "robot.yaml", tmp_path / "out.mcap", log_of(tmp_path)
    config.write_text("generators: {hand: {type: feeler}}\nintegrator: {frame: base}\n")
    run_file(config, log, ignored=["/ft/other"], out=out)
    assert set(RosRecording(RosConfig(file=out)).topics) == {"ft/_1"}
    assert setting_of_recording(out).ignored == ()
    with pytest.raises(RecordingError, match="no topic 'ft/othr' to ignore; did you mean 'ft/oth"):
        run_file(config, log, ignored=["/ft/othr"])


@pytest.mark.parametrize("suffix", ["mcap", "log"])
def test_of_a_generator_whose_only_topic_is_ignored_that_is_said(
    suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "robot.yaml"
    config.write_text("generators: {hand: {type: feeler}}\nintegrator: {frame: base}\n")
    felt = [wrench(0.1 * row, *PLACE, sensor="ft") for row in range(5)]
    path = recorded(tmp_path / "drive.mcap", [*felt, point(0.0, *PLACE, sensor="eye")])
    ignored = ["/ft"]
    if suffix == "log":
        path, ignored = log_of(tmp_path), ["ft/1", "ft/other"]
    names = ", ".join(f"/{one.removeprefix('/')}" for one in ignored)
    sentence = f"generators.hand: nothing feeds it, as {names} is ignored (--ignore)"
    with pytest.raises(ConfigurationError, match=re.escape(sentence)):
        run_file(config, path, ignored=ignored)
    printed = capsys.readouterr().out
    assert sentence in printed and "holds no" not in printed


def test_a_topic_that_is_taken_for_another_name_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, path = tmp_path / "robot.yaml", tmp_path / "drive.mcap"
    config.write_text(
        "generators: {hand: {type: feeler, sensor: ft/wrnch}}\nintegrator: {frame: base}\n"
    )
    recorded(path, [wrench(0.1 * row, *PLACE, sensor="ft/wrench") for row in range(5)])
    sentence = (
        "generators.hand: no topic is called 'ft/wrnch', so /ft/wrench feeds it, the only Wrench"
    )
    run_file(config, path)
    assert sentence in capsys.readouterr().out
    assert sentence in check_file(config, path).lines
    run_file(config, path, topics={"ft/wrnch": "/ft/wrench"})
    run_file(config, path, overrides=["generators.hand.sensor=ft/wrench"])
    assert "no topic is called" not in capsys.readouterr().out


def test_of_a_camera_that_tells_clouds_too_the_images_feed_who_takes_images(
    tmp_path: Path,
) -> None:
    image = DepthImage(stamp=0.0, frame="base", sensor="eye", depth=np.ones((2, 3)), intrinsics=K)
    path = recorded(tmp_path / "seen.mcap", [point(0.0, *PLACE, sensor="eye"), image])
    for sensor in ("", ", sensor: eye"):
        (tmp_path / "robot.yaml").write_text(
            "generators: {look: {type: looker" + sensor + "}}\nintegrator: {frame: base}\n"
        )
        session = Session(setting_of_file(tmp_path / "robot.yaml"), path)
        (one,) = session.readings()
        assert isinstance(one, DepthImage)
        assert one.sensor == session.inputs.generators["look"]["sensor"]


def test_a_replay_of_what_a_replay_wrote_gives_the_same(config: Path, recording: Path) -> None:
    first, second = config.with_name("first.mcap"), config.with_name("second.mcap")
    run_file(config, recording, out=first)
    run_file(config, first, out=second)
    assert second.read_bytes() == first.read_bytes()


def test_rows_are_those_of_a_run_and_parquet_holds_the_same(config: Path, recording: Path) -> None:
    table, columns = config.with_name("out.csv"), config.with_name("out.parquet")
    run_file(config, recording, out=table)
    run_file(config, recording, out=columns)
    found, held = rows(table), parquet.read_table(columns).to_pylist()
    assert len(found) == len(held) == 10
    assert [float(row["x"]) for row in found] == pytest.approx([row["x"] for row in held])
    assert held[0]["time_ns"] == EPOCH + 100_000_000
    assert dict(held[0]["shares"]).keys() == {"eye", "hand"}


def test_the_configuration_stays_with_the_contacts(config: Path, recording: Path) -> None:
    out = config.parent / "results" / "out.mcap"
    run_file(
        config,
        recording,
        overrides=["integrator.threshold=0.2"],
        topics={"hand": "/wrist"},
        out=out,
    )
    setting = setting_of_recording(out)
    assert setting.config().integrator.threshold == 0.2
    assert setting.topics == {"hand": "/wrist"}
    assert setting.folder.resolve() == config.parent.resolve()
    steps = list(Session(setting, out).steps())
    assert sum(len(step.fusion.contacts) for step in steps) == 10


def test_a_recording_without_a_configuration_asks_for_one(recording: Path) -> None:
    with pytest.raises(RecordingError, match=r"drive.mcap holds no configuration, .*--config"):
        setting_of_recording(recording)


def test_recording_and_scene_of_a_file_for_run_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_text(CONFIG + "recording: {type: log, file: nothing.csv}\n")
    fields = setting_of_file(path).config().model_fields_set
    assert fields == {"folder", "generators", "integrator", "cycle"}


def test_a_part_can_be_played_by_the_clock_of_the_whole(config: Path, recording: Path) -> None:
    out = config.with_name("out.csv")
    run_file(config, recording, window=Window(0.5, 0.3), out=out)
    stamps = [float(row["stamp"]) for row in rows(out)]
    assert stamps[0] >= 0.5 and stamps[-1] <= 0.9


def test_what_is_missing_is_said_and_the_rest_is_kept(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blind = recorded(tmp_path / "blind.mcap", [one for one in touching() if one.sensor == "wrist"])
    out = tmp_path / "out.csv"
    with pytest.raises(ConfigurationError, match="generators.eye: the recording holds no PointCl"):
        run_file(config, blind, out=out)
    assert "generators.eye: the recording holds no PointCloud" in capsys.readouterr().out
    assert len(rows(out)) == 10


def test_the_table_tells_rates_and_gaps(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gap = [one for one in touching(4.0) if not 2.0 < one.stamp < 2.5 or one.sensor == "wrist"]
    run_file(config, recorded(tmp_path / "gap.mcap", gap))
    lines = capsys.readouterr().out.splitlines()
    eye = next(line.split() for line in lines if line.startswith("eye "))
    wrist = next(line.split() for line in lines if line.startswith("wrist "))
    assert eye == ["eye", "PointCloud", "72", "17.75", "9", "0.500"]
    assert wrist == ["wrist", "Wrench", "81", "20", "0", "0.050"]


def moving(stamp: float, x: float) -> Transform:
    return Transform(
        stamp=stamp,
        frame="base",
        child_frame="camera",
        sensor="tf",
        position=np.array([x, 0.0, 0.0]),
        orientation=np.array([0.0, 0.0, 0.0, 1.0]),
    )


def test_late_and_seldom_transforms_place_what_was_seen_between(
    config: Path, tmp_path: Path
) -> None:
    readings = [*touching(2.0, frame="camera"), *(moving(0.5 * i, i) for i in range(5))]
    config.write_text(CONFIG.replace("frame: base", "frame: base, rule: de_morgan"))
    path = recorded(tmp_path / "moving.mcap", sorted(readings, key=lambda one: one.stamp))
    steps = list(Session(setting_of_file(config), path).steps())
    places = {
        round(s.stamp, 2): s.fusion.contacts[0].position[0] for s in steps if s.fusion.contacts
    }
    assert places[0.2] == pytest.approx(PLACE[0] + 0.4, abs=0.11)


def test_missing_transforms_are_counted(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    readings = [moving(0.0, 0.0), moving(0.5, 0.0), *touching(2.0, frame="camera")]
    path = recorded(tmp_path / "short.mcap", sorted(readings, key=lambda one: one.stamp))
    with pytest.raises(ConfigurationError, match="30 of 41 clouds of 'eye' were refused: the tr"):
        run_file(config, path)
    told = capsys.readouterr().out
    assert "missing transforms: 30 clouds of 'eye' were refused" in told
    assert "'camera' in 'base' is not known at 0.550 s: there is one from 0.000 to 0.500 s" in told


def test_results_until_the_recording_breaks_off_are_kept(config: Path, tmp_path: Path) -> None:
    path = recorded(tmp_path / "whole.mcap", touching(4.0))
    heard: list[RawMessage] = []
    list(RosRecording(RosConfig(file=path), tap=heard.append).readings())
    early = next(one for one in heard if one.topic == "/eye")
    path = tmp_path / "jump.mcap"
    with McapWriter(path) as writer:
        for one in heard:
            writer.copy(one)
        writer.copy(early._replace(log_stamp_ns=heard[-1].log_stamp_ns + 1))
    out = tmp_path / "out.mcap"
    with pytest.raises(RecordingError, match="/eye"):
        run_file(config, path, out=out)
    assert len(messages(out)["/contactfusion/contacts"]) >= 39


def test_an_unknown_suffix_is_refused_before_anything_is_played(
    config: Path, recording: Path
) -> None:
    with pytest.raises(RecordingError, match=r"to \.mcap, \.csv, \.parquet, not to '\.txt'"):
        run_file(config, recording, out=config.with_name("out.txt"))


def test_a_folder_of_results_is_made_and_an_interrupt_keeps_what_was_found(
    config: Path, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = config.parent / "new" / "out.csv"
    played = Session.play

    def interrupted(self: Session, *args: Any) -> Any:
        for number, step in enumerate(played(self, *args)):
            if number == 5:
                raise KeyboardInterrupt
            yield step

    monkeypatch.setattr(Session, "play", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_file(config, recording, out=out)
    assert len(rows(out)) == 6


# One command


def frames_above_the_space(seconds: float = 1.0) -> Iterable[Reading]:
    """Readings in a frame that /tf places late and seldom, below a root that is not the space's."""
    for stamp in np.arange(0.0, seconds + 1e-9, 0.05).tolist():
        yield point(stamp, *PLACE, sensor="eye", frame="camera")
        yield wrench(stamp, *PLACE, sensor="wrist")
        if round(20 * stamp) % 5 == 3:
            for parent, child in (("map", "base"), ("map", "camera")):
                yield Transform(stamp=stamp, frame=parent, child_frame=child,
                                position=np.array([stamp, 0.0, 0.0]),
                                orientation=np.array([0.0, 0.0, 0.0, 1.0]))  # fmt: skip


@pytest.mark.parametrize("readings", [touching, frames_above_the_space])
def test_run_and_replay_are_one_command(
    readings: Any, config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the recording's name, by the configuration, and by the alias: the same bytes."""
    recording = recorded(tmp_path / "drive.mcap", readings())
    named = tmp_path / "named.yaml"
    named.write_text(CONFIG + "recording: {type: ros, file: drive.mcap}\n")
    monkeypatch.chdir(tmp_path)
    commands = {
        "run": ["run", str(config), str(recording)],
        "replay": ["replay", str(config), str(recording)],
        "named": ["run", str(named)],
    }
    for name, words in commands.items():
        for out in (f"{name}.csv", f"{name}.mcap", name):
            monkeypatch.setattr("sys.argv", ["contactfusion", *words, "--out", out])
            with pytest.raises(SystemExit, match="^0$"):
                main()
    written = {
        name: [Path(f"{name}.csv").read_bytes(), Path(name, "contacts.csv").read_bytes(),
               Path(name, "summary.json").read_bytes(), Path(f"{name}.mcap").read_bytes()]
        for name in commands
    }  # fmt: skip
    assert written["run"] == written["replay"] == written["named"]
    assert written["run"][0] == written["run"][1] and len(written["run"][0].splitlines()) > 5


def test_an_output_that_fails_leaves_the_others_whole(
    config: Path, recording: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """The table of contacts meets a full disk; what watches goes on to the end."""
    wanted = len(list(Session(setting_of_file(config), recording).play()))
    seen = list[float]()

    def rows(step: Step) -> Any:
        if step.stamp > 0.45:
            raise OSError(28, "No space left on device")
        yield (str(step.stamp),)

    monkeypatch.setattr("contactfusion.run.outputs.contact_rows", rows)
    watch = nullcontext(Observer(step=lambda step: seen.append(step.stamp)))
    out = config.parent / "results"
    with pytest.raises(WritingError, match=r"contacts.csv can't be written: No space .*cut.csv"):
        run_file(config, recording, out=out, watch=lambda session: watch)
    assert len(seen) == wanted > 8
    assert {path.name for path in out.iterdir()} == {"contacts.cut.csv", "summary.json"}
    assert capsys.readouterr().out.endswith(f"results: {out / 'summary.json'}\n")
