"""Reactive grasping: what the hand does follows from where it is touched, and from its joints."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from contactfusion.contacts import Contact
from contactfusion.controllers.grasp_contact import HandConfig, HandContact, on_hand, typical
from contactfusion.controllers.grasp_parameters import ENDS, GraspMode, ReactiveGraspConfig
from contactfusion.controllers.reactive_grasp import ReactiveGrasp
from contactfusion.errors import ConfigurationError, FrameError
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import installed_plugins
from contactfusion.surface import Surface
from tests.grasp_toys import ToyHand, contact, controller

TIP = 0.19
"""How far ahead of the tool fingertips are [m]."""
HAND = HandConfig()


def bottle(aside: float, ahead: float = 0.25) -> Callable[[ToyHand], list[Contact]]:
    """A bottle that stands still beside the hand's way: fingertips 6 cm aside run into it."""

    def touches(hand: ToyHand) -> list[Contact]:
        x, _, z = hand.pose[:3, :3].T @ (np.array([0.5 + ahead, aside, 0.3]) - hand.pose[:3, 3])
        if abs(x) > 0.035 and z - 0.0325 < TIP:
            return [hand.touched((0.06 * np.sign(x), 0.0, TIP), (0.0, 0.0, -1.0))]
        if z - 0.0325 < 0.07:
            return [hand.touched((x, 0.0, 0.07), (0.0, 0.0, -1.0))]
        return []

    return touches


def holding(hand: ToyHand, part: float = 0.5) -> ToyHand:
    """Something is between the fingers."""
    hand.most = np.full(2, part)
    return hand


# A grasp that succeeds


def test_an_object_ahead_is_approached_gripped_lifted_and_held() -> None:
    hand = holding(ToyHand(controller(), bottle(0.0)))
    hand.until(*ENDS)
    assert hand.modes() == ["open", "approach", "enter", "close", "lift", "hold", "lifted"]
    assert hand.pose[2, 3] == pytest.approx(0.3 + 0.13, abs=0.003)
    assert hand.told[-1].gripper == 1.0


@pytest.mark.parametrize("aside", [0.05, -0.05])
def test_a_touch_beside_the_middle_makes_the_hand_go_back_aside_and_ahead_again(
    aside: float,
) -> None:
    hand = holding(ToyHand(controller(), bottle(aside)))
    hand.until(*ENDS)
    assert hand.modes()[:5] == ["open", "approach", "back", "aside", "approach"]
    assert hand.mode == GraspMode.LIFTED
    assert hand.pose[1, 3] == pytest.approx(aside, abs=0.015)


@pytest.mark.parametrize("period", [0.02, 0.1])
def test_however_often_it_is_asked_it_lifts_with_one_correction(period: float) -> None:
    hand = holding(ToyHand(controller(), bottle(0.05), period))
    hand.until(*ENDS)
    corrected = ["back", "aside", "approach"]
    assert hand.modes() == [
        *("open", "approach", *corrected, "enter", "close", "lift", "hold", "lifted")
    ]
    assert hand.pose[:3, 3] == pytest.approx([0.655, 0.058, 0.43], abs=0.01)
    assert 12.0 < hand.now < 16.0


def test_what_is_touched_on_one_side_then_on_the_other_lies_between() -> None:
    """A wide object: each finger runs into it unless the hand is just before it."""

    def wide(hand: ToyHand) -> list[Contact]:
        aside = 0.015 - hand.pose[1, 3]
        if hand.pose[0, 3] < 0.52 or abs(aside) < 0.01:
            return []
        return [hand.touched((0.06 * np.sign(aside), 0.0, TIP), (0.0, 0.0, -1.0))]

    hand = holding(ToyHand(controller(), wide))
    hand.until("close")
    told = dict.fromkeys(told.reason for told in hand.told if told.mode == "aside")
    ways = [float(reason.split(": ")[1].split()[0]) for reason in told]
    assert ways == pytest.approx([6.0, -3.0, -1.5], abs=0.2)
    assert abs(hand.pose[1, 3] - 0.015) < 0.01


def test_the_hand_goes_back_by_as_much_as_it_is_told_before_it_goes_aside() -> None:
    hand = holding(ToyHand(controller(back=0.06), bottle(0.05)))
    hand.until("back")
    touched = hand.pose[0, 3]
    hand.until("aside")
    assert touched - hand.pose[0, 3] == pytest.approx(0.06, abs=0.006)


def test_pushes_without_a_common_direction_count_by_the_nearest_to_the_middle() -> None:
    ways = np.eye(3)
    touches = [
        HandContact(np.array([x, 0.0, 0.1]), way, ("wrist",))
        for x, way in zip((0.0, 0.01, 0.05), ways, strict=True)
    ]
    found = typical(touches)
    assert found.position.tolist() == [0.01, 0.0, 0.1] and found.push.tolist() == ways[1].tolist()


@pytest.mark.parametrize(("ahead", "way"), [(0.07, 0.0), (0.153, 0.05), (0.183, 0.08)])
def test_what_is_between_the_fingers_is_gone_to_until_it_is_deep_enough(
    ahead: float, way: float
) -> None:
    """The middle of what touches from ahead lies 3.2 cm further on."""

    def touch(hand: ToyHand) -> list[Contact]:
        return [hand.touched((0.01, 0.0, ahead), (0.0, 0.0, -1.0))]

    hand = ToyHand(controller(depth=0.135), touch)
    hand.until("enter")
    begun = hand.pose[0, 3]
    hand.until("close")
    assert hand.pose[0, 3] - begun == pytest.approx(way, abs=0.005)


def test_without_any_contact_it_closes_at_the_end_of_its_way() -> None:
    hand = holding(ToyHand(controller(reach=0.1)))
    command = hand.until("close")
    assert command.reason == "at the end of the way"
    assert hand.pose[0, 3] - 0.5 == pytest.approx(0.1, abs=0.003)
    assert hand.until(*ENDS).mode == GraspMode.LIFTED


def test_without_corrections_it_heeds_no_contact() -> None:
    hand = holding(ToyHand(controller(corrections=0), bottle(0.05)))
    hand.until(*ENDS)
    assert hand.modes() == ["open", "approach", "close", "lift", "hold", "lifted"]


def test_a_touch_is_believed_when_it_has_been_felt_so_often() -> None:
    touched: list[float] = []

    def once(hand: ToyHand) -> list[Contact]:
        if hand.mode != "approach" or hand.now < 2.0 or len(touched) == 2:
            return []
        touched.append(hand.now)
        return bottle(0.05, 0.1)(hand)

    hand = holding(ToyHand(controller(confirm=3), once))
    hand.until("close")
    assert len(touched) == 2
    assert "back" not in hand.modes()


def test_what_is_felt_while_the_hand_begins_to_move_is_its_own_jerk() -> None:
    hand = ToyHand(controller(settle=0.4), lambda hand: [hand.touched((0.06, 0, TIP), (0, 0, -1))])
    hand.until("approach")
    hand.until("back")
    began = next(row for row, told in enumerate(hand.told) if told.mode == "approach")
    assert (len(hand.told) - began) * hand.period > 0.4


def test_each_state_says_why_it_was_entered() -> None:
    hand = holding(ToyHand(controller(), bottle(0.05)))
    hand.until(*ENDS)
    reasons = {command.mode: command.reason for command in hand.told}
    assert "touched +6.0 cm aside, 19.0 ahead (wrist, motion)" in reasons["back"]
    assert reasons["aside"] == "correction 1: +6.0 cm aside"
    assert reasons["enter"].endswith("between the fingers")
    assert reasons["lift"] == "fingers rest 50% closed"
    assert reasons["lifted"] == "held for 2.5 s"


# What can go wrong


def test_fingers_that_close_on_nothing_have_missed() -> None:
    hand = ToyHand(controller(attempts=1))
    start = hand.pose[:3, 3].copy()
    command = hand.until(*ENDS)
    assert (command.mode, command.reason) == ("missed", "the fingers closed on nothing")
    assert hand.modes()[-3:] == ["close", "retreat", "missed"]
    assert hand.pose[:3, 3] == pytest.approx(start, abs=0.004)
    assert command.gripper == 0.0


def test_what_was_missed_is_tried_again_from_further_back() -> None:
    hand = ToyHand(controller(attempts=2))
    hand.until("close")
    first = hand.pose[0, 3]
    hand.until("approach")
    assert first - hand.pose[0, 3] == pytest.approx(0.08, abs=0.006)
    holding(hand)
    assert hand.until(*ENDS).mode == GraspMode.LIFTED
    assert hand.pose[0, 3] - first == pytest.approx(0.04, abs=0.003)
    assert "attempt 2" in [command.reason for command in hand.told]


@pytest.mark.parametrize("when", ["lift", "hold"])
def test_fingers_that_close_further_have_dropped_the_object(when: str) -> None:
    hand = holding(ToyHand(controller(), bottle(0.0)))
    hand.until(when)
    hand.most = np.ones(2)
    assert hand.until(*ENDS).mode == GraspMode.DROPPED
    assert hand.told[-1].reason == "the fingers closed further"


def weighing(weight: Callable[[ToyHand], float]) -> ToyHand:
    """A hand with something between its fingers, whose weight its wrist feels as it is lifted."""
    hand = holding(ToyHand(controller(wrist={"sensor": "wrist"}, attempts=2), bottle(0.0)))
    hand.weight = lambda hand: weight(hand) if hand.pose[2, 3] > 0.305 else 0.0
    return hand


def test_fingers_that_creep_over_what_the_wrist_still_weighs_have_not_dropped_it() -> None:
    hand = weighing(lambda hand: 4.0)
    hand.until("hold")
    hand.most = np.full(2, 0.8)
    assert hand.until(*ENDS).mode == GraspMode.LIFTED


def test_fingers_that_creep_count_where_the_wrist_is_silent() -> None:
    hand = weighing(lambda hand: 4.0)
    hand.until("hold")
    hand.weight, hand.most = None, np.full(2, 0.8)
    assert hand.until(*ENDS).reason == "the fingers closed further"


def test_what_slips_is_put_down_and_grasped_again() -> None:
    slips = [True]
    hand = weighing(lambda hand: 1.0 if slips and hand.pose[2, 3] > 0.38 else 4.0)
    hand.until("lift")
    low = hand.pose[2, 3]
    command = hand.until("lower")
    assert (command.gripper, command.reason) == (1.0, "of 4.0 N it still lifts 1.0 N")
    assert hand.until("retreat").gripper == 0.0
    assert hand.pose[2, 3] < low + 0.005
    slips.clear()
    assert hand.until(*ENDS).mode == GraspMode.LIFTED
    begun = hand.modes()[hand.modes().index("lower") :]
    assert begun[:4] == ["lower", "retreat", "open", "approach"]
    assert "attempt 2" in [command.reason for command in hand.told]


def test_what_slips_in_every_attempt_is_dropped() -> None:
    hand = weighing(lambda hand: 0.0)
    assert hand.until(*ENDS).mode == GraspMode.DROPPED
    assert hand.told[-1].reason == "it lifts 0.0 N: nothing"
    assert hand.modes().count("lift") == 2
    assert hand.told[-1].gripper == 0.0


def test_a_finger_that_does_not_open_is_stuck_and_the_hand_stays_where_it_is() -> None:
    hand = ToyHand(controller())
    hand.jammed[1] = True
    command = hand.until(*ENDS)
    assert (command.mode, command.reason) == ("stuck", "'right' does not open")
    assert "approach" not in hand.modes()
    assert hand.pose[:3, 3] == pytest.approx(hand.way[0])


def test_a_touch_from_below_makes_the_hand_go_up() -> None:
    def table(hand: ToyHand) -> list[Contact]:
        low = hand.pose[2, 3] < 0.33
        return [hand.touched((0.0, -0.045, 0.1), (0.0, 1.0, -0.2))] if low else []

    hand = holding(ToyHand(controller(), table))
    hand.until(*ENDS)
    assert hand.mode == GraspMode.LIFTED
    assert [c.reason for c in hand.told if c.mode == "aside"][0] == "correction 1: +2.0 cm up"
    assert hand.modes().count("aside") == 2


def test_what_touches_from_below_again_and_again_obstructs_the_hand() -> None:
    hand = ToyHand(
        controller(corrections=3), lambda hand: [hand.touched((0, -0.045, 0.1), (0, 1, -0.2))]
    )
    assert hand.until(*ENDS).mode == GraspMode.OBSTRUCTED
    assert hand.modes().count("back") == 3
    assert "below or above" in hand.told[-1].reason


def test_a_contact_that_never_goes_away_is_corrected_so_often_then_it_closes() -> None:
    hand = ToyHand(
        controller(corrections=2, attempts=1),
        lambda hand: [hand.touched((0.06, 0, TIP), (0, 0, -1))],
    )
    assert hand.until(*ENDS).mode == GraspMode.MISSED
    assert hand.modes().count("back") == 2
    (why, *_) = [command.reason for command in hand.told if command.mode == "close"]
    assert why.endswith("no correction left")


def test_a_hand_that_comes_no_further_is_blocked() -> None:
    hand = ToyHand(controller(patience=1.0))
    hand.stopped = lambda hand, velocity: velocity[2] > 0.0 and hand.pose[0, 3] > 0.55
    command = hand.until(*ENDS)
    assert (command.mode, command.reason) == ("blocked", "the hand comes no further")
    assert hand.pose[0, 3] == pytest.approx(0.5, abs=0.004)


def test_a_hand_that_cannot_even_go_back_ends_where_it_is() -> None:
    hand = ToyHand(controller(patience=1.0))
    hand.stopped = lambda hand, velocity: hand.pose[0, 3] > 0.55
    assert hand.until(*ENDS).mode == GraspMode.BLOCKED


def test_what_takes_too_long_is_given_up() -> None:
    hand = ToyHand(controller(longest=5.0), lambda hand: [hand.touched((0.06, 0, TIP), (0, 0, -1))])
    command = hand.until(*ENDS)
    assert (command.mode, command.reason) == ("timeout", "not done after 5 s")
    assert hand.now < 15.0


@pytest.mark.parametrize("when", ["lift", "hold"])
def test_what_is_held_when_the_time_runs_out_is_not_let_go(when: str) -> None:
    """The time is over a second after the hand has begun to lift, or to hold."""
    timely = holding(ToyHand(controller()))
    timely.until(when)
    hand = holding(ToyHand(controller(longest=timely.now + 1.0)))
    assert hand.until(*ENDS).mode == GraspMode.LIFTED
    assert hand.told[-1].gripper == 1.0
    assert hand.modes() == ["open", "approach", "close", "lift", "hold", "lifted"]
    assert hand.now > timely.now + 2.0
    assert hand.pose[2, 3] == pytest.approx(0.3 + 0.13, abs=0.003)


def test_without_joints_it_waits_then_stands_still_blind() -> None:
    hand = ToyHand(controller(patience=1.0))
    hand.deaf = True
    assert hand.step().mode == GraspMode.WAIT
    command = hand.until(*ENDS)
    assert (command.mode, command.gripper) == ("blind", None)
    assert command.twist is not None and not command.twist.linear.any()


def test_joints_that_fall_silent_stop_the_hand_in_every_state() -> None:
    for mode in ("open", "approach", "close", "lift", "hold"):
        hand = holding(ToyHand(controller()))
        hand.until(mode)
        hand.silent = hand.now
        command = hand.until(*ENDS)
        assert (command.mode, command.reason) == ("blind", "joints are silent for 0.5 s"), mode
        assert command.twist is not None and not command.twist.linear.any()
        assert hand.now - hand.silent < 0.7


def test_joints_that_tell_the_same_for_ever_are_those_of_a_hand_that_is_blocked() -> None:
    """Encoders that count in steps tell the same when something is in the way."""
    hand = ToyHand(controller(), lambda hand: [])
    hand.until("approach")
    hand.stopped = lambda hand, velocity: True
    assert hand.until("retreat").reason == "the hand comes no further"
    assert hand.until(*ENDS).mode == GraspMode.BLOCKED


def test_what_comes_no_higher_is_put_down_before_it_is_let_go() -> None:
    hand = holding(ToyHand(controller()))
    hand.until("lift")
    low = hand.pose[2, 3]
    hand.stopped = lambda hand, velocity: velocity[1] > 0.0 and hand.pose[2, 3] > low + 0.05
    assert hand.until("lower").gripper == 1.0
    command = hand.until("retreat")
    assert (command.gripper, command.reason) == (0.0, "the hand comes no higher")
    assert hand.pose[2, 3] < low + 0.005
    assert hand.until(*ENDS).mode == GraspMode.BLOCKED


def test_a_hand_that_hears_of_its_joints_late_begins_then() -> None:
    hand = holding(ToyHand(controller()))
    hand.deaf = True
    hand.step()
    hand.deaf = False
    assert hand.until(*ENDS).mode == GraspMode.LIFTED


@pytest.mark.parametrize("held", [0.5, 1.0], ids=["lifted", "missed"])
def test_in_an_end_the_arm_stands_still_whatever_is_felt(held: float) -> None:
    touches: list[Contact] = []
    hand = holding(ToyHand(controller(attempts=1), lambda hand: touches), held)
    end = hand.until(*ENDS)
    touches.append(hand.touched((0.06, 0.0, TIP), (0.0, 0.0, -1.0)))
    for _ in range(40):
        command = hand.step()
        assert (command.mode, command.gripper) == (end.mode, end.gripper)
        assert command.twist is not None and not command.twist.linear.any()


def test_after_a_reset_the_same_happens_again() -> None:
    one = controller()
    first = holding(ToyHand(one, bottle(0.05)))
    first.until(*ENDS)
    one.reset()
    again = holding(ToyHand(one, bottle(0.05)))
    again.until(*ENDS)
    assert again.modes() == first.modes()
    assert np.array(again.way) == pytest.approx(np.array(first.way))


def test_a_mirrored_world_gives_a_mirrored_way() -> None:
    ways = []
    for aside in (0.045, -0.045):
        hand = holding(ToyHand(controller(), bottle(aside)))
        hand.until(*ENDS)
        ways.append(np.array(hand.way) * [1.0, np.sign(aside), 1.0])
    assert ways[0] == pytest.approx(ways[1])


def test_a_joint_that_nobody_tells_is_named_with_the_nearest() -> None:
    hand = ToyHand(controller(gripper={"lefft": (0.0, 1.0)}))
    with pytest.raises(ConfigurationError, match=r"gripper.lefft.*did you mean 'left'"):
        hand.step()


def test_joints_without_velocities_are_told_in_a_sentence() -> None:
    hand = ToyHand(controller())
    hand.tells_speeds = False
    said = "gripper: the joints report no velocities, which show whether the fingers are at rest"
    with pytest.raises(ConfigurationError, match=said):
        hand.step()


def test_a_finger_without_a_velocity_is_refused_in_a_sentence() -> None:
    hand = ToyHand(controller())
    hand.speeds = np.array([0.0, np.nan])
    with pytest.raises(ConfigurationError, match="gripper: the joints report no velocities"):
        hand.step()


def test_a_tool_that_nobody_knows_is_named() -> None:
    hand = ToyHand(controller(tool="plam"))
    with pytest.raises(FrameError, match="plam"):
        hand.step()


# Where the hand is touched


def test_the_push_of_a_contact_is_that_of_its_force() -> None:
    hand = ToyHand(controller())
    felt = on_hand([hand.touched((0.05, 0.01, 0.2), (3.0, 0.0, -4.0))], hand.pose, None, HAND)
    assert felt is not None
    assert felt.position == pytest.approx([0.05, 0.01, 0.2])
    assert felt.push == pytest.approx([0.6, 0.0, -0.8])
    assert felt.sources == ("wrist", "motion")
    assert felt.middle(0.03) == pytest.approx([0.032, 0.01, 0.224])


def test_without_a_force_it_is_the_normal_into_the_surface_that_is_touched() -> None:
    hand = ToyHand(controller())
    points = np.stack([hand.at(0.05, 0.0, 0.2), hand.at(-0.05, 0.0, 0.2)])
    normals = np.stack([-hand.pose[:3, 0], hand.pose[:3, 0]])
    surface = Surface("base", points, normals)
    felt = on_hand([contact(hand.at(0.048, 0.0, 0.2))], hand.pose, surface, HAND)
    assert felt is not None
    assert felt.push == pytest.approx([1.0, 0.0, 0.0])
    assert on_hand([contact(hand.at(0.048, 0.0, 0.2))], hand.pose, None, HAND) is None


def test_contacts_elsewhere_on_the_robot_are_not_the_hands() -> None:
    hand = ToyHand(controller())
    elbow = hand.touched((0.0, 0.0, -0.4), (0.0, 0.0, -1.0))
    tip = hand.touched((0.06, 0.0, 0.2), (0.0, 0.0, -1.0))
    felt = on_hand([elbow, tip], hand.pose, None, HAND)
    assert felt is not None and felt.position[2] == pytest.approx(0.2)
    assert on_hand([elbow], hand.pose, None, HAND) is None


def test_of_two_places_that_explain_a_push_the_object_ahead_is_the_likelier() -> None:
    """The line through the inside of one finger meets the tip of the other."""
    hand = ToyHand(controller())
    inside = hand.touched((0.037, 0.0, 0.13), (0.6, 0.0, -0.8))
    outside = hand.touched((-0.064, 0.0, 0.19), (0.6, 0.0, -0.8))
    felt = on_hand([outside, inside], hand.pose, None, HAND)
    assert felt is not None and felt.position[0] == pytest.approx(0.037)
    assert on_hand([outside], hand.pose, None, HAND) is None


def test_one_wrong_contact_of_three_does_not_count() -> None:
    ahead, right = np.array([0.0, 0.0, -1.0]), np.array([0.06, 0.0, 0.19])
    touches = [
        HandContact(right, ahead, ("wrist",)),
        HandContact(-right, -ahead, ("wrist",)),
        HandContact(right, ahead, ("wrist",)),
    ]
    told = typical(touches)
    assert told.position == pytest.approx(right)
    assert told.push == pytest.approx(ahead)


# In a pipeline


def test_it_is_installed() -> None:
    assert installed_plugins().find("controllers", "reactive_grasp") is ReactiveGrasp


def test_a_pipeline_without_joints_waits() -> None:
    fields: dict[str, Any] = {
        "integrator": {"frame": "base"},
        "controller": {"type": "reactive_grasp", "tool": "palm", "gripper": {"left": [0, 1]}},
    }
    command = Pipeline(PipelineConfig(**fields)).step(0.0).command
    assert command is not None
    assert (command.mode, command.reason) == ("wait", "no joints yet")


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"tool": "palm", "gripper": {}}, "gripper"),
        ({"tool": "palm", "gripper": {"left": (0, 1)}, "speeed": 1}, "did you mean 'speed'"),
        ({"tool": "palm", "gripper": {"left": (1.0, 1.0)}}, "gripper.left"),
    ],
)
def test_a_wrong_option_is_told_in_a_sentence(fields: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        ReactiveGraspConfig(**fields)
