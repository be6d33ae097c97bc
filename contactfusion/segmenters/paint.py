"""Which colours are an object's."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactfusion.segmenter import Mask
from contactfusion.vision import loaded_opencv

BITS = 3
"""Of red, green and blue each that tell colours apart."""
SMALL = 160
"""Colours are learned from an image of this width at most [pixels]."""
ROUNDS = 2
"""Of GrabCut."""
NEAREST = 3
"""It may move the border of the object by so many pixels of that image."""


@dataclass(frozen=True, eq=False)
class Paint:
    """The colours that are more an object's than those of the rest of the image.

    Attributes:
        own: shape (8 ** BITS,), by the leading bits of red, green and blue.
    """

    own: NDArray[np.bool_]

    def covers(self, colours: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Tell which of these are its colours, shape (n,), of shape (n, 3)."""
        return self.own[_bins(colours)]


def learned_paint(colour: NDArray[np.uint8], mask: Mask) -> Paint:
    """Learn an object's colours from one image.

    GrabCut mends the border of the mask, where depth is wrong or missing; the colours inside and
    outside are counted then.

    Args:
        colour: shape (h, w, 3).
        mask: shape (h, w), roughly where the object is.
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
    cv2.setRNGSeed(0)  # GrabCut draws from OpenCV's own chance: equal images, equal masks
    models = np.zeros((2, 1, 65))
    cv2.grabCut(colour, marks, None, *models, ROUNDS, cv2.GC_INIT_WITH_MASK)
    inside: Mask = (marks == cv2.GC_FGD) | (marks == cv2.GC_PR_FGD)
    return inside


def _bins(colours: NDArray[np.uint8]) -> NDArray[np.intp]:
    red, green, blue = (colours[..., i].astype(np.intp) >> (8 - BITS) for i in range(3))
    return (red << 2 * BITS) | (green << BITS) | blue
