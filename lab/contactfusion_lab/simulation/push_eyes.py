"""The eyes of a base that pushes: those of its LiDARs and cameras that are switched on."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final
from zlib import crc32

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.frames import Pose, pose_of
from contactfusion.readings import DepthImage, PointCloud, Reading
from contactfusion.robots.description import CameraConfig, LidarConfig, RobotConfig
from contactfusion.robots.model import shared_robot
from contactfusion_lab.simulation.push_camera import PushCamera
from contactfusion_lab.simulation.push_config import MisplacedConfig, PushConfig
from contactfusion_lab.simulation.push_lidar import PushLidar
from contactfusion_lab.simulation.push_surfaces import triangles_of
from contactfusion_lab.simulation.push_view import Planar, PushView

ROUNDING = 1e-6
"""A reading is due at a stamp that is so nearly its own [s]."""
DARKEST, BRIGHTEST = 30.0, 225.0
"""Red, green and blue of an object lie between these, of 255."""

Look = Callable[[float, Planar, Planar], Reading]
"""Gives the reading at a stamp [s], of the base and the object where they are."""


@final
class Eye:
    """One sensor that looks, at its own rate and with chance of its own.

    Args:
        rate: of its readings [Hz].
        look: gives a reading.
    """

    def __init__(self, rate: float, look: Look) -> None:
        self._period, self._look, self._next = 1.0 / rate, look, 0.0

    def due(self, stamp: float) -> bool:
        """Tell whether it reads at a stamp [s]."""
        return stamp >= self._next - ROUNDING

    def reading(self, stamp: float, base: Planar, thing: Planar) -> Reading:
        """Give the reading of a stamp [s]."""
        self._next = stamp + self._period
        return self._look(stamp, base, thing)


def opened_eyes(config: PushConfig, robot: RobotConfig, seed: int) -> list[Eye]:
    """Switch on what a push sees with.

    Args:
        config: names them.
        robot: has them.
        seed: of their noise; each has chance of its own.

    Raises:
        ConfigurationError: the robot has no such LiDAR or camera, one that is switched on has the
            name of another, or one that is misplaced is not switched on.
        DependencyError: open3d is not installed.
    """
    _require_named(config, robot)
    if not config.sees:
        return []
    view, model = PushView(config.object, robot), shared_robot(robot)
    links = model.poses_at(np.zeros(len(model.joint_names)))
    eyes = []
    for name in config.sees:
        sensor = robot.lidars[name] if name in robot.lidars else robot.cameras[name]
        pose = links[model.link_of(sensor.frame)] @ model.pose_on_link(sensor.frame)
        if name in config.misplaced:
            pose = pose @ misplacement(config.misplaced[name], _chance(seed, f"{name} misplaced"))
        seat = _Seat(config, name, pose, view, seed)
        opened = seat.lidar(sensor) if isinstance(sensor, LidarConfig) else seat.camera(sensor)
        eyes.append(Eye(sensor.rate, opened))
    return eyes


def misplacement(config: MisplacedConfig, rng: np.random.Generator) -> Pose:
    """Draw where a sensor truly is, seen from where it is said to be.

    Args:
        config: how far off it is.
        rng: gives the direction and the axis.
    """
    from scipy.spatial.transform import Rotation

    aside, axis = (one / np.linalg.norm(one) for one in rng.standard_normal((2, 3)))
    turn = Rotation.from_rotvec(np.radians(config.degrees) * axis)
    return pose_of(config.mm / 1000.0 * aside, turn.as_matrix())


@dataclass(frozen=True)
class _Seat:
    """Where an eye is put.

    Attributes:
        config: the push.
        name: of the eye.
        pose: where it truly is in the base's frame.
        view: what there is to see.
        seed: of the push.
    """

    config: PushConfig
    name: str
    pose: Pose
    view: PushView
    seed: int

    def lidar(self, lidar: LidarConfig) -> Look:
        seeing = PushLidar(lidar, self.pose, self.view, self.config.lidar_noise)
        rng, name = _chance(self.seed, self.name), self.name

        def look(stamp: float, base: Planar, thing: Planar) -> Reading:
            points = seeing.points(base, thing, rng)
            return PointCloud(stamp=stamp, frame=lidar.frame, sensor=name, points=points)

        return look

    def camera(self, camera: CameraConfig) -> Look:
        corners = np.concatenate([vertices for vertices, _ in triangles_of(self.config.object)])
        paint: FloatArray = _chance(self.seed, "paint").uniform(DARKEST, BRIGHTEST, 3)
        noise = self.config.camera_noise
        seeing = PushCamera(camera, self.pose, self.view, corners, noise, paint)
        rng, name = _chance(self.seed, self.name), self.name

        def look(stamp: float, base: Planar, thing: Planar) -> Reading:
            picture = seeing.picture(base, thing, rng)
            return DepthImage(
                stamp=stamp,
                frame=camera.frame,
                sensor=name,
                depth=picture.depth,
                intrinsics=seeing.intrinsics,
                colour=picture.colour,
                mask=picture.mask,
            )

        return look


def _chance(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng([seed, crc32(name.encode())])


def _require_named(config: PushConfig, robot: RobotConfig) -> None:
    known = [*robot.lidars, *robot.cameras]
    for name in config.sees:
        if name not in known:
            hint = name_hint(name, known, "LiDARs and cameras of the robot")
            raise ConfigurationError(f"the robot has no '{name}'; {hint}", "sees")
        if known.count(name) > 1:
            raise ConfigurationError(f"the robot has a LiDAR and a camera '{name}'", "sees")
    for name in config.misplaced:
        if name not in config.sees:
            hint = name_hint(name, config.sees, "LiDARs and cameras that are switched on")
            raise ConfigurationError(f"'{name}' is not switched on; {hint}", f"misplaced.{name}")
