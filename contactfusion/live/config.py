"""The options of a pipeline on a running robot: where commands go, and when they are zero."""

from typing import Annotated

from pydantic import Field, StringConstraints

from contactfusion.model import Model
from contactfusion.units import Period

Name = Annotated[str, StringConstraints(pattern=r"^(/[A-Za-z_][A-Za-z0-9_]*)+$")]
"""A topic as ROS allows it, from the root on."""


class LiveConfig(Model):
    """The field `live` of a configuration, for `contactfusion live`."""

    twist: Name = "/cmd_vel"
    """The topic of the velocity of the base or hand, as geometry_msgs/Twist."""
    stamped: bool = False
    """Whether it is geometry_msgs/TwistStamped, as newer controllers of bases take it."""
    joint_velocities: Name = "/contactfusion/joint_velocities"
    """The topic of commanded velocities of joints, as sensor_msgs/JointState."""
    stale_after: Period = Field(default=0.25, gt=0)
    """Commands are zero, and no contact is reported, when for so long no sensor of contacts has
    reported, or the odometry or the joints that came before have not [s]."""
    hangs_after: Period = Field(default=0.25, gt=0)
    """Commands are zero when the loop has not come round for so long [s]."""
    pictures: Period = Field(default=0.1, gt=0)
    """The least time between two pictures of contacts and voxels [s]."""
