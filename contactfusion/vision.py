"""Images: back-projection of pixels, returns of depth, brightness, and OpenCV."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import missing_extra


def loaded_opencv() -> Any:
    """The library OpenCV.

    Raises:
        DependencyError: it is not installed.
    """
    try:
        import cv2
    except ImportError:
        raise missing_extra("opencv", "vision") from None
    return cv2


def back_projected(
    rows: ArrayLike, columns: ArrayLike, depth: ArrayLike, intrinsics: FloatArray
) -> FloatArray:
    """The positions of pixels: x = z (u - c_x)/f_x, y = z (v - c_y)/f_y (O Eq 13).

    The paper prints f_z under x; f_x is meant.

    Args:
        rows: v, shape (n,) [pixels].
        columns: u, shape (n,) [pixels].
        depth: z, shape (n,) [m].
        intrinsics: the camera matrix, shape (3, 3) [pixels].

    Returns:
        Shape (n, 3) [m], in the camera's frame: x right, y down, z forward.
    """
    z = np.asarray(depth, np.float64)
    (focal_x, _, middle_x), (_, focal_y, middle_y), _ = intrinsics
    x = z * (np.asarray(columns) - middle_x) / focal_x
    y = z * (np.asarray(rows) - middle_y) / focal_y
    return np.stack([x, y, z], axis=-1)


def returns(depth: FloatArray) -> FloatArray:
    """A depth image with 0 for all that is no return."""
    return np.where(np.isfinite(depth) & (depth > 0.0), depth, 0.0)


def grey(colour: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The brightness of a colour image, shape (h, w)."""
    cv2 = loaded_opencv()
    brightness: NDArray[np.uint8] = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)
    return brightness
