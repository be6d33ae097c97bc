"""Where a camera stands that sees the robot itself: its pose, mended by the robot's own edges."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in, pose_of
from contactfusion.generators.proximity import BoxConfig
from contactfusion.vision import back_projected

REACH = 0.08
"""Edges may seem to lie so far from where they are [m]: 3 cm and 2 degrees at 1.2 m."""
OWN = 0.015
"""What is so near to the plane of the body's upper side is the body [m]."""
STRIP = 0.05
"""Edges are looked at in strips of this width [m]."""
LEAST = 12
"""So many pixels of a strip have to be seen, and of the upper side its square."""
PIXELS = 20_000
"""Larger images are thinned to about so many pixels."""
PRIOR = np.array([0.02, 0.02, 0.02])
"""Standard deviation of how far ahead [m], to the left [m] and turned [rad] a camera may stand from
where it is said to."""
EDGE = 0.015
"""Standard deviation of where a strip seems to end in an image [m]. It is stated too large: pixels
are coarse, and those of the next image err alike."""
SETTLED = np.array([0.002, 0.002, 0.008])
"""Once all is known as well as this, the pose is kept."""
STEPS = 4
"""The first image is gone through so often, each time from where the last ended."""

Mask = NDArray[np.bool_]


class OwnBody:
    """Mends the pose of a camera by what it sees of the body that carries it.

    The plane of the body's upper side tells height, roll and pitch; its sides tell yaw and how far
    to the left the camera stands, its front edge how far ahead. An edge lies where the share of
    pixels that see the upper side says, among those in a band around it. Strips of it in which
    something higher stands are left out, since it may hide the edge; what no strip tells stays as
    it is said to be.

    Args:
        box: the body in the robot's frame, upright.
    """

    def __init__(self, box: BoxConfig) -> None:
        self._box = box
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self._mending: Pose = np.eye(4)
        self._images = 0
        self._known = np.diag(PRIOR**-2.0)
        self._settled = False

    @property
    def sigma(self) -> FloatArray:
        """How well is known where the camera is ahead, aside [m] and turned [rad], shape (3,)."""
        sigma: FloatArray = np.sqrt(np.diag(np.linalg.inv(self._known)))
        return sigma

    def mended(self, depth: FloatArray, intrinsics: FloatArray, pose: Pose) -> Pose:
        """Give the pose that puts the body where it is, as far as it was seen.

        Args:
            depth: shape (h, w) [m], 0 where there is no return.
            intrinsics: the camera matrix, shape (3, 3) [pixels].
            pose: of the camera in the robot's frame, as it is said to be.
        """
        if not self._settled:
            every = max(1, round((depth.size / PIXELS) ** 0.5))
            thinned = depth[::every, ::every]
            rows, columns = np.nonzero(thinned)
            deep = thinned[rows, columns]
            self._look(back_projected(rows * every, columns * every, deep, intrinsics), pose)
        return self._mending @ pose

    def _look(self, points: FloatArray, pose: Pose) -> None:
        """Learn from what points, shape (n, 3) [m] in the camera's frame, tell of the body."""
        mending, known, moved = self._mending, self._known, np.zeros(3)
        for _ in range(1 if self._images else STEPS):
            held = mending @ pose
            seen, eye = points_in(held, points), held[:3, 3]
            plane = self._plane(seen)
            if plane is None:
                return
            height, slope_x, slope_y = plane / (self._images + 1.0)
            lift = height + slope_x * eye[0] + slope_y * eye[1]
            level = _moved(eye, (-slope_y, slope_x, 0.0), (0.0, 0.0, -lift))
            terms, seems = self._edges(points_in(level, seen), points_in(level, eye))
            known = self._known + terms.T @ terms / EDGE**2
            told = terms.T @ seems / EDGE**2 - self._known @ moved
            ahead, aside, yaw = step = np.linalg.solve(known, told)
            moved = moved + step
            turn = _moved(points_in(level, eye), (0.0, 0.0, -yaw), (-ahead, -aside, 0.0))
            mending = turn @ level @ mending
        self._mending, self._known = mending, known
        self._images += 1
        self._settled = bool(np.all(self.sigma <= SETTLED))

    def _plane(self, points: FloatArray) -> FloatArray | None:
        """Fit the upper side: how much too high it seems at the frame's axis, and its slopes."""
        box, top = self._box, self._box.z[1]
        near = np.abs(points[:, 2] - top) < REACH
        for axis, (first, last) in ((0, box.x), (1, box.y)):
            near &= (points[:, axis] > first + REACH) & (points[:, axis] < last - REACH)
        x, y, z = points[near].T
        if len(x) < LEAST**2:
            return None
        terms = np.column_stack([np.ones(len(x)), x, y])
        kept = np.abs(z - np.median(z)) < REACH / 2.0
        fitted: FloatArray = np.linalg.lstsq(terms[kept], z[kept] - top, rcond=None)[0]
        return fitted

    def _edges(self, points: FloatArray, eye: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Give how far out edges seem to lie, and what that tells of where the camera is.

        Args:
            points: shape (n, 3) [m], the upper side already level.
            eye: where the camera is, shape (3,) [m].

        Returns:
            For each strip by how much it would seem moved, were the camera taken to be ahead [m],
            to the left [m] and turned [rad] by one, shape (s, 3), and by how much it seems to be,
            shape (s,) [m].
        """
        (back, front), (right, left), (_, top) = self._box.x, self._box.y, self._box.z
        below = points[points[:, 2] < eye[2]]
        height = below[:, 2] - top
        own, higher = np.abs(height) < OWN, height >= OWN
        share = (eye[2] - top) / (eye[2] - below[:, 2])
        x, y = (eye[:2] + share[:, None] * (below[:, :2] - eye[:2])).T
        across, along = (right + REACH, left - REACH), (back + REACH, front - REACH)
        offsets, places = _offsets(x - front, y, across, own, higher)
        terms = [np.column_stack([np.ones(len(places)), np.zeros(len(places)), eye[1] - places])]
        seems = [offsets]
        for edge, sign in ((left, 1.0), (right, -1.0)):
            offsets, places = _offsets(sign * (y - edge), x, along, own, higher)
            lever = places - eye[0]
            terms.append(np.column_stack([np.zeros(len(places)), np.ones(len(places)), lever]))
            seems.append(sign * offsets)
        return np.concatenate(terms), np.concatenate(seems)


def _offsets(
    beyond: FloatArray, along: FloatArray, span: tuple[float, float], own: Mask, higher: Mask
) -> tuple[FloatArray, FloatArray]:
    """Give how far out an edge seems to lie in each free strip, and where along the edge that is.

    Args:
        beyond: shape (n,) [m], how far outside the edge pixels lie, on the plane of the upper side.
        along: shape (n,) [m], where along the edge.
        span: the edge is looked at between these.
        own: shape (n,), whether they see the upper side.
        higher: shape (n,), whether they see what is higher.
    """
    band = (np.abs(beyond) < REACH) & (along > span[0]) & (along < span[1])
    strip = ((along[band] - span[0]) / STRIP).astype(np.intp)
    count = np.bincount(strip)
    mine = np.bincount(strip, own[band], len(count))
    hidden = np.bincount(strip, higher[band], len(count)) > 0
    whole = count >= max(LEAST, count.max(initial=0) / 2.0)
    free = whole & ~hidden & (mine > 0) & (mine < count)
    middles = np.bincount(strip, along[band], len(count))[free] / count[free]
    return (2.0 * mine[free] / count[free] - 1.0) * REACH, middles


def _moved(about: FloatArray, turn: Sequence[float], shift: Sequence[float]) -> Pose:
    """Give the pose that turns by a rotation vector [rad] about a place, then shifts [m]."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_rotvec(turn).as_matrix()
    return pose_of(about - rotation @ about + np.asarray(shift), rotation)
