"""Commands on their way to a robot: zero when something is not fresh, the loop hangs, or ends."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from contactfusion.controller import FAULT, Command
from contactfusion.live.commander import CALM, HEARTBEAT, LAST, PERIOD, Commander
from contactfusion.live.config import LiveConfig
from contactfusion.readings import Twist
from tests.wire import Clock, Wire

FORWARD = Command(
    twist=Twist(
        stamp=0.0, frame="base", linear=np.array([0.3, 0.0, 0.0]), angular=np.array([0.0, 0.0, 0.1])
    )
)


def commander(wire: Wire, notes: list[str], **options: object) -> Commander:
    return Commander(wire, LiveConfig.model_validate(options), True, Clock(), notes.append)


def speeds(wire: Wire) -> list[float]:
    return [sent.linear.x for sent in wire.sent["/cmd_vel"]]


def soon(is_so: Callable[[], bool]) -> bool:
    ends = time.monotonic() + 10.0
    while not is_so() and time.monotonic() < ends:
        time.sleep(0.01)
    return is_so()


def test_a_command_is_sent_as_a_twist() -> None:
    wire = Wire()
    with commander(wire, []) as made:
        made.send(FORWARD)
    assert speeds(wire)[0] == 0.3
    assert wire.sent["/cmd_vel"][0].angular.z == 0.1


def test_a_controller_that_fails_commands_zero() -> None:
    wire = Wire()
    with commander(wire, []) as made:
        made.send(FORWARD)
        made.send(Command(joint_velocities={"a": 0.2}))
        made.send(Command(mode=FAULT, reason="it raised"))
        assert speeds(wire) == [0.3, 0.0]
        assert [sent.velocity[0] for sent in wire.sent["/contactfusion/joint_velocities"]] == [
            0.2,
            0.0,
        ]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"twist": "fast"}, "its twist is str, not a Twist"),
        ({"joint_velocities": {"a": float("nan")}}, "the velocity of a is no finite number"),
        ({"gripper": float("inf")}, "the gripper is commanded inf"),
    ],
)
def test_what_no_robot_can_follow_is_no_command(fields: dict[str, Any], words: str) -> None:
    with pytest.raises((TypeError, ValueError), match=words):
        Command(**fields)


def test_the_last_commands_are_zero_however_it_ends() -> None:
    wire = Wire()
    try:
        with commander(wire, []) as made:
            made.send(FORWARD)
            raise RuntimeError("the loop failed")
    except RuntimeError:
        pass
    assert speeds(wire) == [0.3, *[0.0] * LAST]


def test_commands_are_zero_while_something_is_not_fresh_and_go_on_after() -> None:
    wire, notes = Wire(), list[str]()
    with commander(wire, notes) as made:
        made.comes_round("no sensor of contacts has reported for 0.30 s")
        made.send(FORWARD)
        assert set(speeds(wire)) == {0.0}
        made.comes_round("")
        made.send(FORWARD)
        assert speeds(wire)[-1] == 0.3
        assert notes == ["commands are zero: no sensor of contacts has reported for 0.30 s"]
        began = time.monotonic()
        while len(notes) == 1 and time.monotonic() < began + 10.0:
            made.comes_round("")
            time.sleep(0.01)
        assert time.monotonic() > began + CALM
    assert notes[1:] == ["commands go on"]


def test_what_alternates_is_noted_once() -> None:
    wire, notes = Wire(), list[str]()
    with commander(wire, notes) as made:
        for _ in range(3):
            made.comes_round("the wheels have been silent for 0.26 s")
            made.comes_round("")
    assert notes == ["commands are zero: the wheels have been silent for 0.26 s"]


def test_zero_is_repeated_while_the_loop_hangs_and_the_heart_stops() -> None:
    wire, notes = Wire(), list[str]()
    with commander(wire, notes, hangs_after=0.1) as made:
        made.send(FORWARD)
        assert soon(lambda: speeds(wire).count(0.0) > 3)
        beats = len(wire.sent[HEARTBEAT])
        time.sleep(3.0 * PERIOD)
        assert len(wire.sent[HEARTBEAT]) == beats
        assert notes[0].startswith("commands are zero: the loop has not come round for 0.1")
        made.comes_round("")
        assert soon(lambda: len(wire.sent[HEARTBEAT]) > beats)


def test_velocities_of_joints_are_zero_with_the_rest() -> None:
    wire = Wire()
    with commander(wire, []) as made:
        made.send(Command(joint_velocities={"elbow": 0.2, "wrist": -0.1}))
    first, *rest = wire.sent["/contactfusion/joint_velocities"]
    assert dict(zip(first.name, first.velocity, strict=True)) == {"elbow": 0.2, "wrist": -0.1}
    assert [list(sent.velocity) for sent in rest] == [[0.0, 0.0]] * LAST


def test_newer_bases_get_a_twist_with_a_stamp_and_the_frame() -> None:
    wire = Wire()
    with commander(wire, [], stamped=True, twist="/base/cmd_vel") as made:
        made.send(FORWARD)
    sent = wire.sent["/base/cmd_vel"][0]
    assert (sent.header.frame_id, sent.twist.linear.x) == ("base", 0.3)


def test_a_pipeline_without_a_controller_commands_nothing() -> None:
    wire = Wire()
    with Commander(wire, LiveConfig(), False, Clock(), print) as made:
        made.send(None)
        made.comes_round("nothing is fresh")
    assert not wire.sent["/cmd_vel"]
