"""The straight path of a hand towards an object, as joint positions along it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose
from contactfusion.robots.model import RobotModel

STEPS = 60
"""Iterations of the inverse kinematics at most; more never helped."""
NEAR = 1e-4
"""Tolerance of a pose that is reached, in position [m] and rotation [rad]."""
DAMPING = 0.03
"""Damping of least squares: keeps steps small near singularities."""
LONGEST = 0.3
"""Greatest step of the inverse kinematics, by joint [rad, m]."""
SPACING = 0.01
"""Distance between the poses of a path that are solved [m]."""


@dataclass(frozen=True, eq=False)
class Approach:
    """Joint positions along a straight path of the tool, and beyond its end.

    Attributes:
        distances: shape (k,), of the tool along the path [m], ascending; 0 at its end.
        joints: shape (k, n), joint positions there [rad, m].
    """

    distances: FloatArray
    joints: FloatArray

    def at(self, distance: float) -> FloatArray:
        """Joint positions at a distance [m] along the path, shape (n,) [rad, m]."""
        row = int(
            np.clip(np.searchsorted(self.distances, distance) - 1, 0, len(self.distances) - 2)
        )
        span = self.distances[row + 1] - self.distances[row]
        part = min(max((distance - self.distances[row]) / span, 0.0), 1.0)
        positions: FloatArray = (1.0 - part) * self.joints[row] + part * self.joints[row + 1]
        return positions


def straight(
    model: RobotModel, tool: str, end: Pose, start: FloatArray, before: float, beyond: float
) -> Approach | None:
    """A path of the tool along its z, without rotation.

    Args:
        model: the robot.
        tool: the link that moves; its z points forward.
        end: the pose of the tool at distance 0, in the root link's frame.
        start: shape (n,), initial guess of the joint positions [rad, m].
        before: length of the path before that pose [m].
        beyond: length of the path beyond it [m].

    Returns:
        None when the arm does not reach all of it.
    """
    moving = led_by(model, tool)
    positions = solved(model, tool, end, start, moving)
    if positions is None:
        return None
    count = int(np.ceil((before + beyond) / SPACING)) + 1
    distances = np.linspace(-before, beyond, count)
    joints = np.empty((count, len(start)))
    middle = int(np.searchsorted(distances, 0.0))
    for rows in (range(middle, count), range(middle - 1, -1, -1)):
        guess = positions
        for row in rows:
            pose = end.copy()
            pose[:3, 3] += distances[row] * end[:3, 2]
            found = solved(model, tool, pose, guess, moving)
            if found is None or np.abs(found - guess).max() > LONGEST:
                return None
            joints[row] = guess = found
    return Approach(distances, joints)


def led_by(model: RobotModel, tool: str) -> FloatArray:
    """Which joints move a link: shape (n,), 1 for those, 0 for the others."""
    leading = [tool in model.beyond(model.urdf.children[name]) for name in model.joint_names]
    still = [name in model.config.still for name in model.joint_names]
    led: FloatArray = np.array(leading, np.float64) * ~np.array(still)
    return led


def solved(
    model: RobotModel, tool: str, pose: Pose, start: FloatArray, moving: FloatArray
) -> FloatArray | None:
    """Joint positions at which a link has a pose: inverse kinematics by damped least squares.

    Args:
        model: the robot.
        tool: the link.
        pose: in the root link's frame.
        start: shape (n,), initial guess [rad, m].
        moving: shape (n,), 1 for the joints that may move.

    Returns:
        Positions within the joints' limits, shape (n,) [rad, m]; None when none were found.
    """
    positions, (low, high) = start.copy(), model.limits.T
    for _ in range(STEPS):
        there = model.poses_at(positions)[tool]
        rotation = Rotation.from_matrix(pose[:3, :3] @ there[:3, :3].T).as_rotvec()
        error = np.concatenate([pose[:3, 3] - there[:3, 3], rotation])
        if np.abs(error).max() < NEAR:
            return positions
        jacobian = model.jacobian(tool, positions) * moving
        squared = jacobian @ jacobian.T + DAMPING**2 * np.linalg.norm(error) * np.eye(6)
        step = jacobian.T @ np.linalg.solve(squared, error)
        step *= min(1.0, LONGEST / max(float(np.abs(step).max()), 1e-12))
        positions = np.clip(positions + step, low, high)
    return None


def tries(
    model: RobotModel, posture: FloatArray, moving: FloatArray, rng: np.random.Generator
) -> Iterator[FloatArray]:
    """Initial guesses of joint positions: the posture, then random ones; shape (n,) each."""
    yield posture
    low, high = np.clip(model.limits, -np.pi, np.pi).T
    while True:
        drawn = rng.uniform(low, high)
        yield np.where(moving > 0.0, 0.5 * (posture + drawn), posture)
