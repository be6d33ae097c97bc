"""Where everything is: in the frame that stands still."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import final

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
        grid: the frame of the hypothesis space.
        unknown: why the space's pose is not known at this time, and is that nearest in time; empty
            when it is known.
    """

    frames: FrameTree
    world: str
    space: Pose
    grid: str
    unknown: str = ""

    @classmethod
    def of(cls, state: State) -> "Places":
        """Give the poses at a state.

        Raises:
            FrameError: the frames form a circle.
        """
        frames, grid = state.frames, state.grid.frame
        try:
            world = frames.root(grid)
            return cls(frames, world, frames.pose(world, of=grid), grid)
        except FrameError as error:
            nearest = frames.nearest()
            world = nearest.root(grid)
            return cls(frames, world, nearest.pose(world, of=grid), grid, str(error))

    def find(self, frame: str) -> Pose | None:
        """Give the pose of a frame; None where nothing joins it to the world or to the space."""
        with suppress(FrameError):
            return self.frames.pose(self.world, of=frame)
        with suppress(FrameError):
            return self.space @ self.frames.pose(self.grid, of=frame)
        return None

    def why_lost(self, frame: str) -> str:
        """Why a frame has no pose; empty when it has one."""
        try:
            self.frames.pose(self.world, of=frame)
        except FrameError as error:
            return str(error)
        return ""


@final
class Absences:
    """What could not be placed, in the order in which it was first missing."""

    def __init__(self) -> None:
        self._spans: dict[str, tuple[float, float, str]] = {}

    def add(self, what: str, stamp: float, why: str) -> None:
        """Note that something is missing at a stamp [s]; the first reason is kept."""
        first, _, reason = self._spans.get(what, (stamp, stamp, why))
        self._spans[what] = first, stamp, reason

    def lines(self) -> Iterator[str]:
        """What was missing, from when to when, and why."""
        for what, (first, last, why) in self._spans.items():
            span = f"from {first:.3f} to {last:.3f} s" if last > first else f"at {first:.3f} s"
            yield f"{what} {span}: {why}"


def heading(pose: Pose) -> FloatArray:
    """Give how a pose is turned about the vertical, a matrix of shape (3, 3)."""
    yaw = np.arctan2(pose[1, 0], pose[0, 0])
    return np.array(
        [[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    )
