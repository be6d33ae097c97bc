"""A physics world of what is believed: which links are near which object."""

import weakref
from collections.abc import Mapping
from typing import Any

from scipy.spatial.transform import Rotation

from contactfusion.errors import missing_extra
from contactfusion.frames import Pose, pose_of
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.robots.urdf import Mesh
from contactfusion.shapes import ShapeConfig


class BelievedWorld:
    """A robot and objects in PyBullet, put where they are believed to be; nothing falls in it.

    PyBullet knows a mesh by its convex hull, so it tells of more than touches, never of less.

    Args:
        robot: the robot.
        objects: by name.

    Raises:
        DependencyError: pybullet is not installed.
    """

    def __init__(self, robot: RobotModel, objects: Mapping[str, ObjectModel]) -> None:
        try:
            import pybullet
        except ImportError:
            raise missing_extra("pybullet", "sim") from None
        self._bullet: Any = pybullet
        self._client = {"physicsClientId": pybullet.connect(pybullet.DIRECT)}
        weakref.finalize(self, pybullet.disconnect, **self._client)
        self._robot = pybullet.loadURDF(str(robot.urdf.path), useFixedBase=True, **self._client)
        rows = range(pybullet.getNumJoints(self._robot, **self._client))
        infos = [pybullet.getJointInfo(self._robot, row, **self._client) for row in rows]
        joint_rows = {info[1].decode(): row for row, info in zip(rows, infos, strict=True)}
        self._joints = [joint_rows[name] for name in robot.joint_names]
        self._links = {row: info[12].decode() for row, info in zip(rows, infos, strict=True)}
        self._links[-1] = robot.root
        inertial = pybullet.getDynamicsInfo(self._robot, -1, **self._client)[3:5]
        self._inertial = pose_of(inertial[0], Rotation.from_quat(inertial[1]).as_matrix())
        self._objects = {
            name: [(self._body(shape), shape.pose()) for shape in one.shapes]
            for name, one in objects.items()
        }

    def near(self, robot: PosedRobot, name: str, pose: Pose, reach: float) -> set[str]:
        """Give the links that may lie within `reach` [m] of an object.

        Args:
            robot: in its pose.
            name: the object.
            pose: where it is believed to be, in the frame of the robot's poses.
            reach: [m].
        """
        self._place(self._robot, robot.base @ self._inertial)
        for row, position in zip(self._joints, robot.positions, strict=True):
            self._bullet.resetJointState(self._robot, row, position, **self._client)
        links = set()
        for body, own in self._objects[name]:
            self._place(body, pose @ own)
            found = self._bullet.getClosestPoints(self._robot, body, reach, **self._client)
            links |= {self._links[point[3]] for point in found}
        return links

    def _place(self, body: int, pose: Pose) -> None:
        turn = Rotation.from_matrix(pose[:3, :3]).as_quat()
        place = self._bullet.resetBasePositionAndOrientation
        place(body, pose[:3, 3], turn, **self._client)

    def _body(self, shape: ShapeConfig | Mesh) -> int:
        """Put a shape into the world; give its number there."""
        bullet, client = self._bullet, self._client
        make = bullet.createCollisionShape
        if isinstance(shape, Mesh):
            file = str(shape.file)
            made = make(bullet.GEOM_MESH, fileName=file, meshScale=shape.scale, **client)
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
