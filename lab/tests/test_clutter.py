"""Clutter stands behind and beside an object, and leaves the robot's path free."""

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.frames import inverse, points_in
from contactfusion.robots.objects import ObjectModel
from contactfusion.shapes import ShapeConfig
from contactfusion_lab.scenes.clutter import CLEAR, clutter, swept
from lab.tests.test_as_built import arm
from tests.urdfs import outside_of_all

MIDDLE = np.array([0.7, 0.1, 0.35])
CORNERS = MIDDLE + np.stack(
    np.meshgrid([-0.04, 0.04], [-0.05, 0.05], [-0.1, 0.1]), axis=-1
).reshape(-1, 3)


def tube(out: float) -> FloatArray:
    """A thick path that leads to the object from afar."""
    along = np.linspace(0.05, 0.7, 60)[:, None] * [np.cos(out), np.sin(out), 0.4]
    around = np.random.default_rng(0).uniform(-0.08, 0.08, (40, 3))
    return np.reshape(MIDDLE + along[:, None] + around, (-1, 3))


def standing(seed: int, out: float, free: FloatArray | None = None) -> list[ObjectModel]:
    points = tube(out) if free is None else free
    return clutter("base", CORNERS, out, points, np.random.default_rng(seed))


def only(model: ObjectModel) -> ShapeConfig:
    (shape,) = model.shapes
    assert isinstance(shape, ShapeConfig)
    return shape


def test_there_are_a_wall_a_leg_and_one_or_two_bodies() -> None:
    counts = [len(standing(seed, np.pi)) for seed in range(40)]
    assert set(counts) == {3, 4}
    kinds = {only(body).shape for seed in range(40) for body in standing(seed, np.pi)[2:]}
    assert kinds == {"box", "cylinder"}


@pytest.mark.parametrize("out", [np.pi, 1.8, 4.5, 0.0])
def test_nothing_stands_in_the_path_or_in_the_object(out: float) -> None:
    free = np.concatenate([tube(out), CORNERS])
    for seed in range(20):
        for body in standing(seed, out):
            local = points_in(inverse(body.config.pose.pose()), free)
            assert outside_of_all(body.shapes, local).min() > CLEAR - 1e-9


@pytest.mark.parametrize("out", [np.pi, 1.8, 4.5, 0.0])
def test_each_stands_where_it_should(out: float) -> None:
    behind = -np.array([np.cos(out), np.sin(out)])
    for seed in range(20):
        wall, leg, *others = standing(seed, out)
        nearest = (np.array(wall.config.pose.xyz)[:2] - MIDDLE[:2]) @ behind - 0.02
        assert 0.3 <= nearest <= 0.6
        turn = wall.config.pose.pose()[:2, 0]
        assert abs(turn @ behind) == pytest.approx(1.0)
        place = np.array(leg.config.pose.xyz)
        away = place[:2] - MIDDLE[:2]
        assert 0.6 <= np.linalg.norm(away) <= 0.9 and abs(away @ behind) < 0.32
        assert place[2] == pytest.approx((only(leg).length or 0.0) / 2.0)
        for body in others:
            near = outside_of_all(body.shapes, points_in(inverse(body.config.pose.pose()), CORNERS))
            assert 0.04 < near.min() < 0.3
            shape = only(body)
            height = shape.size[2] if shape.size else shape.length or 0.0
            assert body.config.pose.xyz[2] - height / 2.0 == pytest.approx(0.25)


def test_a_wall_stands_behind_whatever_of_the_robot_lies_beyond_the_object() -> None:
    free = np.array([[1.9, 0.0, 0.5]])
    wall, *_ = standing(0, np.pi, free)
    assert wall.config.pose.xyz[0] - 0.02 == pytest.approx(1.9 + CLEAR)


def test_a_body_that_finds_no_place_is_left_out() -> None:
    rng = np.random.default_rng(1)
    full = np.column_stack([rng.uniform(-1.0, 2.0, (40000, 2)), np.full(40000, 0.3)])
    assert len(standing(0, np.pi, full)) == 1


def test_the_same_draws_give_the_same_clutter() -> None:
    one, same, other = (
        [body.config.pose.xyz for body in standing(seed, np.pi)] for seed in (5, 5, 6)
    )
    assert one == same != other


def test_a_robot_sweeps_its_surface_and_its_cameras() -> None:
    robot = arm()
    start, end = np.zeros(len(robot.joint_names)), np.full(len(robot.joint_names), 0.2)
    points = swept(robot, [start, end])
    count = sum(len(part.points) for part in robot.parts.values()) + len(robot.config.cameras)
    assert len(points) == 2 * count
    assert np.abs(points - [-0.3, 0.0, 1.25]).sum(axis=1).min() < 1e-9
    palm = points_in(robot.poses_at(end)["palm"], robot.parts["palm"].points)
    assert np.linalg.norm(points - palm[0], axis=1).min() < 1e-9
