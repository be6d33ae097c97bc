"""Objects that a robot may touch: their shapes and believed poses."""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RobotError, name_hint
from contactfusion.files import require_file
from contactfusion.frames import FrameConfig, FrameTree, Pose, inverse, points_in, pose_of
from contactfusion.model import Model
from contactfusion.readings import ObjectPose
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.solids import Solid
from contactfusion.robots.urdf import Mesh, read_urdf
from contactfusion.shapes import ShapeConfig
from contactfusion.units import Angle, Spread


class ObjectConfig(Model):
    """An object: by shapes, a mesh or a URDF, with its believed pose."""

    shapes: tuple[ShapeConfig, ...] = ()
    """The primitives that make it up."""
    mesh: Path | None = None
    """A mesh file, in metres."""
    urdf: str | None = None
    """A URDF file of one link, or MODULE:FILE as in a robot's description."""
    pose: FrameConfig
    """Its believed pose."""
    sigma: Spread = Field(default=0.02, ge=0)
    """Standard deviation of the believed position, by axis [m]."""
    sigma_yaw: Angle = Field(default=0.087, ge=0)
    """Standard deviation of the believed yaw [rad]."""
    folder: Path = Path()
    """The folder of a relative `urdf`; that of the configuration."""
    files_within: Path | None = None
    """The folder that its files have to lie in, but for those of packages; None: anywhere. It is
    set where a recording names the object."""

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if bool(self.shapes) + (self.mesh is not None) + (self.urdf is not None) != 1:
            raise ValueError("give shapes, a mesh or a urdf")
        if any(shape.shape == "rectangle" for shape in self.shapes):
            raise ConfigurationError("a rectangle has no inside", "shapes")
        return self


class ObjectModel:
    """The shape of an object.

    Args:
        config: the object; its files are rooted already.

    Raises:
        RobotError: a file is missing, or the URDF has more than one link with a shape.
    """

    def __init__(self, config: ObjectConfig) -> None:
        self.config = config
        self.shapes: tuple[ShapeConfig | Mesh, ...] = config.shapes
        if config.mesh is not None:
            require_file(config.mesh, RobotError)
            self.shapes = (Mesh(config.mesh, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),)
        elif config.urdf is not None:
            of = RobotConfig(
                urdf=config.urdf, folder=config.folder, files_within=config.files_within
            )
            path = of.path()
            urdf = read_urdf(path, within=of.files_within)
            shaped = {name: link for name, link in urdf.links.items() if link.collision}
            if len(shaped) != 1:
                raise RobotError(
                    f"{path}: an object has one link with a collision shape, this has {len(shaped)}"
                )
            if urdf.root not in shaped:
                raise RobotError(
                    f"{path}: an object's shape is of its root link, and '{urdf.root}' has none"
                )
            self.shapes = shaped[urdf.root].collision

    @cached_property
    def solid(self) -> Solid:
        """The collision geometry."""
        return Solid(self.shapes)

    def distances(self, pose: Pose, points: FloatArray) -> FloatArray:
        """Signed distances of points from the object, shape (n,) [m], negative inside.

        Args:
            pose: of the object in the frame of the points.
            points: shape (n, 3) [m].
        """
        return self.solid.signed_distances(points_in(inverse(pose), points))

    def spreads(self, pose: Pose, points: FloatArray) -> FloatArray:
        """Standard deviations, by axis, of points that are fixed to the object, shape (n,) [m].

        Args:
            pose: of the object in the frame of the points, whose z is vertical.
            points: shape (n, 3) [m].
        """
        lever = np.linalg.norm((points - pose[:3, 3])[:, :2], axis=1)
        # a yaw moves a point along one horizontal axis: its mean square over three axes
        yawed = self.config.sigma_yaw * lever / np.sqrt(3.0)
        return np.asarray(np.hypot(self.config.sigma, yawed))


class BelievedObjects:
    """Objects with their believed poses: as configured, until a reading reports another.

    Args:
        configs: the objects by name; their files are rooted already.

    Raises:
        RobotError: a file is missing, or a URDF has more than one link with a shape.
    """

    def __init__(self, configs: Mapping[str, ObjectConfig]) -> None:
        self.models = {name: ObjectModel(config) for name, config in configs.items()}
        self.reset()

    def reset(self) -> None:
        """Return to the configured poses."""
        self._believed: dict[str, tuple[str, Pose]] = {
            name: (model.config.pose.parent, model.config.pose.pose())
            for name, model in self.models.items()
        }

    def update(self, reading: ObjectPose, asked_by: str) -> None:
        """Update the believed pose of an object by a reading.

        Args:
            reading: its name is the object's.
            asked_by: the generator that holds the belief.

        Raises:
            RobotError: there is no object of that name.
        """
        from scipy.spatial.transform import Rotation

        if reading.name not in self._believed:
            hint = name_hint(reading.name, self._believed, f"objects of '{asked_by}'")
            raise RobotError(f"unknown object '{reading.name}': {hint}")
        orientation = Rotation.from_quat(reading.orientation).as_matrix()
        self._believed[reading.name] = reading.frame, pose_of(reading.position, orientation)

    def poses(self, frames: FrameTree, frame: str) -> dict[str, Pose]:
        """The believed pose of each object in one frame, by name.

        Raises:
            FrameError: nothing joins an object's frame to that frame.
        """
        return {
            name: frames.pose(frame, of=parent) @ pose
            for name, (parent, pose) in self._believed.items()
        }
