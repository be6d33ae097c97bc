"""Predicted positions of the robot's surface, where contacts are to be expected (F §V-F, Eq 8)."""

import math
from collections.abc import Mapping, Sequence
from itertools import compress

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, pose_of
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.jit import kernel
from contactfusion.readings import JointState, Reading, Twist
from contactfusion.robots.posed import PosedRobot
from contactfusion.state import State
from contactfusion.surface import Surface
from contactfusion.thinning import voxel_downsample
from contactfusion.units import Period, Spread


class MotionConfig(GeneratorConfig):
    """The options of `motion`."""

    links: tuple[str, ...] = ()
    """The links whose surface is predicted, such as those of the hand; empty: the whole robot."""
    ahead: Period = Field(default=0.05, gt=0)
    """Prediction horizon [s]."""
    likelihood: float = Field(default=0.3, ge=0, le=1)
    """Likelihood of a contact at the predicted surface."""
    noise: Spread = Field(default=0.003, ge=0)
    """Standard deviation of the position of the robot's surface [m]."""


class MotionGenerator(Generator[MotionConfig]):
    """Support, multi contact: the voxels of the surface at q + Δq (F Eq 8).

    Δq is the speed of the joints, or of the base, times `ahead`; where a reading has no speed of a
    joint, it is that since its last reading. The contact may come anywhere on the path: the
    spread of a position holds the path's length over √12.
    """

    Config = MotionConfig
    readings = (JointState, Twist)
    needs_body = True
    outputs = {"": HypothesisKind.SUPPORT}

    def __init__(self, name: str, config: MotionConfig) -> None:
        super().__init__(name, config)
        self.reset()

    def reset(self) -> None:
        """Drop the joints' positions and speeds."""
        self._last: dict[str, tuple[float, float]] = {}
        self._speeds: dict[str, float] = {}

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The predicted surface.

        Raises:
            ConfigurationError: there is no robot, or no surface, to move.
            RobotError: no link of a name that is configured.
            FrameError: nothing joins the frame of a twist to the hypothesis space.
        """
        if isinstance(reading, Twist):
            now = self._surface(state)
            predicted = now.moved(self._driven(reading, state), now.frame)
        else:
            assert isinstance(reading, JointState)
            robot = self._learn_speeds(reading, state)
            if not self._speeds.keys() & set(reading.names) & set(robot.model.joint_names):
                return ()
            speeds = robot.model.speeds(self._speeds)
            future = robot.at(robot.positions + speeds * self.config.ahead)
            now, predicted = (posed.surface_of(self.config.links) for posed in (robot, future))
        kept = voxel_downsample(predicted.points, state.grid)
        positions, lengths = moved(now.points, predicted.points, kept)
        return (
            self.cloud(
                reading,
                positions,
                self.config.likelihood,
                frame=state.grid.frame,
                spreads=np.hypot(self.config.noise, lengths / np.sqrt(12.0)),
            ),
        )

    def absorb(self, reading: Reading, state: State) -> None:
        """Take note of the speeds of joints."""
        if isinstance(reading, JointState):
            self._learn_speeds(reading, state)

    def _learn_speeds(self, reading: JointState, state: State) -> PosedRobot:
        """Update the speed of each joint [rad/s, m/s], and return the robot.

        Arm and hand may report in readings of their own, even with one stamp: each joint has a last
        reading of its own, and keeps its speed until the next. Joints without limits may leap by a
        turn.
        """
        robot = state.posed_robot(self.name)
        turning = {*compress(robot.model.joint_names, robot.model.turning.tolist())}
        positions, speeds = reading.positions.tolist(), [math.nan] * len(reading.names)
        if reading.velocities is not None:
            speeds = reading.velocities.tolist()
        for name, position, speed in zip(reading.names, positions, speeds, strict=True):
            stamp, before = self._last.get(name, (-math.inf, position))
            if reading.stamp > stamp:
                self._last[name] = reading.stamp, position
            moved = position - before
            if name in turning:
                moved = math.remainder(moved, math.tau)
            if math.isfinite(speed):
                self._speeds[name] = speed
            elif -math.inf < stamp < reading.stamp:
                self._speeds[name] = moved / (reading.stamp - stamp)
        return robot

    def _surface(self, state: State) -> Surface:
        if state.robot is not None or self.config.links:
            return state.posed_robot(self.name).surface_of(self.config.links)
        return state.placed_surface(self.name)

    def _driven(self, reading: Twist, state: State) -> Pose:
        """The predicted motion in the grid's frame, by the twist of the reading's frame."""
        from scipy.spatial.transform import Rotation

        shift, rotation = reading.linear * self.config.ahead, reading.angular * self.config.ahead
        step = pose_of(shift, Rotation.from_rotvec(rotation).as_matrix())
        to_grid = state.frames.pose(state.grid.frame, of=reading.frame)
        back = state.frames.pose(reading.frame, of=state.grid.frame)
        return to_grid @ step @ back


@kernel
def moved(
    now: FloatArray, predicted: FloatArray, rows: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Predicted positions of some points, shape (k, 3), and their displacements, shape (k,) [m].

    Args:
        now: shape (n, 3) [m], current positions.
        predicted: shape (n, 3) [m], predicted positions.
        rows: shape (k,), of the points.
    """
    positions, lengths = np.empty((len(rows), 3)), np.empty(len(rows))
    for number in range(len(rows)):
        row = rows[number]
        square = 0.0
        for axis in range(3):
            positions[number, axis] = predicted[row, axis]
            square += (predicted[row, axis] - now[row, axis]) ** 2
        lengths[number] = np.sqrt(square)
    return positions, lengths


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[MotionConfig]]]:
    """The motion generator."""
    return {"motion": MotionGenerator}
