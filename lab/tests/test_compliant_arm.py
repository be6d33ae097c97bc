"""Springs and dampers hold the joints, against gravity and no stronger than their limits."""

from pathlib import Path

import numpy as np
import pytest

from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.model import RobotModel
from contactfusion_lab.scenes.arm import STEP, STIFFEST, CompliantArm
from tests.poker import poker
from tests.urdfs import ARM_HAND, random_joints, real

MASS = 3.5
"""All that slides [kg]."""
SOFT = 500.0


@pytest.fixture(scope="module")
def strong(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return poker(tmp_path_factory.mktemp("strong"), effort=1e6)


def arm_of(model: RobotModel, stiffness: float) -> CompliantArm:
    """Hold a poker at 0."""
    return CompliantArm(BulletWorld(model), model, np.zeros(1), np.array([stiffness]))


@pytest.mark.parametrize("seed", range(3))
def test_an_arm_stays_where_it_shall_be_under_its_weight(seed: int) -> None:
    model = real(ARM_HAND)
    positions = 0.5 * random_joints(model, seed)
    arm = CompliantArm(BulletWorld(model), model, positions, np.full(len(positions), 10.0))
    for _ in range(500):
        arm.step(positions)
    assert np.abs(arm.positions - positions).max() < 1e-4
    assert np.abs(arm.velocities).max() < 1e-3


def test_what_moves_comes_to_rest_where_it_shall_be() -> None:
    model = real(ARM_HAND)
    positions = 0.4 * random_joints(model, 5)
    leading = np.array([name.startswith("arm") for name in model.joint_names])
    world = BulletWorld(model)
    arm = CompliantArm(world, model, positions, np.where(leading, 400.0, 10.0))
    shift = np.where(np.arange(len(positions)) % 2, 0.05, -0.05)
    for step in range(100):
        arm.step(positions + shift * (step + 1) / 100)
    moving = np.abs(arm.velocities).max()
    for _ in range(2500):
        arm.step(positions + shift)
    assert moving > 0.3 and np.abs(arm.velocities).max() < 1e-3
    assert np.abs(arm.positions - positions - shift).max() < 1e-3


def test_a_joint_swings_back_as_a_critical_damper_says(strong: RobotModel) -> None:
    world = BulletWorld(strong)
    arm = CompliantArm(world, strong, np.zeros(1), np.array([SOFT]))
    world.bend(np.array([0.1]))
    arm.positions[:] = 0.1
    rate, swing = np.sqrt(SOFT / MASS), []
    for _ in range(600):
        arm.step(np.zeros(1))
        swing.append(arm.positions[0])
    times = STEP * np.arange(1, 601)
    assert np.allclose(swing, 0.1 * (1 + rate * times) * np.exp(-rate * times), atol=0.001)
    assert min(swing) > -1e-5


def test_a_joint_follows_a_steady_path_without_lag(strong: RobotModel) -> None:
    arm, speed = arm_of(strong, SOFT), 0.1
    for step in range(1, 1001):
        arm.step(np.array([speed * STEP * step]))
    assert arm.velocities[0] == pytest.approx(speed, rel=1e-3)
    assert arm.positions[0] == pytest.approx(speed * STEP * 1000, abs=2 * speed * STEP)


def test_a_joint_pushes_no_stronger_than_its_limit(tmp_path: Path) -> None:
    arm = arm_of(poker(tmp_path, effort=2.0), 1e5)
    for step in range(1, 21):
        arm.step(np.array([0.5]))
        assert arm.velocities[0] == pytest.approx(step * STEP * 2.0 / MASS, rel=1e-6)


def test_no_spring_is_stiffer_than_the_physics_can_follow(strong: RobotModel) -> None:
    world = BulletWorld(strong)
    arm = CompliantArm(world, strong, np.zeros(1), np.array([1e12]))
    world.bend(np.array([0.01]))
    arm.positions[:] = 0.01
    arm.step(np.zeros(1))
    assert arm.velocities[0] == pytest.approx(-0.01 * STIFFEST**2 * STEP, rel=1e-6)
    for _ in range(200):
        arm.step(np.zeros(1))
    assert abs(arm.positions[0]) < 1e-6
