"""Reactive pushing: what it decides follows from where the object touches, and for how long not."""

import math
from collections.abc import Callable, Iterable
from itertools import groupby
from typing import Any

import pytest

from contactfusion.controllers.face import FaceContact
from contactfusion.controllers.pushing import ARRIVED, Decision
from contactfusion.controllers.pushing_law import place_of
from contactfusion.controllers.pushing_parameters import SETS, PushingParameters
from contactfusion.controllers.reactive_pushing import ReactivePushing, ReactivePushingConfig
from contactfusion.frames import PlanarPose

FAR = (5.0, 0.0)
ORIGIN = (0.0, 0.0, 0.0)
PERIOD = 0.1
PAPER, TUNED = SETS["paper"], SETS["tuned"]
REALIGN, SEARCH, ESCAPE = TUNED.realign, TUNED.search, TUNED.escape
assert REALIGN is not None and REALIGN.turning is not None
assert SEARCH is not None and ESCAPE is not None
SHARP: dict[str, Any] = {"like": "tuned", "smoothing": 0.0}
"""The tuned set without its low-pass."""
SEARCH_FIELDS = SEARCH.model_dump()
ASIDE = (TUNED.beta + REALIGN.enter) / 2.0
"""So far aside the tuned set moves sideways, and does not realign [m]."""

Script = Callable[[int, PlanarPose], tuple[FaceContact | None, float]]
"""What touches the face in a cycle, and which side of the robot."""


def pusher(parameters: Any = "tuned", target: tuple[float, float] = FAR) -> ReactivePushing:
    fields: dict[str, Any] = {"target": target, "parameters": parameters}
    return ReactivePushing(ReactivePushingConfig(**fields))


def at(lateral: float) -> FaceContact:
    return FaceContact(lateral, "point", lateral, lateral, 0.9)


def decided(
    one: ReactivePushing, laterals: Iterable[float | None], pose: PlanarPose = ORIGIN
) -> list[Decision]:
    """Touch at these places, one a cycle, while the robot stands still."""
    return [
        one.decide(None if lateral is None else at(lateral), pose, PERIOD * cycle)
        for cycle, lateral in enumerate(laterals)
    ]


def driven(
    one: ReactivePushing, script: Script, cycles: range, start: PlanarPose = ORIGIN
) -> list[tuple[PlanarPose, Decision]]:
    """Move as decided."""
    pose, told = start, []
    for cycle in cycles:
        touch, side = script(cycle, pose)
        decision = one.decide(touch, pose, PERIOD * cycle, side)
        told.append((pose, decision))
        heading = pose[2] + decision.yaw_rate * PERIOD / 2.0
        way = PERIOD * decision.forward, PERIOD * decision.lateral
        x, y = place_of(way, (pose[0], pose[1], heading))
        pose = x, y, pose[2] + PERIOD * decision.yaw_rate
    return told


def modes(told: Iterable[Decision]) -> list[str]:
    """Give the modes in their order, each as often as it begins."""
    return [mode for mode, _ in groupby(told, key=lambda decision: decision.mode)]


def numbers(decision: Decision) -> tuple[float, float, float]:
    return decision.forward, decision.lateral, decision.yaw_rate


# Before and at contact


@pytest.mark.parametrize(("name", "speed"), [("paper", 0.05), ("tuned", SEARCH.speed)])
def test_without_any_contact_it_approaches_straight_for_ever(name: str, speed: float) -> None:
    one = pusher(name)
    for now in (0.0, 1.0, 1e4):
        decision = one.decide(None, (0.1, 0.2, 0.7), now)
        assert (numbers(decision), decision.mode) == ((speed, 0.0, 0.0), "approach")


@pytest.mark.parametrize(("distance", "speed"), [(5.0, 0.05), (0.45, 0.045), (0.1, 0.01)])
def test_the_paper_s_robot_slows_down_before_the_target(distance: float, speed: float) -> None:
    (decision,) = decided(pusher("paper", (0.3 + distance, 0.0)), [0.0])
    assert numbers(decision) == pytest.approx((speed, 0.0, 0.0))
    assert decision.mode == "push"


def test_the_tuned_robot_is_never_slower_than_its_slowest() -> None:
    (decision,) = decided(pusher("tuned", (0.36, 0.0)), [0.0])
    assert decision.forward == TUNED.slowest


def test_a_contact_aside_is_followed_at_the_same_speed() -> None:
    """At l = β the rate is half of η: 5 aside for 1 ahead; ω follows from what goes ahead."""
    (decision,) = decided(pusher("paper"), [0.12])
    ahead = 0.05 / math.sqrt(26.0)
    error = math.atan2(-0.12, 4.7)
    turn = ahead * math.tan(error) / 0.2
    assert numbers(decision) == pytest.approx((ahead, 5.0 * ahead, turn))


def test_near_the_target_there_is_no_lateral_motion() -> None:
    near, far = (
        decided(pusher("paper", (0.3 + distance, 0.1)), [0.1])[0] for distance in (0.49, 0.51)
    )
    assert near.lateral == 0.0 and far.lateral > 0.01


@pytest.mark.parametrize("name", ["paper_realign_only", "tuned_neither"])
def test_a_set_without_lateral_motion_has_none(name: str) -> None:
    assert decided(pusher(name), [0.1])[0].lateral == 0.0


# Realignment


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("parameters", "enter", "leave"),
    [("paper", 0.24, 0.12), (SHARP, REALIGN.enter, REALIGN.leave)],
)
def test_realignment_begins_far_aside_and_ends_near_the_middle(
    parameters: Any, enter: float, leave: float, side: float
) -> None:
    steps = [
        (0.0, "push"),
        (enter - 0.01, "push"),
        (enter + 0.01, "realign"),
        (enter - 0.01, "realign"),
        (leave + 0.01, "realign"),
        (leave - 0.01, "push"),
        (leave + 0.01, "push"),
        (enter + 0.01, "realign"),
        (-enter, "realign"),  # it may change sides
        (0.0, "push"),
    ]
    told = decided(pusher(parameters), [side * lateral for lateral, _ in steps])
    assert [decision.mode for decision in told] == [mode for _, mode in steps]
    assert [math.copysign(1.0, told[row].lateral) * side for row in (2, 4, 8)] == [1.0, 1.0, -1.0]


def test_while_realigning_it_moves_mostly_aside_and_hardly_turns() -> None:
    """Of the tuned set a share of the turn is left; of the paper's 1 - |l|/l_cr, or nothing."""
    assert REALIGN is not None and REALIGN.turning is not None
    changed = {**SHARP, "settle": 0.0, "length": 1.0, "slowest": 0.0}
    (tuned,) = decided(pusher(changed, (0.6, 0.6)), [0.3])
    speed = TUNED.speed_gain * math.hypot(0.3, 0.3)
    ahead = speed / math.hypot(1.0, REALIGN.rate)
    turn = REALIGN.turning * speed * math.tan(TUNED.heading_gain * math.pi / 4.0)
    assert numbers(tuned) == pytest.approx((ahead, REALIGN.rate * ahead, turn))
    first, second = decided(pusher("paper", (5.0, 0.5)), [0.25, 0.18])
    assert first.yaw_rate == 0.0
    error = math.atan2(0.5 - 0.18, 4.7)
    assert second.yaw_rate == pytest.approx(0.25 * 0.05 * math.tan(error) / 0.2)


@pytest.mark.parametrize("name", ["paper_lateral_only", "tuned_neither"])
def test_a_set_without_realignment_never_realigns(name: str) -> None:
    assert set(modes(decided(pusher(name), [0.0, 0.29, -0.33]))) == {"push"}


# Turning


@pytest.mark.parametrize("name", ["paper", "tuned"])
@pytest.mark.parametrize("y", [3.0, -3.0])
def test_the_turn_is_limited(name: str, y: float) -> None:
    (decision,) = decided(pusher(name, (0.3, y)), [0.0])
    assert decision.yaw_rate == math.copysign(SETS[name].fastest_turn, y)


@pytest.mark.parametrize(("part", "share"), [(1.1, 1.0), (1.0, 1.0), (0.5, 0.5), (0.1, 0.1)])
def test_the_greatest_turn_falls_when_the_target_is_near(part: float, share: float) -> None:
    (decision,) = decided(pusher("tuned", (0.3, part * TUNED.settle)), [0.0])
    assert decision.yaw_rate == pytest.approx(share * TUNED.fastest_turn)


def test_the_contact_is_smoothed() -> None:
    """By a low-pass, but for the first contact, which is taken as it is."""
    told = decided(pusher("tuned"), [0.2, 0.0])
    expected = 0.2 * math.exp(-PERIOD / TUNED.smoothing)
    assert numbers(told[1]) == pytest.approx(numbers(decided(pusher("tuned"), [expected])[0]))


# Arrival


@pytest.mark.parametrize("name", ["paper", "tuned"])
def test_having_arrived_it_stands_still_for_ever(name: str) -> None:
    """Whatever is touched then, or no longer touched; until it is reset."""
    one = pusher(name, (0.3, 0.1))
    (decision,) = decided(one, [0.1 + 0.9 * SETS[name].arrival])
    assert (numbers(decision), decision.mode) == ((0.0, 0.0, 0.0), ARRIVED)
    for touch, pose, now in ((None, ORIGIN, 5.0), (at(-0.3), (2.0, 1.0, 1.0), 900.0)):
        decision = one.decide(touch, pose, now)
        assert (numbers(decision), decision.mode) == ((0.0, 0.0, 0.0), ARRIVED)
    one.reset()
    assert one.decide(None, ORIGIN, 901.0).mode == "approach"


def test_arrival_is_judged_by_the_contact_as_it_is_not_smoothed() -> None:
    slow: dict[str, Any] = {"like": "tuned", "smoothing": 100.0}
    told = decided(pusher(slow, (0.3, 0.0)), [0.2, 0.0])
    assert modes(told) == ["push", ARRIVED]
    told = decided(pusher(slow, (0.3, 0.2)), [0.1, 0.3])
    assert modes(told) == ["push"]


# A contact that is lost


def test_for_a_while_the_last_contact_counts() -> None:
    one = pusher({**SHARP, "search": {**SEARCH_FIELDS, "patience": 0.35}})
    held, *lost = decided(one, [ASIDE] + [None] * 6)
    assert [decision.mode for decision in lost] == ["push"] * 3 + ["search"] * 3
    for decision in lost[:3]:
        assert numbers(decision) == numbers(held)
        assert "lost" in decision.reason and "lost" not in held.reason


def test_the_paper_s_robot_goes_by_the_last_contact_for_ever() -> None:
    """It never searches, and without any progress it never escapes."""
    one = pusher("paper")
    held = one.decide(at(0.15), ORIGIN, 0.0)
    for now in (1.0, 100.0, 1e4):
        assert numbers(one.decide(None, ORIGIN, now)) == numbers(held)
    touched = [one.decide(at(0.0), ORIGIN, 1e4 + PERIOD * cycle) for cycle in range(600)]
    assert modes(touched) == ["push"]


def test_a_touch_ends_a_search_and_the_next_begins_anew() -> None:
    def script(cycle: int, pose: PlanarPose) -> tuple[FaceContact | None, float]:
        return (at(ASIDE) if cycle in (0, 150) else None), 0.0

    told = [decision for _, decision in driven(pusher(SHARP), script, range(180))]
    assert modes(told) == ["push", "search"] * 2
    tries = [one.reason.split(", ")[-1] for one in told if one.mode == "search"]
    assert [number for number, _ in groupby(tries)][:2] == ["try 1", "try 2"]
    assert tries[-1] == "try 1"
    assert told[150].mode == "push"


def test_a_search_finds_what_stayed_where_it_was() -> None:
    """The object is a post; the robot had turned away from it."""
    post = (0.4, 0.25)

    def script(cycle: int, pose: PlanarPose) -> tuple[FaceContact | None, float]:
        x, y = post[0] - pose[0], post[1] - pose[1]
        ahead = math.cos(pose[2]) * x + math.sin(pose[2]) * y - 0.3
        aside = math.cos(pose[2]) * y - math.sin(pose[2]) * x
        return (at(aside) if -0.05 < ahead <= 0.0 and abs(aside) <= 0.3 else None), 0.0

    one = pusher(SHARP, (5.0, -5.0))
    x, y = place_of((-0.3, 0.0), (*post, 1.0))
    one.decide(at(0.0), (x, y, 1.0), 0.0)
    told = [decision for _, decision in driven(one, script, range(10, 100), (0.1, -0.2, 0.5))]
    assert modes(told)[0] == "search" and {"push", "realign"} & set(modes(told))
    searched = [decision for decision in told if decision.mode == "search"]
    assert all(decision.yaw_rate == 0.0 for decision in searched)
    assert {decision.reason.split(", ")[-1] for decision in searched} == {"try 1"}


def test_who_is_touched_at_a_side_while_searching_backs_off_further() -> None:
    def script(cycle: int, pose: PlanarPose) -> tuple[FaceContact | None, float]:
        return (at(ASIDE) if cycle == 0 else None), float(cycle >= beside)

    def aside(told: list[tuple[PlanarPose, Decision]]) -> list[int]:
        return [row for row, (_, one) in enumerate(told) if "aside, try" in one.reason]

    beside = 1000
    beside = aside(driven(pusher(SHARP), script, range(100)))[0] + 1
    told = driven(pusher(SHARP), script, range(beside + 30))
    assert aside(told) == [beside - 1]
    assert {decision.forward < 0.0 for _, decision in told[beside:]} == {True}


# A cycle that leads nowhere


def test_without_progress_it_escapes_after_its_patience() -> None:
    assert ESCAPE is not None
    one = pusher({"like": "tuned", "escape": {**ESCAPE.model_dump(), "patience": 7.95}})
    told = decided(one, [0.0] * 90)
    assert modes(told) == ["push", "escape"]
    assert [decision.mode for decision in told].index("escape") == 80
    assert numbers(told[80]) == (-ESCAPE.speed, 0.0, 0.0) and "back off" in told[80].reason


def test_progress_is_coming_nearer_than_ever() -> None:
    """Coming nearer again after having gone away is not."""
    assert ESCAPE is not None
    one, cycles, x = pusher(), round(0.8 * ESCAPE.patience / PERIOD), 0.0
    for cycle in range(5 * cycles):
        x = 1.5 * ESCAPE.progress * (cycle // cycles)
        assert one.decide(at(0.0), (x, 0.0, 0.0), PERIOD * cycle).mode == "push"
    to_and_fro = [
        one.decide(at(0.0), (x - 0.5 * (cycle % 20 < 10), 0.0, 0.0), PERIOD * (5 * cycles + cycle))
        for cycle in range(cycles)
    ]
    assert modes(to_and_fro)[:2] == ["push", "escape"]


def test_near_the_target_going_past_it_is_told_at_once() -> None:
    """The object came nearer than `within`, and is now further away than it may be."""
    assert ESCAPE is not None
    nearest = 0.5 * ESCAPE.within
    more, less = 1.1 * ESCAPE.overshoot, 0.9 * ESCAPE.overshoot
    for away, mode in ((less, "push"), (more, "escape")):
        one = pusher("tuned", (0.3 + nearest, 0.0))
        one.decide(at(0.0), ORIGIN, 0.0)
        assert one.decide(at(0.0), (-away, 0.0, 0.0), PERIOD).mode == mode
        far = pusher("tuned", (0.3 + 1.5 * ESCAPE.within, 0.0))
        far.decide(at(0.0), ORIGIN, 0.0)
        assert far.decide(at(0.0), (-away, 0.0, 0.0), PERIOD).mode == "push"


def test_an_escape_that_meets_nothing_ends_in_a_search() -> None:
    one = pusher({**SHARP, "settle": 0.0}, (-3.0, 0.5))
    count = len(decided(one, [0.0] * 200)) - 1
    told = driven(one, lambda cycle, pose: (None, 0.0), range(count, count + 400))
    decisions = [decision for _, decision in told]
    assert modes(decisions)[:2] == ["escape", "search"]
    phases = [one.reason.removeprefix("no progress, ") for one in decisions if one.mode == "escape"]
    assert [phase for phase, _ in groupby(phases)] == ["back off", "go around", "go ahead"]
    (pose, _) = next(row for row in told if row[1].mode == "search")
    assert math.cos(pose[2] - math.atan2(0.5 - pose[1], -3.0 - pose[0])) > 0.95


@pytest.mark.parametrize("name", ["paper", "tuned"])
def test_mirrored_inputs_give_mirrored_ways_through_search_and_escape(name: str) -> None:
    """Contact is held, lost for long, then held without progress, with a side touched at times."""

    def script(cycle: int, pose: PlanarPose) -> tuple[FaceContact | None, float]:
        side = 1.0 if cycle % 50 in (30, 31) else 0.0
        if 20 < cycle < 120 or cycle % 40 == 39:
            return None, side
        return at(0.07 + 0.2 * math.sin(cycle / 9.0)), side

    def mirrored(cycle: int, pose: PlanarPose) -> tuple[FaceContact | None, float]:
        touch, side = script(cycle, pose)
        return (None if touch is None else at(-touch.lateral)), -side

    one = driven(pusher(name, (-2.0, 0.7)), script, range(500), (0.0, 0.1, 0.2))
    other = driven(pusher(name, (-2.0, -0.7)), mirrored, range(500), (0.0, -0.1, -0.2))
    for (pose, left), (image, right) in zip(one, other, strict=True):
        assert pose == pytest.approx((image[0], -image[1], -image[2]), abs=1e-9)
        assert left.mode == right.mode
    seen = {decision.mode for _, decision in one[1:]}
    assert seen == ({"push", "realign"} | ({"search", "escape"} if name == "tuned" else set()))


def test_the_paper_s_set_has_neither_search_nor_escape() -> None:
    assert isinstance(PAPER, PushingParameters)
    assert PAPER.search is None and PAPER.escape is None
    assert (PAPER.settle, PAPER.smoothing) == (0.0, 0.0)
