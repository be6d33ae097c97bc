"""Contacts from a range camera: what moves near the robot is being pushed (F §V-D)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.frames import points_in
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.generators.clouds import clustered, moved_by, without_robot
from contactfusion.grid import Grid
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import PointCloud, Reading
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.state import State
from contactfusion.thinning import first_in_voxels
from contactfusion.units import LengthScale, Memory, Reach, Spacing, Spread

FAINTEST = 0.01
"""Less likely places are dropped (method §5)."""
WIDER = 0.1
"""Earlier sights hold so much more around the links [m]: what comes into view has not moved."""


class RangeConfig(GeneratorConfig):
    """The options of `range`."""

    links: tuple[str, ...] = ()
    """The links that may touch, such as those of the hand; none: the whole robot."""
    evidence: Literal["motion", "proximity"] = "motion"
    """`motion`: objects that move count, as Regular. `proximity`: all that is near counts, as
    Support: for objects that cannot move."""
    scale: Annotated[Spread, LengthScale()] = Field(default=0.01, gt=0)
    """λ: the likelihood is a half at this distance from the robot [m] (F Eq 5)."""
    around: Reach = Field(default=0.15, gt=0)
    """How far around the links to look for objects [m]."""
    resolution: Spacing = Field(default=0.004, gt=0)
    """Points are thinned to one in a cube of this side [m]."""
    margin: Spread = Field(default=0.015, ge=0)
    """Points so near the robot are its own [m]: as much as the camera and its place may err."""
    gap: Spread = Field(default=0.02, gt=0)
    """Points that no chain of so short steps joins are of different objects [m]."""
    min_points: int = Field(default=20, ge=3)
    """Of an object."""
    min_motion: Spread = Field(default=0.006, gt=0)
    """An object has moved when its points have by so much, root mean square [m]."""
    memory: Memory = Field(default=0.3, gt=0)
    """An object is compared with how it lay so long ago at most [s]."""
    noise: Spread = Field(default=0.005, ge=0)
    """Standard deviation of a point, by the camera and by its place [m]."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What was seen of the objects at one stamp.

    Attributes:
        stamp: [s].
        points: shape (n, 3) [m], in the grid's frame.
        hand: shape (3,) [m], the middle of the links then.
    """

    stamp: float
    points: FloatArray
    hand: FloatArray


class RangeGenerator(Generator[RangeConfig]):
    """Points of objects near the robot, likely by their distance to its surface (F Eq 5).

    With `evidence: motion` an object counts while it moves, and only on the side that the hand
    moves to.
    """

    Config = RangeConfig
    readings = (PointCloud,)
    needs_body = True

    def __init__(self, name: str, config: RangeConfig) -> None:
        super().__init__(name, config)
        moving = config.evidence == "motion"
        kind = HypothesisKind.REGULAR if moving else HypothesisKind.SUPPORT
        self.outputs = {"": kind}
        self.reset()

    def prepare(self, robot: RobotModel) -> None:
        """Fit the robot's spheres and the grids of its links, which takes seconds."""
        robot.spheres  # noqa: B018 it is kept
        for link in robot.known_links(self.config.links):
            if link in robot.parts:
                robot.parts[link].grid  # noqa: B018 it is kept

    def reset(self) -> None:
        """Forget where the objects lay."""
        self._sights: list[Sight] = []

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Give the points of objects that are being touched.

        Raises:
            ConfigurationError: there is no robot to be near to.
            RobotError: no link of a name that is configured.
        """
        assert isinstance(reading, PointCloud)
        robot = state.posed_robot(self.name)
        hand = robot.surface_of(self.config.links).points
        points = self._around(reading, state, robot, hand)
        counted = _within(points, hand, self.config.around)
        if self.config.evidence == "motion":
            counted &= self._moving(Sight(reading.stamp, points, hand.mean(axis=0)), counted)
        return (self._near(reading, points[counted], state, robot),)

    def _around(
        self, reading: PointCloud, state: State, robot: PosedRobot, hand: FloatArray
    ) -> FloatArray:
        """Give the points around the links, thinned, without the robot's own, shape (n, 3) [m]."""
        pose = state.frames.pose(state.grid.frame, of=reading.frame)
        points = points_in(pose, reading.points[np.isfinite(reading.points).all(axis=1)])
        points = points[_within(points, hand, self.config.around + WIDER)]
        points = points[first_in_voxels(points, Grid(state.grid.frame, self.config.resolution))]
        return without_robot(points, robot, self.config.margin)

    def _moving(self, sight: Sight, near: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Tell which points are of an object that moves, ahead of the hand, shape (n,).

        Only what is near now is compared: all of that was in view before.
        """
        counted = np.zeros(len(sight.points), np.bool_)
        self._sights = [
            old for old in self._sights if 0.0 < sight.stamp - old.stamp <= self.config.memory
        ]
        if self._sights:
            before = self._sights[0]
            objects = clustered(sight.points, self.config.gap, self.config.min_points)
            for rows in objects:
                way = moved_by(sight.points[rows[near[rows]]], before.points, self.config.gap)
                counted[rows] = way >= self.config.min_motion
            ahead = (sight.points - sight.hand) @ (sight.hand - before.hand) > 0.0
            counted &= ahead
        self._sights.append(sight)
        return counted

    def _near(
        self, reading: Reading, points: FloatArray, state: State, robot: PosedRobot
    ) -> HypothesisCloud:
        """Give points by their distance to the links; p = λ²/(λ² + d²) (F Eq 5)."""
        scale = self.config.scale
        reach = scale * np.sqrt(1.0 / FAINTEST - 1.0)
        distances, _ = robot.surface_of(self.config.links).nearest(points, reach)
        near = distances < reach
        places, distances = points[near], distances[near]
        return self.cloud(
            reading,
            places,
            scale**2 / (scale**2 + distances**2),
            frame=state.grid.frame,
            # the contact is no further than the robot, but what was near it is hidden or removed:
            # in a ball of that radius, an axis has a mean square of d²/5
            spreads=np.hypot(self.config.noise, distances / np.sqrt(5.0)),
        )


def _within(points: FloatArray, hand: FloatArray, reach: float) -> NDArray[np.bool_]:
    """Tell which points lie in the box around the hand's, widened by `reach` [m], shape (n,)."""
    low, high = hand.min(axis=0) - reach, hand.max(axis=0) + reach
    inside: NDArray[np.bool_] = ((points >= low) & (points <= high)).all(axis=1)
    return inside


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[RangeConfig]]]:
    """Offer the range generator."""
    return {"range": RangeGenerator}
