"""Probes that press on the skin of a hand that touches an object: touches at several places."""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial import KDTree

from contactfusion.arrays import FloatArray
from contactfusion.frames import points_in, vectors_in
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectModel
from contactfusion_lab.scenes.clutter import points_of

RADIUS = 0.008
"""Of the tip of a probe, about that of a human's [m]."""
GAP = 0.002
"""Distance from which a probe comes [m]."""
APART = 0.04
"""Least distance of a place from every other [m]."""
COVERED = 0.005
"""Greatest distance of a place on the skin from the centre of a taxel [m]."""
CLEAR = 0.005
"""Least distance of a tip from other bodies [m]."""


def places(
    robot: RobotModel,
    hand: set[str],
    joints: FloatArray,
    touched: FloatArray,
    bodies: Sequence[ObjectModel],
    rng: np.random.Generator,
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Places for probes on the skin of a hand, and the outward normals there, shape (3,) each.

    A hand without any skin is pressed anywhere. There may be fewer than are wanted.

    Args:
        robot: the hand is its.
        hand: the links that may be touched.
        joints: shape (n,), positions [rad, m].
        touched: shape (k, 3), where the hand is touched already [m].
        bodies: what probes keep clear of.
        rng: draws the places.
    """
    poses = robot.poses_at(joints)
    own = [(robot.parts[name], poses[name]) for name in sorted(hand & robot.parts.keys())]
    points = np.concatenate([points_in(pose, part.points) for part, pose in own])
    normals = np.concatenate([vectors_in(pose, part.normals) for part, pose in own])
    tips = points + (RADIUS + GAP) * normals
    solid = KDTree(np.concatenate([*points_of(robot, poses, robot.link_names)]))
    free = solid.query(tips)[0] >= RADIUS
    for body in bodies:
        free &= body.distances(body.config.pose.pose(), tips) >= RADIUS + CLEAR
    skins = [
        points_in(
            poses[robot.link_of(patch.frame)] @ robot.pose_on_link(patch.frame), patch.centres()
        )
        for patch in robot.config.patches.values()
    ]
    if skins:
        free &= KDTree(np.concatenate(skins)).query(points)[0] <= COVERED
    for row in rng.permutation(np.flatnonzero(free)):
        if np.linalg.norm(touched - points[row], axis=1).min(initial=np.inf) >= APART:
            touched = np.concatenate([touched, points[row : row + 1]])
            yield points[row], normals[row]
