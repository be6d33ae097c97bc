"""Evidence of contact in the level of a residual, learned on one profile and tried on another."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion_lab.experiments.ur10e.runs import PERIOD, Run

WINDOW = 0.2
"""Over which residuals are averaged [s]."""
LENGTH = round(WINDOW / PERIOD)
Part = Literal["windows", "samples"]
"""What is judged."""


@dataclass(frozen=True, eq=False)
class Judged:
    """What is judged of runs.

    Attributes:
        residuals: shape (n, 6) [A].
        contact: shape (n,), whether the tool touches.
        group: shape (n,), the number of the run.
    """

    residuals: FloatArray
    contact: NDArray[np.bool_]
    group: NDArray[np.intp]


def judged(runs: Sequence[Run], part: Part) -> Judged:
    """All samples of runs, or the means over windows, one after the other.

    A window in which the force passes 5 N is neither contact nor none, and is left out.
    """
    parts = [_windows(run) if part == "windows" else (run.residual, run.touching) for run in runs]
    return Judged(
        residuals=np.concatenate([residuals for residuals, _ in parts]),
        contact=np.concatenate([contact for _, contact in parts]),
        group=np.repeat(np.arange(len(parts)), [len(contact) for _, contact in parts]),
    )


def _windows(run: Run) -> tuple[FloatArray, NDArray[np.bool_]]:
    count = len(run.stamps) // LENGTH
    residuals = run.residual[: count * LENGTH].reshape(count, LENGTH, -1).mean(axis=1)
    share = run.touching[: count * LENGTH].reshape(count, LENGTH).mean(axis=1)
    clear = (share == 0.0) | (share == 1.0)
    return residuals[clear], share[clear] > 0.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence of joints, bounded for each of them.

    Friction that is not as the controller believes loads one joint, a contact loads several; and
    how hard, its force decides, which is another in each run. So a joint counts by tanh of half its
    residual, in standard deviations of free motion, times the same of where contacts took it.

    Attributes:
        free: shape (6,), the mean of free motion [A].
        deviation: shape (6,), its standard deviation [A].
        shift: shape (6,), how far contacts took it, in standard deviations.
    """

    free: FloatArray
    deviation: FloatArray
    shift: FloatArray

    @classmethod
    def learned(cls, given: Judged) -> Self:
        """What contacts do to residuals."""
        none, touched = given.residuals[~given.contact], given.residuals[given.contact]
        free, deviation = none.mean(axis=0), none.std(axis=0)
        return cls(free, deviation, (touched.mean(axis=0) - free) / deviation)

    def of(self, residuals: FloatArray) -> FloatArray:
        """The evidence in residuals (n, 6), shape (n,)."""
        bounded = np.tanh((residuals - self.free) / self.deviation / 2.0)
        return np.asarray(bounded @ np.tanh(self.shift / 2.0), np.float64)


def discriminant(given: Judged) -> FloatArray:
    """The weights of joints by linear discriminant analysis, shape (6,) (Fisher 1936)."""
    left, means = given.residuals.copy(), []
    for contact in (True, False):
        rows = given.contact == contact
        means.append(given.residuals[rows].mean(axis=0))
        left[rows] -= means[-1]
    weights: FloatArray = np.linalg.solve(left.T @ left / len(left), means[0] - means[1])
    return weights
