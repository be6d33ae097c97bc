"""The straight way of a hand towards an object, as joint positions along it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose
from contactfusion.robots.model import RobotModel

STEPS = 60
"""Of the search for joint positions; more never helped."""
NEAR = 1e-4
"""A pose is reached when its place [m] and its turn [rad] are so near."""
DAMPING = 0.03
"""Keeps steps small where the arm is stretched out."""
LONGEST = 0.3
"""Of a step of the search, by joint [rad, m]."""
SPACING = 0.01
"""The way is solved at places so far apart [m]."""


@dataclass(frozen=True, eq=False)
class Approach:
    """Joint positions along a straight way of the tool, and beyond its end.

    Attributes:
        ways: shape (k,), how far the tool has come [m], ascending.
        joints: shape (k, n), the positions there [rad, m].
    """

    ways: FloatArray
    joints: FloatArray

    def at(self, way: float) -> FloatArray:
        """The joint positions when the tool has come so far [m], shape (n,) [rad, m]."""
        row = int(np.clip(np.searchsorted(self.ways, way) - 1, 0, len(self.ways) - 2))
        span = self.ways[row + 1] - self.ways[row]
        part = min(max((way - self.ways[row]) / span, 0.0), 1.0)
        positions: FloatArray = (1.0 - part) * self.joints[row] + part * self.joints[row + 1]
        return positions


def straight(
    model: RobotModel, tool: str, end: Pose, start: FloatArray, before: float, beyond: float
) -> Approach | None:
    """Plan the way of a tool along its z, without a turn.

    Args:
        model: the robot.
        tool: the link that is led; its z points ahead.
        end: the pose of the tool at way 0, in the root link's frame.
        start: shape (n,), where the search for joint positions begins [rad, m].
        before: where the way begins, so far before the end [m].
        beyond: where it ends, so far behind the end [m].

    Returns:
        None when the arm does not reach all of it.
    """
    moving = led_by(model, tool)
    positions = solved(model, tool, end, start, moving)
    if positions is None:
        return None
    count = int(np.ceil((before + beyond) / SPACING)) + 1
    ways = np.linspace(-before, beyond, count)
    joints = np.empty((count, len(start)))
    middle = int(np.searchsorted(ways, 0.0))
    for rows in (range(middle, count), range(middle - 1, -1, -1)):
        warm = positions
        for row in rows:
            pose = end.copy()
            pose[:3, 3] += ways[row] * end[:3, 2]
            found = solved(model, tool, pose, warm, moving)
            if found is None or np.abs(found - warm).max() > LONGEST:
                return None
            joints[row] = warm = found
    return Approach(ways, joints)


def led_by(model: RobotModel, tool: str) -> FloatArray:
    """Which joints lead a link: shape (n,), 1 for those, 0 for the others."""
    leading = [tool in model.beyond(model.urdf.children[name]) for name in model.joint_names]
    still = [name in model.config.still for name in model.joint_names]
    led: FloatArray = np.array(leading, np.float64) * ~np.array(still)
    return led


def solved(
    model: RobotModel, tool: str, pose: Pose, start: FloatArray, moving: FloatArray
) -> FloatArray | None:
    """Find joint positions that bring a link into a pose, by damped least squares.

    Args:
        model: the robot.
        tool: the link.
        pose: in the root link's frame.
        start: shape (n,), where to begin [rad, m].
        moving: shape (n,), 1 for the joints that may move.

    Returns:
        Positions within the joints' limits, shape (n,) [rad, m]; None when none were found.
    """
    positions, (low, high) = start.copy(), model.limits.T
    for _ in range(STEPS):
        there = model.poses_at(positions)[tool]
        turn = Rotation.from_matrix(pose[:3, :3] @ there[:3, :3].T).as_rotvec()
        error = np.concatenate([pose[:3, 3] - there[:3, 3], turn])
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
    """Places to begin a search from: the posture first, then chance; shape (n,) each."""
    yield posture
    low, high = np.clip(model.limits, -np.pi, np.pi).T
    while True:
        chance = rng.uniform(low, high)
        yield np.where(moving > 0.0, 0.5 * (posture + chance), posture)
