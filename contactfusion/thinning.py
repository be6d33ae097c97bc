"""Voxel downsampling: one position a voxel, as the integrator distinguishes no more."""

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.grid import Grid
from contactfusion.jit import kernel

COUNTABLE = 2.0**62
DENSE = 64
"""Voxels for each position up to which a table of all voxels is faster than sorting."""


def voxel_downsample(positions: FloatArray, grid: Grid) -> NDArray[np.intp]:
    """The rows of the first position in each occupied voxel, ascending.

    Args:
        positions: shape (n, 3) [m], in the grid's frame.
        grid: the voxels.
    """
    positions = np.ascontiguousarray(positions, np.float64)
    if not len(positions):
        return np.zeros(0, np.intp)
    keys, count = _numbered(positions, 1.0 / grid.voxel_size)
    if not count <= DENSE * len(keys):  # nor where a position is not finite
        voxels = grid.voxels(positions)
        return np.sort(np.unique(voxels, axis=0, return_index=True)[1])
    return _first_rows(keys, int(count))


@kernel
def _numbered(positions: FloatArray, scale: float) -> tuple[NDArray[np.int64], float]:
    """Numbers of the voxels of positions, counted in their bounding box.

    Args:
        positions: shape (n, 3) [m], at least one.
        scale: 1 / side [1/m].

    Returns:
        Shape (n,), and the number of voxels of the box; infinity, and no numbers, where a position
        is not finite or there are more voxels than a number can count.
    """
    low = np.floor(positions[0] * scale)
    high = low.copy()
    finite = True
    for row in range(len(positions)):
        for axis in range(3):
            cell = np.floor(positions[row, axis] * scale)
            finite &= np.isfinite(cell)
            low[axis] = min(low[axis], cell)
            high[axis] = max(high[axis], cell)
    keys = np.empty(len(positions), np.int64)
    count = (high[0] - low[0] + 1.0) * (high[1] - low[1] + 1.0) * (high[2] - low[2] + 1.0)
    if not finite or not count < COUNTABLE:
        return keys, np.inf
    sizes = (high - low).astype(np.int64) + 1
    for row in range(len(positions)):
        key = np.int64(0)
        for axis in range(3):
            cell = np.floor(positions[row, axis] * scale) - low[axis]
            key = key * sizes[axis] + np.int64(cell)
        keys[row] = key
    return keys, count


@kernel
def _first_rows(keys: NDArray[np.int64], count: int) -> NDArray[np.intp]:
    """The rows whose key no earlier row has, for keys below `count`."""
    seen = np.zeros(count, np.bool_)
    rows = np.empty(len(keys), np.intp)
    found = 0
    for row in range(len(keys)):
        if not seen[keys[row]]:
            seen[keys[row]] = True
            rows[found] = row
            found += 1
    return rows[:found]
