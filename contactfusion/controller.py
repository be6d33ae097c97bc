"""The contract of controllers: contacts in, commands out."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from contactfusion.contacts import Contact
from contactfusion.model import Model
from contactfusion.readings import Twist
from contactfusion.state import State


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
