"""Joint torques as they come: frames, gaps, grippers, slow topics, wrists that come and go."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import IntegratorConfig, Pipeline, PipelineConfig
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, InvalidReadingError
from contactfusion.frames import inverse, vectors_in
from contactfusion.generators.external_torque import ExternalTorque
from contactfusion.generators.joint_torque import (
    NO_EFFORTS,
    SLOW,
    JointTorqueConfig,
    JointTorqueGenerator,
)
from contactfusion.hypotheses import HypothesisCloud, Resultant
from contactfusion.pipeline_config import CycleConfig
from contactfusion.readings import JointState, Reading, Wrench
from contactfusion.robots.description import EffortConfig, RobotConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from tests.arms import ARM, BENT, SIGMA, STILL, known, pushed, reading, robot, state, whole

UP = np.array([0.0, 0.0, -9.81])
REST = np.zeros(len(ARM))
HELD: FloatArray = -Dynamics(robot()).drift(whole(BENT), whole(REST), UP)[: len(ARM)]
"""The torques of motors that hold the arm."""
GRIPPER = "finger_1_proximal_joint"


def generator(**options: Any) -> JointTorqueGenerator:
    config = JointTorqueConfig(**{"effort": "external", "joints": known(), **options})
    return JointTorqueGenerator("arm", config)


def only(clouds: Sequence[HypothesisCloud]) -> HypothesisCloud:
    (found,) = clouds
    return found


def pipeline(**options: Any) -> Pipeline:
    described = RobotConfig(
        urdf="contactfusion.robots:arm_hand.urdf", still=STILL, spacing=0.01, efforts=known()
    )
    arm = {"type": "joint_torque", "joints": list(ARM), **options}
    return Pipeline(
        PipelineConfig(
            robot=described,
            generators={"arm": arm},
            integrator=IntegratorConfig(frame="base"),
            cycle=CycleConfig(every=0.02),
        )
    )


def driven(positions: FloatArray, speeds: FloatArray, accelerations: FloatArray) -> FloatArray:
    """The torques of motors in motion, shape (7,)."""
    pin, model = robot().kinematics
    model = model.copy()
    model.gravity.linear = UP
    data = model.createData()
    torques: FloatArray = pin.rnea(
        model, data, whole(positions), whole(speeds), whole(accelerations)
    )
    return torques[: len(ARM)]


def swinging(stamp: float, size: float = 0.4) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions, speeds and accelerations."""
    angle = 2.0 * stamp + np.arange(len(ARM))
    return (
        BENT + size * np.sin(angle),
        2.0 * size * np.cos(angle),
        -4.0 * size * np.sin(angle),
    )


def beside(force: FloatArray, point: FloatArray, **wrists: tuple[str, ...]) -> Any:
    """The state with wrenches of a force on the hand, by sensor the links that each carries."""
    links = wrists or {"wrist": robot().beyond("wrist_sensor")}
    wrench = Resultant(force, np.cross(point, force), np.zeros(3), 0.1, 0.01)
    held = {name: replace(wrench, links=each) for name, each in links.items()}
    return replace(state(), resultants=held)


@pytest.mark.parametrize("frame", ["base", "joints"])
def test_a_push_ends_whatever_the_frame_of_its_readings(frame: str) -> None:
    """Headers of joint states name no frame as a rule."""
    _, _, push = pushed("link_6", 20.0, 4)
    running = pipeline(effort="external")
    rng, felt = np.random.default_rng(0), []
    for stamp in np.arange(0.0, 1.5, 0.02).round(9).tolist():
        torques = push * (0.5 <= stamp < 1.0) + SIGMA * rng.standard_normal(len(ARM))
        running.receive(replace(reading(torques, stamp=stamp), frame=frame))
        felt += [stamp] * bool(running.step(stamp).fusion.contacts)
    assert 0.5 <= felt[0] <= 0.54 and 0.98 <= felt[-1] <= 1.02


def test_joints_that_report_no_effort_move_the_others() -> None:
    moves = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    some = ExternalTorque(
        Dynamics(robot()), {name: EffortConfig(noise=SIGMA) for name in ARM[3:]}, "measured", 30, 0
    )
    found = None
    for stamp in np.arange(0.0, 1.0, 0.002).tolist():
        angle = 4.0 * stamp
        arm = BENT + 0.5 * moves * np.sin(angle)
        speeds = 2.0 * moves * np.cos(angle)
        torques = driven(arm, speeds, -8.0 * moves * np.sin(angle))
        found = some.update(reading(torques, arm, stamp, velocities=speeds), whole(arm), UP)
    assert found is not None and np.abs(found[0][3:7]).max() < 0.1  # as if at rest it is 11


@pytest.mark.parametrize(("newtons", "scale"), [(400.0, 0.05), (800.0, 0.05), (400.0, 0.3)])
def test_a_blow_is_a_contact_however_hard(newtons: float, scale: float) -> None:
    point, _, torques = pushed("link_5", newtons)
    cloud = only(generator(scale=scale).generate(reading(torques), state()))
    assert cloud.likelihoods.sum() > 0.9
    best = cloud.positions[int(cloud.likelihoods.argmax())]
    assert np.linalg.norm(best - point) < 0.05


def test_a_gripper_neither_ends_the_contact_of_the_arm_nor_hides_that_it_is_dead() -> None:
    _, _, push = pushed("link_6", 20.0, 4)
    arm = generator(effort="measured")

    def gripper(stamp: float, effort: float) -> JointState:
        return JointState(
            stamp=stamp, frame="base", names=(GRIPPER,), positions=np.zeros(1),
            efforts=np.full(1, effort),
        )  # fmt: skip

    clouds: Sequence[HypothesisCloud] = ()
    for number in range(100):
        given = reading(HELD - (number >= 50) * push, BENT, 0.01 * number, velocities=REST)
        clouds = arm.generate(given, state())
        assert not arm.generate(gripper(0.01 * number + 0.001, 0.0), state())
        assert not arm.generate(gripper(0.01 * number + 0.002, 0.3), state())
    assert len(only(clouds))
    dead = JointState(
        stamp=1.5, frame="base", names=(*ARM, GRIPPER), positions=np.zeros(8),
        efforts=np.r_[np.zeros(7), 0.3],
    )  # fmt: skip
    assert only(arm.generate(dead, state())).notes == (NO_EFFORTS,)


@pytest.mark.parametrize("fails", ["joints", "wrist"])
def test_after_a_gap_a_hand_that_a_wrist_measures_is_no_contact_of_the_arm(fails: str) -> None:
    hand, force, push = pushed("palm", 30.0, 2)
    arm, stamp = generator(effort="measured"), 0.0
    for number in range(200):
        stamp += 0.4 if number == 100 and fails == "joints" else 0.01
        is_blind = fails == "wrist" and 80 <= number < 120
        given = reading(HELD - push, BENT, stamp, velocities=REST)
        clouds = arm.generate(given, state() if is_blind else beside(force, hand))
        assert is_blind or not any(len(cloud) for cloud in clouds)


def beside_its_wrist(
    first: str = "joints",
    every: float = 0.05,
    begins: float = 0.0,
    live: bool = False,
    **wrist: Any,
) -> Sequence[HypothesisCloud]:
    """The clouds of an arm whose hand is pushed, and whose wrist measures that.

    Args:
        first: which of `joints` and `wrist` is read first.
        every: time between steps [s].
        begins: the stamp of the first push [s].
        live: whether readings that a newer one follows are absorbed.
        wrist: further options of the wrist's generator.
    """
    point, force, push = pushed("palm", 20.0)
    pose = PosedRobot(robot(), whole(BENT), "base", np.eye(4)).pose_of("wrist_sensor")
    felt = vectors_in(inverse(pose), np.stack([force, np.cross(point - pose[:3, 3], force)]))
    wrist = {
        "type": "force_torque", "sign": "on_robot", "force_noise": 0.1, "torque_noise": 0.005,
        **wrist,
    }  # fmt: skip
    clouds = list[HypothesisCloud]()
    running = Pipeline(
        PipelineConfig(
            robot=RobotConfig(urdf="contactfusion.robots:arm_hand.urdf", still=STILL, spacing=0.01),
            generators={
                "arm": {"type": "joint_torque", "effort": "measured", "joints": known()},
                "wrist": wrist,
            },
            integrator=IntegratorConfig(frame="base"),
        ),
        tell=clouds.append,
    )
    running.conflates = live
    rng, steps = np.random.default_rng(0), 1
    for stamp in np.arange(0.01, 1.5, 0.01).tolist():
        noise, pushes = SIGMA * rng.standard_normal(len(ARM)), float(stamp >= begins)
        joints = reading(HELD - pushes * push + noise, BENT, stamp, velocities=REST)
        wrench = Wrench(
            stamp=stamp, frame="wrist_sensor", force=pushes * felt[0], torque=pushes * felt[1]
        )
        both: tuple[Reading, ...] = (joints, wrench)
        for each in both if first == "joints" else both[::-1]:
            running.take(each)
        if stamp >= steps * every:
            running.step(stamp)
            steps += 1
    return [cloud for cloud in clouds if cloud.source == "arm"]


@pytest.mark.parametrize("every", [0.05, 0.2])
@pytest.mark.parametrize("first", ["joints", "wrist"])
def test_live_a_hand_that_a_wrist_measures_is_no_contact_of_the_arm(
    first: str, every: float
) -> None:
    arm = beside_its_wrist(first, every, live=True)
    assert len(arm) >= 6 and not any(len(cloud) for cloud in arm)


@pytest.mark.parametrize("first", ["joints", "wrist"])
def test_nor_is_it_while_the_wrist_averages_the_beginning_of_a_push(first: str) -> None:
    arm = beside_its_wrist(first, begins=0.5, average=0.1)
    assert len(arm) > 100 and not any(len(cloud) for cloud in arm)


def test_positions_are_those_of_the_reading_whatever_a_slow_topic_said() -> None:
    running, felt = pipeline(effort="measured", sensor="fast"), 0
    for number in range(200):
        stamp = 0.005 * number
        arm, speeds, accelerations = swinging(stamp)
        if number % 10 == 0:
            names, both = (*ARM, "finger_1_spread"), np.r_[arm, 0.0]
            running.receive(
                JointState(stamp=stamp, frame="base", sensor="slow", names=names, positions=both)
            )
        torques = driven(arm, speeds, accelerations)
        given = reading(torques, arm, stamp, velocities=speeds, sensor="fast")
        running.receive(given)
        felt += number % 4 == 0 and bool(running.step(stamp).fusion.contacts)
    assert not felt


def test_an_effort_that_a_joint_does_not_report_is_named() -> None:
    efforts = np.ones(len(ARM))
    efforts[6] = np.nan
    cloud = only(generator().generate(reading(efforts), state()))
    assert not len(cloud) and cloud.notes == ("its driver reports no effort of arm_7",)
    efforts[6] = 1e300
    with pytest.raises(InvalidReadingError, match=r"has an effort of 1e\+300 of 'arm_7'"):
        generator().generate(reading(efforts), state())
    other = JointState(
        stamp=0.0, frame="base", names=(*ARM, GRIPPER), positions=np.r_[BENT, 0.0],
        efforts=np.r_[pushed("link_6", 20.0)[2], np.nan],
    )  # fmt: skip
    assert len(only(generator().generate(other, state())))


def test_of_two_sensors_of_the_same_links_one_is_taken_off() -> None:
    hand, force, push = pushed("palm", 30.0, 2)
    links = robot().beyond("wrist_sensor")
    both = beside(force, hand, wrist=links, filtered=links)
    assert not len(only(generator().generate(reading(push), both)))


def test_a_sensor_under_the_base_leaves_the_arm_to_its_joints() -> None:
    point, force, push = pushed("link_5", 20.0, 4)
    below = beside(force, point, base=robot().link_names)
    alone = only(generator().generate(reading(push), state()))
    cloud = only(generator().generate(reading(push), below))
    np.testing.assert_array_equal(cloud.positions, alone.positions)
    hand, force, push = pushed("palm", 30.0, 2)
    both = beside(force, hand, base=robot().link_names, wrist=robot().beyond("wrist_sensor"))
    assert not len(only(generator().generate(reading(push), both)))  # the wrist counts beside it


def test_joints_beyond_a_sensor_tell_nothing_of_what_it_does_not_carry() -> None:
    model, surface = robot(), state().placed_surface("test")
    names, at = model.joint_names, whole(BENT)
    linear, angular = Dynamics(model).axes(at)
    link = model.link_names.index("finger_1_distal")
    row = np.flatnonzero(surface.links == link)[0]
    point, force = surface.points[row], -10.0 * surface.normals[row]
    lever = (linear + np.cross(angular, point)) @ force
    torques = np.where(Dynamics(model).supports[link], lever, 0.0)
    torques[: len(ARM)] += pushed("link_5", 20.0, 4)[2]
    joints = {name: EffortConfig(noise=SIGMA) for name in names}
    given = JointState(stamp=0.0, frame="base", names=names, positions=at, efforts=torques)
    cloud = only(generator(joints=joints).generate(given, beside(force, point)))
    best = cloud.positions[int(cloud.likelihoods.argmax())]
    assert np.linalg.norm(best - pushed("link_5", 20.0, 4)[0]) < 0.05


def test_silence_beside_a_hand_that_is_left_to_a_wrist_says_so() -> None:
    hand, force, push = pushed("palm", 30.0, 2)
    cloud = only(generator().generate(reading(push), beside(force, hand)))
    (note,) = cloud.notes
    assert note.startswith("what touches these links is left to another sensor: ")
    assert "palm" in note


def test_a_reading_that_comes_twice_says_nothing_new_and_slow_ones_are_named() -> None:
    torque = ExternalTorque(Dynamics(robot()), known(), "measured", 10.0, 0.0)
    push = np.array([3.0, -2.0, 1.0, 4.0, 0.5, -1.0, 0.2])
    found = None
    for stamp in np.repeat(np.arange(0.0, 2.0, 0.125), 2).tolist():
        found = torque.update(reading(HELD - push, BENT, stamp, velocities=REST), whole(BENT), UP)
    assert found is not None
    np.testing.assert_allclose(found[0][: len(ARM)], push, rtol=0.01)
    arm = generator(effort="measured")
    given = [reading(HELD, BENT, stamp, velocities=REST) for stamp in (0.0, 0.5)]
    assert not arm.generate(given[0], state())
    assert only(arm.generate(given[1], state())).notes == (SLOW,)


def test_a_reading_that_a_newer_one_overtook_changes_nothing() -> None:
    _, _, push = pushed("link_6", 20.0)
    arm, probable = generator(effort="measured"), list[float]()
    stamps = [0.01 * number for number in range(100)]
    stamps[80:82] = stamps[81], stamps[80]
    for stamp in stamps:
        given = reading(HELD - (stamp > 0.4) * push, BENT, stamp, velocities=REST)
        clouds = arm.generate(given, state())
        probable += [float(cloud.likelihoods.sum()) for cloud in clouds if stamp > 0.705]
    assert len(probable) == 29 and min(probable) > 0.9


@pytest.mark.parametrize("gain", [3.0, 10.0])
def test_a_joint_that_breaks_away_is_no_contact(gain: float) -> None:
    coulomb = np.linspace(1.2, 0.2, 7)
    joints = {
        name: EffortConfig(noise=0.1, coulomb=each)
        for name, each in zip(ARM, coulomb.tolist(), strict=True)
    }
    arm, positions = generator(effort="measured", joints=joints, gain=gain), BENT.copy()
    side, found = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0]), list[float]()
    for stamp in np.arange(0.0, 1.8, 0.005).tolist():
        speeds = np.full(7, 0.2 * np.clip((stamp - 1.0) / 0.1, 0.0, 1.0))
        rising = np.full(7, 2.0 if 1.0 < stamp < 1.1 else 0.0)
        positions = positions + 0.005 * speeds
        friction = coulomb * (0.9 * side if stamp <= 1.0 else np.tanh(speeds / 0.01))
        efforts = driven(positions, speeds, rising) + friction
        given = reading(efforts, positions, stamp, velocities=speeds)
        found += [float(each.likelihoods.sum()) for each in arm.generate(given, state(positions))]
    assert len(found) > 300 and max(found) < 0.5


def test_a_joint_that_passes_half_a_turn_does_not_leap(tmp_path: Path) -> None:
    text = robot().urdf.path.read_text()
    first = text.index('<joint name="arm_7" type="revolute">')
    last = text[first:].replace("revolute", "continuous", 1)
    path = tmp_path / "arm.urdf"
    path.write_text(text[:first] + last)
    turning = RobotModel(RobotConfig(urdf=str(path), still=STILL))
    torque = ExternalTorque(Dynamics(turning), known(), "measured", 10.0, 0.0)
    found = None
    for number, angle in enumerate((3.10, 3.12, 3.14, -3.1232, -3.1032)):
        arm = np.r_[BENT[:6], angle]
        held = -Dynamics(robot()).drift(whole(arm), whole(REST), UP)[: len(ARM)]
        found = torque.update(reading(held, arm, 0.1 * number), whole(arm), UP)
    assert found is not None and np.abs(found[0]).max() < 0.2


def test_noise_that_no_joint_has_is_taken_for_the_least_that_one_may_have() -> None:
    for noise in (1e-3, 1e-6):
        _, _, push = pushed("link_2", 20.0)
        cloud = only(generator(joints=known(noise=noise)).generate(reading(push), state()))
        assert not len(cloud) and cloud.notes


# Configurations that can tell nothing


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"links": ("base",)}, "links: none of `joints` moves base: what touches there loads none"),
        (
            {"joints": {"arm_1": EffortConfig(noise=0.1), "arm_2": EffortConfig(noise=0.1)}},
            "joints: 2 joints cannot tell where on",
        ),
    ],
)
def test_what_can_tell_nothing_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError) as refusal:
        generator(**options).prepare(robot())
    assert words in str(refusal.value)


def test_a_joint_that_drives_another_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    text = robot().urdf.path.read_text()
    name = '<joint name="finger_2_spread"'
    start = text.index(name)
    end = text.index("</joint>", start)
    mimic = '<mimic joint="finger_1_spread"/>'
    path.write_text(text[:end] + mimic + text[end:])
    model = RobotModel(RobotConfig(urdf=str(path)))
    joints = {**known(), "finger_1_spread": EffortConfig(noise=0.1)}
    with pytest.raises(ConfigurationError, match="'finger_1_spread' drives 'finger_2_spread'"):
        generator(joints=joints).prepare(model)
