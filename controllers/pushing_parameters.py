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
    """Realignment of a contact near an edge of the face: mostly lateral motion, hardly any yaw."""

    enter: Length
    """l_cr: |l| above which it begins [m]."""
    leave: Length
    """|l| below which it ends [m]."""
    rate: Positive
    """a_r meanwhile."""
    turning: float | None = Field(default=None, ge=0, le=1)
    """Factor of ω; None: 1 - |l|/l_cr, or 0 where that is negative."""

    @model_validator(mode="after")
    def _hysteresis(self) -> Self:
        if self.leave > self.enter:
            raise ConfigurationError("may not be above `enter`", "leave")
        return self


class SearchParameters(Model):
    """Search for a lost contact; not in the papers."""

    patience: Memory = Field(ge=0)
    """Time for which the last contact counts before the search [s]."""
    speed: Pace
    """Speed of the search [m/s]."""
    clearance: Length
    """Distance of the last contact forward of the face to which the robot backs off [m]."""
    beyond: Length
    """Distance by which the face then moves past it; each round adds as much [m]."""
    shift: Length
    """Lateral shift of the second try of a round, and of the third to the other side [m]."""


class EscapeParameters(Model):
    """Escape from a cycle without progress, around the object; not in the papers."""

    patience: Pause
    """Time without progress before the escape [s]."""
    progress: Length
    """Decrease of the least distance to the target that is progress [m]."""
    within: Reach = Field(ge=0)
    """Immediate escape once the robot was nearer to the target than this [m],"""
    overshoot: Length
    """and is further away again by this [m]."""
    clearance: Length
    """Distance of the contact forward of the face to which the robot backs off [m]."""
    reach: Reach = Field(ge=0)
    """Believed distance of the object's centre beyond the contact [m]."""
    speed: Pace
    """Speed of the escape [m/s]."""


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
    """β, the |l| of half the change of the rate [m]."""
    k: Positive
    """Steepness of the change of the rate there [1/m]."""
    near: Reach = Field(ge=0)
    """d_th: the distance to the target below which there is no lateral motion [m]."""
    heading_gain: float = Field(gt=0, le=1)
    """K_h; the heading's error times this is limited to below 90 degrees."""
    length: Length
    """L; a smaller one turns sharper [m]."""
    fastest_turn: Positive
    """The greatest ω [rad/s]."""
    realign: RealignmentParameters | None
    """Realignment near an edge of the face; None: never."""
    settle: Reach = Field(default=0.0, ge=0)
    """Distance to the target below which the greatest ω falls in proportion; 0: never [m]. Not in
    the papers."""
    smoothing: Memory = Field(default=0.0, ge=0)
    """Time constant of a low-pass on l [s]; 0: none. Not in the papers."""
    search: SearchParameters | None = None
    """Search for a lost contact; None: keep the last one, and move forward."""
    escape: EscapeParameters | None = None
    """Escape from a cycle; None: never."""
    arrival: Length
    """Distance of the contact from the target at which it has arrived [m]."""

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
"""The sets by name; `paper_neither` is the strategy without lateral motion and without realignment
with which the authors compare."""


def _named(value: Any) -> Any:
    """A set by name, or by fields that change the set named `like`."""
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
