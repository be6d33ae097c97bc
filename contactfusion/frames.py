"""Frames: trees of poses, lookup of one frame in another, and frames by configuration."""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from contactfusion.arrays import FloatArray, frozen
from contactfusion.errors import FrameError, name_hint
from contactfusion.model import Model
from contactfusion.units import Angles, Position

Pose = FloatArray
"""A rigid transform as a homogeneous matrix, shape (4, 4), from a frame to its parent."""
Parent = tuple[str, Pose]
"""The parent of a frame, and the frame's pose there."""
PlanarPose = tuple[float, float, float]
"""A pose on the floor: x, y [m] and yaw [rad]."""
Planar = tuple[float, float]
"""A point [m] or a vector on the floor."""


class Above(Protocol):
    """Frames beside those of a tree, whose poses are computed only when a chain needs them."""

    @property
    def frames(self) -> frozenset[str]:
        """All frames."""
        ...

    def parent_of(self, frame: str) -> Parent | None:
        """The parent of a frame and its pose there; None for a root, or an unknown frame.

        Raises:
            FrameError: the pose is not known at this time.
        """
        ...

    def nearest(self) -> "Above":
        """The same frames; unknown poses are those known nearest in time."""
        ...


def pose_of(xyz: ArrayLike, rotation: ArrayLike | None = None) -> Pose:
    """The pose of a frame with its origin at `xyz` [m], rotated by a matrix (3, 3)."""
    pose = np.eye(4)
    pose[:3, 3] = xyz
    if rotation is not None:
        pose[:3, :3] = rotation
    return pose


def pose_at(xyz: Sequence[float], rpy: Sequence[float]) -> Pose:
    """The pose at `xyz` [m], rotated by roll, pitch and yaw about fixed axes [rad]."""
    from scipy.spatial.transform import Rotation

    return pose_of(xyz, Rotation.from_euler("xyz", rpy).as_matrix())


def inverse(pose: Pose) -> Pose:
    """The inverse of a pose."""
    turned_back = pose[:3, :3].T
    return pose_of(-turned_back @ pose[:3, 3], turned_back)


def apart(pose: Pose, other: Pose) -> tuple[float, float]:
    """The distance [m] and the angle [rad] between two poses of a frame."""
    cosine = (np.trace(pose[:3, :3].T @ other[:3, :3]) - 1.0) / 2.0
    distance = float(np.linalg.norm(pose[:3, 3] - other[:3, 3]))
    return distance, float(np.arccos(np.clip(cosine, -1.0, 1.0)))


class FrameTree:
    """Poses of frames in their parents; immutable.

    Args:
        parents: for each child frame its parent and its pose there (child to parent).
        above: further frames; `parents` takes precedence.
        origins: for frames that no pose may name, such as that of the hypothesis space, their words
            in sentences: the frame and its origin.

    Raises:
        FrameError: the frames of `parents` form a circle.
    """

    def __init__(
        self,
        parents: Mapping[str, Parent],
        above: Above | None = None,
        origins: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._parents = dict(parents)
        self._above = above
        self._origins = dict(origins)
        self._cache: dict[tuple[str, str], Pose] = {}
        sound: set[str] = set()
        for frame in self._parents:
            chain: list[str] = []
            while frame in self._parents and frame not in sound:
                if frame in chain:
                    raise _circle([*chain, frame])
                chain.append(frame)
                frame = self._parents[frame][0]
            sound.update(chain)

    @property
    def frames(self) -> frozenset[str]:
        """All frames of the tree."""
        names = frozenset(self._parents) | {parent for parent, _ in self._parents.values()}
        return names if self._above is None else names | self._above.frames

    def under(self, above: Above) -> "FrameTree":
        """The tree with further frames, such as those of a recording."""
        return FrameTree(self._parents, above, self._origins)

    def extended(self, parents: Mapping[str, Parent]) -> "FrameTree":
        """The tree with further frames, or with new poses for some."""
        return FrameTree({**self._parents, **parents}, self._above, self._origins)

    def nearest(self) -> "FrameTree":
        """The tree in which unknown poses are those known nearest in time."""
        return self if self._above is None else self.under(self._above.nearest())

    def pose(self, frame: str, of: str) -> Pose:
        """The pose of frame `of` in `frame`: it transforms coordinates from `of` to `frame`.

        Raises:
            FrameError: a frame is unknown, or no chain of poses joins the two.
        """
        key = (frame, of)
        if key not in self._cache:
            self._cache[key] = frozen(self._pose(frame, of))
        return self._cache[key]

    def root(self, of: str) -> str:
        """The topmost ancestor of a frame; an unknown frame is its own.

        Raises:
            FrameError: a pose on the path is not known at this time, or the frames form a circle.
        """
        chain, unknown = self._chain(of)
        if unknown:
            raise unknown
        return next(reversed(chain))

    def ancestors(self, of: str) -> tuple[str, ...]:
        """The frame itself and its ancestors, nearest first, as far as poses are known.

        Raises:
            FrameError: the frames form a circle.
        """
        return tuple(self._chain(of)[0])

    def _pose(self, frame: str, of: str) -> Pose:
        if frame == of:
            return pose_of((0.0, 0.0, 0.0))
        known = self.frames
        if unknown_names := [name for name in (of, frame) if name not in known]:
            raise FrameError(self._unknown(of, frame, unknown_names))
        (up_from, unknown), (up_to, unknown_to) = self._chain(of), self._chain(frame)
        shared = next((name for name in up_from if name in up_to), None)
        if shared is not None:  # unknown poses above it do not matter
            return inverse(up_to[shared]) @ up_from[shared]
        raise (
            unknown
            or unknown_to
            or FrameError(
                f"no transform joins '{of}' to '{frame}': "
                f"'{of}' hangs under '{next(reversed(up_from))}', "
                f"'{frame}' under '{next(reversed(up_to))}'"
            )
        )

    def _unknown(self, of: str, frame: str, unknown: Sequence[str]) -> str:
        """The sentence on frames without a pose, of the two to be joined."""
        name = next((name for name in unknown if name not in self._origins), unknown[0])
        other = frame if name == of else of
        hint = name_hint(name, self.frames, "frames")
        if not self.frames:
            where = self._origins.get(other, f"'{other}'")
            return f"unknown frame '{name}': {hint}; `frames` or a `robot` can place it in {where}"
        if name in self._origins:
            above = next(reversed(self._chain(other)[0]))
            return (
                f"nothing joins '{other}' to {self._origins[name]}, which is unknown: {hint}; "
                f"name a known frame there, such as '{above}', or place it by `frames`"
            )
        return (
            f"unknown frame '{name}': {hint}; where no transform places it, `frames` or "
            "`robot.frames` can"
        )

    def _chain(self, frame: str) -> tuple[dict[str, Pose], FrameError | None]:
        """Each ancestor of a frame with the frame's pose in it, nearest first.

        Second, why the chain ends before the root: a pose that is unknown at this time.
        """
        pose = pose_of((0.0, 0.0, 0.0))
        chain = {frame: pose}
        while True:
            try:
                parent = self._parent_of(frame)
            except FrameError as error:
                return chain, error
            if parent is None:
                return chain, None
            frame, step = parent
            if frame in chain:
                raise _circle([*chain, frame])
            pose = step @ pose
            chain[frame] = pose

    def _parent_of(self, frame: str) -> Parent | None:
        parent = self._parents.get(frame)
        if parent is None and self._above is not None:
            parent = self._above.parent_of(frame)
        return parent


def _circle(chain: Sequence[str]) -> FrameError:
    return FrameError(f"the frames form a circle: {' -> '.join(chain)}")


def points_in(pose: Pose, points: FloatArray) -> FloatArray:
    """Points of shape (n, 3) [m], transformed to the parent frame of the pose."""
    moved: FloatArray = points @ pose[:3, :3].T
    moved += pose[:3, 3]
    return moved


def vectors_in(pose: Pose, vectors: FloatArray) -> FloatArray:
    """Vectors of shape (n, 3), rotated to the parent frame of the pose."""
    turned: FloatArray = vectors @ pose[:3, :3].T
    return turned


def planar_pose(planar: PlanarPose, height: float) -> Pose:
    """The pose at x and y, `height` [m] above the floor, rotated by the yaw."""
    x, y, yaw = planar
    return pose_at((x, y, height), (0.0, 0.0, yaw))


def planar_point(planar: PlanarPose, point: Planar) -> Planar:
    """A point of the frame at a planar pose, in the frame of that pose: p + R q [m]."""
    (x, y, yaw), (forward, lateral) = planar, point
    cos, sin = math.cos(yaw), math.sin(yaw)
    return x + cos * forward - sin * lateral, y + sin * forward + cos * lateral


def planar_turned(vector: Planar, yaw: float) -> Planar:
    """A vector of a frame that is rotated by a yaw [rad], in its parent frame: R v."""
    cos, sin, (x, y) = math.cos(yaw), math.sin(yaw), vector
    return cos * x - sin * y, sin * x + cos * y


def planar_turned_back(vector: Planar, yaw: float) -> Planar:
    """A vector of the parent frame in a frame that is rotated by a yaw [rad]: Rᵀ v."""
    cos, sin, (x, y) = math.cos(yaw), math.sin(yaw), vector
    return cos * x + sin * y, cos * y - sin * x


def planar_rotation(yaw: float) -> FloatArray:
    """The matrix of a rotation by a yaw [rad], shape (2, 2)."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, -sin], [sin, cos]])


def yaw_quaternion(yaw: float) -> FloatArray:
    """The quaternion x, y, z, w of a rotation by a yaw [rad], shape (4,)."""
    return np.array([0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)])


class FrameConfig(Model):
    """A static frame in its parent."""

    parent: str = Field(min_length=1)
    """The parent frame, in which `xyz` and the rotation are given."""
    xyz: Position = (0.0, 0.0, 0.0)
    """The origin in the parent [m]."""
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
        """The pose of the frame in its parent."""
        if self.quaternion is None:
            return pose_at(self.xyz, self.rpy or (0.0, 0.0, 0.0))
        from scipy.spatial.transform import Rotation

        return pose_of(self.xyz, Rotation.from_quat(self.quaternion).as_matrix())
