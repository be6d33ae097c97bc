"""Where everything is: in the frame that stands still."""

from dataclasses import dataclass

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import FrameError
from contactfusion.frames import FrameTree, Pose
from contactfusion.state import State

ASIDE, ABOVE = np.radians([-60.0, 28.0])
"""The scene is looked at from so far beside its contacts, and from above [rad]."""


@dataclass(frozen=True, eq=False)
class Places:
    """The poses of all frames at one step, in the frame in which is drawn.

    Attributes:
        frames: the poses.
        world: the frame over all that hang together with the hypothesis space: the odometry's, or
            the space itself.
    """

    frames: FrameTree
    world: str

    @classmethod
    def of(cls, state: State) -> "Places":
        """Give the poses at a state."""
        return cls(state.frames, state.frames.root(state.grid.frame))

    def find(self, frame: str) -> Pose | None:
        """Give the pose of a frame; None where nothing joins it to the world."""
        try:
            return self.frames.pose(self.world, of=frame)
        except FrameError:
            return None

    def space(self, frame: str) -> Pose:
        """Give the pose of the hypothesis space, which hangs under the world."""
        return self.frames.pose(self.world, of=frame)


class Extent:
    """What to look at, and from where: the box around all that was drawn of body and contacts."""

    def __init__(self) -> None:
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._towards = np.zeros(3)
        self.touched = False
        """Whether there ever was a contact."""

    def include(self, body: FloatArray, contacts: FloatArray) -> None:
        """Go on with one step; both have shape (n, 3) [m]."""
        self.touched = self.touched or len(contacts) > 0
        points = np.concatenate([body, contacts])
        if len(points):
            self._low = np.minimum(self._low, points.min(axis=0))
            self._high = np.maximum(self._high, points.max(axis=0))
        if len(body) and len(contacts):
            self._towards += contacts[0] - body.mean(axis=0)

    @property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """The least and the greatest coordinates [m]; a cube of 1 m while there is nothing."""
        if not np.isfinite(self._low).all():
            return np.full(3, -0.5), np.full(3, 0.5)
        return self._low, self._high

    @property
    def eye(self) -> FloatArray:
        """The direction from which most contacts are seen, a unit vector, shape (3,).

        From above, and aside of where contacts lie on the robot, so that it does not hide them.
        """
        ahead = np.arctan2(self._towards[1], self._towards[0])
        around, up = ahead + ASIDE, ABOVE
        return np.array([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)])
