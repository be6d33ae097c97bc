"""Trees of frames."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from contactfusion.errors import FrameError
from contactfusion.frames import (
    FrameTree,
    Parent,
    Pose,
    planar_point,
    planar_pose,
    planar_rotation,
    planar_turned,
    planar_turned_back,
    points_in,
    pose_of,
    vectors_in,
    yaw_quaternion,
)
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.pipeline_config import PipelineConfig

Parents = dict[str, tuple[str, Pose]]
NUMBERS = st.floats(-3.0, 3.0)
POSES = st.builds(
    lambda shift, turn: pose_of(shift, Rotation.from_rotvec(turn).as_matrix()),
    st.tuples(NUMBERS, NUMBERS, NUMBERS),
    st.tuples(NUMBERS, NUMBERS, NUMBERS),
)


def shift(x: float, y: float = 0.0, z: float = 0.0) -> Pose:
    return pose_of([x, y, z])


def arm() -> FrameTree:
    return FrameTree(
        {
            "base": ("world", shift(1.0)),
            "hand": ("base", shift(0.0, 1.0)),
            "eye": ("base", shift(5)),
        }
    )


def test_a_pose_takes_coordinates_of_the_one_frame_to_the_other() -> None:
    turned = pose_of([1, 0, 0], Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix())
    tree = FrameTree({"hand": ("base", turned)})
    pose = tree.pose("base", of="hand")
    assert points_in(pose, np.array([[1.0, 0.0, 0.0]])) == pytest.approx(np.array([[1, 1, 0]]))
    assert vectors_in(pose, np.array([[1.0, 0.0, 0.0]])) == pytest.approx(np.array([[0, 1, 0]]))


def test_poses_add_up_along_the_chain_and_across_branches() -> None:
    assert arm().pose("world", of="hand")[:3, 3] == pytest.approx([1.0, 1.0, 0.0])
    assert arm().pose("eye", of="hand")[:3, 3] == pytest.approx([-5.0, 1.0, 0.0])


def test_a_frame_in_itself_is_the_identity_even_when_nobody_knows_it() -> None:
    assert np.array_equal(arm().pose("moon", of="moon"), np.eye(4))


@settings(max_examples=25, deadline=None)
@given(POSES, POSES)
def test_there_and_back_is_the_identity(first: Pose, second: Pose) -> None:
    tree = FrameTree({"a": ("root", first), "b": ("root", second)})
    both = tree.pose("a", of="b") @ tree.pose("b", of="a")
    assert both == pytest.approx(np.eye(4), abs=1e-12)


def test_points_that_nobody_may_change_can_be_moved() -> None:
    points = np.zeros((2, 3))
    points.flags.writeable = False
    assert points_in(shift(1.0), points)[:, 0].tolist() == [1.0, 1.0]
    assert points_in(shift(1.0), np.zeros((0, 3))).shape == (0, 3)


def test_an_unknown_frame_is_named_with_the_nearest_that_exists() -> None:
    with pytest.raises(FrameError, match=r"unknown frame 'hnd': did you mean 'hand'\?.*base, eye"):
        arm().pose("base", of="hnd")
    with pytest.raises(FrameError, match="unknown frame 'bas'"):
        arm().pose("bas", of="hand")


def test_without_any_frames_it_is_the_frame_that_came_which_is_unknown() -> None:
    with pytest.raises(FrameError, match="unknown frame 'hand': there are no frames; .* in 'base'"):
        FrameTree({}).pose("base", of="hand")


@pytest.mark.parametrize(
    ("integrator", "where"),
    [({}, "default of `integrator.frame`"), ({"frame": "base"}, "`integrator.frame`")],
)
def test_an_unknown_frame_of_the_space_is_named_with_where_it_comes_from(
    integrator: dict[str, Any], where: str
) -> None:
    space = f"the integrator's frame 'base' ({where})"
    alone = PipelineConfig(integrator=IntegratorConfig(**integrator)).frame_tree()
    with pytest.raises(FrameError) as raised:
        alone.pose("base", of="hand")
    assert str(raised.value) == (
        f"unknown frame 'hand': there are no frames; `frames` or a `robot` can place it in {space}"
    )
    apart = alone.extended({"hand": ("bse", shift(1))})
    for frame, of in (("base", "hand"), ("hand", "base")):
        with pytest.raises(FrameError) as raised:
            apart.nearest().pose(frame, of=of)
        assert str(raised.value) == (
            f"nothing joins 'hand' to {space}, which is unknown: did you mean 'bse'? "
            "The frames are: bse, hand; name a known frame there, such as 'bse', or place it by "
            "`frames`"
        )


def test_frames_of_two_trees_are_not_joined() -> None:
    tree = FrameTree({"hand": ("base", shift(1)), "cup": ("table", shift(1))})
    with pytest.raises(FrameError, match="'cup' hangs under 'table', 'hand' under 'base'"):
        tree.pose("hand", of="cup")


@pytest.mark.parametrize(
    "circle",
    [{"a": ("a", shift(0))}, {"a": ("b", shift(0)), "b": ("a", shift(0))}],
)
def test_a_circle_of_frames_is_refused(circle: Parents) -> None:
    with pytest.raises(FrameError, match="circle: a -> "):
        FrameTree(circle)


def test_an_extended_tree_leaves_the_old_one_as_it_was() -> None:
    tree = arm()
    before = tree.pose("world", of="hand")
    moved = tree.extended({"base": ("world", shift(9.0)), "cup": ("hand", shift(0.0))})
    assert moved.pose("world", of="cup")[:3, 3] == pytest.approx([9.0, 1.0, 0.0])
    assert np.array_equal(tree.pose("world", of="hand"), before)
    assert tree.frames == {"world", "base", "hand", "eye"}
    assert moved.frames == tree.frames | {"cup"}


def test_a_pose_cannot_be_changed_by_who_asked_for_it() -> None:
    with pytest.raises(ValueError, match="read-only"):
        arm().pose("base", of="hand")[0, 3] = 9.0


class Lost:
    """Frames of which one has a parent whose pose is not known at this time."""

    frames = frozenset({"map", "robot"})

    def parent_of(self, frame: str) -> Parent | None:
        if frame == "robot":
            raise FrameError("the transform of 'robot' in 'map' is not known at 1 s")
        return None

    def nearest(self) -> "Lost":
        return self


def test_what_lies_above_the_first_shared_frame_need_not_be_known() -> None:
    parents = {"hand": ("robot", pose_of((1, 0, 0))), "eye": ("robot", pose_of((0, 0, 2)))}
    tree = FrameTree(parents, Lost())
    np.testing.assert_array_equal(tree.pose("eye", of="hand")[:3, 3], (1, 0, -2))
    np.testing.assert_array_equal(tree.pose("robot", of="hand")[:3, 3], (1, 0, 0))
    with pytest.raises(FrameError, match="'robot' in 'map' is not known"):
        tree.pose("map", of="hand")
    with pytest.raises(FrameError, match="'robot' in 'map' is not known"):
        tree.root("eye")
    assert tree.ancestors("eye") == ("eye", "robot")


@given(st.tuples(NUMBERS, NUMBERS, NUMBERS), st.tuples(NUMBERS, NUMBERS))
def test_planar_poses_are_poses_that_stand_upright(
    planar: tuple[float, float, float], point: tuple[float, float]
) -> None:
    (_, _, yaw), pose = planar, planar_pose(planar, 0.4)
    raised = np.array([[*point, 0.0]])
    assert planar_point(planar, point) == pytest.approx(points_in(pose, raised)[0, :2])
    turned = planar_turned(point, yaw)
    assert turned == pytest.approx(vectors_in(pose, raised)[0, :2])
    assert planar_turned_back(turned, yaw) == pytest.approx(point)
    np.testing.assert_allclose(planar_rotation(yaw), pose[:2, :2], atol=1e-12)
    matrix = Rotation.from_quat(yaw_quaternion(yaw)).as_matrix()
    np.testing.assert_allclose(matrix, pose[:3, :3], atol=1e-12)
    assert pose[2, 3] == 0.4
