"""The dipole field leads behind the object, and then to the goal."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from contactfusion.controllers.dipole_field import DipoleField, DipoleFieldConfig, dipole
from contactfusion.controllers.face import FaceContact
from contactfusion.controllers.pushing import ARRIVED
from contactfusion.controllers.pushing_law import wrapped

TOUCH = FaceContact(0.0, "point", 0.0, 0.0, 0.8)


def field(**options: Any) -> DipoleField:
    return DipoleField(DipoleFieldConfig.model_validate({"target": (2.0, 0.0), **options}))


@pytest.mark.parametrize(
    ("theta", "direction", "pushing"),
    [
        (math.pi, 0.0, True),  # behind the object: with it to the goal
        (math.pi / 2.0, math.pi, True),  # beside it: backwards
        (0.75 * math.pi, -math.pi / 2.0, True),  # between: across
        (math.pi / 4.0, 0.75 * math.pi, False),  # before it: round it, not away along 2 θ
        (0.0, math.pi / 2.0, False),  # right before it: to one side
    ],
)
def test_the_directions_of_the_dipole(theta: float, direction: float, pushing: bool) -> None:
    angle, leads = dipole(theta)
    assert math.cos(angle - direction) == pytest.approx(1.0)
    assert leads == pushing or theta == math.pi / 2.0  # there the field grazes the object


@given(st.floats(0.51 * math.pi, math.pi), st.sampled_from([-1.0, 1.0]))
def test_behind_the_object_the_field_is_that_of_a_dipole(theta: float, side: float) -> None:
    """E of a dipole p at the origin, in the plane, at r: (2 (p·r) r - |r|² p) / |r|⁴."""
    place, moment = np.array([math.cos(theta), side * math.sin(theta)]), np.array([1.0, 0.0])
    along, across = 2.0 * (moment @ place) * place - moment
    angle, leads = dipole(side * theta)
    assert (math.cos(angle), math.sin(angle)) == pytest.approx((along, across), abs=1e-9)
    assert leads


@given(st.floats(-math.pi, math.pi), st.floats(1.0, 10.0))
def test_no_direction_leads_away_from_the_object(theta: float, a: float) -> None:
    angle, _ = dipole(theta, a)
    assert math.cos(angle - theta) < 1e-6


@given(st.floats(0.01, math.pi - 0.01), st.floats(1.0, 10.0))
def test_the_field_is_the_same_on_both_sides(theta: float, a: float) -> None:
    assert wrapped(dipole(-theta, a)[0] + dipole(theta, a)[0]) == pytest.approx(0.0, abs=1e-6)


@given(st.floats(0.6 * math.pi, 0.999 * math.pi), st.floats(1.0, 5.0), st.floats(1.1, 2.0))
def test_more_strength_across_turns_further_from_the_goal(
    theta: float, a: float, factor: float
) -> None:
    assert math.cos(dipole(theta, a * factor)[0]) < math.cos(dipole(theta, a)[0])


def test_it_pushes_straight_what_lies_straight_ahead() -> None:
    decision = field().decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    assert (decision.lateral, decision.yaw_rate) == pytest.approx((0.0, 0.0))
    assert decision.forward == field().options.fastest


def test_with_the_target_to_the_left_it_goes_to_the_right() -> None:
    """The object lies at (0.55, 0), the way of the contact goes to the left: θ = -90°."""
    decision = field(target=(0.3, 2.0)).decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    assert decision.lateral < -0.9 * field().options.fastest
    assert "-90°" in decision.reason or "+90°" in decision.reason


def test_with_the_target_behind_it_goes_round() -> None:
    decision = field(target=(-2.0, 0.1)).decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    assert decision.mode == "orbit"
    assert decision.forward == pytest.approx(0.0, abs=1e-6)
    assert abs(decision.lateral) == pytest.approx(field().options.fastest)


def test_the_face_turns_to_the_object() -> None:
    """The contact at l = 0.2 is believed to have the object at (0.55, 0.2)."""
    touch = FaceContact(0.2, "point", 0.2, 0.2, 0.8)
    decision = field(turn_gain=0.5).decide(touch, (0.0, 0.0, 0.0), 0.0)
    assert decision.yaw_rate == pytest.approx(0.5 * math.atan2(0.2, 0.55))


def test_a_lost_object_stays_where_it_was() -> None:
    one = field(turn_gain=1.0)
    one.decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    decision = one.decide(None, (0.55, -1.0, 0.0), 0.1)  # the object is a metre to the left
    assert decision.yaw_rate == one.options.fastest_turn
    assert decision.reason.endswith("contact lost")


def test_a_lost_object_is_not_where_the_face_has_passed() -> None:
    """Else the robot would turn round to nothing, once it stands where it believed the object."""
    one = field()
    one.decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    decision = one.decide(None, (1.0, 0.0, 0.0), 5.0)
    assert decision.yaw_rate == pytest.approx(0.0)
    assert decision.forward > 0.0


def test_it_holds_still_after_arrival() -> None:
    one = field()
    assert one.decide(TOUCH, (1.7, 0.0, 0.0), 0.0).mode == ARRIVED
    later = one.decide(None, (1.7, 0.0, 0.0), 0.1)
    assert (later.mode, later.forward, later.lateral, later.yaw_rate) == (ARRIVED, 0.0, 0.0, 0.0)
    one.reset()
    assert one.decide(None, (1.7, 0.0, 0.0), 0.2).mode == "approach"


def test_a_slowest_speed_above_the_fastest_is_refused() -> None:
    with pytest.raises(ValidationError, match="may not be above `fastest`"):
        field(slowest=0.2, fastest=0.1)
