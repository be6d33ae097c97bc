"""Scene `press`: an arm in motion that is pressed, and how its drives err."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.generators.external_torque import ExternalTorque
from contactfusion.readings import JointState, Wrench
from contactfusion.robots.description import EffortConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion_lab.experiments.press.plan import Plan, arm
from contactfusion_lab.experiments.press.trial import scene_of
from contactfusion_lab.scenes.press.config import PressConfig
from contactfusion_lab.scenes.press.scene import PressScene

EARTH = np.array([0.0, 0.0, -9.81])


def robot(name: str = "panda") -> RobotModel:
    config = arm(name).pipeline.robot
    assert config is not None
    return shared_robot(config)


def config(**fields: Any) -> PressConfig:
    blind = {"camera_rate": 0.1}
    return arm("panda").scene.model_copy(update={**blind, **fields})


@dataclass(frozen=True)
class Played:
    scene: PressScene
    joints: list[JointState]
    wrenches: list[Wrench]


@cache
def played(seed: int, places: int = 1, press: float = 10.0, inertia: float = 0.05) -> Played:
    drives = config().drives.model_copy(update={"inertia": inertia})
    scene = PressScene(
        config(places=places, press=press, drives=drives, seconds=4.0), robot(), seed
    )
    readings = list(scene.readings())
    joints = [each for each in readings if isinstance(each, JointState)]
    return Played(scene, joints, [each for each in readings if isinstance(each, Wrench)])


def torques_of(found: Played) -> FloatArray:
    """What an observer of the arm as described leaves, shape (n, 7) [N·m]."""
    known = {name: EffortConfig(noise=0.1) for name in found.joints[0].names}
    observer = ExternalTorque(Dynamics(robot()), known, "measured", 30.0, 0.05)
    left = [observer.update(each, robot().positions(each), EARTH) for each in found.joints]
    return np.array([each[0][:7] for each in left if each is not None])


def test_a_probe_presses_once_the_arm_has_moved_freely() -> None:
    found = played(0)
    assert found.scene.onset >= found.scene.config.lead
    assert len(found.scene.touching.links) == 1
    (force,) = np.linalg.norm(found.scene.touching.forces, axis=1)
    assert 9.0 < force < 16.0  # along its guide 10 N; friction and a surface that tilts add


def test_the_probe_presses_from_outside_on_the_link_that_is_named() -> None:
    seen = set[str]()
    for seed in range(6):
        touching = played(seed).scene.touching
        seen |= {*touching.links}
        for force in touching.forces:
            assert np.linalg.norm(force) > 1.0
    assert len(seen) >= 3


def test_joints_report_what_the_contact_loads_them_with() -> None:
    found = played(0, inertia=0.0)
    positions = robot().positions(found.joints[-1])
    touching = found.scene.touching
    link, force, point = touching.links[0], touching.forces[0], touching.places[0]
    linear, angular = Dynamics(robot()).axes(positions)
    loads = Dynamics(robot()).supports[robot().link_names.index(link)]
    expected = np.where(loads, (linear + np.cross(angular, point)) @ force, 0.0)[:7]
    measured = torques_of(found)[-10:].mean(axis=0)
    np.testing.assert_allclose(measured, expected, atol=0.6)


def test_in_free_motion_only_wrong_masses_are_left() -> None:
    right, wrong = played(3, places=0, inertia=0.0), played(3, places=0, inertia=0.05)
    assert np.isnan(right.scene.onset)
    assert np.abs(torques_of(right)[20:].mean(axis=0)).max() < 0.15
    assert np.abs(torques_of(wrong)[20:].mean(axis=0)).max() > 0.15


def test_a_specimen_keeps_its_masses_whatever_the_seed() -> None:
    def mean(specimen: int) -> FloatArray:
        scene = PressScene(config(places=0, specimen=specimen, seconds=1.0), robot(), 5)
        joints = [each for each in scene.readings() if isinstance(each, JointState)]
        return np.asarray(torques_of(Played(scene, joints, []))[20:].mean(axis=0))

    assert np.abs(mean(1) - mean(1)).max() == 0.0
    assert np.abs(mean(1) - mean(2)).max() > 0.05


def test_of_two_places_the_second_is_beyond_the_wrist() -> None:
    beyond = {*robot().beyond("panda_hand")}
    for seed in range(4):
        links = played(seed, places=2).scene.touching.links
        assert sum(link in beyond for link in links) <= 1


def test_equal_seeds_make_equal_readings() -> None:
    first, second = ([*PressScene(config(), robot(), 4).readings()] for _ in range(2))
    for one, other in zip(first, second, strict=True):
        assert type(one) is type(other) and one.stamp == other.stamp
        if isinstance(one, JointState) and isinstance(other, JointState):
            np.testing.assert_array_equal(one.efforts, other.efforts)


def test_drives_of_another_robot_are_refused() -> None:
    drives = config().drives.model_copy(update={"coulomb": (1.0, 1.0)})
    with pytest.raises(ConfigurationError, match="2 values for the 7 joints panda_joint1"):
        PressScene(config(drives=drives), robot())


def test_a_wrist_on_a_moving_joint_does_not_feel_the_friction_of_its_motor() -> None:
    free = {"places": 0, "seconds": 3.0, "camera_rate": 0.1, "speed": (0.2, 0.6)}
    scene = PressScene(arm("kuka").scene.model_copy(update=free), robot("kuka"), 3)
    about = [each.torque[2] for each in scene.readings() if isinstance(each, Wrench)]
    assert np.sqrt(np.mean(np.square(about))) < 0.05  # of 1 N·m of friction


def test_a_link_that_turns_about_a_probe_does_not_jam_it() -> None:
    plan = Plan(("kuka",), (10.0,), touches=23, places=1, minutes=0.0, seed=2014)
    press = plan.presses()[-1]
    pressed = scene_of(arm("kuka").scene, press).model_copy(update={"camera_rate": 0.1})
    scene = PressScene(pressed, robot("kuka"), press.seed)
    for _ in scene.readings():
        pass
    forces = np.linalg.norm(scene.touching.forces, axis=1)
    assert 5.0 < forces.max() < 30.0
