"""A push by configuration: what is pushed, from where, to where, and how well it is felt."""

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.model import Model
from contactfusion.simulation.push_objects import FRICTIONS, PAPER, AnyObject

RATE = 240
"""Steps of the physics a second."""
Distance = Annotated[float, Field(ge=-100, le=100)]


class FrictionConfig(Model):
    """Coulomb friction between object and ground, and between object and robot."""

    ground: float = Field(gt=0, le=2)
    """Between object and ground."""
    robot: float = Field(ge=0, le=2)
    """Between object and robot."""


def _friction(value: Any) -> Any:
    """Take the name of a known pair for the pair."""
    if not isinstance(value, str):
        return value
    if value not in FRICTIONS:
        hint = name_hint(value, FRICTIONS, "frictions")
        raise ConfigurationError(f"unknown friction '{value}'; {hint}")
    ground, robot = FRICTIONS[value]
    return {"ground": ground, "robot": robot}


class SkinConfig(Model):
    """How well the skin feels."""

    activation: float = Field(default=1.0, ge=0)
    """A taxel that is pressed by less on average over a cycle tells nothing [N]."""
    noise: float = Field(default=0.05, gt=0)
    """Standard deviation of each value [N]."""


class PushConfig(Model):
    """A base pushes an object to a target; the first contact of a nominal start is at (0, 0).

    Frames: `odom` on the floor, x ahead at the start; the robot's front stands at its x = 0.
    """

    type: Literal["push"] = "push"
    """The kind of scene."""
    object: AnyObject = Field(default_factory=lambda: PAPER["box"], validate_default=True)
    """What is pushed: `box`, `cylinder`, `nonuniform`, `lshape`, `prism`, `light_cylinder`, or the
    fields of one."""
    friction: Annotated[FrictionConfig, BeforeValidator(_friction)] = Field(
        default="mu1", validate_default=True
    )
    """`mu1`, `mu2`, or `ground` and `robot`."""
    target: tuple[Distance, Distance]
    """Where the contact shall come to [m]."""
    offset: float = Field(default=0.0, ge=-5, le=5)
    """How far the object stands to the left of the robot's middle [m]."""
    yaw: float = Field(default=0.0, ge=-360, le=360)
    """How the object is turned [degrees]."""
    gap: float = Field(default=0.001, ge=0, le=2)
    """Between the robot's front and the object [m]."""
    skin: SkinConfig = Field(default_factory=SkinConfig)
    """How well the skin feels."""
    period: float = Field(default=0.1, ge=0.05, le=1)
    """Between commands, and between readings: whole steps of the physics, 1/240 s each [s]."""
    window: bool = False
    """Show PyBullet's window; needs a screen."""
    longest: float = Field(default=300.0, gt=0)
    """The push ends after so long [s]."""
    longest_lost: float = Field(default=150.0, gt=0)
    """It ends when there was no contact for so long, all in all [s]."""
    furthest: float = Field(default=6.0, gt=0)
    """It ends when the object is further than this from the origin [m]."""
    within: float = Field(default=0.05, gt=0)
    """So near to the target the contact has arrived [m]."""

    @field_validator("period")
    @classmethod
    def _whole_steps(cls, period: float) -> float:
        if abs(period * RATE - round(period * RATE)) > 1e-6:
            raise ValueError(f"the physics takes {RATE} steps a second; the period is whole steps")
        return period

    @model_validator(mode="after")
    def _reachable(self) -> "PushConfig":
        reach = math.hypot(*self.target)
        if reach > self.furthest - 1.0:
            raise ConfigurationError(
                f"{self.target} is out of reach: a push ends when the object is further than "
                f"`furthest` {self.furthest:g} m away, and the object needs room",
                "target",
            )
        return self
