"""Extrinsic self-calibration of a camera by the edges of the robot's own body."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, points_in, pose_of
from contactfusion.generators.proximity import BoxConfig
from contactfusion.vision import back_projected

REACH = 0.08
"""The greatest apparent offset of edges [m]: 3 cm and 2 degrees at 1.2 m."""
OWN = 0.015
"""The greatest distance of the body's points from the plane of its upper side [m]."""
STRIP = 0.05
"""Width of the strips of an edge [m]."""
LEAST = 12
"""The least number of pixels of a strip; of the upper side, its square."""
PIXELS = 20_000
"""Larger images are thinned to about this number of pixels."""
PRIOR = np.array([0.02, 0.02, 0.02])
"""Standard deviations of a camera's configured position, forward and lateral [m], and yaw [rad]."""
EDGE = 0.015
"""Standard deviation of the position of an edge in a strip of an image [m]. It is overestimated:
pixels are coarse, and errors of successive images are correlated."""
SETTLED = np.array([0.002, 0.002, 0.008])
"""Standard deviations at which the calibration ends."""
STEPS = 4
"""Iterations over the first image, each from the result of the last."""

Mask = NDArray[np.bool_]


class OwnBody:
    """Corrects the pose of a camera by its view of the body that carries it.

    The plane of the body's upper side determines height, roll and pitch; its sides determine yaw
    and the lateral position, its front edge the forward position. An edge lies where the share of
    pixels in a band around it that see the upper side puts it. Strips with something higher are
    left out, since it may hide the edge; what no strip determines stays as configured.

    Args:
        box: the body in the robot's frame, upright.
    """

    def __init__(self, box: BoxConfig) -> None:
        self._box = box
        self.reset()

    def reset(self) -> None:
        """Return to the configured pose."""
        self._mending: Pose = np.eye(4)
        self._images = 0
        self._known = np.diag(PRIOR**-2.0)
        self._settled = False

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations, forward and lateral [m] and yaw [rad], shape (3,)."""
        sigma: FloatArray = np.sqrt(np.diag(np.linalg.inv(self._known)))
        return sigma

    def mended(self, depth: FloatArray, intrinsics: FloatArray, pose: Pose) -> Pose:
        """The corrected pose of the camera in the robot's frame.

        Args:
            depth: shape (h, w) [m], 0 where there is no return.
            intrinsics: the camera matrix, shape (3, 3) [pixels].
            pose: of the camera in the robot's frame, as configured.
        """
        if not self._settled:
            every = max(1, round((depth.size / PIXELS) ** 0.5))
            thinned = depth[::every, ::every]
            rows, columns = np.nonzero(thinned)
            deep = thinned[rows, columns]
            self._look(back_projected(rows * every, columns * every, deep, intrinsics), pose)
        return self._mending @ pose

    def _look(self, points: FloatArray, pose: Pose) -> None:
        """Update the correction by points, shape (n, 3) [m], in the camera's frame."""
        mending, known, moved = self._mending, self._known, np.zeros(3)
        for _ in range(1 if self._images else STEPS):
            held = mending @ pose
            seen, camera = points_in(held, points), held[:3, 3]
            plane = self._plane(seen)
            if plane is None:
                return
            height, slope_x, slope_y = plane / (self._images + 1.0)
            lift = height + slope_x * camera[0] + slope_y * camera[1]
            level = _moved(camera, (-slope_y, slope_x, 0.0), (0.0, 0.0, -lift))
            terms, seems = self._edges(points_in(level, seen), points_in(level, camera))
            known = self._known + terms.T @ terms / EDGE**2
            rhs = terms.T @ seems / EDGE**2 - self._known @ moved
            forward, lateral, yaw = step = np.linalg.solve(known, rhs)
            moved = moved + step
            about, back = points_in(level, camera), (-forward, -lateral, 0.0)
            mending = _moved(about, (0.0, 0.0, -yaw), back) @ level @ mending
        self._mending, self._known = mending, known
        self._images += 1
        self._settled = bool(np.all(self.sigma <= SETTLED))

    def _plane(self, points: FloatArray) -> FloatArray | None:
        """The fitted upper side: height above the nominal at the frame's axis, and slopes."""
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

    def _edges(self, points: FloatArray, camera: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Apparent offsets of edges, and their derivatives by the camera's position and yaw.

        Args:
            points: shape (n, 3) [m], the upper side already level.
            camera: its position, shape (3,) [m].

        Returns:
            For each strip the derivatives of its offset by the camera's forward and lateral error
            [m] and its yaw error [rad], shape (s, 3), and the offset, shape (s,) [m].
        """
        (back, front), (right, left), (_, top) = self._box.x, self._box.y, self._box.z
        below = points[points[:, 2] < camera[2]]
        height = below[:, 2] - top
        own, higher = np.abs(height) < OWN, height >= OWN
        share = (camera[2] - top) / (camera[2] - below[:, 2])
        x, y = (camera[:2] + share[:, None] * (below[:, :2] - camera[:2])).T
        across, along = (right + REACH, left - REACH), (back + REACH, front - REACH)
        offsets, strips = _offsets(x - front, y, across, own, higher)
        ones, zeros = np.ones(len(strips)), np.zeros(len(strips))
        terms = [np.column_stack([ones, zeros, camera[1] - strips])]
        seems = [offsets]
        for edge, sign in ((left, 1.0), (right, -1.0)):
            offsets, strips = _offsets(sign * (y - edge), x, along, own, higher)
            ones, zeros = np.ones(len(strips)), np.zeros(len(strips))
            terms.append(np.column_stack([zeros, ones, strips - camera[0]]))
            seems.append(sign * offsets)
        return np.concatenate(terms), np.concatenate(seems)


def _offsets(
    beyond: FloatArray, along: FloatArray, span: tuple[float, float], own: Mask, higher: Mask
) -> tuple[FloatArray, FloatArray]:
    """Apparent offset of an edge in each free strip, outward, and the strip's position along it.

    Args:
        beyond: shape (n,) [m], distance of pixels outside the edge, on the plane of the upper side.
        along: shape (n,) [m], their position along the edge.
        span: range of positions that are used [m].
        own: shape (n,), whether they see the upper side.
        higher: shape (n,), whether they see something higher.
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


def _moved(about: FloatArray, rotation_vector: Sequence[float], shift: Sequence[float]) -> Pose:
    """The pose that rotates by a rotation vector [rad] about a point, then shifts [m]."""
    from scipy.spatial.transform import Rotation

    matrix = Rotation.from_rotvec(rotation_vector).as_matrix()
    return pose_of(about - matrix @ about + np.asarray(shift), matrix)
