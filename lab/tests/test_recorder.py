"""Recordings of scenes: what the sensors read, the truth beside it, nothing of ours."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, ContactFusionError, WritingError
from contactfusion.frames import FrameTree, Pose, pose_of
from contactfusion.loop import Observer
from contactfusion.pipeline import Pipeline
from contactfusion.readings import JointState, Reading, TactileImage, Wrench
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import Window
from contactfusion.robots.description import located, read_robot
from contactfusion.robots.model import shared_robot
from contactfusion.run.configuration import setting_of_file, setting_of_recording
from contactfusion.run.execute import run_file
from contactfusion.run.recorder import TRUTH, record_scene
from contactfusion.run.session import Session
from contactfusion.scene import Scene
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.scenes.push.scene import PushScene
from tests.mcap_files import Read, Recorded, channel_metadata, disk_of, read_by_rosbags

SCENES = Path(__file__).parents[2] / "examples" / "scenes"
BOX, PANDA, PUSH = (SCENES / f"{name}.yaml" for name in ("touch_box", "panda_table", "push_box"))
NEAR = ["controller.target=[0.4,0.1]", "scene.target=[0.4,0.1]"]
"""A push of a few seconds."""
MAIN = [sys.executable, "-c", "from contactfusion.cli import main; main()"]


@pytest.fixture(scope="module")
def touch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("touch") / "touch.mcap"
    record_scene(BOX, [], path)
    return path


@pytest.fixture(scope="module")
def push(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("push") / "push.mcap"
    record_scene(PUSH, NEAR, path)
    return path


def received_from(
    path: Path, overrides: Sequence[str] = ()
) -> tuple[list[Reading], dict[str, Any]]:
    """All readings of a scene that is not recorded, and its truth."""
    session, readings = Session(setting_of_file(path, overrides)), list[Reading]()
    *_, last = session.play(Observer(readings.append))
    verdict = session.stream.verdict(session.pipeline, last)
    assert verdict is not None
    return readings, verdict.truth


def xyz(fields: Any) -> list[float]:
    return [fields[axis] for axis in "xyz"]


def seconds(message: Read) -> float:
    return (message.stamp - Scene.epoch_ns) / 1e9


def places(message: Read) -> FloatArray:
    return np.reshape([xyz(contact["position"]) for contact in message.fields["contacts"]], (-1, 3))


def frames_of(found: Recorded, topic: str) -> dict[str, tuple[str, Pose]]:
    """Parent and pose in it of each child frame of the messages of a topic."""
    from scipy.spatial.transform import Rotation

    return {
        each["child_frame_id"]: (
            each["header"]["frame_id"],
            pose_of(
                xyz(each["transform"]["translation"]),
                Rotation.from_quat(list(each["transform"]["rotation"].values())).as_matrix(),
            ),
        )
        for message in found[topic]
        for each in message.fields["transforms"]
    }


# What is recorded


def test_a_touch_is_recorded_reading_by_reading(touch: Path) -> None:
    found, (readings, _) = read_by_rosbags(touch), received_from(BOX)
    wrenches = [reading for reading in readings if isinstance(reading, Wrench)]
    assert [xyz(each.fields["wrench"]["force"]) for each in found["/wrist"]] == [
        wrench.force.tolist() for wrench in wrenches
    ]
    assert [seconds(each) for each in found["/wrist"]] == pytest.approx(
        [wrench.stamp for wrench in wrenches], abs=1e-9
    )
    joints = [reading for reading in readings if isinstance(reading, JointState)]
    assert [each.fields["position"] for each in found["/joints"]] == [
        joint_state.positions.tolist() for joint_state in joints
    ]
    for skin in ("tip_1", "tip_2", "tip_3", "palm"):
        images = [
            reading
            for reading in readings
            if isinstance(reading, TactileImage) and reading.sensor == skin
        ]
        assert [each.fields["values"] for each in found[f"/{skin}"]] == [
            image.values.tolist() for image in images
        ]
    assert len(found["/forehead"]) == len(found["/forehead/depth"]) > 2
    assert len(found["/object_pose/box"]) == 1


def test_nothing_of_ours_is_recorded(touch: Path, push: Path) -> None:
    for path in (touch, push):
        topics = read_by_rosbags(path).keys()
        assert not [name for name in topics if name.split("/")[1] in ("contacts", "command")]
        assert "/cmd_vel" not in topics


def test_the_truth_of_a_touch_stands_beside_it(touch: Path) -> None:
    found, (_, truth) = read_by_rosbags(touch), received_from(BOX)
    first, last = found["/truth/contacts"][0], found["/truth/contacts"][-1]
    assert seconds(last) == seconds(found["/wrist"][-1])
    assert first.fields["contacts"] == [] and seconds(first) == 0.0
    assert last.fields["header"]["frame_id"] == truth["frame"] == "base"
    np.testing.assert_allclose(places(last), truth["places"])
    forces = [xyz(contact["force"]) for contact in last.fields["contacts"]]
    np.testing.assert_allclose(forces, truth["forces"])
    assert {contact["likelihood"] for contact in last.fields["contacts"]} == {1.0}
    box = found["/truth/box"][0].fields
    assert box["header"]["frame_id"] == "base"
    assert xyz(box["pose"]["position"]) == [0.7, 0.0, 0.35]
    believed = found["/object_pose/box"][0].fields["pose"]["position"]
    assert xyz(believed) != [0.7, 0.0, 0.35]
    assert "/truth/table" in found


def test_the_truth_of_a_push_stands_beside_it(push: Path) -> None:
    found, (_, truth) = read_by_rosbags(push), received_from(PUSH, NEAR)
    assert truth["success"]
    stamps = [seconds(each) for each in found["/truth/object"]]
    assert stamps == [seconds(each) for each in found["/skin"]]
    last = found["/truth/object"][-1].fields
    assert last["header"]["frame_id"] == "odom"
    assert xyz(last["pose"]["position"])[:2] == pytest.approx(truth["object"][:2])
    (contact,) = found["/truth/contacts"][-1].fields["contacts"]
    assert found["/truth/contacts"][-1].fields["header"]["frame_id"] == "base"
    x, y, yaw = truth["base"]
    forward, lateral, height = xyz(contact["position"])
    there = [
        x + np.cos(yaw) * forward - np.sin(yaw) * lateral,
        y + np.sin(yaw) * forward + np.cos(yaw) * lateral,
    ]
    assert np.hypot(*np.subtract(there, (0.4, 0.1))) == pytest.approx(truth["distance"])
    assert -0.41 < height < -0.04, "on the front"
    assert contact["force"]["x"] < -1.0, "the object pushes back"
    (first, second), middle = (xyz(end) for end in contact["extent"]), xyz(contact["position"])
    assert first[1] != second[1]
    np.testing.assert_allclose(np.mean([first, second], axis=0)[:2], middle[:2])


def test_without_contact_the_truth_is_an_empty_list(push: Path) -> None:
    first = read_by_rosbags(push)["/truth/contacts"][0]
    assert first.fields["contacts"] == [] and seconds(first) == 0.0


def test_readings_are_recorded_before_faults(push: Path, tmp_path: Path) -> None:
    """Once the skin is dead the push takes another path; the recording still has what it read."""
    dead = "faults=[{fault: silent, sensor: skin, start: 1.0}]"
    path = tmp_path / "dead.mcap"
    record_scene(PUSH, [*NEAR, dead, "scene.longest=3"], path)
    found, whole = read_by_rosbags(path), read_by_rosbags(push)
    assert [seconds(each) for each in found["/skin"]] == [
        seconds(each) for each in found["/wheels"]
    ]
    early = slice(0, 11)
    for topic in ("/skin", "/odometry"):
        assert [each.fields for each in found[topic][early]] == [
            each.fields for each in whole[topic][early]
        ]
    assert found["/odometry"][25].fields != whole["/odometry"][25].fields, "the loop is closed"


# What a replay needs


def test_where_sensors_are_can_be_reconstructed(push: Path) -> None:
    found = read_by_rosbags(push)
    assert len(found["/tf_static"]) == 1 and seconds(found["/tf_static"][0]) == 0.0
    robot = read_robot("contactfusion.robots:mobile_base.yaml")
    static = frames_of(found, "/tf_static")
    assert static.keys() == robot.frames.keys()
    tree = FrameTree({**static, **frames_of(found, "/tf")})
    model, (x, y, yaw) = shared_robot(robot), (0.0, 0.0, 0.0)
    base = found["/odometry"][-1].fields["pose"]["pose"]
    (x, y, height), turn = xyz(base["position"]), base["orientation"]
    yaw = 2.0 * np.arctan2(turn["z"], turn["w"])
    rotation = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    for lidar in robot.lidars.values():
        wanted = pose_of((x, y, height), rotation) @ model.pose_on_link(lidar.frame)
        np.testing.assert_allclose(tree.pose("odom", of=lidar.frame), wanted, atol=1e-12)


def test_a_replay_finds_the_contacts_that_the_run_found(push: Path) -> None:
    setting = setting_of_file(PUSH, NEAR)
    wanted = {step.stamp: step.fusion.contacts for step in Session(setting).play()}
    assert sum(map(len, wanted.values())) > 10
    replay = Pipeline(setting.changed(["controller=null"]).config())
    readings = [reading for reading in open_recording(push).readings() if reading.sensor != TRUTH]
    for stamp, contacts in wanted.items():
        while readings and readings[0].stamp < stamp + 1e-6:
            replay.receive(readings.pop(0))
        found = replay.step(stamp).fusion.contacts
        assert len(found) == len(contacts)
        for first, second in zip(found, contacts, strict=True):
            np.testing.assert_allclose(first.position, second.position, atol=1e-9)
            assert first.likelihood == pytest.approx(second.likelihood)


def test_frames_of_the_file_are_reported_with_those_of_the_robot(tmp_path: Path) -> None:
    moved = "frames.base={parent: world, xyz: [1.0, 0.0, 0.0], rpy: [0.0, 0.0, 0.5]}"
    record_scene(BOX, [moved, "integrator.frame=world"], tmp_path / "a.mcap", duration=0.0)
    static = frames_of(read_by_rosbags(tmp_path / "a.mcap"), "/tf_static")
    assert static.keys() == {"base", "tip_1", "tip_2", "tip_3", "palm_skin", "forehead"}
    assert static["base"][0] == "world" and static["base"][1][0, 3] == 1.0


def test_the_robot_can_be_drawn(touch: Path) -> None:
    (message,) = read_by_rosbags(touch)["/robot_description"]
    urdf = located("contactfusion.robots:arm_hand.urdf").read_text()
    assert message.fields["data"] == urdf and seconds(message) == 0.0
    metadata = channel_metadata(touch)
    for topic in ("/robot_description", "/tf_static"):
        assert yaml.safe_load(metadata[topic]["offered_qos_profiles"])[0]["durability"] == 1


def test_a_robot_without_frames_of_its_own_has_none(tmp_path: Path) -> None:
    record_scene(PANDA, [], tmp_path / "panda.mcap", duration=0.0)
    found = read_by_rosbags(tmp_path / "panda.mcap")
    assert "/robot_description" in found and "/tf_static" not in found


# Seeds, sizes, times


@pytest.mark.slow
@pytest.mark.parametrize("scene", [BOX, PUSH])
def test_the_same_seed_gives_the_same_bytes(scene: Path, tmp_path: Path) -> None:
    changes = NEAR if scene is PUSH else []
    for name, seed in (("one", 7), ("same", 7), ("other", 8)):
        record_scene(scene, changes, tmp_path / f"{name}.mcap", seed, 2.0)
    record_scene(scene, [*changes, "seed=7"], tmp_path / "file.mcap", duration=2.0)
    first, same, second, file = (
        (tmp_path / f"{name}.mcap").read_bytes() for name in ("one", "same", "other", "file")
    )
    assert first == same == file != second


def test_the_cameras_of_a_push_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one", "same"):
        record_scene(SCENES / "push_five.yaml", [], tmp_path / f"{name}.mcap", duration=0.5)
    file = tmp_path / "one.mcap"
    assert file.read_bytes() == (tmp_path / "same.mcap").read_bytes()
    assert {"/skin", "/lidar", "/camera/depth", "/wheels", "/odometry"} <= set(
        read_by_rosbags(file)
    )


def test_recordings_are_small(touch: Path, push: Path) -> None:
    assert touch.stat().st_size < 2_000_000
    assert push.stat().st_size < 200_000


@pytest.mark.parametrize("scene", [BOX, PUSH])
def test_a_duration_ends_it(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record_scene(scene, [], tmp_path / "a.mcap", duration=0.3)
    found = read_by_rosbags(tmp_path / "a.mcap")
    stamps = [seconds(message) for messages in found.values() for message in messages]
    assert max(stamps) == pytest.approx(0.3)
    assert max(seconds(each) for each in found["/truth/contacts"]) == pytest.approx(0.3)
    output = capsys.readouterr().out
    assert " in 0.30 s, " in output and "truth:" not in output, "it did not come to its end"


def test_it_says_what_was_recorded_and_what_is_true(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "new" / "a.mcap"
    record_scene(PANDA, [], path)
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith(f"{path}: ") and " readings on 3 topics in 0." in first
    assert first.endswith(f", {path.stat().st_size / 1000:.0f} kB")
    assert second.startswith("truth: panda_")


# The command line


def test_the_command_records_under_the_name_of_the_scene(tmp_path: Path) -> None:
    done = subprocess.run(
        [*MAIN, "record", str(PUSH), "--seed", "3", "--set", "scene.longest=1"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("out/push_box.mcap: 33 readings on 3 topics in 1.00 s, ")
    record_scene(PUSH, ["scene.longest=1"], tmp_path / "same.mcap", 3)
    recorded = tmp_path / "out" / "push_box.mcap"
    assert recorded.read_bytes() == (tmp_path / "same.mcap").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_kill_leave_nothing_half_written(sign: signal.Signals, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("of old")
    long = [*MAIN, "record", str(SCENES / "push_five.yaml"), "--out", str(path)]
    # whoever runs tests in the background has Ctrl+C ignored, and children inherit that
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with subprocess.Popen(long, stderr=subprocess.PIPE, text=True) as recording:
        signal.signal(signal.SIGINT, before)
        for _ in range(600):
            if len(list(tmp_path.iterdir())) > 1 or recording.poll() is not None:
                break
            time.sleep(0.1)
        time.sleep(0.5)
        recording.send_signal(sign)
        assert recording.wait(30) == 130
        assert recording.stderr is not None and "Traceback" not in recording.stderr.read()
    assert path.read_text() == "of old" and list(tmp_path.iterdir()) == [path]


# What does not work


@pytest.mark.parametrize(
    ("scene", "changes", "sentence"),
    [
        (BOX, ["scene={}"], "scene: only a scene can be recorded, and here is none"),
        (BOX, ["recording={type: log}"], "scene: give a recording or a scene, not both"),
        (BOX, ["scene.tol=palm"], "scene.tol: unknown field; did you mean 'tool'?"),
        (BOX, ["robot=null"], "robot: a scene needs a robot by URDF"),
        (PUSH, ["controller=null"], "controller: a push needs a controller"),
        (PUSH, ["controller.target=[2,2]"], "controller.target: the controller pushes to (2, 2)"),
    ],
)
def test_a_scene_that_is_wrong_is_one_sentence_and_writes_nothing(
    scene: Path, changes: list[str], sentence: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        record_scene(scene, changes, tmp_path / "a.mcap")
    message = str(caught.value)
    assert message.startswith(f"{scene}: {sentence}") and "\n" not in message
    assert not list(tmp_path.iterdir())


def test_a_file_that_plays_a_recording_can_not_be_recorded(tmp_path: Path) -> None:
    fields = {key: value for key, value in read_yaml(PUSH).items() if key != "scene"}
    (tmp_path / "run.yaml").write_text(yaml.safe_dump(fields | {"recording": {"type": "log"}}))
    with pytest.raises(ConfigurationError, match=r"run.yaml: scene: only a scene can be recorded"):
        record_scene(tmp_path / "run.yaml", [], tmp_path / "a.mcap")


def test_a_name_that_no_replay_would_open_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"--out: '.*bag' .* let it end in .mcap"):
        record_scene(PUSH, [], tmp_path / "bag")
    with pytest.raises(ContactFusionError, match="is a folder"):
        (tmp_path / "a.mcap").mkdir()
        record_scene(PUSH, [], tmp_path / "a.mcap")


def test_a_full_disk_is_one_sentence(tmp_path: Path) -> None:
    with (
        disk_of(10_000),
        pytest.raises(WritingError, match="a.mcap can't be written: File too large"),
    ):
        record_scene(PUSH, ["scene.longest=2"], tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == [tmp_path / "a.cut.mcap"]


def test_a_scene_that_fails_midway_leaves_the_file_of_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def readings(scene: PushScene) -> Iterator[Reading]:
        if scene.stamp > 0.5:
            raise KeyboardInterrupt
        return iter(())

    monkeypatch.setattr(PushScene, "readings", readings)
    path = tmp_path / "a.mcap"
    path.write_text("of old")
    with pytest.raises(KeyboardInterrupt):
        record_scene(PUSH, [], path)
    assert path.read_text() == "of old" and list(tmp_path.iterdir()) == [path]


# What a run writes


def test_a_run_of_a_scene_writes_what_is_recorded_and_contacts_beside_it(
    push: Path, tmp_path: Path
) -> None:
    run_file(PUSH, overrides=NEAR, out=tmp_path / "run.mcap")
    ran, recorded = read_by_rosbags(tmp_path / "run.mcap"), read_by_rosbags(push)
    assert {topic: ran[topic] for topic in recorded} == recorded
    assert {topic for topic in ran if topic not in recorded and "marker" not in topic} == {
        f"/contactfusion/{name}"
        for name in ("cmd_vel", "command", "configuration", "contacts", "contacts/voxels", "events")
    }
    kept = setting_of_recording(tmp_path / "run.mcap")
    assert sum(len(step.fusion.contacts) for step in Session(kept, tmp_path / "run.mcap").play())


def test_a_scene_is_played_as_it_is(tmp_path: Path) -> None:
    choices: list[dict[str, Any]] = [
        {"window": Window(1.0)},
        {"topics": {"skin": "/x"}},
        {"ignored": ["/x"]},
    ]
    for choice in choices:
        with pytest.raises(ConfigurationError, match=r"push_box.yaml: --start, .* for recordings"):
            run_file(PUSH, out=tmp_path / "run", **choice)
    assert not (tmp_path / "run").exists()
