"""An alarm of contact by motor currents, without the pose of the arm.

What follows from the past of a joint's residual is taken off by a linear prediction. What is left
is summed since each onset that a contact may have, some samples ago, and weighed by its noise in
free motion; the likeliest onset counts (as in the generalised likelihood ratio of Willsky & Jones
1976). Two events load a joint in free motion as hard as a contact. Its set value jumps, and the
current follows late: so a deviation grows with recent changes of the set value. And its friction
sticks and slips, which moves that joint alone, while a contact moves several: so joints count by
the logarithm of a heavy-tailed density (Student's), and not by their squares.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.signal import lfilter

from contactfusion.arrays import FloatArray
from contactfusion_lab.experiments.ur10e.runs import PERIOD, Run

ORDER = 5
"""Of the prediction: samples that a sample is predicted by."""
MEMORY = 0.1
"""How long a change of the set value makes a joint unsure [s]."""
STILL = 0.02
"""A set value that has changed by less has not changed [A]."""
TAIL = 2.0
"""Degrees of freedom of Student's density, in squares of standard deviations."""
SAFE = 1.1
"""The threshold is the highest statistic in free motion, times this."""
SETTLED = 60
"""Samples at the beginning of a run that are not judged."""
ONSETS = (2, 3, 4, 5)
"""Samples since onsets that are considered."""


@dataclass(frozen=True, eq=False)
class Noise:
    """The residual of free motion under one controller.

    Attributes:
        prediction: shape (ORDER + 1, 6), of a sample by the last ones, newest first, and by 1.
        deviations: by number of samples, of their sum over its root, shape (6,) [A].
    """

    prediction: FloatArray
    deviations: Mapping[int, FloatArray]

    @classmethod
    def of(cls, runs: Sequence[Run]) -> Self:
        """The noise of the free motion of runs."""
        free = [run.free for run in runs]
        given = np.concatenate([_past(run)[rows] for run, rows in zip(runs, free, strict=True)])
        values = np.concatenate([run.residual[rows] for run, rows in zip(runs, free, strict=True)])
        fits = [
            np.linalg.lstsq(given[:, :, joint], values[:, joint], rcond=None)[0]
            for joint in range(values.shape[1])
        ]
        prediction = np.asarray(np.stack(fits, axis=1), np.float64)
        blank = cls(prediction, {})
        still = np.concatenate(
            [changes(run)[rows] < STILL for run, rows in zip(runs, free, strict=True)]
        )
        deviations = {}
        for count in ONSETS:
            sums = np.concatenate([blank.sums(run, count)[run.free] for run in runs])
            squares = np.where(still, sums**2, 0.0).sum(axis=0)
            deviations[count] = np.sqrt(squares / np.maximum(still.sum(axis=0), 1))
        return cls(prediction, deviations)

    def sums(self, run: Run, count: int) -> FloatArray:
        """What was not predicted, summed over the last samples, over their root, (n, 6) [A]."""
        left = run.residual - np.einsum("nkj,kj->nj", _past(run), self.prediction)
        return np.asarray(lfilter(np.ones(count) / np.sqrt(count), [1.0], left, axis=0), np.float64)


@dataclass(frozen=True, eq=False)
class Alarm:
    """A test for contact, sample by sample.

    Attributes:
        noises: of free motion, by controller.
        unsure: deviation of a residual per recent change of its set value.
        threshold: from which statistic on there is an alarm.
    """

    noises: Mapping[str, Noise]
    unsure: float
    threshold: float

    @classmethod
    def fitted(cls, runs: Sequence[Run]) -> Self:
        """The alarm by the noise of runs, that is silent in all their free motion."""
        noises = {
            name: Noise.of([run for run in runs if run.controller == name])
            for name in sorted({run.controller for run in runs})
        }
        blank = cls(noises, _unsure(runs, noises), np.inf)
        free = [blank.statistic(run)[SETTLED:][run.free[SETTLED:]].max() for run in runs]
        return cls(noises, blank.unsure, SAFE * float(max(free)))

    def statistic(self, run: Run) -> FloatArray:
        """How little free motion explains each sample, shape (n,)."""
        noise = self.noises[run.controller]
        spread = (self.unsure * changes(run)) ** 2
        weighed = [
            np.log1p(noise.sums(run, count) ** 2 / (deviation**2 + spread) / TAIL).sum(axis=1)
            for count, deviation in noise.deviations.items()
        ]
        return np.asarray(np.max(weighed, axis=0), np.float64)

    def first(self, run: Run) -> float:
        """The stamp of the first alarm in a run [s]; inf where there is none."""
        return first_above(run, self.statistic(run), self.threshold)


def _unsure(runs: Sequence[Run], noises: Mapping[str, Noise]) -> float:
    """Deviation of a residual per recent change of its set value, as free motion shows it."""
    excess = squares = 0.0
    for run in runs:
        moved = changes(run)
        rows = (moved >= STILL) & run.free[:, None]
        squares += len(ONSETS) * float((moved[rows] ** 2).sum())
        noise = noises[run.controller]
        for count, deviation in noise.deviations.items():
            excess += float((noise.sums(run, count) ** 2 - deviation**2)[rows].sum())
    return float(np.sqrt(max(excess, 0.0) / squares)) if squares else 0.0


def first_above(run: Run, statistic: FloatArray, threshold: float) -> float:
    """The first stamp at which a statistic (n,) passes a threshold [s]; inf where it never does."""
    above = statistic[SETTLED:] > threshold
    return float(run.stamps[SETTLED + int(above.argmax())]) if above.any() else np.inf


def plain_first(run: Run, runs: Sequence[Run]) -> float:
    """The first alarm of a plain threshold by joint: the greatest in free motion of runs [s]."""
    under = [other for other in runs if other.controller == run.controller]
    free = np.concatenate([np.abs(other.residual[other.free]) for other in under])
    return first_above(run, (np.abs(run.residual) / free.max(axis=0)).max(axis=1), SAFE)


def changes(run: Run) -> FloatArray:
    """How much each set value has changed lately, shape (n, 6) [A]."""
    steps = np.abs(np.diff(run.set_values, axis=0, prepend=run.set_values[:1]))
    return np.asarray(lfilter([1.0], [1.0, -np.exp(-PERIOD / MEMORY)], steps, axis=0), np.float64)


def _past(run: Run) -> FloatArray:
    """The samples before each sample, newest first, and 1, shape (n, ORDER + 1, 6) [A]."""
    padded = np.concatenate([np.repeat(run.residual[:1], ORDER, axis=0), run.residual])
    count = len(run.residual)
    past = [padded[ORDER - lag : ORDER - lag + count] for lag in range(1, ORDER + 1)]
    return np.stack([*past, np.ones_like(run.residual)], axis=1)
