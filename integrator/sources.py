"""What the integrator remembers of each source."""

import math
from collections import Counter, deque
from dataclasses import dataclass, field

from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.integrator.report import SourceReport
from contactfusion.time import NANOSECONDS_PER_SECOND

RATE_WINDOW = 16
"""The rate of a source is that of its newest so many clouds."""
REMARKS = 32
"""At most so many different remarks are counted: a plug-in may make up new ones for ever."""


@dataclass(slots=True)
class SourceRecord:
    """One plugged source: how it was plugged, and what came from it; times in ns."""

    name: str
    kind: HypothesisKind
    timeout: int = 0
    stale_after: int = 0
    replace: bool = False
    sensitivity: float = 0.0
    found_nothing: bool = False
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
        self.found_nothing = not cloud.likelihoods.any() and not cloud.notes

    def is_active(self, now: int) -> bool:
        """Whether the source has not been silent for too long.

        Silence counts from the newest accepted stamp or, before the first, from the first step.
        """
        since = self.stamps[-1] if self.stamps else self.first_step
        return since is None or now - since <= self.stale_after

    def misses(self, now: int, lifetime: int) -> float:
        """Give how probable its silence is while there is a contact.

        1 unless its newest cloud, not older than entries may be, says that it found nothing.

        Args:
            now: [ns].
            lifetime: how old its entries may be [ns].
        """
        fresh = bool(self.stamps) and now - self.stamps[-1] <= lifetime
        return 1.0 - self.sensitivity if fresh and self.found_nothing else 1.0

    def forget(self) -> None:
        """Forget all stamps, as at the restart of a clock; the counts stay."""
        self.stamps.clear()
        self.first_step, self.active, self.notes = None, True, ()

    def report(self, now: int) -> SourceReport:
        """Tell how the source does."""
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
