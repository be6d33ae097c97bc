"""The bodies of a push in PyBullet: floor and driven base, and what all bodies need."""

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from contactfusion.errors import RobotError
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.urdf import Mesh, read_urdf

ORIGIN_HEIGHT = 0.45
"""Of the robot's frame above the floor [m]."""
SLIDES, CHASSIS = 10.0, 130.0
"""Masses of the two slides that carry the base, and of the base [kg]; motors hide them."""
CHASSIS_LINK = 2
"""What of the base touches, the last of its links."""
GRAVITY = 9.81
"""[m/s²]."""

Client = Mapping[str, int]
"""Names the physics among several, as PyBullet wants it."""
Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""


class Base(NamedTuple):
    """A base that is driven, and its pushing face.

    Attributes:
        body: in PyBullet.
        front: where the pushing face lies in the robot's frame [m].
        rear: where the base ends behind [m].
        half_width: of the pushing face [m].
    """

    body: int
    front: float
    rear: float
    half_width: float


def add_floor(bullet: Any, client: Client, friction: float) -> None:
    """Add the floor; PyBullet multiplies the frictions of two bodies, the object's is 1."""
    plane = bullet.createCollisionShape(bullet.GEOM_PLANE, **client)
    rub(bullet, client, bullet.createMultiBody(0.0, plane, **client), friction)


def add_base(bullet: Any, client: Client, robot: RobotConfig, friction: float) -> Base:
    """Put a base on two slides and a hinge, whose motors drive it without slip.

    Raises:
        RobotError: the base is not one box.
    """
    urdf = read_urdf(robot.path(), robot.package_folders())
    shapes = [shape for link in urdf.links.values() for shape in link.collision]
    if len(shapes) != 1 or isinstance(shapes[0], Mesh) or shapes[0].shape != "box":
        raise RobotError(f"{urdf.path}: a base that pushes has one collision shape, a box")
    xyz, size = shapes[0].xyz, np.array(shapes[0].size)
    chassis = bullet.createCollisionShape(
        bullet.GEOM_BOX, halfExtents=size / 2.0, collisionFramePosition=xyz, **client
    )
    body: int = bullet.createMultiBody(
        0.0,
        basePosition=(0.0, 0.0, ORIGIN_HEIGHT),
        linkMasses=(SLIDES, SLIDES, CHASSIS),
        linkCollisionShapeIndices=(-1, -1, chassis),
        linkParentIndices=(0, 1, 2),
        linkJointTypes=(bullet.JOINT_PRISMATIC, bullet.JOINT_PRISMATIC, bullet.JOINT_REVOLUTE),
        linkJointAxis=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        **in_place(((0.0, 0.0, 0.0),) * 3),
        **client,
    )
    rub(bullet, client, body, friction)
    front = xyz[0] + float(size[0]) / 2.0
    bullet.resetJointState(body, 0, -front, **client)
    return Base(body, front, front - float(size[0]), float(size[1]) / 2.0)


def rub(bullet: Any, client: Client, body: int, friction: float) -> None:
    """Give a body Coulomb friction, and take every other loss away."""
    for row in range(-1, bullet.getNumJoints(body, **client)):
        bullet.changeDynamics(
            body, row, lateralFriction=friction, rollingFriction=0.0, spinningFriction=0.0,
            restitution=0.0, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, **client,
        )  # fmt: skip


@contextmanager
def quiet() -> Iterator[None]:
    """Keep what PyBullet prints of itself out of the output."""
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


def in_place(places: Sequence[tuple[float, ...]]) -> dict[str, Any]:
    """Give the places of links that are neither turned nor seen."""
    count = len(places)
    return {
        "linkPositions": places,
        "linkOrientations": [(0.0, 0.0, 0.0, 1.0)] * count,
        "linkInertialFramePositions": [(0.0, 0.0, 0.0)] * count,
        "linkInertialFrameOrientations": [(0.0, 0.0, 0.0, 1.0)] * count,
        "linkVisualShapeIndices": [-1] * count,
    }
