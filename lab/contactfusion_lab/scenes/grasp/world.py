"""The physics of a grasp: a compliant arm, fixed objects, one that moves, and their pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError
from contactfusion.frames import Pose, inverse, pose_of
from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectModel
from contactfusion.robots.urdf import Mesh, read_urdf
from contactfusion.shapes import ShapeConfig
from contactfusion_lab.scenes.arm import CompliantArm
from contactfusion_lab.scenes.touch.world import FAINT, Touching, TouchWorld

SPINNING, ROLLING = 0.004, 0.0005
"""Lever arms of the spinning and rolling friction of a hand's soft pads [m]."""
ITERATIONS = 100
"""Iterations of the solver in each step: friction from several sides needs more than a touch."""
COLOUR = (0.34, 0.71, 0.91, 1.0)
"""Colour of the object in pictures, RGBA."""
NEAR, FAR = 0.05, 5.0
"""Clipping distances of pictures [m]."""


@dataclass(frozen=True)
class Viewpoint:
    """The viewpoint of a picture, in the root link's frame, whose z points up.

    Attributes:
        place: position of the viewpoint [m].
        target: point in the middle of the picture [m].
        field: vertical field of view [degrees].
        width: [pixels].
        height: [pixels].
    """

    place: tuple[float, float, float]
    target: tuple[float, float, float]
    field: float = 40.0
    width: int = 480
    height: int = 360

    def picture(self, bullet: Any, client: dict[str, int]) -> NDArray[np.uint8]:
        """A rendered picture of a PyBullet world, shape (height, width, 3)."""
        view, projection = self._matrices(bullet)
        seen = bullet.getCameraImage(
            self.width, self.height, view, projection, shadow=1,
            lightDirection=(0.5, -1.0, 2.0), renderer=bullet.ER_TINY_RENDERER, **client,
        )  # fmt: skip
        colours = np.reshape(np.asarray(seen[2], np.uint8), (self.height, self.width, 4))
        return colours[:, :, :3].copy()

    def pixels(self, bullet: Any, positions: FloatArray) -> FloatArray:
        """The pixels of positions in the picture.

        Args:
            bullet: PyBullet.
            positions: shape (n, 3) [m].

        Returns:
            Shape (n, 2), from the left and from the top [pixels].
        """
        view, projection = (
            np.reshape(matrix, (4, 4)).T for matrix in self._matrices(bullet)
        )  # by columns, as OpenGL has them
        seen = np.column_stack([positions, np.ones(len(positions))]) @ (projection @ view).T
        across = seen[:, :2] / seen[:, 3:]
        half = np.array([self.width, self.height]) / 2.0
        found: FloatArray = half + half * across * [1.0, -1.0]
        return found

    def _matrices(self, bullet: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
        view = bullet.computeViewMatrix(self.place, self.target, (0.0, 0.0, 1.0))
        aspect = self.width / self.height
        return view, bullet.computeProjectionMatrixFOV(self.field, aspect, NEAR, FAR)


class GraspWorld:
    """A robot on a floor, fixed objects, and one that moves, in PyBullet.

    Args:
        model: the robot; its root link stands at the origin.
        surroundings: fixed objects, by name.
        movable: the object that moves.
        mass: of that object [kg]; None: that of its URDF.
        friction: coefficient between robot and object.
        table_friction: coefficient between the object and what it stands on.

    Raises:
        RobotError: the object's URDF has no mass, or PyBullet cannot read it.
    """

    def __init__(
        self,
        model: RobotModel,
        surroundings: Mapping[str, ObjectModel],
        movable: ObjectModel,
        mass: float | None,
        friction: float,
        table_friction: float,
    ) -> None:
        # the hand's friction is 1, and PyBullet multiplies those of two bodies
        self._touch = TouchWorld(model, surroundings, table_friction / friction)
        self._physics = self._touch.physics
        self._bullet, self._client = self._physics.bullet, self._physics.client
        floor = self._bullet.createCollisionShape(self._bullet.GEOM_PLANE, **self._client)
        self._bullet.createMultiBody(0.0, floor, **self._client)  # for what falls off the table
        bullet, client = self._bullet, self._client
        bodies = [bullet.getBodyUniqueId(n, **client) for n in range(bullet.getNumBodies(**client))]
        self._ground = [body for body in bodies if body != self._physics.robot]
        self._body = _add_movable(self._physics, movable, mass)
        self._touch.adopt("object", self._body)
        grip = {"spinningFriction": SPINNING, "rollingFriction": ROLLING}
        self._bullet.changeDynamics(
            self._body, -1, lateralFriction=friction, **grip, linearDamping=0.0,
            angularDamping=0.0, **self._client,
        )  # fmt: skip
        self._bullet.setPhysicsEngineParameter(numSolverIterations=ITERATIONS, **self._client)
        self._bullet.changeVisualShape(self._body, -1, rgbaColor=COLOUR, **self._client)
        inertial = self._bullet.getDynamicsInfo(self._body, -1, **self._client)[3:5]
        self._inertial = pose_of(inertial[0], Rotation.from_quat(inertial[1]).as_matrix())

    @property
    def object_pose(self) -> Pose:
        """The true pose of the object, in the root link's frame."""
        position, orientation = self._bullet.getBasePositionAndOrientation(
            self._body, **self._client
        )
        there: Pose = pose_of(position, Rotation.from_quat(orientation).as_matrix()) @ inverse(
            self._inertial
        )
        return there

    def put(self, pose: Pose) -> None:
        """Place the object at a pose, at rest."""
        self._physics.place(self._body, pose @ self._inertial)

    def stand(self, clutter: Sequence[ObjectModel]) -> None:
        """Add further bodies that do not move."""
        self._ground += self._touch.stand(clutter)

    def blocked(self, positions: FloatArray) -> bool:
        """Whether the robot would touch anything at joint positions of shape (n,) [rad, m]."""
        return self._touch.blocked(positions, set(), "object")

    def arm(self, positions: FloatArray, stiffness: FloatArray) -> CompliantArm:
        """The compliant arm at its start.

        Args:
            positions: shape (n,), of the joints [rad, m].
            stiffness: shape (n,), of the joints [N·m/rad, N/m].
        """
        return self._touch.arm(positions, stiffness)

    def felt(self) -> dict[str, FloatArray]:
        """The true wrench at each wrist, weight included, shape (6,) [N, N·m], on the robot."""
        return self._touch.felt()

    def touching(self) -> Touching:
        """The contact points on the robot now."""
        return self._touch.touching()

    def touches_object(self) -> bool:
        """Whether the robot touches the object."""
        return self._touches(self._physics.robot)

    def supports_object(self) -> bool:
        """Whether the floor or a fixed object touches the object."""
        return any(self._touches(body) for body in self._ground)

    def _touches(self, body: int) -> bool:
        points = self._bullet.getContactPoints(body, self._body, **self._client)
        return any(point[9] >= FAINT for point in points)

    def seen(
        self, viewpoint: Viewpoint, positions: FloatArray
    ) -> tuple[NDArray[np.uint8], FloatArray]:
        """A picture, shape (height, width, 3), and the pixels of positions (n, 3) [m] in it."""
        return viewpoint.picture(self._bullet, self._client), viewpoint.pixels(
            self._bullet, positions
        )


def _add_movable(world: BulletWorld, movable: ObjectModel, mass: float | None) -> int:
    """Add an object that moves, at the origin.

    Args:
        world: of the physics.
        movable: the object.
        mass: spread evenly over the box around its shapes [kg]; None: that of its URDF.

    Returns:
        Its body number in PyBullet.

    Raises:
        RobotError: its URDF has no mass, or PyBullet cannot read it.
    """
    bullet, client = world.bullet, world.client
    if mass is None:
        assert movable.config.urdf is not None
        path = RobotConfig(urdf=movable.config.urdf, folder=movable.config.folder).path()
        if not any(link.mass for link in read_urdf(path).links.values()):  # PyBullet takes 1 kg
            raise RobotError(f"{path} has no mass, so nothing moves it: give the scene's `mass`")
        flags = bullet.URDF_USE_INERTIA_FROM_FILE
        try:
            body: int = bullet.loadURDF(str(path), flags=flags, **client)
        except bullet.error as error:
            raise RobotError(f"{path}: PyBullet cannot load it: {error}") from None
        return body
    corners = np.concatenate([vertices for vertices, _ in movable.solid.meshes])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    parts = [_part(bullet, shape) for shape in movable.shapes]
    joined = bullet.createCollisionShapeArray(
        **{name: [part[name] for part in parts] for name in parts[0]}, **client
    )
    made: int = bullet.createMultiBody(
        mass, joined, baseInertialFramePosition=middle.tolist(), **client
    )
    return made


def _part(bullet: Any, shape: ShapeConfig | Mesh) -> dict[str, Any]:
    """The fields of one shape of a compound in PyBullet, which needs all of each."""
    pose = shape.pose()
    part = {
        "radii": 0.0, "lengths": 0.0, "halfExtents": (0.0, 0.0, 0.0), "fileNames": "",
        "meshScales": (1.0, 1.0, 1.0), "collisionFramePositions": pose[:3, 3].tolist(),
        "collisionFrameOrientations": Rotation.from_matrix(pose[:3, :3]).as_quat().tolist(),
    }  # fmt: skip
    if isinstance(shape, Mesh):
        own = {"shapeTypes": bullet.GEOM_MESH, "fileNames": str(shape.file)}
        return part | own | {"meshScales": shape.scale}
    if shape.shape == "box":
        edges = tuple(edge / 2.0 for edge in shape.size or ())
        return part | {"shapeTypes": bullet.GEOM_BOX, "halfExtents": edges}
    if shape.shape == "cylinder":
        return part | {
            "shapeTypes": bullet.GEOM_CYLINDER, "radii": shape.radius, "lengths": shape.length
        }  # fmt: skip
    return part | {"shapeTypes": bullet.GEOM_SPHERE, "radii": shape.radius}
