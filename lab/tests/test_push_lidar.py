"""What LiDARs see of a push: where they measure, how wrong they are, and what they make of it."""

from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import PlanarPose, Pose, points_in, pose_at
from contactfusion.generators.perceived import ROBOT
from contactfusion.generators.proximity import ProximityConfig, without
from contactfusion.readings import PointCloud
from contactfusion.robots.description import LidarConfig
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.noise import LidarNoise
from contactfusion_lab.scenes.push.scene import PushScene
from contactfusion_lab.scenes.push.sensors import PushLidar, directions
from contactfusion_lab.scenes.push.view import PushView
from contactfusion_lab.scenes.sensor_errors import RangeErrors, RangeNoise
from lab.tests.test_push_world import base

HERE: PlanarPose = (-0.3, 0.0, 0.0)
"""The base whose front stands at x = 0."""
NO_ERRORS = RangeErrors(RangeNoise(), np.random.default_rng(0))
NEAR: PlanarPose = (0.201, 0.0, 0.0)
"""A box 0.4 m long, 1 mm before the front."""
FAR: PlanarPose = (4.0, 0.0, 0.0)
CALM = LidarNoise(range=0.0, dropout=0.0, jumps=0.0)
MOUNTINGS = ("lidar", "lidar_side", "lidar_tilted")
PROXIMITY = ProximityConfig(occupied=2)
TOUCHING = PROXIMITY.cell[0] / 2.0
"""A length that is less is that of a point in a strip's first cell [m]."""
HEIGHT = 1.45
"""Of a LiDAR that looks straight down, over the floor [m]."""


def lidar(
    config: LidarConfig, pose: Pose, noise: LidarNoise = CALM, name: Any = "box"
) -> PushLidar:
    view = PushView(PushConfig(object=name, target=(1.0, 0.0)).object, base())
    return PushLidar(config, pose, view, noise, NO_ERRORS)


def mounted(name: str, noise: LidarNoise = CALM) -> tuple[PushLidar, Pose]:
    config = base().lidars[name]
    pose = base().frames[config.frame].pose()
    return lidar(config, pose, noise), pose


def looking_down(noise: LidarNoise, **fields: Any) -> FloatArray:
    """64000 points of an empty floor, in the frame of the LiDAR, x down."""
    wide = {"frame": "lidar", "rings": 200, "fov": 8.0, "columns": 11520, "window": (-5.0, 5.0)}
    pose = pose_at((2.0, 0.0, HEIGHT - 0.45), (0.0, np.pi / 2.0, 0.0))
    seen = lidar(LidarConfig(**{**wide, **fields}), pose, noise)
    return seen.points(HERE, FAR, np.random.default_rng(11))


def off(points: FloatArray) -> FloatArray:
    """Excess of ranges over those to the floor, shape (n,) [m]."""
    ranges = np.linalg.norm(points, axis=1)
    errors: FloatArray = ranges - HEIGHT * ranges / points[:, 0]
    return errors


def scanned(seed: int = 0, cycles: int = 1, **fields: Any) -> list[list[PointCloud]]:
    scene = PushScene(PushConfig(**{"target": (1.0, 0.0), **fields}), base(), seed)
    seen = []
    for _ in range(cycles):
        seen.append([reading for reading in scene.readings() if isinstance(reading, PointCloud)])
        scene.drive(0.1, 0.0, 0.0)
    return seen


def lengths(points: FloatArray, pose: Pose) -> FloatArray:
    return PROXIMITY.lengths_of_cloud(without(points_in(pose, points), ROBOT))


# Where it measures


def test_rings_fan_out_and_columns_spin_from_x_to_y() -> None:
    found = directions(LidarConfig(frame="base", rings=3, columns=4))
    half = np.sqrt(0.5)
    assert found == pytest.approx(
        np.array(
            [
                (-half, 0.0, -half), (-1.0, 0.0, 0.0), (-half, 0.0, half),
                (0.0, -half, -half), (0.0, -1.0, 0.0), (0.0, -half, half),
                (half, 0.0, -half), (1.0, 0.0, 0.0), (half, 0.0, half),
                (0.0, half, -half), (0.0, 1.0, 0.0), (0.0, half, half),
            ]
        ),
        abs=1e-12,
    )  # fmt: skip


def test_rings_are_equally_far_from_each_other() -> None:
    found = directions(LidarConfig(frame="base", rings=32, columns=16))
    assert np.linalg.norm(found, axis=1) == pytest.approx(np.ones(len(found)))
    rise = np.degrees(np.arcsin(found[:32, 2]))
    assert rise == pytest.approx(np.linspace(-45.0, 45.0, 32))


@pytest.mark.parametrize(
    ("window", "turns"),
    [
        ((-180.0, 180.0), [-180.0, -90.0, 0.0, 90.0]),
        ((0.0, 360.0), [0.0, 90.0, 180.0, 270.0]),
        ((-360.0, 0.0), [-360.0, -270.0, -180.0, -90.0]),
        ((-1.0, 91.0), [0.0, 90.0]),
        ((0.0, 90.0), [0.0]),
        ((10.0, 80.0), []),
    ],
)
def test_a_window_holds_the_turns_between_its_ends(
    window: tuple[float, float], turns: list[float]
) -> None:
    found = directions(LidarConfig(frame="base", rings=1, fov=1.0, columns=4, window=window))
    assert len(found) == len(turns)
    seen = np.arctan2(found[:, 1], found[:, 0])
    assert np.cos(seen - np.radians(turns)) == pytest.approx(np.ones(len(turns)))


def test_the_mountings_of_the_base_measure_only_in_their_windows() -> None:
    counts = {name: len(directions(base().lidars[name])) for name in MOUNTINGS}
    columns = {name: np.arange(-1024, 1024) * 360.0 / 1024 for name in MOUNTINGS}
    for name, turns in columns.items():
        first, last = base().lidars[name].window
        assert counts[name] == 32 * np.count_nonzero((turns >= first) & (turns < last))
    assert counts == {"lidar": 6368, "lidar_side": 6368, "lidar_tilted": 10912}


# How wrong it is


def test_without_noise_every_point_lies_on_the_floor() -> None:
    points = looking_down(CALM)
    assert len(points) == 200 * 320
    assert np.abs(off(points)).max() < 1e-6


def test_ranges_are_off_by_3_5_mm() -> None:
    errors = off(looking_down(LidarNoise(dropout=0.0, jumps=0.0)))
    assert len(errors) == 64000
    assert errors.std() == pytest.approx(0.0035, rel=0.02)
    assert abs(errors.mean()) < 5e-5
    assert np.mean(np.abs(errors) < 0.0035) == pytest.approx(0.683, abs=0.01)


def test_one_measurement_in_71_has_no_return() -> None:
    lost = 64000 - len(looking_down(LidarNoise()))
    assert lost / 64000 == pytest.approx(0.014, abs=0.0015)


def test_one_range_in_125_jumps_to_either_side() -> None:
    errors = off(looking_down(LidarNoise(range=0.0, dropout=0.0)))
    jumps = errors[np.abs(errors) > 1e-5]
    assert len(jumps) / 64000 == pytest.approx(0.008, abs=0.0012)
    assert np.abs(jumps).max() < 0.3
    assert np.quantile(jumps, [0.25, 0.75]) == pytest.approx([-0.15, 0.15], abs=0.03)


def test_noise_is_along_the_ray() -> None:
    quiet, noisy = looking_down(CALM), looking_down(LidarNoise(dropout=0.0, jump=0.0))
    sines = np.linalg.norm(np.cross(quiet, noisy), axis=1)
    assert sines.max() < 1e-9


def test_nothing_is_nearer_or_farther_than_its_reach() -> None:
    points = looking_down(LidarNoise(), reach=(HEIGHT, HEIGHT + 0.005))
    ranges = np.linalg.norm(points, axis=1)
    assert HEIGHT <= ranges.min() < ranges.max() <= HEIGHT + 0.005
    assert 1000 < len(points) < 50000
    assert len(looking_down(CALM, reach=(0.1, 1.0))) == 0


def test_what_is_too_near_is_not_seen() -> None:
    # 0.25 m over the box: only what lies aslant is far enough
    config = LidarConfig(frame="lidar", rings=41, fov=80.0, columns=360, window=(-60.0, 60.0))
    pose = pose_at((0.5, 0.0, 0.60), (0.0, np.pi / 2.0, 0.0))
    points = lidar(config, pose).points(HERE, NEAR, np.random.default_rng(0))
    ranges = np.linalg.norm(points, axis=1)
    assert 0.3 <= ranges.min() < 0.303
    near = lidar(config.model_copy(update={"reach": (0.2, 50.0)}), pose)
    whole = near.points(HERE, NEAR, np.random.default_rng(0))
    assert len(whole) > len(points)
    assert np.linalg.norm(whole, axis=1).min() == pytest.approx(0.25, abs=1e-4)


def test_where_there_is_nothing_there_is_no_point() -> None:
    config = LidarConfig(frame="lidar", rings=8, fov=60.0, columns=64)
    upward = pose_at((0.0, 0.0, 1.0), (0.0, -np.pi / 2.0, 0.0))
    sky = lidar(config.model_copy(update={"window": (-30.0, 30.0)}), upward, LidarNoise())
    assert sky.points(HERE, NEAR, np.random.default_rng(0)).shape == (0, 3)


# It repeats itself


def test_the_same_seed_gives_the_same_bytes() -> None:
    def bits(seed: int) -> list[bytes]:
        return [each.points.tobytes() for (each,) in scanned(seed, 3, sees=("lidar",))]

    assert bits(3) == bits(3)
    assert all(first != second for first, second in zip(bits(3), bits(4), strict=True))
    assert len(set(bits(3))) == 3


def test_another_lidar_changes_nothing_of_the_first() -> None:
    alone = scanned(3, 3, sees=("lidar",))
    both = scanned(3, 3, sees=("lidar_side", "lidar", "lidar_tilted"))
    for (first,), (_, second, _) in zip(alone, both, strict=True):
        assert (first.sensor, first.frame) == (second.sensor, second.frame) == ("lidar", "lidar")
        assert first.points.tobytes() == second.points.tobytes()


# When it measures


@pytest.mark.parametrize(
    ("rate", "period", "counts"),
    [
        (10.0, 0.05, [1, 0, 1, 0, 1, 0]),
        (10.0, 0.1, [1, 1, 1, 1, 1, 1]),
        (20.0, 0.1, [1, 1, 1, 1, 1, 1]),
        (5.0, 0.1, [1, 0, 1, 0, 1, 0]),
        (4.0, 0.1, [1, 0, 0, 1, 0, 0]),
    ],
)
def test_scans_come_at_its_rate_and_with_a_cycle(
    rate: float, period: float, counts: list[int]
) -> None:
    turning = base().lidars["lidar"].model_copy(update={"rate": rate})
    robot = base().model_copy(update={"lidars": {"lidar": turning}})
    scene = PushScene(PushConfig(target=(1.0, 0.0), sees=("lidar",), period=period), robot)
    seen = []
    for _ in counts:
        clouds = [reading for reading in scene.readings() if isinstance(reading, PointCloud)]
        assert all(cloud.stamp == scene.stamp for cloud in clouds)
        seen.append(len(clouds))
        scene.drive(0.0, 0.0, 0.0)
    assert seen == counts


# What a push makes of it


def test_a_push_that_names_no_lidar_sees_nothing() -> None:
    assert scanned() == [[]]


def test_an_unknown_lidar_is_reported_in_one_sentence() -> None:
    with pytest.raises(ConfigurationError) as caught:
        scanned(sees=("lidar", "lidar_tiled"))
    sentence = str(caught.value)
    assert sentence.startswith("sees: the robot has no 'lidar_tiled'; did you mean 'lidar_tilted'?")
    assert "\n" not in sentence


@pytest.mark.parametrize("name", MOUNTINGS)
def test_every_mounting_sees_a_box_before_the_face(name: str) -> None:
    seen, pose = mounted(name)
    found = lengths(seen.points(HERE, NEAR, np.random.default_rng(0)), pose)
    # the box begins 1 mm after the face, and there are points of it in each strip's first cell
    assert np.all(found[2:10] < TOUCHING)
    assert found[[0, 1, 11]] == pytest.approx(np.full(3, PROXIMITY.empty))


def test_points_lie_so_close_to_each_other_that_a_touch_is_no_gap() -> None:
    # the mean of a first cell that a surface fills from 1 mm on is half a millimetre off its middle
    seen, pose = mounted("lidar")
    found = lengths(seen.points(HERE, NEAR, np.random.default_rng(0)), pose)
    assert found[2:10] == pytest.approx(np.full(8, 0.0005), abs=0.0005)


@pytest.mark.parametrize("name", MOUNTINGS)
@pytest.mark.parametrize("gap", [0.05, 0.12, 0.25])
def test_every_mounting_sees_how_far_a_box_is(name: str, gap: float) -> None:
    seen, pose = mounted(name)
    found = lengths(seen.points(HERE, (0.2 + gap, 0.0, 0.0), np.random.default_rng(0)), pose)
    assert found[3:9] == pytest.approx(np.full(6, gap - 0.01), abs=PROXIMITY.cell[0])


@pytest.mark.parametrize("name", MOUNTINGS)
def test_every_mounting_sees_on_which_side_a_box_stands(name: str) -> None:
    seen, pose = mounted(name)
    # from 0.02 to 0.42 m to the left: strips 7 and on, the seventh begins at 0.05 m
    left = lengths(seen.points(HERE, (0.201, 0.22, 0.0), np.random.default_rng(0)), pose)
    right = lengths(seen.points(HERE, (0.201, -0.22, 0.0), np.random.default_rng(0)), pose)
    assert np.all(left[7:] < TOUCHING) and np.all(left[:6] == PROXIMITY.empty)
    assert np.all(right[:5] < TOUCHING) and np.all(right[6:] == PROXIMITY.empty)


@pytest.mark.parametrize("name", MOUNTINGS)
def test_an_empty_region_stays_empty_despite_noise(name: str) -> None:
    seen, pose = mounted(name, LidarNoise())
    rng = np.random.default_rng(7)
    scans = [lengths(seen.points(HERE, FAR, rng), pose) for _ in range(200)]
    empty = [bool(np.all(scan == PROXIMITY.empty)) for scan in scans]
    assert np.mean(empty) >= 0.95


@pytest.mark.parametrize("name", MOUNTINGS)
def test_a_box_that_touches_is_seen_despite_noise(name: str) -> None:
    seen, pose = mounted(name, LidarNoise())
    rng = np.random.default_rng(8)
    scans = [lengths(seen.points(HERE, NEAR, rng), pose) for _ in range(50)]
    assert np.median(scans, axis=0)[2:10].max() < TOUCHING
    assert np.quantile(np.array(scans)[:, 3:9], 0.95) < TOUCHING


# What is wrong


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"window": (10.0, -60.0)}, "window: give the first turn, then the last, at most a turn"),
        ({"window": (10.0, 10.0)}, "window: give the first turn, then the last, at most a turn"),
        ({"window": (-200.0, 200.0)}, "window: give the first turn, then the last, at most a turn"),
        ({"window": (0.0, 400.0)}, "window: give the first turn, then the last, at most a turn"),
        ({"reach": (50.0, 0.3)}, "reach: give the least distance, then the greatest"),
        ({"reach": (-0.1, 0.3)}, "reach: give the least distance, then the greatest"),
        ({"rings": 0}, "rings: "),
        ({"columns": 0}, "columns: "),
        ({"fov": 180.0}, "fov: "),
        ({"rate": 0.0}, "rate: "),
        ({"colums": 512}, "colums: unknown field; did you mean 'columns'?"),
    ],
)
def test_wrong_fields_of_a_lidar_are_reported(fields: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        LidarConfig(**{"frame": "base", **fields})
    assert str(caught.value).startswith(sentence)
    assert "\n" not in str(caught.value)
