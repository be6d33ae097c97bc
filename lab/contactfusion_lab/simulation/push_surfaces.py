"""Objects to push from above, and their surfaces."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError
from contactfusion.frames import points_in
from contactfusion.robots.description import RobotConfig
from contactfusion_lab.simulation.push_objects import ObjectConfig, UrdfObjectConfig
from contactfusion_lab.simulation.push_parts import Triangles, extruded


def outlines(config: ObjectConfig) -> list[FloatArray]:
    """Give the object as it is seen from above: the corners of each convex piece.

    The collision shapes of a URDF are taken for convex, its joints stand at 0.

    Returns:
        Each of shape (n, 2) [m], counterclockwise, in the object's frame.

    Raises:
        RobotError: a URDF cannot be read, has no collision shape, or one that is flat.
    """
    if not isinstance(config, UrdfObjectConfig):
        return [part.outline for part in config.parts()]
    from contactfusion.robots.model import RobotModel

    model = RobotModel(RobotConfig(urdf=config.urdf, folder=config.folder))
    poses = model.poses_at(np.zeros(len(model.joint_names)))
    try:
        found = [
            _hull(points_in(poses[link], vertices)[:, :2])
            for link, solid in model.solids.items()
            for vertices, _ in solid.meshes
        ]
    except QhullError:
        raise RobotError(f"{model.urdf.path}: a collision shape is flat seen from above") from None
    if not found:
        raise RobotError(f"{model.urdf.path}: it has no collision shape")
    return found


def triangles_of(config: ObjectConfig) -> list[Triangles]:
    """Give the surface of an object in its frame, one closed mesh a piece.

    Returns:
        Vertices (v, 3) [m], and rows of them that make triangles, (t, 3).

    Raises:
        RobotError: a URDF cannot be read, or has no collision shape.
    """
    if isinstance(config, UrdfObjectConfig):
        from contactfusion.robots.model import RobotModel

        model = RobotModel(RobotConfig(urdf=config.urdf, folder=config.folder))
        poses = model.poses_at(np.zeros(len(model.joint_names)))
        return [
            (points_in(poses[link], vertices), triangles)
            for link, solid in model.solids.items()
            for vertices, triangles in solid.meshes
        ]
    return [extruded(part) for part in config.parts()]


def _hull(points: FloatArray) -> FloatArray:
    corners: FloatArray = points[ConvexHull(points).vertices]
    return corners
