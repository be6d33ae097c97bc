"""Whether a patch may say that nothing touches it (method §5)."""

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray

PERSISTS = 0.2
"""Evidence of others that lasts longer than this silences a taxel [s]."""
ALIVE = 0.5
"""A patch shows noise when at least this part of its taxels has changed."""


class Health:
    """Watches a patch: a dead one reads zeros, or its last value, and must not forbid contacts.

    Args:
        taxels: how many there are.
        window: how long a sign of life counts [s].
    """

    def __init__(self, taxels: int, window: float) -> None:
        self._window = window
        self._values: FloatArray | None = None
        self._changed = np.full(taxels, -np.inf)
        self._confirmed = -np.inf
        self._disputed_since = np.full(taxels, np.inf)

    def watch(self, stamp: float, values: FloatArray) -> None:
        """Look for noise: a taxel that changes is alive.

        Args:
            stamp: of the reading [s].
            values: shape (n,), as the sensor gives them.
        """
        if self._values is not None:
            self._changed[values != self._values] = stamp
        self._values = values

    def confirm(self, stamp: float) -> None:
        """Note that a self-test passed, or that another source confirmed a contact."""
        self._confirmed = stamp

    def healthy(self, stamp: float) -> bool:
        """Tell whether the patch has shown itself alive within the window."""
        noisy = float((stamp - self._changed <= self._window).mean()) >= ALIVE
        return noisy or stamp - self._confirmed <= self._window

    def disputed(self, stamp: float, contradicted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Tell over which taxels another source has seen a contact for long, shape (n,).

        Args:
            stamp: of the reading [s].
            contradicted: shape (n,), where another source has evidence of a contact now.
        """
        since = np.minimum(self._disputed_since, stamp)
        self._disputed_since = np.where(contradicted, since, np.inf)
        return stamp - self._disputed_since > PERSISTS
