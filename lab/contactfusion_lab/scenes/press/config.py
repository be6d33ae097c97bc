"""An arm that is pressed, by configuration."""

from typing import Literal

from pydantic import Field

from contactfusion.model import Model
from contactfusion.units import Force, Seconds
from contactfusion_lab.scenes.noise import TouchNoise
from contactfusion_lab.scenes.press.drives import DrivesConfig
from contactfusion_lab.scenes.ranges import AnyRange


class PressConfig(Model):
    """An arm moves in free air until it meets probes that press on it, and moves on.

    Where a range is given, a value is drawn from it, uniformly.
    """

    type: Literal["press"] = "press"
    """The kind of scene."""
    tool: str
    """The link that the arm moves."""
    links: tuple[str, ...] = ()
    """The links that may be pressed; none given: all that two joints or more move."""
    places: int = Field(default=1, ge=0, le=2)
    """Number of places that are pressed; of two the second is on the tool or beyond. With none the
    arm goes from posture to posture."""
    press: Force = Field(default=10.0, gt=0)
    """Force of each probe along its guide [N]; friction adds to it."""
    speed: AnyRange = (0.05, 0.25)
    """Speed of the fastest joint [rad/s]."""
    lead: Seconds = Field(default=1.0, gt=0)
    """Time in free motion before the probes come [s]."""
    hold: Seconds = Field(default=0.3, gt=0)
    """Time for which they press [s]."""
    seconds: Seconds = Field(default=10.0, gt=0)
    """Length of a motion without any [s]."""
    stiffness: float = Field(default=2000.0, gt=0)
    """Stiffness of the joints [N·m/rad]."""
    friction: float = Field(default=0.5, ge=0)
    """Coefficient of friction between probes and arm."""
    rate: float = Field(default=100.0, gt=0, le=1000)
    """Rate of joints and wrenches [Hz]."""
    camera_rate: float = Field(default=4.0, gt=0, le=1000)
    """Rate of the images of each camera [Hz]."""
    drives: DrivesConfig
    """How the joints err."""
    specimen: int = Field(default=0, ge=0)
    """Number of the arm among others of its kind: inertias, friction and zeros are drawn by it."""
    noise: TouchNoise = Field(default_factory=lambda: TouchNoise.model_validate("prototype"))
    """Errors of wrist and cameras, by name or field as in a `touch`."""
