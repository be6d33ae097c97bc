"""What readings are drawn on: a codec knows this, and no library that draws."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose

Colour = tuple[int, int, int]
"""RGB in 0..255."""
Colours = NDArray[np.uint8]
"""Shape (n, 3) or (n, 4): RGB or RGBA in 0..255."""
PLAIN: Colour = (205, 214, 224)
"""Of what was seen, and of what is at rest."""
ACTIVE: Colour = (60, 255, 150)
"""Of contacts, and of what says that there is one."""
FORCE: Colour = (120, 190, 255)
TORQUE: Colour = (120, 120, 255)
MARKER: Colour = (255, 255, 255)
RAMP = np.array([[156, 79, 217], [226, 84, 134], [251, 148, 70], [246, 236, 66]], np.float64)
"""From little to much: violet, pink, orange, yellow, each lighter than the one before."""


def ramp(values: FloatArray) -> Colours:
    """The colours of values in 0..1, shape (n, 3); the lowest is still seen."""
    at = np.linspace(0.0, 1.0, len(RAMP))
    return np.stack([np.interp(values, at, RAMP[:, i]) for i in range(3)], axis=-1).astype(np.uint8)


class Canvas(ABC):
    """Where one reading is drawn, in the frame of the reading, until the next of its sensor."""

    @abstractmethod
    def points(
        self,
        points: FloatArray,
        colours: Colour | Colours = PLAIN,
        *,
        labels: Sequence[str] = (),
        large: bool = False,
    ) -> None:
        """Draw points, equally large at any distance; those that are not finite are left out.

        Args:
            points: shape (n, 3) [m].
            colours: one for all, or one a point.
            labels: the name of each point, shown when asked for; empty: they have none.
            large: whether each is to be seen by itself.
        """

    @abstractmethod
    def spheres(self, centres: FloatArray, radius: float, colour: Colour) -> None:
        """Draw spheres, shape (n, 3) [m], of one radius [m]."""

    @abstractmethod
    def arrow(self, name: str, vector: FloatArray, unit: str, colour: Colour) -> None:
        """Draw an arrow from the origin of the frame.

        Args:
            name: that of the arrow, as a reading may have several.
            vector: shape (3,), in its unit.
            unit: such as "N"; the largest arrow of a unit in a recording sets their scale.
            colour: always the same for this arrow.
        """

    @abstractmethod
    def taxels(self, values: FloatArray) -> None:
        """Draw the patch of the sensor, coloured by how far its values changed since the first.

        Args:
            values: shape (n,), in the order of the patch.
        """

    @abstractmethod
    def depth_image(
        self, depth: FloatArray, intrinsics: FloatArray, colour: Colours | None
    ) -> None:
        """Draw what a camera sees, as an image and as points.

        Args:
            depth: shape (h, w) [m]; 0 and NaN are no return.
            intrinsics: shape (3, 3), the camera matrix [pixels].
            colour: shape (h, w, 3), or None.
        """

    @abstractmethod
    def axes(self, name: str, pose: Pose) -> None:
        """Draw axes with a name at a pose in the frame of the reading, shape (4, 4) [m]."""
