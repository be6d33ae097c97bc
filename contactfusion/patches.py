"""Patches of taxels: where they are, and what they cover."""

from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from contactfusion.arrays import FloatArray
from contactfusion.model import Model

Edge = Annotated[float, Field(gt=0)]


class TaxelGridConfig(Model):
    """Taxels in rows and columns on the plane z = 0 of their frame, centred at its origin."""

    rows: int = Field(ge=1)
    """Along x."""
    columns: int = Field(ge=1)
    """Along y; values come row by row."""
    pitch: tuple[Edge, Edge]
    """The distance between neighbours along x and y [m]; also the size of a taxel."""

    def places(self) -> FloatArray:
        """Give the centres of the taxels, shape (rows · columns, 3) [m]."""
        x = (np.arange(self.rows, dtype=np.float64) - (self.rows - 1) / 2.0) * self.pitch[0]
        y = (np.arange(self.columns, dtype=np.float64) - (self.columns - 1) / 2.0) * self.pitch[1]
        return _on_plane(x, y)


class PatchConfig(Model):
    """A patch of taxels, as a grid or one by one, in the frame of its readings."""

    grid: TaxelGridConfig | None = None
    """Taxels in rows and columns."""
    places: tuple[tuple[float, float, float], ...] = ()
    """The centre of each taxel [m]."""
    size: tuple[Edge, Edge] | None = None
    """The edges of one taxel along x and y [m]; needed with `places`, else the grid's pitch."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.grid is not None) == bool(self.places):
            raise ValueError("give a grid or places")
        if self.places and self.size is None:
            raise ValueError("places need the size of a taxel")
        return self

    def centres(self) -> FloatArray:
        """Give the centre of each taxel, shape (n, 3) [m]."""
        return self.grid.places() if self.grid else np.array(self.places)

    def edges(self) -> tuple[float, float]:
        """Give the edges of one taxel along x and y [m]."""
        return self.size or (self.grid.pitch if self.grid else (0.0, 0.0))

    def covered(self, side: float) -> tuple[FloatArray, NDArray[np.intp]]:
        """Cover each taxel with places no further apart than a voxel.

        Args:
            side: of a voxel [m].

        Returns:
            Places of shape (m, 3) [m], and the taxel that each belongs to, shape (m,).
        """
        axes = []
        for edge in self.edges():
            cells = max(1, int(np.ceil(edge / side - 1e-9)))
            axes.append(((2.0 * np.arange(cells) + 1.0) / cells - 1.0) * edge / 2.0)
        offsets = _on_plane(*axes)
        centres = self.centres()
        places = (centres[:, None, :] + offsets).reshape(-1, 3)
        return places, np.repeat(np.arange(len(centres), dtype=np.intp), len(offsets))

    def near(self, points: FloatArray, reach: float) -> NDArray[np.bool_]:
        """Tell which taxels have a point over their area, or closer to it than `reach` [m].

        Args:
            points: shape (m, 3) [m], in the frame of the patch.
            reach: along each axis [m].

        Returns:
            Shape (n,).
        """
        centres = self.centres()
        half = np.array([*self.edges(), 0.0]) / 2.0 + reach
        low, high = centres.min(axis=0) - half, centres.max(axis=0) + half
        close = points[((points >= low) & (points <= high)).all(axis=1)]
        inside = np.abs(close - centres[:, None, :]) <= half
        return np.asarray(np.any(np.all(inside, axis=2), axis=1))


def _on_plane(x: FloatArray, y: FloatArray) -> FloatArray:
    """Give all points of these coordinates on the plane z = 0, x by x, shape (m, 3)."""
    points = np.zeros((len(x) * len(y), 3))
    points[:, 0], points[:, 1] = np.repeat(x, len(y)), np.tile(y, len(x))
    return points
