"""Whether a patch may say that nothing touches it (SPEC §5)."""

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
        window: how long a sign of life counts [s].
    """

    def __init__(self, window: float) -> None:
        self._window = window
        self._last: FloatArray | None = None
        self._changed: FloatArray | None = None
        self._alive_until = -np.inf
        self._disputed_since: FloatArray | None = None

    def watch(self, stamp: float, values: FloatArray) -> None:
        """Look for noise: a taxel that changes is alive.

        Args:
            stamp: of the reading [s].
            values: shape (n,), as the sensor gives them.
        """
        if self._last is None or self._changed is None:
            self._changed = np.full(len(values), -np.inf)
        else:
            self._changed[values != self._last] = stamp
        self._last = values
        if (stamp - self._changed <= self._window).mean() >= ALIVE:
            self._alive_until = stamp + self._window

    def confirm(self, stamp: float) -> None:
        """Note that a self-test passed, or that another source confirmed a contact."""
        self._alive_until = stamp + self._window

    def healthy(self, stamp: float) -> bool:
        """Tell whether the patch has shown itself alive within the window."""
        return stamp <= self._alive_until

    def undisputed(self, stamp: float, contradicted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Tell which taxels no other source has contradicted for long.

        Args:
            stamp: of the reading [s].
            contradicted: shape (n,), where another source has evidence of a contact now.
        """
        if self._disputed_since is None:
            self._disputed_since = np.full(len(contradicted), np.inf)
        self._disputed_since[~contradicted] = np.inf
        fresh = contradicted & np.isinf(self._disputed_since)
        self._disputed_since[fresh] = stamp
        return stamp - self._disputed_since <= PERSISTS
