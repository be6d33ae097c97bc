"""What the steps of a pipeline amounted to, counted as they pass."""

import math
from collections.abc import Iterable, Iterator
from typing import Self, final

from contactfusion.integrator.report import EventKind, Report
from contactfusion.pipeline import Step

TELLING = (EventKind.REFUSED, EventKind.STALE, EventKind.OVERRUN)
"""What is worth a sentence at the end."""


@final
class Summary:
    """Counts steps and contacts, and keeps the first event of each kind and source.

    Attributes:
        steps: how many there were.
        with_contact: in how many of them something was touched.
        contacts: how many contacts they told.
        report: of the last step; None before the first.
        stamp: of the last step [s].
    """

    def __init__(self) -> None:
        self.steps = self.with_contact = self.contacts = 0
        self.report: Report | None = None
        self.stamp = math.nan
        self._first: dict[tuple[EventKind, str], tuple[float, str]] = {}
        self._times: dict[tuple[EventKind, str], int] = {}

    @classmethod
    def of(cls, steps: Iterable[Step]) -> Self:
        """Count steps."""
        summary = cls()
        for step in steps:
            summary.add(step)
        return summary

    def add(self, step: Step) -> None:
        """Count a step."""
        found = len(step.fusion.contacts)
        self.steps += 1
        self.with_contact += bool(found)
        self.contacts += found
        self.report, self.stamp = step.fusion.report, step.stamp
        for event in step.events:
            key = event.kind, event.source
            self._first.setdefault(key, (step.stamp, event.message))
            self._times[key] = self._times.get(key, 0) + 1

    def refusal(self, source: str) -> str | None:
        """Give why a cloud of a source was refused first; None when none was."""
        first = self._first.get((EventKind.REFUSED, source))
        return first[1] if first else None

    def lines(self) -> Iterator[str]:
        """Give what there was, for people."""
        yield (f"{self.steps} steps, {self.with_contact} with contact, {self.contacts} contacts")
        for name, source in self.report.sources.items() if self.report else ():
            rate = "no rate" if math.isnan(source.rate) else f"{source.rate:.4g} Hz"
            yield (
                f"  {name} ({source.kind}): {source.accepted} clouds, {rate}, {source.late} late, "
                f"{source.early} early, {source.invalid} refused"
            )
        for (kind, name), (stamp, message) in self._first.items():
            if kind in TELLING:
                times = self._times[kind, name]
                often = f" ({times} times)" if times > 1 else ""
                yield f"  {kind} at {stamp:.3f} s{often}: {message}"
