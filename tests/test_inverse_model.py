"""The inverse model learns from where pushes work."""

import math
from typing import Any

import pytest

from contactfusion.controllers.face import FaceContact
from contactfusion.controllers.inverse_model import InverseModel, InverseModelConfig
from contactfusion.controllers.pushing import Decision

TOUCH = FaceContact(0.0, "point", 0.0, 0.0, 0.8)
AHEAD = 0.3


def model(**options: Any) -> InverseModel:
    return InverseModel(
        InverseModelConfig.model_validate(
            {"target": (9.0, 0.0), "spread": math.pi / 3.0, **options}
        )
    )


def pushed(one: InverseModel, headings: list[float], stride: float = 0.05) -> list[Decision]:
    """Let the contact move in these directions [rad], while the robot looks along x."""
    x = y = 0.0
    taken = [one.decide(TOUCH, (x, y, 0.0), 0.0)]
    for heading in headings:
        x, y = x + stride * math.cos(heading), y + stride * math.sin(heading)
        taken.append(one.decide(TOUCH, (x, y, 0.0), 0.0))
    return taken


def direction(decision: Decision) -> float:
    return math.atan2(decision.lateral, decision.forward)


def test_straight_behind_the_object_it_pushes() -> None:
    decision = model().decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    assert decision.mode == "push"
    assert direction(decision) == pytest.approx(0.0)
    assert decision.forward == model().options.fastest


def test_push_and_relocate_are_blended_by_the_gaussian() -> None:
    """The target straight to the left: the object lies 90° to the right of it, cos α = 0."""
    beside = model(target=(AHEAD, 2.0)).decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    assert beside.mode == "relocate"
    assert direction(beside) == pytest.approx(-math.pi / 2.0)
    # 30° to the left the Gaussian gives exp(-30²/(2 · 60²)) = 0.88: cos 30° = 0.87 is the limit
    slanted = model(target=(AHEAD + 2.0 * math.cos(math.pi / 6.0), 1.0))
    push = math.cos(math.pi / 6.0)
    assert math.exp(-1.0 / 8.0) > push
    decision = slanted.decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    assert direction(decision) == pytest.approx(-math.acos(push))
    # a narrower one gives 0.61
    narrow = model(target=slanted.options.target, spread=math.pi / 6.0)
    push = math.exp(-0.5)
    decision = narrow.decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    assert direction(decision) == pytest.approx(-math.acos(push))


def test_in_front_of_the_object_it_goes_round() -> None:
    decision = model(target=(-3.0, 0.5)).decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    assert decision.mode == "relocate"
    assert abs(direction(decision)) == pytest.approx(math.pi / 2.0)


def test_a_push_that_went_better_than_the_last_draws_the_mean() -> None:
    """The object lies 10° off the way, and goes more and more as it should."""
    off = math.radians(10.0)
    target = (AHEAD + 100.0 * math.cos(off), 100.0 * math.sin(off))
    one = model(target=target, prior=1.0)
    pushed(one, [off + 0.3, off + 0.2, off + 0.1])
    better = one.decide(TOUCH, (0.0, 0.0, 0.0), 0.0).reason
    other = model(target=target, prior=1.0)
    pushed(other, [off + 0.1, off + 0.2, off + 0.3])  # only the first was better than nothing known
    worse = other.decide(TOUCH, (0.0, 0.0, 0.0), 0.0).reason
    # from 0 by a prior of 1: after three pushes at -10° the mean is -7.5°, after one it is -5°
    assert "best -8 ±" in better or "best -7 ±" in better
    assert "best -5 ±" in worse


def test_much_prior_learns_slowly() -> None:
    off = math.radians(10.0)
    one = model(target=(AHEAD + 100.0 * math.cos(off), 100.0 * math.sin(off)))
    pushed(one, [off + 0.3, off + 0.2, off + 0.1])
    assert "best -0 ± 59°" in one.decide(TOUCH, (0.0, 0.0, 0.0), 0.0).reason


def test_it_turns_against_the_error_and_slows_down() -> None:
    """An object that goes off to the left is pushed from further left."""
    one = model(error_gain=0.5, bias_gain=0.0)
    last = pushed(one, [0.4])[-1]
    way = math.atan2(-0.05 * math.sin(0.4), 8.7 - 0.05 * math.cos(0.4))
    without = pushed(model(error_gain=0.0, bias_gain=0.0), [0.4])[-1]
    assert direction(last) - direction(without) == pytest.approx(0.5 * 0.4)
    assert math.hypot(last.forward, last.lateral) == pytest.approx(one.options.fastest / 1.4)
    assert way < 0.0


def test_what_hardly_moved_teaches_nothing() -> None:
    still, moved = model(prior=1.0), model(prior=1.0)
    decisions = [
        pushed(one, [1.0, 0.0], stride)[-1] for one, stride in ((still, 0.005), (moved, 0.05))
    ]
    speeds = [math.hypot(one.forward, one.lateral) for one in decisions]
    assert speeds[0] == pytest.approx(still.options.fastest)
    assert speeds[1] < speeds[0]


def test_out_of_contact_it_goes_to_where_the_object_was() -> None:
    one = model()
    one.decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    decision = one.decide(None, (0.55, -1.0, 0.0), 0.1)
    assert decision.mode == "return"
    assert direction(decision) == pytest.approx(math.pi / 2.0)
    assert decision.yaw_rate > 0.0


def test_a_jump_while_out_of_contact_teaches_nothing() -> None:
    one = model(prior=1.0)
    one.decide(TOUCH, (0.0, 0.0, 0.0), 0.0)
    one.decide(None, (0.5, 0.5, 0.0), 0.1)
    decision = one.decide(TOUCH, (0.5, 0.5, 0.0), 0.2)
    assert math.hypot(decision.forward, decision.lateral) == pytest.approx(one.options.fastest)
