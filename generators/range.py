"""Contacts from a range camera: what moves near the robot is being pushed (F §V-D)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.grid import Grid
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import PointCloud, Reading
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.robots.solids import loaded_open3d
from contactfusion.state import State
from contactfusion.thinning import first_in_voxels
from contactfusion.units import LengthScale, Memory, Reach, Spacing, Spread

FAINTEST = 0.01
"""Less likely places are dropped (method §5)."""
WIDER = 0.1
"""Earlier sights hold so much more around the links [m]: what comes into view has not moved."""
NEIGHBOURS = 20
"""So many neighbours at most make up the plane at a point."""
SHOWN = 0.1
"""A motion is seen when it moves the surface along its normals by this part of the mean square of
the ways of its points."""
LEAST = 10
"""Fewer points have no shape to compare."""


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
        """The points of objects that are being touched.

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
        """The points around the links, thinned, without the robot's own, shape (n, 3) [m]."""
        pose = state.frames.pose(state.grid.frame, of=reading.frame)
        points = points_in(pose, reading.points[np.isfinite(reading.points).all(axis=1)])
        points = points[_within(points, hand, self.config.around + WIDER)]
        points = points[first_in_voxels(points, Grid(state.grid.frame, self.config.resolution))]
        return without_robot(points, robot, self.config.margin)

    def _moving(self, sight: Sight, near: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which points are of an object that moves, ahead of the hand, shape (n,).

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
        """Points by their distance to the links; p = λ²/(λ² + d²) (F Eq 5)."""
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
    """Which points lie in the box around the hand's, widened by `reach` [m], shape (n,)."""
    low, high = hand.min(axis=0) - reach, hand.max(axis=0) + reach
    inside: NDArray[np.bool_] = ((points >= low) & (points <= high)).all(axis=1)
    return inside


def without_robot(points: FloatArray, robot: PosedRobot, margin: float) -> FloatArray:
    """Leave out what lies within `margin` [m] of the robot's spheres; points have shape (n, 3)."""
    from scipy.spatial import KDTree

    if not len(points):
        return points
    centres, radii = robot.spheres_of(())
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    reach = radii[:, None]
    near = ((centres >= low - reach) & (centres <= high + reach)).all(axis=1)
    own = np.zeros(len(points), np.bool_)
    for rows in KDTree(points).query_ball_point(centres[near], radii[near] + margin):
        own[rows] = True
    return points[~own]


def clustered(points: FloatArray, gap: float, min_points: int) -> list[NDArray[np.intp]]:
    """The rows of each object: points that chains of steps up to `gap` [m] join."""
    if not len(points):
        return []  # of which Open3D would warn
    labels = np.asarray(_cloud(points).cluster_dbscan(gap, min_points))
    return [np.flatnonzero(labels == label) for label in range(labels.max(initial=-1) + 1)]


def moved_by(points: FloatArray, before: FloatArray, reach: float) -> float:
    """Measure how far an object has moved since a cloud was seen, by point-to-plane ICP.

    Points of a surface lie on the camera's raster, whatever the object does: point to point would
    hold them there. But a plane may slide in itself, and a cylinder turn about its axis, without
    that anything is seen of it, and there ICP follows noise: such motions do not count.

    Args:
        points: shape (n, 3) [m], of the object now.
        before: shape (m, 3) [m], of all objects then.
        reach: the furthest that a point is believed to have moved [m].

    Returns:
        The root mean square of the ways of its points [m]; 0 where nothing was near it then.
    """
    open3d = loaded_open3d()
    if len(points) < LEAST or len(before) < LEAST:
        return 0.0
    registration, there = open3d.pipelines.registration, _cloud(before)
    there.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(reach, NEIGHBOURS))
    to_plane = registration.TransformationEstimationPointToPlane()
    found = registration.registration_icp(_cloud(points), there, reach, np.eye(4), to_plane)
    pairs = np.asarray(found.correspondence_set)
    if len(pairs) < LEAST:
        return 0.0
    now, then = pairs.T
    back = np.asarray(found.transformation)
    return _seen_motion(points[now], np.asarray(there.normals)[then], back)


def _seen_motion(points: FloatArray, normals: FloatArray, motion: Pose) -> float:
    """The root mean square of the ways of points [m], without what nobody can see of them.

    Args:
        points: shape (n, 3) [m].
        normals: shape (n, 3), of the surface there.
        motion: small.
    """
    from scipy.spatial.transform import Rotation

    centre = points.mean(axis=0)
    levers = points - centre
    size = np.sqrt(np.square(levers).sum(axis=1).mean())
    turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    shift = motion[:3, :3] @ centre + motion[:3, 3] - centre
    # what turns and shifts, both as ways [m], do to the surface along its normals
    along = np.concatenate([np.cross(levers / size, normals), normals], axis=1)
    shown, directions = np.linalg.eigh(along.T @ along / len(points))
    seen = directions[:, shown >= SHOWN]
    turn_size, shift = np.split(seen @ seen.T @ np.concatenate([size * turn, shift]), 2)
    ways = np.cross(turn_size / size, levers) + shift
    return float(np.sqrt(np.square(ways).sum(axis=1).mean()))


def _cloud(points: FloatArray) -> Any:
    open3d = loaded_open3d()
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[RangeConfig]]]:
    """Offer the range generator."""
    return {"range": RangeGenerator}
