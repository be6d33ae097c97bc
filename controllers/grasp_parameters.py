"""The options of `reactive_grasp`, and the names of its states."""

from collections.abc import Mapping
from enum import StrEnum

from pydantic import Field, model_validator

from contactfusion.controllers.grasp_contact import HandConfig
from contactfusion.errors import ConfigurationError
from contactfusion.model import Model
from contactfusion.units import Limit, Memory, Reach, Speed

Range = tuple[float, float]


class GraspMode(StrEnum):
    """The states of a grasp; those from `LIFTED` on are ends, in which the arm stands still."""

    WAIT = "wait"
    """Where the joints are is not known yet."""
    OPEN = "open"
    """The gripper opens; after an attempt that has missed the hand goes back, too."""
    APPROACH = "approach"
    """The hand goes ahead until it is touched."""
    BACK = "back"
    """It goes back from a contact that is not where it should be."""
    ASIDE = "aside"
    """It goes sideways, as the place of the contact says."""
    ENTER = "enter"
    """What touches it is between the fingers: it goes on until that is deep enough, unheeding."""
    CLOSE = "close"
    """The gripper closes, until its joints rest."""
    LIFT = "lift"
    """The hand goes up."""
    LOWER = "lower"
    """It comes no higher: it puts down again what it holds."""
    HOLD = "hold"
    """It stands, for as long as a grasp has to hold."""
    RETREAT = "retreat"
    """The grasp has failed: the gripper opens, and the hand goes straight back, as it came."""
    LIFTED = "lifted"
    """The object is held."""
    MISSED = "missed"
    """The gripper closed on nothing."""
    DROPPED = "dropped"
    """The fingers closed further while the object was lifted or held: it has slipped out."""
    STUCK = "stuck"
    """A finger does not follow its commands."""
    OBSTRUCTED = "obstructed"
    """Whatever the hand did, it was touched from below or above, as by the table."""
    BLOCKED = "blocked"
    """The hand does not move as it is told: something is in its way, or it is out of reach."""
    TIMEOUT = "timeout"
    """It took too long."""
    BLIND = "blind"
    """The joints are silent: the hand stops where it is."""


ENDS = tuple(GraspMode)[tuple(GraspMode).index(GraspMode.LIFTED) :]
"""The states in which a grasp has ended."""


class ReactiveGraspConfig(Model):
    """The options of `reactive_grasp`.

    In the frame of the tool x is aside, y up, and z ahead.
    """

    tool: str
    """The link that is led."""
    gripper: dict[str, Range] = Field(min_length=1)
    """The joints of the fingers: where they are when the gripper is open, and when it is closed on
    nothing [rad, m]."""
    reach: Reach = Field(default=0.22, gt=0)
    """So far ahead of the start an object would lie in the palm; the hand goes no further [m]."""
    inside: Reach = Field(default=0.028, gt=0)
    """An object whose middle is so little aside goes between the fingers [m]."""
    depth: Reach = Field(default=0.135, gt=0)
    """So far ahead of the tool's origin the middle of an object should be when the gripper closes
    [m]."""
    confirm: int = Field(default=3, ge=1)
    """A decision is made by the typical one of so many contacts, step by step."""
    hand: HandConfig = Field(default_factory=HandConfig)
    """Where contacts are the hand's, and where the object should be."""
    corrections: int = Field(default=8, ge=0)
    """So often the hand is corrected at most; 0: it goes ahead and closes, whatever it feels."""
    attempts: int = Field(default=3, ge=1)
    """So often the gripper closes at most when it closes on nothing."""
    back: Reach = Field(default=0.04, gt=0)
    """So far it goes back before it is corrected; before a further attempt twice as far [m]."""
    aside: Reach = Field(default=0.06, gt=0)
    """So far it goes sideways at most at once [m]."""
    raised: Reach = Field(default=0.02, gt=0)
    """So far it goes up, or down, from what touches it from below, or above [m]."""
    speed: Speed = Field(default=0.05, gt=0)
    """Of the hand [m/s]."""
    lift: Reach = Field(default=0.13, gt=0)
    """How high [m]."""
    hold: Memory = Field(default=2.5, ge=0)
    """How long the object is held before the grasp has succeeded [s]."""
    settle: Memory = Field(default=0.4, ge=0)
    """Contacts count so long after the hand has begun to move: the wrist feels its own jerk [s]."""
    empty: float = Field(default=0.9, gt=0, le=1)
    """Fingers of which each joint has come this part of its way have closed on nothing."""
    slip: float = Field(default=0.12, gt=0, lt=1)
    """What is held has slipped when a joint of the fingers goes on by this part of its way."""
    resting: float = Field(default=0.05, gt=0)
    """A joint of the fingers that is slower rests [rad/s, m/s]."""
    closing: Memory = Field(default=4.0, gt=0)
    """Fingers that tremble for so long are as closed as they will be [s]."""
    patience: Memory = Field(default=1.5, gt=0)
    """The hand is blocked when it comes no nearer to its goal for so long [s]."""
    longest: Limit = Field(default=50.0, gt=0)
    """The grasp is given up after so long [s]."""

    @model_validator(mode="after")
    def _closes(self) -> "ReactiveGraspConfig":
        require_way(self.gripper)
        return self


def require_way(gripper: Mapping[str, Range]) -> None:
    """Make sure that every joint of a gripper moves when it closes.

    Raises:
        ConfigurationError: one is open and closed at the same place.
    """
    for name, (opened, closed) in gripper.items():
        if opened == closed:
            raise ConfigurationError(
                f"open and closed it is at {opened:g}: it does not move", f"gripper.{name}"
            )
