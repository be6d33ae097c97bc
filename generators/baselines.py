"""Untouched values of taxels, and their response to touch."""

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from contactfusion.arrays import FloatArray, frozen_array
from contactfusion.errors import ConfigurationError
from contactfusion.files import read_npz
from contactfusion.model import Model


class BaselineConfig(Model):
    """Untouched values of taxels, and their response to touch."""

    values: float | tuple[float, ...] = 0.0
    """The untouched value of all taxels, or of each."""
    noise: float | tuple[float, ...] = 1.0
    """The standard deviation of an untouched value, of all taxels or of each."""
    file: Path | None = None
    """An npz file with `values` and `noise`, one number a taxel; replaces both."""
    touch: Literal["rises", "falls", "either"] = "rises"
    """Whether a touch raises the value, lowers it, or either."""

    def load(self, taxels: int) -> tuple[FloatArray, FloatArray]:
        """Values and noise of each taxel, both of shape (taxels,).

        Raises:
            ConfigurationError: the file is missing, or the numbers are not one a taxel.
        """
        given = read_npz(self.file, "values", "noise") if self.file else (self.values, self.noise)
        values, noise = (_for_each(array, taxels) for array in given)
        if (noise <= 0).any():
            raise ConfigurationError("the noise must be positive", "baseline")
        return values, noise


def _for_each(numbers: ArrayLike, taxels: int) -> FloatArray:
    """One finite number a taxel, from one for all or one for each."""
    if np.ndim(numbers) == 0:
        numbers = np.full(taxels, numbers)
    elif len(np.asarray(numbers)) != taxels:
        raise ConfigurationError(
            f"{np.size(numbers)} numbers for the {taxels} taxels of the patch", "baseline"
        )
    return frozen_array(numbers, (taxels,), "numbers of the baseline", ConfigurationError)


def fit_baseline(images: FloatArray, least_noise: float) -> tuple[FloatArray, FloatArray]:
    """Untouched values of taxels.

    Args:
        images: shape (m, n), values without any touch.
        least_noise: the least standard deviation, e.g. half a digit.

    Returns:
        Median and standard deviation of each taxel, both of shape (n,).

    Raises:
        ValueError: there are no images, they are no table of finite numbers, or the least standard
            deviation is not positive.
    """
    images = np.asarray(images, np.float64)
    if images.ndim != 2 or not images.size or not np.isfinite(images).all():
        raise ValueError(f"images are finite, of shape (m, n) with m, n > 0, not {images.shape}")
    if not 0.0 < least_noise < np.inf:
        raise ValueError(f"the least standard deviation is positive, not {least_noise}")
    noise = np.maximum(images.std(axis=0), least_noise)
    return np.median(images, axis=0), noise
