"""Segmentation of the pushed object by depth: what stands on the floor before the robot's face."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.frames import Pose, vectors_in
from contactfusion.generators.proximity import BoxConfig
from contactfusion.hooks import hookimpl
from contactfusion.readings import DepthImage
from contactfusion.segmenter import Mask, Segmenter, SegmenterConfig
from contactfusion.units import Metres, Nearby, Reach, Spread
from contactfusion.vision import back_projected, loaded_opencv, returns

CELL = 0.01
"""Cell of the view from above [m]."""
FORWARD, BEHIND, LATERAL = 2.0, 0.8, 1.4
"""How far the view reaches forward of the face, behind it, and to either side [m]."""
KEPT = 0.3
"""The object is lost when a smaller share of its last mask is covered by what stands there now."""
NARROW = 160
"""Width of images in which holes beside the object are filled by one pixel, by more in larger."""

Ground = NDArray[np.int32]
BITS = 3
"""Leading bits of red, green and blue that tell colours apart."""
SMALL = 160
"""The greatest width of the image from which colours are learned [pixels]."""
ROUNDS = 2
"""Iterations of GrabCut."""
NEAREST = 3
"""The greatest correction of the object's border by GrabCut, in pixels of that image."""


class ClustersConfig(SegmenterConfig):
    """The options of `clusters`."""

    type: str = "clusters"
    """The segmenter, by name."""
    floor: Nearby = -0.45
    """Height of the floor in the robot's frame [m]."""
    clearance: Spread = Field(default=0.05, ge=0)
    """What rises less above the floor counts as floor [m]."""
    face: Nearby = 0.30
    """The x of the robot's face; the object is what stands nearest to it at the start [m]."""
    width: Reach = Field(default=0.60, gt=0)
    """Width of the face [m]."""
    robot: tuple[BoxConfig, ...] = (BoxConfig(x=(-1.0, 0.31), y=(-0.35, 0.35), z=(-0.45, -0.02)),)
    """Boxes around the robot's own parts that the camera sees, in the robot's frame."""
    gap: Metres = Field(default=0.03, gt=0, le=0.5)
    """Objects that stand nearer to each other, seen from above, are merged [m]."""
    least: float = Field(default=0.003, ge=0)
    """The least area of an object, seen from above [m²]."""


class ClustersSegmenter(Segmenter[ClustersConfig]):
    """Clusters of what stands on the floor, seen from above, without the robot itself.

    At the start the cluster nearest to the face is the object; from then on it is the cluster that
    covers most of the last mask. Pixels without depth beside it belong to the object when their
    colour is more frequent in it than in the rest; GrabCut learns the colours, once it is found.
    """

    Config = ClustersConfig

    def __init__(self, config: ClustersConfig) -> None:
        super().__init__(config)
        loaded_opencv()
        self._view: tuple[bytes, NDArray[np.float32]] | None = None
        x, y = (CELL * (np.arange(n) + 0.5) for n in _GRID)
        forward = np.maximum(x - BEHIND, 0.0)
        lateral = np.maximum(np.abs(y - LATERAL) - config.width / 2.0, 0.0)
        self._distance = np.hypot(forward[:, None], lateral)
        self.reset()

    def reset(self) -> None:
        """Forget the object."""
        self._last: Mask | None = None
        self._paint: Paint | None = None

    def segment(self, image: DepthImage, pose: Pose) -> Mask | None:
        """The mask of the object; None when it is lost, or there is none at the start."""
        depth = returns(image.depth).astype(np.float32)
        pixels, cells = self._standing(image, depth, pose)
        ground = self._ground(cells)
        labels = np.zeros(depth.shape, np.int32)
        labels.reshape(-1)[pixels] = ground.reshape(-1)[cells]
        label = self._nearest(ground) if self._last is None else _covering(labels, self._last)
        if label == 0:
            self.reset()
            return None
        mask = labels == label
        if self._last is None and image.colour is not None:
            self._paint = learned_paint(image.colour, mask)
        self._last = self._filled(mask, depth, image.colour)
        return self._last

    def _standing(
        self, image: DepthImage, depth: NDArray[np.float32], pose: Pose
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Pixels of what is neither floor nor robot, and their cells on the ground."""
        rays, config = self._rays(image, pose), self.config
        height = depth * rays[2] + np.float32(pose[2, 3])
        above = (depth > 0.0) & (height > config.floor + config.clearance)
        pixels = np.flatnonzero(above)
        z, far = height.ravel()[pixels], depth.ravel()[pixels]
        x, y = (
            far * ray.ravel()[pixels] + np.float32(start)
            for ray, start in zip(rays[:2], pose[:2, 3], strict=True)
        )
        points = np.stack([x, y, z]).T
        kept = (np.abs(y) < LATERAL) & (x > config.face - BEHIND) & (x < config.face + FORWARD)
        for box in config.robot:
            kept &= ~box.holds(points)
        rows = ((x[kept] - (config.face - BEHIND)) / CELL).astype(np.intp)
        columns = ((y[kept] + LATERAL) / CELL).astype(np.intp)
        rows, columns = np.minimum(rows, _GRID[0] - 1), np.minimum(columns, _GRID[1] - 1)
        return pixels[kept], rows * _GRID[1] + columns

    def _rays(self, image: DepthImage, pose: Pose) -> NDArray[np.float32]:
        """The ray of each pixel for a depth of 1 m in the robot's frame, shape (3, h, w)."""
        key = b"".join(a.tobytes() for a in (image.intrinsics, pose, np.array(image.depth.shape)))
        if self._view is None or self._view[0] != key:
            rows, columns = np.indices(image.depth.shape)
            optical = back_projected(rows, columns, np.ones(image.depth.shape), image.intrinsics)
            rays = vectors_in(pose, optical.reshape(-1, 3)).T.astype(np.float32)
            self._view = key, np.ascontiguousarray(rays).reshape(3, *image.depth.shape)
        return self._view[1]

    def _ground(self, cells: NDArray[np.intp]) -> Ground:
        """The cluster of each cell of the ground, from 1 on; 0 where nothing stands."""
        cv2 = loaded_opencv()
        occupied = np.zeros(_GRID, np.uint8)
        occupied.reshape(-1)[cells] = 1
        reach = max(1, round(self.config.gap / CELL))  # of 0 OpenCV would make 3
        joined = cv2.dilate(occupied, np.ones((reach, reach), np.uint8))
        count, components = cv2.connectedComponents(joined)
        standing = np.flatnonzero(occupied)
        found = components.reshape(-1)[standing]
        sizes = np.bincount(found, minlength=count)
        large = np.where(sizes * CELL**2 < self.config.least, 0, np.arange(count))
        labels: Ground = np.zeros(_GRID, np.int32)
        labels.reshape(-1)[standing] = large[found]
        return labels

    def _nearest(self, ground: Ground) -> int:
        """The cluster that is nearest to the face, 0 if there is none."""
        return int(ground.reshape(-1)[np.argmin(np.where(ground > 0, self._distance, np.inf))])

    def _filled(
        self, mask: Mask, depth: NDArray[np.float32], colour: NDArray[np.uint8] | None
    ) -> Mask:
        """The mask with pixels around that lack depth and have its colour, or lie mostly in it."""
        cv2 = loaded_opencv()
        side = 2 * max(1, round(mask.shape[1] / NARROW)) + 1
        share = cv2.blur(mask.astype(np.float32), (side, side))
        holes = np.flatnonzero((depth == 0.0) & (share > 0.0))
        if self._paint is None or colour is None:
            own = share.ravel()[holes] > 0.5
        else:
            own = self._paint.covers(colour.reshape(-1, 3)[holes])
        filled = mask.copy()
        filled.reshape(-1)[holes[own]] = True
        return filled


_GRID = round((FORWARD + BEHIND) / CELL), round(2.0 * LATERAL / CELL)


def _covering(labels: Ground, last: Mask) -> int:
    """The cluster that covers most of the last mask, 0 if it is too little."""
    if labels.shape != last.shape:
        return 0
    counts = np.bincount(labels[last])
    counts[0] = 0
    label = int(np.argmax(counts))
    return label if counts[label] >= KEPT * np.count_nonzero(last) else 0


@hookimpl
def contactfusion_segmenters() -> Mapping[str, type[Segmenter[Any]]]:
    """The segmenter."""
    return {"clusters": ClustersSegmenter}


@dataclass(frozen=True, eq=False)
class Paint:
    """Colours that are more frequent in an object than in the rest of the image.

    Attributes:
        own: shape (8 ** BITS,), by the leading bits of red, green and blue.
    """

    own: NDArray[np.bool_]

    def covers(self, colours: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Which colours, shape (n, 3), are the object's; shape (n,)."""
        return self.own[_bins(colours)]


def learned_paint(colour: NDArray[np.uint8], mask: Mask) -> Paint:
    """Colours of an object, learned from one image.

    GrabCut corrects the border of the mask, where depth is wrong or missing; then the colours
    inside and outside are counted.

    Args:
        colour: shape (h, w, 3).
        mask: shape (h, w), approximate mask of the object.
    """
    step = -(-mask.shape[1] // SMALL)
    small = np.ascontiguousarray(colour[::step, ::step])
    inside = _mended(small, mask[::step, ::step])
    bins = _bins(small)
    counts = (np.bincount(bins[part], minlength=8**BITS) + 1.0 for part in (inside, ~inside))
    own, other = (count / count.sum() for count in counts)
    return Paint(own > other)


def _mended(colour: NDArray[np.uint8], mask: Mask) -> Mask:
    cv2 = loaded_opencv()
    around = np.ones((2 * NEAREST + 1, 2 * NEAREST + 1), np.uint8)
    rough = mask.astype(np.uint8)
    marks = np.where(mask, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    marks[cv2.erode(rough, around) > 0] = cv2.GC_FGD
    marks[cv2.dilate(rough, around) == 0] = cv2.GC_BGD
    if not (marks % 2).any() or (marks % 2).all():
        return mask
    cv2.setRNGSeed(0)  # GrabCut draws from OpenCV's own random numbers: equal images, equal masks
    models = np.zeros((2, 1, 65))
    cv2.grabCut(colour, marks, None, *models, ROUNDS, cv2.GC_INIT_WITH_MASK)
    inside: Mask = (marks == cv2.GC_FGD) | (marks == cv2.GC_PR_FGD)
    return inside


def _bins(colours: NDArray[np.uint8]) -> NDArray[np.intp]:
    red, green, blue = (colours[..., i].astype(np.intp) >> (8 - BITS) for i in range(3))
    return (red << 2 * BITS) | (green << BITS) | blue
