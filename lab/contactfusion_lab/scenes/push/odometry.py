"""The motion of a base that pushes, as its wheels measure it."""

import math
from typing import final

import numpy as np

from contactfusion.frames import PlanarPose, planar_turned, planar_turned_back
from contactfusion_lab.scenes.push.noise import OdometryNoise

EXACT = OdometryNoise()
"""Odometry that measures the truth."""


@final
class PushOdometry:
    """Odometry, cycle by cycle; without noise it is the truth.

    Args:
        noise: the size of its errors.
        pose: true, at the start.
        twist: true, at the start: forward, lateral [m/s], yaw rate [rad/s].
        rng: draws the errors.
    """

    def __init__(
        self,
        noise: OdometryNoise,
        pose: PlanarPose,
        twist: tuple[float, float, float],
        rng: np.random.Generator,
    ) -> None:
        self._noise, self._rng, self._true = noise, rng, pose
        scale, yaw, slip = rng.standard_normal(3).tolist()
        self._scale, self._yaw = 1.0 + noise.translation * scale, 1.0 + noise.yaw * yaw
        self._slip = noise.slip * slip
        self.pose = pose
        """Measured, in `odom`."""
        self.twist = twist
        """Measured in the last cycle."""

    def follow(
        self, pose: PlanarPose, twist: tuple[float, float, float], pressed: bool, period: float
    ) -> None:
        """Measure the motion of one cycle.

        Args:
            pose: true, at its end.
            twist: true, in it.
            pressed: whether the object pressed on the base.
            period: of the cycle [s].
        """
        if self._noise == EXACT:
            self.pose, self.twist = pose, twist
            return
        x, y, yaw = self._true
        turned = pose[2] - yaw
        moved = planar_turned_back((pose[0] - x, pose[1] - y), yaw + turned / 2.0)
        length = math.hypot(*moved)
        walk = math.sqrt(length) * self._rng.standard_normal(3)
        walk *= self._noise.walk, self._noise.walk, math.radians(self._noise.turn)
        ahead, aside, turn = walk.tolist()
        ahead += self._scale * moved[0]
        aside += self._scale * moved[1] + self._slip * length * pressed
        turn += self._yaw * turned
        there = planar_turned((ahead, aside), self.pose[2] + turn / 2.0)
        self.pose = self.pose[0] + there[0], self.pose[1] + there[1], self.pose[2] + turn
        self.twist = ahead / period, aside / period, turn / period
        self._true = pose
