"""How far aside a hand goes between the places where it has been touched on either side."""

from typing import final

import numpy as np

NARROW = 0.005
"""Nothing lies between places that are nearer to each other [m]."""


@final
class Between:
    """What was touched on one side here, and on the other there, lies between the two.

    So it is wider than it was taken for: the hand does not go beyond, but half-way.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Forget all touches, as after the object may have been moved."""
        self._low, self._high = -np.inf, np.inf

    def shift(self, here: float, wanted: float) -> float:
        """Give how far aside the hand goes [m].

        Args:
            here: where it was touched, aside [m].
            wanted: how far it would go by this touch alone [m].
        """
        low, high = (here, self._high) if wanted > 0.0 else (self._low, here)
        if high - low < NARROW:  # the object has been pushed aside meanwhile
            low, high = (here, np.inf) if wanted > 0.0 else (-np.inf, here)
        self._low, self._high = low, high
        return wanted if low < here + wanted < high else (low + high) / 2.0 - here
