"""What a depth camera on the base sees of a push."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, inverse, points_in, pose_at, vectors_in
from contactfusion.robots.description import CameraConfig
from contactfusion.vision import back_projected
from contactfusion_lab.scenes.camera import RangeCamera
from contactfusion_lab.simulation.push_bodies import ORIGIN_HEIGHT
from contactfusion_lab.simulation.push_config import CameraNoise
from contactfusion_lab.simulation.push_view import Planar, PushView, Rays

Mask = NDArray[np.bool_]
FLOOR, CHASSIS = (150.0, 146.0, 138.0), (60.0, 62.0, 66.0)
"""Red, green and blue, of 255."""
STEP = 0.05
"""Stereo has holes where depth steps by more [m]."""
LIGHT = 1.5
"""The lamp is at the camera; at this distance things have half of their brightness [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One image.

    Attributes:
        depth: shape (h, w) [m], 0 where nothing is measured.
        colour: shape (h, w, 3), red, green and blue.
        mask: shape (h, w), where the object is.
    """

    depth: FloatArray
    colour: NDArray[np.uint8]
    mask: Mask


class PushCamera:
    """A depth camera with colour, the depth aligned to it.

    Only pixels on which the object can lie are cast anew; all others see the floor or the base,
    which stand still.

    Args:
        config: its lens and reach.
        pose: where it is in the base's frame.
        view: what there is to see.
        corners: shape (v, 3) [m], those of the object in its frame; it lies between them.
        noise: how wrong it is.
        paint: red, green and blue of the object, of 255.
    """

    def __init__(
        self,
        config: CameraConfig,
        pose: Pose,
        view: PushView,
        corners: FloatArray,
        noise: CameraNoise,
        paint: FloatArray,
    ) -> None:
        self._camera, self._noise, self._view = RangeCamera(config), noise, view
        self._pose, self._corners, self._paint = pose, corners, paint
        self._size = config.height, config.width
        self.intrinsics = self._camera.intrinsics
        """Shape (3, 3) [pixels]."""
        v, u = np.indices(self._size).reshape(2, -1)
        ahead = back_projected(v, u, np.ones(len(u)), self.intrinsics)
        self._rays = view.rays(pose[:3, 3], vectors_in(pose, ahead))
        still = np.where(np.isfinite(self._rays.still), self._rays.still, 0.0)
        heights = pose[2, 3] + still * self._rays.directions[:, 2]
        on_floor = np.abs(heights + ORIGIN_HEIGHT) < 1e-3
        self._still_paint = np.where(on_floor[:, None], FLOOR, CHASSIS).astype(np.float32)

    def picture(self, base: Planar, thing: Planar, rng: np.random.Generator) -> Picture:
        """Take an image.

        Args:
            base: where the base is.
            thing: where the object is.
            rng: of the noise.
        """
        depth, mask = self._true(base, thing)
        return Picture(self._measured(depth, rng), self._coloured(depth, mask, rng), mask)

    def _true(self, base: Planar, thing: Planar) -> tuple[FloatArray, Mask]:
        depth, mask = self._rays.still.copy(), np.zeros(len(self._rays.still), np.bool_)
        pixels = np.arange(len(depth)).reshape(self._size)[self._window(base, thing)].ravel()
        rays = self._rays
        near = Rays(rays.origin, rays.directions[pixels], rays.still[pixels])
        depth[pixels], mask[pixels] = self._view.distances(near, base, thing)
        return depth.reshape(self._size), mask.reshape(self._size)

    def _window(self, base: Planar, thing: Planar) -> tuple[slice, slice]:
        """Give the rows and columns between which the object lies; all when it is beside it."""
        to_base = inverse(_standing(base, ORIGIN_HEIGHT)) @ _standing(thing, 0.0)
        corners = points_in(inverse(self._pose) @ to_base, self._corners)
        if corners[:, 2].min() < self._camera.config.reach[0]:
            return slice(None), slice(None)
        pixels = corners @ self.intrinsics.T
        places = pixels[:, :2] / pixels[:, 2:]
        limits = np.array(self._size[::-1])
        first = np.clip(np.floor(places.min(axis=0)), 0, limits).astype(int)
        last = np.clip(np.ceil(places.max(axis=0)) + 1, 0, limits).astype(int)
        return slice(first[1], last[1]), slice(first[0], last[0])

    def _measured(self, depth: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Add noise, σ = z² disparity / (focal baseline), and holes."""
        noise = self._noise
        share = noise.disparity / (noise.focal * noise.baseline)
        off = rng.standard_normal(depth.shape, np.float32)
        chance = rng.random(depth.shape, np.float32)
        measured = np.where(np.isfinite(depth), depth, 0.0)
        measured += share * measured**2 * off
        measured = np.rint(measured / noise.unit) * noise.unit
        measured[chance < np.where(beside_steps(depth), noise.edges, noise.holes)] = 0.0
        return self._camera.within_reach(measured)

    def _coloured(
        self, depth: FloatArray, mask: Mask, rng: np.random.Generator
    ) -> NDArray[np.uint8]:
        paint = self._still_paint.reshape(*self._size, 3).copy()
        paint[mask] = self._paint
        paint *= (2.0 / (1.0 + (depth / LIGHT) ** 2)).astype(np.float32)[..., None]
        paint += self._noise.colour * rng.standard_normal(paint.shape, np.float32)
        return np.clip(paint, 0.0, 255.0).astype(np.uint8)


def beside_steps(depth: FloatArray) -> Mask:
    """Tell which pixels differ from one beside, above or below them by more than `STEP`.

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


def _standing(planar: Planar, height: float) -> Pose:
    x, y, yaw = planar
    return pose_at((x, y, height), (0.0, 0.0, yaw))
