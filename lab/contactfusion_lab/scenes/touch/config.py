"""A touch by configuration: what is touched, from where, and how well it is felt."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.model import Model
from contactfusion.robots.objects import ObjectConfig
from contactfusion.units import Force, Reach, Speed
from contactfusion_lab.scenes.noise import TouchNoise

Range = tuple[float, float]


def _range(value: Any) -> Any:
    """Take one number for a range of one."""
    return (value, value) if isinstance(value, int | float) else value


def _ordered(value: Range) -> Range:
    if value[1] < value[0]:
        raise ValueError("give the least, then the greatest")
    return value


AnyRange = Annotated[Range, BeforeValidator(_range), AfterValidator(_ordered)]


class TouchConfig(Model):
    """A robot moves a hand straight ahead until it touches, and holds still.

    Where a range is given, chance takes a value from it.
    """

    type: Literal["touch"] = "touch"
    """The kind of scene."""
    objects: dict[str, ObjectConfig] = Field(min_length=1)
    """What may be touched, where it is; it does not move."""
    surroundings: dict[str, ObjectConfig] = Field(default_factory=dict)
    """What else stands around, such as the table."""
    target: str | None = None
    """The object to touch, the only one that is there; None: the first."""
    tool: str
    """The link that is led, along its z."""
    hand: tuple[str, ...] = ()
    """The links that may touch; none: what hangs on the tool."""
    azimuth: AnyRange = (180.0, 180.0)
    """Where the hand comes from, seen from the object: about the z of the robot's root link, from
    its x [degrees]."""
    elevation: AnyRange = (45.0, 45.0)
    """How high above the horizon it comes from [degrees]."""
    roll: AnyRange = (-180.0, 180.0)
    """How it is turned about the way it goes; at 0 its x lies level [degrees]."""
    tilt: float = Field(default=15.0, ge=0, lt=90)
    """The hand may look past its way by so much [degrees]."""
    wander: float = Field(default=0.3, ge=0, le=0.5)
    """The hand may aim beside the middle of the object, by so much of its size."""
    posture: dict[str, AnyRange] = Field(default_factory=dict)
    """Where joints stand, or may stand: those of the hand for good, those of the arm where the
    search for a way begins [rad, m]; the others are at 0, or where they are `still`."""
    short: Reach = Field(default=0.0, ge=0)
    """Stop so much before the first touch [m]; 0: touch."""
    speed: Speed = Field(default=0.05, gt=0)
    """Of the hand [m/s]."""
    press: Force = Field(default=6.0, gt=0)
    """The hand stops when it is pushed by so much [N]."""
    arm_stiffness: float = Field(default=400.0, gt=0)
    """How the joints that lead the tool yield [N·m/rad, N/m]."""
    friction: float = Field(default=0.5, ge=0)
    """Between hand and object."""
    camera_rate: float = Field(default=4.0, gt=0, le=1000)
    """Of the images of each camera [Hz]."""
    noise: TouchNoise = Field(default_factory=lambda: TouchNoise.model_validate("prototype"))
    """How wrong the sensors are: `none`, `prototype`, `full`, or the fields of `TouchNoise`."""

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
