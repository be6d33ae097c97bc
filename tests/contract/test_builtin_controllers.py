"""Every controller of the package keeps the contract."""

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from contactfusion import Pipeline
from contactfusion.controllers.face import FaceContact
from contactfusion.controllers.pushing import ARRIVED, Decision, PushingController
from contactfusion.controllers.pushing_parameters import SETS
from contactfusion.frames import PlanarPose
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import installed_plugins

BUILTIN = {
    name: cls
    for name, cls in installed_plugins().offers("controllers").items()
    if cls.__module__.startswith("contactfusion.")
}
PUSHERS: dict[str, type[PushingController[Any]]] = {
    name: cls for name, cls in BUILTIN.items() if issubclass(cls, PushingController)
}
CASES: list[tuple[str, dict[str, Any]]] = [
    (name, {}) for name in PUSHERS if name != "reactive_pushing"
] + [("reactive_pushing", {"parameters": name}) for name in SETS]
each_pusher = pytest.mark.parametrize(
    ("name", "options"), CASES, ids=["-".join([name, *kind.values()]) for name, kind in CASES]
)
PAGE = Path(__file__).resolve().parents[2] / "docs" / "controllers.md"
TARGET = (1.0, -0.5)
PERIOD = 0.1

Step = tuple[FaceContact | None, PlanarPose, float]
laterals = st.floats(-0.33, 0.33)
places = st.floats(-6.0, 6.0)
angles = st.floats(-math.pi, math.pi)


def controller(
    name: str, options: dict[str, Any], target: tuple[float, float] = TARGET
) -> PushingController[Any]:
    cls = PUSHERS[name]
    return cls(cls.Config.model_validate({"target": target, **options}))


def touched(right: float, left: float) -> FaceContact:
    middle = (right + left) / 2.0
    return FaceContact(middle, "line" if left - right > 0.05 else "point", right, left, 0.8)


def arrival(one: PushingController[Any]) -> float:
    options = one.options
    return float(getattr(options, "parameters", options).arrival)


def numbers(decision: Decision) -> tuple[float, float, float]:
    return decision.forward, decision.lateral, decision.yaw_rate


@st.composite
def steps(draw: st.DrawFn) -> list[Step]:
    """Any touches and poses, with time that does not run backward."""
    touches = st.none() | st.tuples(laterals, laterals).map(lambda ends: touched(*sorted(ends)))
    now, taken = 0.0, []
    for touch, pose, period in draw(
        st.lists(
            st.tuples(touches, st.tuples(places, places, angles), st.floats(0.0, 30.0)), max_size=12
        )
    ):
        now += period
        taken.append((touch, pose, now))
    return taken


def walk(seed: int) -> list[Step]:
    """A walk of chance; the contact wanders and is lost at times; no ties, no round numbers."""
    rng = np.random.default_rng(seed)
    x, y, yaw, lateral = rng.uniform(-1.0, 1.0, 4)
    taken: list[Step] = []
    for index in range(40):
        x, y, yaw = np.array([x, y, yaw]) + rng.normal(0.0, 0.03, 3)
        lateral = float(np.clip(lateral + rng.normal(0.0, 0.03), -0.3, 0.3))
        touch = None if rng.random() < 0.3 else touched(lateral - 0.01, lateral + 0.01)
        taken.append((touch, (float(x), float(y), float(yaw)), PERIOD * index))
    return taken


def mirrored(step: Step) -> Step:
    touch, (x, y, yaw), now = step
    if touch is not None:
        touch = replace(touch, lateral=-touch.lateral, right=-touch.left, left=-touch.right)
    return touch, (x, -y, -yaw), now


def test_every_controller_is_checked_here() -> None:
    """One that does not push needs checks of its own."""
    elsewhere = {"reactive_grasp"}  # tests/test_reactive_grasp.py
    assert set(BUILTIN) == set(PUSHERS) | elsewhere
    assert {name for name, _ in CASES} == set(PUSHERS)


@each_pusher
@settings(max_examples=25)
@given(taken=steps())
def test_every_decision_is_finite_and_explained(
    name: str, options: dict[str, Any], taken: list[Step]
) -> None:
    one = controller(name, options)
    for step in taken:
        decision = one.decide(*step)
        assert np.isfinite(numbers(decision)).all()
        assert math.hypot(decision.forward, decision.lateral) < 0.5
        assert abs(decision.yaw_rate) < 0.5
        assert decision.mode
        assert decision.reason


@each_pusher
@settings(max_examples=25)
@given(taken=steps(), other=steps())
def test_after_a_reset_the_same_inputs_give_the_same(
    name: str, options: dict[str, Any], taken: list[Step], other: list[Step]
) -> None:
    one = controller(name, options)
    first = [one.decide(*step) for step in taken]
    one.reset()
    for step in other:
        one.decide(*step)
    one.reset()
    assert [one.decide(*step) for step in taken] == first
    fresh = controller(name, options)
    assert [fresh.decide(*step) for step in taken] == first


@each_pusher
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_mirrored_world_gives_mirrored_commands(
    name: str, options: dict[str, Any], seed: int
) -> None:
    """But for ties, as when the target lies exactly behind, where one side has to be chosen."""
    one = controller(name, options)
    other = controller(name, options, (TARGET[0], -TARGET[1]))
    for step in walk(seed):
        ahead, aside, turn = numbers(one.decide(*step))
        assert numbers(other.decide(*mirrored(step))) == pytest.approx(
            (ahead, -aside, -turn), abs=1e-6
        )


@each_pusher
@settings(max_examples=25)
@given(st.tuples(places, places, angles), laterals, angles, st.floats(0.0, 2.0))
def test_arrival_is_a_touch_within_the_arrival_distance(
    name: str,
    options: dict[str, Any],
    pose: PlanarPose,
    lateral: float,
    direction: float,
    part: float,
) -> None:
    distance = part * arrival(controller(name, options))
    (x, y, yaw), ahead = pose, 0.3
    target = (
        x + math.cos(yaw) * ahead - math.sin(yaw) * lateral + distance * math.cos(direction),
        y + math.sin(yaw) * ahead + math.cos(yaw) * lateral + distance * math.sin(direction),
    )
    one = controller(name, options, target)
    assert one.decide(None, pose, 0.0).mode != ARRIVED
    decision = one.decide(touched(lateral, lateral), pose, PERIOD)
    if abs(part - 1.0) > 1e-6:
        assert (decision.mode == ARRIVED) == (part < 1.0)
    if decision.mode == ARRIVED:
        assert numbers(decision) == (0.0, 0.0, 0.0)


@each_pusher
@settings(max_examples=25)
@given(taken=steps())
def test_without_touch_nothing_arrives(
    name: str, options: dict[str, Any], taken: list[Step]
) -> None:
    """Not even where the last contact was right at the target."""
    one = controller(name, options)
    one.decide(touched(0.0, 0.0), (TARGET[0] - 0.45, TARGET[1], 0.0), 0.0)
    for _, _, now in taken:
        decision = one.decide(None, (TARGET[0] - 0.3, TARGET[1], 0.0), now)
        assert decision.mode != ARRIVED


@each_pusher
def test_before_the_first_contact_it_goes_straight_ahead(
    name: str, options: dict[str, Any]
) -> None:
    decision = controller(name, options).decide(None, (0.3, 0.2, 1.0), 0.0)
    assert decision.forward > 0.0
    assert (decision.lateral, decision.yaw_rate) == (0.0, 0.0)


@each_pusher
def test_what_sticks_to_the_middle_of_the_face_gets_to_a_target_ahead(
    name: str, options: dict[str, Any]
) -> None:
    """The easiest push of all: the object moves with the face."""
    one = controller(name, options, (1.5, 0.0))
    x, y, yaw, index = -0.3, 0.0, 0.0, 0
    decision = one.decide(None, (x, y, yaw), 0.0)
    while decision.mode != ARRIVED and index < 3000:
        x += PERIOD * (math.cos(yaw) * decision.forward - math.sin(yaw) * decision.lateral)
        y += PERIOD * (math.sin(yaw) * decision.forward + math.cos(yaw) * decision.lateral)
        yaw += PERIOD * decision.yaw_rate
        index += 1
        touch = touched(0.0, 0.0) if index > 5 else None
        decision = one.decide(touch, (x, y, yaw), PERIOD * index)
    assert decision.mode == ARRIVED
    contact = x + 0.3 * math.cos(yaw), y + 0.3 * math.sin(yaw)
    assert math.dist(contact, (1.5, 0.0)) <= arrival(one)


@each_pusher
def test_odometry_is_waited_for_then_missed_in_a_sentence(
    name: str, options: dict[str, Any]
) -> None:
    pipeline = Pipeline(
        PipelineConfig.model_validate(
            {
                "integrator": {"frame": "base", "voxel_size": 0.0125},
                "controller": {"type": name, "target": TARGET, **options},
            }
        )
    )
    waiting = pipeline.step(0.0).command
    assert waiting is not None and waiting.twist is not None
    assert (waiting.mode, waiting.reason) == ("wait", "no odometry yet")
    assert not np.any([waiting.twist.linear, waiting.twist.angular])
    command = pipeline.step(1.1).command
    assert command is not None
    assert command.twist is None
    assert command.mode == "fault"
    assert command.reason.endswith("a controller that pushes needs odometry of the base")
    pipeline.reset()
    again = pipeline.step(10.0).command
    assert again is not None and again.mode == "wait"


def test_the_page_names_every_option_and_set() -> None:
    text = PAGE.read_text()
    code = set(re.findall(r"\w+", " ".join(re.findall(r"`[^`\n]+`", text))))
    options = {name for cls in PUSHERS.values() for name in option_names(cls.Config)}
    assert not {*options, *PUSHERS, "paper", "tuned"} - code


def option_names(model: type[BaseModel]) -> Iterator[str]:
    for name, info in model.model_fields.items():
        yield name
        for inner in (info.annotation, *get_args(info.annotation)):
            if isinstance(inner, type) and issubclass(inner, BaseModel):
                yield from option_names(inner)


def test_the_examples_of_the_page_are_configurations() -> None:
    examples = re.findall(r"^```yaml\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert len(examples) == 2
    for example in examples:
        fields = {"integrator": {"frame": "base", "voxel_size": 0.0125}, **yaml.safe_load(example)}
        command = Pipeline(PipelineConfig.model_validate(fields)).step(0.0).command
        assert command is not None
        assert command.reason == "no odometry yet"


def test_the_controller_of_the_page_pushes() -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    module: dict[str, Any] = {"__name__": "my_controller"}
    exec(compile(code, str(PAGE), "exec"), module)
    cls = module["contactfusion_controllers"]()["hopeful"]
    one = cls(cls.Config(target=(1.0, 0.0)))
    place = touched(0.0, 0.0)
    modes = [one.decide(place, (x, 0.0, 0.0), 0.0, 0.0).mode for x in (0.0, 0.66)]
    assert modes == ["push", ARRIVED]
