"""Contacts on an arm by the torques of its joints: the observer, and where a contact may be."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactfusion import IntegratorConfig, Pipeline, PipelineConfig
from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, InvalidReadingError, RobotError
from contactfusion.generators.external_torque import Effort, ExternalTorque
from contactfusion.generators.joint_torque import JointTorqueConfig, JointTorqueGenerator
from contactfusion.hypotheses import HypothesisCloud, Note, Resultant
from contactfusion.pipeline_config import CycleConfig
from contactfusion.readings import JointState, Wrench
from contactfusion.robots.description import (
    EffortConfig,
    LinkMassConfig,
    RobotConfig,
    WristConfig,
)
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import RobotModel
from tests.arms import ARM, BENT, SIGMA, STILL, known, pushed, reading, robot, state, whole

UP = np.array([0.0, 0.0, -9.81])
RUBS = np.array([1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
"""Joints with friction; the physics cannot follow it where little moves."""


def generator(**options: Any) -> JointTorqueGenerator:
    config = JointTorqueConfig(**{"effort": "external", "joints": known(), **options})
    return JointTorqueGenerator("arm", config)


def only(cloud: Sequence[HypothesisCloud]) -> HypothesisCloud:
    (found,) = cloud
    return found


def links_of(cloud: HypothesisCloud) -> dict[str, float]:
    """The probability of a contact on each link."""
    surface = state().placed_surface("test")
    names = [surface.link_names[surface.links[row]] for row in surface.nearest(cloud.positions)[1]]
    found = dict.fromkeys(names, 0.0)
    for name, probability in zip(names, cloud.likelihoods.tolist(), strict=True):
        found[name] += probability
    return found


@pytest.mark.parametrize("link", ["link_5", "link_6", "palm"])
@pytest.mark.parametrize("newtons", [10.0, 20.0])
def test_a_push_is_found_where_it_is(link: str, newtons: float) -> None:
    away, right = [], []
    for seed in range(12):
        point, force, torques = pushed(link, newtons, seed)
        cloud = only(generator().generate(reading(torques), state()))
        assert cloud.single and cloud.likelihoods.sum() == pytest.approx(0.95)
        assert cloud.forces is not None
        best = int(cloud.likelihoods.argmax())
        away.append(float(np.linalg.norm(cloud.positions[best] - point)))
        on = links_of(cloud)
        right.append(max(on, key=lambda name: on[name]))
    assert np.median(away) < 0.03
    hand = {name for name in robot().link_names if name.startswith(("finger", "palm", "wrist"))}
    near = {"link_5": {"link_4", "link_6"}, "link_6": {"link_5", "link_7"} | hand, "palm": hand}
    assert sum(name == link or name in near[link] for name in right) >= 10


def test_a_joint_that_feels_nothing_excludes_the_links_beyond_it() -> None:
    _, _, torques = pushed("link_3", 20.0)
    cloud = only(generator().generate(reading(torques), state()))
    assert cloud.notes == ("it cannot tell on which link: link_2, link_3, link_4",)


def test_near_the_base_it_cannot_tell() -> None:
    torques = np.zeros(len(ARM))
    torques[0] = 0.8
    cloud = only(generator().generate(reading(torques), state()))
    assert not len(cloud)
    assert any(note.startswith("it cannot tell on which link: link_1,") for note in cloud.notes)


def test_where_several_links_come_into_question_it_names_them_and_claims_all() -> None:
    named = 0
    for seed in range(12):
        _, _, torques = pushed("link_5", 10.0, seed)
        cloud = only(generator().generate(reading(torques), state()))
        for note in cloud.notes:
            links = note.removeprefix("it cannot tell on which link: ").split(", ")
            on = links_of(cloud)
            assert sum(on.get(name, 0.0) for name in links) >= 0.85 * cloud.likelihoods.sum() > 0.0
            assert all(on.get(name, 0.0) < 0.9 * cloud.likelihoods.sum() for name in links)
            named += 1
    assert 0 < named < 12


def test_noise_alone_is_no_contact() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        noise = SIGMA * rng.standard_normal(len(ARM))
        cloud = only(generator().generate(reading(noise), state()))
        assert not len(cloud) and not cloud.notes


def test_the_sign_of_an_external_torque_is_configured() -> None:
    point, _, torques = pushed("link_6", 20.0)
    cloud = only(generator(sign="by_robot").generate(reading(-torques), state()))
    best = int(cloud.likelihoods.argmax())
    assert np.linalg.norm(cloud.positions[best] - point) < 0.05


def test_two_pushes_at_once_are_told_apart_from_one() -> None:
    _, _, first = pushed("link_3", 30.0, 1)
    _, _, second = pushed("palm", 30.0, 2)
    cloud = only(generator(scale=0.0).generate(reading(first + second), state()))
    assert Note.MORE_THAN_ONE_CONTACT in cloud.notes


def test_a_robot_that_is_mounted_elsewhere_finds_it_there() -> None:
    base = np.eye(4)
    base[:3, :3] = Rotation.from_euler("xyz", [0.4, -0.2, 1.0]).as_matrix()
    base[:3, 3] = 0.5, -0.2, 0.8
    point, _, torques = pushed("link_6", 20.0, 4)
    here = only(generator().generate(reading(torques), state()))
    there = only(generator().generate(reading(torques), state(base=base)))
    best = there.positions[int(there.likelihoods.argmax())]
    expected = base[:3, :3] @ here.positions[int(here.likelihoods.argmax())] + base[:3, 3]
    assert np.linalg.norm(best - expected) < 0.02


def test_wrong_constants_make_it_less_sure_of_the_place() -> None:
    _, _, torques = pushed("link_6", 20.0, 5)
    wrong = torques * np.array([1.3, 0.8, 1.1, 0.9, 1.2, 0.75, 1.0])
    sure = only(generator(scale=0.05).generate(reading(torques), state()))
    wide = only(generator(scale=0.3).generate(reading(wrong), state()))
    assert len(wide) > 3 * len(sure)


def moving(
    effort: Effort, push: FloatArray, friction: float = 0.0, velocities: bool = True
) -> Iterator[JointState]:
    """An arm that swings under gravity and its motors, pushed from 1 s on; readings at 200 Hz."""
    pin, fingered = robot().kinematics
    held = [fingered.getJointId(name) for name in STILL]
    arm = pin.buildReducedModel(fingered, held, robot().configuration(whole(BENT)))
    data, step, zero = arm.createData(), 0.001, np.zeros(len(ARM))
    positions, speeds = BENT.copy(), zero
    for number in range(2000):
        stamp = number * step
        wanted = (
            BENT
            + 0.2 * np.sin(2.0 * stamp + np.arange(len(ARM)))
            - 0.2 * np.sin(np.arange(len(ARM)))
        )
        gravity = pin.computeGeneralizedGravity(arm, data, positions)
        inertia = np.diag(pin.crba(arm, data, positions))
        motors = gravity + inertia * (400.0 * (wanted - positions) - 40.0 * speeds)
        rubbed = friction * RUBS * np.tanh(speeds / 0.01)
        load = push if stamp >= 1.0 else zero
        if number % 5 == 0:
            reported = motors / (2.0 if effort == "current" else 1.0) + 0.3
            yield reading(reported, positions, stamp, velocities=speeds if velocities else None)
        acceleration = pin.aba(arm, data, positions, speeds, motors + load - rubbed)
        speeds = speeds + step * acceleration
        positions = positions + step * speeds


@pytest.mark.parametrize("effort", ["measured", "current"])
@pytest.mark.parametrize("velocities", [True, False])
def test_the_observer_tells_the_push_from_motors_gravity_and_friction(
    effort: Effort, velocities: bool
) -> None:
    push = np.array([3.0, -2.0, 1.0, 4.0, 0.5, -1.0, 0.2])
    constant = 2.0 if effort == "current" else 1.0
    joints = {
        name: EffortConfig(noise=SIGMA, offset=0.3, constant=constant, coulomb=0.5 * rubs)
        for name, rubs in zip(ARM, RUBS.tolist(), strict=True)
    }
    torque = ExternalTorque(Dynamics(robot()), joints, effort, gain=30.0, scale=0.0)
    free, loaded = [], []
    for each in moving(effort, push, 0.5, velocities):
        found = torque.update(each, whole(each.positions), UP)
        if found is None:
            assert each.stamp <= (0.0 if velocities else 0.005)
        elif 0.3 < each.stamp < 1.0:
            free.append(found[0][: len(ARM)])
        elif each.stamp > 1.3:
            loaded.append(found[0][: len(ARM)])
    assert np.abs(np.mean(free, axis=0)).max() < 0.15
    np.testing.assert_allclose(np.mean(loaded, axis=0), push, atol=0.35)


def test_readings_that_it_absorbs_count_as_those_of_which_it_makes_clouds() -> None:
    every, some = (generator(effort="measured") for _ in range(2))
    held = -Dynamics(robot()).drift(whole(BENT), np.zeros(len(whole(BENT))), UP)[: len(ARM)]
    push = pushed("link_6", 20.0)[2]
    readings = [reading(held - (n >= 100) * push, stamp=0.005 * n) for n in range(200)]
    for each in readings[:-1]:
        every.generate(each, state())
        some.absorb(each, state())
    last = readings[-1]
    expected = only(every.generate(last, state()))
    found = only(some.generate(last, state()))
    assert len(found.positions)
    np.testing.assert_array_equal(found.positions, expected.positions)
    np.testing.assert_array_equal(found.likelihoods, expected.likelihoods)


def test_friction_at_rest_may_be_anything_within_its_limit() -> None:
    torque = ExternalTorque(Dynamics(robot()), known(coulomb=1.0), "measured", 30.0, 0.0)
    found, zero = None, np.zeros(len(ARM))
    for stamp in np.arange(0.0, 1.0, 0.01).tolist():
        found = torque.update(reading(zero, BENT, stamp, velocities=zero), whole(BENT), UP)
    assert found is not None
    np.testing.assert_allclose(found[1][: len(ARM)], np.hypot(SIGMA, 1.0 / np.sqrt(3.0)))


def test_torques_of_a_fast_start_are_as_unsure_as_inertias() -> None:
    zero = np.zeros(len(ARM))
    deviations = {}
    for scale in (0.0, 0.1):
        torque = ExternalTorque(Dynamics(robot()), known(), "measured", 10.0, scale)
        for stamp, speeds in ((0.0, zero), (0.01, zero + 0.05)):
            begun = torque.update(reading(zero, BENT, stamp, velocities=speeds), whole(BENT), UP)
        assert begun is not None
        deviations[scale] = begun[1][: len(ARM)], begun[0][: len(ARM)]
    np.testing.assert_allclose(deviations[0.0][0], SIGMA)
    gained = Dynamics(robot()).momentum(whole(BENT), whole(zero + 0.05))[: len(ARM)]
    inertial = 10.0 * gained / (1.0 + 10.0 * 0.01)  # as late as the observer is
    expected = np.sqrt(SIGMA**2 + 0.01 * (deviations[0.1][1] ** 2 + inertial**2))
    np.testing.assert_allclose(deviations[0.1][0], expected)


def test_after_a_gap_the_observer_begins_again() -> None:
    torque = ExternalTorque(Dynamics(robot()), known(), "measured", 30.0, 0.0)
    zero = np.zeros(len(ARM))
    stamps = (0.0, 0.01, 1.0, 1.01, 1.005, 0.5)
    given = [
        torque.update(reading(zero, BENT, at, velocities=zero), whole(BENT), UP) for at in stamps
    ]
    assert [each is not None for each in given] == [False, True, False, True, True, False]


def test_without_velocities_it_begins_once_there_is_a_difference() -> None:
    torque, moved = ExternalTorque(Dynamics(robot()), known(), "measured", 30.0, 0.0), []
    for number, stamp in enumerate((0.0, 0.01, 0.02, 1.0, 1.01, 1.02)):
        arm = BENT + 0.2 * stamp
        held = -Dynamics(robot()).drift(whole(arm), whole(np.full(7, 0.2)), UP)[: len(ARM)]
        found = torque.update(reading(held, arm, stamp), whole(arm), UP)
        assert (found is None) == (number % 3 < 2)
        moved += [] if found is None else [np.abs(found[0]).max()]
    assert max(moved) < 0.2  # begun from rest it would be 4


def test_the_pipeline_finds_the_push_with_nothing_set() -> None:
    point, force, torques = pushed("link_6", 20.0, 4)
    config = PipelineConfig(
        robot=RobotConfig(
            urdf="contactfusion.robots:arm_hand.urdf", still=STILL, spacing=0.01, efforts=known()
        ),
        generators={"arm": {"type": "joint_torque", "effort": "external", "joints": list(ARM)}},
        integrator=IntegratorConfig(frame="base"),
        cycle=CycleConfig(on="joint_state"),
    )
    steps = Pipeline(config).run(reading(torques, stamp=0.01 * number) for number in range(30))
    (contact,) = [*steps][-1].fusion.contacts
    assert np.linalg.norm(contact.position - point) < 0.05
    assert contact.force @ force > 0.8 * np.linalg.norm(contact.force) * np.linalg.norm(force)


def test_a_joint_of_which_nothing_is_known_is_named() -> None:
    config = PipelineConfig(
        robot=RobotConfig(urdf="contactfusion.robots:arm_hand.urdf", still=STILL, efforts=known()),
        generators={"arm": {"type": "joint_torque", "effort": "external", "joints": ["arm_9"]}},
        integrator=IntegratorConfig(frame="base"),
        cycle=CycleConfig(on="joint_state"),
    )
    with pytest.raises(ConfigurationError, match="arm_9"):
        Pipeline(config)


# Bad input


def test_a_reading_without_efforts_is_refused() -> None:
    with pytest.raises(InvalidReadingError, match="has no efforts; a driver that reports"):
        generator().generate(reading(None), state())


def test_a_joint_without_effort_is_named() -> None:
    fewer = JointState(
        stamp=0.0, frame="base", names=ARM[:6], positions=BENT[:6], efforts=np.ones(6)
    )
    with pytest.raises(InvalidReadingError, match="no effort of 'arm_7'"):
        generator().generate(fewer, state())


def test_efforts_are_found_by_name_in_any_order() -> None:
    point, _, torques = pushed("link_6", 20.0, 6)
    order = np.array([3, 0, 6, 2, 5, 1, 4])
    turned = JointState(
        stamp=0.0, frame="base", names=tuple(ARM[row] for row in order), positions=BENT[order],
        efforts=torques[order],
    )  # fmt: skip
    straight = only(generator().generate(reading(torques), state()))
    again = only(generator().generate(turned, state()))
    np.testing.assert_array_equal(straight.likelihoods, again.likelihoods)
    assert len(point) == 3


def test_efforts_that_are_all_zero_are_of_no_sensor() -> None:
    cloud = only(generator().generate(reading(np.zeros(len(ARM))), state()))
    assert cloud.notes == ("every effort is exactly 0: its driver reports none",)


def test_an_unknown_joint_is_named_with_the_nearest() -> None:
    wrong = {"arm_8": EffortConfig(noise=0.1)}
    with pytest.raises(ConfigurationError, match="unknown joint 'arm_8'; .*'arm_"):
        generator(joints=wrong).prepare(robot())


def test_a_robot_without_inertias_is_refused_where_they_are_needed(tmp_path: Path) -> None:
    text = robot().urdf.path.read_text()
    path = tmp_path / "light.urdf"
    path.write_text(re.sub(r"<inertial>.*?</inertial>", "", text))
    light = RobotModel(RobotConfig(urdf=str(path), still=STILL))
    generator().prepare(light)
    with pytest.raises(RobotError, match="joint 'arm_1' moves no mass: give inertias of link_1"):
        generator(effort="measured").prepare(light)


# Beside a wrist


def held(force: FloatArray, point: FloatArray) -> Resultant:
    """The wrench of a force on the hand, as a sensor at the origin measures it."""
    links = robot().beyond("wrist_sensor")
    return Resultant(force, np.cross(point, force), np.zeros(3), 0.1, 0.01, links)


def test_what_a_wrist_measures_is_left_out_so_that_an_elbow_comes_apart_from_a_hand() -> None:
    elbow, _, first = pushed("link_4", 30.0, 1)
    hand, force, second = pushed("palm", 30.0, 2)
    both = reading(first + second)
    mixed = only(generator(scale=0.01).generate(both, state()))
    assert Note.MORE_THAN_ONE_CONTACT in mixed.notes
    beside = replace(state(), resultants={"wrist": held(force, hand)})
    cloud = only(generator(scale=0.01).generate(both, beside))
    assert cloud.notes == ()
    best = cloud.positions[int(cloud.likelihoods.argmax())]
    assert np.linalg.norm(best - elbow) < 0.06
    assert not {*robot().beyond("wrist_sensor")} & {*links_of(cloud)} - {
        name for name, share in links_of(cloud).items() if share == 0.0
    }


def test_a_hand_that_a_wrist_measures_alone_is_no_contact_of_the_arm() -> None:
    hand, force, torques = pushed("palm", 30.0, 2)
    beside = replace(state(), resultants={"wrist": held(force, hand)})
    assert not len(only(generator().generate(reading(torques), beside)))


def test_a_sudden_push_of_the_hand_is_no_contact_of_the_arm_while_the_observer_lags() -> None:
    hand, force, torques = pushed("palm", 30.0, 2)
    zero = np.zeros(len(ARM))
    gravity = Dynamics(robot()).drift(whole(BENT), whole(zero), UP)[: len(ARM)]
    beside = replace(state(), resultants={"wrist": held(force, hand)})
    arm, found = generator(effort="measured"), 0
    for step in range(40):
        pushes = step >= 10
        efforts = -gravity - pushes * torques
        given = reading(efforts, BENT, 0.01 * step, velocities=zero)
        clouds = arm.generate(given, beside if pushes else state())
        found += sum(len(cloud) for cloud in clouds)
    assert not found


def test_beside_a_wrist_that_feels_nothing_an_arm_is_found_as_without() -> None:
    point, _, torques = pushed("link_6", 20.0, 4)
    links = robot().beyond("wrist_sensor")
    silent = Resultant(np.full(3, 0.1), np.zeros(3), np.zeros(3), 0.3, 0.03, links)
    beside = replace(state(), resultants={"wrist": silent})
    cloud = only(generator().generate(reading(torques), beside))
    best = cloud.positions[int(cloud.likelihoods.argmax())]
    assert np.linalg.norm(best - point) < 0.05
    assert not {*links} & {name for name, share in links_of(cloud).items() if share > 0.0}


@pytest.mark.parametrize("newtons", [1.0, 2.0, 3.0, 4.0, 6.0])
def test_a_touch_of_the_hand_within_the_noise_of_its_wrist_is_none_of_the_arm(
    newtons: float,
) -> None:
    links = robot().beyond("wrist_sensor")
    sensor = robot().poses_at(whole(BENT))["wrist_sensor"][:3, 3]
    for seed in range(4):
        hand, force, torques = pushed("palm", newtons, seed)
        rng = np.random.default_rng(seed)
        measured = force + rng.standard_normal(3)
        torque = np.cross(hand - sensor, force) + 0.1 * rng.standard_normal(3)
        wrench = Resultant(measured, torque, sensor, 1.0, 0.1, links)
        beside = replace(state(), resultants={"wrist": wrench})
        assert not len(only(generator().generate(reading(torques), beside)))


def test_of_two_sensors_one_behind_the_other_the_first_measures_all() -> None:
    hand, force, torques = pushed("palm", 30.0, 2)
    whole_hand = held(force, hand)
    finger = Resultant(0.1 * force, np.zeros(3), hand, 0.1, 0.01, ("finger_1_distal",))
    beside = replace(state(), resultants={"wrist": whole_hand, "finger": finger})
    assert not len(only(generator().generate(reading(torques), beside)))


def test_a_wrist_that_dies_while_it_is_touched_leaves_the_hand_to_the_joints() -> None:
    wrist = {"type": "force_torque", "sensor": "wrist", "wrist": "wrist", "load": "robot"}
    described = RobotConfig(
        urdf="contactfusion.robots:arm_hand.urdf", still=STILL, spacing=0.01, efforts=known(),
        wrists={"wrist": WristConfig(frame="wrist_sensor", sign="on_robot")},
    )  # fmt: skip
    config = PipelineConfig(
        robot=described, generators={"wrist": wrist}, integrator=IntegratorConfig(frame="base")
    )
    pipeline = Pipeline(config)

    def measured(stamp: float, force: float) -> set[str]:
        pipeline.receive(reading(None, stamp=stamp))
        given = np.full(3, force), np.zeros(3)
        pipeline.receive(
            Wrench(
                stamp=stamp, frame="wrist_sensor", sensor="wrist", force=given[0], torque=given[1]
            )
        )
        return {*pipeline.state(stamp).resultants}

    assert measured(0.0, 20.0) == {"wrist"}
    assert measured(0.01, 0.0) == set()  # exact zeros under a load
    assert measured(0.02, 20.0) == {"wrist"}
    assert not pipeline.state(0.5).resultants  # nothing came since


# Masses in place of those of the URDF


def test_a_heavier_link_loads_the_joints_by_its_weight() -> None:
    link = robot().urdf.links["link_4"]
    x, y, z = link.centre_of_mass
    changed = LinkMassConfig(mass=link.mass + 1.0, centre_of_mass=(x, y, z))
    heavy = RobotModel(robot().config.model_copy(update={"masses": {"link_4": changed}}))
    at, rest = whole(BENT), np.zeros(len(whole(BENT)))
    more = Dynamics(heavy).drift(at, rest, UP) - Dynamics(robot()).drift(at, rest, UP)
    _, columns = Dynamics(robot()).payload_columns("link_4", at, rest, UP)
    np.testing.assert_allclose(more, columns[:, :4] @ [1.0, x, y, z], atol=1e-9)
    assert np.abs(more).max() > 1.0
    poses = robot().poses_at(at)
    before = robot().load_on("link_4", poses)[0]
    assert heavy.load_on("link_4", poses)[0] == pytest.approx(before + 1.0)


def test_the_same_mass_changes_nothing() -> None:
    link = robot().urdf.links["link_4"]
    same = LinkMassConfig(mass=link.mass, centre_of_mass=link.centre_of_mass)
    again = RobotModel(robot().config.model_copy(update={"masses": {"link_4": same}}))
    at, rest = whole(BENT), np.full(len(whole(BENT)), 0.3)
    np.testing.assert_allclose(
        Dynamics(again).momentum(at, rest), Dynamics(robot()).momentum(at, rest), atol=1e-12
    )


def test_the_mass_of_an_unknown_link_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(ConfigurationError, match="unknown link 'link_44'.*'link_4'"):
        mass = LinkMassConfig(mass=1.0, centre_of_mass=(0.0, 0.0, 0.0))
        RobotModel(robot().config.model_copy(update={"masses": {"link_44": mass}}))


@pytest.mark.parametrize(("sign", "times"), [("by_robot", 1), ("on_robot", 0)])
def test_torques_that_hold_the_arm_with_the_wrong_sign_are_told_once(sign: str, times: int) -> None:
    still, positions = np.zeros(len(ARM)), whole(BENT)
    held = -Dynamics(robot()).drift(positions, np.zeros(len(positions)), UP)[: len(ARM)]
    arm = generator(effort="measured", sign=sign)
    notes = [
        note
        for step in range(80)
        for cloud in arm.generate(reading(held, stamp=0.05 * step, velocities=still), state())
        for note in cloud.notes
    ]
    assert notes.count(Note.REVERSED) == times


def test_a_driver_by_name_reports_minus_the_torque_of_the_motors() -> None:
    still, positions = np.zeros(len(ARM)), whole(BENT)
    held = -Dynamics(robot()).drift(positions, np.zeros(len(positions)), UP)[: len(ARM)]
    arm = JointTorqueGenerator(
        "arm", JointTorqueConfig.model_validate({"vendor": "kinova_torque", "joints": known()})
    )
    clouds: Sequence[HypothesisCloud] = ()
    for step in range(40):
        clouds = arm.generate(reading(-held, stamp=0.05 * step, velocities=still), state())
    assert not len(only(clouds)) and not only(clouds).notes


def test_one_limb_of_several_states_no_force() -> None:
    _, _, torques = pushed("link_6", 20.0)
    stated = only(generator().generate(reading(torques), state()))
    limb = only(generator(forces=False).generate(reading(torques), state()))
    assert stated.forces is not None and limb.forces is None
    assert limb.likelihoods.tolist() == stated.likelihoods.tolist()
