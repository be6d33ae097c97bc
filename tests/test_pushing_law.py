"""The law of reactive pushing gives what is computed by hand, and keeps its symmetries."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactfusion.controllers.pushing_law import (
    LIMIT,
    adaptive_rate,
    displacement,
    heading_error,
    limited,
    turn_rate,
    velocities,
    wrapped,
)

ANGLES = st.floats(-50.0, 50.0)
LATERALS = st.floats(-0.4, 0.4)
SPEEDS = st.floats(0.0, 2.0)


def test_the_way_that_is_left_starts_at_the_contact() -> None:
    """The robot at (1, 1) looks along y: what is ahead of it adds to y, what is left takes of x."""
    way = displacement(target=(3.0, 2.0), pose=(1.0, 1.0, math.pi / 2.0), contact=(0.3, 0.1))
    assert way == pytest.approx((3.0 - 0.9, 2.0 - 1.3))


@pytest.mark.parametrize(
    ("lateral", "rate"),
    [
        (0.12, 2.0 + 4.0),  # halfway at β
        (-0.12, -6.0),
        (0.12 + math.log(3.0) / 60.0, 2.0 + 8.0 * 0.75),  # 1/(1 + e^-ln3)
        (0.12 - math.log(3.0) / 60.0, 2.0 + 8.0 * 0.25),
        (50.0, 10.0),
        (0.0, 0.0),
    ],
)
def test_the_adaptive_rate(lateral: float, rate: float) -> None:
    assert adaptive_rate(lateral, eta=10.0, zeta=2.0, beta=0.12, k=60.0) == pytest.approx(rate)


def test_a_steep_rate_does_not_overflow() -> None:
    assert adaptive_rate(0.001, eta=10.0, zeta=0.0, beta=100.0, k=1e6) < 1e-300


def test_a_speed_is_shared() -> None:
    """A triangle of 3, 4 and 5."""
    assert velocities(0.05, 0.75) == pytest.approx((0.04, 0.03))


@pytest.mark.parametrize(
    ("way", "yaw", "error"),
    [
        ((0.0, 2.0), 0.0, math.pi / 2.0),
        ((1.0, 1.0), math.pi / 2.0, -math.pi / 4.0),
        ((math.cos(3.0), -math.sin(3.0)), 3.0, 2.0 * math.pi - 6.0),
        ((-1.0, 0.0), 0.0, math.pi),
    ],
)
def test_the_heading_error_is_the_shorter_way(
    way: tuple[float, float], yaw: float, error: float
) -> None:
    assert heading_error(way, yaw) == pytest.approx(error)


@pytest.mark.parametrize(
    ("error", "gain", "turn"),
    [
        (math.pi / 4.0, 1.0, 0.05 / 0.2),
        (-math.pi / 2.0, 0.5, -0.05 / 0.2),
        (math.pi / 3.0, 1.0, 0.05 * math.sqrt(3.0) / 0.2),
        (math.pi, 1.0, 0.05 * math.tan(LIMIT) / 0.2),  # tan π would be 0
        (math.radians(91.0), 1.0, 0.05 * math.tan(LIMIT) / 0.2),  # and this negative
    ],
)
def test_the_turn_rate(error: float, gain: float, turn: float) -> None:
    assert turn_rate(0.05, error, gain, length=0.2) == pytest.approx(turn)


@pytest.mark.parametrize(
    ("angle", "same"), [(math.pi, math.pi), (-math.pi, math.pi), (7.0, 7.0 - 2.0 * math.pi)]
)
def test_an_angle_is_wrapped(angle: float, same: float) -> None:
    assert wrapped(angle) == pytest.approx(same)


@given(ANGLES)
def test_a_wrapped_angle_is_the_same_within_half_a_turn(angle: float) -> None:
    assert -math.pi < wrapped(angle) <= math.pi
    assert math.cos(wrapped(angle)) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped(angle)) == pytest.approx(math.sin(angle), abs=1e-9)


@given(SPEEDS, st.floats(-100.0, 100.0))
def test_the_speed_is_kept_and_no_velocity_is_backward(speed: float, rate: float) -> None:
    ahead, aside = velocities(speed, rate)
    assert math.hypot(ahead, aside) == pytest.approx(speed)
    assert ahead >= 0.0


@given(LATERALS, st.floats(0.0, 20.0), st.floats(0.0, 1.0), st.floats(0.0, 0.3))
def test_the_robot_moves_to_the_side_of_the_contact(
    lateral: float, eta: float, part: float, beta: float
) -> None:
    """Towards the contact, so that this comes to the middle; never faster than η tells."""
    rate = adaptive_rate(lateral, eta, part * eta, beta, k=40.0)
    aside = velocities(1.0, rate)[1]
    assert aside * lateral >= 0.0
    assert abs(rate) <= eta * (1.0 + 1e-12)
    assert rate == -adaptive_rate(-lateral, eta, part * eta, beta, k=40.0)


@given(LATERALS, LATERALS)
def test_the_further_aside_the_higher_the_rate(one: float, other: float) -> None:
    nearer, further = sorted((abs(one), abs(other)))
    rates = [adaptive_rate(each, 10.0, 0.0, 0.12, 60.0) for each in (nearer, further)]
    assert rates[0] <= rates[1]


@given(SPEEDS, ANGLES, st.floats(0.01, 0.999), st.floats(0.01, 1.0))
def test_the_turn_is_bounded_to_the_side_of_the_target(
    speed: float, angle: float, gain: float, length: float
) -> None:
    error = wrapped(angle)
    turn = turn_rate(speed, error, gain, length)
    assert abs(turn) <= speed * math.tan(LIMIT) / length * (1.0 + 1e-12)
    assert turn * error >= 0.0
    assert turn == -turn_rate(speed, -error, gain, length)
    assert abs(limited(turn, 0.15)) <= 0.15


@given(*[st.floats(-5.0, 5.0)] * 4, ANGLES, LATERALS)
def test_a_mirrored_world_leaves_a_mirrored_way(
    target_x: float, target_y: float, x: float, y: float, yaw: float, lateral: float
) -> None:
    way = displacement((target_x, target_y), (x, y, yaw), (0.3, lateral))
    mirrored = displacement((target_x, -target_y), (x, -y, -yaw), (0.3, -lateral))
    assert mirrored == pytest.approx((way[0], -way[1]))
