"""Whether stated probabilities and covariances agree with what is true."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from contactfusion.arrays import FloatArray

BINS = 10
"""Bins of probabilities, at most."""
FEWEST = 10
"""Least number of probabilities in a bin."""
LEVEL = 0.95
"""Probability of the region whose radius is the sharpness."""


def brier(probabilities: FloatArray, events: NDArray[np.bool_]) -> float:
    """The mean squared difference of probabilities and events, both of shape (n,)."""
    return float(np.mean((probabilities - events) ** 2))


def calibration_error(probabilities: FloatArray, events: NDArray[np.bool_]) -> float:
    """The expected calibration error (ECE) in the root mean square, debiased.

    Args:
        probabilities: shape (n,).
        events: shape (n,), whether each occurred.

    Returns:
        From 0 to 1; NaN with fewer than two probabilities.
    """
    return float(np.sqrt(np.maximum(squared_calibration_error(probabilities, events), 0.0)))


def squared_calibration_error(probabilities: FloatArray, events: NDArray[np.bool_]) -> float:
    """The square of the calibration error, which may be less than 0.

    Bins have equal mass; the variance of each bin's share of events, which makes the plain
    estimate too large, is subtracted (Kumar et al. 2019, definition 4.3).

    Args:
        probabilities: shape (n,).
        events: shape (n,), whether each occurred.

    Returns:
        NaN with fewer than two probabilities.
    """
    if len(probabilities) < 2:
        return float("nan")
    order = np.argsort(probabilities, kind="stable")
    bins = np.array_split(order, max(1, min(BINS, len(order) // FEWEST)))
    total = 0.0
    for rows in bins:
        share = events[rows].mean()
        bias = share * (1.0 - share) / (len(rows) - 1)
        total += len(rows) / len(order) * ((probabilities[rows].mean() - share) ** 2 - bias)
    return total


def level(deviation: FloatArray, covariance: FloatArray) -> float:
    """The probability of the smallest ellipsoid of a Gaussian that reaches a deviation.

    Levels of the truth are uniform between 0 and 1 where covariances are right.

    Args:
        deviation: shape (3,), of the truth from the mean [m].
        covariance: shape (3, 3) [m²].
    """
    return float(chi2.cdf(deviation @ np.linalg.solve(covariance, deviation), len(deviation)))


def radius(covariance: FloatArray) -> float:
    """The radius of the sphere with the volume of the 95 % ellipsoid of a Gaussian [m].

    Args:
        covariance: shape (3, 3) [m²].
    """
    count = len(covariance)
    volume = max(float(np.linalg.det(covariance)), 0.0) ** (1.0 / (2 * count))
    return float(np.sqrt(chi2.ppf(LEVEL, count)) * volume)
