"""Where the robot would touch an object first, if the object is about where it is believed."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.generators.sliding import (
    DistanceGrid,
    Int64Array,
    Tufts,
    first_touches,
    shared_grid,
)
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import JointState, ObjectPose, Reading
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import BelievedObjects, ObjectConfig
from contactfusion.robots.posed import PosedRobot
from contactfusion.state import State
from contactfusion.units import Spread

REACH = 4.0
"""An object is off by so many standard deviations at most."""
ROOM = 0.12
"""An object begins to slide at least so far from where it is believed [m]: beyond the surface, also
where it is believed to be inside the robot."""


class FirstTouchConfig(GeneratorConfig):
    """The options of `first_touch`."""

    objects: dict[str, ObjectConfig] = Field(min_length=1)
    """What stands around, by name, where it is believed to be; `sigma` and `sigma_yaw` of each say
    how far off it may be."""
    links: tuple[str, ...] = ()
    """The links that may touch, such as those of the hand; none: the whole robot."""
    particles: int = Field(default=100, ge=1, le=10_000)
    """In so many places each object is tried."""
    likelihood: float = Field(default=1.0, ge=0, le=1)
    """Of a contact with one of the objects, anywhere: what the cloud sums to."""
    noise: Spread = Field(default=0.003, ge=0)
    """Standard deviation of where the robot believes its surface to be [m]."""
    seed: int = Field(default=0, ge=0)
    """Of the places that are tried; they are drawn once."""


class FirstTouchGenerator(Generator[FirstTouchConfig]):
    """Support, single contact: what objects touch first when they slide to the hand.

    An object is drawn in many places about the believed one: shifted by N(0, σ²) across the way
    from the surface's centroid to the object's middle, and turned about the vertical by
    N(0, σ_yaw²). Each slides along the way until it touches. The point p that it touches is a
    hypothesis, weighed by how probably the object is as far along the way as it then is:

        w(p) ∝ Σ N(s; 0, σ² + spread²), over the draws that touch p when shifted by s

    An `ObjectPose` moves an object. Equal input gives equal output: the draws are made once.
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
        self._turns = rng.standard_normal(config.particles)

    def prepare(self, robot: RobotModel) -> None:
        """Work out the distances of the objects, and bundle the surface."""
        self._tufts = {name: Tufts.of(part.points) for name, part in robot.parts.items()}
        self._grids = {name: shared_grid(one) for name, one in self.config.objects.items()}
        grid, tufts = next(iter(self._grids.values())), next(iter(self._tufts.values()))
        here, turn, up = tufts.points[:1], np.eye(3)[None], np.array([0.0, 0.0, 1.0])
        first_touches(grid, tufts, here, turn, up, ROOM, 0.0)  # no reading waits for the compiler

    def reset(self) -> None:
        """Believe again what is configured."""
        self._objects.reset()

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Give the points that are touched first.

        Raises:
            ConfigurationError: there is no robot.
            RobotError: an object of that name is not configured, or no link of a name.
        """
        if isinstance(reading, ObjectPose):
            self._objects.tell(reading, self.name)
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
                self.config.likelihood * weights.clip(max=1.0),  # rounding may go beyond
                frame=state.grid.frame,
                spreads=np.full(len(points), spread),
                single=True,
            ),
        )

    def _hand(self, robot: PosedRobot) -> Tufts | None:
        """Give the surface of the links that may touch; None where they have none."""
        wanted = robot.model.known_links(self.config.links)
        parts = [(part, robot.poses[name]) for name, part in self._tufts.items() if name in wanted]
        return Tufts.joined(parts) if parts else None

    def _touched(
        self, name: str, pose: Pose, hand: Tufts, spread: float
    ) -> tuple[Int64Array, FloatArray]:
        """Slide one object from all its places.

        Args:
            name: of the object.
            pose: where it is believed to be.
            hand: the surface, in the same frame, whose z is vertical.
            spread: standard deviation of a point of the surface [m].

        Returns:
            The points that are touched, and the logarithm of each one's weight, both of shape (k,).
        """
        grid, config = self._grids[name], self._objects.models[name].config
        way = points_in(pose, grid.centre[None])[0] - hand.points.mean(axis=0)
        if np.allclose(way, 0.0):
            return np.empty(0, np.int64), np.empty(0)  # it may come from anywhere
        way /= np.linalg.norm(way)
        shifts = config.sigma * (self._shifts - np.outer(self._shifts @ way, way))
        turns = _about_z(config.sigma_yaw * self._turns) @ pose[:3, :3]
        doubt = float(np.hypot(config.sigma, spread))
        room, reach = max(ROOM, REACH * doubt), REACH * doubt
        rows, along = first_touches(grid, hand, pose[:3, 3] + shifts, turns, way, room, -reach)
        hit = rows >= 0
        return rows[hit], -0.5 * np.square(along[hit] / doubt) - np.log(doubt)


def _about_z(angles: FloatArray) -> FloatArray:
    """Give rotations about z by angles of shape (n,) [rad], shape (n, 3, 3)."""
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0] = np.sin(angles)
    turns[:, 0, 1] = -turns[:, 1, 0]
    turns[:, 2, 2] = 1.0
    return turns


def _weights(scores: FloatArray) -> FloatArray:
    """Turn logarithms of shape (k,) into weights that sum to 1."""
    if not len(scores):
        return scores
    weights = np.exp(scores - scores.max())
    return np.asarray(weights / weights.sum())


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[FirstTouchConfig]]]:
    """Offer the first-touch generator."""
    return {"first_touch": FirstTouchGenerator}
