"""A push by configuration: what is pushed, from where, to where, and how well it is felt."""

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.model import Model
from contactfusion.units import Limit, Reach, Spread
from contactfusion_lab.simulation.push_disturbances import DisturbanceConfig
from contactfusion_lab.simulation.push_names import FRICTIONS, PAPER, AnyObject
from contactfusion_lab.simulation.push_shapes import SoftConfig

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
    """The skin: its pad, and how well it feels."""

    pad: SoftConfig | None = Field(
        default_factory=lambda: SoftConfig(stiffness=10_000.0, damping=400.0)
    )
    """How it gives way, over the whole height of the front; None: it is hard. Two hard faces
    rattle: of a flat contact now one end touches and now the other."""

    activation: float = Field(default=1.0, ge=0)
    """A taxel that is pressed by less on average over a cycle tells nothing [N]."""
    noise: float = Field(default=0.05, gt=0)
    """Standard deviation of each value [N]."""


class LidarNoise(Model):
    """How wrong LiDARs are, as recordings of real ones show it."""

    range: float = Field(default=0.0035, ge=0)
    """Standard deviation of a range [m]."""
    dropout: float = Field(default=0.014, ge=0, le=0.5)
    """The part of all measurements that have no return though something is there."""
    jumps: float = Field(default=0.008, ge=0, le=0.5)
    """The part of all measurements whose range jumps."""
    jump: float = Field(default=0.3, ge=0)
    """By so much at most, either way [m]."""


class CameraNoise(Model):
    """How wrong depth cameras are; the defaults are those of a RealSense D435i."""

    disparity: float = Field(default=0.08, ge=0)
    """Standard deviation of what each pixel is shifted between left and right imager [pixels]."""
    baseline: float = Field(default=0.05, gt=0)
    """Between the imagers [m]."""
    focal: float = Field(default=615.0, gt=0)
    """Of the imagers [pixels]; smaller images are thinned from theirs. A depth z is off by
    z² disparity / (focal baseline)."""
    unit: float = Field(default=0.001, gt=0)
    """Depths are whole multiples of this [m]."""
    holes: float = Field(default=0.01, ge=0, le=0.5)
    """The part of all pixels that have no depth."""
    edges: float = Field(default=0.5, ge=0, le=1)
    """The part of those beside a step in depth that have none."""
    colour: float = Field(default=6.0, ge=0)
    """Standard deviation of red, green and blue, of 255."""


class MisplacedConfig(Model):
    """How far off a sensor truly is from where its frame says, in directions that chance draws."""

    mm: float = Field(default=0.0, ge=0, le=1000)
    """[mm]."""
    degrees: float = Field(default=0.0, ge=0, le=90)
    """About an axis through the sensor [degrees]."""


class PushConfig(Model):
    """A base pushes an object to a target; the first contact of a nominal start is at (0, 0).

    Frames: `odom` on the floor, x ahead at the start; the robot's front stands at its x = 0.
    """

    type: Literal["push"] = "push"
    """The kind of scene."""
    object: AnyObject = Field(default_factory=lambda: PAPER["box"], validate_default=True)
    """What is pushed, by name, such as `box` or `soft_cylinder`, or the fields of one."""
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
    gap: Reach = Field(default=0.001, ge=0, le=2)
    """Between the robot's front and the object [m]."""
    disturbances: tuple[DisturbanceConfig, ...] = ()
    """How somebody else shoves the object, besides what the object itself says."""
    skin: SkinConfig = Field(default_factory=SkinConfig)
    """The skin: its pad, and how well it feels."""
    sees: tuple[str, ...] = ()
    """The LiDARs and cameras of the robot that are switched on, by name."""
    lidar_noise: LidarNoise = Field(default_factory=LidarNoise)
    """How wrong LiDARs are."""
    camera_noise: CameraNoise = Field(default_factory=CameraNoise)
    """How wrong cameras are."""
    misplaced: dict[str, MisplacedConfig] = Field(default_factory=dict)
    """How far LiDARs and cameras that are switched on truly are from where the robot's description
    has them, by name."""
    period: float = Field(default=0.1, ge=0.05, le=1)
    """Between commands, and between readings: whole steps of the physics, 1/240 s each [s]."""
    window: bool = False
    """Show PyBullet's window; needs a screen."""
    longest: Limit = Field(default=300.0, gt=0)
    """The push ends after so long [s]."""
    longest_lost: Limit = Field(default=150.0, gt=0)
    """It ends when there was no contact for so long, all in all [s]."""
    furthest: float = Field(default=6.0, gt=0)
    """It ends when the object is further than this from the origin [m]."""
    within: Spread = Field(default=0.05, gt=0)
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
