"""Objects that a range camera sees move near the hand."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import HypothesisCloud, HypothesisKind
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.generators.range import (
    RangeConfig,
    RangeGenerator,
    clustered,
    moved_by,
    self_filtered,
)
from contactfusion.readings import PointCloud
from contactfusion.robots.model import RobotModel
from contactfusion.shapes import ShapeConfig
from tests.hands import posed, slide, state

CUBE = ShapeConfig(shape="box", size=(0.08, 0.08, 0.08)).sampled("cube", 0.003).points
CUBE = CUBE + np.random.default_rng(0).uniform(-0.0015, 0.0015, CUBE.shape)  # no common raster


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return slide(tmp_path_factory.mktemp("slide"))


def generator(**options: Any) -> RangeGenerator:
    return RangeGenerator("eye", RangeConfig(**options))


def cube(x: float, y: float = 0.0, seed: int = 0, noise: float = 0.0) -> FloatArray:
    """Give points of a cube of 8 cm centred at (x, y, 0)."""
    scatter = np.random.default_rng(seed).normal(0.0, noise, CUBE.shape) if noise else 0.0
    points: FloatArray = CUBE + [x, y, 0.0] + scatter
    return points


def seen(
    eye: RangeGenerator, robot: RobotModel, stamp: float, hand: float, points: FloatArray
) -> HypothesisCloud:
    reading = PointCloud(stamp=stamp, frame="base", points=points)
    (cloud,) = eye.generate(reading, state(robot, hand, stamp))
    return cloud


def pushed(eye: RangeGenerator, robot: RobotModel, points: Any, steps: int = 8) -> HypothesisCloud:
    """Move the hand ahead by 1 cm a step; `points` gives what is seen, by where the hand is."""
    clouds = [
        seen(eye, robot, 0.1 * step, 0.01 * step, points(0.01 * step)) for step in range(steps)
    ]
    return clouds[-1]


def test_an_object_that_is_pushed_is_evidence_on_the_side_that_the_hand_moves_to(
    robot: RobotModel,
) -> None:
    cloud = pushed(generator(), robot, lambda x: cube(x + 0.11))
    assert cloud.kind == HypothesisKind.REGULAR and not cloud.single
    assert len(cloud) and cloud.positions[:, 0].min() > 0.07 + 0.05
    assert abs(cloud.positions[:, 1]).max() <= 0.042


def test_an_object_that_stands_still_is_no_evidence(robot: RobotModel) -> None:
    assert not len(pushed(generator(), robot, lambda x: cube(0.20)))


def test_noise_is_no_motion(robot: RobotModel) -> None:
    for seed in range(5):
        stood = pushed(generator(), robot, lambda x: cube(0.2, seed=int(1e3 * x), noise=0.0025))
        assert not len(stood), seed


def test_of_two_objects_only_the_one_that_moves_counts(robot: RobotModel) -> None:
    cloud = pushed(
        generator(), robot, lambda x: np.concatenate([cube(x + 0.11), cube(0.12, y=0.15)])
    )
    assert len(cloud) and cloud.positions[:, 1].max() < 0.05


def test_an_object_that_moves_behind_the_hand_is_not_touched(robot: RobotModel) -> None:
    assert not len(pushed(generator(), robot, lambda x: cube(x - 0.11)))


def test_a_hand_that_stands_touches_nothing(robot: RobotModel) -> None:
    eye = generator()
    clouds = [seen(eye, robot, 0.1 * step, 0.0, cube(0.11 + 0.01 * step)) for step in range(8)]
    assert not len(clouds[-1])


@pytest.mark.parametrize("trembles", [1e-6, -1e-6])
def test_a_hand_that_trembles_moves_nowhere(trembles: float, robot: RobotModel) -> None:
    eye = generator()
    clouds = [
        seen(eye, robot, 0.1 * step, trembles * step, cube(0.11 + 0.01 * step)) for step in range(8)
    ]
    assert not len(clouds[-1])


def test_proximity_is_support_and_needs_no_motion(robot: RobotModel) -> None:
    eye = generator(evidence="proximity")
    cloud = seen(eye, robot, 0.0, 0.0, cube(0.11))
    assert cloud.kind == HypothesisKind.SUPPORT and len(cloud)


def test_likelihoods_fall_with_the_distance(robot: RobotModel) -> None:
    points = np.array([[0.07, 0.0, 0.0], [0.08, 0.0, 0.0], [0.10, 0.0, 0.0]])
    eye = generator(evidence="proximity", margin=0.0)
    cloud = seen(eye, robot, 0.0, 0.0, points)
    distances = np.array([0.02, 0.03, 0.05])  # of the sampled surface, at most 4 mm apart
    expected = 1e-4 / (1e-4 + distances**2)
    np.testing.assert_allclose(cloud.likelihoods, expected, rtol=0.03)
    assert cloud.spreads is not None
    np.testing.assert_allclose(cloud.spreads, np.hypot(0.005, distances / np.sqrt(5.0)), rtol=0.03)


def test_what_is_less_likely_than_a_hundredth_is_dropped(robot: RobotModel) -> None:
    points = np.array([[0.05 + 0.098, 0.0, 0.0], [0.05 + 0.101, 0.0, 0.0]])
    cloud = seen(generator(evidence="proximity"), robot, 0.0, 0.0, points)
    assert len(cloud) == 1 and cloud.likelihoods[0] >= 0.01


def test_the_robot_is_no_object(robot: RobotModel) -> None:
    eye = generator(evidence="proximity")
    own = posed(robot).surface.points + np.random.default_rng(0).normal(0.0, 0.003, 3)
    assert not len(seen(eye, robot, 0.0, 0.0, own))


def test_a_camera_that_sees_nothing_has_looked_and_found_nothing(robot: RobotModel) -> None:
    for points in (np.empty((0, 3)), np.full((5, 3), np.nan), np.full((5, 3), 9.0)):
        assert len(seen(generator(), robot, 0.0, 0.0, points)) == 0


def test_after_a_reset_motion_is_found_anew(robot: RobotModel) -> None:
    eye = generator()
    pushed(eye, robot, lambda x: cube(x + 0.11))
    eye.reset()
    assert not len(seen(eye, robot, 0.8, 0.08, cube(0.19)))


def test_a_clock_that_jumps_back_is_no_motion(robot: RobotModel) -> None:
    eye = generator()
    pushed(eye, robot, lambda x: cube(x + 0.11))
    assert not len(seen(eye, robot, 0.0, 0.0, cube(0.11)))


def test_without_a_robot_it_says_so() -> None:
    reading = PointCloud(stamp=0.0, frame="base", points=cube(0.1))
    with pytest.raises(ConfigurationError, match="'eye' needs the robot"):
        generator().generate(reading, state(None))


def test_an_unknown_link_is_told(robot: RobotModel) -> None:
    with pytest.raises(RobotError, match="unknown link 'hnd': did you mean 'hand'"):
        seen(generator(links=("hnd",)), robot, 0.0, 0.0, cube(0.1))


def test_links_without_a_shape_are_named_in_a_sentence(robot: RobotModel) -> None:
    bare = [name for name in robot.link_names if name not in robot.parts]
    with pytest.raises(ConfigurationError, match="the links of 'eye' have no surface"):
        seen(generator(links=(bare[0],)), robot, 0.0, 0.0, cube(0.1))


def test_points_within_the_margin_of_the_robot_are_removed(robot: RobotModel) -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.065, 0.0, 0.0], [0.08, 0.0, 0.0]])
    kept = self_filtered(points, posed(robot), 0.015)
    assert kept[:, 0].tolist()[-1] == 0.08 and len(kept) <= 2


def test_nothing_is_no_cluster_and_no_warning(capfd: pytest.CaptureFixture[str]) -> None:
    assert clustered(np.empty((0, 3)), 0.02, 3) == []
    assert capfd.readouterr() == ("", "")


def test_clusters_are_chains_of_short_steps(tmp_path: Path) -> None:
    points = np.concatenate([cube(0.0), cube(0.2), np.array([[5.0, 5.0, 5.0]])])
    one, other = clustered(points, 0.02, 10)
    assert (len(one), len(other)) == (len(CUBE), len(CUBE))
    assert clustered(np.empty((0, 3)), 0.02, 10) == []


@pytest.mark.parametrize("way", [0.0, 0.004, 0.01])
def test_icp_measures_the_way(way: float) -> None:
    rng = np.random.default_rng(1)
    again = cube(way) + rng.uniform(-0.0015, 0.0015, CUBE.shape)
    assert moved_by(again, cube(0.0), 0.02) == pytest.approx(way, abs=1e-3)


def test_a_motion_that_nobody_can_see_is_none() -> None:
    rng, angles = np.random.default_rng(0), np.linspace(0.0, np.pi, 40)
    height, angle = np.meshgrid(np.linspace(0.0, 0.1, 25), angles)
    for turned, risen in ((0.15, 0.0), (0.0, 0.01), (0.0, 0.0)):  # about its axis, along its axis
        around = (angle + turned).ravel()
        cylinder = np.stack(
            [0.05 * np.cos(around), 0.05 * np.sin(around), height.ravel() + risen], axis=1
        )
        before = cylinder + 0.001 * rng.standard_normal(cylinder.shape)
        now = cylinder[::2] + 0.001 * rng.standard_normal(cylinder[::2].shape)
        assert moved_by(now, before, 0.02) < 0.002
    assert moved_by(now + [0.0, 0.01, 0.0], before, 0.02) == pytest.approx(0.01, abs=0.001)


def test_of_what_hardly_anything_was_near_no_motion_is_told() -> None:
    before = np.random.default_rng(0).uniform(0.0, 0.1, (50, 3))
    now = np.concatenate([before[:1] + 0.001, before[1:] + [1.0, 0.0, 0.0]])
    assert moved_by(now, before, 0.02) == 0.0


def test_what_nothing_was_near_has_not_moved() -> None:
    assert moved_by(cube(0.0), cube(3.0), 0.02) == 0.0
    assert moved_by(cube(0.0), np.empty((0, 3)), 0.02) == 0.0
