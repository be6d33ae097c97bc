"""The options of `reactive_grasp`, and its states."""

from collections.abc import Mapping
from enum import StrEnum

from pydantic import Field, model_validator

from contactfusion.controllers.grasp_contact import HandConfig
from contactfusion.controllers.grasp_load import LoadConfig
from contactfusion.errors import ConfigurationError
from contactfusion.model import Model
from contactfusion.units import Limit, Memory, Reach, Speed

Range = tuple[float, float]


class GraspMode(StrEnum):
    """The states of a grasp; those from `LIFTED` on are final, and the arm is at rest in them."""

    WAIT = "wait"
    """The joints' positions are not known yet."""
    OPEN = "open"
    """The gripper opens; after a missed attempt the hand also moves back."""
    APPROACH = "approach"
    """The hand moves forward until a contact."""
    BACK = "back"
    """It moves back from a contact that is not between the fingers."""
    ASIDE = "aside"
    """It moves laterally, by the position of the contact."""
    ENTER = "enter"
    """The contact is between the fingers: it moves forward to the grasp depth; contacts are
    ignored."""
    CLOSE = "close"
    """The gripper closes, until its joints are at rest."""
    LIFT = "lift"
    """The hand moves up."""
    LOWER = "lower"
    """It is blocked while it lifts, or the object slips: it puts the object down again."""
    HOLD = "hold"
    """It rests, for as long as a grasp has to hold."""
    RETREAT = "retreat"
    """The grasp has failed, or the object has slipped: the gripper opens, and the hand moves
    straight back."""
    LIFTED = "lifted"
    """The object is held."""
    MISSED = "missed"
    """The gripper closed on nothing."""
    DROPPED = "dropped"
    """The object has slipped while it was lifted or held."""
    STUCK = "stuck"
    """A finger does not follow its commands."""
    OBSTRUCTED = "obstructed"
    """All corrections ended in contacts from below or above, as by the table."""
    BLOCKED = "blocked"
    """The hand does not follow its commands: there is an obstacle, or the goal is out of reach."""
    TIMEOUT = "timeout"
    """The time limit was reached."""
    BLIND = "blind"
    """The joints are silent: the hand stops."""


ENDS = tuple(GraspMode)[tuple(GraspMode).index(GraspMode.LIFTED) :]
"""The final states."""


class ReactiveGraspConfig(Model):
    """The options of `reactive_grasp`.

    In the frame of the tool x is lateral, y up, and z forward.
    """

    tool: str
    """The controlled link."""
    gripper: dict[str, Range] = Field(min_length=1)
    """The joints of the fingers: their positions when the gripper is open, and when it is closed on
    nothing [rad, m]."""
    reach: Reach = Field(default=0.22, gt=0)
    """Distance forward of the start at which an object would touch the palm; the limit of the
    approach [m]."""
    inside: Reach = Field(default=0.028, gt=0)
    """The greatest lateral offset of an object's centre between the fingers [m]."""
    depth: Reach = Field(default=0.135, gt=0)
    """Distance of an object's centre forward of the tool's origin when the gripper closes [m]."""
    confirm: int = Field(default=3, ge=1)
    """Number of contacts, one a step, whose median decides."""
    hand: HandConfig = Field(default_factory=HandConfig)
    """The region of contacts on the hand, and the expected object."""
    corrections: int = Field(default=8, ge=0)
    """The greatest number of corrections; 0: the hand moves forward and closes, whatever it
    touches."""
    attempts: int = Field(default=3, ge=1)
    """The greatest number of times that the gripper closes: on nothing, or on what slips, by the
    wrist."""
    back: Reach = Field(default=0.04, gt=0)
    """Distance back before a correction; twice as far before a further attempt [m]."""
    aside: Reach = Field(default=0.06, gt=0)
    """The greatest lateral correction [m]."""
    raised: Reach = Field(default=0.02, gt=0)
    """Distance up, or down, from a contact below, or above [m]."""
    speed: Speed = Field(default=0.05, gt=0)
    """Speed of the hand [m/s]."""
    lift: Reach = Field(default=0.13, gt=0)
    """Height to which the object is lifted [m]."""
    hold: Memory = Field(default=2.5, ge=0)
    """Duration for which the object is held until the grasp has succeeded [s]."""
    settle: Memory = Field(default=0.4, ge=0)
    """Time after the start of a motion before contacts count: the wrist measures its own jerk
    [s]."""
    empty: float = Field(default=0.9, gt=0, le=1)
    """The share of its travel at which a joint of the fingers has closed on nothing, if all
    have."""
    slip: float = Field(default=0.12, gt=0, lt=1)
    """The further share of its travel by which a joint closes when the object has slipped; where
    the wrist weighs the load, that counts instead."""
    wrist: LoadConfig | None = None
    """How the wrist detects that the object slips; None: the fingers detect it alone."""
    resting: float = Field(default=0.05, gt=0)
    """The speed under which a joint of the fingers is at rest [rad/s, m/s]."""
    closing: Memory = Field(default=4.0, gt=0)
    """Time after which fingers that still tremble count as closed [s]."""
    patience: Memory = Field(default=1.5, gt=0)
    """Time without progress to its goal after which the hand is blocked [s]."""
    longest: Limit = Field(default=50.0, gt=0)
    """The time limit of a grasp [s]."""

    @model_validator(mode="after")
    def _closes(self) -> "ReactiveGraspConfig":
        require_way(self.gripper)
        return self


def require_way(gripper: Mapping[str, Range]) -> None:
    """Refuse a gripper with a joint that does not move when it closes.

    Raises:
        ConfigurationError: a joint is open and closed at the same position.
    """
    for name, (opened, closed) in gripper.items():
        if opened == closed:
            raise ConfigurationError(
                f"open and closed it is at {opened:g}: it does not move", f"gripper.{name}"
            )
