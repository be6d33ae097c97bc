"""What a grasping hand is about: a way to a goal, or to stand, and how it gets on with it."""

from typing import final

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.controllers.grasp_parameters import ReactiveGraspConfig
from contactfusion.controllers.grasp_sense import Sense

NEAR = 0.002
"""So near to its goal the hand has reached it [m]."""
PROGRESS = 0.002
"""A hand that comes nearer by less makes no progress [m]."""
SLOWING = 4.0
"""The hand is so much slower for each metre that is left [1/s]."""
QUIET = 0.2
"""Fingers have stopped when they rest for so long [s]."""


@final
class Move:
    """A way of the hand, and whether its fingers rest since it began.

    Args:
        now: when it begins [s].
        goal: where the tool shall be, shape (3,) [m], in the frame of the hypothesis space; None:
            it shall stand.
        options: speeds and patience.
    """

    def __init__(self, now: float, goal: FloatArray | None, options: ReactiveGraspConfig) -> None:
        self.began, self.goal, self._options = now, goal, options
        self._left, self._nearest = np.inf, np.inf
        self._now = self._nearer = self._moved = now

    def follow(self, sense: Sense) -> None:
        """Take in how far the hand has come, and whether its fingers rest."""
        self._now = now = sense.now
        if (np.abs(sense.speeds) > self._options.resting).any():
            self._moved = now
        if self.goal is None:
            return
        self._left = float(np.linalg.norm(self.goal - sense.place))
        if self._left < self._nearest - PROGRESS:
            self._nearest, self._nearer = self._left, now

    @property
    def is_there(self) -> bool:
        """Whether the hand has reached its goal."""
        return self._left < NEAR

    @property
    def is_blocked(self) -> bool:
        """Whether it comes no nearer."""
        return self.goal is not None and self._now - self._nearer > self._options.patience

    @property
    def fingers_rest(self) -> bool:
        """Whether the fingers have had time to begin, and rest since."""
        return min(self._now - self._moved, self._now - self.began - QUIET) > QUIET

    def velocity(self, sense: Sense) -> FloatArray:
        """Give the velocity of the tool in its own frame, shape (3,) [m/s]."""
        if self.goal is None:
            return np.zeros(3)
        way = sense.tool[:3, :3].T @ (self.goal - sense.place)
        left = max(float(np.linalg.norm(way)), 1e-9)
        velocity: FloatArray = way / left * min(self._options.speed, SLOWING * left)
        return velocity
