"""A robot by URDF: where its links are, how they move, what hangs on a sensor, its surface."""

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import (
    ConfigurationError,
    FrameError,
    RobotError,
    missing_extra,
    name_hint,
)
from contactfusion.frames import FrameTree, Pose, points_in
from contactfusion.readings import JointState
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.solids import Solid
from contactfusion.robots.spheres import SphereModel, fit_spheres
from contactfusion.robots.urdf import Urdf, read_urdf
from contactfusion.surface import RigidPart

SPHERE_SPACING = 0.008
"""Spheres are fitted to points about so far apart [m]."""


class RobotModel:
    """A robot of one URDF; poses are given in the frame of its root link.

    Args:
        config: the file, and where on the robot the sensors are.

    Raises:
        RobotError: the URDF does not hold together.
        ConfigurationError: a sensor is on a link that the URDF lacks, or frames form a circle.
        DependencyError: pinocchio is not installed.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.config = config
        self.urdf: Urdf = read_urdf(config.path(), config.package_folders(), config.within)
        self._pin, self._model = _kinematics(self.urdf)
        self._data: Any = self._model.createData()
        self.root = self.urdf.root
        self.link_names = tuple(self.urdf.links)
        self.joint_names: tuple[str, ...] = tuple(self._model.names)[1:]
        self._body = {
            frame.name: number
            for number, frame in enumerate(self._model.frames)
            if frame.type == self._pin.FrameType.BODY
        }
        self._beyond: dict[str, tuple[str, ...]] = {}
        self._check_names()
        self._frames = self._fixed_frames()

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to another process as the configuration; there it is built once."""
        return _built, (self.config.model_dump_json(),)

    @property
    def limits(self) -> FloatArray:
        """The least and the greatest position of each joint, shape (n, 2) [rad, m]."""
        lower, upper = self._model.lowerPositionLimit, self._model.upperPositionLimit
        first = [joint.idx_q for joint in self._joints]
        turning = np.array([joint.nq == 2 for joint in self._joints], np.bool_)
        limits = np.stack([lower[first], upper[first]], axis=1)
        limits[turning] = -np.inf, np.inf
        return limits

    @property
    def efforts(self) -> FloatArray:
        """The greatest torque or force of each joint, shape (n,) [N·m, N]."""
        return np.array(self._model.effortLimit)

    def positions(self, joints: JointState | None) -> FloatArray:
        """Give the position of each of `joint_names`, shape (n,) [rad, m].

        Args:
            joints: of this robot, and perhaps of others; those that are `still` may be left out.

        Raises:
            RobotError: a joint of the robot is not among them.
        """
        names = joints.names if joints else ()
        found, rows, positions = self._rows(names)
        positions = positions.copy()
        if joints is not None:
            positions[found] = joints.positions[rows]
        return positions

    def poses(self, joints: JointState | None) -> dict[str, Pose]:
        """Give the pose of each link in the root link's frame.

        Raises:
            RobotError: a joint of the robot is not among `joints`.
        """
        return self.poses_at(self.positions(joints))

    def poses_at(self, positions: FloatArray) -> dict[str, Pose]:
        """Give the pose of each link with the joints at `positions`, shape (n,) [rad, m]."""
        self._pin.framesForwardKinematics(self._model, self._data, self._configuration(positions))
        placed = self._data.oMf
        return {name: placed[number].homogeneous for name, number in self._body.items()}

    def jacobian(self, link: str, positions: FloatArray) -> FloatArray:
        """Give how a link's origin moves with the joints.

        Args:
            link: which.
            positions: shape (n,) [rad, m].

        Returns:
            Shape (6, n): linear [m/s], then angular velocity [rad/s] for each unit of joint speed,
            along the axes of the root link.

        Raises:
            RobotError: there is no such link.
        """
        self.urdf.require_link(link)
        jacobian = self._pin.computeFrameJacobian(
            self._model,
            self._data,
            self._configuration(positions),
            self._body[link],
            self._pin.LOCAL_WORLD_ALIGNED,
        )
        return np.reshape(jacobian, (6, -1))  # of one joint, it comes as a vector

    def gravity_torques(self, positions: FloatArray) -> FloatArray:
        """Give what the joints need to hold the robot up, shape (n,) [N·m, N].

        The root link's z points up.
        """
        torques: FloatArray = self._pin.computeGeneralizedGravity(
            self._model, self._data, self._configuration(positions)
        )
        return torques

    def inertias(self, positions: FloatArray) -> FloatArray:
        """Give what each joint has to move when all others yield, shape (n,) [kg·m², kg].

        Raises:
            RobotError: a joint moves no mass.
        """
        matrix = self._pin.crba(self._model, self._data, self._configuration(positions))
        massless = np.diag(matrix) <= 0.0
        if massless.any():
            name = self.joint_names[int(massless.argmax())]
            raise RobotError(f"{self.urdf.path}: joint '{name}' moves no mass")
        return 1.0 / np.diag(np.linalg.inv(matrix))

    def load_on(self, frame: str, poses: Mapping[str, Pose]) -> tuple[float, FloatArray]:
        """Give what hangs on a sensor: its mass [kg] and its centre of mass, shape (3,) [m].

        Args:
            frame: of the sensor; the mass of its own link hangs on it, too.
            poses: of all links, in one frame.

        Returns:
            The centre is given in the frame of the poses.

        Raises:
            RobotError: no link and no frame of the description has that name.
        """
        links = self.beyond(frame)
        masses = np.array([self.urdf.links[name].mass for name in links])
        centres = np.array(
            [
                points_in(poses[name], np.array([self.urdf.links[name].centre_of_mass]))[0]
                for name in links
            ]
        )
        mass = float(masses.sum())
        return mass, masses @ centres / mass if mass else centres[0]

    def link_of(self, frame: str) -> str:
        """Give the link that a frame of the description is fixed to; a link is fixed to itself.

        Raises:
            RobotError: no link and no frame of the description has that name.
        """
        while frame in self.config.frames:
            frame = self.config.frames[frame].parent
        self.urdf.require_link(frame)
        return frame

    def known_links(self, links: Sequence[str]) -> Sequence[str]:
        """Give the links, all when none is named.

        Raises:
            RobotError: there is no link of a name.
        """
        for link in links:
            self.urdf.require_link(link)
        return links or self.link_names

    def pose_on_link(self, frame: str) -> Pose:
        """Give the pose of a frame of the description in the link that it is fixed to.

        Raises:
            RobotError: no link and no frame of the description has that name.
        """
        return self._frames.pose(self.link_of(frame), of=frame)

    def beyond(self, frame: str) -> tuple[str, ...]:
        """Give the links that hang on a sensor's frame, its own link among them.

        Raises:
            RobotError: no link and no frame of the description has that name.
        """
        if frame not in self._beyond:
            self._beyond[frame] = self.urdf.hanging_on(self.link_of(frame))
        return self._beyond[frame]

    @cached_property
    def parts(self) -> dict[str, RigidPart]:
        """The sampled surface of each link that has one, in the link's frame."""
        wanted = self.link_names if self.config.links is None else self.config.links
        parts = {}
        for name, solid in self.solids.items():
            if name in wanted:
                points, normals = solid.samples(self.config.spacing)
                links = np.full(len(points), self.link_names.index(name), np.int32)
                parts[name] = RigidPart(points, normals, links)
        if not parts:
            which = "no link" if self.config.links is None else "no link of `links`"
            raise RobotError(f"{self.urdf.path}: {which} has a <{self.config.shapes}> shape")
        return parts

    @cached_property
    def spheres(self) -> SphereModel:
        """Spheres in place of the collision shapes of the links."""
        return fit_spheres(self._solids("collision"), self.link_names, SPHERE_SPACING)

    @cached_property
    def solids(self) -> dict[str, Solid]:
        """The links whose shapes make up the surface, in their frames."""
        return self._solids(self.config.shapes)

    def _solids(self, shapes: str) -> dict[str, Solid]:
        links = {name: getattr(link, shapes) for name, link in self.urdf.links.items()}
        return {name: Solid(given) for name, given in links.items() if given}

    @cached_property
    def _joints(self) -> Sequence[Any]:
        return list(self._model.joints)[1:]

    def _configuration(self, positions: FloatArray) -> FloatArray:
        """Give pinocchio's vector, in which a joint without ends is a cosine and a sine."""
        vector = np.empty(self._model.nq)
        for joint, position in zip(self._joints, positions, strict=True):
            if joint.nq == 2:
                vector[joint.idx_q : joint.idx_q + 2] = np.cos(position), np.sin(position)
            else:
                vector[joint.idx_q] = position
        return vector

    @lru_cache(maxsize=16)  # noqa: B019 a robot lives as long as its process
    def _rows(
        self, names: tuple[str, ...]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], FloatArray]:
        """Find the joints in the names of a reading; the third are positions of those at rest."""
        missing = [
            name for name in self.joint_names if name not in names and name not in self.config.still
        ]
        if missing:
            hint = name_hint(missing[0], names, "joints of the reading")
            more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
            raise RobotError(f"no position of joint '{missing[0]}' came{more}: {hint}")
        found = [i for i, name in enumerate(self.joint_names) if name in names]
        rows = [names.index(self.joint_names[i]) for i in found]
        still = np.array([self.config.still.get(name, 0.0) for name in self.joint_names])
        return np.array(found, np.intp), np.array(rows, np.intp), still

    def _check_names(self) -> None:
        """Make sure that all that the description names is there."""
        config, joints, links = self.config, self.joint_names, self.urdf.links
        frames = {*links, *config.frames}
        named: list[tuple[str, str, Sequence[str] | set[str], str]] = []
        named += [(f"still.{name}", name, joints, "joint") for name in config.still]
        named += [("links", name, tuple(links), "link") for name in config.links or ()]
        for name, frame in config.frames.items():
            named.append((f"frames.{name}.parent", frame.parent, frames, "frame"))
        for kind in ("patches", "wrists", "cameras", "lidars"):
            for name, sensor in getattr(config, kind).items():
                named.append((f"{kind}.{name}.frame", sensor.frame, frames, "frame"))
        for name, finger in config.fingers.items():
            named += [(f"fingers.{name}.joints", one, joints, "joint") for one in finger.joints]
            named += [(f"fingers.{name}.links", one, tuple(links), "link") for one in finger.links]
        for path, name, known, what in named:
            if name not in known:
                hint = name_hint(name, known, f"{what}s")
                raise ConfigurationError(f"unknown {what} '{name}': {hint}", path)

    def _fixed_frames(self) -> FrameTree:
        """Give the frames of the description in their links."""
        frames = self.config.frames
        for name in frames:
            if name in self.urdf.links:
                raise ConfigurationError("a link has this name already", f"frames.{name}")
        try:
            return FrameTree({name: (one.parent, one.pose()) for name, one in frames.items()})
        except FrameError as error:
            raise ConfigurationError(str(error), "frames") from None


def _kinematics(urdf: Urdf) -> tuple[Any, Any]:
    try:
        import pinocchio
    except ImportError:
        raise missing_extra("pinocchio", "robot") from None
    library: Any = pinocchio  # its names are made by the compiler
    try:
        return library, library.buildModelFromUrdf(str(urdf.path))
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"{urdf.path}: pinocchio cannot read it: {error}") from None


def shared_robot(config: RobotConfig) -> RobotModel:
    """Give the robot of a description, built once in a process: spheres take seconds to fit.

    Raises:
        RobotError: the URDF does not hold together.
        ConfigurationError: a sensor is on a link that the URDF lacks, or frames form a circle.
        DependencyError: pinocchio is not installed.
    """
    return _built(config.model_dump_json())


@lru_cache(maxsize=4)
def _built(config: str) -> RobotModel:
    return RobotModel(RobotConfig.model_validate_json(config))
