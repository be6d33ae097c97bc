"""An object that moves, in PyBullet: with the inertia of its URDF, or that of its shapes."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.errors import RobotError
from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.objects import ObjectModel
from contactfusion.robots.urdf import Mesh, read_urdf
from contactfusion.shapes import ShapeConfig


def add_movable(world: BulletWorld, thing: ObjectModel, mass: float | None) -> int:
    """Add an object that moves, at the origin.

    Args:
        world: where to.
        thing: the object.
        mass: spread evenly over the box around its shapes [kg]; None: as its URDF says.

    Returns:
        Its number in PyBullet.

    Raises:
        RobotError: its URDF has no mass, or PyBullet cannot read it.
    """
    bullet, client = world.bullet, world.client
    if mass is None:
        assert thing.config.urdf is not None
        path = RobotConfig(urdf=thing.config.urdf, folder=thing.config.folder).path()
        if not any(link.mass for link in read_urdf(path).links.values()):  # PyBullet takes 1 kg
            raise RobotError(f"{path} has no mass, so nothing moves it: give the scene's `mass`")
        flags = bullet.URDF_USE_INERTIA_FROM_FILE
        try:
            body: int = bullet.loadURDF(str(path), flags=flags, **client)
        except bullet.error as error:
            raise RobotError(f"{path}: PyBullet cannot load it: {error}") from None
        return body
    corners = np.concatenate([vertices for vertices, _ in thing.solid.meshes])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    parts = [_part(bullet, shape) for shape in thing.shapes]
    joined = bullet.createCollisionShapeArray(
        **{name: [part[name] for part in parts] for name in parts[0]}, **client
    )
    made: int = bullet.createMultiBody(
        mass, joined, baseInertialFramePosition=middle.tolist(), **client
    )
    return made


def _part(bullet: Any, shape: ShapeConfig | Mesh) -> dict[str, Any]:
    """Give one shape as PyBullet joins them; it wants every field of each."""
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
