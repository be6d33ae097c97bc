"""A reading: one sample of one sensor, with stamp, frame and units; a subclass for each kind."""

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import finite_number, frozen_array
from contactfusion.errors import InvalidReadingError
from contactfusion.time import LONGEST_SECONDS

At = dict[str, Any]
"""Some fields of a reading by name: its stamp [s], frame and sensor, and others of its kind."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """One sample of one sensor.

    Attributes:
        stamp: when it was measured [s].
        frame: the frame in which its values are given.
        sensor: the name of the sensor, so that one of several can be chosen.
    """

    stamp: float
    frame: str
    sensor: str = ""

    def __post_init__(self) -> None:
        """Check stamp and frame, then what the kind of reading adds."""
        stamp = finite_number(self.stamp, f"the stamp of {self.label}", InvalidReadingError)
        if abs(stamp) > LONGEST_SECONDS:
            raise InvalidReadingError(f"the stamp of {self.label} is out of range: {stamp} s")
        self._set("stamp", stamp)
        if not self.frame:
            raise InvalidReadingError(f"{self.label} needs the name of its frame")
        self._check()

    @property
    def label(self) -> str:
        """The name of the reading in a sentence."""
        kind = type(self).__name__
        return f"{kind} of '{self.sensor}'" if self.sensor else kind

    def _check(self) -> None:
        """Check and freeze the values of this kind of reading."""

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _freeze(
        self, name: str, *shape: int | None, finite: bool = True, dtype: type = np.float64
    ) -> NDArray[Any]:
        label = f"{name} of {self.label}"
        array = frozen_array(
            getattr(self, name), shape, label, InvalidReadingError, finite=finite, dtype=dtype
        )
        self._set(name, array)
        return array

    def _freeze_turn(self) -> None:
        """Check and freeze an `orientation`."""
        norm = float(np.linalg.norm(self._freeze("orientation", 4)))
        if abs(norm - 1.0) > 1e-3:
            raise InvalidReadingError(
                f"the orientation of {self.label} is no unit quaternion: its norm is {norm:.4g}"
            )


R = TypeVar("R", bound=Reading)
