"""The configuration of a pipeline: named generators, frames, a surface, the integrator."""

from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from contactfusion.errors import ConfigurationError
from contactfusion.frames import FrameTree, Pose, pose_of
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.model import Model
from contactfusion.shapes import BodyConfig

Vector = tuple[float, float, float]


class FrameConfig(Model):
    """Where a frame stands in its parent, for good."""

    parent: str
    """The frame in which `xyz` and the rotation are given."""
    xyz: Vector = (0.0, 0.0, 0.0)
    """The origin [m]."""
    rpy: Vector | None = None
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
        if self.quaternion is not None:
            rotation = Rotation.from_quat(self.quaternion)
        else:
            rotation = Rotation.from_euler("xyz", self.rpy or (0.0, 0.0, 0.0))
        return pose_of(self.xyz, rotation.as_matrix())


class CycleConfig(Model):
    """When the pipeline steps: exactly one of the three."""

    every: float | None = Field(default=None, gt=0)
    """Step at this period [s]."""
    on: str | None = None
    """Step after each reading of this sensor or type, e.g. `wrench`."""
    ready: bool = False
    """Step when every active source has reported (F §III-B)."""

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        return {"ready": True} if value == "ready" else value

    @model_validator(mode="after")
    def _one_policy(self) -> Self:
        if (self.every is not None) + (self.on is not None) + self.ready != 1:
            raise ValueError("give exactly one of: ready, every, on")
        return self


class PipelineConfig(Model):
    """Everything between the sensors and the contacts."""

    generators: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """By name: the `type` of the generator and its options."""
    integrator: IntegratorConfig = Field(default_factory=IntegratorConfig)
    """How hypotheses are fused."""
    cycle: CycleConfig = Field(default_factory=lambda: CycleConfig(every=0.01))
    """When to step: `ready`, `{every: seconds}` or `{on: sensor or type}`."""
    frames: dict[str, FrameConfig] = Field(default_factory=dict)
    """Frames that stand still in their parents, by name."""
    surface: BodyConfig | None = None
    """The surface of the robot."""
    controller: dict[str, Any] | None = None
    """The `type` of the controller and its options."""
    folder: Path = Path()
    """Where relative file names start, those in options of plug-ins too; `contactfusion run` takes
    the folder of the configuration."""

    @model_validator(mode="after")
    def _typed(self) -> Self:
        for name, options in self.generators.items():
            if not isinstance(options.get("type"), str):
                raise ConfigurationError(
                    "name the type of the generator", f"generators.{name}.type"
                )
            if "/" in name:
                raise ConfigurationError("a name may not hold a slash", f"generators.{name}")
        if self.controller is not None and not isinstance(self.controller.get("type"), str):
            raise ConfigurationError("name the type of the controller", "controller.type")
        return self

    def frame_tree(self) -> FrameTree:
        """Give the tree of the frames that stand still.

        Raises:
            FrameError: the frames form a circle.
        """
        poses = {name: (frame.parent, frame.pose()) for name, frame in self.frames.items()}
        return FrameTree(poses)
