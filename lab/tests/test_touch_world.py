"""What a wrist feels is what hangs on it and what pushes; what pushes is on both surfaces."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in, vectors_in
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectConfig, ObjectModel
from contactfusion_lab.scenes.arm import CompliantArm
from contactfusion_lab.scenes.touch.world import FAINT, Touching, TouchWorld, contacts_of
from tests.poker import RADIUS, WRISTS, poker
from tests.urdfs import ARM_HAND, random_joints, real

Vector = tuple[float, float, float]
GRAVITY = np.array([0.0, 0.0, -9.81])
WALL = 0.45
"""Where the wall's face stands, along x [m]."""
STIFFNESS = 2000.0


def wall(yaw: float = 0.0, **fields: Any) -> ObjectModel:
    """A wall that the ball touches where it pokes."""
    pose = {"parent": "base", "xyz": (WALL + 0.05, 0.0, 0.5), "rpy": (0.0, 0.0, yaw)}
    shapes = [{"shape": "box", "size": (0.1, 1.0, 1.0)}]
    return ObjectModel(ObjectConfig.model_validate({"shapes": shapes, "pose": pose, **fields}))


@dataclass(frozen=True)
class Poke:
    """A poker that stands still."""

    model: RobotModel
    world: TouchWorld
    arm: CompliantArm
    wanted: float

    @property
    def poses(self) -> dict[str, Pose]:
        return self.model.poses_at(self.arm.positions)

    def of_the_world(self, wrist: str) -> tuple[FloatArray, FloatArray]:
        """Force and torque on a wrist, less the weight, along the base's axes, and their lever."""
        frame = self.model.config.wrists[wrist].frame
        pose = self.poses[self.model.link_of(frame)] @ self.model.pose_on_link(frame)
        force, torque = vectors_in(pose, self.world.felt()[wrist].reshape(2, 3))
        mass, centre = self.model.load_on(frame, self.poses)
        weight = mass * GRAVITY
        bare = np.concatenate([force - weight, torque - np.cross(centre - pose[:3, 3], weight)])
        return bare, pose[:3, 3]


def poked(
    model: RobotModel, wanted: float, steps: int, friction: float = 0.5, yaw: float = 0.0
) -> Poke:
    world = TouchWorld(model, {"wall": wall(yaw)}, friction)
    arm = world.arm(np.zeros(1), np.array([STIFFNESS]))
    for step in range(steps):
        arm.step(np.array([min(wanted, 0.0005 * step)]))
    return Poke(model, world, arm, wanted)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return poker(tmp_path_factory.mktemp("poker"))


@pytest.fixture(scope="module")
def free(model: RobotModel) -> Poke:
    return poked(model, 0.1, 1500)


@pytest.fixture(scope="module")
def pressed(model: RobotModel) -> Poke:
    return poked(model, 0.25, 1500)


# What a wrist feels


@pytest.mark.parametrize("wrist", WRISTS)
def test_a_wrist_that_nothing_touches_feels_what_hangs_on_it(free: Poke, wrist: str) -> None:
    bare, _ = free.of_the_world(wrist)
    assert not free.world.touching().links
    assert np.allclose(bare, 0.0, atol=1e-6)
    mass = {"cell": 1.5, "reverse": 1.5, "whole": 3.5}[wrist]
    assert np.linalg.norm(free.world.felt()[wrist][:3]) == pytest.approx(9.81 * mass)


@pytest.mark.parametrize("wrist", WRISTS)
def test_a_wrist_feels_what_pushes_and_its_lever(pressed: Poke, wrist: str) -> None:
    bare, origin = pressed.of_the_world(wrist)
    touching = pressed.world.touching()
    force = touching.forces.sum(axis=0)
    torque = np.cross(touching.places - origin, touching.forces).sum(axis=0)
    assert np.linalg.norm(force) > 5.0 and np.linalg.norm(torque) > 0.3
    assert np.allclose(bare[:3], force, atol=1e-6)
    assert np.allclose(bare[3:], torque, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_the_wrist_of_a_real_arm_at_rest_feels_its_hand(seed: int) -> None:
    model = real(ARM_HAND).config.model_copy(update={"wrists": {}, "frames": {}})
    fields = model.model_dump() | {"wrists": {"w": {"frame": "wrist_sensor", "sign": "on_robot"}}}
    robot = RobotModel(type(model).model_validate(fields))
    positions = 0.5 * random_joints(robot, seed)
    world = TouchWorld(robot, {}, 0.5)
    arm = world.arm(positions, np.full(len(positions), 100.0))
    for _ in range(50):
        arm.step(positions)
    poses = robot.poses_at(arm.positions)
    force, torque = vectors_in(poses["wrist_sensor"], world.felt()["w"].reshape(2, 3))
    mass, centre = robot.load_on("wrist_sensor", poses)
    lever = centre - poses["wrist_sensor"][:3, 3]
    assert np.allclose(force, mass * GRAVITY, atol=1e-3)
    assert np.allclose(torque, np.cross(lever, mass * GRAVITY), atol=1e-3)


# Where the robot is touched


def test_the_push_is_that_of_the_springs(pressed: Poke) -> None:
    force = pressed.world.touching().forces.sum(axis=0)
    squeezed = pressed.wanted - pressed.arm.positions[0]
    assert np.allclose(force, [-STIFFNESS * squeezed, 0.0, 0.0], atol=0.01)
    assert np.abs(pressed.arm.velocities).max() < 1e-6


def test_a_touch_is_on_both_surfaces_and_on_the_link_that_is_touched(pressed: Poke) -> None:
    touching = pressed.world.touching()
    assert set(touching.links) == {"palm"}
    ball = points_in(pressed.poses["palm"], np.array([[0.05, 0.03, 0.08]]))[0]
    for place in touching.places:
        assert place[0] == pytest.approx(WALL, abs=5e-4)
        assert np.linalg.norm(place - ball) == pytest.approx(RADIUS, abs=5e-4)
        assert np.allclose(place, ball + [RADIUS, 0.0, 0.0], atol=1e-3)


def test_what_does_not_touch_is_reported_as_nothing(free: Poke) -> None:
    touching = free.world.touching()
    assert touching.places.shape == touching.forces.shape == (0, 3) and touching.links == ()


def test_what_is_faint_is_no_touch(model: RobotModel) -> None:
    world = TouchWorld(model, {"wall": wall()}, 0.5)
    arm = world.arm(np.zeros(1), np.array([STIFFNESS]))
    for step in range(1000):
        arm.step(np.array([min(0.25, 0.0005 * step)]))
    weakest = []
    for step in range(3000):  # it is drawn back so slowly that the push fades
        arm.step(np.array([0.25 - 5e-6 * step]))
        weakest += [float(np.linalg.norm(force)) for force in world.touching().forces]
    assert FAINT <= min(weakest) < 3.0 * FAINT and not world.touching().links


def test_without_friction_a_wall_pushes_along_its_normal(model: RobotModel) -> None:
    rotation = 0.5
    slippery = poked(model, 0.27, 1200, friction=0.0, yaw=rotation)
    force = slippery.world.touching().forces.sum(axis=0)
    assert -force[0] > 5.0
    assert np.allclose(
        force / np.linalg.norm(force), [-np.cos(rotation), -np.sin(rotation), 0], atol=1e-3
    )


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_what_is_dragged_along_a_wall_feels_its_friction(friction: float, tmp_path: Path) -> None:
    model = poker(tmp_path, foot="prismatic")
    assert model.joint_names == ("foot", "slide")
    world = TouchWorld(model, {"wall": wall()}, friction)
    arm = world.arm(np.zeros(2), np.full(2, STIFFNESS))
    forces = []
    for step in range(1200):
        arm.step(np.array([5e-5 * max(step - 600, 0), min(0.25, 0.0005 * step)]))
        forces.append(world.touching().forces.sum(axis=0))
    forward, side, up = np.mean(forces[-200:], axis=0)
    assert forward < -20.0 and abs(up) < 0.1 * abs(side)
    assert side == pytest.approx(friction * forward, rel=0.05)


def test_where_the_arm_may_not_be_is_reported(model: RobotModel) -> None:
    world = TouchWorld(model, {"wall": wall()}, 0.5)
    away, inside = np.array([0.1]), np.array([0.3])
    assert not world.blocked(away, {"palm"}, "wall")
    assert not world.blocked(inside, {"palm"}, "wall")
    assert world.blocked(inside, {"palm"}, "table")
    assert world.blocked(inside, {"flange"}, "wall")
    assert not world.blocked(away, set(), "wall")


def test_the_root_may_stand_on_something() -> None:
    robot = real(ARM_HAND)
    floor = {"shapes": [{"shape": "box", "size": (1, 1, 0.1)}], "pose": {"parent": "base"}}
    world = TouchWorld(robot, {"floor": ObjectModel(ObjectConfig.model_validate(floor))}, 0.5)
    upright = np.zeros(len(robot.joint_names))
    assert not world.blocked(upright, set(), "")
    lying = upright.copy()
    lying[robot.joint_names.index("arm_2")] = 2.1
    assert world.blocked(lying, set(), "")


# Contacts of what is touched


def touches(*contacts: tuple[Vector, Vector, str]) -> Touching:
    places = np.reshape([place for place, _, _ in contacts], (-1, 3))
    forces = np.reshape([force for _, force, _ in contacts], (-1, 3))
    return Touching(places, forces, tuple(name for _, _, name in contacts))


def test_near_points_are_one_contact_where_the_force_is() -> None:
    found = contacts_of([touches(((0, 0, 0), (0, 0, 3), "tip"), ((0.008, 0, 0), (0, 0, 1), "tip"))])
    assert found.links == ("tip",)
    assert np.allclose(found.places, [[0.002, 0, 0]]) and np.allclose(found.forces, [[0, 0, 4]])


def test_contacts_are_given_strongest_first() -> None:
    weak, strong = ((0, 0, 0), (1, 0, 0), "palm"), ((0.1, 0, 0), (0, 0, -5), "tip")
    for order in ((weak, strong), (strong, weak)):
        found = contacts_of([touches(*order)])
        assert found.links == ("tip", "palm")
        assert np.allclose(found.places, [[0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
        assert np.allclose(found.forces, [[0, 0, -5], [1, 0, 0]])


def test_a_row_of_points_is_one_contact_and_a_gap_parts_two() -> None:
    def along(*xs: float) -> int:
        return len(contacts_of([touches(*(((x, 0, 0), (0, 0, 1), "tip") for x in xs))]).links)

    assert along(0.0, 0.014, 0.028, 0.042) == 1
    assert along(0.0, 0.016) == 2
    assert along(0.0, 0.014, 0.030) == 2


def test_the_force_of_a_contact_is_its_mean_over_moments() -> None:
    first, second = ((0, 0, 0), (0, 0, 2), "tip"), ((0.004, 0, 0), (0, 0, 6), "tip")
    found = contacts_of([touches(first), touches(), touches(second), touches()])
    assert np.allclose(found.forces, [[0, 0, 2]]) and np.allclose(found.places, [[0.003, 0, 0]])


def test_without_a_touch_there_is_no_contact() -> None:
    for moments in ([], [touches()], [touches(), touches()]):
        found = contacts_of(moments)
        assert found.places.shape == found.forces.shape == (0, 3) and found.links == ()


def test_what_stands_around_is_touched_too(model: RobotModel) -> None:
    world = TouchWorld(model, {}, 0.5)
    (body,) = world.stand([wall()])
    arm = world.arm(np.zeros(1), np.array([STIFFNESS]))
    for step in range(800):
        arm.step(np.array([min(0.25, 0.0005 * step)]))
    touching = world.touching()
    assert set(touching.links) == {"palm"} and touching.forces.sum(axis=0)[0] < -5.0
    friction = world.physics.bullet.getDynamicsInfo(body, -1, **world.physics.client)[1]
    assert friction == 0.5
