"""A hand goes straight ahead, from where it is aimed to where it touches."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, inverse, points_in, pose_at
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectConfig, ObjectModel
from contactfusion_lab.scenes.approach import Approach, led_by, solved, straight, tries
from contactfusion_lab.scenes.touch.config import TouchConfig
from contactfusion_lab.scenes.touch.scene import FAR, aimed, distance_to_touch, drawn_posture
from tests.hands import slide
from tests.poker import poker
from tests.urdfs import ARM_HAND, real

BENT = {"arm_2": 0.6, "arm_4": 1.2, "arm_6": 1.2, "finger_1_distal_joint": 0.3}
BEFORE, BEYOND = 0.05, 0.04
BRICK = {"shapes": [{"shape": "box", "size": (0.1, 0.2, 0.4)}]}
AWAY = FAR + np.linalg.norm([0.1, 0.2, 0.4]) / 2.0
"""From the middle of the brick."""


def bent() -> FloatArray:
    return np.array([BENT.get(name, 0.0) for name in real(ARM_HAND).joint_names])


def brick(*xyz: float, rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> ObjectModel:
    pose = {"parent": "base", "xyz": xyz, "rpy": rpy}
    return ObjectModel(ObjectConfig.model_validate({**BRICK, "pose": pose}))


def turned_by(first: Pose, second: Pose) -> float:
    """The angle between two poses [rad]."""
    rotation = Rotation.from_matrix(first[:3, :3].T @ second[:3, :3])
    return float(np.linalg.norm(rotation.as_rotvec()))


@pytest.fixture(scope="module")
def end() -> Pose:
    """Where the palm shall be: a little off where the bent arm has it."""
    there = real(ARM_HAND).poses_at(bent())["palm"]
    return there @ pose_at((0.02, -0.03, 0.04), (0.1, -0.2, 0.3))


@pytest.fixture(scope="module")
def path(end: Pose) -> Approach:
    found = straight(real(ARM_HAND), "palm", end, bent(), BEFORE, BEYOND)
    assert found is not None
    return found


# The straight path


@pytest.mark.parametrize("gone", np.linspace(-BEFORE, BEYOND, 37))
def test_the_tool_goes_straight_along_its_z_without_a_turn(
    path: Approach, end: Pose, gone: float
) -> None:
    there = real(ARM_HAND).poses_at(path.at(gone))["palm"]
    assert np.allclose(there[:3, 3], end[:3, 3] + gone * end[:3, 2], atol=4e-4)
    assert turned_by(end, there) < 2e-3


def test_the_path_is_within_the_limits_and_moves_the_arm_only(path: Approach) -> None:
    model = real(ARM_HAND)
    low, high = model.limits.T
    assert (path.joints >= low).all() and (path.joints <= high).all()
    fingers = [number for number, name in enumerate(model.joint_names) if "finger" in name]
    assert len(fingers) == 8
    assert np.array_equal(
        path.joints[:, fingers], np.tile(bent()[fingers], (len(path.distances), 1))
    )
    assert path.distances[0] == -BEFORE and path.distances[-1] == BEYOND
    assert np.abs(np.diff(path.joints, axis=0)).max() < 0.1


def test_beyond_its_ends_a_path_stands_still() -> None:
    path = Approach(np.array([-0.1, 0.0, 0.3]), np.array([[0.0], [1.0], [4.0]]))
    expected = [path.at(gone)[0] for gone in (-9.0, -0.1, -0.05, 0.0, 0.1, 0.3, 9.0)]
    assert np.allclose(expected, [0.0, 0.0, 0.5, 1.0, 2.0, 4.0, 4.0])


def test_out_of_reach_there_is_no_path(end: Pose) -> None:
    far = end.copy()
    far[:3, 3] *= 3.0
    assert straight(real(ARM_HAND), "palm", far, bent(), BEFORE, BEYOND) is None


def test_a_path_that_can_be_gone_in_part_only_is_none(tmp_path: Path) -> None:
    model, start = poker(tmp_path, foot="prismatic"), np.zeros(2)
    for place, before, beyond, reached in [
        (0.9, 0.1, 0.09, True),
        (0.9, 0.1, 0.11, False),
        (-0.9, 0.09, 0.1, True),
        (-0.9, 0.11, 0.1, False),
    ]:
        pose = model.poses_at(np.array([0.1, place]))["carriage"]
        found = straight(model, "carriage", pose, start, before, beyond)
        assert (found is not None) is reached
        if found is not None:
            assert np.allclose(found.joints[:, 0], 0.1, atol=2e-4)
            assert np.allclose(found.joints[:, 1], place + found.distances, atol=2e-4)


def test_the_joints_that_lead_a_link_are_those_before_it(tmp_path: Path) -> None:
    model = real(ARM_HAND)
    led = dict(zip(model.joint_names, led_by(model, "palm"), strict=True))
    assert led == {name: float(name.startswith("arm")) for name in model.joint_names}
    finger = dict(zip(model.joint_names, led_by(model, "finger_2_proximal"), strict=True))
    assert finger["finger_2_spread"] == finger["finger_2_proximal_joint"] == 1.0
    assert finger["finger_2_distal_joint"] == finger["finger_1_spread"] == 0.0
    still = poker(tmp_path, foot="prismatic", still={"foot": 0.1})
    assert led_by(still, "palm").tolist() == [0.0, 1.0]


def test_joint_positions_are_found_for_a_pose_without_those_that_stay() -> None:
    model = real(ARM_HAND)
    rng, posture = np.random.default_rng(0), bent()
    moving = led_by(model, "palm")
    moving[model.joint_names.index("arm_3")] = 0.0  # six are left
    for _ in range(5):
        goal = posture + 0.2 * rng.standard_normal(len(posture)) * moving
        pose = model.poses_at(goal)["palm"]
        found = solved(model, "palm", pose, posture, moving)
        assert found is not None
        there = model.poses_at(found)["palm"]
        assert np.allclose(there[:3, 3], pose[:3, 3], atol=2e-4) and turned_by(there, pose) < 2e-4
        assert np.array_equal(found[moving == 0.0], posture[moving == 0.0])


def test_a_search_begins_at_the_posture_then_by_chance() -> None:
    model, posture = real(ARM_HAND), bent()
    moving = led_by(model, "palm")
    starts = tries(model, posture, moving, np.random.default_rng(0))
    first, *others = itertools.islice(starts, 6)
    assert np.array_equal(first, posture)
    low, high = model.limits.T
    for other in others:
        assert (other[moving > 0] != posture[moving > 0]).all()
        assert np.array_equal(other[moving == 0], posture[moving == 0])
        assert (low <= other).all() and (other <= high).all()
    assert len({other.tobytes() for other in others}) == 5


# Where the hand comes from


def touch(**fields: Any) -> TouchConfig:
    objects: dict[str, Any] = {"brick": {**BRICK, "pose": {"parent": "base"}}}
    return TouchConfig(objects=objects, tool="palm", **fields)


STRAIGHT: dict[str, Any] = {"tilt": 0.0, "wander": 0.0, "roll": 0.0}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("azimuth", "elevation", "forward", "x"),
    [
        (180.0, 0.0, (1, 0, 0), (0, 1, 0)),
        (0.0, 0.0, (-1, 0, 0), (0, -1, 0)),
        (90.0, 0.0, (0, -1, 0), (1, 0, 0)),
        (180.0, 90.0, (0, 0, -1), (0, 1, 0)),
        (180.0, 45.0, (np.sqrt(0.5), 0, -np.sqrt(0.5)), (0, 1, 0)),
    ],
)
def test_the_hand_comes_from_the_given_direction(
    azimuth: float, elevation: float, forward: Any, x: Any
) -> None:
    config = touch(azimuth=azimuth, elevation=elevation, **STRAIGHT)
    pose = aimed(config, brick(1.0, 2.0, 3.0), np.random.default_rng(0))
    assert np.allclose(pose[:3, 2], forward) and np.allclose(pose[:3, 0], x)
    assert np.allclose(pose[:3, 1], np.cross(forward, x))
    assert np.allclose(pose[:3, 3], np.array([1, 2, 3]) - AWAY * np.array(forward))


def test_a_roll_turns_the_hand_about_its_path() -> None:
    level = aimed(touch(**STRAIGHT), brick(0, 0, 0), np.random.default_rng(0))
    config = touch(**{**STRAIGHT, "roll": 30.0})
    rolled = aimed(config, brick(0, 0, 0), np.random.default_rng(0))
    expected = level @ pose_at((0, 0, 0), (0, 0, np.radians(30.0)))
    assert np.allclose(rolled, expected)


def test_the_hand_aims_beside_the_middle_and_past_its_path() -> None:
    target = brick(0.3, 0.2, 0.1, rpy=(0.4, 0.5, 0.6))
    config = touch(azimuth=(150.0, 210.0), elevation=30.0, tilt=20.0, wander=0.25)
    angles, places, sides = [], [], []
    rng = np.random.default_rng(1)
    for _ in range(300):
        pose = aimed(config, target, rng)
        assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3))
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        angles.append(np.degrees(np.arccos(-pose[:3, 2] @ [-np.sqrt(0.75), 0.0, 0.5])))
        sides.append(np.degrees(np.arctan2(pose[1, 2], pose[0, 2])))
        places.append(pose[:3, 3] + AWAY * pose[:3, 2])
    inside = points_in(inverse(target.config.pose.pose()), np.array(places))
    for farthest in (inside.max(axis=0), -inside.min(axis=0)):
        assert farthest == pytest.approx([0.025, 0.05, 0.1], rel=0.05)
    assert 20.0 < max(angles) < 20.0 + 30.0 and min(sides) < -20.0 and max(sides) > 20.0


def test_a_tilt_is_no_larger_than_its_limit() -> None:
    config, rng = touch(elevation=0.0, tilt=20.0, wander=0.0), np.random.default_rng(1)
    leans = []
    for _ in range(300):
        forward = aimed(config, brick(0, 0, 0), rng)[:3, 2]
        leans.append(np.degrees(np.arctan2(np.hypot(forward[1], forward[2]), forward[0])))
    assert 18.0 < max(leans) <= 20.0 + 1e-6 and min(leans) < 4.0


def test_joints_stand_where_they_are_placed_within_their_limits(tmp_path: Path) -> None:
    model = real(ARM_HAND)
    config = touch(posture={"arm_2": 0.6, "arm_4": (1.0, 2.0), "finger_1_spread": (9.0, 9.0)})
    drawn = np.array(
        [drawn_posture(config, model, np.random.default_rng(seed)) for seed in range(100)]
    ).T
    found = dict(zip(model.joint_names, drawn, strict=True))
    assert set(found["arm_2"]) == {0.6} and set(found["arm_1"]) == {0.0}
    assert set(found["finger_1_spread"]) == {1.6}
    assert 1.0 <= found["arm_4"].min() < 1.1 and 1.9 < found["arm_4"].max() <= 2.0
    still = poker(tmp_path, foot="prismatic", still={"foot": 0.1})
    assert drawn_posture(touch(), still, np.random.default_rng(0)).tolist() == [0.1, 0.0]


# Where it touches first


@pytest.fixture(scope="module")
def cube(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return slide(tmp_path_factory.mktemp("slide"))


def distance_of(
    model: RobotModel, target: ObjectModel, forward: tuple[float, ...] = (1, 0, 0)
) -> float:
    poses = model.poses_at(np.zeros(1))
    return distance_to_touch(model, {"hand"}, poses, np.array(forward, np.float64), target)


def test_the_distance_to_a_box_in_front_is_the_gap_between_the_faces(cube: RobotModel) -> None:
    assert distance_of(cube, brick(0.4, 0.0, 0.0)) == pytest.approx(0.3, abs=1e-6)
    assert distance_of(cube, brick(0.4, 0.1, 0.2)) == pytest.approx(0.3, abs=1e-6)
    assert distance_of(cube, brick(0.0, 0.0, -0.5), (0, 0, -1)) == pytest.approx(0.25, abs=1e-6)


def test_the_distance_to_an_edge_in_front_is_that_to_the_edge(cube: RobotModel) -> None:
    box = {"shapes": [{"shape": "box", "size": (0.1, 0.1, 0.4)}]}
    pose = {"parent": "base", "xyz": (0.4, 0.0, 0.0), "rpy": (0.0, 0.0, np.pi / 4)}
    target = ObjectModel(ObjectConfig.model_validate({**box, "pose": pose}))
    edge = 0.4 - 0.1 / np.sqrt(2.0) - 0.05
    assert edge - 1e-6 <= distance_of(cube, target) <= edge + cube.config.spacing / 2 + 1e-6


def test_past_an_object_and_away_from_it_the_distance_is_infinite(cube: RobotModel) -> None:
    assert distance_of(cube, brick(0.4, 0.16, 0.0)) == np.inf
    assert distance_of(cube, brick(0.4, 0.0, -0.26)) == np.inf
    assert distance_of(cube, brick(-0.4, 0.0, 0.0)) == np.inf
    assert distance_of(cube, brick(0.4, 0.14, 0.0)) < 0.31


def test_only_the_links_that_may_touch_count(tmp_path: Path) -> None:
    model = real(ARM_HAND)
    poses, up = model.poses_at(np.zeros(len(model.joint_names))), np.array([0.0, 0.0, 1.0])
    above = poses["finger_3_distal"][2, 3] + 1.0
    target = ObjectModel(
        ObjectConfig.model_validate(
            {"shapes": [{"shape": "box", "size": (1, 1, 0.2)}], "pose": {"parent": "base"}}
            | {"pose": {"parent": "base", "xyz": (0.0, 0.0, above + 0.1)}}
        )
    )
    palm = distance_to_touch(model, {"palm"}, poses, up, target)
    assert palm == pytest.approx(above - poses["palm"][2, 3] - 0.07, abs=1e-6)
    hand = distance_to_touch(model, {"palm", "finger_3_distal"}, poses, up, target)
    assert hand < palm - 0.05
