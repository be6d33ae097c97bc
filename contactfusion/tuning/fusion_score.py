"""How well the contacts of a run fit the labels: missed, false, and how far off."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from contactfusion.explaining.quantiles import Quantiles
from contactfusion.pipeline import Step
from contactfusion.tuning.fusion_labels import Label

ALIKE = 0.5
"""Steps of one stretch of so many seconds count as one sample of an interval: they are alike."""
Z = 1.959964
"""Of a 95 % interval."""
ERROR_STEP, ERROR_MOST = 5e-4, 2.0


@dataclass
class Rate:
    """How often something went wrong.

    Attributes:
        steps: in which it could have.
        wrong: in which it has.
        stretches: how many stretches of `ALIKE` seconds these steps lie in.
    """

    steps: int = 0
    wrong: int = 0
    stretches: int = 0
    _stretch: int | None = field(default=None, repr=False)

    def add(self, stamp: float, wrong: bool) -> None:
        """Count a step at a time [s]; steps come in order."""
        self.steps += 1
        self.wrong += wrong
        stretch = math.floor(stamp / ALIKE)
        self.stretches += stretch != self._stretch
        self._stretch = stretch

    @property
    def share(self) -> float:
        """The part of the steps in which it went wrong; NaN without any."""
        return self.wrong / self.steps if self.steps else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """The Wilson interval of the share, as of so many samples as there are stretches."""
        return wilson(self.share, min(self.stretches, self.steps))


@dataclass
class Half:
    """The score of one half of a recording.

    Attributes:
        missed: steps with a labelled contact, of which none was told within reach.
        false: steps without a labelled contact, in which one was told.
        errors: from labelled places to the nearest contact, however far [m].
    """

    missed: Rate = field(default_factory=Rate)
    false: Rate = field(default_factory=Rate)
    errors: Quantiles = field(default_factory=lambda: Quantiles(ERROR_STEP, ERROR_MOST))

    @property
    def cost(self) -> float:
        """The part missed plus the part false; what cannot go wrong costs nothing."""
        return float(np.nansum([self.missed.share, self.false.share]))

    @property
    def error(self) -> float:
        """The median distance from a labelled place to the nearest contact [m]; NaN: none."""
        return self.errors.at(0.5)

    def add(self, step: Step, label: Label | None, within: float) -> None:
        """Count a step; a contact within so much of a labelled place is right [m]."""
        contacts = step.fusion.contacts
        if label is None:
            self.false.add(step.stamp, bool(contacts))
        elif label.place is None:
            self.missed.add(step.stamp, not contacts)
        else:
            away = [math.dist(one.position, label.place) for one in contacts]
            self.missed.add(step.stamp, not away or min(away) > within)
            if away:
                self.errors.add(min(away))

    def as_dict(self) -> dict[str, Any]:
        """Give what JSON holds of it."""
        rows = np.flatnonzero(self.errors.counts)
        rates = {"missed": self.missed, "false": self.false}
        return {
            **{name: [one.steps, one.wrong, one.stretches] for name, one in rates.items()},
            "errors": [[int(row), int(self.errors.counts[row])] for row in rows],
        }

    @classmethod
    def from_dict(cls, held: dict[str, Any]) -> Self:
        """Read it back.

        Raises:
            ValueError, TypeError, KeyError, IndexError: it is something else.
        """
        missed, false = (Rate(*map(int, held[name])) for name in ("missed", "false"))
        half = cls(missed, false)
        for row, count in held["errors"]:
            half.errors.counts[row] = count
        return half


@dataclass
class Score:
    """The score of a run.

    Attributes:
        first: the time of the first step [s].
        last: that of the last [s].
        halves: the one to choose on, and the one to report on.
    """

    first: float
    last: float
    halves: tuple[Half, Half]


def scored(steps: Iterable[Step], labels: Sequence[Label], split: float, within: float) -> Score:
    """Compare steps with labels.

    Args:
        steps: in order; each is looked at once.
        labels: in order, without overlap.
        split: the time that parts the halves [s].
        within: a contact so near a labelled place is right [m].
    """
    halves, first, last, at = (Half(), Half()), math.nan, math.nan, 0
    for step in steps:
        first = step.stamp if math.isnan(first) else first
        last = step.stamp
        while at < len(labels) and labels[at].end <= step.stamp:
            at += 1
        label = labels[at] if at < len(labels) and labels[at].start <= step.stamp else None
        halves[step.stamp >= split].add(step, label, within)
    return Score(first, last, halves)


def wilson(share: float, samples: int) -> tuple[float, float]:
    """Give the 95 % Wilson interval of a share of samples; NaN without any."""
    if not samples or math.isnan(share):
        return math.nan, math.nan
    square = Z * Z / samples
    middle = (share + square / 2.0) / (1.0 + square)
    half = math.sqrt(share * (1.0 - share) * square + square * square / 4.0) / (1.0 + square)
    return max(middle - half, 0.0), min(middle + half, 1.0)
