"""The readings of a skin around a base that points press; touches are made by hand."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.patches import PatchConfig, TaxelGridConfig
from contactfusion.robots.description import read_robot
from contactfusion_lab.scenes.push.config import SkinConfig
from contactfusion_lab.scenes.push.scene import BASE
from contactfusion_lab.scenes.push.sensors import PushSkin
from contactfusion_lab.scenes.push.world import Touches

PITCH = 0.05
FRONT, LEFT, RIGHT = slice(0, 12), slice(12, 26), slice(26, 40)
HUSH = 1e-12
"""So little noise that it is none."""
STEPS = 24
ON_FRONT, ON_LEFT, ON_RIGHT, ON_REAR, ON_TOP = (
    (-1.0, 0.0, 0.0),
    (0.0, -1.0, 0.0),
    (0.0, 1.0, 0.0),
    (1.0, 0.0, 0.0),
    (0.0, 0.0, -1.0),
)
"""Into the robot."""

Point = tuple[tuple[float, float, float], tuple[float, float, float], float]


@cache
def patch() -> PatchConfig:
    """The skin of the package's base: the front from right to left, the left side from front
    to back, the right side from back to front."""
    return read_robot(BASE).patches["skin"]


def touches(*points: Point, steps: int = STEPS) -> Touches:
    """Points that press in all steps: position, normal, force."""
    places, normals, forces = (np.array(column) for column in zip(*points, strict=True))
    count = len(points)
    return Touches(
        np.repeat(np.arange(steps, dtype=np.float64), count),
        np.tile(places, (steps, 1)),
        np.tile(normals, (steps, 1)),
        np.tile(forces, steps),
    )


def nothing() -> Touches:
    return Touches(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty(0))


def felt(
    pressed: Touches, activation: float = 0.0, noise: float = HUSH, seed: int = 0
) -> FloatArray:
    skin = PushSkin(patch(), SkinConfig(activation=activation, noise=noise))
    return skin.values(0.0, pressed, STEPS, np.random.default_rng(seed))


def only(values: FloatArray) -> dict[int, float]:
    """The taxels that are active."""
    return {int(row): float(values[row].round(9)) for row in np.flatnonzero(abs(values) > 1e-9)}


def front(y: float, force: float = 10.0, z: float = -0.2) -> Point:
    return (0.3, y, z), ON_FRONT, force


def test_a_point_over_a_taxel_presses_it_alone() -> None:
    assert only(felt(touches(front(0.025)))) == {6: 10.0}
    assert only(felt(touches(front(-0.275)))) == {0: 10.0}


def test_a_point_between_two_presses_the_nearer_more() -> None:
    assert only(felt(touches(front(0.0)))) == {5: 5.0, 6: 5.0}
    assert only(felt(touches(front(0.0125)))) == {5: 2.5, 6: 7.5}


@pytest.mark.parametrize(("y", "last"), [(0.275, 11), (0.3, 11), (0.31, 11), (-0.3, 0)])
def test_a_point_at_the_end_presses_the_last_taxel(y: float, last: int) -> None:
    assert only(felt(touches(front(y)))) == {last: 10.0}


@pytest.mark.parametrize("y", np.linspace(-0.27, 0.27, 7))
def test_the_mean_of_both_taxels_by_their_values_is_the_place(y: float) -> None:
    values = felt(touches(front(float(y))))
    assert values[FRONT].sum() == pytest.approx(10.0)
    middle = np.average(patch().centres(), axis=0, weights=abs(values))
    assert middle[:2] == pytest.approx([0.3, y])


def test_height_makes_no_difference() -> None:
    low, high = felt(touches(front(0.1, z=-0.39))), felt(touches(front(0.1, z=-0.06)))
    assert np.array_equal(low, high)


def test_points_add_up() -> None:
    values = felt(touches(front(0.025, 3.0), front(0.0, 4.0), front(-0.275, 6.0)))
    assert only(values) == {0: 6.0, 5: 2.0, 6: 5.0}


@pytest.mark.parametrize(
    ("place", "normal", "strip", "taxel"),
    [
        ((0.265, 0.3, -0.2), ON_LEFT, LEFT, 0),  # close to the front
        ((-0.385, 0.3, -0.2), ON_LEFT, LEFT, 13),
        ((0.265, -0.3, -0.2), ON_RIGHT, RIGHT, 13),
        ((-0.385, -0.3, -0.2), ON_RIGHT, RIGHT, 0),
    ],
)
def test_a_side_feels_what_presses_the_side(
    place: tuple[float, float, float],
    normal: tuple[float, float, float],
    strip: slice,
    taxel: int,
) -> None:
    values = felt(touches((place, normal, 7.0)))
    assert values[strip][taxel] == pytest.approx(7.0)
    assert abs(values).sum() == pytest.approx(7.0)
    assert patch().centres()[strip][taxel] == pytest.approx([*place[:2], -0.225])


@pytest.mark.parametrize("normal", [ON_REAR, ON_TOP])
def test_where_there_is_no_skin_nothing_is_felt(normal: tuple[float, float, float]) -> None:
    assert only(felt(touches(((-0.42, 0.0, -0.2), normal, 50.0)))) == {}


@pytest.mark.parametrize(("degrees", "strip"), [(40.0, FRONT), (50.0, LEFT)])
def test_at_a_corner_that_strip_feels_which_is_pressed_more_squarely(
    degrees: float, strip: slice
) -> None:
    yaw = np.radians(degrees)
    values = felt(touches(((0.3, 0.3, -0.2), (-np.cos(yaw), -np.sin(yaw), 0.0), 8.0)))
    assert values[strip].sum() == pytest.approx(8.0)
    assert abs(values).sum() == pytest.approx(8.0)


def test_a_taxel_measures_the_mean_of_the_cycle() -> None:
    """Whether it is pressed always, or four times as hard in a quarter of the steps."""
    often = felt(touches(front(0.025, 3.0)))
    rarely = felt(touches(front(0.025, 12.0), steps=STEPS // 4))
    assert only(often) == only(rarely) == {6: 3.0}


def test_what_is_under_the_activation_is_not_reported() -> None:
    pressed = touches(front(0.025, 0.99), front(-0.275, 1.01))
    assert only(felt(pressed, activation=1.0)) == {0: 1.01}
    split = touches(front(0.0, 1.5))  # each half of it is too faint
    assert only(felt(split, activation=1.0)) == {}


def test_every_taxel_has_its_noise_pressed_or_not() -> None:
    skin, rng = PushSkin(patch(), SkinConfig(noise=0.05)), np.random.default_rng(0)
    pressed = touches(front(0.025))
    many = np.array([skin.values(0.0, pressed, STEPS, rng) for _ in range(300)])
    expected = np.zeros(40)
    expected[6] = 10.0
    assert many.mean(axis=0) == pytest.approx(expected, abs=0.015)
    assert many.std(axis=0) == pytest.approx(np.full(40, 0.05), rel=0.25)


def test_noise_is_that_of_the_generator_of_chance() -> None:
    first, same = (felt(nothing(), noise=0.05, seed=3) for _ in range(2))
    assert np.array_equal(first, same)
    assert not np.array_equal(first, felt(nothing(), noise=0.05, seed=4))


def test_a_strip_may_have_a_single_taxel() -> None:
    upright: dict[str, Any] = {"xyz": (0.3, 0.0, 0.0), "rpy": (0.0, np.pi / 2.0, 0.0)}
    first = PatchConfig(grids=(TaxelGridConfig(rows=1, columns=1, pitch=(0.35, 0.6), **upright),))
    skin = PushSkin(first, SkinConfig(activation=0.0, noise=HUSH))
    values = skin.values(
        0.0, touches(front(-0.2), front(0.25, 1.0)), STEPS, np.random.default_rng(0)
    )
    assert only(values) == {0: 11.0}


@pytest.mark.parametrize(
    "fields",
    [
        {"places": [(0.3, 0.0, 0.0)], "size": (0.1, 0.1)},
        {"grid": {"rows": 1, "columns": 3, "pitch": (0.1, 0.1)}},
        {"grids": [{"rows": 2, "columns": 3, "pitch": (0.1, 0.1)}]},
    ],
)
def test_what_is_not_made_of_strips_is_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match="made of `grids` of one row each"):
        PushSkin(PatchConfig(**fields), SkinConfig())
