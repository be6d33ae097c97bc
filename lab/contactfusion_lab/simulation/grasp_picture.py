"""Pictures of a grasp, as somebody beside the table would see it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray

NEAR, FAR = 0.05, 5.0
"""Between these distances things are seen [m]."""


@dataclass(frozen=True)
class Eye:
    """Who looks from where, in the root link's frame, whose z points up.

    Attributes:
        place: [m].
        target: what is in the middle of the picture [m].
        field: of view, from bottom to top [degrees].
        width: [pixels].
        height: [pixels].
    """

    place: tuple[float, float, float]
    target: tuple[float, float, float]
    field: float = 40.0
    width: int = 480
    height: int = 360

    def picture(self, bullet: Any, client: dict[str, int]) -> NDArray[np.uint8]:
        """See what is in PyBullet, shape (height, width, 3)."""
        view, projection = self._matrices(bullet)
        seen = bullet.getCameraImage(
            self.width, self.height, view, projection, shadow=1,
            lightDirection=(0.5, -1.0, 2.0), renderer=bullet.ER_TINY_RENDERER, **client,
        )  # fmt: skip
        colours = np.reshape(np.asarray(seen[2], np.uint8), (self.height, self.width, 4))
        return colours[:, :, :3].copy()

    def pixels(self, bullet: Any, places: FloatArray) -> FloatArray:
        """Give where places are in the picture.

        Args:
            bullet: PyBullet.
            places: shape (n, 3) [m].

        Returns:
            Shape (n, 2), from the left and from the top [pixels].
        """
        view, projection = (
            np.reshape(matrix, (4, 4)).T for matrix in self._matrices(bullet)
        )  # by columns, as OpenGL has them
        seen = np.column_stack([places, np.ones(len(places))]) @ (projection @ view).T
        across = seen[:, :2] / seen[:, 3:]
        half = np.array([self.width, self.height]) / 2.0
        found: FloatArray = half + half * across * [1.0, -1.0]
        return found

    def _matrices(self, bullet: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
        view = bullet.computeViewMatrix(self.place, self.target, (0.0, 0.0, 1.0))
        aspect = self.width / self.height
        return view, bullet.computeProjectionMatrixFOV(self.field, aspect, NEAR, FAR)
