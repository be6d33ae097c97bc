"""What the steps of a pipeline amounted to, counted as they pass, and what kept it from its job."""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, final

import numpy as np

from contactfusion.assembly import AnyGenerator
from contactfusion.contacts import Contact
from contactfusion.errors import ConfigurationError, listed_once, name_hint
from contactfusion.faults import unmet
from contactfusion.hypotheses import HypothesisKind, Note
from contactfusion.integrator.sources import EventKind, Report, SourceReport
from contactfusion.pipeline import Pipeline, Step
from contactfusion.readings import Reading
from contactfusion.readings.registry import installed_kinds

TELLING = (EventKind.REFUSED, EventKind.STALE, EventKind.OVERRUN)
"""What is worth a sentence at the end."""
CAUSES: dict[str, str] = {Note.MORE_THAN_ONE_CONTACT: "tare?"}
"""The likely cause of a remark that most clouds of a source come with, of a force that changes."""
Heard = Collection[tuple[str, type[Reading]]]
"""The sensors and types of the readings that came, before any faults."""


@final
class Summary:
    """Counts steps and contacts, and keeps the first event of each kind and source.

    Args:
        pipeline: whose steps are counted.

    Attributes:
        steps: how many there were.
        with_contact: in how many of them something was touched.
        contacts: how many contacts they told.
        first: the likeliest contact of the first step with any, and the step's stamp [s]; None
            before it.
        likeliest: of all contacts, likewise.
        last: the likeliest contact of the last step with any, likewise.
        report: of the last step; None before the first.
        stamp: of the last step [s].
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self.steps = self.with_contact = self.contacts = 0
        self.first: tuple[float, Contact] | None = None
        self.likeliest: tuple[float, Contact] | None = None
        self.last: tuple[float, Contact] | None = None
        self.report: Report | None = None
        self.stamp = math.nan
        self._first_events: dict[tuple[EventKind, str], tuple[float, str]] = {}
        self._times: dict[tuple[EventKind, str], int] = {}

    def add(self, step: Step) -> None:
        """Count a step."""
        found = len(step.fusion.contacts)
        self.steps += 1
        self.with_contact += bool(found)
        self.contacts += found
        if found:
            self.last = step.stamp, step.fusion.contacts[0]
            self.first = self.first or self.last
            if not self.likeliest or self.last[1].likelihood > self.likeliest[1].likelihood:
                self.likeliest = self.last
        self.report, self.stamp = step.fusion.report, step.stamp
        for event in step.events:
            key = event.kind, event.source
            self._first_events.setdefault(key, (step.stamp, event.message))
            self._times[key] = self._times.get(key, 0) + 1

    def fields(self) -> dict[str, Any]:
        """Counts of steps and contacts, and how each source did; JSON."""
        return {
            "steps": self.steps,
            "steps_with_contact": self.with_contact,
            "contacts": self.contacts,
            "sources": {
                name: {
                    "kind": str(source.kind),
                    "rate": None if math.isnan(source.rate) else source.rate,
                    "accepted": source.accepted,
                    "late": source.late,
                    "early": source.early,
                    "invalid": source.invalid,
                    "remarks": dict(source.remarks),
                }
                for name, source in self._sources.items()
            },
        }

    def lines(self) -> Iterator[str]:
        """Give what there was, for people."""
        yield f"{self.steps} steps, {self.with_contact} with contact, {self.contacts} contacts"
        if self.first and self.likeliest and self.last:
            yield f"  first at {self.first[0]:.3f} s: {self.first[1]}"
            stamp, contact = self.likeliest
            yield f"  likeliest at {stamp:.3f} s: {contact}{_force(contact)}"
            yield f"  last at {self.last[0]:.3f} s: {self.last[1]}"
        for name, source in self._sources.items():
            rate = "no rate" if math.isnan(source.rate) else f"{source.rate:.4g} Hz"
            yield (
                f"  {name} ({source.kind}): {source.accepted} clouds, {rate}, {source.late} late, "
                f"{source.early} early, {source.invalid} refused"
            )
            for note, count in source.remarks.items():
                blames = 2 * count > source.accepted and Note.UNCHANGED not in source.remarks
                cause = f": {CAUSES[note]}" if note in CAUSES and blames else ""
                yield f"    {count} × {note}{cause}"
        for name, generator in self._pipeline.generators.items():
            given, looked = self._pipeline.given[name], self._looked(generator)
            if 0 < 2 * looked < given and HypothesisKind.REGULAR in generator.sources.values():
                yield f"  {name}: {given - looked} of {given} readings gave no cloud"
        if misplaced := self._pipeline.misplaced:
            yield f"  {misplaced}"
        yield from listed_once(self._happened(), told=next(self._useless(), ""))
        for row, fault in enumerate(self._pipeline.config.faults):
            if fault.start is not None and fault.start > self.stamp:
                yield f"  faults.{row} did nothing: it starts at {fault.start:g} s, after the end"

    def _happened(self) -> Iterator[str]:
        """The first event of each kind and source; sources of the same event share a line."""
        alike: dict[tuple[EventKind, str], list[str]] = {}
        for (kind, name), (_, message) in self._first_events.items():
            if kind in TELLING:
                alike.setdefault((kind, message.replace(f"'{name}'", "")), []).append(name)
        for (kind, _), (name, *others) in alike.items():
            stamp, message = self._first_events[kind, name]
            times = sum(self._times[kind, one] for one in (name, *others))
            often = f" ({times} times)" if times > 1 else ""
            likewise = f"; likewise {', '.join(map(repr, others))}" if others else ""
            yield f"  {kind} at {stamp:.3f} s{often}: {message}{likewise}"

    def complaints(self, heard: Heard) -> Iterator[str]:
        """Report what kept the pipeline from its job.

        Args:
            heard: what came.

        Yields:
            A sentence for each input that it waited for in vain, each source that gave nothing of
            use, and each fault that met no reading.
        """
        sensors = {sensor for sensor, _ in heard}
        config = self._pipeline.config
        on = config.cycle.on
        if on is not None and not self.steps:
            hint = name_hint(on, sensors.union(installed_kinds().names), "sensors and types")
            yield f"cycle.on: no reading of '{on}' came; {hint}"
        if not config.generators:
            yield "generators: none are configured, so nothing can be found"
        for name, generator in self._pipeline.generators.items():
            fit = [sensor for sensor, kind in heard if issubclass(kind, generator.readings)]
            wanted = generator.config.sensor
            if not fit:
                kinds = " or ".join(kind.__name__ for kind in generator.readings)
                yield f"generators.{name}: no {kinds} came"
            elif wanted is not None and wanted not in fit:
                hint = name_hint(wanted, fit, "sensors")
                yield f"generators.{name}.sensor: no reading of '{wanted}' came; {hint}"
        yield from self._useless()
        yield from unmet(config.faults, heard)

    def _useless(self) -> Iterator[str]:
        """Report plug-ins that ended or never looked, and sources of which most was refused."""
        sources, ended = self._sources, self._pipeline.ended
        for field, why in ended.items():
            yield f"{field}: {why}"
        for name, generator in self._pipeline.generators.items():
            if f"generators.{name}" in ended:
                continue
            given = self._pipeline.given[name]
            is_evidence = HypothesisKind.REGULAR in generator.sources.values()
            if self.steps and given and is_evidence and not self._looked(generator):
                why = f": {generator.waits_for}" if generator.waits_for else ""
                yield f"generators.{name}: it gave no cloud for any of its {given} readings{why}"
        for name, source in sources.items():
            if f"generators.{name.partition('/')[0]}" in ended:
                continue
            came = source.accepted + source.late + source.invalid
            if source.invalid == came > 0:
                yield f"every cloud of '{name}' was refused: {self._why(EventKind.REFUSED, name)}"
            elif 2 * source.invalid > came:
                why = self._why(EventKind.REFUSED, name)
                yield f"{source.invalid} of {came} clouds of '{name}' were refused: {why}"
            elif source.early and not source.accepted:
                yield f"no cloud of '{name}' was accepted: {self._why(EventKind.EARLY, name)}"

    def _looked(self, generator: AnyGenerator) -> int:
        """How many clouds the busiest source of a generator gave, of use or not."""
        reports = (one for name, one in self._sources.items() if name in generator.sources)
        return max(
            (one.accepted + one.late + one.early + one.invalid for one in reports), default=0
        )

    def _why(self, kind: EventKind, source: str) -> str:
        return self._first_events[kind, source][1]

    @property
    def _sources(self) -> Mapping[str, SourceReport]:
        return self.report.sources if self.report else {}


def _force(contact: Contact) -> str:
    """The force on the robot, as the end of a sentence; nothing where none was felt."""
    if np.isnan(contact.force).any():
        return ""
    x, y, z = np.round(contact.force, 1) + 0.0  # no -0
    return f", force ({x:.1f}, {y:.1f}, {z:.1f}) N"


def refuse(path: Path, complaints: Iterable[str]) -> None:
    """Refuse what did not do its job, with the first reason.

    Args:
        path: the configuration.
        complaints: the reasons.

    Raises:
        ConfigurationError: there is one.
    """
    if found := list(complaints):
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        raise ConfigurationError(f"{path}: {found[0]}{more}")
