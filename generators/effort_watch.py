"""Whether efforts are to be believed: joints whose effort stays, and torques that are always there.

A contact comes and goes, and loads change as the arm moves. An effort that stays exactly as it is
is not measured; torques from the first reading on may be those of a payload, of wrong constants or
of a link whose inertia is missing.
"""

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray

BEYOND = 4.0
"""Standard deviations that noise does not reach."""
ZEROS = 5
"""A joint that bears something, and so often in turn reports exactly 0, reports nothing."""
SETTLED = 5.0
"""Lags of the observer after which what is left is of the last effort."""
START = 0.2
"""A load that stays so long from the first reading on may be the arm's own [s]."""
FREE = 0.3
"""So long without a load in turn, an arm is free [s]."""
LONG = 10.0
"""Over about so long, loaded and free time are compared [s]."""
GAP = 0.5
"""Readings that are further apart count as no time [s]."""
NEVER_FREE = (
    "loaded since the first reading: a payload, wrong constants, efforts that lag positions, or a "
    "contact from the start? Nothing is claimed before it was free"
)
OFTEN = (
    f"loaded for most of the last {LONG:g} s: a payload, wrong constants, or efforts that lag "
    "positions, if nothing touches"
)


class FrozenEfforts:
    """Joints that go on to report one and the same effort while what they bear is another.

    Args:
        lag: of the observer [s].
    """

    def __init__(self, lag: float) -> None:
        self._lag = lag
        self.reset()

    def reset(self) -> None:
        """Begin again, as the observer does."""
        self.found: NDArray[np.bool_] = np.zeros((), np.bool_)
        """Which efforts are frozen, shape (n,); none, of shape (), before the first."""
        self._efforts: FloatArray | None = None

    def follow(
        self, stamp: float, efforts: FloatArray, left: FloatArray, deviations: FloatArray
    ) -> None:
        """Take note of the efforts of a reading.

        Args:
            stamp: of the reading [s].
            efforts: as reported, shape (n,).
            left: what motion and gravity do not explain of their torques, shape (n,) [N·m, N].
            deviations: its standard deviations, shape (n,).
        """
        if self._efforts is None:
            self._efforts = np.full(len(efforts), np.nan)
            self._count, self._since = np.zeros(len(efforts), np.intp), np.full(len(efforts), stamp)
            self._least, self._greatest = left.copy(), left.copy()
        stays = efforts == self._efforts
        self._efforts = efforts
        self._count = np.where(stays, self._count + 1, 1)
        self._since = np.where(stays, self._since, stamp)
        settled = stays & (stamp - self._since > SETTLED * self._lag)
        self._least = np.where(settled, np.minimum(self._least, left), left)
        self._greatest = np.where(settled, np.maximum(self._greatest, left), left)
        dead = (efforts == 0.0) & (self._count >= ZEROS) & (np.abs(left) > BEYOND * deviations)
        self.found = dead | (self._greatest - self._least > BEYOND * deviations)


class LoadWatch:
    """Compares the time for which torques are loaded with that for which they are free."""

    def __init__(self) -> None:
        self._first = self._last = self._free_since = np.nan
        self._was_free, self._share, self._whole = False, 0.0, 0.0

    @property
    def may_be_own(self) -> bool:
        """Whether the load is there since the first reading, and for long."""
        return not self._was_free and self._last - self._first >= START

    @property
    def is_loaded_often(self) -> bool:
        """Whether it is loaded for most of the time."""
        return self._whole >= LONG and self._share > 0.5

    def follow(self, stamp: float, is_loaded: bool) -> None:
        """Take note of the load at a stamp [s]."""
        self._first = stamp if np.isnan(self._first) else self._first
        elapsed = stamp - self._last
        self._last = stamp
        if is_loaded:
            self._free_since = np.nan
        elif np.isnan(self._free_since):
            self._free_since = stamp
        self._was_free |= stamp - self._free_since >= FREE
        if 0.0 < elapsed <= GAP:
            self._whole += elapsed
            part = elapsed / min(self._whole, LONG)
            self._share += part * (is_loaded - self._share)
