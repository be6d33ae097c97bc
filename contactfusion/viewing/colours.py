"""The colours of the viewer, made for its dark background."""

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray

Colours = NDArray[np.uint8]
"""Shape (n, 3) or (n, 4): RGB or RGBA in 0..255."""
Colour = tuple[int, int, int]
"""RGB in 0..255."""
RAMP = np.array([[156, 79, 217], [226, 84, 134], [251, 148, 70], [246, 236, 66]], np.float64)
"""From little to much: violet, pink, orange, yellow, each lighter than the one before."""
BACKGROUND = (13, 16, 17)
ROBOT = (150, 158, 170)
CLOUD = (205, 214, 224)
CONTACT = (60, 255, 150)
FORCE = (60, 255, 150)
WRENCH = (120, 190, 255)
TORQUE = (120, 120, 255)
COMMAND = (255, 170, 60)
TURN = (255, 110, 60)
MARKER = (255, 255, 255)
VOXELS = {
    "contact": (255, 140, 60),
    "below_threshold": (170, 90, 235),
    "support_only": (86, 180, 233),
    "nulled": (150, 150, 160),
}
"""By verdict."""
LINES = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 190, 140),
    (240, 130, 190),
    (240, 228, 66),
    (230, 110, 40),
    (90, 140, 255),
)
"""Of sources in plots, to be told apart by everyone."""


def ramp(values: FloatArray) -> Colours:
    """Give the colours of values in 0..1, shape (n, 3); the lowest is still seen."""
    at = np.linspace(0.0, 1.0, len(RAMP))
    return np.stack([np.interp(values, at, RAMP[:, i]) for i in range(3)], axis=-1).astype(np.uint8)
