"""Joints, odometry and frames between their readings."""

import pickle
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from contactfusion.errors import FrameError, InvalidReadingError
from contactfusion.frames import FrameConfig, FrameTree
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import CycleConfig, PipelineConfig
from contactfusion.readings import JointState, Odometry, Transform, Twist, Wrench
from contactfusion.robot_state import MOST_SETS, StateBuffer
from contactfusion.transform_buffer import LENGTH, MOST_FRAMES, TransformBuffer

STRAIGHT = (0.0, 0.0, 0.0, 1.0)
quaternions = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


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


def history(*readings: JointState | Odometry | Twist) -> StateBuffer:
    remembered = StateBuffer()
    for reading in readings:
        remembered.add(reading)
    return remembered


def angles(remembered: StateBuffer, stamp: float) -> list[float]:
    state = remembered.joints(stamp)
    assert state is not None
    return [round(float(angle), 12) for angle in state.positions]


def pose(remembered: StateBuffer, stamp: float) -> tuple[str, str, float, float]:
    base = remembered.base_pose(stamp)
    assert base is not None
    parent, child, transform = base
    turn = np.arctan2(transform[1, 0], transform[0, 0])
    return parent, child, float(transform[0, 3]), float(turn)


def test_nothing_is_known_before_the_first_reading() -> None:
    assert StateBuffer().joints(0.0) is None
    assert StateBuffer().base_pose(0.0) is None


def test_readings_of_other_things_are_not_remembered() -> None:
    remembered = StateBuffer()
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


def test_a_joint_that_turns_past_half_a_turn_is_not_in_between() -> None:
    remembered = history(joints(0.0, 3.1, 0.0), joints(1.0, -3.1, 0.5))
    assert angles(remembered, 0.4) == [3.1, 0.2]
    assert angles(remembered, 0.6) == [-3.1, 0.3]


def test_a_joint_that_several_readings_name_is_that_of_the_newest() -> None:
    slow, fast = joints(0.0, 1.0, 2.0), joints(0.1, 9.0, 3.0, names=("b", "c"))
    state = history(slow, fast).joints(0.2)
    assert state is not None
    assert dict(zip(state.names, state.positions, strict=True)) == {"a": 1.0, "b": 9.0, "c": 3.0}


def test_a_joint_that_several_readings_name_at_once_is_that_of_the_first() -> None:
    remembered = history(joints(0.0, 1.0, 2.0), joints(0.0, 9.0, 3.0, names=("b", "c")))
    state = remembered.joints(0.0)
    assert state is not None
    assert dict(zip(state.names, state.positions, strict=True)) == {"a": 1.0, "b": 2.0, "c": 3.0}


def test_a_set_of_joints_that_a_newer_one_holds_whole_counts_no_more() -> None:
    early = joints(0.0, 1.0, 2.0)
    remembered = history(early, joints(10.0, 3.0, 4.0, 5.0, names=("a", "b", "grip")))
    state = remembered.joints(10.0)
    assert state is not None and state.stamp == 10.0 and state.velocities is not None
    assert dict(zip(state.names, state.positions, strict=True)) == {"a": 3.0, "b": 4.0, "grip": 5.0}


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


def transform(
    stamp: float,
    x: float = 0.0,
    turn: tuple[float, ...] = STRAIGHT,
    frame: str = "map",
    child: str = "base",
    static: bool = False,
) -> Transform:
    return Transform(
        stamp=stamp,
        frame=frame,
        child_frame=child,
        position=np.array([x, 0.0, 0.0]),
        orientation=np.array(turn) / np.linalg.norm(turn),
        static=static,
    )


def tree(known: TransformBuffer, stamp: float) -> FrameTree:
    told = known.at(stamp)
    assert told is not None
    return FrameTree({}).under(told)


def known(*transforms: Transform) -> TransformBuffer:
    transforms_ = TransformBuffer()
    for one in transforms:
        transforms_.add(one)
    return transforms_


def test_between_two_transforms_a_frame_moves_evenly() -> None:
    pose = tree(known(transform(1.0, 0.0), transform(2.0, 4.0)), 1.25).pose("map", of="base")
    assert pose[:3, 3] == pytest.approx([1.0, 0.0, 0.0])


@given(quaternions, quaternions, st.floats(0.0, 1.0))
def test_it_turns_by_the_shortest_arc(one: list[float], other: list[float], part: float) -> None:
    moving = known(transform(0.0, turn=tuple(one)), transform(1.0, turn=tuple(other)))
    pose = tree(moving, part).pose("map", of="base")
    expected = Slerp([0.0, 1.0], Rotation.from_quat([one, other]))(part)
    apart = (Rotation.from_matrix(pose[:3, :3]) * expected.inv()).magnitude()
    half_turn = (Rotation.from_quat(one) * Rotation.from_quat(other).inv()).magnitude()
    if half_turn < np.pi - 1e-3:  # at half a turn both arcs are as short
        assert apart < 1e-4


@pytest.mark.parametrize("stamp", [0.999, 2.001])
def test_outside_its_time_a_transform_is_an_error_that_says_what_there_is(stamp: float) -> None:
    frames = tree(known(transform(1.0), transform(2.0)), stamp)
    sentence = rf"'base' in 'map' is not known at {stamp} s: there is one from 1.000 to 2.000 s"
    with pytest.raises(FrameError, match=sentence):
        frames.pose("map", of="base")


@pytest.mark.parametrize("stamp", [0.0, 1.0, 1.7, 2.0, 40.0, 50.0])
def test_to_another_process_goes_only_what_counts_at_the_stamp(stamp: float) -> None:
    told = known(*(transform(float(n + 1), float(n * n)) for n in range(40)))
    told.add(transform(0.0, 3.0, child="eye", frame="base", static=True))
    here = told.at(stamp)
    packed = pickle.dumps(here)
    assert len(packed) < 3000
    there = pickle.loads(packed)
    for child in ("base", "eye"):
        try:
            expected = here.parent_of(child) if here else None
        except FrameError as error:
            with pytest.raises(FrameError, match=re.escape(str(error))):
                there.parent_of(child)
        else:
            assert expected is not None
            frame, pose = there.parent_of(child)
            assert frame == expected[0]
            np.testing.assert_array_equal(pose, expected[1])


def test_a_static_transform_holds_at_all_times_and_the_newest_counts() -> None:
    fixed = known(transform(5.0, 1.0, static=True), transform(5.0, 2.0, static=True))
    assert tree(fixed, -100.0).pose("map", of="base")[0, 3] == 2.0


def test_the_nearest_pose_is_that_of_the_first_or_the_last_transform() -> None:
    told = known(transform(1.0, x=1.0), transform(2.0, x=3.0))
    for stamp, x in ((0.0, 1.0), (1.0, 1.0), (1.5, 2.0), (2.0, 3.0), (9.0, 3.0)):
        pose = tree(told, stamp).nearest().pose("map", of="base")
        assert pose[0, 3] == pytest.approx(x)
    with pytest.raises(FrameError, match="is not known at 0.000 s"):
        tree(told, 0.0).pose("map", of="base")
    assert FrameTree({}).nearest().frames == frozenset()


def test_a_frame_with_a_new_parent_hangs_under_that_one_only() -> None:
    moved = known(transform(0.0), transform(1.0, 3.0, frame="table"))
    frames = tree(moved, 1.0)
    assert frames.pose("table", of="base")[0, 3] == 3.0
    with pytest.raises(FrameError, match="unknown frame 'map'"):
        frames.pose("map", of="base")


def test_a_frame_that_two_publishers_place_is_named() -> None:
    handed_over = known(transform(0.0), transform(1.0, frame="table"))
    assert handed_over.disputed == ""
    by_turns = known(transform(0.0), transform(1.0, frame="table"), transform(2.0))
    assert by_turns.disputed == (
        "the frame 'base' is placed in 'table' and in 'map', by turns: the last one counts"
    )
    by_turns.clear()
    assert by_turns.disputed == ""


def test_transforms_that_form_a_circle_are_named() -> None:
    circle = known(transform(0.0), transform(0.0, frame="base", child="map"))
    with pytest.raises(FrameError, match="the frames form a circle: map -> base -> map"):
        tree(circle, 0.0).pose("base", of="map")


def test_old_transforms_are_forgotten_so_that_memory_stays() -> None:
    many = known(*(transform(0.01 * index) for index in range(2 * LENGTH + 5)))
    with pytest.raises(FrameError, match="is not known at 0.000 s"):
        tree(many, 0.0).pose("map", of="base")
    assert tree(many, 0.01 * LENGTH).pose("map", of="base") is not None


def test_of_ever_new_frames_those_that_moved_last_are_remembered() -> None:
    buffer = TransformBuffer()
    buffer.add(transform(0.0, 5.0, frame="base", child="fixed", static=True))
    newest = MOST_FRAMES + 49
    for number in range(newest + 1):
        buffer.add(transform(0.1 * number, 1.0))
        buffer.add(transform(0.1 * number, 2.0, child=f"object {number}"))
    frames = buffer.at(0.1 * newest)
    assert frames is not None and len(frames.frames) == MOST_FRAMES + 1  # and the map
    assert {"base", "fixed", f"object {newest}"} <= frames.frames
    assert "object 3" not in frames.frames


def test_of_ever_new_sets_of_joints_those_that_moved_last_are_remembered() -> None:
    buffer = StateBuffer()
    newest = MOST_SETS + 49
    for number in range(newest + 1):
        buffer.add(joints(0.1 * number, 1.0, 2.0))
        buffer.add(joints(0.1 * number, 3.0, names=(f"joint {number}",)))
    known = buffer.joints(0.1 * newest)
    assert known is not None and len(known.names) == MOST_SETS + 1
    assert {"a", "b", f"joint {newest}"} <= {*known.names}


def test_one_that_comes_late_changes_nothing() -> None:
    late = known(transform(0.0, 0.0), transform(1.0, 1.0), transform(0.5, 9.0))
    assert tree(late, 0.5).pose("map", of="base")[0, 3] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("child", "sentence"),
    [("", "needs the name of its child frame"), ("map", "gives the pose of 'map' in itself")],
)
def test_a_transform_of_nothing_or_of_itself_is_no_reading(child: str, sentence: str) -> None:
    with pytest.raises(InvalidReadingError, match=sentence):
        transform(0.0, child=child)


def wrench(stamp: float) -> Wrench:
    return Wrench(
        stamp=stamp,
        frame="tool",
        sensor="wrist",
        force=np.array([0.0, 0.0, 5.0]),
        torque=np.zeros(3),
    )


def test_configured_frames_go_before_odometry_and_odometry_before_transforms() -> None:
    tool = FrameConfig(parent="base", xyz=(0.0, 0.0, 1.0))
    pipe = Pipeline(PipelineConfig(frames={"tool": tool}))
    pipe.receive(transform(0.0, 5.0, child="tool", frame="base"))
    pipe.receive(transform(0.0, 7.0, child="base", frame="odom"))
    pipe.receive(
        Odometry(
            stamp=0.0,
            frame="odom",
            child_frame="base",
            position=np.array([1.0, 0.0, 0.0]),
            orientation=np.array(STRAIGHT),
        )
    )
    frames = pipe.state(0.0).frames
    assert frames.pose("base", of="tool")[:3, 3] == pytest.approx([0.0, 0.0, 1.0])
    assert frames.pose("odom", of="base")[0, 3] == 1.0


def test_transforms_move_no_clock() -> None:
    config = PipelineConfig(cycle=CycleConfig(every=0.1))
    readings = [transform(0.0), wrench(0.0), transform(5.0), wrench(0.25)]
    assert [step.stamp for step in Pipeline(config).run(readings)] == pytest.approx([0.1, 0.2, 0.3])


def test_odometry_of_a_frame_in_itself_is_refused() -> None:
    with pytest.raises(InvalidReadingError, match="gives the pose of 'odom' in itself"):
        odometry(0.0, 1.0, child="odom")


def test_odometry_that_closes_a_circle_is_left_out_with_the_reason() -> None:
    frames = {"odom": FrameConfig(parent="base")}
    pipeline = Pipeline(PipelineConfig(frames=frames, cycle=CycleConfig(every=0.1)))
    pipeline.receive(odometry(0.0, 1.0))
    state = pipeline.state(0.0)
    assert state.base_pose is None
    assert state.unplaced.startswith("the odometry of 'base' is left out: ")
    assert pipeline.step(0.0).fusion.contacts == ()
    pipeline.reset()
    assert pipeline.state(0.0).unplaced == ""
