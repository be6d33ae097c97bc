"""Point clouds near a robot: its own points removed, objects told apart, their motion measured."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose
from contactfusion.robots.posed import PosedRobot
from contactfusion.robots.solids import loaded_open3d

NEIGHBOURS = 20
"""So many neighbours at most make up the plane at a point."""
SHOWN = 0.1
"""A motion is seen when it moves the surface along its normals by this part of the mean square of
the ways of its points."""
LEAST = 10
"""Fewer points have no shape to compare."""


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
    """Give the rows of each object: points that chains of steps up to `gap` [m] join."""
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
    """Give the root mean square of the ways of points [m], without what nobody can see of them.

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
