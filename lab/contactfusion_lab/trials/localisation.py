"""How well a set of reported contacts matches the set of true ones: GOSPA and its parts."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from contactfusion.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Localisation:
    """GOSPA with p = 2 and α = 2 (Rahmathullah et al. 2017, proposition 1), and its parts.

    gospa² = distance² + cutoff² / 2 (missed + false).

    Attributes:
        gospa: the metric [m].
        distance: root of the sum of squared distances of the pairs [m].
        missed: number of true contacts without a reported one.
        false: number of reported contacts without a true one.
    """

    gospa: float
    distance: float
    missed: int
    false: int


def localisation(true: FloatArray, reported: FloatArray, cutoff: float) -> Localisation:
    """Pair true and reported contacts at the least cost.

    Args:
        true: shape (n, d) [m].
        reported: shape (m, d) [m].
        cutoff: pairs are nearer to each other than this [m].
    """
    squares = np.minimum(cdist(true, reported, "sqeuclidean"), cutoff**2)
    pairs = squares[linear_sum_assignment(squares)]
    near = pairs[pairs < cutoff**2]
    missed, false = len(true) - len(near), len(reported) - len(near)
    total = float(near.sum())
    gospa = np.sqrt(total + cutoff**2 / 2.0 * (missed + false))
    return Localisation(float(gospa), float(np.sqrt(total)), missed, false)
