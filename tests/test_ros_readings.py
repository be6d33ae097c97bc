"""Messages of ROS as readings: what McapWriter wrote comes back, and what others write is read."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import RecordingError
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
from contactfusion.readings.messages import message
from contactfusion.readings.point_cloud import points_of
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.ros import RosConfig, RosRecording
from tests.ros_bags import (
    EPOCH,
    SECOND,
    Said,
    camera_info,
    image,
    joints,
    mcap,
    ros1,
    top,
    vector,
    wrench,
)

READING_TYPES = {codec.name: codec.kind for codec in BUILT_IN}

POINTS = np.array([[0.5, -0.25, 1.0], [np.nan, np.nan, np.nan], [2.0, 3.0, -4.0], [0.0, 0.0, 0.5]])
NUMBERS = {"f4": 7, "f8": 8, "u2": 4}
NAMES = ("a", "b", "c")


def recorded(folder: Path, *said: Said, **sensors: str) -> RosRecording:
    """Give the recording of messages, in a bag of ROS 2."""
    return RosRecording(RosConfig(file=mcap(folder, said), sensors=sensors))


def only(folder: Path, topic: str, one: Any) -> Any:
    """Give the one reading of a message."""
    (reading,) = recorded(folder, (topic, 0, one)).readings()
    return reading


def wrong(folder: Path, topic: str, one: Any) -> str:
    """Give why there is no reading of a message."""
    recording = recorded(folder, (topic, 0, one))
    assert list(recording.readings()) == []
    tally = recording.tally[topic]
    assert tally.unreadable == 1
    return tally.why_unreadable


# There and back


def some(kind: type[Reading], stamp: float, rng: np.random.Generator) -> Reading:
    """Give a random reading of a kind, whose sensor is called like it."""
    xyz, turn = rng.normal(size=3), rng.normal(size=4)
    turn /= np.linalg.norm(turn)
    places = np.where(rng.random((5, 1)) < 0.3, np.nan, rng.normal(size=(5, 3)))
    maybe = [None, xyz]
    size = tuple(int(one) for one in rng.integers(1, 5, 2))
    depth = np.where(rng.random(size) < 0.3, np.nan, rng.random(size)).astype(np.float32)
    values: dict[type[Reading], dict[str, Any]] = {
        Wrench: {"force": xyz, "torque": rng.normal(size=3)},
        TactileImage: {"values": rng.normal(size=int(rng.integers(0, 20)))},
        Switch: {"closed": bool(rng.integers(2))},
        PointCloud: {"points": places.astype(np.float32)},
        DepthImage: {
            "depth": depth,
            "intrinsics": np.diag([*rng.uniform(1.0, 500.0, 2), 1.0]),
            "colour": [None, rng.integers(0, 256, (*size, 3)).astype(np.uint8)][rng.integers(2)],
            "mask": [None, rng.random(size) < 0.5][rng.integers(2)],
        },
        JointState: {
            "names": NAMES,
            "positions": xyz,
            "velocities": maybe[rng.integers(2)],
            "efforts": maybe[rng.integers(2)],
        },
        JointCommand: {"names": NAMES, "positions": xyz},
        Twist: {"linear": xyz, "angular": rng.normal(size=3)},
        Odometry: {
            "child_frame": "wheels",
            "position": xyz,
            "orientation": turn,
            "linear": maybe[rng.integers(2)],
            "angular": maybe[rng.integers(2)],
        },
        ObjectPose: {"name": "box", "position": xyz, "orientation": turn},
        Markers: {"names": tuple("vwxyz"), "positions": places},
        Transform: {
            "child_frame": "arm",
            "position": xyz,
            "orientation": turn,
            "static": bool(rng.integers(2)),
        },
    }
    sensor = f"my/{kind.__name__}"
    if kind is Transform:
        sensor = "tf_static" if values[kind]["static"] else "tf"
    return kind(stamp=stamp, frame="base", sensor=sensor, **values[kind])


def assert_equal(one: Reading, other: Reading) -> None:
    assert type(one) is type(other)
    for field in fields(one):
        mine, theirs = getattr(one, field.name), getattr(other, field.name)
        if isinstance(mine, np.ndarray):
            np.testing.assert_array_equal(mine, theirs)
            assert mine.dtype == theirs.dtype
        else:
            assert mine == theirs, field.name


@pytest.mark.parametrize("seed", range(20))
def test_all_that_mcap_writer_writes_comes_back(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    kinds = list(READING_TYPES.values())
    times = np.sort(np.append(0, rng.integers(1, SECOND // 4, 39) + SECOND // 4 * np.arange(39)))
    times = times / SECOND
    wrote = [some(kinds[i % len(kinds)], float(time), rng) for i, time in enumerate(times)]
    path = tmp_path / "a.mcap"
    with McapWriter(path, EPOCH) as writer:
        for one in rng.permutation(np.array(wrote, object)) if seed % 2 else wrote:
            writer.reading(one)
    recording = RosRecording(RosConfig(file=path))
    assert recording.epoch_ns == EPOCH
    named = {one.sensor: type(one) for one in wrote} | {"tf": Transform}
    assert recording.topics == named
    found = list(recording.readings())
    # odometry moves a frame, too
    moved = [one for one in found if isinstance(one, Transform) and one.child_frame == "wheels"]
    rest = [one for one in found if one not in moved]
    assert len(rest) == len(wrote)
    for one, other in zip(wrote, rest, strict=True):
        assert_equal(one, other)
    told = [one for one in wrote if isinstance(one, Odometry)]
    assert len(told) == len(moved)
    for there, back in zip(told, moved, strict=True):
        np.testing.assert_array_equal(there.position, back.position)
        assert (there.stamp, there.frame) == (back.stamp, back.frame)


def test_a_pose_without_a_sensor_keeps_the_name_of_its_object(tmp_path: Path) -> None:
    turn = np.array([0.0, 0.0, 0.0, 1.0])
    at: dict[str, Any] = {"stamp": 0.0, "frame": "base", "position": turn[:3], "orientation": turn}
    with McapWriter(tmp_path / "a.mcap", EPOCH) as writer:
        writer.reading(ObjectPose(**at, name="box"))
        writer.reading(ObjectPose(**at, name="box"), prefix="truth")
    found = list(RosRecording(RosConfig(file=tmp_path / "a.mcap")).readings())
    told = [(one.sensor, one.name) for one in found if isinstance(one, ObjectPose)]
    assert told == [("object_pose", "box")]  # the truth is read only when asked for
    asked = RosConfig(file=tmp_path / "a.mcap", sensors={"truth": "/truth/box"})
    (true,) = RosRecording(asked).readings()
    assert isinstance(true, ObjectPose) and (true.sensor, true.name) == ("truth", "box")


# The layout of points


def cloud(
    points: Any = POINTS,
    *,
    order: str = "xyz",
    kind: str = "f4",
    big: bool = False,
    before: int = 0,
    after: int = 0,
    rows: int = 1,
    padding: int = 0,
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
    laid = [
        message("sensor_msgs/PointField", name=n, offset=at, datatype=NUMBERS[kind], count=1)
        for n, at in zip(order, offsets, strict=True)
    ]
    parts: dict[str, Any] = {
        "header": top(0, "lidar"),
        "height": rows,
        "width": len(points) // rows,
        "fields": laid,
        "is_bigendian": big,
        "point_step": step,
        "row_step": len(lines[0]),
        "data": np.frombuffer(b"".join(lines), np.uint8),
        "is_dense": False,
    }
    return message("sensor_msgs/PointCloud2", **{**parts, **changes})


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
    assert points_of(cloud(np.empty((0, 3)), height=0, width=7)).shape == (0, 3)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"order": "xy"}, "no field 'z'; its fields are: x, y"),
        ({"fields": []}, "no field 'x'; its fields are: none"),
        (
            {"points": np.ones((4, 3)), "kind": "u2"},
            "'x' of the cloud is neither float32 nor float64: its type is 4",
        ),
        ({"width": 5}, "no 1 rows of 5 points"),
        ({"point_step": 8}, "no 1 rows of 4 points: 'z' lies beyond the 8 bytes of a point"),
        ({"point_step": 0}, "no 1 rows of 4 points"),
        ({"rows": 2, "row_step": 0}, "the rows overlap"),
        ({"rows": 2, "row_step": 4_000_000_000}, "no 2 rows of 2 points"),
        ({"height": 2**31, "width": 2**31}, "rows"),
        ({"data": np.zeros(0, np.uint8)}, "no 1 rows of 4 points"),
    ],
)
def test_a_cloud_that_does_not_hold_together_is_one_sentence(
    changes: dict[str, Any], told: str
) -> None:
    with pytest.raises(RecordingError, match=told):
        points_of(cloud(**changes))


def test_a_wrong_cloud_is_counted_and_passed_over(tmp_path: Path) -> None:
    assert wrong(tmp_path, "/lidar", cloud(order="xy")).startswith("the cloud has no field 'z'")


def test_a_laser_scan_is_a_cloud_in_its_plane(tmp_path: Path) -> None:
    scan = message(
        "sensor_msgs/LaserScan",
        header=top(0, "laser"),
        angle_min=-math.pi / 2,
        angle_max=math.pi,
        angle_increment=math.pi / 2,
        time_increment=0.0,
        scan_time=0.1,
        range_min=0.5,
        range_max=10.0,
        ranges=np.array([1.0, 2.0, 0.1, math.inf, 11.0], np.float32),
        intensities=np.empty(0, np.float32),
    )
    reading = only(tmp_path, "/scan", scan)
    assert isinstance(reading, PointCloud) and reading.frame == "laser"
    np.testing.assert_allclose(reading.points[:2], [[0, -1, 0], [2, 0, 0]], atol=1e-6)
    assert np.isnan(reading.points[2:]).all() and len(reading.points) == 5


# Joints and motion


def test_joints_without_a_frame_get_one(tmp_path: Path) -> None:
    reading = only(tmp_path, "/joint_states", joints(velocity=np.array([1.0, 2.0])))
    assert isinstance(reading, JointState)
    assert (reading.frame, reading.sensor) == ("joints", "joint_states")
    assert reading.velocities is not None and reading.velocities.tolist() == [1.0, 2.0]
    assert reading.efforts is None


def test_what_a_joint_does_not_report_is_nan_and_what_none_reports_is_none(tmp_path: Path) -> None:
    told = joints(velocity=np.array([1.0, np.nan]), effort=np.array([np.nan, np.nan]))
    reading = only(tmp_path, "/joint_states", told)
    np.testing.assert_array_equal(reading.velocities, [1.0, np.nan])
    assert reading.efforts is None


def test_joints_without_positions_are_passed_over(tmp_path: Path) -> None:
    assert "no positions" in wrong(tmp_path, "/joints", joints(position=np.empty(0)))


def test_a_trajectory_commands_its_last_point(tmp_path: Path) -> None:
    def trajectory(*positions: Sequence[float]) -> Any:
        points = [
            message(
                "trajectory_msgs/JointTrajectoryPoint",
                positions=np.array(one),
                velocities=np.empty(0),
                accelerations=np.empty(0),
                effort=np.empty(0),
                time_from_start=message("builtin_interfaces/Duration", sec=1, nanosec=0),
            )
            for one in positions
        ]
        return message(
            "trajectory_msgs/JointTrajectory",
            header=top(0, ""),
            joint_names=["a", "b"],
            points=points,
        )

    reading = only(tmp_path / "2", "/goal", trajectory([0.0, 0.0], [1.0, 2.0]))
    assert isinstance(reading, JointCommand)
    assert (reading.names, reading.positions.tolist()) == (("a", "b"), [1.0, 2.0])
    assert "no point" in wrong(tmp_path / "0", "/goal", trajectory())


def test_a_pose_is_of_an_object_that_is_called_like_its_topic(tmp_path: Path) -> None:
    turn = message("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    place = message("geometry_msgs/Point", x=1.0, y=2.0, z=3.0)
    pose = message("geometry_msgs/Pose", position=place, orientation=turn)
    stamped = message("geometry_msgs/PoseStamped", header=top(), pose=pose)
    recording = recorded(tmp_path, ("/tracker/box", 0, stamped), ("/cup", 1, stamped))
    found = [one for one in recording.readings() if isinstance(one, ObjectPose)]
    assert [(one.sensor, one.name) for one in found] == [("tracker", "box"), ("cup", "cup")]
    (named,) = recorded(
        tmp_path / "n", ("/tracker/box", 0, stamped), seen="/tracker/box"
    ).readings()
    assert isinstance(named, ObjectPose) and (named.sensor, named.name) == ("seen", "box")


def test_two_objects_of_one_tracker_are_both_read(tmp_path: Path) -> None:
    turn = message("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    place = message("geometry_msgs/Point", x=1.0, y=2.0, z=3.0)
    pose = message("geometry_msgs/Pose", position=place, orientation=turn)
    stamped = message("geometry_msgs/PoseStamped", header=top(), pose=pose)
    recording = recorded(tmp_path, ("/tracker/box", 0, stamped), ("/tracker/cup", 1, stamped))
    found = [one for one in recording.readings() if isinstance(one, ObjectPose)]
    assert [(one.sensor, one.name) for one in found] == [("tracker", "box"), ("tracker", "cup")]
    assert recording.sensors == {"tracker": ("/tracker/box", "/tracker/cup")}
    asked = RosRecording(RosConfig(file=tmp_path / "made/made.mcap", sensors={"see": "/tracker"}))
    assert [one.sensor for one in asked.readings()] == ["see", "see"]


def test_odometry_of_a_robot(tmp_path: Path) -> None:
    def odometry(speed: float) -> Any:
        turn = message("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        place = message("geometry_msgs/Point", x=1.0, y=2.0, z=3.0)
        pose = message("geometry_msgs/Pose", position=place, orientation=turn)
        twist = message(
            "geometry_msgs/Twist", linear=vector(speed, 0.0, 0.0), angular=vector(0.0, 0.0, 0.25)
        )
        unknown = np.zeros(36)
        return message(
            "nav_msgs/Odometry",
            header=top(0, "/odom"),
            child_frame_id="/base_link",
            pose=message("geometry_msgs/PoseWithCovariance", pose=pose, covariance=unknown),
            twist=message("geometry_msgs/TwistWithCovariance", twist=twist, covariance=unknown),
        )

    reading = only(tmp_path / "known", "/odom", odometry(0.5))
    assert isinstance(reading, Odometry)
    assert (reading.frame, reading.child_frame) == ("odom", "base_link")
    assert reading.linear is not None and reading.linear.tolist() == [0.5, 0.0, 0.0]
    unknown = only(tmp_path / "unknown", "/odom", odometry(math.nan))
    assert unknown.linear is None and unknown.angular is not None


# Images

DEPTH = np.array([[0.5, 0.0, 2.0], [1.0, 0.25, 4.0]])


@pytest.mark.parametrize("padding", [0, 6])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("encoding", ["32FC1", "16UC1", "mono16"])
def test_depth_is_read_in_every_encoding(
    tmp_path: Path, encoding: str, big: bool, padding: int
) -> None:
    order = ">" if big else "<"
    pixels = (
        DEPTH.astype(order + "f4") if encoding == "32FC1" else (1000 * DEPTH).astype(order + "u2")
    )
    said = [
        ("/camera/depth/camera_info", 0, camera_info(0, (2, 3))),
        ("/camera/depth/image_rect_raw", 1, image(0, encoding, pixels, padding, big)),
        ("/camera/color/camera_info", 2, camera_info(0, (2, 3))),
        ("/camera/color/image_raw", 3, image(0, "rgb8", np.zeros((2, 3, 3), np.uint8))),
    ]
    for made in (mcap(tmp_path / "2", said), ros1(tmp_path / "1", said)):
        recording = RosRecording(RosConfig(file=made))
        assert recording.topics == {"camera/depth/image_rect_raw": DepthImage}
        (reading,) = recording.readings()
        assert isinstance(reading, DepthImage)
        assert (reading.frame, reading.stamp) == ("lens", 0.0)
        np.testing.assert_allclose(reading.depth, DEPTH, atol=1e-12)
        assert reading.intrinsics[0].tolist() == [300.0, 0.0, 1.0]
        assert reading.colour is None and reading.mask is None


@pytest.mark.parametrize(
    ("encoding", "pixel"),
    [
        ("rgb8", [1, 2, 3]),
        ("bgr8", [3, 2, 1]),
        ("rgba8", [1, 2, 3, 9]),
        ("bgra8", [3, 2, 1, 9]),
        ("mono8", [7]),
    ],
)
def test_colours_of_the_same_stamp_are_joined(
    tmp_path: Path, encoding: str, pixel: list[int]
) -> None:
    colour = np.tile(np.array(pixel, np.uint8), (2, 3, 1))
    mask = np.array([[0, 255, 0], [255, 0, 1]], np.uint8)
    depth = image(SECOND, "32FC1", DEPTH.astype("<f4"))
    said = [
        ("/eye/colour", 0, image(0, encoding, colour)),
        ("/eye/depth", 1, depth),
        ("/eye/colour", 2, image(SECOND, encoding, colour)),
        ("/eye/mask", 3, image(SECOND, "mono8", mask)),
        ("/eye/camera_info", 4, camera_info(SECOND, (2, 3))),
        ("/eye/depth", 5, image(SECOND + 1, "32FC1", DEPTH.astype("<f4"))),
    ]
    recording = recorded(tmp_path, *said)
    assert recording.topics == {"eye": DepthImage}
    first, second = recording.readings()
    assert isinstance(first, DepthImage) and isinstance(second, DepthImage)
    assert first.colour is not None and first.mask is not None
    wanted = [7, 7, 7] if encoding == "mono8" else [1, 2, 3]
    assert (first.colour == wanted).all()
    np.testing.assert_array_equal(first.mask, mask > 0)
    assert second.colour is None and second.mask is None
    assert second.intrinsics[0, 0] == 300.0


def test_the_camera_is_that_of_its_time(tmp_path: Path) -> None:
    said: list[Said] = []
    for i in range(5):
        at = i * SECOND
        said += [
            ("/eye/camera_info", 3 * i, camera_info(at, (2, 3), focal=100.0 + i)),
            ("/eye/depth", 3 * i + 1, image(at + 7, "32FC1", DEPTH.astype("<f4"))),
        ]
    found = recorded(tmp_path, *said).readings()
    assert [one.intrinsics[0, 0] for one in found if isinstance(one, DepthImage)] == [
        100.0, 101.0, 102.0, 103.0, 104.0
    ]  # fmt: skip


def test_a_camera_that_is_told_once_is_kept(tmp_path: Path) -> None:
    said: list[Said] = [("/eye/camera_info", 0, camera_info(0, (2, 3)))]
    said += [("/eye/depth", i, image(i * SECOND, "16UC1", DEPTH.astype("<u2"))) for i in range(9)]
    assert len(list(recorded(tmp_path, *said, eye="/eye/depth").readings())) == 9


def test_images_that_do_not_hold_together_are_counted(tmp_path: Path) -> None:
    whole = image(0, "32FC1", DEPTH.astype("<f4"))
    short = image(SECOND, "32FC1", DEPTH.astype("<f4"))
    short.data = short.data[:-1]
    other = image(2 * SECOND, "rgb8", np.zeros((2, 3, 3), np.uint8))
    large = image(3 * SECOND, "32FC1", np.ones((4, 3), "<f4"))
    said = [
        ("/eye/camera_info", 0, camera_info(0, (2, 3))),
        *[("/eye/depth", i, one) for i, one in enumerate((whole, short, other, large))],
    ]
    recording = recorded(tmp_path, *said)
    assert len(list(recording.readings())) == 1
    tally = recording.tally["/eye/depth"]
    assert tally.unreadable == 3
    assert "23 bytes are no 2 rows of 3 pixels of 32FC1, 12 bytes a row" in tally.why_unreadable


def test_depth_without_a_camera_is_no_reading(tmp_path: Path) -> None:
    depth = image(0, "32FC1", DEPTH.astype("<f4"))
    with pytest.raises(RecordingError, match="no image of depth, or has no camera_info beside"):
        recorded(tmp_path, ("/eye/depth", 0, depth), ("/w", 1, wrench()), eye="/eye/depth")
