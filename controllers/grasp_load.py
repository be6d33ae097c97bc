"""The load in a hand by the force on its wrist: what was lifted, and whether it slips away."""

from collections import deque
from collections.abc import Iterable

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.model import Model
from contactfusion.readings import Wrench
from contactfusion.units import Force, Memory, Reach


class LoadConfig(Model):
    """How the wrist weighs what the hand carries."""

    sensor: str
    """The force-torque sensor of the wrist."""
    span: Memory = Field(default=0.2, gt=0)
    """Duration whose median force counts: shorter jerks do not [s]."""
    clear: Reach = Field(default=0.03, gt=0)
    """Height at which the object hangs free, and is weighed [m]."""
    least: Force = Field(default=0.5, gt=0)
    """Weight under which nothing has been lifted [N]."""
    lost: float = Field(default=0.5, gt=0, lt=1)
    """Share of the weight whose loss is a slip."""


class CarriedLoad:
    """Weighs what a hand carries; the hand may move, but not turn.

    Without a turn the weight of the hand is constant, and so is the bias of the sensor: both go
    with the force of the empty hand. Neither the sign of the sensor nor its frame matters.

    Args:
        config: sensor and limits.
    """

    def __init__(self, config: LoadConfig) -> None:
        self._config = config
        self._recent = deque[Wrench]()
        self._empty: FloatArray | None = None
        self._lifted: float | None = None

    def feel(self, wrenches: Iterable[Wrench], now: float) -> None:
        """Take the newest readings of wrists, and drop those that are older than the span."""
        recent = self._recent
        recent.extend(wrench for wrench in wrenches if wrench.sensor == self._config.sensor)
        while recent and now - recent[0].stamp > self._config.span:
            recent.popleft()

    def tare(self) -> None:
        """Take the force now for that of the empty hand."""
        self._empty = self._force()

    def begin(self) -> None:
        """Begin to lift another object."""
        self._lifted = None

    def slip(self, height: float) -> str | None:
        """Why the object has slipped; empty: it has not. None: the wrist does not weigh it.

        Args:
            height: of the hand above where it took the object [m].
        """
        config, force = self._config, self._force()
        if force is None or self._empty is None:
            return None
        weight = float(np.linalg.norm(force - self._empty))
        if self._lifted is None:
            if height < config.clear:
                return ""
            if weight < config.least:
                return f"it lifts {weight:.1f} N: nothing"
            self._lifted = weight
        if weight < (1.0 - config.lost) * self._lifted:
            return f"of {self._lifted:.1f} N it still lifts {weight:.1f} N"
        return ""

    def _force(self) -> FloatArray | None:
        """The median force, shape (3,) [N]; None of a silent sensor, or one that repeats itself."""
        forces = np.array([wrench.force for wrench in self._recent])
        if not len(forces) or (forces == forces[0]).all():
            return None
        return np.asarray(np.median(forces, axis=0))
