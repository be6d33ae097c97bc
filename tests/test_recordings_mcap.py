"""MCAP files: what is written is read back by rosbags and by mcap-ros2-support."""

import errno
import math
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import Writer

from contactfusion import Fusion, Integrator, IntegratorConfig
from contactfusion.arrays import FloatArray
from contactfusion.controller import Command
from contactfusion.errors import (
    ContactFusionError,
    DependencyError,
    RecordingError,
    WritingError,
)
from contactfusion.hypotheses import HypothesisKind
from contactfusion.pipeline import Step
from contactfusion.readings import (
    BUILT_IN,
    DepthImage,
    JointCommand,
    JointState,
    Markers,
    ObjectPose,
    Odometry,
    PointCloud,
    Reading,
    Switch,
    TactileImage,
    Transform,
    Twist,
    Wrench,
)
from contactfusion.readings.messages import known_types
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.recording import RawMessage
from contactfusion.recordings.ros import RosConfig, RosRecording
from contactfusion.recordings.ros.readers import MCAP_MAGIC
from tests.clouds import HERE, THERE, cloud, fused
from tests.mcap_files import (
    Recorded,
    channel_metadata,
    disk_of,
    read_by_mcap_ros2,
    read_by_rosbags,
    rosbag2,
)

READING_TYPES = {codec.name: codec.kind for codec in BUILT_IN}

EPOCH = 1_700_000_000_123_456_789
AT: dict[str, Any] = {"stamp": 0.25, "frame": "base"}
ONE, TWO = np.array([1.0, 2.0, 3.0]), np.array([-0.1, 0.2, -0.3])
TURN = np.array([0.0, 0.0, np.sin(0.2), np.cos(0.2)])


Written = Callable[..., Recorded]


@pytest.fixture(params=[read_by_rosbags, read_by_mcap_ros2])
def written(request: pytest.FixtureRequest, tmp_path: Path) -> Written:
    """Write readings and steps, and read them back by each of the two readers."""

    def write_and_read(*items: Reading | Step, prefix: str = "", epoch: int = EPOCH) -> Recorded:
        found: Recorded = request.param(
            write(tmp_path / "a.mcap", *items, prefix=prefix, epoch=epoch)
        )
        return found

    return write_and_read


def write(path: Path, *items: Reading | Step, prefix: str = "", epoch: int = EPOCH) -> Path:
    with McapWriter(path, epoch) as writer:
        for item in items:
            if isinstance(item, Step):
                writer.step(item)
            else:
                writer.reading(item, prefix)
    return path


def only(found: Recorded, topic: str, kind: str) -> Any:
    """Give the one message of a topic, which has the stamp and frame of `AT`."""
    (one,) = found[topic]
    assert one.kind == kind
    assert one.stamp == EPOCH + 250_000_000
    header = one.fields["header"]
    assert header["frame_id"] == "base"
    assert header["stamp"] == {"sec": 1_700_000_000, "nanosec": 373_456_789}
    return one.fields


def numbers(fields: Any) -> list[float]:
    """Give the numbers of a message such as a point or a quaternion."""
    return list(fields.values())


def touching() -> Fusion:
    """Give two contacts, of which one is felt with a force."""
    touches = [
        cloud("skin", 0.2, {HERE: 0.8}, forces=ONE[None]),
        cloud("camera", 0.25, {HERE: 0.5, THERE: 0.6}),
    ]
    return fused(*touches, now=0.25)


def commanded(command: Command | None = None) -> Step:
    return Step(0.25, touching(), command)


def test_a_wrench(written: Written) -> None:
    found = written(Wrench(**AT, sensor="wrist", force=ONE, torque=TWO))
    wrench = only(found, "/wrist", "geometry_msgs/msg/WrenchStamped")["wrench"]
    assert numbers(wrench["force"]) == ONE.tolist()
    assert numbers(wrench["torque"]) == TWO.tolist()


def test_a_tactile_image(written: Written) -> None:
    values = np.linspace(0.0, 1.0, 17)
    found = written(TactileImage(**AT, sensor="finger", values=values))
    image = only(found, "/finger", "contactfusion_msgs/msg/TactileImage")
    assert image["values"] == values.tolist()


@pytest.mark.parametrize("closed", [True, False])
def test_a_switch(written: Written, closed: bool) -> None:
    found = written(Switch(**AT, closed=closed))
    assert only(found, "/switch", "contactfusion_msgs/msg/Switch")["closed"] is closed


def floats(fields: Any) -> FloatArray:
    return np.frombuffer(bytes(fields["data"]), "<f4").astype(np.float64)


def test_a_point_cloud_as_float32(written: Written) -> None:
    points = np.array([ONE, [np.nan, 0.0, 1e300], TWO])
    found = written(PointCloud(**AT, sensor="lidar", points=points))
    sent = only(found, "/lidar", "sensor_msgs/msg/PointCloud2")
    expected = [*ONE, np.nan, 0.0, np.inf, *TWO.astype(np.float32)]
    np.testing.assert_array_equal(floats(sent), expected)
    assert [(field["name"], field["offset"]) for field in sent["fields"]] == [
        ("x", 0),
        ("y", 4),
        ("z", 8),
    ]
    assert (sent["width"], sent["point_step"], sent["row_step"]) == (3, 12, 36)
    assert not sent["is_dense"]


def test_a_point_cloud_of_no_points(written: Written) -> None:
    found = written(PointCloud(**AT, points=np.empty((0, 3))))
    sent = only(found, "/point_cloud", "sensor_msgs/msg/PointCloud2")
    assert (sent["width"], sent["data"], sent["is_dense"]) == (0, [], True)


def test_a_depth_image_with_its_camera_beside_it(written: Written) -> None:
    depth = np.array([[0.5, np.nan, 0.0], [1.0, 2.0, 3.0]])
    intrinsics = np.array([[300.0, 0.0, 1.0], [0.0, 310.0, 0.5], [0.0, 0.0, 1.0]])
    found = written(DepthImage(**AT, sensor="eye", depth=depth, intrinsics=intrinsics))
    assert found.keys() == {"/eye/depth", "/eye/camera_info"}
    image = only(found, "/eye/depth", "sensor_msgs/msg/Image")
    assert (image["encoding"], image["height"], image["width"]) == ("32FC1", 2, 3)
    assert image["step"] == 12
    np.testing.assert_array_equal(floats(image), depth.ravel())
    camera = only(found, "/eye/camera_info", "sensor_msgs/msg/CameraInfo")
    assert (camera["height"], camera["width"]) == (2, 3)
    assert camera["k"] == intrinsics.ravel().tolist()
    np.testing.assert_array_equal(
        np.reshape(camera["p"], (3, 4)), np.column_stack([intrinsics, np.zeros(3)])
    )


def test_the_colour_and_the_mask_of_a_depth_image(written: Written) -> None:
    colour = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
    mask = np.array([[True, False, True], [False, False, True]])
    eye: dict[str, Any] = {
        "depth": np.ones((2, 3)),
        "intrinsics": np.eye(3),
        "colour": colour,
        "mask": mask,
    }
    found = written(DepthImage(**AT, **eye))
    seen = only(found, "/depth_image/colour", "sensor_msgs/msg/Image")
    assert (seen["encoding"], seen["step"], seen["data"]) == ("rgb8", 9, list(range(18)))
    object_of_interest = only(found, "/depth_image/mask", "sensor_msgs/msg/Image")
    assert object_of_interest["encoding"] == "mono8"
    assert object_of_interest["data"] == (255 * mask.ravel()).tolist()


def test_a_joint_state(written: Written) -> None:
    names = ("shoulder", "elbow", "wrist")
    found = written(JointState(**AT, names=names, positions=ONE, efforts=TWO))
    joints = only(found, "/joint_state", "sensor_msgs/msg/JointState")
    assert joints["name"] == list(names)
    assert joints["position"] == ONE.tolist()
    assert joints["velocity"] == []
    assert joints["effort"] == TWO.tolist()


def test_a_joint_command(written: Written) -> None:
    found = written(JointCommand(**AT, sensor="hand/goal", names=("a", "b", "c"), positions=ONE))
    goal = only(found, "/hand/goal", "trajectory_msgs/msg/JointTrajectory")
    assert goal["joint_names"] == ["a", "b", "c"]
    (last,) = goal["points"]
    assert last["positions"] == ONE.tolist()
    assert last["time_from_start"] == {"sec": 0, "nanosec": 0}


def test_a_twist(written: Written) -> None:
    found = written(Twist(**AT, linear=ONE, angular=TWO))
    twist = only(found, "/twist", "geometry_msgs/msg/TwistStamped")["twist"]
    assert numbers(twist["linear"]) == ONE.tolist()
    assert numbers(twist["angular"]) == TWO.tolist()


def odometry(**others: Any) -> Odometry:
    return Odometry(**AT, child_frame="wheels", position=ONE, orientation=TURN, **others)


def test_odometry_which_is_a_transform_too(written: Written) -> None:
    found = written(odometry(linear=TWO))
    sent = only(found, "/odometry", "nav_msgs/msg/Odometry")
    assert sent["child_frame_id"] == "wheels"
    assert numbers(sent["pose"]["pose"]["position"]) == ONE.tolist()
    assert numbers(sent["pose"]["pose"]["orientation"]) == TURN.tolist()
    assert numbers(sent["twist"]["twist"]["linear"]) == TWO.tolist()
    assert all(map(math.isnan, numbers(sent["twist"]["twist"]["angular"])))
    (message,) = found["/tf"]
    assert message.stamp == EPOCH + 250_000_000
    (transform,) = message.fields["transforms"]
    assert transform["header"] == sent["header"]
    assert transform["child_frame_id"] == "wheels"
    assert numbers(transform["transform"]["translation"]) == ONE.tolist()
    assert numbers(transform["transform"]["rotation"]) == TURN.tolist()


def test_odometry_with_a_prefix_moves_no_frame(written: Written) -> None:
    assert written(odometry(), prefix="truth").keys() == {"/truth/odometry"}


@pytest.mark.parametrize(
    ("sensor", "prefix", "topic"),
    [
        ("", "", "/object_pose/box"),
        ("camera", "", "/camera/box"),
        ("", "truth", "/truth/box"),
        ("", "/truth/", "/truth/box"),
        ("camera", "truth", "/truth/camera/box"),
    ],
)
def test_the_pose_of_an_object(written: Written, sensor: str, prefix: str, topic: str) -> None:
    box = ObjectPose(**AT, sensor=sensor, name="box", position=ONE, orientation=TURN)
    pose = only(written(box, prefix=prefix), topic, "geometry_msgs/msg/PoseStamped")["pose"]
    assert numbers(pose["position"]) == ONE.tolist()
    assert numbers(pose["orientation"]) == TURN.tolist()


def transform(child: str = "hand", **others: Any) -> Transform:
    return Transform(**AT, child_frame=child, position=ONE, orientation=TURN, **others)


@pytest.mark.parametrize(
    ("static", "prefix", "topic"),
    [
        (False, "", "/tf"),
        (True, "", "/tf_static"),
        (False, "truth", "/truth/tf"),
        (True, "truth", "/truth/tf_static"),
    ],
)
def test_a_transform(written: Written, static: bool, prefix: str, topic: str) -> None:
    found = written(transform(static=static, sensor="tf"), prefix=prefix)
    assert found.keys() == {topic}
    (message,) = found[topic]
    assert (message.stamp, message.kind) == (EPOCH + 250_000_000, "tf2_msgs/msg/TFMessage")
    (pose,) = message.fields["transforms"]
    assert (pose["header"]["frame_id"], pose["child_frame_id"]) == ("base", "hand")
    assert pose["header"]["stamp"] == {"sec": 1_700_000_000, "nanosec": 373_456_789}
    assert numbers(pose["transform"]["translation"]) == ONE.tolist()
    assert numbers(pose["transform"]["rotation"]) == TURN.tolist()


def test_frames_that_stand_still_are_one_message(tmp_path: Path) -> None:
    with McapWriter(tmp_path / "a.mcap", EPOCH) as writer:
        writer.static([transform("eye"), transform("ear")], 0.5)
        writer.static([])
    (message,) = read_by_rosbags(tmp_path / "a.mcap")["/tf_static"]
    assert message.stamp == EPOCH + 500_000_000
    assert [pose["child_frame_id"] for pose in message.fields["transforms"]] == ["eye", "ear"]
    stamps = [pose["header"]["stamp"]["nanosec"] for pose in message.fields["transforms"]]
    assert stamps == [623_456_789, 623_456_789]


def test_the_description_of_a_robot(tmp_path: Path) -> None:
    with McapWriter(tmp_path / "a.mcap", EPOCH) as writer:
        writer.robot_description("<robot name='µ'/>")
    (message,) = read_by_mcap_ros2(tmp_path / "a.mcap")["/robot_description"]
    assert (message.stamp, message.kind) == (EPOCH, "std_msgs/msg/String")
    assert message.fields["data"] == "<robot name='µ'/>"


def test_what_is_told_once_is_kept_for_those_who_come_late(tmp_path: Path) -> None:
    """`ros2 bag play` offers a topic as its channel's metadata say, in numbers of rmw."""
    with McapWriter(tmp_path / "a.mcap") as writer:
        writer.static([transform("eye")])
        writer.robot_description("<robot/>")
        writer.reading(transform("ear", static=True), prefix="truth")
        writer.reading(odometry())
    offered = {
        topic: yaml.safe_load(metadata["offered_qos_profiles"])
        for topic, metadata in channel_metadata(tmp_path / "a.mcap").items()
    }
    assert offered.pop("/tf") is offered.pop("/odometry") is None
    assert offered.keys() == {"/tf_static", "/robot_description", "/truth/tf_static"}
    for (quality,) in offered.values():
        assert quality["durability"] == 1, "transient_local"
        assert quality["reliability"] == 1, "reliable"
        assert (quality["history"], quality["depth"]) == (1, 100), "keep_last"
        assert quality["deadline"] == {"sec": 9223372036, "nsec": 854775807}, "endless"
    with rosbag2.Reader(tmp_path / "a.mcap") as bag:
        lasting = [one.topic for one in bag.connections if one.ext.offered_qos_profiles]
    assert sorted(lasting) == ["/robot_description", "/tf_static", "/truth/tf_static"]


def test_contacts_that_no_step_gave(tmp_path: Path) -> None:
    contacts = touching().contacts
    with McapWriter(tmp_path / "a.mcap", EPOCH) as writer:
        writer.contacts(contacts, "base", 0.25, "truth")
        writer.contacts((), "base", 0.5, "truth")
    found = read_by_rosbags(tmp_path / "a.mcap")
    assert found.keys() == {"/truth/contacts", "/truth/contacts/markers"}
    full, empty = found["/truth/contacts"]
    assert full.fields["header"]["frame_id"] == "base"
    assert [numbers(one["position"]) for one in full.fields["contacts"]] == [
        one.position.tolist() for one in contacts
    ]
    assert empty.fields["contacts"] == [] and empty.stamp == EPOCH + 500_000_000


def test_markers_some_of_them_lost(written: Written) -> None:
    places = np.array([ONE, np.full(3, np.nan)])
    found = written(Markers(**AT, names=("heel", "toe"), positions=places))
    sent = only(found, "/markers", "contactfusion_msgs/msg/Markers")
    assert sent["names"] == ["heel", "toe"]
    np.testing.assert_array_equal([numbers(place) for place in sent["positions"]], places)


def test_contacts(written: Written) -> None:
    wanted = touching().contacts
    assert len(wanted) == 2
    sent = only(
        written(commanded()), "/contactfusion/contacts", "contactfusion_msgs/msg/ContactArray"
    )
    for contact, one in zip(wanted, sent["contacts"], strict=True):
        assert one["stamp"] == {"sec": 1_700_000_000, "nanosec": 373_456_789}
        assert numbers(one["position"]) == contact.position.tolist()
        assert (one["likelihood"], one["voxels"]) == (contact.likelihood, contact.voxels)
        assert one["dispersion"] == contact.dispersion
        assert one["covariance"] == contact.covariance.ravel().tolist()
        assert [numbers(end) for end in one["extent"]] == contact.extent.tolist()
        assert one["track"] == contact.track > 0
        assert one["since"] == {"sec": 1_700_000_000, "nanosec": 373_456_789}
        np.testing.assert_array_equal(numbers(one["force"]), contact.force)
        shares = dict(zip(one["sources"], one["shares"], strict=True))
        assert shares == dict(contact.shares)
    assert math.isnan(sent["contacts"][1]["force"]["x"])


def test_what_happened_to_contacts_in_the_steps_in_which_any_did(written: Written) -> None:
    integrator = Integrator(IntegratorConfig(frame="base"))
    integrator.plug("skin", replace=True)
    integrator.receive(cloud("skin", 0.2, {HERE: 0.8}))
    integrator.step(0.2)
    kept = Step(0.3, integrator.step(0.3), None)
    integrator.receive(cloud("skin", 0.4, {}))
    broken = integrator.step(0.4)
    assert "/contactfusion/events" not in written(kept)
    (sent,) = written(Step(0.4, broken, None))["/contactfusion/events"]
    assert sent.kind == "contactfusion_msgs/msg/ContactEvents"
    (event,) = sent.fields["events"]
    assert event["change"] == "broken" and event["contact"]["track"] == 1
    assert sent.fields["header"]["frame_id"] == "base"


def test_contacts_are_drawn_after_those_of_before_are_deleted(
    written: Written,
) -> None:
    wanted = touching().contacts
    (sent,) = written(commanded())["/contactfusion/contacts/markers"]
    assert sent.kind == "visualization_msgs/msg/MarkerArray"
    first, *others = sent.fields["markers"]
    assert first["action"] == 3
    spheres, texts = others[::2], others[1::2]
    for number, (contact, sphere, text) in enumerate(zip(wanted, spheres, texts, strict=True)):
        assert (sphere["type"], text["type"]) == (2, 9)
        assert sphere["id"] == text["id"] == number
        assert sphere["ns"] != text["ns"]
        assert sphere["header"]["frame_id"] == "base"
        assert numbers(sphere["pose"]["position"]) == contact.position.tolist()
        assert text["pose"]["position"]["z"] > contact.position[2]
        assert text["text"] == f"{contact.likelihood:.2f}"
        assert min(numbers(sphere["scale"])) > 0.0
        assert min(sphere["color"]["a"], text["color"]["a"]) > 0.0


VIEWS = ("contacts/markers", "contacts/voxels")


def test_a_step_without_contacts_says_so(written: Written) -> None:
    found = written(Step(0.25, fused(now=0.25), None))
    assert set(found) == {f"/contactfusion/{name}" for name in ("contacts", *VIEWS)}
    assert (
        only(found, "/contactfusion/contacts", "contactfusion_msgs/msg/ContactArray")["contacts"]
        == []
    )
    (markers,) = found["/contactfusion/contacts/markers"]
    assert len(markers.fields["markers"]) == 1


def test_a_command_with_a_twist(written: Written) -> None:
    twist = Twist(**AT, linear=ONE, angular=TWO)
    found = written(commanded(Command(twist=twist, gripper=0.5, mode="push", reason="a touch")))
    command = only(found, "/contactfusion/command", "contactfusion_msgs/msg/Command")
    assert (command["gripper"], command["mode"], command["reason"]) == (0.5, "push", "a touch")
    assert (command["joint_names"], command["joint_velocities"]) == ([], [])
    sent = only(found, "/contactfusion/cmd_vel", "geometry_msgs/msg/TwistStamped")["twist"]
    assert command["twist"] == sent
    assert numbers(sent["linear"]) == ONE.tolist()
    assert numbers(sent["angular"]) == TWO.tolist()


def test_a_command_to_joints(written: Written) -> None:
    found = written(commanded(Command(joint_velocities={"elbow": 0.5, "wrist": -1.0})))
    assert "/contactfusion/cmd_vel" not in found
    (command,) = found["/contactfusion/command"]
    assert command.fields["joint_names"] == ["elbow", "wrist"]
    assert command.fields["joint_velocities"] == [0.5, -1.0]
    assert math.isnan(command.fields["gripper"])
    assert math.isnan(command.fields["twist"]["linear"]["x"])


def test_stamps_that_fall_are_read_in_their_order(written: Written) -> None:
    late, early = (Switch(stamp=stamp, frame="base", closed=True) for stamp in (0.5, 0.25))
    (first, second) = written(late, early, epoch=0)["/switch"]
    assert (first.stamp, second.stamp) == (250_000_000, 500_000_000)


def test_names_that_ros_does_not_allow_are_changed(written: Written) -> None:
    assert written(Switch(**AT, sensor="3rd-floor/2 left", closed=True)).keys() == {
        "/_3rd_floor/_2_left"
    }


def test_a_recording_of_nothing_is_a_file(written: Written) -> None:
    assert written() == {}


def test_two_writings_are_equal_bytes_whatever_the_name(tmp_path: Path) -> None:
    items: list[Reading | Step] = [
        odometry(),
        Wrench(**AT, force=ONE, torque=TWO),
        commanded(Command(mode="push")),
    ]
    first = write(tmp_path / "first.mcap", *items)
    second = write(tmp_path / "folder" / "second.bag", *items)
    assert first.read_bytes() == second.read_bytes()


def test_a_file_of_that_name_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("of old")
    write(path, odometry())
    assert read_by_rosbags(path).keys() == {"/odometry", "/tf"}
    assert list(tmp_path.iterdir()) == [path]


def test_an_exception_leaves_no_file_and_no_temporary(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), McapWriter(tmp_path / "a.mcap") as writer:
        writer.reading(odometry())
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupt_while_a_file_is_closed_waits_until_it_is_whole(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.signal(number, signal.default_int_handler)  # as the command line has it
    close = Writer.close

    def interrupted(bag: Writer) -> None:
        signal.raise_signal(number)
        close(bag)

    monkeypatch.setattr(Writer, "close", interrupted)
    try:
        with pytest.raises(KeyboardInterrupt):
            write(tmp_path / "a.mcap", odometry())
    finally:
        signal.signal(number, before)
    assert list(tmp_path.iterdir()) == [tmp_path / "a.mcap"]
    assert any(RosRecording(RosConfig(file=tmp_path / "a.mcap")).readings())


def test_what_the_disk_does_not_take_at_the_end_is_a_sentence_and_kept_as_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(file: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(WritingError, match=r"No space left on device; .* is .*a.cut.mcap"):
        write(tmp_path / "a.mcap", odometry())
    assert list(tmp_path.iterdir()) == [tmp_path / "a.cut.mcap"]


def test_a_pipe_beside_the_files_of_a_folder_is_not_waited_for(tmp_path: Path) -> None:
    write(tmp_path / "bag" / "a.mcap", odometry())
    os.mkfifo(tmp_path / "bag" / "b.mcap")
    assert any(RosRecording(RosConfig(file=tmp_path / "bag")).readings())


def test_an_exception_leaves_the_file_of_before(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", odometry())
    before = path.read_bytes()
    with pytest.raises(ZeroDivisionError), McapWriter(path):
        raise ZeroDivisionError
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("clouds", [1, 60], ids=["at the end", "while it writes"])
@pytest.mark.parametrize("older", [False, True])
def test_a_full_disk_is_one_sentence_and_what_was_written_is_kept_beside_what_was_there(
    clouds: int, older: bool, tmp_path: Path
) -> None:
    path = tmp_path / "a.mcap"
    if older:
        write(path, odometry())
    before = {entry: entry.read_bytes() for entry in tmp_path.iterdir()}
    noise = np.random.default_rng(0).standard_normal((8000, 3))
    scan = PointCloud(**AT, sensor="lidar", points=noise)
    with disk_of(50_000), pytest.raises(WritingError) as caught:
        write(path, *[scan] * clouds)
    cut = tmp_path / "a.cut.mcap"
    why = f"{path} can't be written: File too large"
    assert str(caught.value) == f"{why}; what was written until then is {cut}"
    after = {entry: entry.read_bytes() for entry in tmp_path.iterdir()}
    assert after.pop(cut).startswith(MCAP_MAGIC) and after == before


def test_what_a_full_disk_took_can_be_read(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).standard_normal((60, 8000, 3))
    scans = [
        PointCloud(stamp=n / 10.0, frame="base", sensor="lidar", points=points)
        for n, points in enumerate(noise)
    ]
    with disk_of(2_500_000), pytest.raises(WritingError):
        write(tmp_path / "a.mcap", *scans)
    recording = RosRecording(RosConfig(file=tmp_path / "a.cut.mcap"))
    read = []
    with pytest.raises(RecordingError, match="is cut off after"):
        for one in recording.readings():
            read.append(one.stamp)  # what comes before the error counts
    assert 10 < len(read) < 30


def test_an_error_of_whoever_writes_is_not_taken_for_the_disks(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), McapWriter(tmp_path / "a.mcap"):
        raise FileNotFoundError("of a log that is read meanwhile")
    assert list(tmp_path.iterdir()) == []


def refusal(path: Path, *items: Reading | Step, epoch: int = 0) -> str:
    with pytest.raises(RecordingError) as caught:
        write(path / "a.mcap", *items, epoch=epoch)
    assert list(path.iterdir()) == []
    return str(caught.value)


def test_one_topic_holds_one_type(tmp_path: Path) -> None:
    arm = Switch(**AT, sensor="arm", closed=True), Wrench(**AT, sensor="arm", force=ONE, torque=TWO)
    assert refusal(tmp_path, *arm) == (
        "the topic /arm holds contactfusion_msgs/msg/Switch, and can't hold "
        "geometry_msgs/msg/WrenchStamped; call one of the two sensors otherwise"
    )


def test_two_sensors_never_share_a_topic(tmp_path: Path) -> None:
    switches = [Switch(**AT, sensor=name, closed=True) for name in ("left foot", "left-foot")]
    assert "'/left-foot' and another topic would both be /left_foot in ROS" in refusal(
        tmp_path, *switches
    )


def test_a_sensor_does_not_write_where_steps_do(tmp_path: Path) -> None:
    twist = Twist(**AT, sensor="contactfusion/cmd_vel", linear=ONE, angular=TWO)
    assert "can't be recorded on /contactfusion/cmd_vel, as what begins" in refusal(tmp_path, twist)


@pytest.mark.parametrize("stamp", [-0.001, 2.0**31])
def test_stamps_before_1970_and_after_2038_are_refused(tmp_path: Path, stamp: float) -> None:
    late = Switch(stamp=stamp, frame="base", closed=True)
    assert "lies before 1970 or after 2038" in refusal(tmp_path, late)


def test_a_reading_of_an_unknown_kind_is_refused(tmp_path: Path) -> None:
    sentence = refusal(tmp_path, Reading(**AT, sensor="nose"))
    assert "there is no message for a Reading of 'nose'" in sentence
    assert all(kind.__name__ in sentence for kind in READING_TYPES.values())
    assert "there is no message for a Reading;" in refusal(tmp_path, Reading(**AT))


def test_it_writes_within_a_with_statement_only(tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match="within its with statement only"):
        writer.reading(odometry())


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="is a folder"):
        McapWriter(tmp_path)


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ContactFusionError, match="cannot be made"):
        write(tmp_path / "file" / "a.mcap")


def test_without_rosbags_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    typestore.cache_clear()
    monkeypatch.setattr("contactfusion.recordings.messages.known_types", known_types.__wrapped__)
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(DependencyError) as caught:
        McapWriter(tmp_path / "a.mcap")
    assert str(caught.value) == (
        "rosbags is not installed; install it with: pip install 'contactfusion[record]'"
    )


def test_the_voxels_of_a_step_as_a_cloud_with_likelihoods_and_verdicts(written: Written) -> None:
    motion = cloud("motion", 0.25, {(9, 9, 9): 0.3}, kind=HypothesisKind.SUPPORT)
    free = cloud("free", 0.25, {THERE: 1.0, (9, 9, 0): 1.0}, kind=HypothesisKind.NULL)
    touches = cloud("skin", 0.2, {HERE: 0.8, THERE: 0.4})
    step = Step(0.25, fused(touches, motion, free, now=0.25), None)
    found = only(written(step), "/contactfusion/contacts/voxels", "sensor_msgs/msg/PointCloud2")
    points = np.frombuffer(bytes(found["data"]), np.uint8).reshape(-1, found["point_step"])
    numbers_ = points[:, :16].copy().view("<f4")
    space = step.fusion.space
    told = ~np.isnan(space.source_likelihoods[:, space.sources.index("skin")])
    assert len(points) == np.count_nonzero(told) == 2 < len(told)
    np.testing.assert_allclose(numbers_[:, :3], space.positions[told], atol=1e-6)
    np.testing.assert_allclose(numbers_[:, 3], space.likelihoods[told], atol=1e-6)
    words = ["support_only", "below_threshold", "contact", "nulled"]
    assert [words[code] for code in points[:, 16]] == space.verdicts[told].tolist()
    assert [field["name"] for field in found["fields"]] == ["x", "y", "z", "likelihood", "verdict"]
    assert [field["offset"] for field in found["fields"]] == [0, 4, 8, 12, 16]


def test_steps_without_voxels_are_drawn_once(tmp_path: Path) -> None:
    empty, full = Step(0.25, fused(now=0.25), None), commanded()
    with McapWriter(tmp_path / "a.mcap", EPOCH) as writer:
        for step in (empty, empty, full, empty, empty):
            writer.step(step)
    found = read_by_rosbags(tmp_path / "a.mcap")
    assert len(found["/contactfusion/contacts"]) == 5
    assert [len(found[f"/contactfusion/{name}"]) for name in VIEWS] == [3, 3]


def test_a_topic_that_cannot_be_copied_is_named(tmp_path: Path) -> None:
    raw = RawMessage("/big", "a/msg/B", "std_msgs/Header[5000000] v\n", EPOCH, bytes(8))
    with McapWriter(tmp_path / "out.mcap") as writer:
        with pytest.raises(RecordingError, match="^/big can't be copied: the definition"):
            writer.copy(raw)
