"""Contacts from compliant fingers: joints that deviate from their reference (F §V-E)."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Annotated

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError, name_hint
from contactfusion.generator import Generator, GeneratorConfig, OfRobot
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, Note
from contactfusion.readings import JointCommand, JointState, Reading
from contactfusion.robots.description import FingerConfig
from contactfusion.robots.posed import PosedRobot
from contactfusion.state import State
from contactfusion.thinning import voxel_downsample
from contactfusion.units import Memory, Spread

GAVE_WAY = 1e-6
"""Least displacement of a point against its normal [m]; below, it is rounding, as beside a
hinge."""


class FingerPoseConfig(GeneratorConfig):
    """The options of `finger_pose`."""

    fingers: Annotated[dict[str, FingerConfig], OfRobot("fingers")] = Field(min_length=1)
    """The compliant fingers, by name, or a list of names from the robot's description; each is an
    output."""
    threshold: float = Field(default=0.02, gt=0)
    """Least deviation of a joint from its reference [rad, m]; well above the noise of its
    encoder."""
    settle: Memory = Field(default=0.5, ge=0)
    """Time in which fingers move after a command, and give no contact [s]."""
    noise: Spread = Field(default=0.003, ge=0)
    """Standard deviation of the position of the robot's surface [m]."""


class FingerPoseGenerator(Generator[FingerPoseConfig]):
    """Regular, one single contact a finger: somewhere on the displaced side of its displaced links.

    The first joints after `reset`, or after a command has been carried out, are the reference. When
    a joint deviates, the contact lies on a link beyond the last joint that deviates, where the
    surface has moved inward: a contact pushes into the surface.
    """

    Config = FingerPoseConfig
    readings = (JointState, JointCommand)
    needs_body = True

    def __init__(self, name: str, config: FingerPoseConfig) -> None:
        super().__init__(name, config)
        self.outputs = dict.fromkeys(config.fingers, HypothesisKind.REGULAR)
        self.reset()

    def reset(self) -> None:
        """Take the next joints as the reference."""
        self._references: dict[str, Mapping[str, float]] = {}
        self._moving_until = dict.fromkeys(self.config.fingers, -np.inf)
        self._commanded: dict[str, float] = {}

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The displaced surface of each finger; no cloud of those that may still move by command.

        Raises:
            ConfigurationError: there is no robot.
            RobotError: a finger has joints or links that the robot lacks.
        """
        if isinstance(reading, JointCommand):
            self._obey(reading)
            return ()
        assert isinstance(reading, JointState)
        robot, positions = state.posed_robot(self.name), _positions(reading)
        clouds = []
        for name, finger in self.config.fingers.items():
            _require_known(robot, name, finger)
            if positions.keys() >= set(finger.joints) and reading.stamp >= self._moving_until[name]:
                clouds.append(self._finger(reading, positions, state, robot, name))
        return clouds

    def _obey(self, command: JointCommand) -> None:
        """Drop the reference of fingers with a new command.

        Many drivers repeat the last command for ever; a repetition moves nothing.
        """
        positions = _positions(command)
        for name, finger in self.config.fingers.items():
            commanded = positions.keys() & set(finger.joints)
            if any(positions[joint] != self._commanded.get(joint) for joint in commanded):
                self._references.pop(name, None)
                self._moving_until[name] = command.stamp + self.config.settle
        self._commanded |= positions

    def _finger(
        self,
        reading: Reading,
        positions: Mapping[str, float],
        state: State,
        robot: PosedRobot,
        name: str,
    ) -> HypothesisCloud:
        finger = self.config.fingers[name]
        nothing = partial(self.nothing, reading, output=name, frame=state.grid.frame)
        reference = self._references.setdefault(name, positions)
        moved = [
            joint
            for joint in finger.joints
            if abs(positions[joint] - reference[joint]) > self.config.threshold
        ]
        if not moved:
            return nothing()
        points = _pushed(robot, reference, finger, moved)
        points = points[voxel_downsample(points, state.grid)]
        if not len(points):
            return nothing(notes=(Note.OFF_SURFACE,))
        return self.cloud(
            reading,
            points,
            1.0 / len(points),
            output=name,
            frame=state.grid.frame,
            spreads=np.full(len(points), self.config.noise),
            single=True,
        )


def _positions(reading: JointState | JointCommand) -> dict[str, float]:
    return dict(zip(reading.names, reading.positions.tolist(), strict=True))


def _require_known(robot: PosedRobot, name: str, finger: FingerConfig) -> None:
    """Refuse a finger with joints or links that the robot lacks."""
    model = robot.model
    for what, named, known in (
        ("joint", finger.joints, model.joint_names),
        ("link", finger.links, model.link_names),
    ):
        for part in named:
            if part not in known:
                hint = name_hint(part, known, f"{what}s")
                raise RobotError(f"finger '{name}' has an unknown {what} '{part}': {hint}")


def _pushed(
    robot: PosedRobot, reference: Mapping[str, float], finger: FingerConfig, moved: Sequence[str]
) -> FloatArray:
    """The displaced points of a finger, shape (n, 3) [m]: the contact is one of them.

    The arm may have moved since the reference; only the finger's own joints count.
    """
    model = robot.model
    pushed = [
        link
        for link in finger.links
        if all(link in model.beyond(model.urdf.children[joint]) for joint in moved)
    ]
    if not pushed:  # an empty list of links would mean all links
        return np.empty((0, 3))
    before = robot.positions.copy()
    for joint in finger.joints:
        before[model.joint_names.index(joint)] = reference[joint]
    now, then = robot.surface_of(pushed), robot.at(before).surface_of(pushed)
    outward = np.einsum("ij,ij->i", now.points - then.points, now.normals)
    displaced: FloatArray = now.points[outward < -GAVE_WAY]
    return displaced


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[FingerPoseConfig]]]:
    """The finger-pose generator."""
    return {"finger_pose": FingerPoseGenerator}
