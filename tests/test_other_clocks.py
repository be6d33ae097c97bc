"""Stamps far ahead of a step are of another clock: left out by name, and they hide nothing."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from contactfusion import IntegratorConfig, Pipeline, PipelineConfig
from contactfusion.integrator.sources import EventKind
from contactfusion.readings import Reading
from contactfusion.time import LEAP
from tests.test_robot_state import joints, odometry, transform, twist
from tests.toys import offer_toys, wrench

HOUR = 3600.0


def pipeline(**fields: object) -> Pipeline:
    return Pipeline(PipelineConfig.model_validate({"integrator": {"frame": "map"}, **fields}))


def at(x: float) -> Callable[[float], Reading]:
    return lambda stamp: odometry(stamp, x)


def told(pipe: Pipeline, now: float) -> list[str]:
    events = pipe.step(now).events
    return [event.message for event in events if event.kind == EventKind.EARLY]


def base_at(pipe: Pipeline, now: float) -> float:
    pose = pipe.state(now).base_pose
    assert pose is not None
    return float(pose[0, 3])


@pytest.mark.parametrize("lead", [HOUR, LEAP + 0.5])
def test_odometry_of_another_clock_is_named_and_freezes_no_pose(lead: float) -> None:
    pipe = pipeline()
    pipe.receive(odometry(0.0, 1.0))
    pipe.step(0.0)
    pipe.receive(odometry(lead, 5.0))
    pipe.receive(odometry(0.1, 2.0))
    assert base_at(pipe, 0.1) == 2.0
    (message,) = told(pipe, 0.1)
    ahead = f"{lead - 0.1:,.3f} s ahead of the step: left out, its clock is another"
    assert message == f"Odometry is {ahead}"
    assert told(pipe, 0.2) == []


def test_the_last_reading_before_a_step_may_be_that_of_another_clock() -> None:
    pipe = pipeline()
    for reading in (odometry(0.0, 1.0), odometry(0.1, 2.0), odometry(HOUR, 5.0)):
        pipe.receive(reading)
    assert len(told(pipe, 0.1)) == 1
    assert base_at(pipe, 0.2) == 2.0


def test_joints_twists_and_transforms_of_another_clock_are_named_too() -> None:
    pipe = pipeline()
    pipe.receive(odometry(0.0, 1.0))
    pipe.step(0.0)
    for stamp in (HOUR, 0.1):
        pipe.receive(joints(stamp, stamp, 0.0))
        pipe.receive(twist(stamp, 1.0))
        pipe.receive(transform(stamp, stamp, child="eye"))
    state = pipe.state(0.1)
    assert state.joints is not None
    assert state.joints.positions[0] == 0.1
    assert base_at(pipe, 0.1) == pytest.approx(1.1)
    assert state.frames.pose("map", of="eye")[0, 3] == 0.1
    sources = {message.partition(" is ")[0] for message in told(pipe, 0.1)}
    assert sources == {"JointState", "Twist", "the transform of 'eye'"}


def test_after_a_pause_without_steps_all_is_of_this_clock() -> None:
    pipe = pipeline()
    pipe.receive(odometry(0.0, 1.0))
    pipe.step(0.0)
    for stamp in np.arange(1.0, 20.0).tolist():
        pipe.receive(odometry(stamp, stamp))
    assert base_at(pipe, 18.5) == 18.5
    assert told(pipe, 19.0) == []


def test_a_transform_that_only_another_clock_knows_is_unknown() -> None:
    pipe = pipeline()
    pipe.receive(transform(HOUR, 1.0, child="eye"))
    assert len(told(pipe, 0.0)) == 1
    assert "eye" not in pipe.state(0.0).frames.frames


def test_clouds_of_another_clock_are_dropped_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_toys(monkeypatch)
    pipe = Pipeline(
        PipelineConfig(generators={"touch": {"type": "feeler"}}, integrator=IntegratorConfig())
    )
    pipe.receive(wrench(HOUR, 0.1, 0.0, 0.0))
    (message,) = told(pipe, 0.0)
    assert message.endswith(" is 3,600.000 s early: dropped, its clock is another")
    assert told(pipe, 0.1) == []
    assert pipe.step(HOUR).fusion.contacts == ()


@pytest.mark.parametrize("lead", [0.5, 1.9])
@pytest.mark.parametrize(("kind", "frame"), [(odometry, "odom"), (transform, "map")])
def test_a_reading_a_little_ahead_freezes_no_pose(kind: Any, frame: str, lead: float) -> None:
    pipe, messages = pipeline(), list[str]()
    for number in range(40):
        now = 0.1 * number
        pipe.receive(kind(now, now))
        if number == 10:
            pipe.receive(kind(now + lead, now))
        messages += told(pipe, now)
        where = pipe.state(now).frames.pose(frame, of="base")[0, 3]
        assert where == pytest.approx(now, abs=1e-9)
    (message,) = messages
    assert f"{lead - 0.1:,.3f} s ahead of the step: left out, its clock is another" in message


def test_a_reading_that_was_overtaken_turns_no_clock_back() -> None:
    pipe = pipeline()
    for stamp in (0.0, 0.1, 0.2, 0.4, 0.5, 0.3, 0.6):
        pipe.receive(odometry(stamp, stamp))
        assert not told(pipe, 0.6)
    assert base_at(pipe, 0.5) == pytest.approx(0.5)
