"""The proximity descriptor once more, by plain loops: what the fast one is compared with."""

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.generators.proximity import ProximityConfig


def by_loops(points: FloatArray, config: ProximityConfig) -> FloatArray:
    """Give the lengths of the strips by the equations as they are printed (O Eq 5-11).

    Args:
        points: shape (n, 3) [m], in the robot's frame; rows that are not finite are no points.
        config: the region and its cells.

    Returns:
        Shape (S,) [m], from right to left.
    """
    box, (deep, wide) = config.region, config.cell
    inside = [
        (x, y)
        for x, y, z in points.tolist()
        if box.x[0] < x < box.x[1] and box.y[0] < y < box.y[1] and box.z[0] < z < box.z[1]
    ]
    start = box.x[0] + deep / 2.0
    lengths = []
    for column in range(round((box.y[1] - box.y[0]) / wide)):
        right, left = box.y[0] + column * wide, box.y[0] + (column + 1) * wide
        strip = [x for x, y in inside if right <= y < left]
        end = box.x[1]
        for row in range(round((box.x[1] - box.x[0]) / deep)):
            low, high = box.x[0] + row * deep, box.x[0] + (row + 1) * deep
            cell = [x for x in strip if low <= x < high]
            if cell:
                end = sum(cell) / len(cell)
                break
        lengths.append(abs(end - start))
    return np.array(lengths)
