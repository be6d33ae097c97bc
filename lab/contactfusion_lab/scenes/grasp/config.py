"""A grasp by configuration: what stands where on the table, and how well it is felt."""

from typing import Literal

from pydantic import Field, model_validator

from contactfusion.controllers.grasp_parameters import require_way
from contactfusion.errors import ConfigurationError
from contactfusion.model import Model
from contactfusion.robots.objects import ObjectConfig
from contactfusion.units import Limit, Load, Memory, Nearby, Reach
from contactfusion_lab.scenes.noise import TouchNoise
from contactfusion_lab.scenes.touch.config import AnyRange


class GraspConfig(Model):
    """A hand goes ahead to where an object is believed to stand, and lifts it.

    The z of the robot's root link points up. Where a range is given, chance takes a value from it.
    """

    type: Literal["grasp"] = "grasp"
    """The kind of scene."""
    object: ObjectConfig
    """What is grasped, standing where it is believed to stand; it may move."""
    mass: Load | None = Field(default=None, gt=0)
    """Of the object [kg], spread evenly over its shapes; None: as its URDF says."""
    surroundings: dict[str, ObjectConfig] = Field(default_factory=dict)
    """What else stands around, such as the table; it does not move."""
    tool: str
    """The link that is led; its z points ahead, its x aside."""
    gripper: dict[str, tuple[float, float]] = Field(min_length=1)
    """The joints of the fingers: where they are when the gripper is open, and when it is closed on
    nothing [rad, m]."""
    begin: float = Field(default=0.3, ge=0, le=1)
    """How far the gripper is closed at the start."""
    posture: dict[str, float] = Field(default_factory=dict)
    """Where joints of the arm stand when the search for the start begins; others: 0 [rad, m]."""
    azimuth: AnyRange = (180.0, 180.0)
    """Where the hand comes from, seen from where the object is believed to stand: about the z of
    the root link, from its x [degrees]."""
    height: Nearby = 0.09
    """So high above the origin of the object the tool goes, level [m]."""
    distance: Reach = Field(default=0.3, gt=0)
    """Of the tool's origin from the axis of the object at the start, level [m]."""
    offset: AnyRange = (-0.05, 0.05)
    """How far beside the hand's way the object truly stands, to the left as the hand goes [m]."""
    yaw: AnyRange = (-30.0, 30.0)
    """How far it is truly turned about the vertical [degrees]."""
    friction: float = Field(default=0.6, gt=0)
    """Between hand and object."""
    table_friction: float = Field(default=0.3, gt=0)
    """Between the object and what it stands on."""
    arm_stiffness: float = Field(default=400.0, gt=0)
    """How the joints that lead the tool yield [N·m/rad, N/m]."""
    grip: float = Field(default=1.0, gt=0)
    """The greatest torque with which the joints of the fingers close [N·m, N]."""
    stuck: dict[str, float] = Field(default_factory=dict)
    """Joints of fingers that never leave a position, as they are broken [rad, m]."""
    camera_rate: float = Field(default=0.0, ge=0, le=20)
    """Of the images of each camera [Hz]; 0: cameras are off."""
    wrench_range: tuple[float, float] | None = None
    """No component of force [N] and torque [N·m] reads more than these; None: any does."""
    noise: TouchNoise = Field(default_factory=lambda: TouchNoise.model_validate("prototype"))
    """How wrong the sensors are: `none`, `prototype`, `full`, or the fields of `TouchNoise`."""
    period: float = Field(default=0.05, ge=0.01, le=0.2)
    """Between commands, and between readings of joints and skins [s]."""
    lifted: Reach = Field(default=0.1, gt=0)
    """A grasp has succeeded when the object has been so much higher [m] ..."""
    held: Memory = Field(default=2.0, gt=0)
    """... for so long at the end [s]."""
    longest: Limit = Field(default=60.0, gt=0)
    """The grasp ends after so long [s]."""

    @model_validator(mode="after")
    def _fits(self) -> "GraspConfig":
        require_way(self.gripper)
        if self.mass is None and self.object.urdf is None:
            raise ConfigurationError("an object without a URDF needs its mass", "mass")
        if "object" in self.surroundings:
            raise ConfigurationError(
                "that is what the grasped object is called: give it another name",
                "surroundings.object",
            )
        for joint in self.stuck:
            if joint not in self.gripper:
                raise ConfigurationError(
                    f"only joints of the gripper may be stuck: {', '.join(self.gripper)}",
                    f"stuck.{joint}",
                )
        if self.wrench_range is not None and min(self.wrench_range) <= 0.0:
            raise ConfigurationError("give ranges greater than 0", "wrench_range")
        return self
