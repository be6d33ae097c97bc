"""Contact hypotheses: where a source believes, or rules out, a contact (F §III-A)."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from contactfusion.arrays import LARGEST, FloatArray, finite_number, frozen_array
from contactfusion.errors import InvalidCloudError, name_hint
from contactfusion.frames import Pose, points_in, vectors_in
from contactfusion.time import LONGEST_SECONDS

SUM_TOLERANCE = 1e-6
"""How far above 1 the likelihoods of a single contact may sum through rounding."""


class HypothesisKind(StrEnum):
    """What a hypothesis stands on (F §III-A)."""

    REGULAR = "regular"
    """Evidence from a sensor."""
    SUPPORT = "support"
    """A prediction or context: counts only together with evidence."""
    NULL = "null"
    """Here is no contact."""


class Note(StrEnum):
    """Remarks that a generator may attach to a cloud; others are plain text."""

    MORE_THAN_ONE_CONTACT = "more than one contact"
    OFF_SURFACE = "off the surface"
    PULLS = "the force pulls: sign?"
    REVERSED = "reversed, it would explain what it does not: sign?"
    NEVER_FREE = "loaded since the first reading: tare?"
    UNCHANGED = "loaded and unchanged since the first reading: columns?"
    SATURATED = "saturated"
    UNHEALTHY = "unhealthy"


def kind_of(value: str) -> HypothesisKind:
    """The kind of a name.

    Raises:
        InvalidCloudError: there is no such kind.
    """
    try:
        return HypothesisKind(value)
    except ValueError:
        hint = name_hint(str(value), list(HypothesisKind), "kinds")
        raise InvalidCloudError(f"unknown kind {value!r}: {hint}") from None


@dataclass(frozen=True, slots=True, eq=False)
class Resultant:
    """The sum of the forces and torques of all contacts on a part of the robot.

    Attributes:
        force: shape (3,) [N], on the robot.
        torque: shape (3,) [N·m], on the robot, about `origin`.
        origin: shape (3,) [m].
        force_deviation: standard deviation of the force, by axis [N].
        torque_deviation: standard deviation of the torque, by axis [N·m].
        links: of the part; empty: the whole robot.

    Raises:
        InvalidCloudError: a vector that is not finite, or a deviation that is not positive.
    """

    force: FloatArray
    torque: FloatArray
    origin: FloatArray
    force_deviation: float
    torque_deviation: float
    links: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check every field and freeze the arrays."""
        for name in ("force", "torque", "origin"):
            what = f"the {name} of a resultant"
            vector = frozen_array(getattr(self, name), (3,), what, InvalidCloudError)
            object.__setattr__(self, name, vector)
        for name in ("force_deviation", "torque_deviation"):
            what = f"the {name} of a resultant"
            if finite_number(getattr(self, name), what, InvalidCloudError) <= 0.0:
                raise InvalidCloudError(f"{what} is {getattr(self, name):g}, not positive")

    def moved(self, pose: Pose) -> "Resultant":
        """In another frame; `pose` is that of the present frame in it."""
        force, torque = vectors_in(pose, np.stack([self.force, self.torque]))
        origin = points_in(pose, self.origin[None])[0]
        return replace(self, force=force, torque=torque, origin=origin)


@dataclass(frozen=True, slots=True, eq=False)
class HypothesisCloud:
    """All hypotheses that one source gives at one instant, as arrays.

    An empty cloud means "measured, found nothing".

    Attributes:
        source: the name of the source, e.g. "skin" or "skin/free".
        kind: evidence, support or null.
        stamp: when the sensor measured [s].
        frame: the frame of the positions and forces.
        positions: shape (n, 3) [m].
        likelihoods: shape (n,), in [0, 1].
        forces: shape (n, 3) [N], the force on the robot at each place, or None.
        spreads: shape (n,) [m], the standard deviation of each position, or None.
        single: whether the cloud describes one contact somewhere in it; then the likelihoods sum
            to the probability that there is a contact at all (F Eq 2).
        notes: remarks that reach the report, see `Note`.
        resultant: of all contacts, in the cloud's frame, where the source measures it; also of an
            empty cloud, for the sum of several contacts may point at no place.

    Raises:
        InvalidCloudError: a value that no hypothesis can have; names the first bad row.
    """

    source: str
    kind: HypothesisKind
    stamp: float
    frame: str
    positions: FloatArray
    likelihoods: FloatArray
    forces: FloatArray | None = None
    spreads: FloatArray | None = None
    single: bool = False
    notes: tuple[str, ...] = ()
    resultant: Resultant | None = None

    def __post_init__(self) -> None:
        """Check every field and freeze the arrays."""
        if not self.source or not isinstance(self.source, str):
            raise InvalidCloudError("a cloud needs the name of its source")
        if not self.frame or not isinstance(self.frame, str):
            raise InvalidCloudError(f"a cloud of '{self.source}' needs the name of its frame")
        keep = object.__setattr__
        keep(self, "kind", kind_of(self.kind))
        stamp = finite_number(self.stamp, f"the stamp of '{self.source}'", InvalidCloudError)
        if abs(stamp) > LONGEST_SECONDS:
            raise InvalidCloudError(f"the stamp of '{self.source}' is out of range: {stamp} s")
        keep(self, "stamp", stamp)
        keep(self, "positions", self._rows(self.positions, (None, 3), "positions"))
        n = len(self.positions)
        keep(self, "likelihoods", self._rows(self.likelihoods, (n,), "likelihoods", finite=False))
        _refuse_outside(self.likelihoods, 0.0, 1.0, f"likelihoods of '{self.source}'")
        if self.forces is not None:
            keep(self, "forces", self._rows(self.forces, (n, 3), "forces"))
        if self.spreads is not None:
            keep(self, "spreads", self._rows(self.spreads, (n,), "spreads", finite=False))
            _refuse_outside(self.spreads, 0.0, LARGEST, f"spreads of '{self.source}'")
        keep(self, "single", bool(self.single))
        if self.single and n and (total := float(self.likelihoods.sum())) > 1.0 + SUM_TOLERANCE:
            raise InvalidCloudError(
                f"the likelihoods of '{self.source}' describe a single contact but sum to "
                f"{total:.6g}, more than 1"
            )
        keep(self, "notes", tuple(str(note) for note in self.notes))

    def __len__(self) -> int:
        """The number of hypotheses."""
        return len(self.positions)

    def _rows(
        self, value: FloatArray, shape: tuple[int | None, ...], name: str, finite: bool = True
    ) -> NDArray[np.float64]:
        what = f"{name} of '{self.source}'"
        return frozen_array(value, shape, what, InvalidCloudError, finite=finite)


class ContactHypothesis(BaseModel):
    """The papers' record of one hypothesis (F §III-A), for JSON and people."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )

    location: tuple[float, float, float]
    """The place [m], in `frame`."""
    likelihood: float = Field(ge=0, le=1)
    """The fused likelihood of a contact there."""
    likelihoods: dict[str, float]
    """The likelihood that each source gave."""
    kind: HypothesisKind
    """Regular when a sensor gave evidence, else Null or Support."""
    stamp: float
    """The newest contribution [s]."""
    frame: str
    """The frame of location and force."""
    force_magnitude: float | None = Field(default=None, ge=0)
    """[N], when a source felt one."""
    force_direction: tuple[float, float, float] | None = None
    """A unit vector, when a source felt a force."""

    @property
    def sources(self) -> tuple[str, ...]:
        """The sources that contributed, by name."""
        return tuple(sorted(self.likelihoods))


def _refuse_outside(values: FloatArray, low: float, high: float, name: str) -> None:
    """Refuse values outside the bounds; NaN lies outside."""
    if len(values) and not (values.min() >= low and values.max() <= high):
        row = int(np.argmin((values >= low) & (values <= high)))
        raise InvalidCloudError(
            f"row {row} of the {name} is {values[row]:.6g}, outside [{low:g}, {high:g}]"
        )
