"""Where everything is: in the frame that stands still."""

from dataclasses import dataclass

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import FrameError
from contactfusion.frames import FrameTree, Pose
from contactfusion.state import State


@dataclass(frozen=True, eq=False)
class Places:
    """The poses of all frames at one step, in the frame in which is drawn.

    Attributes:
        frames: the poses.
        world: the frame over all that hang together with the hypothesis space: the odometry's, or
            the space itself.
        space: the pose of the hypothesis space.
    """

    frames: FrameTree
    world: str
    space: Pose

    @classmethod
    def of(cls, state: State) -> "Places":
        """Give the poses at a state."""
        frames, space = state.frames, state.grid.frame
        world = frames.root(space)
        return cls(frames, world, frames.pose(world, of=space))

    def find(self, frame: str) -> Pose | None:
        """Give the pose of a frame; None where nothing joins it to the world."""
        try:
            return self.frames.pose(self.world, of=frame)
        except FrameError:
            return None


def heading(pose: Pose) -> FloatArray:
    """Give how a pose is turned about the vertical, a matrix of shape (3, 3)."""
    yaw = np.arctan2(pose[1, 0], pose[0, 0])
    return np.array(
        [[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    )
