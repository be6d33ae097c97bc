"""The object of a push in PyBullet."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from contactfusion.errors import RobotError
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.urdf import read_urdf
from contactfusion_lab.simulation.push_bodies import (
    CHASSIS_LINK,
    Client,
    Quaternion,
    in_place,
    quiet,
    rub,
)
from contactfusion_lab.simulation.push_objects import (
    BallConfig,
    HollowConfig,
    ObjectConfig,
    UrdfObjectConfig,
)
from contactfusion_lab.simulation.push_parts import Part
from contactfusion_lab.simulation.push_shapes import SoftConfig

GRIP = 0.5
"""Friction between a ball and what it rolls in."""


class Thing(NamedTuple):
    """An object that can be pushed.

    Attributes:
        body: in PyBullet.
        back: where PyBullet has the body's place, in the object's frame [m].
        turn: how PyBullet has the body turned there, a quaternion x, y, z, w.
        ball: what rolls inside, in PyBullet; None: nothing does.
    """

    body: int
    back: tuple[float, float, float]
    turn: Quaternion
    ball: int | None


def add_object(bullet: Any, client: Client, config: ObjectConfig) -> Thing:
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
        back, turn = bullet.getDynamicsInfo(body, -1, **client)[3:5]
    else:
        parts = config.parts()
        body = _joined(bullet, client, parts)
        x, y = parts[0].middle.tolist()
        back, turn = (x, y, parts[0].bottom + parts[0].height / 2.0), (0.0, 0.0, 0.0, 1.0)
    rub(bullet, client, body, 1.0)
    ball = None
    if isinstance(config, HollowConfig) and config.ball is not None:
        ball = _rolling(bullet, client, config.ball, config.wall)
    return Thing(body, back, turn, ball)


def soften(bullet: Any, client: Client, base: int, soft: SoftConfig) -> None:
    """Let a base and the object give way where they press each other.

    PyBullet puts the springs of two bodies in a row, at each point of contact. Were the object's
    the soft one, it would sink into the floor, too; the base touches nothing but the object. What
    is pressed along a line has a point at each end of it, so each has half of the whole.
    """
    bullet.changeDynamics(
        base, CHASSIS_LINK, contactStiffness=soft.stiffness / 2.0,
        contactDamping=soft.damping / 2.0, **client,
    )  # fmt: skip


def turned(one: Quaternion, other: Quaternion) -> Quaternion:
    """Turn as `other` does, then as `one` does."""
    x, y, z, w = one
    a, b, c, d = other
    return (
        w * a + x * d + y * c - z * b,
        w * b + y * d + z * a - x * c,
        w * c + z * d + x * b - y * a,
        w * d - x * a - y * b - z * c,
    )


def _joined(bullet: Any, client: Client, parts: Sequence[Part]) -> int:
    """Put parts together: each a link of its own, so that each keeps its mass."""
    middles = [(*part.middle, part.bottom + part.height / 2.0) for part in parts]
    places = [tuple(np.subtract(middle, middles[0])) for middle in middles[1:]]
    count = len(places)
    body: int = bullet.createMultiBody(
        parts[0].mass,
        _shape(bullet, client, parts[0]),
        linkMasses=[part.mass for part in parts[1:]],
        linkCollisionShapeIndices=[_shape(bullet, client, part) for part in parts[1:]],
        linkParentIndices=[0] * count,
        linkJointTypes=[bullet.JOINT_FIXED] * count,
        linkJointAxis=[(0.0, 0.0, 1.0)] * count,
        **in_place(places),
        **client,
    )
    return body


def _rolling(bullet: Any, client: Client, ball: BallConfig, floor: float) -> int:
    """Lay a ball on the floor of what it rolls in."""
    shape = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=ball.radius, **client)
    place = (0.0, 0.0, floor + ball.radius)
    body: int = bullet.createMultiBody(ball.mass, shape, basePosition=place, **client)
    rub(bullet, client, body, GRIP)
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
