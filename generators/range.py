"""Contacts from a range camera: objects that move near the robot (F §V-D)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
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
from contactfusion.thinning import voxel_downsample
from contactfusion.units import LengthScale, Memory, Reach, Spacing, Spread

FAINTEST = 0.01
"""The least likelihood of a position (method §5)."""
WIDER = 0.1
"""Additional margin of earlier clouds around the links [m]: what enters the view has not moved."""
NEIGHBOURS = 20
"""The greatest number of neighbours that define the plane at a point."""
SHOWN = 0.1
"""The share of a motion's mean square displacement that must lie along the normals of the surface
for the motion to be observable."""
AT_REST = 0.1
"""The least displacement of the links, as a share of `min_motion`, that has a direction."""
LEAST = 10
"""The least number of points whose shape can be compared."""


class RangeConfig(GeneratorConfig):
    """The options of `range`."""

    links: tuple[str, ...] = ()
    """The links that may touch, such as those of the hand; empty: the whole robot."""
    evidence: Literal["motion", "proximity"] = "motion"
    """`motion`: objects that move, as Regular. `proximity`: everything near, as Support: for
    objects that cannot move."""
    scale: Annotated[Spread, LengthScale()] = Field(default=0.01, gt=0)
    """λ: the likelihood is a half at this distance from the robot [m] (F Eq 5)."""
    around: Reach = Field(default=0.15, gt=0)
    """Margin of the region around the links [m]."""
    resolution: Spacing = Field(default=0.004, gt=0)
    """Edge of the cubes in which points are thinned to one [m]."""
    margin: Spread = Field(default=0.015, ge=0)
    """Distance from the robot within which points are its own [m]; at least the error of the camera
    and its pose."""
    gap: Spread = Field(default=0.02, gt=0)
    """The least gap between objects [m]: points that shorter steps join are of one object."""
    min_points: int = Field(default=20, ge=3)
    """The least number of points of an object."""
    min_motion: Spread = Field(default=0.006, gt=0)
    """The least displacement of an object's points, root mean square, when it has moved [m]."""
    memory: Memory = Field(default=0.3, gt=0)
    """The greatest age of the cloud with which an object is compared [s]."""
    noise: Spread = Field(default=0.005, ge=0)
    """Standard deviation of a point, by the camera and by its pose [m]."""


@dataclass(frozen=True, eq=False)
class Sight:
    """Points of objects at one stamp.

    Attributes:
        stamp: [s].
        points: shape (n, 3) [m], in the grid's frame.
        hand: shape (3,) [m], the centroid of the links then.
    """

    stamp: float
    points: FloatArray
    hand: FloatArray


class RangeGenerator(Generator[RangeConfig]):
    """Points of objects near the robot, likely by their distance to its surface (F Eq 5).

    With `evidence: motion` an object counts while it moves, and only on the side to which the hand
    moves.
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
        robot.spheres  # noqa: B018 made now and kept, so that no step waits for it
        for link in robot.known_links(self.config.links):
            if link in robot.parts:
                robot.parts[link].grid  # noqa: B018 likewise

    def reset(self) -> None:
        """Drop the earlier clouds."""
        self._sights: list[Sight] = []

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The points of objects that are being touched.

        Raises:
            ConfigurationError: there is no robot to be near to, or its links have no surface.
            RobotError: no link of a name that is configured.
        """
        assert isinstance(reading, PointCloud)
        robot = state.posed_robot(self.name)
        hand = robot.surface_of(self.config.links).points
        if not len(hand):
            raise ConfigurationError(f"the links of '{self.name}' have no surface to be near to")
        points = self._around(reading, state, robot, hand)
        counted = _within(points, hand, self.config.around)
        if self.config.evidence == "motion":
            counted &= self._moving(Sight(reading.stamp, points, hand.mean(axis=0)), counted)
        return (self._near(reading, points[counted], state, robot),)

    def _around(
        self, reading: PointCloud, state: State, robot: PosedRobot, hand: FloatArray
    ) -> FloatArray:
        """Points around the links, thinned, without the robot's own, shape (n, 3) [m]."""
        pose = state.frames.pose(state.grid.frame, of=reading.frame)
        points = points_in(pose, reading.points[np.isfinite(reading.points).all(axis=1)])
        points = points[_within(points, hand, self.config.around + WIDER)]
        points = points[voxel_downsample(points, Grid(state.grid.frame, self.config.resolution))]
        return self_filtered(points, robot, self.config.margin)

    def _moving(self, sight: Sight, near: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which points are of an object that moves, forward of the hand, shape (n,).

        Only points that are near now are compared: all of them were in view before.
        """
        counted = np.zeros(len(sight.points), np.bool_)
        self._sights = [
            old for old in self._sights if 0.0 < sight.stamp - old.stamp <= self.config.memory
        ]
        if self._sights:
            before = self._sights[0]
            objects = clustered(sight.points, self.config.gap, self.config.min_points)
            for rows in objects:
                shift = moved_by(sight.points[rows[near[rows]]], before.points, self.config.gap)
                counted[rows] = shift >= self.config.min_motion
            way = sight.hand - before.hand
            counted &= (sight.points - sight.hand) @ way > 0.0
            if np.linalg.norm(way) < AT_REST * self.config.min_motion:
                counted[:] = False  # its direction is noise
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
        chosen, distances = points[near], distances[near]
        return self.cloud(
            reading,
            chosen,
            scale**2 / (scale**2 + distances**2),
            frame=state.grid.frame,
            # the contact is no further than the robot, but points near it are hidden or removed: in
            # a ball of that radius, an axis has a mean square of d²/5
            spreads=np.hypot(self.config.noise, distances / np.sqrt(5.0)),
        )


def _within(points: FloatArray, hand: FloatArray, reach: float) -> NDArray[np.bool_]:
    """Which points lie in the bounding box of the hand, widened by `reach` [m], shape (n,)."""
    low, high = hand.min(axis=0) - reach, hand.max(axis=0) + reach
    inside: NDArray[np.bool_] = ((points >= low) & (points <= high)).all(axis=1)
    return inside


def self_filtered(points: FloatArray, robot: PosedRobot, margin: float) -> FloatArray:
    """Points further than `margin` [m] from the robot's spheres; all have shape (n, 3) [m]."""
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
        return []  # Open3D would warn
    labels = np.asarray(_cloud(points).cluster_dbscan(gap, min_points))
    return [np.flatnonzero(labels == label) for label in range(labels.max(initial=-1) + 1)]


def moved_by(points: FloatArray, before: FloatArray, reach: float) -> float:
    """The displacement of an object since an earlier cloud, by point-to-plane ICP.

    Points of a surface lie on the camera's raster, whatever the object does: point-to-point ICP
    would hold them there. But a plane may slide in itself, and a cylinder rotate about its axis,
    unobserved, and there ICP follows noise: such motions do not count.

    Args:
        points: shape (n, 3) [m], of the object now.
        before: shape (m, 3) [m], of all objects then.
        reach: the greatest displacement of a point [m].

    Returns:
        The root mean square displacement of its points [m]; 0 where nothing was near it then.
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
    """The root mean square displacement of points [m], without its unobservable part.

    Args:
        points: shape (n, 3) [m].
        normals: shape (n, 3), of the surface there.
        motion: small.
    """
    from scipy.spatial.transform import Rotation

    centre = points.mean(axis=0)
    levers = points - centre
    size = np.sqrt(np.square(levers).sum(axis=1).mean())
    rotation = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    shift = motion[:3, :3] @ centre + motion[:3, 3] - centre
    # effect of rotation and shift, both as displacements [m], on the surface along its normals
    along = np.concatenate([np.cross(levers / size, normals), normals], axis=1)
    shown, directions = np.linalg.eigh(along.T @ along / len(points))
    seen = directions[:, shown >= SHOWN]
    rotation_part, shift = np.split(seen @ seen.T @ np.concatenate([size * rotation, shift]), 2)
    displacements = np.cross(rotation_part / size, levers) + shift
    return float(np.sqrt(np.square(displacements).sum(axis=1).mean()))


def _cloud(points: FloatArray) -> Any:
    open3d = loaded_open3d()
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[RangeConfig]]]:
    """The range generator."""
    return {"range": RangeGenerator}
