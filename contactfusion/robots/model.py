"""A robot by URDF: kinematics, load on a sensor, sampled surface."""

import math
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

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
from contactfusion.frames import FrameConfig, FrameTree, Parent, Pose, inverse, points_in
from contactfusion.readings import JointState
from contactfusion.robots.description import PayloadConfig, RobotConfig
from contactfusion.robots.solids import Solid
from contactfusion.robots.spheres import SphereModel, fitted_spheres
from contactfusion.robots.urdf import Shapes, Urdf, read_urdf
from contactfusion.surface import RigidPart
from contactfusion.units import LENGTH

SPHERE_SPACING = 0.008
"""The distance between the points that spheres are fitted to, about [m]."""
COVERED = 0.002
"""Points of a link that are so near a neighbouring link can't be touched [m]."""
MOUNTED = 10.0
"""The furthest that a frame is mounted from its link [m]; half of the links' reach if greater."""

TURN = 2.0 * math.pi
"""A joint so far beyond its limits is in another unit than rad, or is not that joint."""


class _Known(NamedTuple):
    """The joints that a message holds, sorted by what gives each joint of the robot its position.

    Attributes:
        found: the joints of `joint_names` that the message holds, as rows of `joint_names`.
        rows: their rows in the message.
        still: configured positions of the others, 0 where there is none, shape (n,) [rad, m].
        following: the joints that mimic another.
        unknown: the joints without a position.
    """

    found: NDArray[np.intp]
    rows: NDArray[np.intp]
    still: FloatArray
    following: tuple[str, ...]
    unknown: tuple[str, ...]


class RobotModel:
    """A robot of one URDF; poses are in the frame of its root link.

    Args:
        config: the URDF, and the frames of the sensors on the robot.

    Raises:
        RobotError: the URDF is not valid.
        ConfigurationError: a sensor is on a link that the URDF lacks, or further away than a robot
            of this size can carry it, or frames form a circle.
        DependencyError: pinocchio is not installed.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.config = config
        self.urdf: Urdf = read_urdf(
            config.path(), config.package_folders(), config.files_within, (config.shapes,)
        )
        self._pin, self._model = _kinematics(self.urdf)
        self._data: Any = self._model.createData()
        self.root = self.urdf.root
        self.link_names = tuple(self.urdf.links)
        self.joint_names: tuple[str, ...] = tuple(self._model.names)[1:]
        self._mimics = {
            name: mimic for name, mimic in self.urdf.mimics.items() if name in self.joint_names
        }
        self._body = {
            frame.name: number
            for number, frame in enumerate(self._model.frames)
            if frame.type == self._pin.FrameType.BODY
        }
        self._beyond: dict[str, tuple[str, ...]] = {}
        self._check_names()
        self._frames = self._fixed_frames()
        self.require_mounted(config.frames)
        self._payload: tuple[str, float, FloatArray] | None = None
        """The link that carries it, its mass [kg] and its centre of mass there, shape (3,) [m]."""
        for name, given in config.masses.items():
            link = self.urdf.links[name]
            self._weigh(name, (-link.mass, link.centre_of_mass), (given.mass, given.centre_of_mass))
        if config.payload is not None:
            self._carry(config.payload)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as the configuration; the robot is built once in each process."""
        return _built, (self.config.model_dump_json(),)

    @property
    def kinematics(self) -> tuple[Any, Any]:
        """Pinocchio, and its model of the robot, which must not be changed."""
        return self._pin, self._model

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each joint's position: "m" if prismatic, "rad" if revolute."""
        prismatic = (joint.shortname().startswith("JointModelP") for joint in self._joints)
        return tuple("m" if slides else "rad" for slides in prismatic)

    @property
    def limits(self) -> FloatArray:
        """The least and the greatest position of each joint, shape (n, 2) [rad, m]."""
        lower, upper = self._model.lowerPositionLimit, self._model.upperPositionLimit
        first = [joint.idx_q for joint in self._joints]
        limits = np.stack([lower[first], upper[first]], axis=1)
        limits[self.turning] = -np.inf, np.inf
        return limits

    @cached_property
    def turning(self) -> NDArray[np.bool_]:
        """The joints that turn without limits: their positions may leap by a turn, shape (n,)."""
        return np.array([joint.nq == 2 for joint in self._joints], np.bool_)

    def stray(self, reading: JointState) -> str:
        """A sentence on a revolute joint that is a turn or more beyond its limits, or nothing."""
        rows, low, high = self._bounds(reading.names)
        away = (reading.positions < low) | (reading.positions > high)
        if not away.any():
            return ""
        at = int(away.argmax())
        least, greatest = self.limits[rows[at]]
        return (
            f"{reading.label}: {reading.names[at]} is at {reading.positions[at]:.4g} rad, and its "
            f"limits in the URDF are {least:.4g} and {greatest:.4g}: is it in degrees, or another "
            f"joint?"
        )

    @lru_cache(maxsize=8)  # noqa: B019 a robot lives as long as its pipeline
    def _bounds(self, names: tuple[str, ...]) -> tuple[list[int], FloatArray, FloatArray]:
        """Of joints by name their rows, -1 if unknown, and what is a turn beyond their limits."""
        known = {name: row for row, name in enumerate(self.joint_names)}
        rows, turns = [known.get(name, -1) for name in names], np.array(self.units) == "rad"
        bounds = [
            self.limits[row] + (-TURN, TURN) if row >= 0 and turns[row] else (-np.inf, np.inf)
            for row in rows
        ]
        low, high = np.reshape(bounds, (-1, 2)).T
        return rows, low, high

    @property
    def efforts(self) -> FloatArray:
        """The greatest torque or force of each joint, shape (n,) [N·m, N]."""
        return np.array(self._model.effortLimit)

    def positions(self, joints: JointState | None) -> FloatArray:
        """The position of each of `joint_names`, shape (n,) [rad, m].

        Args:
            joints: of this robot, and perhaps of others; joints that are `still` or mimic another
                may be left out.

        Raises:
            RobotError: a joint of the robot is not among them.
        """
        positions, unknown = self.known_positions(joints)
        if unknown:
            raise RobotError(self._unknown(unknown, joints))
        return positions

    def known_positions(self, joints: JointState | None) -> tuple[FloatArray, tuple[str, ...]]:
        """The position of each of `joint_names`, shape (n,) [rad, m], 0 for unknown joints.

        Second, the names of the unknown joints.
        """
        known = self._known(joints.names if joints else ())
        positions = known.still.copy()
        if joints is not None:
            positions[known.found] = joints.positions[known.rows]
        return self._followed(positions, known.following), known.unknown

    def followed(self, positions: FloatArray, moved: Collection[str] | None = None) -> FloatArray:
        """Positions, shape (n,) [rad, m], in which each joint that mimics another follows it.

        A joint that is `still` stays.

        Args:
            positions: shape (n,) [rad, m].
            moved: joints that were measured anew: those that mimic one of them follow it, unless
                they were measured, too; None: all follow.
        """
        following = [
            name
            for name, (driver, _, _) in self._mimics.items()
            if name not in self.config.still
            and (moved is None or (driver in moved and name not in moved))
        ]
        return self._followed(positions.copy(), following)

    def speeds(self, measured: Mapping[str, float]) -> FloatArray:
        """The speed of each of `joint_names`, shape (n,) [rad/s, m/s].

        Args:
            measured: by joint; a joint that mimics another follows it, and others have speed 0.
        """
        speeds = {name: measured.get(name, 0.0) for name in self.joint_names}
        for name, (driver, multiplier, _) in self._mimics.items():
            if name not in measured and name not in self.config.still:
                speeds[name] = multiplier * speeds[driver]
        return np.array([*speeds.values()])

    def poses(self, joints: JointState | None) -> dict[str, Pose]:
        """The pose of each link in the root link's frame.

        Raises:
            RobotError: a joint of the robot is not among `joints`.
        """
        return self.poses_at(self.positions(joints))

    def poses_at(self, positions: FloatArray) -> dict[str, Pose]:
        """The pose of each link with the joints at `positions`, shape (n,) [rad, m]."""
        self._pin.framesForwardKinematics(self._model, self._data, self.configuration(positions))
        placed = self._data.oMf
        return {name: placed[number].homogeneous for name, number in self._body.items()}

    def frames_at(self, positions: FloatArray, unknown: tuple[str, ...] = ()) -> dict[str, Parent]:
        """The frames of the links.

        Args:
            positions: shape (n,) [rad, m].
            unknown: the joints whose positions are not known; their positions are ignored.

        Returns:
            By link its pose in the root link, or in the nearest link above it that an unknown
            joint carries; links that such a joint carries have no entry.
        """
        poses, root = self.poses_at(positions), self.root
        return {
            link: (top, poses[link] if top == root else inverse(poses[top]) @ poses[link])
            for link, top in self._tops(unknown).items()
        }

    def jacobian(self, link: str, positions: FloatArray) -> FloatArray:
        """The Jacobian of a link's origin.

        Args:
            link: its name.
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
            self.configuration(positions),
            self._body[link],
            self._pin.LOCAL_WORLD_ALIGNED,
        )
        return np.reshape(jacobian, (6, -1))  # of a single joint, it comes as a vector

    def gravity_torques(self, positions: FloatArray) -> FloatArray:
        """The torques and forces that hold the robot against gravity, shape (n,) [N·m, N].

        The root link's z points up.
        """
        torques: FloatArray = self._pin.computeGeneralizedGravity(
            self._model, self._data, self.configuration(positions)
        )
        return torques

    def inertias(self, positions: FloatArray) -> FloatArray:
        """The inertia at each joint while all others are free, shape (n,) [kg·m², kg].

        Raises:
            RobotError: a joint moves no mass.
        """
        matrix = self._pin.crba(self._model, self._data, self.configuration(positions))
        massless = np.diag(matrix) <= 0.0
        if massless.any():
            name = self.joint_names[int(massless.argmax())]
            raise RobotError(f"{self.urdf.path}: joint '{name}' moves no mass")
        return 1.0 / np.diag(np.linalg.inv(matrix))

    def mass_of(self, link: str) -> tuple[float, FloatArray]:
        """Mass [kg] and centre of mass of a link, shape (3,) [m], in its frame."""
        own = self.config.masses.get(link, self.urdf.links[link])
        return own.mass, np.array(own.centre_of_mass)

    def carried_by(self, link: str) -> float:
        """The mass of a link, and of the payload that it carries [kg]."""
        carries = self._payload is not None and self._payload[0] == link
        return self.mass_of(link)[0] + (self._payload[1] if carries and self._payload else 0.0)

    def load_on(self, frame: str, poses: Mapping[str, Pose]) -> tuple[float, FloatArray]:
        """The load of a sensor: mass [kg] and centre of mass, shape (3,) [m].

        Args:
            frame: of the sensor; its own link belongs to the load, as does a payload beyond it.
            poses: of all links, in one frame.

        Returns:
            The centre is in the frame of the poses.

        Raises:
            RobotError: no link and no frame of the description has that name.
        """
        links = self.beyond(frame)
        held = [(name, *self.mass_of(name)) for name in links]
        if self._payload is not None and self._payload[0] in links:
            held.append(self._payload)
        masses = np.array([mass for _, mass, _ in held])
        centres = np.array([points_in(poses[name], np.array([at]))[0] for name, _, at in held])
        mass = float(masses.sum())
        return mass, masses @ centres / mass if mass else centres[0]

    def link_of(self, frame: str) -> str:
        """The link that a frame of the description is fixed to; a link is fixed to itself.

        Raises:
            RobotError: no link and no frame of the description has that name.
        """
        while frame in self.config.frames:
            frame = self.config.frames[frame].parent
        self.urdf.require_link(frame)
        return frame

    def known_links(self, links: Sequence[str]) -> Sequence[str]:
        """The links of these names, all links when none is named.

        Raises:
            RobotError: there is no link of a name.
        """
        for link in links:
            self.urdf.require_link(link)
        return links or self.link_names

    def pose_on_link(self, frame: str) -> Pose:
        """The pose of a frame of the description in the link that it is fixed to.

        Raises:
            RobotError: no link and no frame of the description has that name.
        """
        return self._frames.pose(self.link_of(frame), of=frame)

    def beyond(self, frame: str) -> tuple[str, ...]:
        """The links that a sensor's frame carries, its own link among them.

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
    def exposed(self) -> dict[str, NDArray[np.bool_]]:
        """The points of each part that no neighbouring link covers, shape (n,) each."""
        rest, parents = self.known_positions(None)[0], self.urdf.parents
        poses = self.poses_at(np.clip(rest, *self.limits.T))
        found = {}
        for name, part in self.parts.items():
            free = np.ones(len(part.points), np.bool_)
            for other, solid in self.solids.items():
                if parents.get(other) == name or parents.get(name) == other:
                    points = points_in(inverse(poses[other]) @ poses[name], part.points)
                    free &= solid.signed_distances(points) > COVERED
            found[name] = free
        return found

    @cached_property
    def spheres(self) -> SphereModel:
        """Spheres in place of the collision shapes of the links."""
        return fitted_spheres(self._shapes("collision"), self.link_names, SPHERE_SPACING)

    @cached_property
    def solids(self) -> dict[str, Solid]:
        """The links whose shapes make up the surface, in their frames."""
        return {name: Solid(given) for name, given in self._shapes(self.config.shapes).items()}

    def _shapes(self, kind: str) -> dict[str, Shapes]:
        """The shapes of a kind of the links that have some."""
        links = {name: getattr(link, kind) for name, link in self.urdf.links.items()}
        return {name: given for name, given in links.items() if given}

    @cached_property
    def _joints(self) -> Sequence[Any]:
        return list(self._model.joints)[1:]

    def configuration(self, positions: FloatArray) -> FloatArray:
        """Pinocchio's configuration vector: a joint without limits is a cosine and a sine.

        Args:
            positions: of all joints, shape (n,) [rad, m].

        Raises:
            RobotError: they are of another number, or not finite.
        """
        if np.shape(positions) != (len(self._joints),) or not np.isfinite(positions).all():
            raise RobotError(
                f"the positions of {len(self._joints)} joints are as many finite numbers, not "
                f"{positions}"
            )
        vector = np.empty(self._model.nq)
        for joint, position in zip(self._joints, positions, strict=True):
            if joint.nq == 2:
                vector[joint.idx_q : joint.idx_q + 2] = np.cos(position), np.sin(position)
            else:
                vector[joint.idx_q] = position
        return vector

    @lru_cache(maxsize=16)  # noqa: B019 a robot lives as long as its process
    def _known(self, names: tuple[str, ...]) -> "_Known":
        """The joints of the robot, sorted by what a message with these joints holds."""
        still = self.config.still
        known = {*names, *still} & {*self.joint_names}
        following = [name for name in self._mimics if name not in known]
        unknown = {*self.joint_names} - known - {*following}
        unknown |= {name for name in following if self._mimics[name].joint in unknown}
        found = [i for i, name in enumerate(self.joint_names) if name in names]
        rows = [names.index(self.joint_names[i]) for i in found]
        return _Known(
            np.array(found, np.intp),
            np.array(rows, np.intp),
            np.array([still.get(name, 0.0) for name in self.joint_names]),
            tuple(name for name in following if name not in unknown),
            tuple(name for name in self.joint_names if name in unknown),
        )

    def _followed(self, positions: FloatArray, following: Sequence[str]) -> FloatArray:
        """Set the positions of joints that mimic another, in place."""
        number = self.joint_names.index
        for name in following:
            driver, multiplier, offset = self._mimics[name]
            positions[number(name)] = multiplier * positions[number(driver)] + offset
        return positions

    def _unknown(self, unknown: Sequence[str], joints: JointState | None) -> str:
        """The sentence on the joints whose position is not known, and on how to configure them."""
        first = next(name for name in unknown if name not in self._mimics)
        mimics = [name for name, mimic in self._mimics.items() if mimic.joint == first]
        mimicked = "".join(f", which '{name}' mimics" for name in mimics if name in unknown)
        more = f" (and {len(unknown) - 1} more)" if len(unknown) > 1 else ""
        hint = "no reading of joints did"
        if joints is not None:
            hint = name_hint(first, joints.names, "joints of the reading")
        return (
            f"no position of joint '{first}' came{mimicked}{more}: {hint}; one that nothing "
            "measures is placed by `robot.still`"
        )

    @lru_cache(maxsize=16)  # noqa: B019 a robot lives as long as its process
    def _tops(self, unknown: tuple[str, ...]) -> dict[str, str]:
        """By link the root, or the nearest link above it that one of the unknown joints carries."""
        carried, parents = {self.urdf.children[name] for name in unknown}, self.urdf.parents
        tops = {}
        for link in self.link_names:
            top = link
            while top in parents and top not in carried:
                top = parents[top]
            if top != link:
                tops[link] = top
        return tops

    def require_mounted(self, frames: Mapping[str, FrameConfig]) -> None:
        """Refuse frames on links that are too far away for a robot of this size.

        Raises:
            ConfigurationError: one is, as in millimetres.
        """
        zero = self.poses_at(np.zeros(len(self.joint_names)))
        span = max(float(np.linalg.norm(pose[:3, 3])) for pose in zero.values())
        limit = max(MOUNTED, 2.0 * span)
        for name, frame in frames.items():
            for axis, given in enumerate(frame.xyz):
                if abs(given) > limit:
                    problem = LENGTH.implausible(given, math.copysign(limit, given))
                    raise ConfigurationError(problem, f"frames.{name}.xyz.{axis}")

    @property
    def moved_links(self) -> frozenset[str]:
        """The links that a joint moves against the root."""
        tops = self._tops(self.joint_names)
        return frozenset(n for n in self.link_names if tops.get(n, n) != self.root)

    def _check_names(self) -> None:
        """Refuse names of joints, links and frames that the URDF lacks."""
        config, joints, links = self.config, self.joint_names, self.urdf.links
        frames = {*links, *config.frames}
        named: list[tuple[str, str, Sequence[str] | set[str], str]] = []
        named += [(f"still.{name}", name, joints, "joint") for name in config.still]
        named += [("links", name, tuple(links), "link") for name in config.links or ()]
        for name, frame in config.frames.items():
            named.append((f"frames.{name}.parent", frame.parent, frames, "frame"))
        named += [(f"efforts.{name}", name, joints, "joint") for name in config.efforts]
        for kind in ("patches", "wrists", "cameras", "lidars"):
            for name, sensor in getattr(config, kind).items():
                named.append((f"{kind}.{name}.frame", sensor.frame, frames, "frame"))
        named += [(f"masses.{name}", name, tuple(links), "link") for name in config.masses]
        if config.payload is not None:
            named.append(("payload.frame", config.payload.frame, frames, "frame"))
        for name, finger in config.fingers.items():
            at = f"fingers.{name}"
            named += [(f"{at}.joints", joint, joints, "joint") for joint in finger.joints]
            named += [(f"{at}.links", link, tuple(links), "link") for link in finger.links]
        for path, name, known, what in named:
            if name not in known:
                hint = name_hint(name, known, f"{what}s")
                cure = "; give its pose on a link in `robot.frames`" if what == "frame" else ""
                raise ConfigurationError(f"unknown {what} '{name}': {hint}{cure}", path)

    def _carry(self, payload: PayloadConfig) -> None:
        """Add a payload to the link that carries it, as a point mass."""
        link = self.link_of(payload.frame)
        centre = points_in(self.pose_on_link(payload.frame), np.array([payload.centre_of_mass]))[0]
        self._payload = link, payload.mass, centre
        self._weigh(link, (payload.mass, centre))

    def _weigh(self, link: str, *added: tuple[float, Sequence[float] | FloatArray]) -> None:
        """Add point masses to a link: mass [kg], less than 0 to take it off, and position [m]."""
        carrier = self._model.frames[self._body[link]]
        inertia = self._model.inertias[carrier.parentJoint].toDynamicParameters()
        for mass, at in added:
            point = self._pin.Inertia(1.0, np.array(at), np.zeros((3, 3)))
            inertia = inertia + mass * carrier.placement.act(point).toDynamicParameters()
        changed = self._pin.Inertia.FromDynamicParameters(inertia)
        self._model.inertias[carrier.parentJoint] = changed

    def _fixed_frames(self) -> FrameTree:
        """The tree of the description's frames, from their links."""
        frames = self.config.frames
        for name in frames:
            if name in self.urdf.links:
                raise ConfigurationError("a link has this name already", f"frames.{name}")
        try:
            return FrameTree({name: (frame.parent, frame.pose()) for name, frame in frames.items()})
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
    """The robot of a description, built once in a process: fitting spheres takes seconds.

    Raises:
        RobotError: the URDF is not valid.
        ConfigurationError: a sensor is on a link that the URDF lacks, or frames form a circle.
        DependencyError: pinocchio is not installed.
    """
    return _built(config.model_dump_json())


@lru_cache(maxsize=4)
def _built(config: str) -> RobotModel:
    return RobotModel(RobotConfig.model_validate_json(config))
