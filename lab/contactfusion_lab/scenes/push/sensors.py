"""Simulated sensors of a base that pushes: its skin, and LiDARs and cameras that are on."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, name_hint
from contactfusion.frames import (
    PlanarPose,
    Pose,
    inverse,
    planar_pose,
    points_in,
    pose_of,
    vectors_in,
)
from contactfusion.patches import PatchConfig, TaxelGridConfig
from contactfusion.readings import DepthImage, PointCloud, Reading
from contactfusion.robots.description import CameraConfig, LidarConfig, PatchOnLink, RobotConfig
from contactfusion.robots.model import shared_robot
from contactfusion.vision import back_projected
from contactfusion_lab.scenes.camera import RangeCamera
from contactfusion_lab.scenes.push.bodies import ORIGIN_HEIGHT
from contactfusion_lab.scenes.push.clutter import Clutter
from contactfusion_lab.scenes.push.config import PushConfig, SkinConfig
from contactfusion_lab.scenes.push.noise import CameraNoise, LidarNoise, MisplacedConfig
from contactfusion_lab.scenes.push.objects import Triangles, triangles_of
from contactfusion_lab.scenes.push.view import PushView, Rays, distances_to
from contactfusion_lab.scenes.push.world import Touches
from contactfusion_lab.scenes.sensor_errors import (
    RangeErrors,
    TaxelErrors,
    TaxelNoise,
)

FACING = np.cos(np.pi / 4.0)
"""Least cosine between a force and the normal of a strip that measures it."""
Mask = NDArray[np.bool_]
FLOOR, CHASSIS, CLUTTER = (150.0, 146.0, 138.0), (60.0, 62.0, 66.0), (128.0, 104.0, 82.0)
"""Red, green and blue of floor, base and other bodies, of 255."""
STEP = 0.05
"""Step in depth beyond which stereo has holes [m]."""
LIGHT = 1.5
"""Distance at which surfaces have half of their brightness, for the lamp is at the camera [m]."""
ROUNDING = 1e-6
"""Tolerance of the stamp at which a reading is due [s]."""
DARKEST, BRIGHTEST = 30.0, 225.0
"""Limits of red, green and blue of an object, of 255."""
EXACT_TAXELS = TaxelNoise()
"""Taxels without further errors."""
Look = Callable[[float, PlanarPose, PlanarPose], Reading]
"""From stamp [s], pose of the base and pose of the object to the reading."""


class PushSkin:
    """Strips of taxels around a base.

    A point presses the two taxels that are nearest to it along the strip, each the more the nearer
    it is; a taxel reads the mean of a cycle, or 0 when that is under its activation.

    Args:
        patch: its grids have one row each, in the frame of the robot.
        config: activation and noise.
        noise: further errors of its taxels, strip by strip.
        seed: of these.

    Raises:
        ConfigurationError: the patch is not made of such strips.
    """

    def __init__(
        self,
        patch: PatchConfig,
        config: SkinConfig,
        noise: TaxelNoise = EXACT_TAXELS,
        seed: int = 0,
    ) -> None:
        if any(grid.rows != 1 for grid in patch.grids) or not patch.grids:
            raise ConfigurationError("a skin around a base is made of `grids` of one row each")
        self._config, rng = config, rng_of(seed, "taxels")
        self._strips = [(inverse(grid.pose()), grid.columns, grid.pitch[1]) for grid in patch.grids]
        self._errors = [
            TaxelErrors(np.outer(np.arange(columns) * pitch, (0.0, 1.0, 0.0)), noise, rng)
            for _, columns, pitch in self._strips
        ]

    def values(
        self, stamp: float, touches: Touches, steps: int, rng: np.random.Generator
    ) -> FloatArray:
        """The value of each taxel, shape (n,) [N].

        Args:
            stamp: [s].
            touches: contact points on the robot in one cycle.
            steps: of the physics in the cycle.
            rng: of the noise.
        """
        pressed = []
        for (pose, columns, pitch), errors in zip(self._strips, self._errors, strict=True):
            felt = -(touches.normals @ pose[2, :3]) > FACING
            along = points_in(pose, touches.points[felt])[:, 1]
            position = (along / pitch + (columns - 1) / 2.0).clip(0.0, columns - 1.0)
            lower = np.minimum(position.astype(np.intp), max(columns - 2, 0))
            upper_share = position - lower
            forces = touches.forces[felt] / steps
            on_lower = np.bincount(lower, forces * (1.0 - upper_share), columns)
            on_upper = np.bincount(
                np.minimum(lower + 1, columns - 1), forces * upper_share, columns
            )
            pressed.append(errors.read(stamp, np.asarray(on_lower + on_upper, np.float64)))
        mean = np.concatenate(pressed)
        mean[mean < self._config.activation] = 0.0
        return mean + self._config.noise * rng.standard_normal(len(mean))


def with_taxels(patch: PatchOnLink, columns: int) -> PatchOnLink:
    """A skin with another number of taxels on its front; those of its sides are as wide.

    Args:
        patch: its first strip is the front.
        columns: number of taxels of the front.
    """
    front = patch.grids[0]
    pitch = front.columns * front.pitch[1] / columns

    def divided(grid: TaxelGridConfig) -> TaxelGridConfig:
        count = max(1, round(grid.columns * grid.pitch[1] / pitch))
        return grid.model_copy(update={"columns": count, "pitch": (grid.pitch[0], pitch)})

    return patch.model_copy(update={"grids": tuple(map(divided, patch.grids))})


class PushLidar:
    """A spinning LiDAR; a whole turn is measured at once.

    Args:
        config: its rings and range limits.
        pose: true, in the base's frame.
        view: the world for rays.
        noise: measurement errors.
        errors: further ones of its ranges.
    """

    def __init__(
        self,
        config: LidarConfig,
        pose: Pose,
        view: PushView,
        noise: LidarNoise,
        errors: RangeErrors,
    ) -> None:
        self._reach, self._noise, self._view = config.reach, noise, view
        self._rings, self._errors = config.rings, errors
        self._directions = directions(config)
        self._rays = view.rays(pose[:3, 3], vectors_in(pose, self._directions))

    def points(
        self,
        base: PlanarPose,
        pushed: PlanarPose,
        rng: np.random.Generator,
        bodies: Sequence[Triangles] = (),
    ) -> FloatArray:
        """All returns, shape (n, 3) [m], in the LiDAR's frame.

        Args:
            base: true pose of the base.
            pushed: true pose of the object.
            rng: of the noise.
            bodies: that are there, too, in `odom`.
        """
        ranges, noise = self._view.distances(self._rays, base, pushed)[0], self._noise
        if bodies:
            ranges = np.minimum(ranges, distances_to(bodies, self._rays, base))
        ranges = self._errors.read(ranges.reshape(-1, self._rings)).ravel()
        count = len(ranges)
        measured = ranges + noise.range * rng.standard_normal(count)
        drawn = rng.random(count)
        jumping = np.flatnonzero(drawn < noise.jumps)
        measured[jumping] += rng.uniform(-noise.jump, noise.jump, len(jumping))
        lost = drawn >= 1.0 - noise.dropout
        nearest, farthest = self._reach
        kept = (measured >= nearest) & (measured <= farthest) & ~lost
        points: FloatArray = self._directions[kept] * measured[kept, None]
        return points


def directions(config: LidarConfig) -> FloatArray:
    """The direction of each measurement, shape (n, 3), column by column, in its frame."""
    first, last = config.window
    turns = np.arange(-config.columns, config.columns + 1) * 360.0 / config.columns
    turns = np.radians(turns[(turns >= first) & (turns < last)])
    up = np.radians(np.linspace(-config.fov / 2.0, config.fov / 2.0, config.rings))
    azimuth, elevation = (axis.ravel() for axis in np.meshgrid(turns, up, indexing="ij"))
    return np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=1,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """An image of a depth camera.

    Attributes:
        depth: shape (h, w) [m], 0 without a measurement.
        colour: shape (h, w, 3), red, green and blue.
        mask: shape (h, w), the pixels of the object.
    """

    depth: FloatArray
    colour: NDArray[np.uint8]
    mask: Mask


class PushCamera:
    """A depth camera with colour, the depth aligned to it.

    Only pixels on which the object can lie are cast anew; all others see the floor or the base,
    which stand still, or other bodies.

    Args:
        config: image size, field of view and range limits.
        pose: true, in the base's frame.
        view: the world for rays.
        corners: shape (v, 3) [m], vertices of the object in its frame.
        noise: measurement errors.
        errors: further ones of its depths.
        paint: red, green and blue of the object, of 255.
    """

    def __init__(
        self,
        config: CameraConfig,
        pose: Pose,
        view: PushView,
        corners: FloatArray,
        noise: CameraNoise,
        errors: RangeErrors,
        paint: FloatArray,
    ) -> None:
        self._camera, self._noise, self._view = RangeCamera(config), noise, view
        self._errors = errors
        self._pose, self._corners, self._paint = pose, corners, paint
        self._size = config.height, config.width
        self.intrinsics = self._camera.intrinsics
        """Camera matrix, shape (3, 3) [pixels]."""
        v, u = np.indices(self._size).reshape(2, -1)
        forward = back_projected(v, u, np.ones(len(u)), self.intrinsics)
        self._rays = view.rays(pose[:3, 3], vectors_in(pose, forward))
        still = np.where(np.isfinite(self._rays.still), self._rays.still, 0.0)
        heights = pose[2, 3] + still * self._rays.directions[:, 2]
        on_floor = np.abs(heights + ORIGIN_HEIGHT) < 1e-3
        self._still_paint = np.where(on_floor[:, None], FLOOR, CHASSIS).astype(np.float32)

    def picture(
        self,
        base: PlanarPose,
        pushed: PlanarPose,
        rng: np.random.Generator,
        bodies: Sequence[Triangles] = (),
    ) -> Picture:
        """An image.

        Args:
            base: true pose of the base.
            pushed: true pose of the object.
            rng: of the noise.
            bodies: that are there, too, in `odom`.
        """
        depth, mask = self._true(base, pushed)
        paint = self._still_paint.reshape(*self._size, 3).copy()
        if bodies:
            found = distances_to(bodies, self._rays, base).reshape(self._size)
            before = found < depth
            depth, mask = np.minimum(found, depth), mask & ~before
            paint[before] = CLUTTER
        paint[mask] = self._paint
        return Picture(self._measured(depth, rng), self._coloured(depth, paint, rng), mask)

    def _true(self, base: PlanarPose, pushed: PlanarPose) -> tuple[FloatArray, Mask]:
        depth, mask = self._rays.still.copy(), np.zeros(len(self._rays.still), np.bool_)
        pixels = np.arange(len(depth)).reshape(self._size)[self._window(base, pushed)].ravel()
        rays = self._rays
        near = Rays(rays.origin, rays.directions[pixels], rays.still[pixels])
        depth[pixels], mask[pixels] = self._view.distances(near, base, pushed)
        return depth.reshape(self._size), mask.reshape(self._size)

    def _window(self, base: PlanarPose, pushed: PlanarPose) -> tuple[slice, slice]:
        """Rows and columns between which the object lies; all when it is beside the camera."""
        to_base = inverse(planar_pose(base, ORIGIN_HEIGHT)) @ planar_pose(pushed, 0.0)
        corners = points_in(inverse(self._pose) @ to_base, self._corners)
        if corners[:, 2].min() < self._camera.config.reach[0]:
            return slice(None), slice(None)
        pixels = corners @ self.intrinsics.T
        points = pixels[:, :2] / pixels[:, 2:]
        limits = np.array(self._size[::-1])
        first = np.clip(np.floor(points.min(axis=0)), 0, limits).astype(int)
        last = np.clip(np.ceil(points.max(axis=0)) + 1, 0, limits).astype(int)
        return slice(first[1], last[1]), slice(first[0], last[0])

    def _measured(self, depth: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Add noise, σ = z² disparity / (focal baseline), and holes."""
        noise = self._noise
        share = noise.disparity / (noise.focal * noise.baseline)
        off = rng.standard_normal(depth.shape, np.float32)
        drawn = rng.random(depth.shape, np.float32)
        measured = self._errors.read(np.where(np.isfinite(depth), depth, 0.0))
        measured += share * measured**2 * off
        measured = np.rint(measured / noise.unit) * noise.unit
        measured[drawn < np.where(beside_steps(depth), noise.edges, noise.holes)] = 0.0
        return self._camera.within_reach(measured)

    def _coloured(
        self, depth: FloatArray, paint: NDArray[np.float32], rng: np.random.Generator
    ) -> NDArray[np.uint8]:
        paint *= (2.0 / (1.0 + (depth / LIGHT) ** 2)).astype(np.float32)[..., None]
        paint += self._noise.colour * rng.standard_normal(paint.shape, np.float32)
        return np.clip(paint, 0.0, 255.0).astype(np.uint8)


def beside_steps(depth: FloatArray) -> Mask:
    """Which pixels differ from a neighbour beside, above or below them by more than `STEP`.

    Args:
        depth: shape (h, w) [m].
    """
    beside = np.zeros(depth.shape, np.bool_)
    finite = np.where(np.isfinite(depth), depth, 1e3)
    across = np.abs(np.diff(finite, axis=1)) > STEP
    down = np.abs(np.diff(finite, axis=0)) > STEP
    beside[:, 1:] |= across
    beside[:, :-1] |= across
    beside[1:] |= down
    beside[:-1] |= down
    return beside


@final
class RangeSensor:
    """An exteroceptive sensor, LiDAR or camera, with its own rate and random draws.

    Args:
        rate: of its readings [Hz].
        look: makes a reading.
    """

    def __init__(self, rate: float, look: Look) -> None:
        self._period, self._look, self._next = 1.0 / rate, look, 0.0

    def due(self, stamp: float) -> bool:
        """Whether a reading is due at a stamp [s]."""
        return stamp >= self._next - ROUNDING

    def reading(self, stamp: float, base: PlanarPose, pushed: PlanarPose) -> Reading:
        """The reading of a stamp [s]."""
        self._next = stamp + self._period
        return self._look(stamp, base, pushed)


def range_sensors(
    config: PushConfig, robot: RobotConfig, seed: int, clutter: Clutter | None
) -> list[RangeSensor]:
    """The exteroceptive sensors of a push that are switched on.

    Args:
        config: names them.
        robot: describes them.
        seed: of their noise; each has random draws of its own.
        clutter: what they see beside the object; None: nothing.

    Raises:
        ConfigurationError: the robot has no such LiDAR or camera, one that is switched on has the
            name of another, or one that is misplaced is not switched on.
        DependencyError: open3d is not installed.
    """
    _require_named(config, robot)
    if not config.sees:
        return []
    view, model = PushView(config.object, robot), shared_robot(robot)
    mounting = config.noise.mounting
    links = model.poses_at(np.zeros(len(model.joint_names)))
    sensors = []
    for name in config.sees:
        sensor = robot.lidars[name] if name in robot.lidars else robot.cameras[name]
        pose = links[model.link_of(sensor.frame)] @ model.pose_on_link(sensor.frame)
        if name in config.misplaced:
            pose = pose @ misplacement(config.misplaced[name], rng_of(seed, f"{name} misplaced"))
        if mounting != MisplacedConfig():
            pose = pose @ misplacement(mounting, rng_of(seed, f"{name} mounted"))
        mount = _Mounting(config, name, pose, view, seed, clutter)
        look = mount.lidar(sensor) if isinstance(sensor, LidarConfig) else mount.camera(sensor)
        sensors.append(RangeSensor(sensor.rate, look))
    return sensors


def misplacement(config: MisplacedConfig, rng: np.random.Generator) -> Pose:
    """A random true pose of a sensor, in its frame by the robot's description.

    Args:
        config: size of the error.
        rng: draws the direction and the axis.
    """
    from scipy.spatial.transform import Rotation

    shift, axis = (drawn / np.linalg.norm(drawn) for drawn in rng.standard_normal((2, 3)))
    rotation = Rotation.from_rotvec(np.radians(config.degrees) * axis)
    return pose_of(config.mm / 1000.0 * shift, rotation.as_matrix())


@dataclass(frozen=True)
class _Mounting:
    """A mounted exteroceptive sensor.

    Attributes:
        config: the push.
        name: of the sensor.
        pose: true, in the base's frame.
        view: the world for rays.
        seed: of the push.
        clutter: what it sees beside the object.
    """

    config: PushConfig
    name: str
    pose: Pose
    view: PushView
    seed: int
    clutter: Clutter | None

    def lidar(self, lidar: LidarConfig) -> Look:
        noise = self.config.white[1]
        simulated = PushLidar(lidar, self.pose, self.view, noise, self._errors())
        rng, name = rng_of(self.seed, self.name), self.name

        def look(stamp: float, base: PlanarPose, pushed: PlanarPose) -> Reading:
            points = simulated.points(base, pushed, rng, self._bodies(stamp, base, pushed))
            return PointCloud(stamp=stamp, frame=lidar.frame, sensor=name, points=points)

        return look

    def camera(self, camera: CameraConfig) -> Look:
        corners = np.concatenate([vertices for vertices, _ in triangles_of(self.config.object)])
        paint: FloatArray = rng_of(self.seed, "paint").uniform(DARKEST, BRIGHTEST, 3)
        noise, errors = self.config.white[2], self._errors()
        simulated = PushCamera(camera, self.pose, self.view, corners, noise, errors, paint)
        rng, name = rng_of(self.seed, self.name), self.name

        def look(stamp: float, base: PlanarPose, pushed: PlanarPose) -> Reading:
            picture = simulated.picture(base, pushed, rng, self._bodies(stamp, base, pushed))
            return DepthImage(
                stamp=stamp,
                frame=camera.frame,
                sensor=name,
                depth=picture.depth,
                intrinsics=simulated.intrinsics,
                colour=picture.colour,
                mask=picture.mask,
            )

        return look

    def _errors(self) -> RangeErrors:
        return RangeErrors(self.config.noise.ranges, rng_of(self.seed, f"{self.name} ranges"))

    def _bodies(self, stamp: float, base: PlanarPose, pushed: PlanarPose) -> Sequence[Triangles]:
        return self.clutter.seen(stamp, base, pushed) if self.clutter else ()


def rng_of(seed: int, name: str) -> np.random.Generator:
    """The random draws of something, by its name, apart from those of all else."""
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
