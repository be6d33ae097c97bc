"""What came of each sensor, what its steps amounted to, and what kept a pipeline from its job."""

import math
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from statistics import median
from typing import Any, final

import numpy as np

from contactfusion.assembly import AnyGenerator
from contactfusion.contacts import Contact
from contactfusion.errors import ConfigurationError, listed_once, name_hint
from contactfusion.faults import unmet
from contactfusion.hypotheses import HypothesisKind, Note
from contactfusion.integrator.sources import EventKind, SourceReport
from contactfusion.loop import Observer, play
from contactfusion.pipeline import Pipeline, Step
from contactfusion.readings import Reading, Transform
from contactfusion.readings.codec import Role
from contactfusion.readings.registry import installed_kinds

TELLING = (EventKind.REFUSED, EventKind.STALE, EventKind.OVERRUN, EventKind.DISAGREES)
"""What is worth a sentence at the end."""
NO_GENERATORS = "generators: none are configured, so nothing can be found"
NO_EVIDENCE = "no generator gives evidence (regular): what is support or null makes no contact"
CAUSES: dict[str, str] = {
    Note.MORE_THAN_ONE_CONTACT: "tare?",
    Note.OFF_SURFACE: "is the surface that of what is touched, and the sign right?",
}
"""The likely cause of a remark that most clouds of a source come with, of a force that changes."""


TRIED = 300
"""So many readings are played to see whether all fits."""
MOST_EVENTS = 20_000
"""So many events of a run are kept, the newest."""
LEARNT = 200
"""The period of a sensor is learnt from so many intervals."""
GAP = 1.5
"""An interval of more than so many periods is a gap: readings were dropped."""


@final
@dataclass
class SensorTally:
    """The readings of one sensor, counted as they pass.

    Attributes:
        kind: of its readings.
        readings: how many came.
        first: the first stamp [s].
        last: the last stamp [s].
        dropped: how many more would have come in its gaps.
        longest: the longest interval [s].
    """

    kind: str
    readings: int = 0
    first: float = math.nan
    last: float = math.nan
    dropped: int = 0
    longest: float = 0.0
    _period: float = math.nan
    _intervals: list[float] = field(default_factory=list)

    def add(self, stamp: float) -> None:
        """Count a reading [s]; stamps rise."""
        if self.readings:
            self._pass(stamp - self.last)
        else:
            self.first = stamp
        self.readings += 1
        self.last = stamp

    def close(self) -> None:
        """Learn the period of a sensor of which little came."""
        if math.isnan(self._period) and self._intervals:
            self._learn()

    @property
    def rate(self) -> float:
        """Readings a second, over all its time; NaN before the second."""
        span = self.last - self.first
        return (self.readings - 1) / span if span > 0.0 else math.nan

    def _pass(self, interval: float) -> None:
        self.longest = max(self.longest, interval)
        if math.isnan(self._period):
            self._intervals.append(interval)
            if len(self._intervals) == LEARNT:
                self._learn()
        else:
            self._judge(interval)

    def _learn(self) -> None:
        self._period = median(self._intervals)
        for interval in self._intervals:
            self._judge(interval)
        self._intervals.clear()

    def _judge(self, interval: float) -> None:
        if self._period > 0.0 and interval > GAP * self._period:
            self.dropped += round(interval / self._period) - 1


@final
class Tally:
    """Counts readings by sensor and kind, in constant memory."""

    def __init__(self) -> None:
        self.streams: dict[str, SensorTally] = {}
        self.kinds: dict[tuple[str, type[Reading]], int] = {}
        """How many readings came, by sensor and type."""

    def add(self, reading: Reading) -> None:
        """Count a reading."""
        key = reading.sensor, type(reading)
        self.kinds[key] = self.kinds.get(key, 0) + 1
        name = reading.sensor or type(reading).__name__
        stream = self.streams.get(name)
        if stream is None:
            stream = self.streams[name] = SensorTally(type(reading).__name__)
        stream.add(reading.stamp)

    @property
    def span(self) -> float:
        """How long the recording is [s]; 0 when nothing came."""
        streams = [stream for stream in self.streams.values() if stream.readings]
        if not streams:
            return 0.0
        return max(s.last for s in streams) - min(s.first for s in streams)

    def table(self, troubles: Mapping[str, str]) -> Iterator[str]:
        """The lines of the table.

        Args:
            troubles: what its reader met, by sensor.
        """
        rows = [("input", "kind", "readings", "rate Hz", "dropped", "longest gap s", "trouble")]
        for name, stream in sorted(self.streams.items()):
            stream.close()
            rate = "-" if math.isnan(stream.rate) else f"{stream.rate:.4g}"
            counts = f"{stream.readings}", rate, f"{stream.dropped}", f"{stream.longest:.3f}"
            rows.append((name, stream.kind, *counts, troubles.get(name, "")))
        for name in sorted(set(troubles) - set(self.streams)):
            if troubles[name]:
                rows.append((name, "-", "0", "-", "-", "-", troubles[name]))
        widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
        for row in rows:
            cells = [
                cell.ljust(width) if column < 2 else cell.rjust(width)
                for column, (cell, width) in enumerate(zip(row[:-1], widths, strict=True))
            ]
            yield "  ".join([*cells, row[-1]]).rstrip()


@final
class Summary:
    """Counts readings, steps and contacts, and keeps events.

    Args:
        pipeline: whose steps are counted.
        most_events: number of newest events that are kept.

    Attributes:
        steps: how many there were.
        with_contact: in how many of them something was touched.
        contacts: how many contacts they reported.
        first: the likeliest contact of the first step with any, and the step's stamp [s]; None
            before it.
        likeliest: of all contacts, likewise.
        last: the likeliest contact of the last step with any, likewise.
        last_step: None before the first.
        events: the newest of the steps; JSON.
        left_out: number of older events that were not kept.
        tally: the readings that came, before any faults.
    """

    def __init__(self, pipeline: Pipeline, most_events: int = MOST_EVENTS) -> None:
        self._pipeline = pipeline
        self.steps = self.with_contact = self.contacts = 0
        self.first: tuple[float, Contact] | None = None
        self.likeliest: tuple[float, Contact] | None = None
        self.last: tuple[float, Contact] | None = None
        self.last_step: Step | None = None
        self.events = deque[dict[str, Any]](maxlen=most_events)
        self.left_out = 0
        self.tally = Tally()
        self._first_events: dict[tuple[EventKind, str], tuple[float, str]] = {}
        self._times: dict[tuple[EventKind, str], int] = {}

    @property
    def observer(self) -> Observer:
        """What counts readings and steps while they are played."""
        return Observer(self.tally.add, self.add)

    @property
    def came(self) -> bool:
        """Whether anything came but transforms."""
        return any(kind is not Transform for _, kind in self.tally.kinds)

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
        self.last_step = step
        for event in step.events:
            self.left_out += len(self.events) == self.events.maxlen
            self.events.append(
                {"stamp": step.stamp, "kind": str(event.kind), "message": event.message}
            )
            key = event.kind, event.source
            self._first_events.setdefault(key, (step.stamp, event.message))
            self._times[key] = self._times.get(key, 0) + 1

    def fields(self) -> dict[str, Any]:
        """Counts of steps and contacts, how each source did, and what happened; JSON."""
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
            "events": [*self.events],
            **({"events_left_out": self.left_out} if self.left_out else {}),
        }

    def lines(self) -> Iterator[str]:
        """What there was, for people."""
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
        if lacks_evidence(self._pipeline):
            yield f"  {NO_EVIDENCE}"
        for sensor, kind in self.tally.kinds:
            codec = installed_kinds().of(kind)
            is_context = codec is not None and codec.role is not Role.SENSED
            if not is_context and not self._pipeline.listens(sensor, kind):
                yield f"  no generator takes the {kind.__name__} of '{sensor}'"
        if misplaced := self._pipeline.misplaced:
            yield f"  {misplaced}"
        yield from listed_once(self._happened(), printed=next(self._useless(), ""))
        for row, fault in enumerate(self._pipeline.config.faults):
            end = self.last_step.stamp if self.last_step else math.nan
            if fault.start is not None and fault.start > end:
                yield f"  faults.{row} did nothing: it starts at {fault.start:g} s, after the end"

    def _happened(self) -> Iterator[str]:
        """The first event of each kind and source; sources of the same event share a line."""
        alike: dict[tuple[EventKind, str], list[str]] = {}
        for (kind, name), (_, message) in self._first_events.items():
            if kind in TELLING:
                alike.setdefault((kind, message.replace(f"'{name}'", "")), []).append(name)
        for (kind, _), (name, *others) in alike.items():
            stamp, message = self._first_events[kind, name]
            times = sum(self._times[kind, source] for source in (name, *others))
            often = f" ({times} times)" if times > 1 else ""
            likewise = f"; likewise {', '.join(map(repr, others))}" if others else ""
            yield f"  {kind} at {stamp:.3f} s{often}: {message}{likewise}"

    def complaints(self) -> Iterator[str]:
        """Report what kept the pipeline from its job.

        Yields:
            A sentence for each input that it waited for in vain, each source that gave nothing of
            use, and each fault that met no reading.
        """
        came = self.tally.kinds
        sensors = {sensor for sensor, _ in came}
        config = self._pipeline.config
        on = config.cycle.on
        if on is not None and not self.steps:
            hint = name_hint(on, sensors.union(installed_kinds().names), "sensors and types")
            yield f"cycle.on: no reading of '{on}' came; {hint}"
        if not config.generators:
            yield NO_GENERATORS
        for name, generator in self._pipeline.generators.items():
            fit = [sensor for sensor, kind in came if issubclass(kind, generator.readings)]
            wanted = generator.config.sensor
            if not fit:
                kinds = " or ".join(kind.__name__ for kind in generator.readings)
                yield f"generators.{name}: no {kinds} came"
            elif wanted is not None and wanted not in fit:
                hint = name_hint(wanted, fit, "sensors")
                yield f"generators.{name}.sensor: no reading of '{wanted}' came; {hint}"
        yield from self._useless()
        yield from unmet(config.faults, came)

    def _useless(self) -> Iterator[str]:
        """Report plug-ins that ended or never looked, and sources of which most was refused."""
        sources, ended = self._sources, self._pipeline.ended
        yield from (f"{plugin}: {why}" for plugin, why in ended.items())
        for name, generator in self._pipeline.generators.items():
            if f"generators.{name}" in ended:
                continue
            given = self._pipeline.given[name]
            is_evidence = HypothesisKind.REGULAR in generator.sources.values()
            if self.steps and given and is_evidence and not self._looked(generator):
                waits = self._pipeline.waits_for(name)
                why = f": {waits}" if waits else ""
                yield f"generators.{name}: it gave no cloud for any of its {given} readings{why}"
        refused = dict(self.refused())
        for name, source in sources.items():
            if f"generators.{name.partition('/')[0]}" in ended:
                continue
            came = source.accepted + source.late + source.invalid
            if name in refused:
                yield refused[name]
            elif 2 * source.invalid > came:
                why = self._why(EventKind.REFUSED, name)
                yield f"{source.invalid} of {came} clouds of '{name}' were refused: {why}"
            elif source.early and not source.accepted:
                yield f"no cloud of '{name}' was accepted: {self._why(EventKind.EARLY, name)}"

    def refused(self) -> Iterator[tuple[str, str]]:
        """Each source of which every cloud was refused, and a sentence on why."""
        for name, source in self._sources.items():
            if source.invalid == source.accepted + source.late + source.invalid > 0:
                why = self._why(EventKind.REFUSED, name)
                yield name, f"every cloud of '{name}' was refused: {why}"

    def _looked(self, generator: AnyGenerator) -> int:
        """How many clouds the busiest source of a generator gave, of use or not."""
        reports = (s for name, s in self._sources.items() if name in generator.sources)
        return max((s.accepted + s.late + s.early + s.invalid for s in reports), default=0)

    def _why(self, kind: EventKind, source: str) -> str:
        return self._first_events[kind, source][1]

    @property
    def _sources(self) -> Mapping[str, SourceReport]:
        return self.last_step.fusion.report.sources if self.last_step else {}


def _force(contact: Contact) -> str:
    """The force on the robot, as the end of a sentence; nothing where none was felt."""
    if np.isnan(contact.force).any():
        return ""
    x, y, z = np.round(contact.force, 1) + 0.0  # no -0
    return f", force ({x:.1f}, {y:.1f}, {z:.1f}) N"


def lacks_evidence(pipeline: Pipeline) -> bool:
    """Whether a pipeline has generators, and none of their sources is evidence."""
    kinds = {kind for each in pipeline.generators.values() for kind in each.sources.values()}
    return bool(kinds) and HypothesisKind.REGULAR not in kinds


def refused_at_once(pipeline: Pipeline, readings: Iterable[Reading]) -> Iterator[str]:
    """Play the first readings, without a command: some faults show only there.

    Yields:
        A sentence for each source of which every cloud was refused, unless it lacks a transform,
        which may come.

    Raises:
        ConfigurationError: the pipeline does not fit the readings.
    """
    pipeline.reset()
    summary = Summary(pipeline)
    for _ in play(pipeline, islice(readings, TRIED), [summary.observer]):
        pass
    for name, why in summary.refused():
        if not pipeline.unplaced[name.partition("/")[0]]:
            yield why


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
