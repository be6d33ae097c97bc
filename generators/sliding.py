"""What an object touches first when it slides along a line: distances on a grid, and the search."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in
from contactfusion.jit import kernel
from contactfusion.robots.objects import ObjectConfig, ObjectModel

CELL = 0.004
"""The distance between neighbouring nodes of the grid [m], of an object that is not too large."""
NODES = 500_000
"""About as many nodes at most; a larger object has a coarser grid."""
PADDING = 0.03
"""The grid reaches so far beyond the object [m]; further off, the distance to its box serves."""
TUFT = 0.02
"""Points of a surface are bundled by cubes of this side [m]: most bundles are never opened."""
TOUCHING = 3e-4
"""What is nearer than this touches [m]."""

Int64Array = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class DistanceGrid:
    """The signed distance of an object at the nodes of a grid, in the object's frame.

    Attributes:
        low: shape (3,) [m], the least corner of the object.
        high: shape (3,) [m], the greatest.
        corner: shape (3,) [m], the first node.
        cell: the distance between neighbouring nodes [m].
        nodes: shape (a, b, c) [m], negative inside.
        radius: of a ball about the origin of the object's frame that holds the object [m].
    """

    low: FloatArray
    high: FloatArray
    corner: FloatArray
    cell: float
    nodes: NDArray[np.float32]
    radius: float

    @staticmethod
    def of(model: ObjectModel) -> "DistanceGrid":
        """Work out the grid of an object."""
        vertices = np.concatenate([vertices for vertices, _ in model.solid.meshes])
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        extent = high - low + 2.0 * PADDING
        cell = max(CELL, float(np.cbrt(extent.prod() / NODES)))
        counts = np.ceil(extent / cell).astype(np.int64) + 1
        corner = low - PADDING
        axes = [start + cell * np.arange(n) for start, n in zip(corner, counts, strict=True)]
        places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        nodes = model.solid.signed_distances(places).reshape(counts).astype(np.float32)
        radius = float(np.linalg.norm(vertices, axis=1).max())
        return DistanceGrid(low, high, corner, cell, nodes, radius)

    @property
    def centre(self) -> FloatArray:
        """The middle of the object's box, shape (3,) [m]."""
        return (self.low + self.high) / 2.0

    def distances(self, points: FloatArray) -> FloatArray:
        """Give signed distances, shape (n,) [m]; beyond the grid, they may come out too small.

        Args:
            points: shape (n, 3) [m], in the object's frame.
        """
        found = np.empty(len(points))
        _distances(points, self.low, self.high, self.corner, self.cell, self.nodes, found)
        return found


def shared_grid(config: ObjectConfig) -> DistanceGrid:
    """Give the distances of an object, worked out once in a process: that takes up to a second."""
    return _grid(config.model_dump_json())


@lru_cache(maxsize=16)
def _grid(config: str) -> DistanceGrid:
    return DistanceGrid.of(ObjectModel(ObjectConfig.model_validate_json(config)))


@dataclass(frozen=True, eq=False)
class Tufts:
    """Points of a surface in bundles, each in a ball.

    Attributes:
        points: shape (n, 3) [m], bundle by bundle.
        ends: shape (m + 1,), where each bundle begins, and where the last one ends.
        centres: shape (m, 3) [m], of the balls.
        radii: shape (m,) [m].
    """

    points: FloatArray
    ends: Int64Array
    centres: FloatArray
    radii: FloatArray

    @staticmethod
    def of(points: FloatArray) -> "Tufts":
        """Bundle points of shape (n, 3) [m], n at least 1."""
        cells = np.floor(points / TUFT).astype(np.int64)
        _, tuft, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        points = points[np.argsort(tuft.reshape(-1), kind="stable")]
        ends = np.concatenate([[0], np.cumsum(counts)])
        least = np.minimum.reduceat(points, ends[:-1])
        centres = (least + np.maximum.reduceat(points, ends[:-1])) / 2.0
        away = np.linalg.norm(points - np.repeat(centres, counts, axis=0), axis=1)
        return Tufts(points, ends, centres, np.maximum.reduceat(away, ends[:-1]))

    @staticmethod
    def joined(parts: Sequence[tuple["Tufts", Pose]]) -> "Tufts":
        """Put bundles of rigid parts together, at least one; each pose takes its part there."""
        begins = np.cumsum([0, *(len(part.points) for part, _ in parts)])
        ends = [part.ends[:-1] + begin for (part, _), begin in zip(parts, begins, strict=False)]
        return Tufts(
            np.concatenate([points_in(pose, part.points) for part, pose in parts]),
            np.concatenate([*ends, begins[-1:]]),
            np.concatenate([points_in(pose, part.centres) for part, pose in parts]),
            np.concatenate([part.radii for part, _ in parts]),
        )


def first_touches(
    grid: DistanceGrid,
    tufts: Tufts,
    places: FloatArray,
    turns: FloatArray,
    way: FloatArray,
    start: float,
    end: float,
) -> tuple[Int64Array, FloatArray]:
    """Slide an object against a surface, once from each place, and tell what it touches first.

    Args:
        grid: the object.
        tufts: the surface, in any frame.
        places: shape (n, 3) [m], of the object in that frame.
        turns: shape (n, 3, 3), likewise.
        way: shape (3,), of unit length; the object comes from far along it, and moves against it.
        start: how far along the way it begins, seen from its place [m].
        end: where it stops [m].

    Returns:
        The point that is touched first, shape (n,), -1 where none is, or where the object has no
        room to begin with; and how far along the way the object then is, shape (n,) [m].
    """
    hits, shifts = np.full(len(places), -1, np.int64), np.full(len(places), np.nan)
    # a ball holds all that the object sweeps from any place; what it misses is left out
    middle = places.mean(axis=0)
    wide = grid.radius + np.linalg.norm(places - middle, axis=1).max()
    offsets = tufts.centres - middle
    along = (offsets @ way).clip(end, start)
    away = np.linalg.norm(offsets - along[:, None] * way, axis=1)
    near = np.flatnonzero(away <= wide + tufts.radii)
    if not len(near):
        return hits, shifts
    _slide(
        tufts.points,
        tufts.ends,
        tufts.centres,
        tufts.radii,
        near,
        np.ascontiguousarray(places),
        np.ascontiguousarray(turns),
        np.ascontiguousarray(way),
        start,
        end,
        grid.low,
        grid.high,
        grid.corner,
        grid.cell,
        grid.nodes,
        hits,
        shifts,
    )
    return hits, shifts


@kernel
def _slide(
    points: FloatArray,
    ends: Int64Array,
    centres: FloatArray,
    radii: FloatArray,
    near: NDArray[np.intp],
    places: FloatArray,
    turns: FloatArray,
    way: FloatArray,
    start: float,
    end: float,
    low: FloatArray,
    high: FloatArray,
    corner: FloatArray,
    cell: float,
    nodes: NDArray[np.float32],
    hits: Int64Array,
    shifts: FloatArray,
) -> None:
    bounds, step = np.empty(len(near)), np.empty(3)
    for i in range(len(places)):
        place, turn = places[i], turns[i]
        for axis in range(3):  # the way in the object's frame, where the surface moves
            step[axis] = turn[0, axis] * way[0] + turn[1, axis] * way[1] + turn[2, axis] * way[2]
        for k in range(len(near)):  # as late as its ball is touched, so late is the tuft
            tuft = near[k]
            bounds[k] = _traced(
                centres[tuft], float(radii[tuft]), place, turn, step, start, end,
                low, high, corner, cell, nodes,
            )  # fmt: skip
        best, hit = end, -1
        while best < start:
            k = int(np.argmax(bounds))
            tuft, bound = near[k], bounds[k]
            if bound <= best:
                break  # all others are touched later
            bounds[k] = -np.inf
            for row in range(ends[tuft], ends[tuft + 1]):
                shift = _traced(
                    points[row], 0.0, place, turn, step, bound, best,
                    low, high, corner, cell, nodes,
                )  # fmt: skip
                if shift > best:
                    best, hit = shift, row
        if hit >= 0 and best < start:
            hits[i], shifts[i] = hit, best


@kernel
def _traced(
    point: FloatArray,
    radius: float,
    place: FloatArray,
    turn: FloatArray,
    step: FloatArray,
    start: float,
    end: float,
    low: FloatArray,
    high: FloatArray,
    corner: FloatArray,
    cell: float,
    nodes: NDArray[np.float32],
) -> float:
    """Trace a ball until it touches; it moves by each distance, for nothing is nearer than that."""
    x, y, z = point[0] - place[0], point[1] - place[1], point[2] - place[2]
    a = turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z
    b = turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z
    c = turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z
    shift = start
    while shift > end:
        p, q, r = a - shift * step[0], b - shift * step[1], c - shift * step[2]
        gap = _distance(p, q, r, low, high, corner, cell, nodes) - radius
        if gap < TOUCHING:
            return shift
        shift -= gap
    return -np.inf


@kernel
def _distances(
    points: FloatArray,
    low: FloatArray,
    high: FloatArray,
    corner: FloatArray,
    cell: float,
    nodes: NDArray[np.float32],
    found: FloatArray,
) -> None:
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        found[i] = _distance(x, y, z, low, high, corner, cell, nodes)


@kernel
def _distance(
    x: float,
    y: float,
    z: float,
    low: FloatArray,
    high: FloatArray,
    corner: FloatArray,
    cell: float,
    nodes: NDArray[np.float32],
) -> float:
    """Interpolate between the eight nodes around a place [m]."""
    a, b, c = (x - corner[0]) / cell, (y - corner[1]) / cell, (z - corner[2]) / cell
    inside = a >= 0.0 and b >= 0.0 and c >= 0.0
    if not (
        inside and a < nodes.shape[0] - 1 and b < nodes.shape[1] - 1 and c < nodes.shape[2] - 1
    ):
        p = max(low[0] - x, x - high[0], 0.0)
        q = max(low[1] - y, y - high[1], 0.0)
        r = max(low[2] - z, z - high[2], 0.0)
        return float(np.sqrt(p * p + q * q + r * r))
    i, j, k = int(a), int(b), int(c)
    u, v, w = a - i, b - j, c - k
    back = (nodes[i, j, k] * (1.0 - w) + nodes[i, j, k + 1] * w) * (1.0 - v) + (
        nodes[i, j + 1, k] * (1.0 - w) + nodes[i, j + 1, k + 1] * w
    ) * v
    front = (nodes[i + 1, j, k] * (1.0 - w) + nodes[i + 1, j, k + 1] * w) * (1.0 - v) + (
        nodes[i + 1, j + 1, k] * (1.0 - w) + nodes[i + 1, j + 1, k + 1] * w
    ) * v
    return float(back * (1.0 - u) + front * u)
