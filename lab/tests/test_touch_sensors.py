"""Sensors read what is, wrong by so much as their noise says."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in
from contactfusion.readings import DepthImage, ObjectPose, PointCloud, TactileImage, Wrench
from contactfusion.robots.description import read_robot
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion.robots.objects import ObjectConfig, ObjectModel
from contactfusion.robots.solids import Solid
from contactfusion.shapes import ShapeConfig
from contactfusion_lab.scenes.approach import led_by
from contactfusion_lab.scenes.noise import TouchNoise
from contactfusion_lab.scenes.touch.sensors import SKIN, TouchSensors
from contactfusion_lab.scenes.touch.world import Touching
from tests.poker import poker
from tests.urdfs import ARM_HAND, real

DESCRIPTION = real(ARM_HAND).urdf.path.with_suffix(".yaml")
BENT = {"arm_2": 0.6, "arm_4": 1.2, "arm_6": 1.2, "finger_1_distal_joint": 0.3}
WALL = ShapeConfig(shape="box", size=(20.0, 20.0, 0.2))


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return shared_robot(read_robot(DESCRIPTION))


def bent(robot: RobotModel) -> FloatArray:
    return np.array([BENT.get(name, 0.0) for name in robot.joint_names])


def sensors_of(robot: RobotModel, noise: Any, seed: int = 0, tool: str = "palm") -> TouchSensors:
    positions = np.array([BENT.get(name, 0.0) for name in robot.joint_names])
    rng = np.random.default_rng(seed)
    kind = TouchNoise.model_validate(noise)
    return TouchSensors(robot, tool, led_by(robot, tool), positions, kind, rng)


# Joints


def told_by(robot: RobotModel, noise: Any, seed: int = 0) -> FloatArray:
    reading = sensors_of(robot, noise, seed).joints(0.0, bent(robot), np.zeros(15))
    return robot.positions(reading)


def test_without_noise_joints_are_read_as_they_are(robot: RobotModel) -> None:
    velocities = np.arange(15.0)
    reading = sensors_of(robot, "none").joints(0.25, bent(robot), velocities)
    assert reading.stamp == 0.25 and reading.names == robot.joint_names
    assert np.array_equal(reading.positions, bent(robot))
    assert reading.velocities is not None and np.array_equal(reading.velocities, velocities)


@pytest.fixture(scope="module")
def strays(robot: RobotModel) -> FloatArray:
    """Where the palm seems to be in its own frame, place and turn, for many seeds."""
    true = robot.poses_at(bent(robot))["palm"]
    found = []
    for seed in range(200):
        there = robot.poses_at(told_by(robot, "prototype", seed))["palm"]
        rotation = Rotation.from_matrix(there[:3, :3] @ true[:3, :3].T).as_rotvec()
        found.append([*(there[:3, 3] - true[:3, 3]), *np.degrees(rotation)])
    return np.array(found)


def test_the_joints_of_the_arm_misplace_the_hand_by_their_noise(strays: FloatArray) -> None:
    noise = TouchNoise.model_validate("prototype")
    assert np.std(strays[:, :3], axis=0) == pytest.approx([noise.wrist_place] * 3, rel=0.15)
    assert np.std(strays[:, 3:], axis=0) == pytest.approx([noise.wrist_turn] * 3, rel=0.15)
    mean = np.abs(strays.mean(axis=0))
    assert (mean < 3 * np.std(strays, axis=0) / np.sqrt(200)).all()


@pytest.mark.parametrize(("noise", "degrees"), [("prototype", 0.2), ("full", np.hypot(0.2, 1.0))])
def test_the_joints_of_the_hand_are_wrong_by_their_encoders_and_zeros(
    robot: RobotModel, noise: str, degrees: float
) -> None:
    hand = led_by(robot, "palm") == 0.0
    errors = [told_by(robot, noise, seed)[hand] - bent(robot)[hand] for seed in range(50)]
    assert np.std(np.degrees(errors)) == pytest.approx(degrees, rel=0.12)


def test_the_error_of_the_joints_is_the_same_all_the_time(robot: RobotModel) -> None:
    sensors = sensors_of(robot, "prototype")
    first = sensors.joints(0.0, bent(robot), np.zeros(15)).positions - bent(robot)
    later = sensors.joints(0.1, bent(robot) + 0.1, np.zeros(15)).positions - bent(robot) - 0.1
    assert np.abs(first).min() > 1e-6 and np.allclose(first, later, atol=1e-12)


def test_a_joint_that_is_still_is_not_reported(tmp_path: Path) -> None:
    robot = poker(tmp_path, foot="prismatic", still={"foot": 0.1})
    sensors = sensors_of(robot, "prototype", tool="carriage")
    reading = sensors.joints(0.0, np.array([0.1, 0.3]), np.array([0.0, 2.0]))
    assert reading.names == ("slide",) and reading.positions.shape == (1,)
    assert reading.velocities is not None and reading.velocities.tolist() == [2.0]
    assert reading.positions[0] == pytest.approx(0.3, abs=0.01)


# Wrists


FELT = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.3])
AT = np.zeros(2)
"""Where the poker's joints stand."""


def wrenches(robot: RobotModel, noise: Any, count: int = 1) -> dict[str, FloatArray]:
    sensors = sensors_of(robot, noise, tool="carriage")
    found: dict[str, list[FloatArray]] = {}
    for number in range(count):
        for reading in sensors.wrenches(
            0.01 * number, AT, {name: FELT for name in robot.config.wrists}
        ):
            assert isinstance(reading, Wrench)
            assert reading.frame == robot.config.wrists[reading.sensor].frame
            both = np.concatenate([reading.force, reading.torque])
            found.setdefault(reading.sensor, []).append(both)
    return {name: np.array(readings) for name, readings in found.items()}


@pytest.fixture(scope="module")
def pokes(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return poker(tmp_path_factory.mktemp("poker"), foot="prismatic")


def test_a_wrench_by_the_robot_is_the_reverse_of_that_on_it(pokes: RobotModel) -> None:
    found = wrenches(pokes, "none")
    assert np.array_equal(found["cell"], [FELT]) and np.array_equal(found["reverse"], [-FELT])


def test_a_wrench_has_a_zero_of_its_own_and_noise_about_it(pokes: RobotModel) -> None:
    found = wrenches(pokes, "prototype", 500)
    spread = np.repeat([0.2, 0.01], 3)
    for name, sign in (("cell", 1.0), ("reverse", -1.0), ("whole", 1.0)):
        assert np.std(found[name], axis=0) == pytest.approx(spread, rel=0.15)
        zero = sign * found[name].mean(axis=0) - FELT
        assert (np.abs(zero) < 4 * np.repeat([0.1, 0.005], 3)).all()
        assert np.abs(zero).max() > 4 * 0.2 / np.sqrt(500)
    assert not np.allclose(found["cell"].mean(axis=0), found["whole"].mean(axis=0), atol=0.03)


def test_zeros_of_wrenches_are_as_wide_as_configured(pokes: RobotModel) -> None:
    zeros = [
        next(
            sensors_of(pokes, {"force_zero": 0.1}, seed, "carriage").wrenches(0, AT, {"cell": FELT})
        )
        for seed in range(100)
    ]
    assert np.std([zero.force - FELT[:3] for zero in zeros]) == pytest.approx(0.1, rel=0.15)
    assert np.array_equal(zeros[0].torque, FELT[3:])


def test_what_a_wrist_reads_drifts_and_mixes(pokes: RobotModel) -> None:
    noise = {"force_drift": 0.2, "torque_drift": 0.01}
    drifting = wrenches(pokes, noise, 6001)["cell"] - FELT
    assert not drifting[0].any() and np.abs(drifting[-1]).min() > 1e-6
    assert np.allclose(drifting[-1], 2.0 * drifting[3000])
    assert 0.02 < np.abs(drifting[-1][:3]).max() < 0.8 and np.abs(drifting[-1][3:]).max() < 0.04
    mixed = wrenches(pokes, {"crosstalk": 0.02})["cell"][0] - FELT
    assert 1e-4 < np.abs(mixed).min() and np.abs(mixed).max() < 0.3


def test_a_payload_that_errs_weighs_at_its_centre_whatever_the_pose(pokes: RobotModel) -> None:
    """A wrist that only carries its load reads more or less than it by one share, everywhere."""
    sensors = sensors_of(pokes, {"payload": 0.05}, tool="carriage")
    for name, sign in (("cell", 1.0), ("reverse", -1.0), ("whole", 1.0)):
        shares = []
        for positions in (AT, np.array([0.7, 0.2])):
            poses = pokes.poses_at(positions)
            frame = pokes.config.wrists[name].frame
            pose = poses[pokes.link_of(frame)] @ pokes.pose_on_link(frame)
            mass, centre = pokes.load_on(frame, poses)
            weight = mass * np.array([0.0, 0.0, -9.81])
            load = np.concatenate(
                [pose[:3, :3].T @ weight, pose[:3, :3].T @ np.cross(centre - pose[:3, 3], weight)]
            )
            (reading,) = sensors.wrenches(0.0, positions, {name: load})
            read = sign * np.concatenate([reading.force, reading.torque])
            share = float(np.linalg.norm(read) / np.linalg.norm(load)) - 1.0
            assert np.allclose(read, (1.0 + share) * load)
            shares.append(share)
        assert shares[0] == pytest.approx(shares[1]) and 1e-3 < abs(shares[0]) < 0.2


def test_no_part_of_the_noise_changes_what_others_draw(robot: RobotModel) -> None:
    def read(noise: str) -> list[FloatArray]:
        sensors = sensors_of(robot, noise)
        joints = sensors.joints(0.0, bent(robot), np.zeros(15)).positions
        (wrench,) = sensors.wrenches(0.0, bent(robot), {"wrist": np.zeros(6)})
        poses, nothing = (
            robot.poses_at(bent(robot)),
            Touching(np.zeros((0, 3)), np.zeros((0, 3)), ()),
        )
        skins = [image.values for image in sensors.skins(0.0, poses, nothing)]
        bodies: list[tuple[Solid, Pose]] = [(Solid([WALL]), poses["base"])]
        (depth, _) = sensors.sights(0.0, poses, bodies)
        assert isinstance(depth, DepthImage)
        return [joints, wrench.force, *skins, depth.depth]

    plain = read("prototype")
    for part, changed in (("taxels", set[int]()), ("range", {6}), ("wrist", {1})):
        other = read(f"prototype+{part}")
        same = [np.array_equal(a, b) for a, b in zip(plain, other, strict=True)]
        assert {row for row, equal in enumerate(same) if not equal} == changed, part


# Skins


def skins(robot: RobotModel, touching: Touching, noise: Any = "none") -> dict[str, FloatArray]:
    poses = robot.poses_at(bent(robot))
    found = {}
    for reading in sensors_of(robot, noise).skins(0.5, poses, touching):
        assert isinstance(reading, TactileImage) and reading.stamp == 0.5
        assert reading.frame == robot.config.patches[reading.sensor].frame
        found[reading.sensor] = reading.values
    return found


def pushed(robot: RobotModel, patch: str, taxel: int, link: str, force: float = 2.0) -> Touching:
    """Push one taxel along its normal."""
    frame = robot.config.patches[patch].frame
    pose = robot.poses_at(bent(robot))[robot.link_of(frame)] @ robot.pose_on_link(frame)
    place = points_in(pose, robot.config.patches[patch].centres()[[taxel]])
    return Touching(place, -force * pose[None, :3, 2], (link,))


@pytest.mark.parametrize(
    ("patch", "link"),
    [("tip_2", "finger_2_distal"), ("palm", "palm"), ("tip_3", "finger_3_distal")],
)
def test_each_taxel_feels_what_pushes_near_it(patch: str, link: str, robot: RobotModel) -> None:
    centres = robot.config.patches[patch].centres()
    for taxel in range(0, len(centres), 5):
        values = skins(robot, pushed(robot, patch, taxel, link))
        away = np.linalg.norm(centres - centres[taxel], axis=1)
        assert np.allclose(values[patch], 2.0 * np.exp(-0.5 * (away / SKIN) ** 2), atol=1e-9)
        assert values[patch].argmax() == taxel and values[patch][taxel] == pytest.approx(2.0)
        assert not any(values[name].any() for name in values if name != patch)


def test_what_pushes_another_link_is_not_felt(robot: RobotModel) -> None:
    values = skins(robot, pushed(robot, "palm", 5, "finger_1_knuckle"))
    assert len(values) == 4 and not any(value.any() for value in values.values())


def test_pushes_add_up(robot: RobotModel) -> None:
    first, second = (pushed(robot, "palm", taxel, "palm") for taxel in (0, 15))
    both = Touching(
        np.concatenate([first.places, second.places]),
        np.concatenate([first.forces, second.forces]),
        ("palm", "palm"),
    )
    alone = skins(robot, first)["palm"] + skins(robot, second)["palm"]
    assert np.allclose(skins(robot, both)["palm"], alone)


def test_taxels_are_noisy_each_by_itself(robot: RobotModel) -> None:
    nothing = Touching(np.empty((0, 3)), np.empty((0, 3)), ())
    values = np.concatenate(list(skins(robot, nothing, "prototype").values()))
    assert len(values) == 3 * 24 + 16
    assert np.std(values) == pytest.approx(0.02, rel=0.25) and len(set(values)) == len(values)


def test_taxels_have_gains_neighbours_and_a_dead_one(robot: RobotModel) -> None:
    exact = skins(robot, pushed(robot, "palm", 5, "palm"))["palm"]
    touching = pushed(robot, "palm", 5, "palm")
    gains = skins(robot, touching, {"taxels": {"gain": 0.2}})["palm"] / exact
    assert np.std(np.log(gains)) == pytest.approx(0.2, rel=0.5)
    dead = skins(robot, touching, {"taxels": {"dead": 1}})["palm"]
    assert np.count_nonzero(dead != exact) == 1 and dead.min() == 0.0
    mixed = skins(robot, touching, {"taxels": {"crosstalk": 0.05}})["palm"]
    assert (mixed >= exact).all() and mixed.sum() > 1.1 * exact.sum()


def test_taxels_are_noisy_after_their_other_errors(robot: RobotModel) -> None:
    nothing = Touching(np.empty((0, 3)), np.empty((0, 3)), ())
    noise = {"pressure": 0.02, "taxels": {"gain": 0.9, "dead": 10}}
    values = np.concatenate(list(skins(robot, nothing, noise).values()))
    assert np.array_equal(
        values, np.concatenate(list(skins(robot, nothing, {"pressure": 0.02}).values()))
    )


def test_taxels_remember_a_touch_that_is_over(robot: RobotModel) -> None:
    poses, touching = robot.poses_at(bent(robot)), pushed(robot, "palm", 5, "palm")
    nothing = Touching(np.empty((0, 3)), np.empty((0, 3)), ())
    sensors = sensors_of(robot, {"taxels": {"hysteresis": 0.1}})
    during, after = (
        {image.sensor: image.values for image in sensors.skins(stamp, poses, there)}["palm"]
        for stamp, there in ((0.1, touching), (0.2, nothing))
    )
    assert np.allclose(after, 0.1 * during * np.exp(-0.1))


# Cameras


def looks(robot: RobotModel, noise: Any, seed: int = 0, count: int = 1) -> list[FloatArray]:
    """See a wall 1 m ahead of where the camera is believed."""
    poses = robot.poses_at(bent(robot))
    viewpoint = poses["base"] @ robot.pose_on_link("forehead")
    forward = np.eye(4)
    forward[2, 3] = 1.1
    bodies: list[tuple[Solid, Pose]] = [(Solid([WALL]), viewpoint @ forward)]
    sensors = sensors_of(robot, noise, seed)
    images = []
    for _ in range(count):
        image, cloud = sensors.sights(0.0, poses, bodies)
        assert isinstance(image, DepthImage) and isinstance(cloud, PointCloud)
        assert image.frame == cloud.frame == image.sensor == cloud.sensor == "forehead"
        assert len(cloud.points) == np.count_nonzero(image.depth)
        assert np.allclose(cloud.points[:, 2], image.depth[image.depth > 0])
        images.append(image.depth)
    return images


def test_without_noise_a_camera_sees_what_is_there(robot: RobotModel) -> None:
    (depth,) = looks(robot, "none")
    assert depth.shape == (240, 320) and np.allclose(depth, 1.0, atol=1e-5)


def test_depth_is_noisy_in_each_pixel_each_time(robot: RobotModel) -> None:
    first, second = looks(robot, {"depth": 0.0025}, count=2)
    assert np.std(first) == pytest.approx(0.0025, rel=0.05)
    assert np.std(first - second) == pytest.approx(0.0025 * np.sqrt(2.0), rel=0.05)
    assert np.mean(first) == pytest.approx(1.0, abs=1e-4)


def test_some_pixels_fly(robot: RobotModel) -> None:
    (depth,) = looks(robot, {"flying": 0.1})
    off = np.abs(depth - 1.0)
    assert np.mean(off > 0.01) == pytest.approx(0.1 * (1 - 0.01 / 0.3), rel=0.1)
    assert 0.28 < off.max() < 0.3 + 1e-4


def test_all_a_camera_sees_is_too_near_or_too_far_by_one_share(robot: RobotModel) -> None:
    first, second = looks(robot, {"ranges": {"bias": 0.01}}, count=2)
    assert np.array_equal(first, second) and np.ptp(first) < 1e-5
    errors = [looks(robot, {"ranges": {"bias": 0.01}}, seed)[0].mean() - 1.0 for seed in range(60)]
    assert np.std(errors) == pytest.approx(0.01, rel=0.25)


def test_ranges_are_noisy_after_their_bias_and_within_reach(robot: RobotModel) -> None:
    biased = looks(robot, {"ranges": {"bias": 0.2}}, seed=2)[0]
    noisy = looks(robot, {"ranges": {"bias": 0.2}, "depth": 0.0025}, seed=2)[0]
    assert abs(biased.mean() - 1.0) > 0.01
    assert np.std(noisy - biased) == pytest.approx(0.0025, rel=0.05)
    reach = robot.config.cameras["forehead"].reach
    assert (noisy <= reach[1]).all()


def test_a_camera_stands_elsewhere_than_believed_all_the_time(robot: RobotModel) -> None:
    first, second = looks(robot, {"eye_place": 0.01}, count=2)
    assert np.array_equal(first, second) and np.ptp(first) < 1e-5
    errors = [looks(robot, {"eye_place": 0.01}, seed)[0].mean() - 1.0 for seed in range(60)]
    assert np.std(errors) == pytest.approx(0.01, rel=0.25)


def test_a_camera_is_turned_from_what_is_believed(robot: RobotModel) -> None:
    slopes = []
    for seed in range(60):
        (depth,) = looks(robot, {"eye_turn": 0.3}, seed)
        # across a wall seen askew the depth grows by the tangent of the angle for each metre
        slopes.append((depth[120, -1] - depth[120, 0]) / (2.0 * np.tan(np.radians(30.0))))
    assert np.std(np.degrees(slopes)) == pytest.approx(0.3, rel=0.25)


# What is believed


def believed(noise: Any, seed: int = 0, **fields: Any) -> ObjectPose:
    shape = {"shape": "box", "size": (0.1, 0.1, 0.1)}
    pose = {"parent": "base", "xyz": (0.7, 0.1, 0.3), "rpy": (0.1, 0.2, 0.3)}
    config = {"shapes": [shape], "pose": pose, **fields}
    robot = shared_robot(read_robot(DESCRIPTION))
    objects = {"box": ObjectModel(ObjectConfig.model_validate(config))}
    poses: Iterator[ObjectPose] = sensors_of(robot, noise, seed).believed(objects)
    (believed_pose,) = poses
    assert (
        believed_pose.name == "box" and believed_pose.frame == "base" and believed_pose.stamp == 0.0
    )
    return believed_pose


TRUE = Rotation.from_euler("xyz", (0.1, 0.2, 0.3))


def test_without_noise_an_object_is_believed_where_it_is() -> None:
    belief = believed("none", sigma=1.0, sigma_yaw=1.0)
    assert np.allclose(belief.position, [0.7, 0.1, 0.3])
    assert (Rotation.from_quat(belief.orientation) * TRUE.inv()).magnitude() < 1e-9


def test_an_object_is_believed_elsewhere_by_its_sigma() -> None:
    poses = [believed("prototype", seed, sigma=0.03, sigma_yaw=0.2) for seed in range(200)]
    places = np.array([each.position for each in poses]) - [0.7, 0.1, 0.3]
    assert np.std(places, axis=0) == pytest.approx([0.03] * 3, rel=0.15)
    turns = [(Rotation.from_quat(each.orientation) * TRUE.inv()).as_rotvec() for each in poses]
    assert np.abs(np.array(turns)[:, :2]).max() < 1e-9
    assert np.std(np.array(turns)[:, 2]) == pytest.approx(0.2, rel=0.15)
