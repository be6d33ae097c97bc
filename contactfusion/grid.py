"""The voxel grid: the one rounding of places to voxels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.jit import kernel

VOXEL_LIMIT = 1 << 20
"""Voxel indices stay below this in magnitude: 5 mm voxels reach 5 km."""
DENSE = 64
"""Up to so many voxels for each place a table of all of them is faster than sorting."""


@dataclass(frozen=True, slots=True)
class Grid:
    """A grid of half-open cubes fixed in one frame.

    Attributes:
        frame: the frame in which the grid stands still.
        voxel_size: the side of a voxel [m].
    """

    frame: str
    voxel_size: float

    def voxels(self, positions: FloatArray) -> NDArray[np.int64]:
        """Give the voxel that each place lies in.

        Args:
            positions: shape (n, 3) [m], in the grid's frame.

        Returns:
            Shape (n, 3): floor(x · (1 / side)) per component, in float64.
        """
        scaled = np.asarray(positions, dtype=np.float64) * (1.0 / self.voxel_size)
        return np.floor(scaled).astype(np.int64)

    def first_in_voxels(self, positions: FloatArray) -> NDArray[np.intp]:
        """Give the rows of the first place in each voxel that has one, ascending.

        Args:
            positions: shape (n, 3) [m], in the grid's frame.
        """
        positions = np.ascontiguousarray(positions, np.float64)
        if not len(positions):
            return np.zeros(0, np.intp)
        keys, count = _keys(positions, 1.0 / self.voxel_size)
        if count > DENSE * len(keys):
            return np.sort(np.unique(keys, return_index=True)[1])
        return _firsts(keys, count)

    def centres(self, voxels: NDArray[np.int64]) -> FloatArray:
        """Give the places of voxels: their centres, shape (n, 3) [m]."""
        return (np.asarray(voxels, np.float64) + 0.5) * np.float64(self.voxel_size)


@kernel
def _keys(positions: FloatArray, scale: float) -> tuple[NDArray[np.int64], int]:
    """Number the voxels of the box around some places, and give the number of each place's.

    Args:
        positions: shape (n, 3) [m], at least one.
        scale: 1 / side [1/m].

    Returns:
        Shape (n,), and how many voxels the box has.
    """
    low = np.floor(positions[0] * scale)
    high = low.copy()
    for row in range(len(positions)):
        for axis in range(3):
            cell = np.floor(positions[row, axis] * scale)
            low[axis] = min(low[axis], cell)
            high[axis] = max(high[axis], cell)
    sizes = (high - low).astype(np.int64) + 1
    keys = np.empty(len(positions), np.int64)
    for row in range(len(positions)):
        key = np.int64(0)
        for axis in range(3):
            cell = np.floor(positions[row, axis] * scale) - low[axis]
            key = key * sizes[axis] + np.int64(cell)
        keys[row] = key
    return keys, sizes[0] * sizes[1] * sizes[2]


@kernel
def _firsts(keys: NDArray[np.int64], count: int) -> NDArray[np.intp]:
    """Give the rows whose key no earlier row has, for keys below `count`."""
    seen = np.zeros(count, np.bool_)
    rows = np.empty(len(keys), np.intp)
    found = 0
    for row in range(len(keys)):
        if not seen[keys[row]]:
            seen[keys[row]] = True
            rows[found] = row
            found += 1
    return rows[:found]
