"""A robot in PyBullet is the robot of its URDF."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import DependencyError
from contactfusion.frames import pose_at
from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel
from contactfusion.robots.urdf import Mesh
from contactfusion.shapes import ShapeConfig
from tests.hands import slide
from tests.poker import poker
from tests.urdfs import ARM_HAND, KUKA, REAL, random_joints, real

BOX = ShapeConfig(shape="box", size=(0.1, 0.1, 0.1))
GAP = 0.001


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return slide(tmp_path_factory.mktemp("slide"))


@pytest.mark.parametrize("name", [ARM_HAND, KUKA])
@pytest.mark.parametrize("seed", range(2))
def test_a_torque_moves_a_joint_as_its_inertia_says(name: str, seed: int) -> None:
    model, step = real(name), 1e-3
    world = BulletWorld(model)
    bullet, client = world.bullet, world.client
    positions = random_joints(model, seed)
    inertias = model.inertias(positions)
    bullet.setTimeStep(step, **client)
    count = len(world.joints)
    bullet.setJointMotorControlArray(
        world.robot, world.joints, bullet.VELOCITY_CONTROL, forces=[0.0] * count, **client
    )
    for row in range(-1, bullet.getNumJoints(world.robot, **client)):
        bullet.changeDynamics(world.robot, row, jointDamping=0.0, **client)
    for number, row in enumerate(world.joints):
        world.bend(positions)
        torque = inertias[number]  # speeds it up by 1 rad/s²
        bullet.setJointMotorControl2(
            world.robot, row, bullet.TORQUE_CONTROL, force=torque, **client
        )
        bullet.stepSimulation(**client)
        speed = bullet.getJointState(world.robot, row, **client)[1]
        assert speed == pytest.approx(step, rel=1e-2), model.joint_names[number]


def test_links_weigh_what_the_file_says(tmp_path: Path) -> None:
    model = poker(tmp_path)
    world = BulletWorld(model)
    for row, link in world.links.items():
        if row >= 0:
            mass = world.bullet.getDynamicsInfo(world.robot, row, **world.client)[0]
            assert mass == model.urdf.links[link].mass, link
    assert world.links[-1] == "base" and set(world.links.values()) == set(model.link_names)


@pytest.mark.parametrize("name", REAL)
def test_joints_and_links_are_found_by_name(name: str) -> None:
    model = real(name)
    world = BulletWorld(model)
    positions = random_joints(model, 1)
    world.bend(positions)
    base = pose_at((0.3, -0.2, 0.5), (0.1, 0.2, -2.0))
    world.place_robot(base)
    poses = model.poses_at(positions)
    for row, link in world.links.items():
        if row >= 0:
            told = world.bullet.getLinkState(
                world.robot, row, computeForwardKinematics=True, **world.client
            )
            assert np.allclose(told[4], (base @ poses[link])[:3, 3], atol=1e-6), link
    states = world.bullet.getJointStates(world.robot, world.joints, **world.client)
    assert np.allclose([state[0] for state in states], positions, atol=1e-12)


@pytest.mark.parametrize(
    "shape",
    [
        BOX,
        ShapeConfig(shape="cylinder", radius=0.05, length=0.1),
        ShapeConfig(shape="sphere", radius=0.05),
    ],
)
def test_the_links_near_a_body_are_told(shape: ShapeConfig, hand: RobotModel) -> None:
    world = BulletWorld(hand)
    body = world.add(shape)
    for axis in range(3):
        for side in (-1, 1):
            # the hand, a cube, and the body reach 0.05 m each
            pose = np.eye(4)
            pose[axis, 3] = side * (0.1 + GAP)
            world.place(body, pose)
            assert world.near(body, 2 * GAP) == {"hand"}
            assert world.near(body, 0.1 * GAP) == set()


def test_the_robot_and_its_joints_go_where_they_are_put(hand: RobotModel) -> None:
    world = BulletWorld(hand)
    body = world.add(BOX)
    world.place(body, pose_at((0.5, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert not world.near(body, 0.1)
    world.bend(np.array([0.35]))
    assert world.near(body, 0.1)
    world.bend(np.array([0.0]))
    world.place_robot(pose_at((0.5, 0.0, 0.15), (0.0, 0.0, 0.0)))
    assert world.near(body, 0.06) and not world.near(body, 0.04)


@pytest.mark.parametrize("hollow", [False, True])
def test_a_hollow_mesh_can_be_reached_into(hollow: bool, hand: RobotModel, tmp_path: Path) -> None:
    import open3d

    library: Any = open3d
    bracket: Any = library.geometry.TriangleMesh()
    for x in (-0.2, 0.2):  # two walls, and the hand between them
        side: Any = library.geometry.TriangleMesh.create_box(0.02, 0.3, 0.3)
        bracket += side.translate((x - 0.01, -0.15, -0.15))
    library.io.write_triangle_mesh(str(tmp_path / "walls.obj"), bracket)
    world = BulletWorld(hand, hollow=hollow)
    nowhere = (0.0, 0.0, 0.0)
    body = world.add(Mesh(tmp_path / "walls.obj", (1.0, 1.0, 1.0), nowhere, nowhere))
    assert bool(world.near(body, 0.0)) is not hollow
    world.bend(np.array([0.16]))
    assert world.near(body, 0.0) == {"hand"}


def test_worlds_are_apart(hand: RobotModel) -> None:
    one, other = BulletWorld(hand), BulletWorld(hand)
    one.add(BOX)
    one.bend(np.array([0.5]))
    bodies = [world.bullet.getNumBodies(**world.client) for world in (one, other)]
    assert bodies == [2, 1]
    assert other.bullet.getJointState(other.robot, other.joints[0], **other.client)[0] == 0.0


def test_without_pybullet_it_says_what_to_install(
    hand: RobotModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(DependencyError, match=r"pip install 'contactfusion\[sim\]'"):
        BulletWorld(hand)


def test_what_pybullet_prints_of_a_link_without_mass_is_kept_from_stdout(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    BulletWorld(slide(tmp_path))
    assert capfd.readouterr().out == ""


def test_files_of_visual_shapes_are_left_alone_unless_they_are_wanted(tmp_path: Path) -> None:
    urdf = slide(tmp_path).urdf.path
    (tmp_path / "seen.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    visual = '<visual><geometry><mesh filename="seen.obj"/></geometry></visual>'
    urdf.write_text(urdf.read_text().replace('<link name="hand">', f'<link name="hand">{visual}'))
    model = RobotModel(RobotConfig(urdf=str(urdf)))
    seen = [
        [shape[4] for shape in world.bullet.getVisualShapeData(world.robot, **world.client)]
        for world in (BulletWorld(model), BulletWorld(model, visual=True))
    ]
    assert not any(name.endswith(b"seen.obj") for name in seen[0])
    assert any(name.endswith(b"seen.obj") for name in seen[1])
