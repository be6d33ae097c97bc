"""What the sensors of a simulated robot read, wrong by so much as its noise says."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, inverse, points_in, pose_of
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
from contactfusion_lab.scenes.touch.world import Touching

SKIN = 0.003
"""A push spreads through the skin as a Gaussian of this standard deviation [m]."""
FLYING = 0.3
"""Flying pixels lie up to so much before or behind what is there [m]."""


class TouchSensors:
    """The sensors of a robot's description; what is constant of their errors is drawn here.

    Args:
        model: the robot.
        tool: the link that the arm leads.
        leading: shape (n,), 1 for the joints that lead the tool.
        positions: shape (n,), about where the joints will be [rad, m].
        noise: how wrong the sensors are.
        rng: draws all errors.
        eyes: draws those of each image; None: `rng`, too.
    """

    def __init__(
        self,
        model: RobotModel,
        tool: str,
        leading: FloatArray,
        positions: FloatArray,
        noise: TouchNoise,
        rng: np.random.Generator,
        eyes: np.random.Generator | None = None,
    ) -> None:
        self._model, self._noise, self._rng = model, noise, rng
        self._eyes = rng if eyes is None else eyes
        # the arm's encoders are wrong in such a way that the hand seems to be elsewhere
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
        self._cameras = {name: RangeCamera(one) for name, one in model.config.cameras.items()}
        self._eye_errors = {name: self._misplaced() for name in self._cameras}

    def joints(self, stamp: float, positions: FloatArray, velocities: FloatArray) -> JointState:
        """Read the joints; both arrays have shape (n,)."""
        told = [
            row
            for row, name in enumerate(self._model.joint_names)
            if name not in self._model.config.still
        ]
        return JointState(
            stamp=stamp,
            frame=self._model.root,
            sensor="joints",
            names=tuple(self._model.joint_names[row] for row in told),
            positions=(positions + self._joint_errors)[told],
            velocities=velocities[told],
        )

    def wrenches(self, stamp: float, felt: Mapping[str, FloatArray]) -> Iterator[Wrench]:
        """Read the wrists; `felt`, shape (6,) [N, N·m], on the robot with all weight."""
        deviations = np.repeat([self._noise.force, self._noise.torque], 3)
        for name, wrench in felt.items():
            noisy = wrench + self._wrench_zeros[name] + deviations * self._rng.standard_normal(6)
            wrist = self._model.config.wrists[name]
            noisy *= 1.0 if wrist.sign == "on_robot" else -1.0
            yield Wrench(
                stamp=stamp, frame=wrist.frame, sensor=name, force=noisy[:3], torque=noisy[3:]
            )

    def skins(
        self, stamp: float, poses: Mapping[str, Pose], touching: Touching
    ) -> Iterator[TactileImage]:
        """Read the patches: each taxel feels what pushes near it.

        Args:
            stamp: [s].
            poses: of all links.
            touching: where the robot is touched.
        """
        for name, patch in self._model.config.patches.items():
            centres = patch.centres()
            values = self._noise.pressure * self._rng.standard_normal(len(centres))
            link = self._model.link_of(patch.frame)
            back = inverse(poses[link] @ self._model.pose_on_link(patch.frame))
            own = [row for row, touched in enumerate(touching.links) if touched == link]
            if own:
                places = points_in(back, touching.places[own])
                pressed = np.linalg.norm(touching.forces[own], axis=1)
                away = np.linalg.norm(centres[:, None, :] - places, axis=2)
                values += np.exp(-0.5 * (away / SKIN) ** 2) @ pressed
            yield TactileImage(stamp=stamp, frame=patch.frame, sensor=name, values=values)

    def sights(
        self, stamp: float, poses: Mapping[str, Pose], bodies: Sequence[tuple[Solid, Pose]]
    ) -> Iterator[Reading]:
        """Look with each camera; gives its depth image and the cloud of its returns.

        Args:
            stamp: [s].
            poses: of all links.
            bodies: all that can be seen, and where.
        """
        for name, camera in self._cameras.items():
            frame = camera.config.frame
            believed = poses[self._model.link_of(frame)] @ self._model.pose_on_link(frame)
            depth = camera.depth(believed @ self._eye_errors[name], bodies)
            depth = camera.within_reach(self._seen_with_noise(depth))
            yield DepthImage(
                stamp=stamp, frame=frame, sensor=name, depth=depth, intrinsics=camera.intrinsics
            )
            points = camera.points(depth)
            yield PointCloud(stamp=stamp, frame=frame, sensor=name, points=points)

    def believed(self, objects: Mapping[str, ObjectModel]) -> Iterator[ObjectPose]:
        """Where objects are believed to be when the touch begins, by name."""
        for name, one in objects.items():
            pose = one.config.pose.pose()
            shift, turn = self._rng.standard_normal(3), self._rng.standard_normal()
            if self._noise.belief:
                yaw = Rotation.from_euler("z", one.config.sigma_yaw * turn)
                pose = pose_of(
                    pose[:3, 3] + one.config.sigma * shift, yaw.as_matrix() @ pose[:3, :3]
                )
            yield ObjectPose(
                stamp=0.0,
                frame=one.config.pose.parent,
                name=name,
                position=pose[:3, 3],
                orientation=Rotation.from_matrix(pose[:3, :3]).as_quat(),
            )

    def _misplaced(self) -> Pose:
        shift, turn = self._rng.standard_normal(3), self._rng.standard_normal(3)
        turn = Rotation.from_rotvec(np.radians(self._noise.eye_turn) * turn).as_matrix()
        return pose_of(self._noise.eye_place * shift, turn)

    def _seen_with_noise(self, depth: FloatArray) -> FloatArray:
        seen = depth > 0.0
        noisy = depth + self._noise.depth * self._eyes.standard_normal(depth.shape)
        flying = self._eyes.random(depth.shape) < self._noise.flying
        noisy[flying] += self._eyes.uniform(-FLYING, FLYING, np.count_nonzero(flying))
        return np.where(seen, noisy, 0.0)
