"""Whether the sign of forces is wrong: turned round, they explain for long what they do not as is.

Contacts push. Where a force pulls on all of the surface, and its reverse would push, the sign is
suspect; so it is where the weight of a known load comes out reversed.
"""

import numpy as np

from contactfusion.arrays import FloatArray

LONG = 2.0
"""Time for which the reverse has to explain what the force does not [s]."""
SHARE = 0.75
"""The least part of the compared time in which it does."""
GAP = 0.5
"""Samples that are further apart count as no time [s]."""
SPREAD = 0.3
"""The least spread of the weights of a load, in the load's weight: it has been turned."""
REVERSED = -1.5
"""A reading that falls by more than that per weight has its sign reversed; that would be -2."""
FITS = 0.5
"""The most that is left of the readings' variance, where weights explain them."""


class SignWatch:
    """Counts the time for which a force explains contacts, and for which its reverse does."""

    def __init__(self) -> None:
        self._last: float | None = None
        self._reverse = self._whole = 0.0
        self._said = False

    def suspects(self, stamp: float, reverse: bool) -> bool:
        """Whether the sign is wrong; true once.

        Args:
            stamp: of a sample with a force [s].
            reverse: whether its reverse explains it, and not the force itself.
        """
        elapsed = 0.0 if self._last is None else stamp - self._last
        self._last = stamp
        if 0.0 < elapsed <= GAP:
            self._whole += elapsed
            self._reverse += elapsed if reverse else 0.0
        wrong = self._reverse >= LONG and self._reverse >= SHARE * self._whole
        news = wrong and not self._said
        self._said |= wrong
        return news


class WeightWatch:
    """Compares what a sensor reads beside its load with the weight of that load, over its poses."""

    def __init__(self) -> None:
        self._count, self._means = 0, np.zeros((2, 3))
        self._squares = np.zeros(3)
        self._first: float | None = None
        self._said = False

    def suspects(self, stamp: float, weight: FloatArray, left: FloatArray) -> bool:
        """Whether the load comes out reversed; true once.

        Of a reversed sensor what is left of the force is -2 times the weight, beside a bias.

        Args:
            stamp: of the sample [s].
            weight: shape (3,) [N], of the load in this pose.
            left: shape (3,) [N], the force without the weight.
        """
        self._first = stamp if self._first is None else self._first
        self._count += 1
        both = np.stack([weight, left])
        before = both - self._means
        self._means += before / self._count
        (w, r), (wm, rm) = before, both - self._means
        self._squares += w @ wm, w @ rm, r @ rm
        own, cross, whole = self._squares.tolist()
        turned = own >= self._count * SPREAD**2 * float(weight @ weight) > 0.0
        if self._said or not turned or stamp - self._first < LONG:
            return False
        self._said = cross <= REVERSED * own and whole - cross**2 / own <= FITS * whole
        return self._said
