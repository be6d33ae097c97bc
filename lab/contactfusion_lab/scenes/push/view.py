"""Ray casting from the base: on the object, the base itself and the floor."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.frames import PlanarPose, Pose, inverse, planar_pose, points_in, vectors_in
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import shared_robot
from contactfusion.robots.solids import loaded_open3d
from contactfusion_lab.scenes.push.bodies import ORIGIN_HEIGHT
from contactfusion_lab.scenes.push.objects import ObjectConfig, Triangles, triangles_of


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays that are fixed to the base, in its frame.

    Attributes:
        origin: shape (3,) [m].
        directions: shape (n, 3); distances are in units of their lengths.
        still: shape (n,), distances to the base itself or the floor, inf where there is neither.
    """

    origin: FloatArray
    directions: FloatArray
    still: FloatArray


class PushView:
    """The object on the floor before the base, for rays.

    The base and the floor never move in the base's frame: rays are cast on them once, on the object
    each time.

    Args:
        pushed: the object.
        robot: the base.

    Raises:
        DependencyError: open3d is not installed.
    """

    def __init__(self, pushed: ObjectConfig, robot: RobotConfig) -> None:
        self._object = _scene(triangles_of(pushed))
        model = shared_robot(robot)
        poses = model.poses_at(np.zeros(len(model.joint_names)))
        self._robot = _scene(
            [
                (points_in(poses[link], vertices), triangles)
                for link, solid in model.solids.items()
                for vertices, triangles in solid.meshes
            ]
        )

    def rays(self, origin: FloatArray, directions: FloatArray) -> Rays:
        """Rays that are fixed to the base.

        Args:
            origin: shape (3,) [m], in the base's frame.
            directions: shape (n, 3), in the base's frame.
        """
        still = _cast(self._robot, origin, directions)
        down = directions[:, 2] < 0.0
        floor = (-ORIGIN_HEIGHT - origin[2]) / np.where(down, directions[:, 2], -1.0)
        return Rays(origin, directions, np.minimum(still, np.where(down, floor, np.inf)))

    def distances(
        self, rays: Rays, base: PlanarPose, pushed: PlanarPose
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Distance along each ray, and whether it ends on the object.

        Args:
            rays: fixed to the base.
            base: true pose of the base.
            pushed: true pose of the object.

        Returns:
            Shape (n,), in units of the directions' lengths, inf where nothing is hit; and a mask of
            the rays that end on the object.
        """
        there = inverse(planar_pose(pushed, -ORIGIN_HEIGHT)) @ planar_pose(base, 0.0)
        found = _met(self._object, rays, there)
        return np.minimum(found, rays.still), found < rays.still


def distances_to(bodies: Sequence[Triangles], rays: Rays, base: PlanarPose) -> FloatArray:
    """Distance along each ray to the nearest of some bodies.

    Args:
        bodies: in `odom`.
        rays: fixed to the base.
        base: true pose of the base.

    Returns:
        Shape (n,), in units of the directions' lengths, inf where none is hit.
    """
    return _met(_scene(bodies), rays, planar_pose(base, ORIGIN_HEIGHT))


def _met(scene: Any, rays: Rays, there: Pose) -> FloatArray:
    """Distances along rays of the base, which stands at a pose in the scene."""
    origin = points_in(there, rays.origin[None])[0]
    return _cast(scene, origin, vectors_in(there, rays.directions))


def _cast(scene: Any, origin: FloatArray, directions: FloatArray) -> FloatArray:
    rays = np.empty((len(directions), 6), np.float32)
    rays[:, :3], rays[:, 3:] = origin, directions
    found = scene.cast_rays(loaded_open3d().core.Tensor(rays), nthreads=1)["t_hit"].numpy()
    return np.asarray(found, np.float64)


def _scene(meshes: Sequence[Triangles]) -> Any:
    open3d = loaded_open3d()
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    for vertices, triangles in meshes:
        scene.add_triangles(
            open3d.core.Tensor(np.ascontiguousarray(vertices, np.float32)),
            open3d.core.Tensor(np.ascontiguousarray(triangles, np.uint32)),
        )
    return scene
