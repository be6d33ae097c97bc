"""Sensors that fail on purpose: what comes of their readings, and what does not change."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from contactfusion import Pipeline, PipelineConfig, Reading, Step
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.faults import FAULTS, Bias, Fault, Faults, Silent, read_faults, unmet
from contactfusion.frames import pose_at
from contactfusion.readings import (
    BUILT_IN,
    DepthImage,
    JointCommand,
    JointState,
    Markers,
    ObjectPose,
    Odometry,
    PointCloud,
    Switch,
    TactileImage,
    Transform,
    Twist,
    Wrench,
)
from contactfusion.readings.registry import installed_kinds
from contactfusion.readings.values import Values
from tests.toys import offer_toys, point, wrench

READING_TYPES = {codec.name: codec.kind for codec in BUILT_IN}

PAGE = Path(__file__).resolve().parents[1] / "docs" / "faults.md"
NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])
QUARTER = Rotation.from_rotvec([0.0, 0.0, np.pi / 2]).as_quat()
ABOUT_Z = [0.0, 0.0, 90.0]
VALUES: dict[str, dict[str, Any]] = {
    "wrench": {"force": [1.0, 2.0, 3.0], "torque": [0.1, 0.2, 0.3]},
    "tactile_image": {"values": [1.0, 2.0, 3.0]},
    "switch": {"closed": True},
    "point_cloud": {"points": np.array([[1.0, 2.0, 3.0], [np.nan, 0.0, 0.0]])},
    "depth_image": {"depth": np.array([[0.0, np.nan], [1.0, 2.0]]), "intrinsics": np.eye(3)},
    "joint_state": {
        "names": ("a", "b"),
        "positions": [1.0, 2.0],
        "velocities": [3.0, 4.0],
        "efforts": [5.0, 6.0],
    },
    "joint_command": {"names": ("a", "b"), "positions": [1.0, 2.0]},
    "twist": {"linear": [1.0, 0.0, 0.0], "angular": [0.0, 0.0, 2.0]},
    "odometry": {
        "child_frame": "wheels",
        "position": [1.0, 2.0, 3.0],
        "orientation": QUARTER,
        "linear": [1.0, 0.0, 0.0],
        "angular": [0.0, 0.0, 1.0],
    },
    "transform": {"child_frame": "eye", "position": [1.0, 2.0, 3.0], "orientation": QUARTER},
    "object_pose": {"name": "mug", "position": [1.0, 2.0, 3.0], "orientation": QUARTER},
    "markers": {"names": ("p", "q"), "positions": np.array([[1.0, 0.0, 0.0], [np.nan] * 3])},
}
AMOUNTS: dict[str, list[float]] = {
    "wrench": [1.0] * 6,
    "tactile_image": [1.0],
    "point_cloud": [1.0],
    "depth_image": [1.0],
    "joint_state": [1.0],
    "joint_command": [1.0, 1.0],
    "twist": [1.0] * 6,
    "object_pose": [1.0] * 6,
    "transform": [1.0] * 6,
    "odometry": [1.0] * 6,
    "markers": [1.0, 1.0, 1.0],
}
SPECIAL = {"switch", "odometry", "transform", "object_pose", "depth_image"}
"""Not all their values are zero when a driver sends zeros."""
MOVABLE = ("wrench", "twist", "odometry", "transform", "object_pose", "point_cloud", "markers")


def values_of(reading: Reading) -> Values[Any]:
    codec = installed_kinds().of(type(reading))
    assert codec is not None
    return codec.values


def zeroed(reading: Reading) -> Any:
    return values_of(reading).zeroed(reading)


def repeated(reading: Reading, other: Reading, elements: Any = None) -> Any:
    return values_of(reading).repeated(reading, other, elements)


def moved(reading: Reading, pose: FloatArray) -> Any:
    return values_of(reading).moved(reading, pose)


def made(kind: str, stamp: float = 0.0, sensor: str = "it", **fields: Any) -> Any:
    common = {"stamp": stamp, "frame": "base", "sensor": sensor}
    return READING_TYPES[kind](**{**common, **VALUES[kind], **fields})


def skin(stamp: float, *values: float, sensor: str = "skin") -> TactileImage:
    return TactileImage(stamp=stamp, frame="base", sensor=sensor, values=np.array(values))


def configured(*entries: Any, **fields: Any) -> PipelineConfig:
    return PipelineConfig(faults=entries, **fields)


def faults(*entries: dict[str, Any], seed: int = 0) -> Faults:
    return Faults(configured(*entries).faults, seed)


def one_fault(**entry: Any) -> Fault:
    (fault,) = configured(entry).faults
    return fault


def after(fault: dict[str, Any], readings: Sequence[Reading], seed: int = 0) -> list[Any]:
    broken = faults(fault, seed=seed)
    return [one for reading in readings for one in broken.apply(reading)]


def same(one: Reading, other: Reading) -> bool:
    """Tell whether two readings are equal to the bit; 0 and -0 count as equal."""
    mine, others = vars(one), vars(other)
    return type(one) is type(other) and all(
        np.array_equal(value, others[name], equal_nan=True)
        if isinstance(value, np.ndarray) and value.dtype == np.float64
        else np.array_equal(value, others[name])
        for name, value in mine.items()
    )


def all_same(some: Sequence[Reading], others: Sequence[Reading]) -> bool:
    return len(some) == len(others) and all(map(same, some, others))


def stamps(readings: Sequence[Reading]) -> list[float]:
    return [reading.stamp for reading in readings]


def values(readings: Sequence[Any]) -> list[list[float]]:
    return [reading.values.tolist() for reading in readings]


def entries(kind: str, amount: float) -> list[dict[str, Any]]:
    """Every fault that a kind of reading may have; with an amount of 0 those change nothing."""
    found: list[dict[str, Any]] = [
        {"fault": "dropout", "probability": amount},
        {"fault": "delay", "seconds": amount},
    ]
    if kind in AMOUNTS:
        numbers = [amount * number for number in AMOUNTS[kind]]
        found += [{"fault": name, "amount": numbers} for name in ("bias", "drift", "noise")]
    if kind in MOVABLE:
        found.append({"fault": "calibration", "mm": [amount] * 3, "degrees": [amount] * 3})
    if amount:
        found += [{"fault": name} for name in ("silent", "zeros", "stuck")]
    return found


EVERY_FAULT = [(kind, entry) for kind in VALUES for entry in entries(kind, 1.0)]
EVERY_FAULT_OF_NOTHING = [(kind, entry) for kind in VALUES for entry in entries(kind, 0.0)]


# Which readings come


def test_every_kind_of_reading_is_tested_here() -> None:
    assert set(VALUES) == set(READING_TYPES)


def test_a_silent_sensor_gives_nothing_from_start_to_end() -> None:
    readings = [skin(stamp, 1.0) for stamp in (0.0, 1.0, 1.5, 2.0, 3.0)]
    assert stamps(after({"fault": "silent", "start": 1.0, "end": 2.0}, readings)) == [0.0, 3.0]


def test_a_fault_without_start_and_end_acts_always() -> None:
    assert after({"fault": "silent"}, [skin(-1e6, 1.0), skin(0.0, 1.0), skin(1e6, 1.0)]) == []


def test_a_dropout_loses_the_share_of_readings_that_it_says() -> None:
    readings = [skin(stamp, 1.0) for stamp in np.arange(10_000) / 100]
    left = after({"fault": "dropout", "probability": 0.3}, readings)
    assert len(left) == pytest.approx(7000, abs=4 * np.sqrt(10_000 * 0.3 * 0.7))
    assert after({"fault": "dropout", "probability": 1.0}, readings) == []
    assert all_same(after({"fault": "dropout", "probability": 0.0}, readings), readings)


def test_a_delayed_reading_waits_for_the_first_reading_of_any_sensor_past_its_time() -> None:
    broken = faults({"fault": "delay", "sensor": "skin", "seconds": 0.2})
    assert broken.apply(skin(0.1, 7.0)) == []
    assert stamps(broken.apply(wrench(0.25, 1.0, 0.0, 0.0))) == [0.25]
    assert broken.apply(skin(0.28, 8.0)) == []
    first, second = broken.apply(wrench(0.3, 1.0, 0.0, 0.0))  # 0.1 + 0.2 > 0.3 in floats
    assert first.stamp == 0.1 and values([first]) == [[7.0]] and second.stamp == 0.3
    assert stamps(broken.apply(skin(0.9, 9.0))) == [0.28]


def test_delayed_readings_come_in_the_order_in_which_they_were_due() -> None:
    broken = faults({"fault": "delay", "sensor": "skin", "seconds": 0.2})
    for stamp in (0.1, 0.3, 0.2):
        broken.apply(skin(stamp, 1.0))
    assert stamps(broken.apply(wrench(9.0, 1.0, 0.0, 0.0))) == [0.2, 0.3, 9.0]


def test_transforms_that_come_ahead_let_no_delayed_reading_go() -> None:
    broken = faults({"fault": "delay", "sensor": "skin", "seconds": 0.2})
    ahead = Transform(
        stamp=1.1, frame="base", child_frame="skin",
        position=np.zeros(3), orientation=np.array([0.0, 0.0, 0.0, 1.0]),
    )  # fmt: skip
    assert broken.apply(skin(0.1, 1.0)) == []
    assert stamps(broken.apply(ahead)) == [1.1]
    assert stamps(broken.apply(wrench(0.3, 1.0, 0.0, 0.0))) == [0.1, 0.3]


def test_a_delay_lets_go_also_when_the_later_reading_is_lost_itself() -> None:
    broken = faults(
        {"fault": "silent", "sensor": "wrench"},
        {"fault": "delay", "sensor": "skin", "seconds": 0.2},
    )
    assert broken.apply(skin(0.0, 1.0)) == []
    assert stamps(broken.apply(wrench(1.0, 1.0, 0.0, 0.0))) == [0.0]


def test_a_delay_of_every_sensor_delays_every_sensor() -> None:
    readings = [skin(0.0, 1.0), wrench(0.1, 1.0, 0.0, 0.0), skin(0.25, 1.0), skin(0.4, 1.0)]
    assert stamps(after({"fault": "delay", "seconds": 0.2}, readings)) == [0.0, 0.1]


# Zeros


@pytest.mark.parametrize("kind", sorted(set(VALUES) - SPECIAL))
def test_zeros_are_in_every_value_and_the_rest_stays(kind: str) -> None:
    whole, broken = vars(made(kind, 0.5)), vars(zeroed(made(kind, 0.5)))
    for name, value in broken.items():
        if isinstance(value, np.ndarray):
            assert value.shape == whole[name].shape and not value.any()
        else:
            assert value == whole[name]


def test_a_switch_of_zeros_is_open() -> None:
    switch = zeroed(made("switch"))
    assert isinstance(switch, Switch) and switch.closed is False


def test_a_pose_of_zeros_is_the_identity_at_rest() -> None:
    pose = zeroed(made("odometry"))
    assert isinstance(pose, Odometry) and pose.linear is not None and pose.angular is not None
    assert not pose.position.any() and not pose.linear.any() and not pose.angular.any()
    assert pose.orientation.tolist() == [0.0, 0.0, 0.0, 1.0]
    mug = zeroed(made("object_pose"))
    assert isinstance(mug, ObjectPose) and not mug.position.any()
    assert mug.orientation.tolist() == [0.0, 0.0, 0.0, 1.0]


def test_a_depth_image_of_zeros_has_no_returns_and_keeps_colours_and_camera() -> None:
    colour = np.full((2, 2, 3), 9, dtype=np.uint8)
    image = zeroed(made("depth_image", colour=colour))
    assert isinstance(image, DepthImage) and image.colour is not None
    assert not image.depth.any() and image.colour.all() and image.intrinsics.any()


def test_what_a_robot_does_not_tell_stays_untold() -> None:
    state = zeroed(made("joint_state", velocities=None, efforts=None))
    assert isinstance(state, JointState) and state.velocities is None and state.efforts is None


def test_some_taxels_may_be_zero_alone() -> None:
    fault = {"fault": "zeros", "sensor": "skin", "elements": [0, 2]}
    assert values(after(fault, [skin(0.0, 1.0, 2.0, 3.0)])) == [[0.0, 2.0, 0.0]]


# Stuck


def test_a_stuck_sensor_repeats_its_last_reading_before_the_start_with_new_stamps() -> None:
    readings = [skin(stamp, 10.0 * stamp) for stamp in (0.0, 1.0, 2.0, 3.0, 4.0)]
    stuck = after({"fault": "stuck", "start": 1.5, "end": 3.5}, readings)
    assert stamps(stuck) == stamps(readings)
    assert values(stuck) == [[0.0], [10.0], [10.0], [10.0], [40.0]]


def test_a_sensor_that_is_stuck_from_the_beginning_repeats_its_first_reading() -> None:
    readings = [skin(stamp, 10.0 * stamp) for stamp in (1.0, 2.0, 3.0)]
    for start in ({}, {"start": 0.5}):
        assert values(after({"fault": "stuck", **start}, readings)) == [[10.0], [10.0], [10.0]]


def test_a_stuck_taxel_leaves_the_others_alone() -> None:
    readings = [skin(0.0, 1.0, 2.0, 3.0), skin(1.0, 4.0, 5.0, 6.0)]
    stuck = after({"fault": "stuck", "elements": [1]}, readings)
    assert values(stuck) == [[1.0, 2.0, 3.0], [4.0, 2.0, 6.0]]


def test_a_stuck_joint_keeps_position_velocity_and_effort() -> None:
    moving = made("joint_state", positions=[7.0, 7.0], velocities=[8.0, 8.0], efforts=[9.0, 9.0])
    stuck = repeated(moving, made("joint_state"), (0,))
    assert isinstance(stuck, JointState)
    assert stuck.velocities is not None and stuck.efforts is not None
    assert stuck.positions.tolist() == [1.0, 7.0]
    assert stuck.velocities.tolist() == [3.0, 8.0] and stuck.efforts.tolist() == [5.0, 9.0]


def test_a_joint_may_be_stuck_of_a_robot_that_tells_positions_only() -> None:
    moving = made("joint_state", positions=[7.0, 7.0], velocities=None, efforts=None)
    stuck = repeated(moving, made("joint_state"), (1,))
    assert isinstance(stuck, JointState)
    assert stuck.positions.tolist() == [7.0, 2.0] and stuck.velocities is None


def test_sensors_without_a_name_are_stuck_each_at_its_own_value() -> None:
    def joints(names: tuple[str, ...], angle: float, frame: str = "base") -> JointState:
        return JointState(
            stamp=angle, frame=frame, names=names, positions=np.full(len(names), angle)
        )

    def odometry(child: str, x: float) -> Odometry:
        return Odometry(
            stamp=x,
            frame="odom",
            child_frame=child,
            position=np.array([x, 0.0, 0.0]),
            orientation=NO_TURN,
        )

    def mug(name: str, stamp: float) -> Any:
        return made("object_pose", stamp, "", name=name, position=[stamp, 0.0, 0.0])

    readings = [
        mug("mug", 0.5),
        mug("jug", 0.6),
        mug("mug", 0.7),
        mug("jug", 0.8),
        joints(("a", "b"), 1.0),
        joints(("thumb",), 2.0),
        joints(("thumb",), 3.0, "other"),
        odometry("base", 4.0),
        odometry("cart", 5.0),
        joints(("a", "b"), 6.0),
        joints(("thumb",), 7.0),
        joints(("thumb",), 8.0, "other"),
        odometry("base", 9.0),
        odometry("cart", 10.0),
    ]
    stuck = after({"fault": "stuck"}, readings)
    firsts = [float(one.positions[0]) for one in stuck if isinstance(one, JointState)]
    assert firsts == [1.0, 2.0, 3.0, 1.0, 2.0, 3.0]
    assert [float(one.position[0]) for one in stuck if isinstance(one, Odometry)] == [4, 5, 4, 5]
    assert [float(one.position[0]) for one in stuck[:4]] == [0.5, 0.6, 0.5, 0.6]


# Bias, drift, noise


def biased(kind: str, amount: Sequence[float], elements: Any = None, **fields: Any) -> Any:
    reading = made(kind, **fields)
    values = values_of(reading)
    return values.added(reading, values.changes(reading, amount, elements))


def test_a_bias_of_a_wrench_is_a_force_and_a_torque() -> None:
    one: Wrench = biased("wrench", [1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    assert one.force.tolist() == [2.0, 4.0, 6.0] and one.torque.tolist() == [0.2, 0.4, 0.6]


def test_a_bias_of_a_twist_is_a_linear_and_an_angular_velocity() -> None:
    one: Twist = biased("twist", [1.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    assert one.linear.tolist() == [2.0, 0.0, 0.0] and one.angular.tolist() == [0.0, 0.0, 2.5]


@pytest.mark.parametrize(
    ("amount", "elements", "expected"),
    [
        ([10.0], None, [11.0, 12.0, 13.0]),
        ([10.0, 20.0, 30.0], None, [11.0, 22.0, 33.0]),
        ([10.0], (2, 0), [11.0, 2.0, 13.0]),
        ([10.0, 20.0], (2, 0), [21.0, 2.0, 13.0]),
    ],
)
def test_a_bias_of_taxels_is_one_number_or_one_for_each(
    amount: list[float], elements: Any, expected: list[float]
) -> None:
    assert biased("tactile_image", amount, elements).values.tolist() == expected


@pytest.mark.parametrize(
    ("amount", "elements", "expected"),
    [
        ([1.0], None, [[2, 3], [3, 4], [5, 6]]),
        ([1.0, 2.0], None, [[2, 4], [3, 4], [5, 6]]),
        ([1.0, 2.0, 3.0, 4.0], None, [[2, 4], [6, 8], [5, 6]]),
        ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], None, [[2, 4], [6, 8], [10, 12]]),
        ([1.0], (1,), [[1, 3], [3, 4], [5, 6]]),
        ([0.0, 0.0, 1.5], (1,), [[1, 2], [3, 4], [5, 7.5]]),
    ],
)
def test_a_bias_of_joints_is_of_positions_then_velocities_then_efforts(
    amount: list[float], elements: Any, expected: list[list[float]]
) -> None:
    state = biased("joint_state", amount, elements)
    assert [state.positions.tolist(), state.velocities.tolist(), state.efforts.tolist()] == expected


def test_a_bias_of_a_command_is_of_positions() -> None:
    command: JointCommand = biased("joint_command", [0.5], (1,))
    assert command.positions.tolist() == [1.0, 2.5]


def test_a_robot_without_velocities_may_have_biased_efforts() -> None:
    state = biased("joint_state", [0.0, 0.0, 1.5], (1,), velocities=None)
    assert state.velocities is None and state.efforts.tolist() == [5.0, 7.5]


def test_a_bias_of_points_moves_them_and_lost_ones_stay_lost() -> None:
    cloud: PointCloud = biased("point_cloud", [0.1, 0.2, 0.3])
    assert cloud.points[0] == pytest.approx([1.1, 2.2, 3.3]) and np.isnan(cloud.points[1, 0])
    markers: Markers = biased("markers", [0.5])
    assert markers.positions[0].tolist() == [1.5, 0.5, 0.5] and np.isnan(markers.positions[1]).all()


def test_a_bias_of_depth_gives_no_returns_where_there_were_none_and_takes_those_below_0() -> None:
    image: DepthImage = biased("depth_image", [-1.5])
    assert image.depth.tolist()[1] == [0.0, 0.5]
    further: DepthImage = biased("depth_image", [1.5])
    assert further.depth.tolist()[1] == [2.5, 3.5]
    for one in (image, further):
        assert one.depth[0, 0] == 0.0 and np.isnan(one.depth[0, 1])


def test_a_bias_of_odometry_shifts_and_turns_about_the_axes_of_its_frame() -> None:
    pose: Odometry = biased("odometry", [1.0, 0.0, 0.0, np.pi / 2, 0.0, 0.0])
    assert pose.position.tolist() == [2.0, 2.0, 3.0]
    turned = Rotation.from_quat(pose.orientation)  # first about z, then about the fixed x
    assert turned.apply([1.0, 0.0, 0.0]) == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    rounded = [0.0, 0.0, 0.0, 1.0001]
    shifted: Odometry = biased("odometry", [1.0, 0.0, 0.0], orientation=rounded)
    assert shifted.orientation.tolist() == rounded


def test_an_object_is_shifted_and_turned_as_a_robot_is() -> None:
    amount = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    mug, base = biased("object_pose", amount), biased("odometry", amount)
    assert np.array_equal(mug.position, base.position)
    assert np.array_equal(mug.orientation, base.orientation)
    pose = pose_at((1.0, 2.0, 3.0), (0.1, 0.2, 0.3))
    moved_mug, moved_base = moved(made("object_pose"), pose), moved(made("odometry"), pose)
    assert isinstance(moved_mug, ObjectPose) and isinstance(moved_base, Odometry)
    assert np.array_equal(moved_mug.position, moved_base.position)
    assert np.array_equal(moved_mug.orientation, moved_base.orientation)


def test_a_drift_grows_from_its_start() -> None:
    readings = [skin(stamp, 1.0) for stamp in (1.0, 2.0, 3.0, 5.0)]
    drifting = after({"fault": "drift", "amount": 0.5, "start": 2.0}, readings)
    assert values(drifting) == [[1.0], [1.0], [1.5], [2.5]]


def test_a_drift_without_a_start_grows_from_the_first_reading() -> None:
    readings = [skin(stamp, 1.0) for stamp in (100.0, 102.0)]
    assert values(after({"fault": "drift", "amount": 0.5}, readings)) == [[1.0], [2.0]]


def test_noise_has_the_standard_deviation_that_it_says_and_no_mean() -> None:
    readings = [skin(stamp, 5.0, 5.0) for stamp in np.arange(5000) / 100]
    noisy = np.array(values(after({"fault": "noise", "amount": [2.0, 0.5]}, readings)))
    assert noisy.mean(axis=0) == pytest.approx([5.0, 5.0], abs=0.1)
    assert noisy.std(axis=0) == pytest.approx([2.0, 0.5], rel=0.05)
    assert abs(np.corrcoef(noisy.T)[0, 1]) < 0.05
    assert abs(np.corrcoef(noisy[1:, 0], noisy[:-1, 0])[0, 1]) < 0.05


def test_noise_is_independent_from_point_to_point_and_pixel_to_pixel() -> None:
    (cloud,) = after(
        {"fault": "noise", "amount": 0.1}, [made("point_cloud", points=np.ones((5, 3)))]
    )
    assert len(np.unique(cloud.points)) == 15
    (image,) = after(
        {"fault": "noise", "amount": 0.1}, [made("depth_image", depth=np.ones((4, 5)))]
    )
    assert len(np.unique(image.depth)) == 20


def test_noise_on_one_taxel_leaves_the_others_alone() -> None:
    (image,) = after({"fault": "noise", "amount": 1.0, "elements": [1]}, [skin(0.0, 1.0, 2.0, 3.0)])
    assert image.values[[0, 2]].tolist() == [1.0, 3.0] and image.values[1] != 2.0


# Calibration


def test_a_wrong_mounting_is_given_in_millimetres_and_degrees_and_turns_before_it_shifts() -> None:
    fault = {"fault": "calibration", "mm": [100.0, 0.0, 0.0], "degrees": ABOUT_Z}
    (cloud,) = after(fault, [made("point_cloud")])
    assert cloud.points[0] == pytest.approx([0.1 - 2.0, 1.0, 3.0])
    assert np.isnan(cloud.points[1, 0])
    (markers,) = after(fault, [made("markers")])
    assert markers.positions[0] == pytest.approx([0.1, 1.0, 0.0])


def test_degrees_are_roll_pitch_and_yaw_about_fixed_axes() -> None:
    fault = {"fault": "calibration", "degrees": [90.0, 0.0, 90.0]}
    (cloud,) = after(fault, [made("point_cloud", points=[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])])
    assert cloud.points == pytest.approx(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]))


def test_a_shifted_wrench_gets_the_torque_about_its_believed_origin() -> None:
    fault = {"fault": "calibration", "mm": [100.0, 0.0, 0.0], "degrees": ABOUT_Z}
    (one,) = after(fault, [made("wrench", force=[2.0, 0.0, 0.0], torque=[0.3, 0.0, 0.0])])
    assert one.force == pytest.approx([0.0, 2.0, 0.0])
    assert one.torque == pytest.approx([0.0, 0.3, 0.2])  # turned, and 0.1 m times 2 N about z


def test_a_shifted_twist_is_that_of_another_point_of_the_same_body() -> None:
    one = moved(made("twist"), pose_at((0.0, 0.1, 0.0), (0.0, 0.0, 0.0)))
    assert isinstance(one, Twist)
    assert one.linear == pytest.approx([1.2, 0.0, 0.0])  # (0, 0.1, 0) x (0, 0, 2) along x
    assert one.angular.tolist() == [0.0, 0.0, 2.0]


def test_a_moved_pose_is_moved_in_its_frame_and_its_velocities_stay() -> None:
    fault = {"fault": "calibration", "mm": [1000.0, 0.0, 0.0], "degrees": ABOUT_Z}
    (pose,) = after(fault, [made("odometry")])
    assert pose.position == pytest.approx([1.0 - 2.0, 1.0, 3.0])
    turn = Rotation.from_quat(pose.orientation).as_rotvec()
    assert turn == pytest.approx([0.0, 0.0, np.pi])
    assert pose.linear.tolist() == [1.0, 0.0, 0.0] and pose.angular.tolist() == [0.0, 0.0, 1.0]
    (pose,) = after({"fault": "calibration", "degrees": [90.0, 0.0, 0.0]}, [made("odometry")])
    turned = Rotation.from_quat(pose.orientation)  # first about z, then about the fixed x
    assert turned.apply([1.0, 0.0, 0.0]) == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)


FINITE = st.tuples(*[st.floats(-10.0, 10.0)] * 3)


@given(FINITE, FINITE, FINITE, FINITE)
def test_the_line_of_a_wrench_moves_as_the_points_do(
    xyz: tuple[float, ...], rpy: tuple[float, ...], place: tuple[float, ...], f: tuple[float, ...]
) -> None:
    pose = pose_at(xyz, rpy)
    line = moved(made("wrench", force=f, torque=np.cross(place, f)), pose)
    touched = moved(made("point_cloud", points=[place]), pose)
    assert isinstance(line, Wrench) and isinstance(touched, PointCloud)
    assert line.torque == pytest.approx(np.cross(touched.points[0], line.force), abs=1e-9)


@given(FINITE, FINITE, FINITE, FINITE, FINITE)
def test_the_motion_of_a_body_moves_as_its_points_do(
    xyz: tuple[float, ...],
    rpy: tuple[float, ...],
    place: tuple[float, ...],
    v: tuple[float, ...],
    w: tuple[float, ...],
) -> None:
    pose = pose_at(xyz, rpy)
    twist = moved(made("twist", linear=v, angular=w), pose)
    touched = moved(made("point_cloud", points=[place]), pose)
    assert isinstance(twist, Twist) and isinstance(touched, PointCloud)
    velocity = pose[:3, :3] @ (v + np.cross(w, place))
    there = twist.linear + np.cross(twist.angular, touched.points[0])
    assert there == pytest.approx(velocity, abs=1e-9)


# What holds for every fault


@pytest.mark.parametrize(("kind", "entry"), EVERY_FAULT, ids=str)
@settings(max_examples=25)
@given(stamp=st.floats(-1e6, 1e6), bounds=st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)))
def test_no_fault_changes_a_reading_outside_its_time(
    kind: str, entry: dict[str, Any], stamp: float, bounds: tuple[float, float]
) -> None:
    start, end = sorted(bounds)
    reading = made(kind, stamp)
    came = faults({**entry, "start": start, "end": end}).apply(reading)
    if not start <= stamp <= end:
        (one,) = came
        assert one is reading


@pytest.mark.parametrize(("kind", "entry"), EVERY_FAULT, ids=str)
@pytest.mark.parametrize("sensor", ["other", "switch", "wrench"])
def test_no_fault_changes_a_reading_of_another_sensor(
    kind: str, entry: dict[str, Any], sensor: str
) -> None:
    if kind in ("switch", "wrench"):
        return
    try:
        broken = faults({**entry, "sensor": sensor})
    except ConfigurationError:
        return  # it makes no sense for that kind of reading
    reading = made(kind)
    assert list(broken.apply(reading)) == [reading]


@pytest.mark.parametrize(("kind", "entry"), EVERY_FAULT, ids=str)
def test_a_fault_may_be_of_a_sensor_or_of_a_type_of_reading(
    kind: str, entry: dict[str, Any]
) -> None:
    readings = [made(kind, stamp) for stamp in (0.0, 0.5, 2.0)]
    every = after(entry, readings)
    assert all_same(after({**entry, "sensor": kind}, readings), every)
    assert all_same(after({**entry, "sensor": "it"}, readings), every)
    assert not all_same(readings, every) or entry["fault"] == "stuck"  # they are equal anyway


@pytest.mark.parametrize(("kind", "entry"), EVERY_FAULT_OF_NOTHING, ids=str)
def test_a_fault_of_nothing_changes_nothing(kind: str, entry: dict[str, Any]) -> None:
    readings = [made(kind, stamp) for stamp in (0.0, 0.5, 2.0)]
    if entry["fault"] == "calibration" and kind in (
        "odometry",
        "transform",
        "object_pose",
    ):  # a quaternion is made unit again
        (pose, *_) = after(entry, readings)
        assert pose.orientation == pytest.approx(QUARTER, abs=1e-12)
        assert pose.position.tolist() == [1.0, 2.0, 3.0]
    else:
        assert all_same(after(entry, readings), readings)


@pytest.mark.parametrize(("kind", "entry"), EVERY_FAULT, ids=str)
def test_every_reading_keeps_its_sensor_frame_and_stamp(kind: str, entry: dict[str, Any]) -> None:
    readings = [made(kind, stamp) for stamp in (0.0, 0.5)]
    for one in after(entry, readings):
        assert one.sensor == "it" and one.frame == "base" and one.stamp in (0.0, 0.5)


RANDOM = [{"fault": "dropout", "probability": 0.5}, {"fault": "noise", "amount": 1.0}]
SERIES = [skin(stamp, 1.0, 2.0) for stamp in np.arange(40) / 10]


@pytest.mark.parametrize("fault", RANDOM, ids=str)
def test_one_seed_gives_one_result_and_another_seed_another(fault: dict[str, Any]) -> None:
    assert all_same(after(fault, SERIES, seed=3), after(fault, SERIES, seed=3))
    assert not all_same(after(fault, SERIES, seed=3), after(fault, SERIES, seed=4))


@pytest.mark.parametrize("fault", RANDOM, ids=str)
def test_randomness_outside_neither_enters_nor_notices(fault: dict[str, Any]) -> None:
    before = after(fault, SERIES)
    np.random.seed(123)
    untouched = str(np.random.get_state())
    assert all_same(after(fault, SERIES), before)
    assert str(np.random.get_state()) == untouched


def test_two_faults_and_two_sensors_draw_apart() -> None:
    noise = {"fault": "noise", "amount": 1.0}
    still = [skin(0.0, 0.0, sensor="a"), skin(0.0, 0.0, sensor="b")]
    (one,), (other,) = values(after(noise, still))
    assert one != other
    ((twice,),) = values(list(faults(noise, noise).apply(still[0])))
    assert twice not in (one, 2.0 * one)


MIXED: list[dict[str, Any]] = [
    {"fault": "dropout", "probability": 0.3},
    {"fault": "noise", "amount": 1.0},
    {"fault": "stuck", "start": 1.0, "end": 2.0},
    {"fault": "delay", "seconds": 0.35},
    {"fault": "drift", "amount": 1.0, "start": 2.5},
]


@given(order=st.lists(st.booleans(), min_size=40, max_size=40), ours=st.integers(0, 40))
def test_what_comes_of_a_sensor_does_not_depend_on_the_others(order: list[bool], ours: int) -> None:
    broken, alone = faults(*MIXED), faults(*MIXED)
    heard: list[Reading] = []
    expected: list[Reading] = []
    for ours_comes, reading in zip(order, SERIES, strict=True):
        if ours_comes:
            heard += broken.apply(reading)
            expected += alone.apply(reading)
        else:
            heard += broken.apply(skin(reading.stamp, 5.0, 6.0, sensor="other"))
    last = skin(1e6, 0.0, 0.0)  # lets all go that is delayed
    heard += broken.apply(last)
    expected += alone.apply(last)
    assert all_same([one for one in heard if one.sensor == "skin"], expected)


def test_after_a_reset_everything_happens_again() -> None:
    broken = faults(*MIXED)
    first = [one for reading in SERIES for one in broken.apply(reading)]
    broken.reset()
    assert all_same([one for reading in SERIES for one in broken.apply(reading)], first)


def test_after_a_reset_nothing_of_before_is_remembered() -> None:
    stuck = faults({"fault": "stuck"})
    stuck.apply(skin(0.0, 1.0))
    stuck.reset()
    assert values(list(stuck.apply(skin(0.0, 2.0)))) == [[2.0]]
    late = faults({"fault": "delay", "seconds": 0.5})
    late.apply(skin(9.0, 1.0))
    late.reset()
    assert late.apply(skin(0.0, 2.0)) == []
    assert stamps(late.apply(skin(0.5, 2.0))) == [0.0]


def test_faults_act_in_their_order() -> None:
    bias, zeros = {"fault": "bias", "amount": 1.0}, {"fault": "zeros"}
    assert values(list(faults(bias, zeros).apply(skin(0.0, 5.0)))) == [[0.0]]
    assert values(list(faults(zeros, bias).apply(skin(0.0, 5.0)))) == [[1.0]]


def test_without_faults_a_reading_goes_through_as_it_is() -> None:
    reading = skin(0.0, 1.0)
    (one,) = Faults(()).apply(reading)
    assert one is reading


# What is refused


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ("silent", "faults.0: 'silent' is no fault; write it as {fault: silent, sensor: …}"),
        ({"sensor": "a"}, "faults.0.fault: this field is required; the faults are: bias, calib"),
        ({"fault": "nose"}, "faults.0.fault: unknown fault 'nose'; did you mean 'noise'? The f"),
        (
            {"fault": "silent", "amount": 1.0},
            "faults.0.amount: unknown field; the fields of 'silent' are: end, fault, sensor, start",
        ),
        (
            {"fault": "bias", "amonut": 1.0},
            "faults.0.amonut: unknown field; did you mean 'amount'? The fields of 'bias' are: ",
        ),
        ({"fault": "bias"}, "faults.0.amount: this field is required"),
        ({"fault": "bias", "amount": []}, "faults.0.amount: tuple should have at least 1 item"),
        ({"fault": "bias", "amount": "much"}, "faults.0.amount.0: input should be a valid number"),
        ({"fault": "dropout", "probability": 1.1}, "faults.0.probability: input should be less"),
        ({"fault": "delay", "seconds": -1.0}, "faults.0.seconds: input should be greater"),
        (
            {"fault": "noise", "amount": [1.0, -1.0]},
            "faults.0.amount: a standard deviation is not negative",
        ),
        ({"fault": "calibration"}, "faults.0: give mm, degrees, or both"),
        (
            {"fault": "silent", "start": 2.0, "end": 1.0},
            "faults.0.end: it lies before the start, 2.0 s",
        ),
        (
            {"fault": "stuck", "elements": [1, 1]},
            "faults.0.elements: an element stands here twice",
        ),
        ({"fault": "stuck", "elements": [-1]}, "faults.0.elements.0: input should be greater"),
        ({"fault": "stuck", "elements": []}, "faults.0.elements: tuple should have at least 1"),
    ],
    ids=str,
)
def test_a_wrong_entry_is_refused_in_one_sentence(entry: Any, sentence: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        configured(entry)
    assert str(caught.value).startswith(sentence) and "\n" not in str(caught.value)


SENSELESS = [
    ("tactile_image", "calibration", "change the pose of its frame under 'frames' instead"),
    ("depth_image", "calibration", "change the pose of its frame under 'frames' instead"),
    ("switch", "calibration", "change the pose of its frame under 'frames' instead"),
    ("joint_state", "calibration", "take 'bias' for joints with a wrong zero"),
    ("joint_command", "calibration", "take 'bias' for joints with a wrong zero"),
    ("switch", "bias", "which has no number; take 'zeros' or 'stuck'"),
    ("switch", "drift", "which has no number; take 'zeros' or 'stuck'"),
    ("switch", "noise", "which has no number; take 'zeros' or 'stuck'"),
]


@pytest.mark.parametrize(("kind", "fault", "instead"), SENSELESS)
def test_a_fault_that_makes_no_sense_for_a_reading_says_what_to_do_instead(
    kind: str, fault: str, instead: str
) -> None:
    own = {"mm": [1.0, 2.0, 3.0]} if fault == "calibration" else {"amount": 1.0}
    name = READING_TYPES[kind].__name__
    with pytest.raises(ConfigurationError) as caught:
        one_fault(fault=fault, sensor=kind, **own)
    start = f"faults.0.fault: this fault makes no sense for {name}, "
    assert str(caught.value).startswith(start) and str(caught.value).endswith(instead)
    for sensor in ({}, {"sensor": "it"}):
        with pytest.raises(ConfigurationError) as caught:
            after({"fault": fault, **sensor, **own}, [made(kind)])
        start = f"faults.0.fault: this fault makes no sense for {name} of 'it', "
        assert str(caught.value).startswith(start) and str(caught.value).endswith(instead)


def test_every_other_fault_can_happen_to_every_reading() -> None:
    senseless = {(kind, fault) for kind, fault, _ in SENSELESS}
    happened = {(kind, entry["fault"]) for kind, entry in EVERY_FAULT}
    assert happened == {(kind, fault) for kind in VALUES for fault in FAULTS} - senseless


@pytest.mark.parametrize(
    ("kind", "amount", "sentence"),
    [
        ("wrench", [1.0], "takes 6 numbers: force x, y, z [N], torque x, y, z [N·m]; it was"),
        ("twist", [1.0, 2.0], "takes 6 numbers: linear x, y, z [m/s], angular x, y, z [rad/s]; it"),
        ("odometry", [1.0], "takes 3 or 6 numbers: x, y, z [m], and a turn about x, y, z [rad]; i"),
        ("point_cloud", [1.0, 2.0], "takes 1 or 3 numbers: x, y, z [m]; it was given 2"),
        ("markers", [1.0, 2.0], "takes 1 or 3 numbers: x, y, z [m]; it was given 2"),
        ("depth_image", [1.0, 2.0], "takes 1 number: depth [m]; it was given 2"),
    ],
)
def test_an_amount_that_does_not_fit_is_refused_as_soon_as_it_is_known(
    kind: str, amount: list[float], sentence: str
) -> None:
    name = READING_TYPES[kind].__name__
    with pytest.raises(ConfigurationError) as caught:
        one_fault(fault="bias", sensor=kind, amount=amount)
    assert str(caught.value).startswith(f"faults.0.amount: {name} {sentence}")
    with pytest.raises(ConfigurationError) as caught:
        after({"fault": "bias", "amount": amount}, [made(kind)])
    assert str(caught.value).startswith(f"faults.0.amount: {name} of 'it' {sentence}")


@pytest.mark.parametrize(
    ("kind", "entry", "sentence"),
    [
        (
            "tactile_image",
            {"fault": "bias", "amount": [1.0, 2.0]},
            "faults.0.amount: TactileImage of 'it' takes 1 or 3 numbers; it was given 2",
        ),
        (
            "joint_state",
            {"fault": "bias", "amount": [1.0, 2.0, 3.0]},
            "faults.0.amount: JointState of 'it' takes 1 or 2 or 4 or 6 numbers; it was given 3",
        ),
        (
            "tactile_image",
            {"fault": "zeros", "elements": [0, 3]},
            "faults.0.elements: TactileImage of 'it' has 3, counted from 0; there is no 3",
        ),
        (
            "joint_state",
            {"fault": "noise", "amount": 1.0, "elements": [2]},
            "faults.0.elements: JointState of 'it' has 2, counted from 0; there is no 2",
        ),
        (
            "wrench",
            {"fault": "stuck", "elements": [2]},
            "faults.0.elements: Wrench of 'it' has none; those that do: TactileImage, JointState, "
            "JointCommand",
        ),
    ],
    ids=str,
)
def test_what_does_not_fit_a_reading_is_named_when_it_is_met(
    kind: str, entry: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        after(entry, [made(kind)])
    assert str(caught.value) == sentence


def test_elements_of_what_has_none_are_refused_as_soon_as_they_are_known() -> None:
    with pytest.raises(ConfigurationError, match=r"faults\.0\.elements: Wrench has none; those"):
        one_fault(fault="zeros", sensor="wrench", elements=[0])


def test_velocities_that_a_robot_does_not_tell_cannot_be_changed() -> None:
    with pytest.raises(ConfigurationError, match="'it' has no velocities to change"):
        biased("joint_state", [1.0, 1.0, 1.0, 1.0], velocities=None)


def test_a_taxel_that_a_shorter_reading_had_not_is_named() -> None:
    with pytest.raises(ConfigurationError, match="has 1, counted from 0; there is no 2"):
        after({"fault": "stuck", "elements": [2]}, [skin(0.0, 1.0), skin(0.1, 1.0, 2.0, 3.0)][:1])
    with pytest.raises(ConfigurationError, match="has 1, counted from 0; there is no 2"):
        repeated(skin(0.1, 1.0, 2.0, 3.0), skin(0.0, 1.0), (2,))


class Whisker(Reading):
    """A reading of somebody else's plug-in."""


@pytest.mark.parametrize("name", ["zeros", "bias", "calibration"])
def test_of_a_strangers_reading_the_values_cannot_be_changed(name: str) -> None:
    fields: dict[str, dict[str, Any]] = {
        "zeros": {},
        "bias": {"amount": 1.0},
        "calibration": {"mm": [1.0, 0.0, 0.0]},
    }
    with pytest.raises(ConfigurationError, match="does not know what to change in Whisker"):
        after({"fault": name, **fields[name]}, [Whisker(stamp=0.0, frame="base")])


def test_a_strangers_reading_can_be_stuck_lost_and_late() -> None:
    readings = [Whisker(stamp=stamp, frame="base") for stamp in (0.0, 0.5)]
    assert stamps(after({"fault": "stuck"}, readings)) == [0.0, 0.5]
    assert after({"fault": "silent"}, readings) == []
    assert stamps(after({"fault": "delay", "seconds": 0.5}, readings)) == [0.0]


@pytest.mark.parametrize("seed", [-1, "it"])
def test_a_seed_is_a_number_from_0(seed: Any) -> None:
    with pytest.raises(ConfigurationError, match="seed: input should be"):
        PipelineConfig(seed=seed)


# Files and pages


def test_faults_are_read_from_a_file_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text("faults:\n  - {fault: silent, sensor: a}\n  - {fault: bias, amount: 2}\n")
    silent, bias = read_faults(path)
    assert silent == one_fault(fault="silent", sensor="a")
    assert bias == one_fault(fault="bias", amount=[2.0])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("faults: [{fault: nose}]", "faults.0.fault: unknown fault 'nose'; did you mean 'noise'?"),
        ("fault: []", "fault: unknown field; did you mean 'faults'?"),
        ("faults:", "faults: input should be a valid tuple, not None"),
    ],
)
def test_a_wrong_file_is_named_with_what_is_wrong(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        read_faults(path)
    assert str(caught.value).startswith(f"{path}: {sentence}")


def test_the_example_of_the_page_is_a_configuration() -> None:
    (block,) = re.findall(r"^```yaml\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    example = yaml.safe_load(block)
    config = PipelineConfig(**example)
    assert len(config.faults) == len(example["faults"]) == 5


def test_the_page_names_every_fault_every_field_and_every_type() -> None:
    named = set(re.findall(r"`(\w+)`", PAGE.read_text()))
    fields = {field for model in FAULTS.values() for field in model.model_fields}
    assert not (set(FAULTS) | fields | set(READING_TYPES)) - named


def test_every_fault_goes_by_its_name_and_says_what_its_fields_are() -> None:
    for name, model in FAULTS.items():
        assert model.model_fields["fault"].default == name
        fields = (field for key, field in model.model_fields.items() if key != "fault")
        assert all(field.description for field in fields)


# In a pipeline

FRONT = (0.1025, 0.0025, 0.0025)
LEFT = (0.0025, 0.1025, 0.0025)


def pipeline(*entries: dict[str, Any], **config: Any) -> Pipeline:
    generators = {"eye": {"type": "echo"}, "wrist": {"type": "feeler"}}
    return Pipeline(configured(*entries, generators=generators, **config))


def readings(seconds: float) -> list[Reading]:
    series: list[Reading] = []
    for stamp in np.arange(round(100 * seconds)) / 100:
        series.append(point(stamp, *LEFT, sensor="eye"))
        series.append(wrench(stamp, *FRONT, sensor="wrist"))
    return series


def contacts_of(step: Step, source: str) -> list[tuple[bytes, float, float]]:
    return [
        (contact.position.tobytes(), contact.likelihood, contact.stamp)
        for contact in step.fusion.contacts
        if contact.shares[source] > 0.0
    ]


@pytest.mark.parametrize(
    "entry", [entry for kind, entry in EVERY_FAULT if kind == "wrench"], ids=str
)
def test_a_fault_of_one_sensor_leaves_the_contacts_of_the_other_as_they_were(
    monkeypatch: pytest.MonkeyPatch, entry: dict[str, Any]
) -> None:
    offer_toys(monkeypatch)
    healthy = list(pipeline().run(readings(0.5)))
    broken = list(pipeline({**entry, "sensor": "wrist", "start": 0.2}).run(readings(0.5)))
    assert [step.stamp for step in broken] == [step.stamp for step in healthy]
    assert contacts_of(healthy[-1], "eye")
    for step, same_step in zip(broken, healthy, strict=True):
        assert contacts_of(step, "eye") == contacts_of(same_step, "eye")


def test_a_pipeline_feels_the_fault_and_after_a_reset_the_same_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    offer_toys(monkeypatch)
    pipe = pipeline({"fault": "noise", "sensor": "wrist", "amount": [0.02] * 6}, seed=5)
    first = [contacts_of(step, "wrist") for step in pipe.run(readings(0.1))]
    healthy = [contacts_of(step, "wrist") for step in pipeline().run(readings(0.1))]
    assert first != healthy
    pipe.reset()
    assert [contacts_of(step, "wrist") for step in pipe.run(readings(0.1))] == first


def test_a_seed_of_the_pipeline_is_that_of_its_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_toys(monkeypatch)
    noise = {"fault": "noise", "sensor": "wrist", "amount": [0.02] * 6}
    told = [
        [contacts_of(step, "wrist") for step in pipeline(noise, seed=seed).run(readings(0.1))]
        for seed in (1, 1, 2)
    ]
    assert told[0] == told[1] != told[2]


def test_a_silent_sensor_gives_no_clouds(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_toys(monkeypatch)
    *_, last = pipeline({"fault": "silent", "sensor": "wrist", "start": 0.1}).run(readings(0.3))
    accepted = {name: one.accepted for name, one in last.fusion.report.sources.items()}
    assert accepted == {"eye": 30, "wrist": 10}


def test_the_robots_own_state_suffers_too() -> None:
    pipe = Pipeline(
        configured(
            {"fault": "bias", "sensor": "joint_state", "amount": 0.5, "elements": [1]},
            {"fault": "stuck", "sensor": "odometry"},
        )
    )
    odometry = [made("odometry", t, frame="odom", position=[t, 0.0, 0.0]) for t in (0.0, 1.0)]
    list(pipe.run([made("joint_state"), *odometry]))
    state = pipe.state(1.0)
    assert state.joints is not None and state.joints.positions.tolist() == [1.0, 2.5]
    assert state.base_pose is not None and state.base_pose[0, 3] == 0.0
    pipe = Pipeline(configured({"fault": "silent", "sensor": "odometry"}))
    list(pipe.run([made("odometry", frame="odom")]))
    assert pipe.state(0.0).base_pose is None


def test_a_cycle_on_a_sensor_steps_when_its_readings_arrive(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    offer_toys(monkeypatch)
    series = [
        wrench(0.0, *FRONT, sensor="wrist"),
        point(0.1, *LEFT),
        wrench(0.2, *FRONT, sensor="wrist"),
        point(0.3, *LEFT),
    ]

    def stepped(**entry: Any) -> list[float]:
        pipe = pipeline({"sensor": "wrist", **entry}, cycle={"on": "wrist"})
        return [step.stamp for step in pipe.run(series)]

    assert stepped(fault="zeros") == [0.0, 0.2]
    assert stepped(fault="silent", start=0.1) == [0.0]
    assert stepped(fault="delay", seconds=0.05) == [0.1, 0.3]


def test_a_fault_that_makes_no_sense_stops_the_pipeline(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_toys(monkeypatch)
    pipe = pipeline({"fault": "calibration", "mm": [1.0, 0.0, 0.0]})
    with pytest.raises(ConfigurationError, match=r"faults\.0\.fault: .* Switch of 'bumper', which"):
        list(pipe.run([Switch(stamp=0.0, frame="base", sensor="bumper", closed=True)]))


def test_a_fault_that_leaves_no_reading_names_itself() -> None:
    fault = Bias(sensor="skin", amount=(1e31,))
    reading = TactileImage(stamp=0.0, frame="base", sensor="skin", values=np.zeros(1))
    with pytest.raises(ConfigurationError, match=r"^faults\.0: what it makes is no reading: "):
        Faults([fault]).apply(reading)


def test_a_fault_of_every_sensor_misses_none_where_nothing_came() -> None:
    assert list(unmet([Silent()], ())) == []
    assert len(list(unmet([Silent(sensor="skin")], ()))) == 1
