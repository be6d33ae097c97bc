"""Kernels of the rule `posterior`: how well a contact at each place would explain a source."""

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.jit import kernel

REACH = 4.0
"""Beyond so many standard deviations a hypothesis says nothing."""


@kernel
def spread_out(
    places: FloatArray,
    positions: FloatArray,
    likelihoods: NDArray[np.float32],
    variances: FloatArray,
    single: bool,
    field: FloatArray,
) -> None:
    """Spread hypotheses over places: a Gaussian each, as wide as its spread.

    Hypotheses of a single contact are alternatives, so that they add up; those of several contacts
    are claims of their own, of which the strongest counts.

    Args:
        places: shape (c, 3) [m].
        positions: shape (n, 3) [m].
        likelihoods: shape (n,).
        variances: shape (n,) [m²], by axis.
        single: whether the hypotheses describe one contact.
        field: shape (c,), is overwritten.
    """
    for row in range(len(places)):
        x, y, z = places[row, 0], places[row, 1], places[row, 2]
        value = 0.0
        for i in range(len(positions)):
            dx, dy, dz = positions[i, 0] - x, positions[i, 1] - y, positions[i, 2] - z
            squared = (dx * dx + dy * dy + dz * dz) / variances[i]
            if squared < REACH * REACH:
                share = likelihoods[i] * np.exp(-0.5 * squared)
                value = value + share if single else max(value, share)
        field[row] = value


@kernel
def near(
    points: FloatArray, cells: NDArray[np.bool_], low: FloatArray, side: float
) -> NDArray[np.bool_]:
    """Tell which points lie in marked cells of a coarse grid, shape (n,).

    Args:
        points: shape (n, 3) [m].
        cells: shape (a, b, c), the marked ones are True.
        low: shape (3,) [m], the least corner of the grid.
        side: of a cell [m].
    """
    found = np.zeros(len(points), np.bool_)
    for row in range(len(points)):
        i = int(np.floor((points[row, 0] - low[0]) / side))
        j = int(np.floor((points[row, 1] - low[1]) / side))
        k = int(np.floor((points[row, 2] - low[2]) / side))
        if 0 <= i < cells.shape[0] and 0 <= j < cells.shape[1] and 0 <= k < cells.shape[2]:
            found[row] = cells[i, j, k]
    return found


@kernel
def densities(places: FloatArray, weights: FloatArray, width: float, floor: float) -> FloatArray:
    """Smooth weights over their neighbourhood: a Gaussian kernel of `width` [m], shape (c,).

    Places with less than `floor` are no modes, and get 0.
    """
    found = np.zeros(len(places))
    for row in range(len(places)):
        if weights[row] < floor:
            continue
        for i in range(len(places)):
            squared = 0.0
            for axis in range(3):
                squared += (places[i, axis] - places[row, axis]) ** 2
            squared /= width * width
            if squared < REACH * REACH:
                found[row] += weights[i] * np.exp(-0.5 * squared)
    return found
