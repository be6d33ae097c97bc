"""A push as its sensors measure it, the truth apart from it, and the closed loop of both."""

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion import Pipeline
from contactfusion.controllers.face import FaceConfig, on_face
from contactfusion.controllers.pushing import ARRIVED
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Odometry, TactileImage, Twist
from contactfusion.robot_state import StateBuffer
from contactfusion_lab.experiments.push import experiment
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import Cycle, Ending, PushScene, pushed
from contactfusion_lab.scenes.push.world import Touches
from lab.tests.test_push_world import PERIOD, base

SKIN = yaml.safe_load(Path(experiment.__file__).with_name("skin.yaml").read_text())
NEAR = (0.4, 0.0)


def config(**fields: Any) -> PushConfig:
    return PushConfig(**{"target": NEAR, **fields})


def scene(seed: int = 0, **fields: Any) -> PushScene:
    return PushScene(config(**fields), base(), seed)


def driven(push: PushScene, cycles: int, *velocity: float) -> PushScene:
    for _ in range(cycles):
        push.drive(*velocity)
    return push


def pipeline(
    target: tuple[float, float] = NEAR, parameters: str = "tuned", **fields: Any
) -> Pipeline:
    controller = {"type": "reactive_pushing", "target": target, "parameters": parameters}
    return Pipeline(PipelineConfig(**{**SKIN, "controller": controller, **fields}))


@dataclass(frozen=True, eq=False)
class Done:
    """A push that is over."""

    cycles: list[Cycle]

    @property
    def last(self) -> Cycle:
        return self.cycles[-1]

    @property
    def modes(self) -> list[str]:
        return [cycle.step.command.mode for cycle in self.cycles if cycle.step.command]

    @property
    def kinds(self) -> list[str]:
        return [cycle.truth.kind for cycle in self.cycles]


def done(push: PushScene, by: Pipeline) -> Done:
    return Done(list(pushed(push, by)))


@cache
def arrived(noise: float = 0.05, seed: int = 0) -> Done:
    """Push the box to a target aside, once in all tests."""
    target = (1.0, 0.5)
    return done(scene(seed, target=target, skin={"noise": noise}), pipeline(target))


def silent(sensor: str, **when: float) -> dict[str, Any]:
    return {"faults": [{"fault": "silent", "sensor": sensor, **when}]}


# Readings


def test_readings_are_odometry_twist_and_skin_at_one_stamp() -> None:
    push = driven(scene(gap=1.0), 4, 0.2, -0.1, 0.5)
    odometry, twist, image = push.readings()
    assert isinstance(odometry, Odometry)
    assert isinstance(twist, Twist)
    assert isinstance(image, TactileImage)
    assert {reading.stamp for reading in push.readings()} == {4 * PERIOD}
    assert [(reading.frame, reading.sensor) for reading in push.readings()] == [
        ("odom", "odometry"), ("base", "wheels"), ("base", "skin")
    ]  # fmt: skip
    truth = push.truth()
    x, y, yaw = truth.base
    assert yaw == pytest.approx(0.2)
    assert odometry.child_frame == "base"
    assert odometry.position == pytest.approx([x, y, 0.45])
    assert odometry.orientation == pytest.approx([0, 0, math.sin(0.1), math.cos(0.1)])
    assert odometry.linear is not None and np.array_equal(odometry.linear, twist.linear)
    assert odometry.angular is not None and np.array_equal(odometry.angular, twist.angular)
    assert twist.linear == pytest.approx([0.2, -0.1, 0.0], abs=0.01)
    assert twist.angular == pytest.approx([0.0, 0.0, 0.5])
    assert image.values.shape == (40,) and abs(image.values).max() < 0.3


def test_the_skin_feels_the_force_of_the_truth() -> None:
    push = driven(scene(skin={"activation": 0.0, "noise": 1e-9}), 5, 0.2, 0.0, 0.0)
    image = push.readings()[2]
    assert isinstance(image, TactileImage)
    assert image.values[:12].sum() == pytest.approx(push.truth().force, abs=1e-6)
    assert abs(image.values[12:]).max() < 1e-6
    centres = base().patches["skin"].centres()[:12, 1]
    middle = np.average(centres, weights=image.values[:12].clip(0.0))
    assert middle == pytest.approx(push.truth().contact[1], abs=0.03)


def test_the_same_seed_reads_the_same_and_another_differs_in_the_skin_only() -> None:
    left, same, right = scene(1), scene(1), scene(2)
    for _ in range(5):
        first, second, third = (each.readings() for each in (left, same, right))
        assert [_bytes(reading) for reading in first] == [_bytes(reading) for reading in second]
        assert [_bytes(reading) for reading in first[:2]] == [_bytes(each) for each in third[:2]]
        assert _bytes(first[2]) != _bytes(third[2])
        for each in (left, same, right):
            each.drive(0.2, 0.05, 0.1)
        assert left.truth() == right.truth()


def _bytes(reading: Any) -> bytes:
    arrays = [value for value in vars(reading).values() if isinstance(value, np.ndarray)]
    return b"".join(value.tobytes() for value in arrays)


# The truth


def test_before_the_first_touch_there_is_none() -> None:
    truth = scene().truth()
    assert (truth.stamp, truth.kind, truth.force) == (0.0, "none", 0.0)
    assert np.isnan(truth.contact).all() and math.isnan(truth.distance)
    assert truth.base == pytest.approx((-0.3, 0.0, 0.0))
    assert truth.object == pytest.approx((0.201, 0.0, 0.0), abs=1e-3)


@pytest.mark.parametrize("offset", [0.0, 0.05, -0.2])
def test_a_box_that_is_pushed_squarely_touches_along_a_line(offset: float) -> None:
    """Its middle is that of what of the side is before the face."""
    push = driven(scene(offset=offset), 6, 0.2, 0.0, 0.0)
    right, left = max(offset - 0.2, -0.3), min(offset + 0.2, 0.3)
    truth = push.truth()
    assert truth.kind == "line"
    assert truth.contact == pytest.approx((0.3, (right + left) / 2.0), abs=5e-3)
    assert truth.distance == pytest.approx(
        math.hypot(NEAR[0] - truth.base[0] - 0.3, NEAR[1] - truth.contact[1]), abs=2e-3
    )


def test_a_corner_touches_at_a_point() -> None:
    yaw = math.radians(40.0)
    corner = 0.1 + 0.2 * (math.cos(yaw) - math.sin(yaw))
    truth = driven(scene(yaw=40.0, offset=0.1), 1, 0.1, 0.0, 0.0).truth()
    assert truth.kind == "point"
    assert truth.contact == pytest.approx((0.3, corner), abs=5e-3)


def test_the_distance_is_from_the_contact_wherever_the_robot_stands() -> None:
    push = driven(scene(target=(1.0, 1.0)), 12, 0.2, 0.1, 0.3)
    truth = push.truth()
    x, y, yaw = truth.base
    assert yaw > 0.3 and truth.kind != "none"
    forward, lateral = truth.contact
    there = complex(x, y) + complex(forward, lateral) * complex(math.cos(yaw), math.sin(yaw))
    assert truth.distance == pytest.approx(abs(1 + 1j - there))


def touching(*points: tuple[int, float, float]) -> Any:
    """The truth when these points touched: step, forward, lateral."""
    push = scene()
    rows = np.array(points, np.float64).reshape(-1, 3)
    places = np.column_stack([rows[:, 1:], np.full(len(rows), -0.2)])
    normals = np.tile([-1.0, 0.0, 0.0], (len(rows), 1))
    push.world.touches = Touches(rows[:, 0], places, normals, np.full(len(rows), 24.0))
    return push.truth()


def test_the_truth_is_all_that_touched_in_the_last_50_ms() -> None:
    """12 of the 24 steps of a cycle; no single step has both ends of the line."""
    both = touching((11, 0.3, -0.29), (12, 0.3, -0.1), (23, 0.3, 0.2))
    assert (both.kind, both.contact) == ("line", pytest.approx((0.3, 0.05)))
    early = touching((0, 0.3, -0.1), (11, 0.3, 0.2))
    assert early.kind == "none" and early.force == 2.0


def test_what_spans_less_than_5_cm_is_a_point_at_its_mean() -> None:
    point = touching((20, 0.3, 0.10), (21, 0.3, 0.10), (22, 0.3, 0.148))
    assert (point.kind, point.contact) == ("point", pytest.approx((0.3, 0.116)))
    line = touching((20, 0.3, 0.10), (21, 0.3, 0.10), (22, 0.3, 0.152))
    assert (line.kind, line.contact) == ("line", pytest.approx((0.3, 0.126)))


def test_a_line_may_lie_along_a_side() -> None:
    line = touching((20, 0.2, 0.3), (21, -0.1, 0.3), (22, 0.0, 0.3))
    assert (line.kind, line.contact) == ("line", pytest.approx((0.05, 0.3)))


# Bad input


@pytest.mark.parametrize("target", [(0.0, 0.0), (-0.3, 0.29), (-0.71, -0.3)])
def test_a_target_under_the_robot_is_refused(target: tuple[float, float]) -> None:
    with pytest.raises(
        ConfigurationError, match=r"^target: the target \(.*\) lies under the robot"
    ):
        scene(target=target)


@pytest.mark.parametrize("target", [(0.01, 0.0), (-0.3, 0.31), (-0.73, 0.0)])
def test_a_target_beside_the_robot_is_none_under_it(target: tuple[float, float]) -> None:
    assert scene(target=target).config.target == target


def test_a_robot_without_skin_is_refused() -> None:
    bare = base().model_copy(update={"patches": {"slin": base().patches["skin"]}})
    with pytest.raises(RobotError, match="a push needs a patch 'skin' .* did you mean 'slin'"):
        PushScene(config(), bare)


# The closed loop


@pytest.mark.slow
def test_a_push_arrives_in_truth_too() -> None:
    push = arrived()
    assert push.last.ending == Ending.ARRIVED and push.modes[-1] == ARRIVED
    assert ARRIVED not in push.modes[:-1]
    assert push.last.truth.distance <= config().within
    assert "push" in push.modes and "line" in push.kinds
    assert [cycle.ending for cycle in push.cycles[:-1]] == [None] * (len(push.cycles) - 1)


def test_cycles_follow_each_other_and_readings_are_those_of_the_cycle() -> None:
    for number, cycle in enumerate(arrived().cycles):
        stamps = {reading.stamp for reading in cycle.readings}
        assert stamps == {cycle.step.stamp} == {cycle.truth.stamp} == {number * PERIOD}


def test_a_command_moves_the_base_in_the_next_cycle() -> None:
    cycles = arrived().cycles
    for before, after in zip(cycles[5:-1], cycles[6:], strict=True):
        twist = before.step.command.twist if before.step.command else None
        assert twist is not None
        yaw = after.truth.base[2] - before.truth.base[2]
        assert yaw == pytest.approx(PERIOD * twist.angular[2], abs=1e-3)


def test_the_same_push_is_made_twice_bit_by_bit() -> None:
    again = done(scene(target=(1.0, 0.5)), pipeline((1.0, 0.5)))
    assert [repr(cycle.truth) for cycle in again.cycles] == [
        repr(cycle.truth) for cycle in arrived().cycles
    ]
    assert [cycle.truth.object for cycle in arrived(seed=1).cycles] != [
        cycle.truth.object for cycle in again.cycles
    ]


def test_the_controller_goes_by_what_is_felt_not_by_the_truth() -> None:
    """A noisy skin moves the contact that it decides on away from where it truly is."""
    push, off = arrived(noise=0.3), []
    for cycle in push.cycles:
        touch = on_face(cycle.step.fusion.contacts, FaceConfig())
        if touch and cycle.truth.kind != "none":
            off.append(touch.lateral - cycle.truth.contact[1])
    assert len(off) > 20 and np.std(off) > 1e-3


def test_who_feels_nothing_approaches_for_ever() -> None:
    """Only the skin's image carries the object to the controller."""
    push = done(scene(longest=6.0), pipeline(**silent("skin")))
    assert push.last.ending == Ending.TIMEOUT
    assert set(push.modes) == {"approach"}
    assert push.kinds.count("line") > 20 and math.dist(push.last.truth.object[:2], (0.2, 0)) > 1.0


def test_a_push_ends_when_it_takes_too_long() -> None:
    push = done(scene(longest=1.0), pipeline())
    assert push.last.ending == Ending.TIMEOUT
    assert push.last.truth.stamp == pytest.approx(1.0)


def test_a_push_ends_when_contact_is_missed_too_long_all_in_all() -> None:
    push = done(scene(gap=1.0, longest_lost=0.5), pipeline())
    assert push.last.ending == Ending.LOST
    assert push.kinds == ["none"] * 7  # the first is before any time has passed


def test_a_push_ends_when_the_object_is_too_far_away() -> None:
    push = done(scene(furthest=1.5), pipeline(**silent("skin")))
    assert push.last.ending == Ending.AWAY
    far = [math.hypot(*cycle.truth.object[:2]) for cycle in push.cycles]
    assert far[-1] > 1.5 >= max(far[:-1])


def test_without_a_controller_nothing_pushes() -> None:
    with pytest.raises(ConfigurationError, match="^controller: a push needs a controller$"):
        done(scene(), pipeline(controller=None))


def test_without_odometry_the_wheels_lead_to_the_target() -> None:
    push = done(scene(), pipeline(**silent("odometry", start=1.0)))
    assert push.last.ending == Ending.ARRIVED
    assert push.last.truth.distance <= 0.05


def test_what_the_wheels_measure_adds_up_to_the_path() -> None:
    push, buffer = scene(gap=1.5), StateBuffer()
    for reading in push.readings()[:2]:
        buffer.add(reading)
    for step in range(100):
        push.drive(0.2, 0.1, 0.4 if step < 60 else -0.2)
        (wheels,) = (reading for reading in push.readings() if isinstance(reading, Twist))
        buffer.add(wheels)
    base = buffer.base_pose(push.stamp)
    assert base is not None
    x, y, yaw = push.truth().base
    assert base[2][:2, 3] == pytest.approx([x, y], abs=1e-3)
    assert np.arctan2(base[2][1, 0], base[2][0, 0]) == pytest.approx(math.remainder(yaw, math.tau))


def test_a_controller_that_fails_ends_the_push_with_a_sentence() -> None:
    problem = "^controller: the controller gave no twist: .* needs odometry of the base$"
    with pytest.raises(ConfigurationError, match=problem):
        done(scene(), pipeline(**silent("odometry")))
