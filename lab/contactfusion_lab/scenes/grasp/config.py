"""A grasp by configuration: object, surroundings, gripper, and errors of the sensors."""

from typing import Literal

from pydantic import Field, model_validator

from contactfusion.controllers.grasp_parameters import require_way
from contactfusion.errors import ConfigurationError
from contactfusion.model import Model
from contactfusion.robots.objects import ObjectConfig
from contactfusion.units import Force, Limit, Load, Memory, Nearby, Reach
from contactfusion_lab.scenes.noise import TouchNoise
from contactfusion_lab.scenes.ranges import AnyRange


class GraspConfig(Model):
    """A hand goes forward to where an object is believed to stand, and lifts it.

    The z of the robot's root link points up. Where a range is given, a value is drawn from it,
    uniformly.
    """

    type: Literal["grasp"] = "grasp"
    """The kind of scene."""
    object: ObjectConfig
    """The object to grasp, at its believed pose; it may move."""
    mass: Load | None = Field(default=None, gt=0)
    """Mass of the object [kg], spread evenly over its shapes; None: that of its URDF."""
    surroundings: dict[str, ObjectConfig] = Field(default_factory=dict)
    """Fixed objects, such as the table."""
    tool: str
    """The link that moves; its z points forward, its x sideways."""
    gripper: dict[str, tuple[float, float]] = Field(min_length=1)
    """The joints of the fingers: positions of the open gripper, and of one closed on nothing
    [rad, m]."""
    begin: float = Field(default=0.3, ge=0, le=1)
    """Part by which the gripper is closed at the start, from 0 (open) to 1."""
    posture: dict[str, float] = Field(default_factory=dict)
    """Joint positions of the arm from which inverse kinematics begins; others: 0 [rad, m]."""
    azimuth: AnyRange = (180.0, 180.0)
    """Direction from the believed object to the hand: about the z of the root link, from its x
    [degrees]."""
    height: Nearby = 0.09
    """Height of the tool, which goes level, above the origin of the object [m]."""
    distance: Reach = Field(default=0.3, gt=0)
    """Horizontal distance of the tool's origin from the axis of the object at the start [m]."""
    offset: AnyRange = (-0.05, 0.05)
    """True lateral offset of the object from the hand's path, to the left as the hand goes [m]."""
    yaw: AnyRange = (-30.0, 30.0)
    """True yaw of the object, from the believed one [degrees]."""
    friction: float = Field(default=0.6, gt=0)
    """Coefficient of friction between hand and object."""
    table_friction: float = Field(default=0.3, gt=0)
    """Coefficient of friction between the object and what it stands on."""
    arm_stiffness: float = Field(default=400.0, gt=0)
    """Stiffness of the joints that move the tool [N·m/rad, N/m]."""
    grip: float = Field(default=1.0, gt=0)
    """The greatest torque with which the joints of the fingers close [N·m, N]."""
    press: Force = Field(default=30.0, gt=0)
    """The greatest force with which the arm presses on what does not give way: beyond it, the arm
    yields [N]."""
    stuck: dict[str, float] = Field(default_factory=dict)
    """Broken joints of fingers, with the positions that they never leave [rad, m]."""
    camera_rate: float = Field(default=0.0, ge=0, le=20)
    """Rate of the images of each camera [Hz]; 0: cameras are off."""
    wrench_range: tuple[float, float] | None = None
    """Range of the wrist sensors by component, force [N] and torque [N·m]: readings saturate there;
    None: unlimited."""
    noise: TouchNoise = Field(default_factory=lambda: TouchNoise.model_validate("prototype"))
    """Errors of the sensors and of the world: `none`, `prototype`, `full`, `hard`, such as
    `prototype+wrist`, or the fields of `TouchNoise`; `press` and `slide` are of touches alone."""
    period: float = Field(default=0.05, ge=0.01, le=0.2)
    """Period of commands, and of readings of joints and skins [s]."""
    lifted: Reach = Field(default=0.1, gt=0)
    """Least height above its start at which the object must be held for success [m] ..."""
    held: Memory = Field(default=2.0, gt=0)
    """... and for how long at the end [s]."""
    longest: Limit = Field(default=60.0, gt=0)
    """Time limit of the grasp [s]."""

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
