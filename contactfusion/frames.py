"""Frames: a tree of poses, and what one frame is in another."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from contactfusion.arrays import FloatArray
from contactfusion.errors import FrameError, name_hint

Pose = FloatArray
"""A rigid transform as a homogeneous matrix, shape (4, 4): it takes a frame to its parent."""


def pose_of(xyz: ArrayLike, rotation: ArrayLike | None = None) -> Pose:
    """Give the pose of a frame whose origin lies at `xyz` [m], turned by a matrix (3, 3)."""
    pose = np.eye(4)
    pose[:3, 3] = xyz
    if rotation is not None:
        pose[:3, :3] = rotation
    return pose


def pose_at(xyz: Sequence[float], rpy: Sequence[float]) -> Pose:
    """Give the pose at `xyz` [m], turned by roll, pitch and yaw about fixed axes [rad]."""
    from scipy.spatial.transform import Rotation

    return pose_of(xyz, Rotation.from_euler("xyz", rpy).as_matrix())


def inverse(pose: Pose) -> Pose:
    """Give the way back."""
    turned_back = pose[:3, :3].T
    return pose_of(-turned_back @ pose[:3, 3], turned_back)


class FrameTree:
    """Poses of frames in their parents; immutable.

    Args:
        parents: for each child frame its parent and its pose there (child to parent).

    Raises:
        FrameError: the frames form a circle.
    """

    def __init__(self, parents: Mapping[str, tuple[str, Pose]]) -> None:
        self._parents = dict(parents)
        self._cache: dict[tuple[str, str], Pose] = {}
        sound: set[str] = set()
        for frame in self._parents:
            chain: list[str] = []
            while frame in self._parents and frame not in sound:
                if frame in chain:
                    raise FrameError(f"the frames form a circle: {' -> '.join([*chain, frame])}")
                chain.append(frame)
                frame = self._parents[frame][0]
            sound.update(chain)

    @property
    def frames(self) -> frozenset[str]:
        """All frames of the tree."""
        return frozenset(self._parents) | {parent for parent, _ in self._parents.values()}

    def extended(self, parents: Mapping[str, tuple[str, Pose]]) -> "FrameTree":
        """Give the tree with further frames, or with new poses for some."""
        return FrameTree({**self._parents, **parents})

    def pose(self, frame: str, of: str) -> Pose:
        """Give the pose of frame `of` in `frame`: it takes coordinates of `of` to `frame`.

        Raises:
            FrameError: a frame is unknown, or no chain of poses joins the two.
        """
        key = (frame, of)
        if key not in self._cache:
            pose = self._pose(frame, of).copy()
            pose.flags.writeable = False
            self._cache[key] = pose
        return self._cache[key]

    def _pose(self, frame: str, of: str) -> Pose:
        if frame == of:
            return pose_of((0.0, 0.0, 0.0))
        for name in (of, frame):
            if name not in self.frames:
                hint = name_hint(name, self.frames, "frames")
                raise FrameError(f"unknown frame '{name}': {hint}")
        up_from, up_to = self._chain(of), self._chain(frame)
        shared = next((name for name in up_from if name in up_to), None)
        if shared is None:
            raise FrameError(
                f"no transform joins '{of}' to '{frame}': "
                f"'{of}' hangs under '{next(reversed(up_from))}', "
                f"'{frame}' under '{next(reversed(up_to))}'"
            )
        return inverse(up_to[shared]) @ up_from[shared]

    def _chain(self, frame: str) -> dict[str, Pose]:
        """Give, from the frame up to its root, each ancestor with the frame's pose in it."""
        pose = pose_of((0.0, 0.0, 0.0))
        chain = {frame: pose}
        while frame in self._parents:
            frame, step = self._parents[frame]
            pose = step @ pose
            chain[frame] = pose
        return chain


def points_in(pose: Pose, points: FloatArray) -> FloatArray:
    """Take points of shape (n, 3) [m] to the frame that the pose is given in."""
    moved: FloatArray = points @ pose[:3, :3].T + pose[:3, 3]
    return moved


def vectors_in(pose: Pose, vectors: FloatArray) -> FloatArray:
    """Turn vectors of shape (n, 3) into another frame."""
    turned: FloatArray = vectors @ pose[:3, :3].T
    return turned
