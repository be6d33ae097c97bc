"""Draws forces and torques as arrows, so long that the largest of a recording is well seen."""

import math
from typing import NamedTuple

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.viewing.colours import Colour
from contactfusion.viewing.library import loaded_rerun
from contactfusion.viewing.recorder import Recorder

THICKNESS = 2.0
"""The radius of an arrow, whatever its distance [points of the screen]."""
RULER = 0.1
"""What an arrow of this length means is told [m]."""


class Sheaf(NamedTuple):
    """Arrows of one path at one time.

    Attributes:
        stamp: from when on they are seen [s].
        vectors: shape (n, 3), in the unit of what they show.
        tips: where they end, shape (n, 3) [m]; None: they begin at the origin.
    """

    stamp: float
    vectors: FloatArray
    tips: FloatArray | None = None


class Arrows:
    """The forces of a recording, or its torques; written at its end, as the largest sets the scale.

    Args:
        unit: of their vectors.
        longest: the longest an arrow may be [m].
    """

    def __init__(self, unit: str, longest: float) -> None:
        self._unit, self._longest = unit, longest
        self._sheaves: dict[str, list[Sheaf]] = {}

    def draw(self, recorder: Recorder, path: str, colour: Colour, sheaf: Sheaf) -> None:
        """Draw arrows of one colour at a path, until its next; what is nothing comes and goes."""
        if path not in self._sheaves:
            if not len(sheaf.vectors):
                return
            rerun = loaded_rerun()
            radii = rerun.Radius.ui_points(THICKNESS)
            look = rerun.Arrows3D.from_fields(colors=colour, radii=radii)
            recorder.draw(path, None, look)
        self._sheaves.setdefault(path, []).append(sheaf)

    def finish(self, recorder: Recorder) -> str:
        """Write all arrows; say what one of 10 cm means, or nothing where there is none."""
        sheaves = [sheaf for some in self._sheaves.values() for sheaf in some]
        vectors = np.concatenate([np.empty((0, 3)), *(sheaf.vectors for sheaf in sheaves)])
        largest = float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
        if largest == 0.0:
            return ""
        meaning = _rounded_up(RULER / self._longest * largest)
        for path, some in self._sheaves.items():
            _send(recorder, path, some, RULER / meaning)
        return f"{meaning:g} {self._unit}"


def _send(recorder: Recorder, path: str, sheaves: list[Sheaf], scale: float) -> None:
    """Write the arrows of one path; the scale is the length of one unit [m]."""
    vectors = [scale * sheaf.vectors for sheaf in sheaves]
    origins = [
        np.zeros_like(arrows) if sheaf.tips is None else sheaf.tips - arrows
        for arrows, sheaf in zip(vectors, sheaves, strict=True)
    ]
    columns = loaded_rerun().Arrows3D.columns(
        vectors=np.concatenate(vectors), origins=np.concatenate(origins)
    )
    stamps = np.array([sheaf.stamp for sheaf in sheaves])
    recorder.send(path, stamps, columns.partition([len(arrows) for arrows in vectors]))


def _rounded_up(value: float) -> float:
    """Give the next greater number of one digit, with any power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return math.ceil(value / power - 1e-9) * power
