"""Contacts from fingers that yield: joints that leave the place they were sent to (F §V-E)."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError, name_hint
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.readings import JointCommand, JointState, Reading
from contactfusion.robots.description import FingerConfig
from contactfusion.robots.posed import PosedRobot
from contactfusion.state import State


class FingerPoseConfig(GeneratorConfig):
    """The options of `finger_pose`."""

    fingers: dict[str, FingerConfig] = Field(min_length=1)
    """The compliant fingers, by name, or a list of names from the robot's description; each is an
    output."""
    threshold: float = Field(default=0.02, gt=0)
    """How far a joint must leave its reference [rad, m]: well over the noise of its encoder."""
    settle: float = Field(default=0.5, ge=0)
    """How long fingers move after a command [s]; what they do until then is no contact."""
    noise: float = Field(default=0.003, ge=0)
    """Standard deviation of where the robot believes its surface to be [m]."""


class FingerPoseGenerator(Generator[FingerPoseConfig]):
    """Regular, one single contact a finger: somewhere on the pushed side of what was pushed.

    The first joints after `reset`, or after a command has been carried out, are the reference. When
    one leaves it, the contact lies on a link beyond the last joint that left, and where the surface
    gave way: the contact pushes into the surface.
    """

    Config = FingerPoseConfig
    readings = (JointState, JointCommand)

    def __init__(self, name: str, config: FingerPoseConfig) -> None:
        super().__init__(name, config)
        self.outputs = dict.fromkeys(config.fingers, HypothesisKind.REGULAR)
        self.reset()

    def reset(self) -> None:
        """Take the next joints as the reference."""
        self._reference: PosedRobot | None = None
        self._moving_until = -np.inf

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Give for each finger the surface that gave way.

        Raises:
            ConfigurationError: there is no robot, or a finger has joints or links that it lacks.
        """
        if isinstance(reading, JointCommand):
            joints = {joint for one in self.config.fingers.values() for joint in one.joints}
            if joints & set(reading.names):
                self._reference = None
                self._moving_until = reading.stamp + self.config.settle
            return ()
        assert isinstance(reading, JointState)
        robot = state.posed_robot(self.name)
        if reading.stamp < self._moving_until:
            return ()
        if self._reference is None:
            self._reference = robot
        return [
            self._finger(reading, state, robot, name, finger)
            for name, finger in self.config.fingers.items()
        ]

    def _finger(
        self, reading: Reading, state: State, robot: PosedRobot, name: str, finger: FingerConfig
    ) -> HypothesisCloud:
        assert self._reference is not None
        model, moved = robot.model, []
        for joint in finger.joints:
            if joint not in model.joint_names:
                hint = name_hint(joint, model.joint_names, "joints")
                raise RobotError(f"finger '{name}' has an unknown joint '{joint}': {hint}")
            row = model.joint_names.index(joint)
            if abs(robot.positions[row] - self._reference.positions[row]) > self.config.threshold:
                moved.append(joint)
        if not moved:
            return self.nothing(reading, output=name)
        places = _pushed(robot, self._reference, finger, moved)
        places = places[state.grid.first_in_voxels(places)]
        return self.cloud(
            reading,
            places,
            1.0 / max(len(places), 1),
            output=name,
            frame=state.grid.frame,
            spreads=np.full(len(places), self.config.noise),
            single=True,
        )


def _pushed(
    robot: PosedRobot, reference: PosedRobot, finger: FingerConfig, moved: Sequence[str]
) -> FloatArray:
    """Give the points of a finger that gave way, shape (n, 3) [m]: the contact is one of them.

    The arm may have moved since; only the finger's own joints count for what gave way.
    """
    names = robot.model.joint_names
    pushed = [link for link in finger.links if _beyond_all(robot, link, moved)]
    before = robot.positions.copy()
    for joint in finger.joints:
        before[names.index(joint)] = reference.positions[names.index(joint)]
    now, then = robot.surface_of(pushed), robot.at(before).surface_of(pushed)
    yielded = np.einsum("ij,ij->i", now.points - then.points, now.normals) < 0.0
    places: FloatArray = now.points[yielded]
    return places


def _beyond_all(robot: PosedRobot, link: str, moved: Sequence[str]) -> bool:
    urdf = robot.model.urdf
    return all(link in urdf.hanging_on(urdf.children[joint]) for joint in moved)


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[FingerPoseConfig]]]:
    """Offer the finger-pose generator."""
    return {"finger_pose": FingerPoseGenerator}
