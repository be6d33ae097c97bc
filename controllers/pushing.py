"""The common part of controllers that push to a target: contacts and odometry in, a twist out."""

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from pydantic import Field

from contactfusion.contacts import Contact
from contactfusion.controller import Command, Controller
from contactfusion.controllers.face import FaceConfig, FaceContact, beside, on_face
from contactfusion.errors import ConfigurationError
from contactfusion.frames import PlanarPose
from contactfusion.model import Model
from contactfusion.readings import Twist
from contactfusion.state import State
from contactfusion.units import Coordinate

PATIENCE = 1.0
"""Time to wait for odometry [s]."""
ARRIVED = "arrived"
"""The mode of a controller that has declared arrival; it rests from then on."""


@dataclass(frozen=True, slots=True)
class Decision:
    """A velocity in the robot's frame, and its reason.

    Attributes:
        forward: v_x [m/s].
        lateral: v_y, to the left [m/s].
        yaw_rate: ω, counterclockwise [rad/s].
        mode: the state of the controller.
        reason: of the velocity, in a few words.
    """

    forward: float
    lateral: float
    yaw_rate: float
    mode: str
    reason: str


class PushingConfig(Model):
    """Options of all controllers that push to a target."""

    target: tuple[Coordinate, Coordinate]
    """The target of the contact, x and y in the odometry's frame [m]."""
    face: FaceConfig = Field(default_factory=FaceConfig)
    """The face of the robot that pushes."""


ConfigT = TypeVar("ConfigT", bound=PushingConfig)


class PushingController(Controller, Generic[ConfigT]):
    """Pushes the object on its face to a target; a subclass decides the velocity.

    Args:
        config: the options.
    """

    Config = PushingConfig

    def __init__(self, config: ConfigT) -> None:
        super().__init__(config)
        self.options = config
        self.reset()

    def reset(self) -> None:
        """Drop all state of earlier steps."""
        self._waits_since = math.inf

    @abstractmethod
    def decide(
        self, touch: FaceContact | None, pose: PlanarPose, now: float, side: float = 0.0
    ) -> Decision:
        """The next velocity.

        Args:
            touch: the contact on the face, or None.
            pose: of the robot.
            now: the stamp of the step [s].
            side: 1.0 if something touches the robot's left side, -1.0 if its right, else 0.0.
        """

    def command(self, contacts: Sequence[Contact], state: State) -> Command:
        """The twist that follows from the contacts of one step.

        Without odometry it waits, for the first reading may be lost.

        Raises:
            ConfigurationError: no odometry comes, or contacts come in another frame.
        """
        if state.base_pose is None:
            self._waits_since = min(self._waits_since, state.now)
            if state.now - self._waits_since > PATIENCE:
                raise ConfigurationError("a controller that pushes needs odometry of the base")
            still = Twist(
                stamp=state.now, frame=self.options.face.frame,
                linear=np.zeros(3), angular=np.zeros(3),
            )  # fmt: skip
            return Command(twist=still, mode="wait", reason="no odometry yet")
        self._waits_since = math.inf
        pose = state.base_pose
        planar = float(pose[0, 3]), float(pose[1, 3]), math.atan2(pose[1, 0], pose[0, 0])
        face = self.options.face
        decision = self.decide(on_face(contacts, face), planar, state.now, beside(contacts, face))
        twist = Twist(
            stamp=state.now,
            frame=face.frame,
            linear=np.array([decision.forward, decision.lateral, 0.0]),
            angular=np.array([0.0, 0.0, decision.yaw_rate]),
        )
        return Command(twist=twist, mode=decision.mode, reason=decision.reason)
