"""What is known of the robot at any recent stamp: joints, base, frames, surface."""

import numpy as np

from contactfusion.errors import FrameError
from contactfusion.frames import FrameTree, Pose
from contactfusion.grid import Grid
from contactfusion.history import History
from contactfusion.integrator.fusion import Fusion
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.state import State
from contactfusion.surface import Surface


class Robot:
    """Remembers the robot's own readings, and gives its state at a stamp.

    Args:
        config: its frames and its surface.
        grid: the frame and voxel size of the hypothesis space.
    """

    def __init__(self, config: PipelineConfig, grid: Grid) -> None:
        self._grid = grid
        self._fixed = config.frame_tree()
        self._body = config.surface.sampled(config.folder) if config.surface else None
        self._moved: tuple[Pose, Surface] | None = None
        self._history = History()

    def add(self, reading: Reading) -> None:
        """Remember a reading of joints or odometry; any other tells nothing of the robot."""
        self._history.add(reading)

    def clear(self) -> None:
        """Forget all readings."""
        self._history.clear()

    def frames(self, stamp: float) -> FrameTree:
        """Give the poses of all frames at a stamp [s]."""
        if base := self._history.base_pose(stamp):
            parent, child, pose = base
            return self._fixed.extended({child: (parent, pose)})
        return self._fixed

    def state(self, stamp: float, fusion: Fusion | None) -> State:
        """Give all that is known at a stamp [s], with the last step of the integrator."""
        frames = self.frames(stamp)
        base = self._history.base_pose(stamp)
        return State(
            now=stamp,
            grid=self._grid,
            frames=frames,
            joints=self._history.joints(stamp),
            base_pose=base[2] if base else None,
            surface=self._surface(frames),
            fusion=fusion,
        )

    def lost_surface(self, state: State) -> str:
        """Say that the surface has no place in the space; empty when it has, or there is none."""
        if self._body is None or state.surface is not None:
            return ""
        return f"no transform joins the surface's frame '{self._body.frame}' to the space"

    def _surface(self, frames: FrameTree) -> Surface | None:
        """Give the body's surface in the space's frame; None while nothing joins the two."""
        if self._body is None or self._body.frame == self._grid.frame:
            return self._body
        try:
            pose = frames.pose(self._grid.frame, of=self._body.frame)
        except FrameError:
            return None
        if self._moved is None or not np.array_equal(self._moved[0], pose):
            self._moved = pose, self._body.moved(pose, self._grid.frame)
        return self._moved[1]
