"""The voxel grid, with the one rounding of positions to voxels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray

VOXEL_LIMIT = 1 << 20
"""Bound of the magnitude of voxel indices: 5 mm voxels reach 5 km."""


@dataclass(frozen=True, slots=True)
class Grid:
    """A grid of half-open cubes, fixed in one frame.

    Attributes:
        frame: that the grid is fixed in.
        voxel_size: the side of a voxel [m].
    """

    frame: str
    voxel_size: float

    def voxels(self, positions: FloatArray) -> NDArray[np.int64]:
        """The voxel of each position.

        Args:
            positions: shape (n, 3) [m], in the grid's frame.

        Returns:
            Shape (n, 3): floor(x · (1 / side)) per component, in float64.
        """
        scaled = np.asarray(positions, dtype=np.float64) * (1.0 / self.voxel_size)
        return np.floor(scaled).astype(np.int64)

    def centres(self, voxels: NDArray[np.int64]) -> FloatArray:
        """The centres of voxels, shape (n, 3) [m]."""
        return (np.asarray(voxels, np.float64) + 0.5) * np.float64(self.voxel_size)
