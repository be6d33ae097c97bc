"""What controllers that push to a target share: contacts and odometry in, a twist out."""

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
"""It waits so long for odometry [s]."""
ARRIVED = "arrived"
"""The mode of a controller that has declared arrival; it holds still from then on."""


@dataclass(frozen=True, slots=True)
class Decision:
    """A velocity in the robot's frame, and why.

    Attributes:
        ahead: v_x [m/s].
        aside: v_y, to the left [m/s].
        turn: ω, counterclockwise [rad/s].
        mode: the state of the controller.
        reason: why, in a few words.
    """

    ahead: float
    aside: float
    turn: float
    mode: str
    reason: str


class PushingConfig(Model):
    """What every controller that pushes to a target can be told."""

    target: tuple[Coordinate, Coordinate]
    """Where the contact shall come to, x and y in the odometry's frame [m]."""
    face: FaceConfig = Field(default_factory=FaceConfig)
    """The face that pushes."""


ConfigT = TypeVar("ConfigT", bound=PushingConfig)


class PushingController(Controller, Generic[ConfigT]):
    """Pushes what its face touches to a target; a subclass decides how.

    Args:
        config: the options.
    """

    Config = PushingConfig

    def __init__(self, config: ConfigT) -> None:
        super().__init__(config)
        self.options = config
        self._waits_since = math.inf
        self.reset()

    @abstractmethod
    def decide(
        self, touch: FaceContact | None, pose: PlanarPose, now: float, side: float = 0.0
    ) -> Decision:
        """Decide what to do next.

        Args:
            touch: where the object touches the face, or None.
            pose: of the robot.
            now: the stamp of the step [s].
            side: 1.0 if something touches the robot's left side, -1.0 if its right, else 0.0.
        """

    def command(self, contacts: Sequence[Contact], state: State) -> Command:
        """Give the twist that follows from the contacts of one step.

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
        place = float(pose[0, 3]), float(pose[1, 3]), math.atan2(pose[1, 0], pose[0, 0])
        face = self.options.face
        one = self.decide(on_face(contacts, face), place, state.now, beside(contacts, face))
        twist = Twist(
            stamp=state.now,
            frame=face.frame,
            linear=np.array([one.ahead, one.aside, 0.0]),
            angular=np.array([0.0, 0.0, one.turn]),
        )
        return Command(twist=twist, mode=one.mode, reason=one.reason)
