"""Patches of taxels: where they are, and what they read untouched."""

from pathlib import Path
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.model import Model


class TaxelGridConfig(Model):
    """Taxels in rows and columns on the plane z = 0 of their frame, centred at its origin."""

    rows: int = Field(ge=1)
    """Along x."""
    columns: int = Field(ge=1)
    """Along y; values come row by row."""
    pitch: tuple[float, float]
    """The distance between neighbours along x and y [m]; also the size of a taxel."""

    def places(self) -> FloatArray:
        """Give the centres of the taxels, shape (rows · columns, 3) [m]."""
        x = (np.arange(self.rows) - (self.rows - 1) / 2.0) * self.pitch[0]
        y = (np.arange(self.columns) - (self.columns - 1) / 2.0) * self.pitch[1]
        x, y = (axis.ravel() for axis in np.meshgrid(x, y, indexing="ij"))
        return np.stack([x, y, np.zeros_like(x)], axis=1)


class PatchConfig(Model):
    """A patch of taxels, as a grid or one by one, in the frame of its readings."""

    grid: TaxelGridConfig | None = None
    """Taxels in rows and columns."""
    places: tuple[tuple[float, float, float], ...] = ()
    """The centre of each taxel [m]."""
    size: tuple[float, float] | None = None
    """The edges of one taxel along x and y [m]; needed with `places`."""

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
        """Give the edges of one taxel [m]."""
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
        x, y = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        offsets = np.stack([x, y, np.zeros_like(x)], axis=1)
        centres = self.centres()
        places = (centres[:, None, :] + offsets).reshape(-1, 3)
        return places, np.repeat(np.arange(len(centres), dtype=np.intp), len(offsets))


class BaselineConfig(Model):
    """What taxels read untouched, and how they answer to touch."""

    values: float | tuple[float, ...] = 0.0
    """The untouched value of all taxels, or of each."""
    noise: float | tuple[float, ...] = 1.0
    """The standard deviation of an untouched value, of all taxels or of each."""
    file: Path | None = None
    """An npz file with `values` and `noise`, as `fit_baseline` saves it; replaces both."""
    touch: Literal["rises", "falls", "either"] = "rises"
    """Whether a touch raises the value, lowers it, or either."""

    def load(self, taxels: int) -> tuple[FloatArray, FloatArray]:
        """Give values and noise of each taxel, both of shape (taxels,).

        Raises:
            ConfigurationError: the file is missing, or the numbers are not one a taxel.
        """
        values, noise = np.asarray(self.values, np.float64), np.asarray(self.noise, np.float64)
        if self.file is not None:
            try:
                with np.load(self.file) as arrays:
                    values, noise = arrays["values"], arrays["noise"]
            except (OSError, KeyError, ValueError) as error:
                raise ConfigurationError(f"the baseline {self.file} cannot be read: {error}") from (
                    None
                )
        for name, array in (("values", values), ("noise", noise)):
            if array.ndim and array.shape != (taxels,):
                raise ConfigurationError(
                    f"the baseline has {array.size} {name}, but the patch has {taxels} taxels"
                )
        if (noise <= 0).any():
            raise ConfigurationError("the noise of a baseline must be positive")
        return np.broadcast_to(values, taxels), np.broadcast_to(noise, taxels)


def fit_baseline(images: FloatArray, least_noise: float) -> tuple[FloatArray, FloatArray]:
    """Learn what each taxel reads untouched.

    Args:
        images: shape (m, n), values without any touch.
        least_noise: the least standard deviation to believe, e.g. half a digit.

    Returns:
        Median and standard deviation of each taxel, both of shape (n,).
    """
    noise = np.maximum(images.std(axis=0), least_noise)
    return np.median(images, axis=0), noise
