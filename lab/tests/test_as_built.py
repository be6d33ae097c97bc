"""A robot as it was built has shapes that deviate, and all else as its URDF says."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.description import RobotConfig, read_robot
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion.robots.urdf import Mesh
from contactfusion_lab.scenes.as_built import as_built
from tests.urdfs import ARM_HAND, real

SPREAD = 0.002


def arm() -> RobotModel:
    return shared_robot(read_robot(real(ARM_HAND).urdf.path.with_suffix(".yaml")))


def sizes(robot: RobotModel, kind: str = "collision") -> list[tuple[float, ...]]:
    """Extents of all shapes, then their positions."""
    found: list[tuple[float, ...]] = []
    for link in robot.urdf.links.values():
        for shape in getattr(link, kind):
            if isinstance(shape, Mesh):
                found.append((*shape.scale, *shape.xyz))
            else:
                width = 2.0 * (shape.radius or 0.0)
                extents = shape.size or (width, width, shape.length or width)
                found.append((*extents, *shape.xyz))
    return found


NAMES = [name for name, link in arm().urdf.links.items() for _ in link.collision]
"""The link of each of these."""


def deviations(seed: int) -> Any:
    with as_built(arm(), SPREAD, np.random.default_rng(seed)) as built:
        return np.array(sizes(built)) - sizes(arm())


def test_without_a_deviation_it_is_the_robot_itself() -> None:
    with as_built(arm(), 0.0, np.random.default_rng(0)) as built:
        assert built is arm()


def test_sizes_and_positions_of_all_shapes_deviate_as_much_as_stated() -> None:
    off = np.concatenate([deviations(seed) for seed in range(20)])
    assert np.std(off[:, 3:], axis=0) == pytest.approx([SPREAD] * 3, rel=0.15)
    assert np.std(off[:, :3]) == pytest.approx(SPREAD, rel=0.15)
    assert np.abs(off.mean(axis=0)).max() < SPREAD / 5.0
    assert np.array_equal(deviations(3), deviations(3))


def test_links_joints_masses_and_sensors_stay_and_so_does_the_urdf() -> None:
    robot = arm()
    before = robot.urdf.path.read_bytes()
    with as_built(robot, SPREAD, np.random.default_rng(0)) as built:
        assert built.link_names == robot.link_names and built.joint_names == robot.joint_names
        positions = np.full(len(robot.joint_names), 0.1)
        there, here = built.poses_at(positions), robot.poses_at(positions)
        assert all(np.array_equal(there[name], here[name]) for name in here)
        assert np.array_equal(built.inertias(positions), robot.inertias(positions))
        assert built.config.patches == robot.config.patches
        file = built.urdf.path
    assert robot.urdf.path.read_bytes() == before and not file.exists()
    assert sorted(built.solids) == sorted(robot.solids)


def test_the_physics_has_the_true_shapes() -> None:
    with as_built(arm(), SPREAD, np.random.default_rng(0)) as built:
        true = BulletWorld(built)
    described = BulletWorld(arm())
    row = next(row for row, link in true.links.items() if link == "link_1")
    spans = []
    for world in (true, described):
        low, high = world.bullet.getAABB(world.robot, row, **world.client)
        spans.append(np.subtract(high, low))
    (extents,) = (
        np.subtract(there[:3], here[:3])
        for there, here, name in zip(sizes(built), sizes(arm()), NAMES, strict=True)
        if name == "link_1"
    )
    assert np.abs(extents).min() > 1e-4
    # Bullet adds a margin, the same for all axes
    assert np.ptp(spans[0] - spans[1] - extents) < 1e-5 < np.ptp(extents)


def test_what_cameras_see_deviates_as_what_touches() -> None:
    looks = RobotModel(arm().config.model_copy(update={"shapes": "visual"}))
    with as_built(looks, SPREAD, np.random.default_rng(0)) as built:
        # the shapes of the hand and arm that comes with the package are the same twice
        assert np.array_equal(sizes(built), sizes(built, "visual"))
        world = BulletWorld(built)
        assert len(world.joints) == len(looks.joint_names)


URDF = """<robot name="r"><link name="base"/><link name="tip">
<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><mesh filename="package://none/nowhere.stl"/></geometry></visual>
<collision><origin rpy="0 0 1.5707963"/>
<geometry><mesh filename="{file}" scale="0.001 0.001 0.002"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize("name", ["meshes/box.obj", "package://robot/meshes/box.obj"])
def test_a_mesh_is_scaled_so_that_its_extents_deviate(tmp_path: Path, name: str) -> None:
    import open3d

    library: Any = open3d
    folder = tmp_path / "robot"
    (folder / "meshes").mkdir(parents=True)
    (folder / "package.xml").write_text("<package/>")
    mesh: Any = library.geometry.TriangleMesh.create_box(100.0, 200.0, 50.0)
    library.io.write_triangle_mesh(str(folder / "meshes/box.obj"), mesh)
    (folder / "robot.urdf").write_text(URDF.format(file=name))
    robot = RobotModel(RobotConfig(urdf="robot.urdf", folder=folder, files_within=folder))
    extents = []
    for seed in range(60):
        with as_built(robot, SPREAD, np.random.default_rng(seed)) as built:
            if seed == 0:
                world = BulletWorld(built)
                low, high = world.bullet.getAABB(world.robot, 0, **world.client)
                assert np.subtract(high, low) == pytest.approx([0.2, 0.1, 0.1], abs=0.03)
        vertices, _ = built.solids["tip"].meshes[0]
        extents.append(np.ptp(vertices, axis=0))
    assert np.mean(extents, axis=0) == pytest.approx([0.2, 0.1, 0.1], abs=0.001)
    assert np.std(extents, axis=0) == pytest.approx([SPREAD] * 3, rel=0.3)


def test_no_shape_vanishes() -> None:
    with as_built(arm(), 1.0, np.random.default_rng(0)) as built:
        now = np.array(sizes(built))[:, :3]
    assert (now >= 0.5 * np.array(sizes(arm()))[:, :3] - 1e-12).all()
