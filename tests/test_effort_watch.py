"""Efforts that are not to be believed: payloads, constants, inertias, dead joints, late efforts."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Pipeline, PipelineConfig
from contactfusion.arrays import FloatArray
from contactfusion.doctor.robot import mass_faults
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.generators.effort_watch import NEVER_FREE, OFTEN, FrozenEfforts, LoadWatch
from contactfusion.generators.joint_torque import FROZEN, JointTorqueConfig, JointTorqueGenerator
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.robots.description import EffortConfig, PayloadConfig, RobotConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import RobotModel
from tests.arms import ARM, BENT, STILL, pushed, reading, robot, state
from tests.free_motion import Joints, Sines, table

NOISE = np.linspace(0.15, 0.05, 7)
"""Of torques as they are used [N·m]; samples have twice as much."""
QUIET = Joints(
    offset=np.zeros(7), coulomb=np.zeros(7), viscous=np.zeros(7), noise=2.0 * NOISE
)  # fmt: skip
HOVER = Sines(span=np.full(7, 0.005), middle=BENT)


def played(
    rows: FloatArray, every: int = 5, arms: RobotModel | None = None, **options: Any
) -> list[HypothesisCloud]:
    """The clouds of each fifth reading; all others are absorbed."""
    efforts = {
        name: EffortConfig(noise=noise, constant=1.0)
        for name, noise in zip(ARM, NOISE.tolist(), strict=True)
    }
    config = JointTorqueConfig(**{"effort": "measured", "joints": efforts, **options})
    arm, clouds = JointTorqueGenerator("arm", config), list[HypothesisCloud]()
    for number, row in enumerate(rows):
        posed = state(row[1:8])
        given = reading(row[8:15], row[1:8], float(row[0]))
        if number % every:
            arm.absorb(given, posed)
        else:
            clouds += arm.generate(given, posed)
    return clouds


def claimed(clouds: list[HypothesisCloud], after: float) -> list[float]:
    """Stamps of the claims that come later."""
    return [cloud.stamp for cloud in clouds if len(cloud) and cloud.stamp > after]


def hovering(
    payload: PayloadConfig | None = None, joints: Joints = QUIET, **more: Any
) -> FloatArray:
    return table(joints, payload, 2.0, 100.0, 0, HOVER, **more)


@pytest.mark.parametrize("mass", [0.3, 0.8, 2.0])
def test_an_unknown_payload_is_no_contact_and_gets_a_sentence(mass: float) -> None:
    tool = PayloadConfig(frame="link_7", mass=mass, centre_of_mass=(0.02, -0.03, 0.12))
    clouds = played(hovering(tool))
    assert not claimed(clouds, 0.3)
    assert NEVER_FREE in clouds[-1].notes


def test_constants_that_are_wrong_claim_no_contact_and_get_a_sentence() -> None:
    wrong = np.array([1.3, 0.7, 1.3, 0.7, 1.3, 0.7, 1.3])
    for constants in (np.full(7, 1.3), wrong, np.array([1.0, 1.0, 1.0, 1.3, 1.0, 1.0, 1.0])):
        clouds = played(hovering(joints=replace(QUIET, constant=1.0 / constants)))
        assert not claimed(clouds, 0.3)
        assert NEVER_FREE in clouds[-1].notes


def test_an_arm_that_was_free_before_it_is_pushed_is_believed() -> None:
    clouds = played(hovering(push=(1.0, 9.0, pushed("link_6", 20.0)[2])))
    assert claimed(clouds, 0.0)[0] >= 1.0
    assert len(claimed(clouds, 1.3)) == len([cloud for cloud in clouds if cloud.stamp > 1.3])
    assert not any(NEVER_FREE in cloud.notes for cloud in clouds)


def test_where_links_are_given_a_contact_from_the_start_is_one() -> None:
    rows = hovering(push=(0.0, 9.0, pushed("link_6", 20.0)[2]))
    assert NEVER_FREE in played(rows)[-1].notes
    assert len(claimed(played(rows, links=("link_6", "palm")), 0.5)) > 10


@pytest.mark.parametrize("joint", [1, 3, 5])
def test_a_joint_that_reports_exactly_0_is_left_out_and_named(joint: int) -> None:
    point, _, push = pushed("palm", 40.0, 3)
    rows = hovering(push=(1.0, 9.0, push))
    rows[:, 8 + joint] = 0.0
    clouds = played(rows)
    assert f"{FROZEN}{ARM[joint]}" in clouds[-1].notes
    assert not claimed([cloud for cloud in clouds if cloud.stamp < 1.0], 0.3)
    for cloud in clouds[-5:]:  # the others go on
        away = np.linalg.norm(cloud.positions - point, axis=1)
        assert cloud.likelihoods[away < 0.15].sum() > 0.5 * cloud.likelihoods.sum() > 0.2


def test_an_effort_that_freezes_in_motion_is_left_out() -> None:
    rows = table(QUIET, None, 4.0, 100.0, 0, Sines(span=np.full(7, 0.3), middle=BENT))
    rows[100:, 11] = rows[100, 11]
    clouds = played(rows)
    assert f"{FROZEN}{ARM[3]}" in clouds[-1].notes
    assert not len(clouds[-1])


def test_efforts_in_coarse_steps_are_not_frozen_while_an_arm_that_is_held_is_pushed() -> None:
    rows = hovering(
        push=(1.0, 9.0, pushed("link_6", 20.0)[2]), joints=replace(QUIET, noise=np.zeros(7))
    )
    rows[:, 1:8], rows[:, 8:] = BENT, np.round(rows[:, 8:], 1)
    rows[:, 8:] = np.where(rows[:, :1] < 1.0, rows[0, 8:], rows[-1, 8:])
    clouds = played(rows)
    assert not any(note.startswith(FROZEN) for cloud in clouds for note in cloud.notes)
    assert len(claimed(clouds, 1.5)) >= 9


def test_after_a_gap_a_push_that_goes_on_freezes_no_effort() -> None:
    rows = np.zeros((300, 15))
    rows[:, 0], rows[:, 1:8] = 0.01 * np.arange(300), BENT
    held = hovering(joints=replace(QUIET, noise=np.zeros(7)))[0, 8:]
    push = pushed("link_6", 20.0)[2]
    rows[:, 8:] = np.where(rows[:, :1] < 1.0, held, held - push)
    rows[200:, 0] += 0.4  # the observer begins again
    clouds = played(rows)
    assert not any(note.startswith(FROZEN) for cloud in clouds for note in cloud.notes)
    assert len(clouds[-1])


@pytest.mark.parametrize(("late", "sentence"), [(4, OFTEN), (10, NEVER_FREE)])
def test_efforts_later_than_positions_get_a_sentence(late: int, sentence: str) -> None:
    rows = table(QUIET, None, 20.0, 100.0, 0, Sines(span=np.full(7, 0.5), middle=BENT))
    rows[:, 8:] = np.roll(rows[:, 8:], late, axis=0)
    notes = {note for cloud in played(rows[late:]) for note in cloud.notes}
    assert sentence in notes


def test_free_motion_and_short_pushes_get_no_sentence() -> None:
    rows = table(
        QUIET,
        None,
        20.0,
        100.0,
        0,
        Sines(span=np.full(7, 0.3), middle=BENT),
        (5.0, 8.0, pushed("link_6", 20.0)[2]),
    )
    notes = {note for cloud in played(rows) for note in cloud.notes}
    assert not notes & {OFTEN, NEVER_FREE}


def test_currents_without_a_constant_are_refused() -> None:
    config = JointTorqueConfig(
        effort="current",
        joints={name: EffortConfig(noise=0.1, constant=10.0) for name in ARM[:-1]}
        | {ARM[-1]: EffortConfig(noise=0.1)},
    )
    with pytest.raises(ConfigurationError, match=r"no torque per ampere of arm_7: give each its"):
        JointTorqueGenerator("arm", config).prepare(robot())


def test_currents_of_a_description_without_a_constant_are_refused() -> None:
    known = {name: EffortConfig(noise=0.1) for name in ARM}
    config = PipelineConfig.model_validate(
        {
            "robot": robot().config.model_copy(update={"efforts": known}),
            "generators": {"arm": {"type": "joint_torque", "effort": "current", "joints": [*ARM]}},
            "integrator": {"frame": "base"},
        }
    )
    sentence = r"^generators\.arm\.joints: no torque per ampere of arm_1, "
    with pytest.raises(ConfigurationError, match=sentence):
        Pipeline(config)


def without_inertia(link: str, folder: Path) -> RobotConfig:
    text = robot().urdf.path.read_text()
    found = re.search(rf'<link name="{link}">.*?</link>', text, re.DOTALL)
    assert found is not None
    bare = re.sub(r"<inertial>.*?</inertial>", "", found[0], flags=re.DOTALL)
    assert bare != found[0]
    path = folder / "part.urdf"
    path.write_text(text.replace(found[0], bare))
    return RobotConfig(urdf=str(path), still=STILL, spacing=0.01)


def test_a_body_that_would_weigh_nothing_is_refused(tmp_path: Path) -> None:
    model = RobotModel(without_inertia("link_4", tmp_path))
    with pytest.raises(RobotError, match=r"part\.urdf: link_4 would weigh nothing: give inertias"):
        Dynamics(model).require_inertias()


def test_a_link_without_mass_on_a_body_that_has_some_is_a_warning(tmp_path: Path) -> None:
    config = without_inertia("palm", tmp_path)
    model = RobotModel(config)
    Dynamics(model).require_inertias()
    assert not [*mass_faults(model)]  # of no effort is anything known
    known = config.model_copy(update={"efforts": {"arm_1": EffortConfig(noise=0.1)}})
    (fault,) = mass_faults(RobotModel(known))
    assert fault == "link 'palm' has a shape, but no mass, so its weight would be a contact"


def test_slow_readings_become_free_too() -> None:
    watch = LoadWatch()
    for stamp in (0.0, 1.0, 2.0):
        watch.follow(stamp, is_loaded=stamp == 0.0)
    assert not watch.may_be_own and not watch.is_loaded_often


def test_a_change_within_the_lag_is_no_frozen_effort() -> None:
    frozen, one = FrozenEfforts(0.1), np.ones(1)
    for stamp in np.arange(0.0, 2.0, 0.01).tolist():
        left = 10.0 * (1.0 - np.exp(-stamp / 0.1)) * one
        frozen.follow(stamp, one, left, 0.1 * one)
        assert not frozen.found.any()
