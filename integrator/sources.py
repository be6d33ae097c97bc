"""The sources: the record of each in the integrator, and its report in a step."""

import math
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, Resultant
from contactfusion.time import NANOSECONDS_PER_SECOND

RATE_WINDOW = 16
"""Number of newest clouds over which the rate of a source is measured."""
REMARKS = 32
"""The most different remarks that are counted: a plug-in may make up new ones for ever."""


class EventKind(StrEnum):
    """Kinds of events of a source."""

    PLUGGED = "plugged"
    UNPLUGGED = "unplugged"
    STALE = "stale"
    BACK = "back"
    LATE = "late"
    EARLY = "early"
    REFUSED = "refused"
    OVERRUN = "overrun"
    DISAGREES = "disagrees"

    @property
    def is_warning(self) -> bool:
        """Whether something is wrong with the source."""
        return self not in (EventKind.PLUGGED, EventKind.BACK)


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a source since the last step.

    Attributes:
        kind: of the event.
        source: the source, or the generator.
        message: one sentence for people.
    """

    kind: EventKind
    source: str
    message: str


@dataclass(frozen=True, slots=True)
class SourceReport:
    """The state of one source.

    Attributes:
        kind: evidence, support or null.
        rate: clouds a second over the newest clouds, by their stamps; NaN before the second.
        age: time since its newest accepted stamp [s]; NaN before the first.
        active: whether readiness waits for it; a source that is silent for too long is not active.
        accepted: clouds accepted so far.
        late: clouds dropped because a newer one had been accepted.
        early: clouds held back because their stamp was in the future.
        invalid: clouds refused.
        notes: remarks on its newest cloud.
        remarks: number of accepted clouds with each remark.
    """

    kind: HypothesisKind
    rate: float
    age: float
    active: bool
    accepted: int
    late: int
    early: int
    invalid: int
    notes: tuple[str, ...]
    remarks: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class Report:
    """The state of all sources.

    Attributes:
        sources: by name.
        events: what happened since the last step, in order.
    """

    sources: Mapping[str, SourceReport]
    events: tuple[Event, ...]

    @property
    def notes(self) -> tuple[tuple[str, str], ...]:
        """Every (source, remark) on a newest cloud."""
        return tuple((name, note) for name, report in self.sources.items() for note in report.notes)


@dataclass(slots=True)
class SourceRecord:
    """One plugged source: its options, and statistics of its clouds; times in ns."""

    name: str
    kind: HypothesisKind
    timeout: int = 0
    stale_after: int = 0
    replace: bool = False
    sensitivity: float = 0.0
    single: bool = False
    positions: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    found_nothing: bool = False
    resultant: Resultant | None = None
    looked: int | None = None
    stamps: deque[int] = field(default_factory=lambda: deque(maxlen=RATE_WINDOW))
    first_step: int | None = None
    active: bool = True
    accepted: int = 0
    late: int = 0
    early: int = 0
    invalid: int = 0
    notes: tuple[str, ...] = ()
    remarks: Counter[str] = field(default_factory=Counter)

    @property
    def newest(self) -> int | None:
        """The newest accepted stamp, or None."""
        return self.stamps[-1] if self.stamps else None

    def is_late(self, stamp: int) -> bool:
        """Whether a newer cloud than one of this stamp has been accepted."""
        return bool(self.stamps) and stamp < self.stamps[-1]

    def accept(self, cloud: HypothesisCloud, stamp: int) -> None:
        """Note that a cloud was accepted."""
        self.accepted += 1
        self.stamps.append(stamp)
        self.notes = cloud.notes
        for note in dict.fromkeys(cloud.notes):
            if note in self.remarks or len(self.remarks) < REMARKS:
                self.remarks[note] += 1
        found = cloud.likelihoods.any() or cloud.resultant is not None
        if found or not cloud.notes:
            self.looked = stamp
        if len(cloud):
            self.single, self.positions = cloud.single, cloud.positions
        self.resultant = cloud.resultant
        self.found_nothing = not found and not cloud.notes

    def is_active(self, now: int) -> bool:
        """Whether the source has not been silent for too long.

        Silence counts from the newest accepted stamp or, before the first, from the first step.
        """
        since = self.stamps[-1] if self.stamps else self.first_step
        return since is None or now - since <= self.stale_after

    def misses(self, now: int, lifetime: int) -> float:
        """The probability of a miss: that it finds nothing while there is a contact.

        1 unless its newest cloud, not older than entries may be, is empty.

        Args:
            now: [ns].
            lifetime: of its entries [ns].
        """
        fresh = self.is_fresh(now, lifetime)
        return 1.0 - self.sensitivity if fresh and self.found_nothing else 1.0

    def is_fresh(self, now: int, lifetime: int) -> bool:
        """Whether its newest cloud is not older than entries may be; both times in ns."""
        return bool(self.stamps) and now - self.stamps[-1] <= lifetime

    def forget(self) -> None:
        """Forget all stamps, as at the restart of a clock; the counts stay."""
        self.stamps.clear()
        self.first_step, self.looked, self.active, self.notes = None, None, True, ()

    def report(self, now: int) -> SourceReport:
        """The source as a step reports it."""
        rate, age = math.nan, math.nan
        if self.stamps:
            age = (now - self.stamps[-1]) / NANOSECONDS_PER_SECOND
            span = self.stamps[-1] - self.stamps[0]
            rate = (len(self.stamps) - 1) * NANOSECONDS_PER_SECOND / span if span else math.nan
        return SourceReport(
            self.kind,
            rate,
            age,
            self.active,
            self.accepted,
            self.late,
            self.early,
            self.invalid,
            self.notes,
            dict(self.remarks),
        )
