"""Joints and odometry between their readings."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactfusion.history import LENGTH, History
from contactfusion.readings import JointState, Odometry, Twist, Wrench


def joints(stamp: float, *angles: float, names: tuple[str, ...] = ("a", "b")) -> JointState:
    return JointState(
        stamp=stamp,
        frame="base",
        names=names,
        positions=np.array(angles),
        velocities=np.full(len(angles), stamp),
    )


def odometry(stamp: float, x: float, turn: float = 0.0, child: str = "base") -> Odometry:
    return Odometry(
        stamp=stamp,
        frame="odom",
        child_frame=child,
        position=np.array([x, 0.0, 0.0]),
        orientation=Rotation.from_rotvec([0.0, 0.0, turn]).as_quat(),
    )


def twist(stamp: float, ahead: float, turn: float = 0.0, frame: str = "base") -> Twist:
    return Twist(
        stamp=stamp,
        frame=frame,
        linear=np.array([ahead, 0.0, 0.0]),
        angular=np.array([0.0, 0.0, turn]),
    )


def history(*readings: JointState | Odometry | Twist) -> History:
    remembered = History()
    for reading in readings:
        remembered.add(reading)
    return remembered


def angles(remembered: History, stamp: float) -> list[float]:
    state = remembered.joints(stamp)
    assert state is not None
    return [round(float(angle), 12) for angle in state.positions]


def pose(remembered: History, stamp: float) -> tuple[str, str, float, float]:
    base = remembered.base_pose(stamp)
    assert base is not None
    parent, child, transform = base
    turn = np.arctan2(transform[1, 0], transform[0, 0])
    return parent, child, float(transform[0, 3]), float(turn)


def test_nothing_is_known_before_the_first_reading() -> None:
    assert History().joints(0.0) is None
    assert History().base_pose(0.0) is None


def test_readings_of_other_things_are_not_remembered() -> None:
    remembered = History()
    remembered.add(Wrench(stamp=0.0, frame="base", force=np.zeros(3), torque=np.zeros(3)))
    assert remembered.joints(0.0) is None and remembered.base_pose(0.0) is None


def test_joint_positions_are_interpolated_and_the_rest_is_that_of_the_nearer_reading() -> None:
    remembered = history(joints(0.0, 0.0, 10.0), joints(1.0, 1.0, 20.0), joints(2.0, 9.0, 9.0))
    assert angles(remembered, 0.25) == [0.25, 12.5]
    for stamp, nearer in ((0.25, 0.0), (0.75, 1.0)):
        state = remembered.joints(stamp)
        assert state is not None and state.velocities is not None
        assert state.velocities.tolist() == [nearer, nearer]


def test_the_base_is_interpolated_in_place_and_turn() -> None:
    remembered = history(odometry(0.0, 0.0), odometry(1.0, 4.0, turn=1.0))
    parent, child, x, turn = pose(remembered, 0.25)
    assert (parent, child) == ("odom", "base")
    assert [x, turn] == pytest.approx([1.0, 0.25])


def test_a_turn_takes_the_short_way_round() -> None:
    remembered = history(odometry(0.0, 0.0, turn=3.0), odometry(1.0, 0.0, turn=-3.0))
    assert abs(pose(remembered, 0.5)[3]) == pytest.approx(np.pi)


def test_the_stamp_tells_since_when_joints_are_silent() -> None:
    remembered = history(joints(0.0, 0.0, 0.0), joints(1.0, 1.0, 1.0))
    remembered.add(joints(4.0, 9.0, names=("c",)))
    for stamp, told in ((0.5, 0.5), (1.0, 1.0), (5.0, 1.0)):
        state = remembered.joints(stamp)
        assert state is not None and state.stamp == told


@pytest.mark.parametrize("stamp", [-1.0, 0.0, 1.0, 5.0])
def test_nothing_is_extrapolated(stamp: float) -> None:
    remembered = history(joints(0.0, 0.0, 0.0), joints(1.0, 1.0, 1.0))
    remembered.add(odometry(0.0, 0.0))
    remembered.add(odometry(1.0, 1.0))
    end = min(max(stamp, 0.0), 1.0)
    assert angles(remembered, stamp) == [end, end]
    assert pose(remembered, stamp)[2] == pytest.approx(end)


def test_where_odometry_falls_silent_twists_go_on() -> None:
    remembered = history(odometry(0.0, 1.0), twist(0.0, 9.0), twist(0.1, 2.0), twist(0.2, 1.0))
    assert pose(remembered, 0.1)[2:] == pytest.approx((1.2, 0.0))
    assert pose(remembered, 0.3)[2:] == pytest.approx((1.3, 0.0))


def test_twists_go_on_in_the_direction_in_which_the_base_has_turned() -> None:
    steps = [twist(0.01 * step, 1.0, np.pi / 2.0) for step in range(1, 101)]
    remembered = history(odometry(0.0, 0.0), *steps)
    base = remembered.base_pose(1.0)
    assert base is not None
    assert base[2][:2, 3] == pytest.approx([2.0 / np.pi, 2.0 / np.pi], abs=1e-4)
    assert pose(remembered, 1.0)[3] == pytest.approx(np.pi / 2.0)


def test_odometry_that_comes_again_counts_alone() -> None:
    remembered = history(odometry(0.0, 0.0), twist(0.1, 5.0), odometry(0.2, 0.3), twist(0.2, 5.0))
    assert pose(remembered, 0.2)[2] == pytest.approx(0.3)


def test_twists_of_a_long_silence_are_forgotten_from_the_oldest_on() -> None:
    remembered = history(odometry(0.0, 0.0))
    for step in range(1, LENGTH + 101):
        remembered.add(twist(0.01 * step, 1.0))
    assert pose(remembered, 100.0)[2] == pytest.approx(0.01 * (LENGTH + 100))


def test_twists_of_another_frame_move_nothing() -> None:
    remembered = history(odometry(0.0, 0.0), twist(0.1, 5.0, frame="gripper"))
    assert pose(remembered, 0.1)[2] == pytest.approx(0.0)


def test_an_older_reading_than_the_newest_is_ignored() -> None:
    remembered = history(joints(0.0, 0.0, 0.0), joints(1.0, 1.0, 1.0), joints(0.5, 7.0, 7.0))
    assert angles(remembered, 0.5) == [0.5, 0.5]


def test_of_two_readings_of_one_stamp_the_later_counts() -> None:
    assert angles(history(joints(1.0, 0.0, 0.0), joints(1.0, 5.0, 5.0)), 1.0) == [5.0, 5.0]


def test_joints_of_an_arm_and_of_its_hand_are_put_together() -> None:
    arm, hand = ("a", "b"), ("c",)
    remembered = history(
        joints(0.0, 0.0, 2.0, names=arm),
        joints(0.5, 7.0, names=hand),
        joints(1.0, 1.0, 4.0, names=arm),
    )
    state = remembered.joints(0.5)
    assert state is not None and state.names == ("a", "b", "c")
    assert state.positions.tolist() == [0.5, 3.0, 7.0]
    assert state.velocities is not None and len(state.velocities) == 3


def test_a_joint_that_several_readings_name_is_that_of_the_first() -> None:
    remembered = history(joints(0.0, 1.0, 2.0), joints(0.0, 9.0, 3.0, names=("b", "c")))
    state = remembered.joints(0.0)
    assert state is not None
    assert dict(zip(state.names, state.positions, strict=True)) == {"a": 1.0, "b": 2.0, "c": 3.0}


def test_what_one_of_several_readings_does_not_tell_is_left_out() -> None:
    bare = JointState(stamp=0.0, frame="base", names=("c",), positions=np.zeros(1))
    state = history(joints(0.0, 1.0, 2.0), bare).joints(0.0)
    assert state is not None and state.velocities is None and state.efforts is None


def test_different_bases_are_never_mixed() -> None:
    remembered = history(odometry(0.0, 1.0), odometry(1.0, 2.0, child="cart"))
    assert pose(remembered, 0.4)[:3] == ("odom", "base", 1.0)
    assert pose(remembered, 0.6)[:3] == ("odom", "cart", 2.0)


def test_only_the_newest_readings_are_remembered() -> None:
    remembered = history(*(joints(float(stamp), stamp, stamp) for stamp in range(LENGTH + 10)))
    assert angles(remembered, 0.0) == [10.0, 10.0]


def test_after_clearing_nothing_is_known() -> None:
    remembered = history(joints(0.0, 0.0, 0.0))
    remembered.add(odometry(0.0, 0.0))
    remembered.clear()
    assert remembered.joints(0.0) is None and remembered.base_pose(0.0) is None
