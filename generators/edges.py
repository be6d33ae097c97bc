"""Where the edges of an object in a depth image lie (O §IV-A)."""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.readings import DepthImage
from contactfusion.segmenter import Mask
from contactfusion.vision import back_projected, grey, loaded_opencv

Threshold = Annotated[float, Field(ge=0)]
Thresholds = tuple[Threshold, Threshold]

RIM = 2
"""So many pixels around the object are looked at, too."""


def edge_points(
    depth: FloatArray, mask: Mask, image: DepthImage, thresholds: Thresholds
) -> FloatArray:
    """Give the places of an object's edges.

    Depth is worst at the silhouette, where it is missing, or is that of the floor behind. So each
    edge pixel takes the depth of the nearest pixel that has one and whose neighbours are all the
    object's; or, where the object is too thin for that, of the nearest of its own.

    Args:
        depth: shape (h, w) [m], 0 where there is no return.
        mask: shape (h, w), where the object is.
        image: has the colours, if any, and the camera matrix.
        thresholds: the lower and the upper one of Canny, of brightness in 0..255.

    Returns:
        Shape (n, 3) [m], in the camera's frame; none when the object has no depth at all.
    """
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return np.empty((0, 3))
    top, left = max(rows[0] - RIM, 0), max(columns[0] - RIM, 0)
    window = slice(top, rows[-1] + RIM + 1), slice(left, columns[-1] + RIM + 1)
    colour = None if image.colour is None else image.colour[window]
    nearest = nearest_depth(depth[window], mask[window])
    edges = edge_pixels(mask[window], colour, thresholds) & (nearest > 0.0)
    v, u = np.nonzero(edges)
    return back_projected(v + top, u + left, nearest[edges], image.intrinsics)


def edge_pixels(mask: Mask, colour: NDArray[np.uint8] | None, thresholds: Thresholds) -> Mask:
    """Give the edges of the masked image by Canny, all of them on the object.

    Outside the mask the image is black, or white if the object is dark. What Canny finds just
    outside is moved to the object's side. The rim of the image is no edge.

    Args:
        mask: shape (h, w).
        colour: shape (h, w, 3), or None: the mask alone is looked at.
        thresholds: of Canny.
    """
    cv2 = loaded_opencv()
    bright = np.full(mask.shape, 255, np.uint8) if colour is None else grey(colour)
    outside = 0 if bright[mask].mean() > 127.0 else 255
    masked = np.where(mask, bright, np.uint8(outside))
    found = cv2.Canny(masked, *thresholds) > 0
    beyond = (found & ~mask).astype(np.uint8)
    beside = cv2.dilate(beyond, np.ones((3, 3), np.uint8)) > 0
    edges: Mask = mask & (found | beside)
    return edges


def nearest_depth(depth: FloatArray, mask: Mask) -> FloatArray:
    """Give each pixel the depth of the nearest that certainly is the object's, 0 if there is none.

    Args:
        depth: shape (h, w) [m], 0 where there is no return.
        mask: shape (h, w), where the object is.
    """
    cv2 = loaded_opencv()
    solid = (cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & (depth > 0.0)
    if not solid.any():
        solid = mask & (depth > 0.0)
    if not solid.any():
        return np.zeros(depth.shape)
    labels = cv2.distanceTransformWithLabels(
        (~solid).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )[1]
    of_label = np.zeros(labels.max() + 1)
    of_label[labels[solid]] = depth[solid]
    nearest: FloatArray = of_label[labels]
    return nearest
