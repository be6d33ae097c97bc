"""Contacts from fingers that yield: joints that leave the place they were sent to (F §V-E)."""

from collections.abc import Mapping, Sequence
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
from contactfusion.thinning import first_in_voxels
from contactfusion.units import Memory, Spread

GAVE_WAY = 1e-6
"""A point that moved less against its normal [m] did so by rounding, as the sides of a hinge do."""


class FingerPoseConfig(GeneratorConfig):
    """The options of `finger_pose`."""

    fingers: Annotated[dict[str, FingerConfig], OfRobot("fingers")] = Field(min_length=1)
    """The compliant fingers, by name, or a list of names from the robot's description; each is an
    output."""
    threshold: float = Field(default=0.02, gt=0)
    """How far a joint must leave its reference [rad, m]: well over the noise of its encoder."""
    settle: Memory = Field(default=0.5, ge=0)
    """How long fingers move after a command [s]; what they do until then is no contact."""
    noise: Spread = Field(default=0.003, ge=0)
    """Standard deviation of where the robot believes its surface to be [m]."""


class FingerPoseGenerator(Generator[FingerPoseConfig]):
    """Regular, one single contact a finger: somewhere on the pushed side of what was pushed.

    The first joints after `reset`, or after a command has been carried out, are the reference. When
    one leaves it, the contact lies on a link beyond the last joint that left, and where the surface
    gave way: the contact pushes into the surface.
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
        """Give for each finger the surface that gave way; nothing of those that may be moving.

        Raises:
            ConfigurationError: there is no robot.
            RobotError: a finger has joints or links that the robot lacks.
        """
        if isinstance(reading, JointCommand):
            self._obey(reading)
            return ()
        assert isinstance(reading, JointState)
        robot, told = state.posed_robot(self.name), _told(reading)
        clouds = []
        for name, finger in self.config.fingers.items():
            _require_known(robot, name, finger)
            if told.keys() >= set(finger.joints) and reading.stamp >= self._moving_until[name]:
                clouds.append(self._finger(reading, told, state, robot, name))
        return clouds

    def _obey(self, command: JointCommand) -> None:
        """Forget the reference of fingers that are sent elsewhere.

        Many drivers repeat the last command for ever: that moves nothing.
        """
        told = _told(command)
        for name, finger in self.config.fingers.items():
            ours = told.keys() & set(finger.joints)
            if any(told[joint] != self._commanded.get(joint) for joint in ours):
                self._references.pop(name, None)
                self._moving_until[name] = command.stamp + self.config.settle
        self._commanded |= told

    def _finger(
        self,
        reading: Reading,
        told: Mapping[str, float],
        state: State,
        robot: PosedRobot,
        name: str,
    ) -> HypothesisCloud:
        finger = self.config.fingers[name]
        reference = self._references.setdefault(name, told)
        moved = [
            joint
            for joint in finger.joints
            if abs(told[joint] - reference[joint]) > self.config.threshold
        ]
        if not moved:
            return self.nothing(reading, output=name)
        places = _pushed(robot, reference, finger, moved)
        places = places[first_in_voxels(places, state.grid)]
        if not len(places):
            return self.nothing(reading, output=name, notes=(Note.OFF_SURFACE,))
        return self.cloud(
            reading,
            places,
            1.0 / len(places),
            output=name,
            frame=state.grid.frame,
            spreads=np.full(len(places), self.config.noise),
            single=True,
        )


def _told(reading: JointState | JointCommand) -> dict[str, float]:
    return dict(zip(reading.names, reading.positions.tolist(), strict=True))


def _require_known(robot: PosedRobot, name: str, finger: FingerConfig) -> None:
    """Make sure that the robot has the joints and links of a finger."""
    model = robot.model
    for what, named, known in (
        ("joint", finger.joints, model.joint_names),
        ("link", finger.links, model.link_names),
    ):
        for one in named:
            if one not in known:
                hint = name_hint(one, known, f"{what}s")
                raise RobotError(f"finger '{name}' has an unknown {what} '{one}': {hint}")


def _pushed(
    robot: PosedRobot, reference: Mapping[str, float], finger: FingerConfig, moved: Sequence[str]
) -> FloatArray:
    """Give the points of a finger that gave way, shape (n, 3) [m]: the contact is one of them.

    The arm may have moved since; only the finger's own joints count for what gave way.
    """
    model = robot.model
    pushed = [
        link
        for link in finger.links
        if all(link in model.beyond(model.urdf.children[joint]) for joint in moved)
    ]
    if not pushed:  # no link named would mean all links
        return np.empty((0, 3))
    before = robot.positions.copy()
    for joint in finger.joints:
        before[model.joint_names.index(joint)] = reference[joint]
    now, then = robot.surface_of(pushed), robot.at(before).surface_of(pushed)
    outward = np.einsum("ij,ij->i", now.points - then.points, now.normals)
    places: FloatArray = now.points[outward < -GAVE_WAY]
    return places


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[FingerPoseConfig]]]:
    """Offer the finger-pose generator."""
    return {"finger_pose": FingerPoseGenerator}
