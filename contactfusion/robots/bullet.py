"""A robot and solid bodies in a PyBullet world of their own."""

import os
import sys
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError, missing_extra
from contactfusion.frames import Pose, pose_of
from contactfusion.robots.model import RobotModel
from contactfusion.robots.urdf import Mesh
from contactfusion.shapes import ShapeConfig


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress what PyBullet prints, also on stdout, where results may go."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept, nowhere = {stream: os.dup(stream) for stream in (1, 2)}, os.open(os.devnull, os.O_WRONLY)
    for stream in kept:
        os.dup2(nowhere, stream)
    try:
        yield
    finally:
        for stream, copy in kept.items():
            os.dup2(copy, stream)
            os.close(copy)
        os.close(nowhere)


class BulletWorld:
    """One robot and static bodies, in a PyBullet world of their own.

    Args:
        robot: the robot; its root link stands at the origin until it is placed.
        fixed: whether its root link stands still; else it floats, as that of a legged robot.
        hollow: whether the mesh of a body is taken as it is; otherwise, as always for the robot,
            its convex hull: faster, and contacts are overestimated, never underestimated.
        visual: whether the robot's visual shapes are loaded, as for pictures.

    Raises:
        DependencyError: pybullet is not installed.
        RobotError: PyBullet cannot load the robot.
    """

    def __init__(
        self, robot: RobotModel, *, fixed: bool = True, hollow: bool = False, visual: bool = False
    ) -> None:
        try:
            import pybullet
        except ImportError:
            raise missing_extra("pybullet", "sim") from None
        self.bullet: Any = pybullet
        self.client = {"physicsClientId": pybullet.connect(pybullet.DIRECT)}
        weakref.finalize(self, pybullet.disconnect, **self.client)
        self._mesh_flags = {"flags": pybullet.GEOM_FORCE_CONCAVE_TRIMESH} if hollow else {}
        # by default PyBullet would derive inertias from the shapes
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        if not visual:  # whose files are not checked
            flags |= pybullet.URDF_IGNORE_VISUAL_SHAPES
        try:
            with quiet():
                self.robot: int = pybullet.loadURDF(
                    str(robot.urdf.path), useFixedBase=fixed, flags=flags, **self.client
                )
        except pybullet.error as error:
            raise RobotError(f"{robot.urdf.path}: PyBullet cannot load it: {error}") from None
        rows = range(pybullet.getNumJoints(self.robot, **self.client))
        infos = [pybullet.getJointInfo(self.robot, row, **self.client) for row in rows]
        by_name = {info[1].decode(): row for row, info in zip(rows, infos, strict=True)}
        self.joints = [by_name[name] for name in robot.joint_names]
        """The row of each of the robot's `joint_names`."""
        self.links = {row: info[12].decode() for row, info in zip(rows, infos, strict=True)}
        """The link of each row."""
        self.links[-1] = robot.root
        for row, link in self.links.items():
            if not robot.urdf.links[link].mass:  # PyBullet would take it for 1 kg
                pybullet.changeDynamics(self.robot, row, mass=0.0, **self.client)
        inertial = pybullet.getDynamicsInfo(self.robot, -1, **self.client)[3:5]
        self._inertial = pose_of(inertial[0], Rotation.from_quat(inertial[1]).as_matrix())
        self.place_robot(np.eye(4))

    def place_robot(self, base: Pose) -> None:
        """Set the pose of the robot's root link in the world."""
        self.place(self.robot, base @ self._inertial)

    def place(self, body: int, pose: Pose) -> None:
        """Set the pose of a body in the world."""
        orientation = Rotation.from_matrix(pose[:3, :3]).as_quat()
        reset = self.bullet.resetBasePositionAndOrientation
        reset(body, pose[:3, 3], orientation, **self.client)

    def bend(self, positions: FloatArray) -> None:
        """Set the joints' positions, at rest; shape (n,) [rad, m], by `joint_names`."""
        for row, position in zip(self.joints, positions.tolist(), strict=True):
            self.bullet.resetJointState(self.robot, row, position, **self.client)

    def add(self, shape: ShapeConfig | Mesh) -> int:
        """Add a static body at the origin; its number, by which it is placed.

        Raises:
            RobotError: PyBullet cannot read its mesh.
        """
        bullet, client = self.bullet, self.client
        make = bullet.createCollisionShape
        if isinstance(shape, Mesh):
            file = str(shape.file)
            scaled = {"meshScale": shape.scale, **self._mesh_flags}
            try:
                with quiet():
                    made = make(bullet.GEOM_MESH, fileName=file, **scaled, **client)
            except bullet.error:
                known = ".obj, .stl and .dae"
                raise RobotError(f"{file}: PyBullet cannot read it; it reads {known}") from None
        elif shape.shape == "box":
            edges = [edge / 2.0 for edge in shape.size or ()]
            made = make(bullet.GEOM_BOX, halfExtents=edges, **client)
        elif shape.shape == "cylinder":
            size = {"radius": shape.radius, "height": shape.length}
            made = make(bullet.GEOM_CYLINDER, **size, **client)
        else:
            made = make(bullet.GEOM_SPHERE, radius=shape.radius, **client)
        body: int = bullet.createMultiBody(0.0, made, **client)
        return body

    def near(self, body: int, reach: float) -> set[str]:
        """The links that lie within `reach` [m] of a body."""
        found = self.bullet.getClosestPoints(self.robot, body, reach, **self.client)
        return {self.links[point[3]] for point in found}
