"""Quantiles of ever so many values, in memory that does not grow."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass
class Quantiles:
    """Counts values by steps of a fixed width; quantiles are exact to half a step.

    Attributes:
        step: the width.
        most: values are counted up to here; larger ones count as this.
        counts: how many values are nearest to each multiple of the step.
    """

    step: float
    most: float
    counts: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.counts = np.zeros(round(self.most / self.step) + 1, np.int64)

    def add(self, value: float) -> None:
        """Count a value of at least 0."""
        self.counts[min(round(value / self.step), len(self.counts) - 1)] += 1

    @property
    def count(self) -> int:
        """How many values were counted."""
        return int(self.counts.sum())

    def at(self, share: float) -> float:
        """Give the least value that so large a share does not exceed; NaN when none was counted."""
        if not self.count:
            return math.nan
        wanted = max(math.ceil(share * self.count - 1e-9), 1)
        return int(np.searchsorted(np.cumsum(self.counts), wanted)) * self.step
