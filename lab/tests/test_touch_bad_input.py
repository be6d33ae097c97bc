"""What is wrong with one sensor of the arm is reported in a sentence, and the others go on."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from contactfusion import Pipeline
from contactfusion.errors import InvalidReadingError
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.integrator.sources import EventKind
from contactfusion.pipeline import Step
from contactfusion.readings import (
    DepthImage,
    JointState,
    ObjectPose,
    PointCloud,
    Reading,
    TactileImage,
    Wrench,
)
from contactfusion.robots.model import shared_robot
from contactfusion_lab.experiments.touch.plan import DEFAULT, Plan, Touch, read_plan
from contactfusion_lab.scenes.touch.scene import TouchScene, Truth

Change = Callable[[Reading], Reading | None]


@pytest.fixture(scope="module")
def plan() -> Plan:
    return read_plan(DEFAULT, [], 15, "none", (), 0)[0]


@pytest.fixture(scope="module")
def touched(plan: Plan) -> tuple[Sequence[Reading], Truth]:
    assert plan.pipeline.robot is not None
    touch = Touch("box", 7, 0, short=False, seed=4)  # at one place
    scene = TouchScene(plan.scene_of(touch), shared_robot(plan.pipeline.robot), touch.seed)
    return list(scene.readings()), scene.truth


def felt(
    plan: Plan, readings: Sequence[Reading], change: Change
) -> tuple[Step, dict[str, HypothesisCloud], set[str]]:
    """Run the touch with changed readings: the step, the last clouds, why something was refused."""
    clouds: dict[str, HypothesisCloud] = {}
    pipeline = Pipeline(
        plan.pipeline_of("box"), tell=lambda cloud: clouds.update({cloud.source: cloud})
    )
    for reading in readings:
        changed = change(reading)
        if changed is not None:
            pipeline.receive(changed)
    step = pipeline.step(readings[-1].stamp)
    refused = {event.message for event in step.events if event.kind == EventKind.REFUSED}
    return step, clouds, refused


def found(step: Step, truth: Truth) -> bool:
    places = [contact.position for contact in step.fusion.contacts]
    return any(
        np.linalg.norm(place - truth.contacts.places, axis=1).min() < 0.03 for place in places
    )


def test_a_healthy_touch_is_found_and_nothing_is_refused(
    plan: Plan, touched: tuple[Sequence[Reading], Truth]
) -> None:
    step, clouds, refused = felt(plan, touched[0], lambda reading: reading)
    assert found(step, touched[1]) and not refused
    assert len(clouds["wrist"]) and len(clouds["believed"])


def test_a_camera_that_sees_nothing_has_looked(
    plan: Plan, touched: tuple[Sequence[Reading], Truth]
) -> None:
    def blind(reading: Reading) -> Reading:
        if isinstance(reading, PointCloud):
            return replace(reading, points=np.empty((0, 3)))
        if isinstance(reading, DepthImage):
            return replace(reading, depth=np.zeros_like(reading.depth))
        return reading

    step, clouds, refused = felt(plan, touched[0], blind)
    assert found(step, touched[1]) and not refused
    assert not len(clouds["near"]) and not len(clouds["air"])


def test_an_object_believed_a_metre_off_is_no_support(
    plan: Plan, touched: tuple[Sequence[Reading], Truth]
) -> None:
    def off(reading: Reading) -> Reading:
        if isinstance(reading, ObjectPose):
            return replace(reading, position=reading.position + [1.0, 0.0, 0.0])
        return reading

    step, clouds, refused = felt(plan, touched[0], off)
    assert found(step, touched[1]) and not refused
    assert not len(clouds["believed"])


def test_an_object_that_is_unknown_is_reported_and_the_others_go_on(
    plan: Plan, touched: tuple[Sequence[Reading], Truth]
) -> None:
    def renamed(reading: Reading) -> Reading:
        return replace(reading, name="bocks") if isinstance(reading, ObjectPose) else reading

    step, _, refused = felt(plan, touched[0], renamed)
    assert found(step, touched[1])
    assert any("unknown object 'bocks': the objects" in reason for reason in refused)


def test_joints_of_other_names_are_reported_by_every_source_that_needs_them(
    plan: Plan, touched: tuple[Sequence[Reading], Truth]
) -> None:
    def renamed(reading: Reading) -> Reading:
        if isinstance(reading, JointState):
            return replace(reading, names=tuple(f"left_{name}" for name in reading.names))
        return reading

    step, _, refused = felt(plan, touched[0], renamed)
    assert not step.fusion.contacts
    assert any("no position of joint 'arm_1' came (and 14 more)" in reason for reason in refused)


def test_joints_that_are_no_numbers_are_refused_when_they_are_made(
    touched: tuple[Sequence[Reading], Truth],
) -> None:
    joints = next(reading for reading in touched[0] if isinstance(reading, JointState))
    wrong = joints.positions.copy()
    wrong[3] = np.nan
    with pytest.raises(InvalidReadingError, match=r"row 3 of the positions .* is not finite: nan"):
        replace(joints, positions=wrong)


@pytest.mark.parametrize("kind", [TactileImage, Wrench, PointCloud, DepthImage])
def test_a_touch_is_found_though_one_kind_of_sensor_is_silent(
    plan: Plan, touched: tuple[Sequence[Reading], Truth], kind: type[Reading]
) -> None:
    def silent(reading: Reading) -> Reading | None:
        return None if isinstance(reading, kind) else reading

    step, _, refused = felt(plan, touched[0], silent)
    assert found(step, touched[1]) and not refused


def test_a_skin_of_another_size_is_refused_alone(
    plan: Plan, touched: tuple[Sequence[Reading], Truth]
) -> None:
    def cut(reading: Reading) -> Reading:
        if isinstance(reading, TactileImage) and reading.sensor == "palm":
            return replace(reading, values=reading.values[:-1])
        return reading

    step, clouds, refused = felt(plan, touched[0], cut)
    assert found(step, touched[1])
    assert any(
        "has 15 values, but the patch of 'palm' has 16 taxels" in message for message in refused
    )
    assert "palm" not in clouds and "tip_1" in clouds
