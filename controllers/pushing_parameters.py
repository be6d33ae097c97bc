"""The parameters of reactive pushing, and the sets that have names."""

from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, model_validator

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.model import Model
from contactfusion.units import Memory, Reach, Speed

Positive = Annotated[float, Field(gt=0)]
Length = Annotated[Reach, Field(gt=0)]
Pause = Annotated[Memory, Field(gt=0)]
Pace = Annotated[Speed, Field(gt=0)]


class RealignmentParameters(Model):
    """When the contact is near an edge of the face: mostly aside, hardly turning."""

    enter: Length
    """l_cr: it begins when |l| is above this [m]."""
    leave: Length
    """It ends when |l| is below this [m]."""
    rate: Positive
    """a_r meanwhile."""
    turning: float | None = Field(default=None, ge=0, le=1)
    """ω is multiplied by this; None: by 1 - |l|/l_cr, or 0 where that is negative."""

    @model_validator(mode="after")
    def _hysteresis(self) -> Self:
        if self.leave > self.enter:
            raise ConfigurationError("may not be above `enter`", "leave")
        return self


class SearchParameters(Model):
    """How to look for a contact that is lost; not in the papers."""

    patience: Memory = Field(ge=0)
    """Before, the last contact counts for so long [s]."""
    speed: Pace
    """Of the search [m/s]."""
    clearance: Length
    """Back off until the place of the last contact is so far ahead of the face [m]."""
    beyond: Length
    """Then go ahead until the face is so far beyond it; each round further by as much [m]."""
    shift: Length
    """A round of tries goes straight, then by so much to one side, and to the other [m]."""


class EscapeParameters(Model):
    """How to leave a cycle that leads nowhere: go around the object; not in the papers."""

    patience: Pause
    """Without progress for so long [s]."""
    progress: Length
    """Coming nearer to the target than ever by so much is progress [m]."""
    within: Reach = Field(ge=0)
    """Or at once when it was nearer to the target than this [m],"""
    overshoot: Length
    """and is so much further away again [m]."""
    clearance: Length
    """Back off until the place of the contact is so far ahead of the face [m]."""
    reach: Reach = Field(ge=0)
    """The middle of the object is believed to be so far beyond the contact [m]."""
    speed: Pace
    """Of going around [m/s]."""


class PushingParameters(Model):
    """The parameters of reactive pushing, by the letters of O §II-B."""

    speed_gain: Positive
    """K_v [1/s]."""
    slowest: Speed = Field(ge=0)
    """The least speed before arrival [m/s]."""
    fastest: Pace
    """The greatest speed [m/s]."""
    eta: float = Field(ge=0)
    """η, the lateral rate far from the middle."""
    zeta: float = Field(ge=0)
    """ζ, the lateral rate at the middle."""
    beta: Reach = Field(ge=0)
    """β, where the rate is halfway between [m]."""
    k: Positive
    """How steep the rate changes there [1/m]."""
    near: Reach = Field(ge=0)
    """d_th: nearer to the target than this there is no lateral motion [m]."""
    heading_gain: float = Field(gt=0, le=1)
    """K_h; the heading's error times this is limited to below 90 degrees."""
    length: Length
    """L, the smaller the sharper it turns [m]."""
    fastest_turn: Positive
    """The greatest ω [rad/s]."""
    realign: RealignmentParameters | None
    """Near the edge; None: never."""
    settle: Reach = Field(default=0.0, ge=0)
    """Nearer to the target than this the greatest ω falls with the distance; 0: never [m]. Not in
    the papers."""
    smoothing: Memory = Field(default=0.0, ge=0)
    """Time constant of a low-pass on l [s]; 0: none. Not in the papers."""
    search: SearchParameters | None = None
    """How to look for a lost contact; None: keep it, and go ahead."""
    escape: EscapeParameters | None = None
    """How to leave a cycle; None: never."""
    arrival: Length
    """The contact has arrived when it is so near to the target [m]."""

    @model_validator(mode="after")
    def _speeds(self) -> Self:
        if self.slowest > self.fastest:
            raise ConfigurationError("may not be above `fastest`", "slowest")
        return self


_PAPER = PushingParameters(
    speed_gain=0.1,
    slowest=0.0,
    fastest=0.05,
    eta=10.0,
    zeta=0.0,
    beta=0.12,
    k=60.0,
    near=0.50,
    heading_gain=1.0,
    length=0.2,
    fastest_turn=0.15,
    realign=RealignmentParameters(enter=0.24, leave=0.12, rate=10.0),
    arrival=0.05,
)
_TUNED = PushingParameters(
    speed_gain=0.373,
    slowest=0.086,
    fastest=0.302,
    eta=3.608,
    zeta=0.0,
    beta=0.121,
    k=37.25,
    near=0.5,
    heading_gain=0.45,
    length=0.04,
    fastest_turn=0.439,
    realign=RealignmentParameters(enter=0.26, leave=0.11, rate=4.893, turning=0.127),
    settle=2.0,
    smoothing=0.088,
    search=SearchParameters(patience=0.3, speed=0.25, clearance=0.15, beyond=0.3, shift=0.3),
    escape=EscapeParameters(
        patience=8.0,
        progress=0.02,
        within=0.5,
        overshoot=0.05,
        clearance=0.2,
        reach=0.25,
        speed=0.3,
    ),
    arrival=0.035,
)
_STILL: dict[str, Any] = {"eta": 0.0, "zeta": 0.0}
_NO_REALIGNMENT: dict[str, Any] = {"realign": None}

SETS: dict[str, PushingParameters] = {
    "paper": _PAPER,
    "tuned": _TUNED,
    **{
        f"{name}_{part}": parameters.model_copy(update=changes)
        for name, parameters in (("paper", _PAPER), ("tuned", _TUNED))
        for part, changes in (
            ("lateral_only", _NO_REALIGNMENT),
            ("realign_only", _STILL),
            ("neither", _STILL | _NO_REALIGNMENT),
        )
    },
}
"""By name; `paper_neither` is the strategy without lateral motion and without realignment that the
authors compare with."""


def _named(value: Any) -> Any:
    """Take a name, or fields that change the set of the name `like`."""
    if isinstance(value, PushingParameters):
        return value
    changes = dict(value) if isinstance(value, dict) else {"like": value}
    name = changes.pop("like", None)
    if name is None:
        return changes
    if not isinstance(name, str) or name not in SETS:
        raise ConfigurationError(f"unknown set '{name}'; {name_hint(str(name), SETS, 'sets')}")
    return {**SETS[name].model_dump(), **changes}


NamedParameters = Annotated[PushingParameters, BeforeValidator(_named)]
