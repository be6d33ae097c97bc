"""A hand without physics: it moves exactly as it is told, and is touched where a script says."""

from collections.abc import Callable, Iterator
from itertools import groupby
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.controller import Command
from contactfusion.controllers.grasp_parameters import ReactiveGraspConfig
from contactfusion.controllers.reactive_grasp import ReactiveGrasp
from contactfusion.frames import FrameTree, Pose, points_in, pose_of, vectors_in
from contactfusion.grid import Grid
from contactfusion.readings import JointState, Wrench
from contactfusion.state import State
from contactfusion.surface import Surface

JOINTS = ("left", "right")
FASTEST = 2.0
"""Of the fingers, in parts of their way [1/s]."""
LOOKING_ALONG_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""The tool's x points along y, its y up, its z along x."""

Touches = Callable[["ToyHand"], list[Contact]]


def controller(**fields: Any) -> ReactiveGrasp:
    gripper = dict.fromkeys(JOINTS, (0.0, 1.0))
    return ReactiveGrasp(ReactiveGraspConfig(**{"tool": "palm", "gripper": gripper, **fields}))


def contact(place: FloatArray, force: FloatArray | None = None, likelihood: float = 0.5) -> Contact:
    """A contact in the frame "base"."""
    return Contact(
        position=place,
        likelihood=likelihood,
        scatter=np.zeros((3, 3)),
        covariance=np.zeros((3, 3)),
        extent=np.stack([place, place]),
        force=np.full(3, np.nan) if force is None else force,
        voxels=1,
        shares={"motion": 0.3, "wrist": 0.7},
        stamp=0.0,
        frame="base",
    )


class ToyHand:
    """A hand at a pose, with two fingers, that does what its controller commands."""

    def __init__(
        self, one: ReactiveGrasp, touches: Touches = lambda hand: [], period: float = 0.05
    ) -> None:
        self.controller, self.touches, self.period = one, touches, period
        self.pose: Pose = pose_of((0.5, 0.0, 0.3), LOOKING_ALONG_X)
        self.closed = np.array([0.3, 0.3])
        self.speeds = np.zeros(2)
        self.most = np.ones(2)
        """What is between the fingers lets them close so far."""
        self.jammed = np.zeros(2, np.bool_)
        self.stopped: Callable[[ToyHand, FloatArray], bool] = lambda hand, velocity: False
        """Whether something keeps the hand from moving so, in its own frame."""
        self.surface: Surface | None = None
        self.deaf = False
        self.silent = np.inf
        """From here on joints tell nothing [s]."""
        self.tells_speeds = True
        self.weight: Callable[[ToyHand], float] | None = None
        """What the wrist weighs beside the hand [N]; None: there is no sensor."""
        self.told: list[Command] = []
        self.way = [self.pose[:3, 3].copy()]

    @property
    def now(self) -> float:
        return len(self.told) * self.period

    @property
    def mode(self) -> str:
        return self.told[-1].mode if self.told else ""

    def at(self, *place: float) -> FloatArray:
        """Where a place in the frame of the tool is in "base"."""
        there: FloatArray = points_in(self.pose, np.array([place]))[0]
        return there

    def touched(self, place: tuple[float, ...], push: tuple[float, ...]) -> Contact:
        """A contact at a place with a force of 2 N, both in the frame of the tool."""
        force = vectors_in(self.pose, 2.0 * np.array([push]) / np.linalg.norm(push))[0]
        return contact(self.at(*place), force)

    def state(self) -> State:
        joints = JointState(
            stamp=min(self.now, self.silent),
            frame="base",
            names=(*JOINTS, "arm"),
            positions=np.append(self.closed, 0.0),
            velocities=np.append(self.speeds, 0.0) if self.tells_speeds else None,
        )
        return State(
            now=self.now,
            grid=Grid("base", 0.005),
            frames=FrameTree({"palm": ("base", self.pose)}),
            joints=None if self.deaf else joints,
            surface=self.surface,
            wrenches=tuple(self.wrenches()),
        )

    def wrenches(self) -> Iterator[Wrench]:
        """What the wrist has read since the last step."""
        if self.weight is None:
            return
        weight = self.weight(self)
        for k in range(5):
            force = np.array([0.01 * k, -10.0 - weight, 0.0])
            stamp = self.now - self.period * (4 - k) / 5
            yield Wrench(stamp=stamp, frame="palm", sensor="wrist", force=force, torque=np.zeros(3))

    def step(self) -> Command:
        command = self.controller.command(self.touches(self), self.state())
        self.told.append(command)
        assert command.twist is not None and command.twist.frame == "palm"
        velocity = command.twist.linear
        if not self.stopped(self, velocity):
            self.pose = self.pose.copy()
            self.pose[:3, 3] += self.period * self.pose[:3, :3] @ velocity
        goal = self.closed if command.gripper is None else np.full(2, command.gripper)
        most = FASTEST * self.period
        way = np.clip(goal - self.closed, -most, most)
        there = np.where(self.jammed, self.closed, np.minimum(self.closed + way, self.most))
        self.speeds, self.closed = (there - self.closed) / self.period, there
        self.way.append(self.pose[:3, 3].copy())
        return command

    def until(self, *modes: str, longest: float = 60.0) -> Command:
        """Go on until a mode is commanded."""
        while self.step().mode not in modes:
            assert self.now < longest, f"it is still in {self.mode}: {self.told[-1].reason}"
        return self.told[-1]

    def modes(self) -> list[str]:
        """The modes in their order, each as often as it begins."""
        return list(self._modes())

    def _modes(self) -> Iterator[str]:
        return (mode for mode, _ in groupby(command.mode for command in self.told))
