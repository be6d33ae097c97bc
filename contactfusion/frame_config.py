"""Frames by configuration: where one stands in its parent."""

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from contactfusion.frames import Pose, pose_at, pose_of
from contactfusion.model import Model
from contactfusion.units import Angles, Position


class FrameConfig(Model):
    """Where a frame stands in its parent, for good."""

    parent: str = Field(min_length=1)
    """The frame in which `xyz` and the rotation are given."""
    xyz: Position = (0.0, 0.0, 0.0)
    """The origin [m]."""
    rpy: Angles | None = None
    """Roll, pitch and yaw about the parent's fixed axes [rad]."""
    quaternion: tuple[float, float, float, float] | None = None
    """The rotation as a unit quaternion (x, y, z, w)."""

    @model_validator(mode="after")
    def _one_rotation(self) -> Self:
        if self.rpy is not None and self.quaternion is not None:
            raise ValueError("give rpy or quaternion, not both")
        if self.quaternion is not None and abs(np.linalg.norm(self.quaternion) - 1.0) > 1e-3:
            raise ValueError("the quaternion is not of unit length")
        return self

    def pose(self) -> Pose:
        """Give the pose of the frame in its parent."""
        if self.quaternion is None:
            return pose_at(self.xyz, self.rpy or (0.0, 0.0, 0.0))
        from scipy.spatial.transform import Rotation

        return pose_of(self.xyz, Rotation.from_quat(self.quaternion).as_matrix())
