"""What rays from the base meet, against geometry by hand."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.frames import PlanarPose
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.view import PushView
from lab.tests.test_push_world import base

HERE: PlanarPose = (-0.3, 0.0, 0.0)
"""The base whose front stands at x = 0."""
AHEAD: PlanarPose = (0.3, 0.0, 0.0)
"""An object whose middle is 0.6 m before the base's origin."""
DOWN, FORWARD, UP = (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
TOP, CHASSIS, FLOOR = 0.35, -0.05, -0.45
"""How high a box of 0.8 m, the chassis and the floor lie in the base's frame [m]."""
REAR, FRONT = -0.42, 0.30


def view(name: Any = "box") -> PushView:
    return PushView(PushConfig(object=name, target=(1.0, 0.0)).object, base())


def met(
    origin: tuple[float, float, float],
    *directions: tuple[float, float, float],
    robot: PlanarPose = HERE,
    pose: PlanarPose = AHEAD,
    what: Any = "box",
) -> tuple[FloatArray, NDArray[np.bool_]]:
    seen = view(what)
    rays = seen.rays(np.array(origin), np.array(directions, np.float64))
    return seen.distances(rays, robot, pose)


@pytest.mark.parametrize(
    ("x", "y", "height", "of_object"),
    [
        (0.6, 0.0, TOP, True),
        (0.41, 0.19, TOP, True),
        (0.39, 0.0, FLOOR, False),
        (0.6, 0.21, FLOOR, False),
        (0.0, 0.0, CHASSIS, False),
        (FRONT - 0.01, -0.29, CHASSIS, False),
        (FRONT + 0.01, 0.0, FLOOR, False),
        (REAR + 0.01, 0.29, CHASSIS, False),
        (REAR - 0.01, 0.0, FLOOR, False),
    ],
)
def test_a_ray_straight_down_ends_on_the_first_object_below(
    x: float, y: float, height: float, of_object: bool
) -> None:
    (distance,), (found,) = met((x, y, 1.1), DOWN)
    assert distance == pytest.approx(1.1 - height, abs=1e-6)
    assert found == of_object


def test_a_ray_forward_ends_on_the_face_of_a_box() -> None:
    distances, found = met((0.31, 0.0, 0.0), FORWARD, (1.0, 1.0, 0.0), UP)
    assert distances[0] == pytest.approx(0.4 - 0.31, abs=1e-6)
    # aslant it leaves the base by as much as it goes aside
    assert distances[1] == pytest.approx(0.4 - 0.31, abs=1e-6)
    assert distances[2] == np.inf
    assert found.tolist() == [True, True, False]


def test_a_distance_counts_in_lengths_of_its_direction() -> None:
    counted, found = met((0.6, 0.0, 1.1), DOWN, (0.0, 0.0, -0.5), (0.0, 0.0, -3.0))
    assert counted == pytest.approx(np.array([0.75, 1.5, 0.25]), abs=1e-6)
    floor, _ = met((0.6, 0.9, 1.1), DOWN, (0.0, 0.0, -0.5), (0.0, 0.0, -3.0))
    assert floor == pytest.approx(np.array([1.55, 3.1, 1.55 / 3.0]))
    assert found.all()


def test_the_chassis_hides_what_is_behind_it() -> None:
    distances, found = met((-0.6, 0.0, -0.2), FORWARD, robot=HERE)
    assert (distances[0], found[0]) == (pytest.approx(REAR + 0.6), False)
    above, free = met((-0.6, 0.0, 0.0), FORWARD)
    assert (above[0], free[0]) == (pytest.approx(0.4 + 0.6), True)
    # what looks down on the front's edge from behind sees nothing at its foot
    aslant, seen = met((0.2, 0.0, 0.1), (0.1, 0.0, -0.2))
    assert (aslant[0], seen[0]) == (pytest.approx((0.1 - CHASSIS) / 0.2), False)


def test_the_box_hides_the_floor_behind_it() -> None:
    # from above the front over the far edge of the top, and just under it
    origin, edge = (0.35, 0.0, 0.85), np.array([0.8, 0.0, TOP])
    over = edge + [0.02, 0.0, 0.0] - origin
    onto = edge - [0.02, 0.0, 0.0] - origin
    distances, found = met(origin, tuple(over.tolist()), tuple(onto.tolist()))
    assert found.tolist() == [False, True]
    assert distances == pytest.approx(np.array([(0.85 - FLOOR) / (0.85 - TOP), 1.0]), abs=1e-6)


def test_a_turned_box_turns_its_corner_to_the_base() -> None:
    corner = 0.6 - 0.2 * np.sqrt(2.0)
    beside_origin: tuple[float, float, float] = (0.3, 0.05, 0.0)
    origin: tuple[float, float, float] = (0.3, 0.0, 0.0)
    turned: PlanarPose = (0.3, 0.0, np.pi / 4.0)
    (straight,), _ = met(origin, FORWARD, pose=turned)
    (beside,), _ = met(beside_origin, FORWARD, pose=turned)
    assert straight == pytest.approx(corner - 0.3, abs=1e-6)
    assert beside == pytest.approx(corner + 0.05 - 0.3, abs=1e-6)


def test_a_base_that_has_turned_looks_where_it_turned_to() -> None:
    # it stands at (1, 2) and looks along y, where the box stands 0.6 m ahead and 0.1 m to the right
    there: PlanarPose = (1.0, 2.0, np.pi / 2.0)
    box: PlanarPose = (1.1, 2.6, np.pi / 2.0)
    distances, found = met((0.35, 0.09, 0.0), FORWARD, robot=there, pose=box)
    assert (distances[0], found[0]) == (pytest.approx(0.05, abs=1e-6), True)
    passed, free = met((0.35, 0.11, 0.0), FORWARD, robot=there, pose=box)
    assert (passed[0], free[0]) == (np.inf, False)


@pytest.mark.parametrize("what", ["box", "cylinder", "nonuniform"])
def test_only_where_the_object_is_to_the_base_counts(what: str) -> None:
    rng = np.random.default_rng(5)
    seen = view(what)
    directions = np.concatenate([rng.uniform(-0.5, 0.5, (200, 2)), np.full((200, 1), -1.0)], axis=1)
    rays = seen.rays(np.array([0.4, 0.1, 0.9]), directions)
    before = seen.distances(rays, (0.0, 0.0, 0.0), (0.55, 0.1, 0.3))
    x, y, yaw = 1.5, -2.0, 2.5
    cos, sin = np.cos(yaw), np.sin(yaw)
    moved: PlanarPose = (x + cos * 0.55 - sin * 0.1, y + sin * 0.55 + cos * 0.1, yaw + 0.3)
    after = seen.distances(rays, (x, y, yaw), moved)
    assert after[0] == pytest.approx(before[0], abs=1e-5)
    assert np.mean(after[1] == before[1]) > 0.99  # a ray on an edge may go either way
    assert 20 < np.count_nonzero(before[1]) < 180


def test_a_compound_is_as_high_as_each_of_its_pieces() -> None:
    # a cylinder 0.3 m high stands on the rear left corner of a box 0.6 m high
    (low,), _ = met((0.6 - 0.125, -0.125, 1.1), DOWN, what="nonuniform")
    (high,), _ = met((0.6 + 0.125, 0.125, 1.1), DOWN, what="nonuniform")
    assert low == pytest.approx(1.55 - 0.6, abs=1e-6)
    assert high == pytest.approx(1.55 - 0.9, abs=1e-6)


def test_a_cylinder_is_round() -> None:
    # faceted, it lies a little within its radius of 0.25 m
    for y in (0.0, 0.1, 0.2):
        (distance,), _ = met((0.3, y, 0.0), FORWARD, what="cylinder")
        assert distance == pytest.approx(0.3 - np.sqrt(0.25**2 - y**2), abs=2e-3)
