"""The bodies of a push in PyBullet: floor, driven base and object."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError
from contactfusion.robots.bullet import quiet
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.urdf import Mesh, read_urdf
from contactfusion_lab.scenes.push.objects import (
    BallConfig,
    HollowConfig,
    ObjectConfig,
    Part,
    SoftConfig,
    UrdfObjectConfig,
)

ORIGIN_HEIGHT = 0.45
"""Height of the robot's frame above the floor [m]."""
SLIDES, CHASSIS = 10.0, 130.0
"""Masses of the two slides that carry the base, and of the base [kg]; velocity motors hide them."""
CHASSIS_LINK = 2
"""The link of the base that touches, its last one."""
GRAVITY = 9.81
"""[m/s²]."""
Client = Mapping[str, int]
"""The keyword of PyBullet that names one of several physics servers."""
Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""
GRIP = 0.5
"""Coefficient of friction between a ball and the box in which it rolls."""


class Chassis(NamedTuple):
    """The box of a base that pushes, in the robot's frame.

    Attributes:
        xyz: its middle [m].
        size: its edges along x, y and z [m].
    """

    xyz: tuple[float, float, float]
    size: tuple[float, float, float]

    @property
    def front(self) -> float:
        """Position of the pushing face along x [m]."""
        return self.xyz[0] + self.size[0] / 2.0

    @property
    def rear(self) -> float:
        """Position of the rear face along x [m]."""
        return self.front - self.size[0]

    @property
    def half_width(self) -> float:
        """Half the width of the pushing face [m]."""
        return self.size[1] / 2.0

    @property
    def corners(self) -> FloatArray:
        """Corners from above, counterclockwise from the rear right, shape (4, 2) [m]."""
        front, rear, half = self.front, self.rear, self.half_width
        return np.array([[rear, -half], [front, -half], [front, half], [rear, half]])


class Base(NamedTuple):
    """A base that is driven.

    Attributes:
        body: its number in PyBullet.
        chassis: the box that touches.
    """

    body: int
    chassis: Chassis


def add_floor(bullet: Any, client: Client, friction: float) -> None:
    """Add the floor; PyBullet multiplies the frictions of two bodies, the object's is 1."""
    plane = bullet.createCollisionShape(bullet.GEOM_PLANE, **client)
    _rub(bullet, client, bullet.createMultiBody(0.0, plane, **client), friction)


def read_chassis(robot: RobotConfig) -> Chassis:
    """The chassis of a base, from its URDF.

    Raises:
        RobotError: the base is not one box.
    """
    urdf = read_urdf(robot.path(), robot.package_folders())
    shapes = [shape for link in urdf.links.values() for shape in link.collision]
    if len(shapes) != 1 or isinstance(shapes[0], Mesh) or shapes[0].shape != "box":
        raise RobotError(f"{urdf.path}: a base that pushes has one collision shape, a box")
    x, y, z = shapes[0].size or (0.0, 0.0, 0.0)
    return Chassis(shapes[0].xyz, (x, y, z))


def add_base(bullet: Any, client: Client, robot: RobotConfig, friction: float) -> Base:
    """Add a base on two slides and a hinge, whose motors drive it without slip.

    Raises:
        RobotError: the base is not one box.
    """
    chassis = read_chassis(robot)
    shape = bullet.createCollisionShape(
        bullet.GEOM_BOX,
        halfExtents=np.array(chassis.size) / 2.0,
        collisionFramePosition=chassis.xyz,
        **client,
    )
    body: int = bullet.createMultiBody(
        0.0,
        basePosition=(0.0, 0.0, ORIGIN_HEIGHT),
        linkMasses=(SLIDES, SLIDES, CHASSIS),
        linkCollisionShapeIndices=(-1, -1, shape),
        linkParentIndices=(0, 1, 2),
        linkJointTypes=(bullet.JOINT_PRISMATIC, bullet.JOINT_PRISMATIC, bullet.JOINT_REVOLUTE),
        linkJointAxis=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        **_in_place(((0.0, 0.0, 0.0),) * 3),
        **client,
    )
    _rub(bullet, client, body, friction)
    bullet.resetJointState(body, 0, -chassis.front, **client)
    return Base(body, chassis)


def _rub(bullet: Any, client: Client, body: int, friction: float) -> None:
    """Set a body's Coulomb friction, and every other loss to 0."""
    for row in range(-1, bullet.getNumJoints(body, **client)):
        bullet.changeDynamics(
            body, row, lateralFriction=friction, rollingFriction=0.0, spinningFriction=0.0,
            restitution=0.0, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, **client,
        )  # fmt: skip


def _in_place(positions: Sequence[tuple[float, ...]]) -> dict[str, Any]:
    """Arguments for links at positions, without rotation or visual shape."""
    count = len(positions)
    return {
        "linkPositions": positions,
        "linkOrientations": [(0.0, 0.0, 0.0, 1.0)] * count,
        "linkInertialFramePositions": [(0.0, 0.0, 0.0)] * count,
        "linkInertialFrameOrientations": [(0.0, 0.0, 0.0, 1.0)] * count,
        "linkVisualShapeIndices": [-1] * count,
    }


class PushedBody(NamedTuple):
    """An object that can be pushed, in PyBullet.

    Attributes:
        body: its number.
        back: origin of the body's frame of PyBullet, in the object's frame [m].
        orientation: of that frame there, a quaternion x, y, z, w.
        ball: number of a ball inside; None: there is none.
    """

    body: int
    back: tuple[float, float, float]
    orientation: Quaternion
    ball: int | None


def add_object(bullet: Any, client: Client, config: ObjectConfig) -> PushedBody:
    """Add an object at the origin.

    Raises:
        RobotError: PyBullet cannot load it, or it has no collision shape.
        ConfigurationError: its URDF is missing or wrong.
    """
    if isinstance(config, UrdfObjectConfig):
        path = RobotConfig(urdf=config.urdf, folder=config.folder).path()
        if not any(link.collision for link in read_urdf(path).links.values()):
            raise RobotError(f"{path}: it has no collision shape, so nothing can touch it")
        try:
            with quiet():
                body: int = bullet.loadURDF(str(path), **client)
        except bullet.error as error:
            raise RobotError(f"{path}: PyBullet cannot load it: {error}") from None
        back, rotation = bullet.getDynamicsInfo(body, -1, **client)[3:5]
    else:
        parts = config.parts()
        body = _joined(bullet, client, parts)
        x, y = parts[0].middle.tolist()
        back, rotation = (x, y, parts[0].bottom + parts[0].height / 2.0), (0.0, 0.0, 0.0, 1.0)
    _rub(bullet, client, body, 1.0)
    ball = None
    if isinstance(config, HollowConfig) and config.ball is not None:
        ball = _rolling(bullet, client, config.ball, config.wall)
    return PushedBody(body, back, rotation, ball)


def soften(bullet: Any, client: Client, base: int, soft: SoftConfig) -> None:
    """Make the contact of a base with the object compliant.

    PyBullet puts the springs of two bodies in series, at each point of contact. If the object were
    the soft one, it would sink into the floor, too; the base touches nothing but the object. A line
    contact has a point at each end, so each has half of the whole.
    """
    bullet.changeDynamics(
        base, CHASSIS_LINK, contactStiffness=soft.stiffness / 2.0,
        contactDamping=soft.damping / 2.0, **client,
    )  # fmt: skip


def turned(after: Quaternion, before: Quaternion) -> Quaternion:
    """The rotation `before`, followed by `after`."""
    x, y, z, w = after
    a, b, c, d = before
    return (
        w * a + x * d + y * c - z * b,
        w * b + y * d + z * a - x * c,
        w * c + z * d + x * b - y * a,
        w * d - x * a - y * b - z * c,
    )


def _joined(bullet: Any, client: Client, parts: Sequence[Part]) -> int:
    """Add parts as one body: each is a link of its own, so that each keeps its mass."""
    middles = [(*part.middle, part.bottom + part.height / 2.0) for part in parts]
    positions = [tuple(np.subtract(middle, middles[0])) for middle in middles[1:]]
    count = len(positions)
    body: int = bullet.createMultiBody(
        parts[0].mass,
        _shape(bullet, client, parts[0]),
        linkMasses=[part.mass for part in parts[1:]],
        linkCollisionShapeIndices=[_shape(bullet, client, part) for part in parts[1:]],
        linkParentIndices=[0] * count,
        linkJointTypes=[bullet.JOINT_FIXED] * count,
        linkJointAxis=[(0.0, 0.0, 1.0)] * count,
        **_in_place(positions),
        **client,
    )
    return body


def _rolling(bullet: Any, client: Client, ball: BallConfig, floor: float) -> int:
    """Add a ball on the floor of the box in which it rolls."""
    shape = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=ball.radius, **client)
    position = (0.0, 0.0, floor + ball.radius)
    body: int = bullet.createMultiBody(ball.mass, shape, basePosition=position, **client)
    _rub(bullet, client, body, GRIP)
    return body


def _shape(bullet: Any, client: Client, part: Part) -> int:
    height = part.height
    shape: int
    if part.radius is not None:
        shape = bullet.createCollisionShape(
            bullet.GEOM_CYLINDER, radius=part.radius, height=height, **client
        )
        return shape
    corners = part.outline - part.middle
    high = corners.max(axis=0)
    if len(corners) == 4 and np.isclose(np.abs(corners), high).all():
        half = [*high, height / 2.0]
        shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half, **client)
        return shape
    vertices = [(*corner, z) for z in (-height / 2.0, height / 2.0) for corner in corners]
    shape = bullet.createCollisionShape(bullet.GEOM_MESH, vertices=vertices, **client)
    return shape
