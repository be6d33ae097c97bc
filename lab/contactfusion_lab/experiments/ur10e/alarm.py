"""An alarm of contact by motor currents, without the pose of the arm.

What follows from the past of a joint's residual is taken off by a linear prediction; what is left is
summed over the last few samples, and weighed by its noise in free motion. Two things load a joint in
free motion as hard as a contact: its set value jumps and the current follows late, so a deviation grows
with recent changes of the set value; and its friction sticks and slips, which moves that joint alone,
while a contact moves several. So joints count by the logarithm of a heavy-tailed density (Student's),
and not by their squares.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.signal import lfilter

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
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
LATEST = 0.1
"""A later alarm counts as being so late where settings are compared [s]."""
SUMMED = ((2,), (3,), (2, 4), (3, 5))
UNSURE = (0.1, 0.2, 0.3)
"""Settings that are tried on the training runs: numbers of samples in a sum, and a deviation per
change of a set value."""


@dataclass(frozen=True, eq=False)
class Noise:
    """The residual of free motion under one controller.

    Attributes:
        prediction: shape (ORDER + 1, 6), of a sample by the last ones, newest first, and by 1.
        deviations: standard deviation [A] of the sum of so many samples, over its root, (6,).
    """

    prediction: FloatArray
    deviations: Mapping[int, FloatArray]

    @classmethod
    def of(cls, runs: Sequence[Run], summed: Sequence[int]) -> Self:
        """The noise of runs, with deviations for these numbers of samples in a sum."""
        free = [run.free for run in runs]
        given = np.concatenate([_past(run)[rows] for run, rows in zip(runs, free, strict=True)])
        values = np.concatenate([run.residual[rows] for run, rows in zip(runs, free, strict=True)])
        prediction = np.stack(
            [
                np.linalg.lstsq(given[:, :, joint], values[:, joint], rcond=None)[0]
                for joint in range(values.shape[1])
            ],
            axis=1,
        )
        blank = cls(prediction, {})
        still = np.concatenate(
            [changes(run)[rows] < STILL for run, rows in zip(runs, free, strict=True)]
        )
        deviations = {}
        for count in summed:
            sums = np.concatenate([blank.sums(run, count)[run.free] for run in runs])
            squares = np.where(still, sums**2, 0.0).sum(axis=0)
            deviations[count] = np.sqrt(squares / np.maximum(still.sum(axis=0), 1))
        return cls(prediction, deviations)

    def sums(self, run: Run, count: int) -> FloatArray:
        """What was not predicted, summed over the last samples, over their root, (n, 6) [A]."""
        left = run.residual - np.einsum("nkj,kj->nj", _past(run), self.prediction)
        return np.asarray(lfilter(np.ones(count) / np.sqrt(count), 1.0, left, axis=0), np.float64)


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
    def fitted(cls, runs: Sequence[Run], summed: Sequence[int], unsure: float) -> Self:
        """The alarm with the noise of runs, that is silent in all their free motion."""
        noises = {
            name: Noise.of([run for run in runs if run.controller == name], summed)
            for name in sorted({run.controller for run in runs})
        }
        blank = cls(noises, unsure, np.inf)
        return cls(noises, unsure, SAFE * float(blank.highest(runs).max()))

    @classmethod
    def chosen(cls, runs: Sequence[Run]) -> Self:
        """The alarm, with the settings that do best on these runs.

        Each run is judged by the threshold that the other ones give: the fewest that are alarmed in
        free motion come first, then the quickest.
        """
        settings = itertools.product(SUMMED, UNSURE)
        alarms = [cls.fitted(runs, summed, unsure) for summed, unsure in settings]
        return min(alarms, key=lambda alarm: alarm._faults(runs))

    def highest(self, runs: Sequence[Run]) -> FloatArray:
        """The highest statistic in the free motion of each run, shape (r,)."""
        return np.array([self.statistic(run)[SETTLED:][run.free[SETTLED:]].max() for run in runs])

    def _faults(self, runs: Sequence[Run]) -> tuple[int, float]:
        """How many runs are alarmed early, and how late alarms are in the mean [s]."""
        highest = self.highest(runs)
        others = np.where(np.eye(len(runs), dtype=bool), -np.inf, highest).max(axis=1)
        delays = [self.first(run) - run.onset for run in runs if np.isfinite(run.onset)]
        late = float(np.minimum(delays, LATEST).mean()) if delays else 0.0
        return int((highest > SAFE * others).sum()), late

    def statistic(self, run: Run) -> FloatArray:
        """How little free motion explains each sample, shape (n,).

        Raises:
            RecordingError: nothing is known of its controller.
        """
        if run.controller not in self.noises:
            raise RecordingError(
                f"{run.name}: no run of another profile is under {run.controller} control, to "
                "learn from"
            )
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


def first_above(run: Run, statistic: FloatArray, threshold: float) -> float:
    """The first stamp at which a statistic (n,) passes its threshold [s]; inf where it never does."""
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
