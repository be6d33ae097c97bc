"""The contract of controllers: contacts in, commands out."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from contactfusion.contacts import Contact
from contactfusion.model import Model
from contactfusion.readings import Twist
from contactfusion.state import State

FAULT = "fault"
"""The mode of the command in place of one that a controller failed to give: the robot stands."""


@dataclass(frozen=True, eq=False)
class Command:
    """The motion of the robot until the next command; a field that is None commands nothing.

    Attributes:
        twist: the velocity of the base or hand.
        joint_velocities: by joint [rad/s, m/s].
        gripper: from 0, open, to 1, closed.
        mode: the state of the controller, e.g. "push", "realign", "search".
        reason: of the motion, in a few words.
    """

    twist: Twist | None = None
    joint_velocities: Mapping[str, float] | None = None
    gripper: float | None = None
    mode: str = ""
    reason: str = ""

    def __post_init__(self) -> None:
        """Check what a robot would follow.

        Raises:
            TypeError: `twist` is none.
            ValueError: a velocity of a joint, or the gripper, is no finite number.
        """
        twist: object = self.twist
        if not isinstance(twist, Twist | None):
            raise TypeError(f"its twist is {type(twist).__name__}, not a Twist")
        speeds = dict(self.joint_velocities or {})
        if wrong := [name for name, speed in speeds.items() if not math.isfinite(speed)]:
            raise ValueError(f"the velocity of {', '.join(wrong)} is no finite number")
        if self.gripper is not None and not math.isfinite(self.gripper):
            raise ValueError(f"the gripper is commanded {self.gripper}")


class Controller(ABC):
    """Turns contacts into commands, by contacts and the state only.

    Args:
        config: the options, an instance of `Config`.
    """

    Config: ClassVar[type[Model]] = Model
    """The type of the options."""

    def __init__(self, config: Model) -> None:
        self.config = config

    @abstractmethod
    def command(self, contacts: Sequence[Contact], state: State) -> Command:
        """The command that follows from the contacts of one step.

        Args:
            contacts: the most likely first, in the grid's frame.
            state: the robot at the step.
        """

    def reset(self) -> None:
        """Drop all state of earlier steps."""
        return None
