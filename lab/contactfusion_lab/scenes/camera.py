"""A range camera, simulated by ray casting on a robot and collision geometry."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in
from contactfusion.robots.description import CameraConfig
from contactfusion.robots.solids import Solid, loaded_open3d


class RangeCamera:
    """A camera whose images are depth along its optical axis z [m], 0 where nothing is measured.

    Args:
        config: image size, field of view and range limits.
    """

    def __init__(self, config: CameraConfig) -> None:
        self.config = config
        focal = config.width / 2.0 / np.tan(np.radians(config.fov) / 2.0)
        middle = (config.width - 1) / 2.0, (config.height - 1) / 2.0
        self.intrinsics = np.array(
            [[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]]
        )
        """Camera matrix, shape (3, 3) [pixels]."""
        u, v = np.meshgrid(np.arange(config.width), np.arange(config.height))
        self._rays = np.stack(
            [(u - middle[0]) / focal, (v - middle[1]) / focal, np.ones_like(u)], axis=-1
        )

    def depth(self, pose: Pose, bodies: Sequence[tuple[Solid, Pose]]) -> FloatArray:
        """A depth image of solid bodies.

        Args:
            pose: of the camera, in any frame.
            bodies: collision geometry, each with its pose in the same frame.

        Returns:
            Shape (height, width) [m].
        """
        open3d = loaded_open3d()
        scene: Any = open3d.t.geometry.RaycastingScene(nthreads=1)
        for solid, placed in bodies:
            for vertices, triangles in solid.meshes:
                scene.add_triangles(
                    open3d.core.Tensor(points_in(placed, vertices).astype(np.float32)),
                    open3d.core.Tensor(triangles),
                )
        rays = np.empty((*self._rays.shape[:2], 6), np.float32)
        rays[..., :3] = pose[:3, 3]
        # a direction with z = 1 is hit after as many of its lengths as the depth has metres
        rays[..., 3:] = self._rays @ pose[:3, :3].T
        depth = scene.cast_rays(open3d.core.Tensor(rays), nthreads=1)["t_hit"].numpy()
        return self.within_reach(depth.astype(np.float64))

    def within_reach(self, depth: FloatArray) -> FloatArray:
        """Depths within the range limits, 0 elsewhere, shape (height, width) [m]."""
        nearest, farthest = self.config.reach
        return np.where((depth >= nearest) & (depth <= farthest), depth, 0.0)

    def points(self, depth: FloatArray) -> FloatArray:
        """The points of all returns, shape (n, 3) [m], in the camera's frame."""
        seen = depth > 0.0
        return self._rays[seen] * depth[seen][:, None]
