"""Readings of the sensors of a simulated robot, with measurement errors."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, inverse, points_in, pose_of, vectors_in
from contactfusion.readings import (
    DepthImage,
    JointState,
    ObjectPose,
    PointCloud,
    Reading,
    TactileImage,
    Wrench,
)
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectModel
from contactfusion.robots.solids import Solid
from contactfusion_lab.scenes.camera import RangeCamera
from contactfusion_lab.scenes.noise import TouchNoise
from contactfusion_lab.scenes.sensor_errors import (
    RangeErrors,
    TaxelErrors,
    TaxelNoise,
    WristErrors,
)
from contactfusion_lab.scenes.touch.world import Touching

SKIN = 0.003
"""Standard deviation of the Gaussian by which a force spreads through the skin [m]."""
FLYING = 0.3
"""Greatest error of flying pixels, towards the camera or away from it [m]."""
GRAVITY = (0.0, 0.0, -9.81)
"""In the root link's frame [m/s²]."""


class TouchSensors:
    """The sensors of a robot's description; their constant errors are drawn on construction.

    Args:
        model: the robot.
        tool: the link that the arm moves.
        leading: shape (n,), 1 for the joints that move the tool.
        positions: shape (n,), about which joint errors are linearized [rad, m].
        noise: measurement errors.
        rng: draws all errors.
        image_rng: draws those of each image; None: `rng`, too.
    """

    def __init__(
        self,
        model: RobotModel,
        tool: str,
        leading: FloatArray,
        positions: FloatArray,
        noise: TouchNoise,
        rng: np.random.Generator,
        image_rng: np.random.Generator | None = None,
    ) -> None:
        self._model, self._noise, self._rng = model, noise, rng
        self._image_rng = rng if image_rng is None else image_rng
        # errors of the arm's encoders that put the hand at another pose
        twist = rng.standard_normal(6) * np.repeat(
            [noise.wrist_place, np.radians(noise.wrist_turn)], 3
        )
        jacobian = model.jacobian(tool, positions) * leading
        hand = rng.standard_normal((2, len(positions))) * (1.0 - leading)
        hand *= np.radians([[noise.encoders], [noise.zeros]])
        still = np.array([name in model.config.still for name in model.joint_names])
        self._joint_errors = np.linalg.pinv(jacobian) @ twist + hand.sum(axis=0) * ~still
        self._wrench_zeros = {
            name: rng.standard_normal(6) * np.repeat([noise.force_zero, noise.torque_zero], 3)
            for name in model.config.wrists
        }
        self._cameras = {name: RangeCamera(camera) for name, camera in model.config.cameras.items()}
        self._camera_errors = {name: self._misplaced() for name in self._cameras}
        # further errors have generators of their own: whoever adds one changes no other
        wrist_rng, skin_rng, range_rng = rng.spawn(3)
        self._wrist_errors: dict[str, WristErrors] = {}
        drift = np.repeat([noise.force_drift, noise.torque_drift], 3)
        if drift.any() or noise.crosstalk or noise.payload:
            self._wrist_errors = {
                name: WristErrors(drift, noise.crosstalk, noise.payload, wrist_rng)
                for name in model.config.wrists
            }
        self._taxel_errors: dict[str, TaxelErrors] = {}
        if noise.taxels != TaxelNoise():
            self._taxel_errors = {
                name: TaxelErrors(patch.centres(), noise.taxels, skin_rng)
                for name, patch in model.config.patches.items()
            }
        self._range_errors = {name: RangeErrors(noise.ranges, range_rng) for name in self._cameras}

    def joints(self, stamp: float, positions: FloatArray, velocities: FloatArray) -> JointState:
        """The reading of the joints; both arrays have shape (n,)."""
        rows = [
            row
            for row, name in enumerate(self._model.joint_names)
            if name not in self._model.config.still
        ]
        return JointState(
            stamp=stamp,
            frame=self._model.root,
            sensor="joints",
            names=tuple(self._model.joint_names[row] for row in rows),
            positions=(positions + self._joint_errors)[rows],
            velocities=velocities[rows],
        )

    def wrenches(
        self, stamp: float, positions: FloatArray, felt: Mapping[str, FloatArray]
    ) -> Iterator[Wrench]:
        """Readings of the wrists from true wrenches on the robot, weight included.

        Args:
            stamp: [s].
            positions: shape (n,), true joint positions [rad, m].
            felt: by wrist, shape (6,), force [N] and torque [N·m].
        """
        deviations = np.repeat([self._noise.force, self._noise.torque], 3)
        poses = self._model.poses_at(positions) if self._wrist_errors else {}
        for name, wrench in felt.items():
            if self._wrist_errors:
                weight = self._weight(self._model.config.wrists[name].frame, poses)
                wrench = self._wrist_errors[name].read(stamp, wrench, weight)
            noisy = wrench + self._wrench_zeros[name] + deviations * self._rng.standard_normal(6)
            wrist = self._model.config.wrists[name]
            noisy *= 1.0 if wrist.sign == "on_robot" else -1.0
            yield Wrench(
                stamp=stamp, frame=wrist.frame, sensor=name, force=noisy[:3], torque=noisy[3:]
            )

    def skins(
        self, stamp: float, poses: Mapping[str, Pose], touching: Touching
    ) -> Iterator[TactileImage]:
        """Readings of the patches: each taxel measures the forces near it.

        Args:
            stamp: [s].
            poses: of all links.
            touching: contact points on the robot.
        """
        for name, patch in self._model.config.patches.items():
            centres = patch.centres()
            values = self._noise.pressure * self._rng.standard_normal(len(centres))
            link = self._model.link_of(patch.frame)
            back = inverse(poses[link] @ self._model.pose_on_link(patch.frame))
            own = [row for row, touched in enumerate(touching.links) if touched == link]
            pressures = np.full(len(centres), -0.0)  # which changes no bit of what it is added to
            if own:
                points = points_in(back, touching.places[own])
                forces = np.linalg.norm(touching.forces[own], axis=1)
                distances = np.linalg.norm(centres[:, None, :] - points, axis=2)
                pressures = np.exp(-0.5 * (distances / SKIN) ** 2) @ forces
            if self._taxel_errors:
                pressures = self._taxel_errors[name].read(stamp, pressures)
            values += pressures
            yield TactileImage(stamp=stamp, frame=patch.frame, sensor=name, values=values)

    def sights(
        self, stamp: float, poses: Mapping[str, Pose], bodies: Sequence[tuple[Solid, Pose]]
    ) -> Iterator[Reading]:
        """A depth image of each camera, and the point cloud of its returns.

        Args:
            stamp: [s].
            poses: of all links.
            bodies: collision geometry that is visible, each with its pose.
        """
        for name, camera in self._cameras.items():
            frame = camera.config.frame
            believed = poses[self._model.link_of(frame)] @ self._model.pose_on_link(frame)
            depth = camera.depth(believed @ self._camera_errors[name], bodies)
            depth = self._range_errors[name].read(depth)
            depth = camera.within_reach(self._seen_with_noise(depth))
            yield DepthImage(
                stamp=stamp, frame=frame, sensor=name, depth=depth, intrinsics=camera.intrinsics
            )
            points = camera.points(depth)
            yield PointCloud(stamp=stamp, frame=frame, sensor=name, points=points)

    def believed(self, objects: Mapping[str, ObjectModel]) -> Iterator[ObjectPose]:
        """The believed poses of objects when the touch begins; `objects` by name."""
        for name, model in objects.items():
            pose = model.config.pose.pose()
            shift, rotation = self._rng.standard_normal(3), self._rng.standard_normal()
            if self._noise.belief:
                yaw = Rotation.from_euler("z", model.config.sigma_yaw * rotation)
                pose = pose_of(
                    pose[:3, 3] + model.config.sigma * shift, yaw.as_matrix() @ pose[:3, :3]
                )
            yield ObjectPose(
                stamp=0.0,
                frame=model.config.pose.parent,
                name=name,
                position=pose[:3, 3],
                orientation=Rotation.from_matrix(pose[:3, :3]).as_quat(),
            )

    def _weight(self, frame: str, poses: Mapping[str, Pose]) -> FloatArray:
        """The weight that a wrist should carry, at its frame: shape (6,) [N, N·m]."""
        mass, centre = self._model.load_on(frame, poses)
        pose = poses[self._model.link_of(frame)] @ self._model.pose_on_link(frame)
        force = mass * np.array(GRAVITY)
        both = np.stack([force, np.cross(centre - pose[:3, 3], force)])
        return vectors_in(inverse(pose), both).ravel()

    def _misplaced(self) -> Pose:
        shift, rotation = self._rng.standard_normal(3), self._rng.standard_normal(3)
        rotation = Rotation.from_rotvec(np.radians(self._noise.eye_turn) * rotation).as_matrix()
        return pose_of(self._noise.eye_place * shift, rotation)

    def _seen_with_noise(self, depth: FloatArray) -> FloatArray:
        seen = depth > 0.0
        noisy = depth + self._noise.depth * self._image_rng.standard_normal(depth.shape)
        flying = self._image_rng.random(depth.shape) < self._noise.flying
        noisy[flying] += self._image_rng.uniform(-FLYING, FLYING, np.count_nonzero(flying))
        return np.where(seen, noisy, 0.0)
