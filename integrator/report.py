"""What each step tells about the sources."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from contactfusion.hypotheses import HypothesisKind


class EventKind(StrEnum):
    """What can happen to a source."""

    PLUGGED = "plugged"
    UNPLUGGED = "unplugged"
    STALE = "stale"
    BACK = "back"
    LATE = "late"
    EARLY = "early"
    REFUSED = "refused"
    OVERRUN = "overrun"


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened to a source since the last step.

    Attributes:
        kind: what happened.
        source: the source, or the generator, that it happened to.
        message: one sentence for people.
    """

    kind: EventKind
    source: str
    message: str


@dataclass(frozen=True, slots=True)
class SourceReport:
    """How one source does.

    Attributes:
        kind: evidence, support or null.
        rate: clouds a second over the newest clouds, by their stamps; NaN before the second.
        age: time since its newest accepted stamp [s]; NaN before the first.
        active: whether readiness waits for it; a source that is silent for too long is not active.
        accepted: clouds accepted so far.
        late: clouds dropped because a newer one had been accepted.
        early: clouds held back because their stamp was too far ahead.
        invalid: clouds refused.
        notes: remarks on its newest cloud.
        remarks: how many accepted clouds came with each remark.
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
    """How all sources do.

    Attributes:
        sources: by name.
        events: what happened since the last step, in order.
    """

    sources: Mapping[str, SourceReport]
    events: tuple[Event, ...]

    @property
    def notes(self) -> tuple[tuple[str, str], ...]:
        """Every (source, remark) on a newest cloud."""
        return tuple((name, note) for name, one in self.sources.items() for note in one.notes)
