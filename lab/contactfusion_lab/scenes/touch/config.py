"""A touch by configuration: objects, directions of approach, and errors of the sensors."""

from typing import Literal

from pydantic import Field, model_validator

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.model import Model
from contactfusion.robots.objects import ObjectConfig
from contactfusion.units import Force, Reach, Speed
from contactfusion_lab.scenes.noise import TouchNoise
from contactfusion_lab.scenes.ranges import AnyRange


class TouchConfig(Model):
    """A robot moves a hand straight forward until it touches, and holds still.

    Where a range is given, a value is drawn from it, uniformly.
    """

    type: Literal["touch"] = "touch"
    """The kind of scene."""
    objects: dict[str, ObjectConfig] = Field(min_length=1)
    """Objects that may be touched, with their true poses; they do not move."""
    surroundings: dict[str, ObjectConfig] = Field(default_factory=dict)
    """Other fixed objects, such as the table."""
    target: str | None = None
    """The object to touch, the only one of them that is there; None: the first."""
    tool: str
    """The link that moves, along its z."""
    hand: tuple[str, ...] = ()
    """The links that may touch; none given: the tool and all links beyond it."""
    azimuth: AnyRange = (180.0, 180.0)
    """Direction from the object to the hand: about the z of the robot's root link, from its x
    [degrees]."""
    elevation: AnyRange = (45.0, 45.0)
    """Elevation of that direction above the horizon [degrees]."""
    roll: AnyRange = (-180.0, 180.0)
    """Rotation of the hand about its path; at 0 its x lies level [degrees]."""
    tilt: float = Field(default=15.0, ge=0, lt=90)
    """Greatest deviation of the path from that direction [degrees]."""
    wander: float = Field(default=0.3, ge=0, le=0.5)
    """Greatest distance of the point aimed at from the middle of the object, as a share of its
    size."""
    posture: dict[str, AnyRange] = Field(default_factory=dict)
    """Joint positions or their ranges: of the hand as they stay, of the arm as the initial guess of
    the inverse kinematics [rad, m]; the others are at 0, or where they are `still`."""
    short: Reach = Field(default=0.0, ge=0)
    """Distance before the first touch at which the hand stops [m]; 0: it touches."""
    places: int = Field(default=1, ge=1, le=5)
    """Number of places at which the hand is touched: probes press on its skin beside the object."""
    speed: Speed = Field(default=0.05, gt=0)
    """Of the hand [m/s]."""
    press: Force = Field(default=6.0, gt=0)
    """Contact force at which the hand stops, and with which each probe presses [N]."""
    arm_stiffness: float = Field(default=400.0, gt=0)
    """Stiffness of the joints that move the tool [N·m/rad, N/m]."""
    friction: float = Field(default=0.5, ge=0)
    """Coefficient of friction between hand and object."""
    camera_rate: float = Field(default=4.0, gt=0, le=1000)
    """Rate of the images of each camera [Hz]."""
    noise: TouchNoise = Field(default_factory=lambda: TouchNoise.model_validate("prototype"))
    """Errors of the sensors and of the world: `none`, `prototype`, `full`, `hard`, such as
    `prototype+wrist`, or the fields of `TouchNoise`."""

    @model_validator(mode="after")
    def _known(self) -> "TouchConfig":
        if self.target is not None and self.target not in self.objects:
            hint = name_hint(self.target, self.objects, "objects")
            raise ConfigurationError(f"unknown object '{self.target}'; {hint}", "target")
        for name in self.objects.keys() & self.surroundings.keys():
            raise ConfigurationError("an object has this name already", f"surroundings.{name}")
        return self

    @property
    def touched(self) -> str:
        """The object to touch."""
        return self.target if self.target is not None else next(iter(self.objects))
