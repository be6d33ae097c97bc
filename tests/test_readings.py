"""Readings: checked and frozen when they are made."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import InvalidReadingError
from contactfusion.readings import BUILT_IN, Reading
from contactfusion.readings.poses import PosedReading

READING_TYPES = {codec.name: codec.kind for codec in BUILT_IN}

ONES, TURN = np.ones(3), np.array([0.0, 0.0, 0.0, 1.0])
GOOD: dict[str, dict[str, Any]] = {
    "wrench": {"force": ONES, "torque": ONES},
    "tactile_image": {"values": np.ones((2, 4))},
    "switch": {"closed": True},
    "point_cloud": {"points": np.ones((5, 3))},
    "depth_image": {"depth": np.ones((3, 4)), "intrinsics": np.eye(3)},
    "joint_state": {"names": ("a", "b"), "positions": np.ones(2)},
    "joint_command": {"names": ("a", "b"), "positions": np.ones(2)},
    "object_pose": {"name": "box", "position": ONES, "orientation": TURN},
    "twist": {"linear": ONES, "angular": ONES},
    "odometry": {"child_frame": "wheels", "position": ONES, "orientation": TURN},
    "transform": {"child_frame": "eye", "position": ONES, "orientation": TURN},
    "markers": {"names": ("a", "b"), "positions": np.ones((2, 3))},
}


def subclasses(kind: type[Reading]) -> set[type[Reading]]:
    below = set(kind.__subclasses__())
    return below.union(*map(subclasses, below))


def made(kind: str, **fields: Any) -> Any:
    common = {"stamp": 0.5, "frame": "base", "sensor": "it"}
    return READING_TYPES[kind](**{**common, **GOOD[kind], **fields})


def test_every_kind_of_reading_has_a_name_and_is_tested_here() -> None:
    assert set(READING_TYPES) == set(GOOD)
    home = Reading.__module__.rpartition(".")[0]
    ours = {kind for kind in subclasses(Reading) if kind.__module__.startswith(home)}
    assert set(READING_TYPES.values()) == ours - {PosedReading}


@pytest.mark.parametrize("kind", GOOD)
def test_a_reading_cannot_be_changed(kind: str) -> None:
    one = made(kind)
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.stamp = 1.0
    arrays = [v for v in vars(one).values() if isinstance(v, np.ndarray)]
    assert all(not array.flags.writeable for array in arrays)


@pytest.mark.parametrize("kind", GOOD)
@pytest.mark.parametrize("stamp", [np.nan, np.inf, 1e18, "soon", None])
def test_a_reading_needs_a_stamp(kind: str, stamp: Any) -> None:
    with pytest.raises(InvalidReadingError, match="the stamp of .* of 'it' is"):
        made(kind, stamp=stamp)


@pytest.mark.parametrize("kind", GOOD)
def test_a_reading_needs_a_frame(kind: str) -> None:
    with pytest.raises(InvalidReadingError, match="needs the name of its frame"):
        made(kind, frame="")


def test_a_reading_is_called_by_its_kind_and_sensor() -> None:
    assert made("wrench").label == "Wrench of 'it'"
    assert made("wrench", sensor="").label == "Wrench"


def test_a_command_that_names_a_joint_twice_is_refused() -> None:
    with pytest.raises(InvalidReadingError, match="JointCommand of 'it' names a joint twice"):
        made("joint_command", names=("a", "a"))


def test_an_object_has_a_name_and_a_turn() -> None:
    with pytest.raises(InvalidReadingError, match="needs the name of its object"):
        made("object_pose", name="")
    with pytest.raises(InvalidReadingError, match="is no unit quaternion"):
        made("object_pose", orientation=np.ones(4))


def test_the_values_of_a_patch_come_in_one_row() -> None:
    assert made("tactile_image").values.shape == (8,)


@pytest.mark.parametrize("kind", ["point_cloud", "markers", "depth_image"])
def test_what_was_not_seen_may_be_nan(kind: str) -> None:
    field = {"point_cloud": "points", "markers": "positions", "depth_image": "depth"}[kind]
    gaps = np.full_like(GOOD[kind][field], np.nan)
    assert np.isnan(getattr(made(kind, **{field: gaps}), field)).all()


def test_no_points_are_a_scene_with_nothing_in_it() -> None:
    assert made("point_cloud", points=[]).points.shape == (0, 3)


@pytest.mark.parametrize(
    ("kind", "fields", "sentence"),
    [
        ("wrench", {"force": np.ones(2)}, r"force of Wrench of 'it' have shape \(2,\), not \(3,\)"),
        ("wrench", {"torque": [0, 0, np.nan]}, "row 2 of the torque of Wrench of 'it'"),
        ("tactile_image", {"values": [1.0, np.inf]}, "row 1 of the values of TactileImage"),
        ("tactile_image", {"values": ["a", "b"]}, "values of TactileImage of 'it' are not numbers"),
        ("tactile_image", {"values": [[1.0], [1.0, 2.0]]}, "values of TactileImage of 'it'"),
        ("point_cloud", {"points": np.ones((2, 2))}, "points of PointCloud"),
        ("depth_image", {"intrinsics": np.eye(2)}, "intrinsics of DepthImage"),
        ("depth_image", {"mask": np.ones((4, 3), bool)}, "mask of DepthImage"),
        ("depth_image", {"colour": np.ones((3, 4), np.uint8)}, "colour of DepthImage"),
        ("depth_image", {"colour": [[[300, 0, 0]] * 4] * 3}, "colour of DepthImage"),
        ("joint_state", {"names": ("a", "a")}, "names a joint twice"),
        ("joint_state", {"names": ("a",)}, r"positions of JointState of 'it' have shape \(2,\)"),
        ("joint_state", {"velocities": np.ones(3)}, "velocities of JointState"),
        ("joint_state", {"efforts": [np.inf, 1.0]}, "efforts of JointState of 'it' are infinite"),
        ("twist", {"linear": np.full(3, np.inf)}, "row 0 of the linear of Twist"),
        ("odometry", {"orientation": TURN * 0.9}, "no unit quaternion: its norm is 0.9"),
        ("odometry", {"orientation": np.zeros(4)}, "no unit quaternion: its norm is 0"),
        ("odometry", {"linear": np.ones(2)}, "linear of Odometry"),
        ("transform", {"child_frame": ""}, "needs the name of its child frame"),
        ("transform", {"child_frame": "base"}, "gives the pose of 'base' in itself"),
        ("markers", {"names": ("a",)}, r"positions of Markers of 'it' have shape \(2, 3\)"),
    ],
)
def test_what_a_sensor_cannot_have_given_is_refused(
    kind: str, fields: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(InvalidReadingError, match=sentence):
        made(kind, **fields)
