"""First contacts of objects near their believed poses with the robot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.jit import kernel
from contactfusion.readings import JointState, ObjectPose, Reading
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import BelievedObjects, ObjectConfig, ObjectModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.state import State
from contactfusion.units import Spread

REACH = 4.0
"""The greatest offset of an object, in standard deviations."""
ROOM = 0.12
"""The least distance from the believed pose at which an object begins to slide [m]: clear of the
surface, also where it is believed to be inside the robot."""
CELL = 0.004
"""The distance between neighbouring nodes of the grid [m]; larger objects have a coarser grid."""
NODES = 500_000
"""The greatest number of nodes, about."""
PADDING = 0.03
"""The margin of the grid around the object [m]; further off, the distance to its box serves."""
TUFT = 0.02
"""Edge of the cubes by which points of a surface are bundled [m]; most bundles are never opened."""
TOUCHING = 3e-4
"""The greatest gap of a contact [m]."""

Int64Array = NDArray[np.int64]


class FirstTouchConfig(GeneratorConfig):
    """The options of `first_touch`."""

    objects: dict[str, ObjectConfig] = Field(min_length=1)
    """The objects, by name, with their believed poses; `sigma` and `sigma_yaw` of each are the
    uncertainty of its pose."""
    links: tuple[str, ...] = ()
    """The links that may touch, such as those of the hand; empty: the whole robot."""
    particles: int = Field(default=100, ge=1, le=10_000)
    """Number of poses that are drawn for each object."""
    likelihood: float = Field(default=1.0, ge=0, le=1)
    """Of a contact with any of the objects: the sum over the cloud."""
    noise: Spread = Field(default=0.003, ge=0)
    """Standard deviation of the position of the robot's surface [m]."""
    seed: int = Field(default=0, ge=0)
    """Of the poses, which are drawn once."""


class FirstTouchGenerator(Generator[FirstTouchConfig]):
    """Support, single contact: points that objects touch first when they slide to the hand.

    Poses of an object are drawn about the believed one: shifted by N(0, σ²) across the direction d
    from the surface's centroid to the object's centre, and yawed by N(0, σ_yaw²). Each slides
    along d until it touches. The point p of contact is a hypothesis, weighed by the probability
    of the object's offset s along d:

        w(p) ∝ Σ N(s; 0, σ² + spread²), over the draws that touch p at offset s

    An `ObjectPose` updates an object's pose. Equal input gives equal output: the draws are made
    once.
    """

    Config = FirstTouchConfig
    readings = (JointState, ObjectPose)
    needs_body = True
    outputs = {"": HypothesisKind.SUPPORT}

    def __init__(self, name: str, config: FirstTouchConfig) -> None:
        super().__init__(name, config)
        self._objects = BelievedObjects(config.objects)
        self._grids: dict[str, DistanceGrid] = {}
        self._tufts: dict[str, Tufts] = {}
        rng = np.random.default_rng(config.seed)
        self._shifts = rng.standard_normal((config.particles, 3))
        self._yaws = rng.standard_normal(config.particles)

    def prepare(self, robot: RobotModel) -> None:
        """Compute the distance grids of the objects, and bundle the surface."""
        self._tufts = {name: Tufts.of(part.points) for name, part in robot.parts.items()}
        self._grids = {name: shared_grid(model) for name, model in self.config.objects.items()}
        grid, tufts = next(iter(self._grids.values())), next(iter(self._tufts.values()))
        here, rotation, up = tufts.points[:1], np.eye(3)[None], np.array([0.0, 0.0, 1.0])
        first_touches(
            grid, tufts, here, rotation, up, ROOM, 0.0
        )  # compiled before the first reading

    def reset(self) -> None:
        """Return to the configured poses."""
        self._objects.reset()

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The points that objects touch first.

        Raises:
            ConfigurationError: there is no robot.
            RobotError: a reading names an object, or `links` a link, that does not exist.
        """
        if isinstance(reading, ObjectPose):
            self._objects.update(reading, self.name)
            return ()
        robot = state.posed_robot(self.name)
        if not self._tufts:
            self.prepare(robot.model)
        hand = self._hand(robot)
        spread = float(np.hypot(self.config.noise, robot.model.config.spacing))
        rows, scores = [np.empty(0, np.int64)], [np.empty(0)]
        if hand is not None:
            for name, there in self._objects.poses(state.frames, state.grid.frame).items():
                touched, score = self._touched(name, there, hand, spread)
                rows.append(touched)
                scores.append(score)
        points, own = np.unique(np.concatenate(rows), return_inverse=True)
        weights = np.bincount(own, _weights(np.concatenate(scores)), len(points))
        return (
            self.cloud(
                reading,
                hand.points[points] if hand is not None else np.empty((0, 3)),
                self.config.likelihood * weights.clip(max=1.0),  # rounding may exceed 1
                frame=state.grid.frame,
                spreads=np.full(len(points), spread),
                single=True,
            ),
        )

    def _hand(self, robot: PosedRobot) -> "Tufts | None":
        """The surface of the links that may touch; None where they have none."""
        wanted = robot.model.known_links(self.config.links)
        parts = [(part, robot.poses[name]) for name, part in self._tufts.items() if name in wanted]
        return Tufts.joined(parts) if parts else None

    def _touched(
        self, name: str, pose: Pose, hand: "Tufts", spread: float
    ) -> tuple[Int64Array, FloatArray]:
        """Slide one object from all its poses.

        Args:
            name: of the object.
            pose: as believed.
            hand: the surface, in the same frame, whose z is vertical.
            spread: standard deviation of a point of the surface [m].

        Returns:
            The points that are touched, and the logarithms of their weights, both of shape (k,).
        """
        grid, config = self._grids[name], self._objects.models[name].config
        direction = points_in(pose, grid.centre[None])[0] - hand.points.mean(axis=0)
        if np.allclose(direction, 0.0):
            return np.empty(0, np.int64), np.empty(0)  # the direction of approach is unknown
        direction /= np.linalg.norm(direction)
        shifts = config.sigma * (self._shifts - np.outer(self._shifts @ direction, direction))
        rotations = _about_z(config.sigma_yaw * self._yaws) @ pose[:3, :3]
        doubt = float(np.hypot(config.sigma, spread))
        room, reach = max(ROOM, REACH * doubt), REACH * doubt
        rows, along = first_touches(
            grid, hand, pose[:3, 3] + shifts, rotations, direction, room, -reach
        )
        hit = rows >= 0
        return rows[hit], -0.5 * np.square(along[hit] / doubt) - np.log(doubt)


def _about_z(angles: FloatArray) -> FloatArray:
    """Rotations about z by angles of shape (n,) [rad], shape (n, 3, 3)."""
    rotations = np.zeros((len(angles), 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = np.cos(angles)
    rotations[:, 1, 0] = np.sin(angles)
    rotations[:, 0, 1] = -rotations[:, 1, 0]
    rotations[:, 2, 2] = 1.0
    return rotations


def _weights(scores: FloatArray) -> FloatArray:
    """Weights that sum to 1 from logarithms, both of shape (k,)."""
    if not len(scores):
        return scores
    weights = np.exp(scores - scores.max())
    return np.asarray(weights / weights.sum())


@dataclass(frozen=True, eq=False)
class DistanceGrid:
    """The signed distance of an object at the nodes of a grid, in the object's frame.

    Attributes:
        low: shape (3,) [m], the least corner of the object.
        high: shape (3,) [m], its greatest corner.
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
        """The grid of an object."""
        vertices = np.concatenate([vertices for vertices, _ in model.solid.meshes])
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        extent = high - low + 2.0 * PADDING
        cell = max(CELL, float(np.cbrt(extent.prod() / NODES)))
        counts = np.ceil(extent / cell).astype(np.int64) + 1
        corner = low - PADDING
        axes = [start + cell * np.arange(n) for start, n in zip(corner, counts, strict=True)]
        positions = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        nodes = model.solid.signed_distances(positions).reshape(counts).astype(np.float32)
        radius = float(np.linalg.norm(vertices, axis=1).max())
        return DistanceGrid(low, high, corner, cell, nodes, radius)

    @property
    def centre(self) -> FloatArray:
        """The centre of the object's box, shape (3,) [m]."""
        return (self.low + self.high) / 2.0

    def distances(self, points: FloatArray) -> FloatArray:
        """Signed distances, shape (n,) [m]; outside the grid, they may be too small.

        Args:
            points: shape (n, 3) [m], in the object's frame.
        """
        found = np.empty(len(points))
        _distances(points, self.low, self.high, self.corner, self.cell, self.nodes, found)
        return found


def shared_grid(config: ObjectConfig) -> DistanceGrid:
    """The distance grid of an object, computed once in a process: that takes up to a second."""
    return _grid(config.model_dump_json())


@lru_cache(maxsize=16)
def _grid(config: str) -> DistanceGrid:
    return DistanceGrid.of(ObjectModel(ObjectConfig.model_validate_json(config)))


@dataclass(frozen=True, eq=False)
class Tufts:
    """Points of a surface in bundles, each in a ball.

    Attributes:
        points: shape (n, 3) [m], bundle by bundle.
        ends: shape (m + 1,), the first point of each bundle, then the number of points.
        centres: shape (m, 3) [m], of the balls.
        radii: shape (m,) [m].
    """

    points: FloatArray
    ends: Int64Array
    centres: FloatArray
    radii: FloatArray

    @staticmethod
    def of(points: FloatArray) -> "Tufts":
        """Bundles of points of shape (n, 3) [m], n at least 1."""
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
        """The bundles of rigid parts, at least one, each moved by its pose."""
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
    positions: FloatArray,
    rotations: FloatArray,
    direction: FloatArray,
    start: float,
    end: float,
) -> tuple[Int64Array, FloatArray]:
    """The points that an object touches first, sliding against a surface from each position.

    Args:
        grid: of the object.
        tufts: the surface, in any frame.
        positions: shape (n, 3) [m], of the object in that frame.
        rotations: shape (n, 3, 3), likewise.
        direction: shape (3,), of unit length; the object comes from far along it, and moves against
            it.
        start: offset along the direction at which it begins [m].
        end: offset at which it stops [m].

    Returns:
        Rows of the points, shape (n,), -1 where the object touches none, or overlaps the surface at
        the start; and offsets of the object along the direction at contact, shape (n,) [m].
    """
    hits, shifts = np.full(len(positions), -1, np.int64), np.full(len(positions), np.nan)
    # a ball bounds the object's sweep from all positions; bundles outside it are left out
    middle = positions.mean(axis=0)
    wide = grid.radius + np.linalg.norm(positions - middle, axis=1).max()
    offsets = tufts.centres - middle
    along = (offsets @ direction).clip(end, start)
    away = np.linalg.norm(offsets - along[:, None] * direction, axis=1)
    near = np.flatnonzero(away <= wide + tufts.radii)
    if not len(near):
        return hits, shifts
    _slide(
        tufts.points,
        tufts.ends,
        tufts.centres,
        tufts.radii,
        near,
        np.ascontiguousarray(positions),
        np.ascontiguousarray(rotations),
        np.ascontiguousarray(direction),
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
    positions: FloatArray,
    rotations: FloatArray,
    direction: FloatArray,
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
    for i in range(len(positions)):
        position, rotation = positions[i], rotations[i]
        for axis in range(3):  # the direction in the object's frame, in which the surface moves
            step[axis] = (
                rotation[0, axis] * direction[0]
                + rotation[1, axis] * direction[1]
                + rotation[2, axis] * direction[2]
            )
        for k in range(len(near)):  # no point of a tuft is touched before its ball
            tuft = near[k]
            bounds[k] = _traced(
                centres[tuft], float(radii[tuft]), position, rotation, step, start, end,
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
                    points[row], 0.0, position, rotation, step, bound, best,
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
    position: FloatArray,
    rotation: FloatArray,
    step: FloatArray,
    start: float,
    end: float,
    low: FloatArray,
    high: FloatArray,
    corner: FloatArray,
    cell: float,
    nodes: NDArray[np.float32],
) -> float:
    """The offset at which a ball touches, by sphere tracing: each step is the distance; or -inf."""
    x, y, z = point[0] - position[0], point[1] - position[1], point[2] - position[2]
    a = rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z
    b = rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z
    c = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z
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
    """The distance [m] at a position, interpolated between the eight nodes around it."""
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


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[FirstTouchConfig]]]:
    """The first-touch generator."""
    return {"first_touch": FirstTouchGenerator}
