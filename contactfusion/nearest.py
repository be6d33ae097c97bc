"""The nearest sample of a rigid body: looked up in a grid, then searched along the surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose
from contactfusion.jit import kernel

CELL = 0.01
"""The distance between neighbouring nodes of the grid [m]."""
MOST_NODES = 4_000_000
"""The greatest number of nodes; a larger body has a coarser grid: a node takes 50 bytes to
build."""
PADDING = 0.03
"""The margin of the grid around the body [m]; further off, the nearest node of its rim serves."""
NEIGHBOURS = 8
"""Number of neighbours of a sample that the search visits."""

Int32Array = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class NearestGrid:
    """A grid and neighbours for fast search of a body's nearest sample.

    Attributes:
        samples: shape (n, 3) [m].
        low: shape (3,) [m], the least corner of the samples.
        high: shape (3,) [m], their greatest corner.
        cell: the distance between neighbouring nodes [m].
        nodes: shape (a, b, c), the sample nearest to each node of the grid.
        neighbours: shape (n, k), the samples nearest to each sample.
    """

    samples: FloatArray
    low: FloatArray
    high: FloatArray
    cell: float
    nodes: Int32Array
    neighbours: Int32Array

    @staticmethod
    def of(samples: FloatArray) -> "NearestGrid":
        """The grid of samples of shape (n, 3) [m], n at least 1."""
        from scipy.spatial import KDTree

        tree = KDTree(samples)
        low, high = samples.min(axis=0), samples.max(axis=0)
        cell, counts = CELL, _counts(low, high, CELL)
        while np.prod(counts, dtype=np.float64) > MOST_NODES:
            cell *= 2.0
            counts = _counts(low, high, cell)
        axes = [start - PADDING + cell * np.arange(n) for start, n in zip(low, counts, strict=True)]
        positions = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        nodes = np.asarray(tree.query(positions)[1], np.int32).reshape(counts)
        k = min(NEIGHBOURS + 1, len(samples))
        around = np.asarray(tree.query(samples, k=k)[1], np.int32).reshape(len(samples), k)
        return NearestGrid(samples, low, high, cell, nodes, around)

    def improve(
        self,
        points: FloatArray,
        back: Pose,
        begin: int,
        distances: FloatArray,
        rows: NDArray[np.intp],
    ) -> None:
        """Update distances and rows where a sample is nearer than those so far.

        Args:
            points: shape (m, 3) [m], in any frame.
            back: transforms that frame to the samples'.
            begin: offset of the rows of the samples.
            distances: shape (m,) [m], updated where a sample is nearer.
            rows: shape (m,), likewise.
        """
        _improve(
            points,
            np.ascontiguousarray(back),
            self.samples,
            self.low,
            self.high,
            self.cell,
            self.nodes,
            self.neighbours,
            begin,
            distances,
            rows,
        )


def _counts(low: FloatArray, high: FloatArray, cell: float) -> NDArray[np.int64]:
    return np.ceil((high - low + 2.0 * PADDING) / cell).astype(np.int64) + 1


@kernel
def _improve(
    points: FloatArray,
    back: Pose,
    samples: FloatArray,
    low: FloatArray,
    high: FloatArray,
    cell: float,
    nodes: Int32Array,
    neighbours: Int32Array,
    begin: int,
    distances: FloatArray,
    rows: NDArray[np.intp],
) -> None:
    position, at, middle = np.empty(3), np.empty(3, np.int64), np.zeros(3)
    half = np.sqrt(np.square(high - low).sum()) / 2.0
    for axis in range(3):  # of the box, in the frame of the points
        for j in range(3):
            middle[axis] += back[j, axis] * ((low[j] + high[j]) / 2.0 - back[j, 3])
    for i in range(len(points)):
        x, y, z = points[i, 0] - middle[0], points[i, 1] - middle[1], points[i, 2] - middle[2]
        far = distances[i] + half
        if x * x + y * y + z * z >= far * far:
            continue
        best, beyond = distances[i] * distances[i], 0.0
        for axis in range(3):
            position[axis] = back[axis, 3]
            for j in range(3):
                position[axis] += back[axis, j] * points[i, j]
            out = max(low[axis] - position[axis], position[axis] - high[axis], 0.0)
            beyond += out * out
        if beyond >= best:
            continue
        for axis in range(3):
            node = np.floor((position[axis] - low[axis] + PADDING) / cell)
            at[axis] = int(min(max(node, 0.0), nodes.shape[axis] - 2.0))
        sample, square, last = -1, np.inf, -2
        for corner in range(8):  # of the cell of the position, or of the nearest one
            a, b, c = at[0] + (corner & 1), at[1] + (corner >> 1 & 1), at[2] + (corner >> 2)
            candidate = int(nodes[int(a), int(b), int(c)])
            other = _square(samples, candidate, position)
            if other < square:
                square, sample = other, candidate
        slack = distances[i] + cell
        if square > slack * slack:
            continue  # the search gains less than a cell
        while sample != last:  # descend along the surface while it comes nearer
            last = sample
            for column in range(neighbours.shape[1]):
                neighbour = int(neighbours[last, column])
                other = _square(samples, neighbour, position)
                if other < square:
                    square, sample = other, neighbour
        if square < best:
            distances[i], rows[i] = np.sqrt(square), begin + sample


@kernel
def _square(samples: FloatArray, row: int, position: FloatArray) -> float:
    x, y = samples[row, 0] - position[0], samples[row, 1] - position[1]
    z = samples[row, 2] - position[2]
    return float(x * x + y * y + z * z)
