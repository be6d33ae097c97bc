"""The step at a time, and its past: hypotheses, contacts that died, troubles of sources."""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE, Contact
from contactfusion.errors import PluginError, TimeError
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.sources import Event, EventKind
from contactfusion.integrator.store import Int64Array, unpack
from contactfusion.pipeline import Pipeline, Step

SAME = 1e-9
"""Distances that differ by less are equal [m]."""
SECONDS = 3.0
"""Length of the past that is kept [s]."""
MOST_ROWS, MOST_CONTACTS, MOST_EVENTS = 1_000_000, 500, 1000
"""More hypotheses, contacts and events are not remembered: the oldest are forgotten first."""
EVER = -(1 << 62)
"""A stamp before all others [ns]."""
TROUBLES = (EventKind.LATE, EventKind.REFUSED, EventKind.EARLY, EventKind.OVERRUN)
CLOSE = 1e-6
"""Stamps that differ by less are equal [s]."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of the integrator and of the sources.

    Attributes:
        integrator: its configuration.
        own_timeouts: lifetime of a source's hypotheses [s], by name, where its options set one.
    """

    integrator: IntegratorConfig
    own_timeouts: Mapping[str, float]

    @classmethod
    def of(cls, pipeline: Pipeline) -> Self:
        """Those of a pipeline."""
        own = {
            source: generator.config.timeout
            for generator in pipeline.generators.values()
            for source in generator.sources
            if generator.config.timeout is not None
        }
        config = pipeline.config.integrator
        return cls(config, {} if config.expiry == "voxel" else own)

    def timeout(self, source: str) -> float:
        """Lifetime of the hypotheses of a source [s]."""
        return self.own_timeouts.get(source, self.integrator.timeout)

    @property
    def tolerance(self) -> float:
        """Linking distance [m]."""
        return self.integrator.linking_distance


@dataclass(frozen=True, slots=True)
class Reported:
    """New hypotheses of one source: places, shape (n, 3) [m], likelihoods, stamps [ns]."""

    source: str
    places: FloatArray
    likelihoods: FloatArray
    stamps: Int64Array


@dataclass(frozen=True, slots=True)
class Dead:
    """A contact that is no more, and the time of the last step that had it [s]."""

    contact: Contact
    stamp: float


class Past:
    """Buffer of the last seconds of steps, in bounded memory.

    Args:
        reach: the greatest distance between the same contact in two steps [m], unless its track
            tells that it is the same.
        seconds: length of the buffer [s].
    """

    def __init__(self, reach: float, seconds: float = SECONDS) -> None:
        self._reach, self._seconds = reach, seconds
        self._reported: deque[Reported] = deque()
        self._rows = 0
        self._newest: dict[str, int] = {}
        self._contacts: list[Dead] = []
        self._events: deque[tuple[float, Event]] = deque(maxlen=MOST_EVENTS)

    def add(self, stamp: float, fusion: Fusion) -> None:
        """Store a step at a time [s]; steps come in order."""
        entries = fusion.field.entries
        for source, own in entries.by_source:
            if source.kind == HypothesisKind.NULL or own.stop == own.start:
                continue
            stamps = entries.columns.stamps[own]
            new = stamps > self._newest.get(source.name, EVER)
            if new.any():
                places = entries.grid.centres(unpack(entries.columns.keys[own][new]))
                likelihoods = entries.columns.likelihoods[own][new].astype(np.float64)
                self._reported.append(Reported(source.name, places, likelihoods, stamps[new]))
                self._rows += len(places)
                self._newest[source.name] = int(stamps.max())
        self._link(stamp, fusion)
        self._events.extend((stamp, event) for event in fusion.report.events)
        self._forget(stamp)

    def last_reported(
        self, source: str, place: FloatArray, reach: float
    ) -> tuple[float, float] | None:
        """The likelihood and the stamp [s] of a source's last hypothesis near a place.

        Args:
            source: its name.
            place: shape (3,) [m].
            reach: the greatest distance [m].
        """
        for new in reversed(self._reported):
            if new.source == source:
                near = ((new.places - place) ** 2).sum(axis=1) <= reach**2
                if near.any():
                    row = np.flatnonzero(near)[new.likelihoods[near].argmax()]
                    return float(new.likelihoods[row]), float(new.stamps[row]) / 1e9
        return None

    def dead(self, stamp: float) -> list[Dead]:
        """The contacts that are no more at a time [s], the newest first."""
        dead = [contact for contact in self._contacts if contact.stamp < stamp]
        return sorted(dead, key=lambda contact: -contact.stamp)

    def events(self, source: str) -> list[tuple[float, Event]]:
        """The troubles with clouds of a source, with the time of each [s]."""
        return [
            (stamp, event)
            for stamp, event in self._events
            if event.source == source and event.kind in TROUBLES
        ]

    def _link(self, stamp: float, fusion: Fusion) -> None:
        """Replace contacts by those of this step that are the same, and add the new ones.

        The same have the same track, wherever they are, or lie within `reach`.
        """
        now = [Dead(contact, stamp) for contact in fusion.contacts[:MOST_CONTACTS]]
        gone = self._contacts
        if now and gone:
            away = cdist(_places(gone), _places(now)).min(axis=1)
            tracks = {new.contact.track for new in now} - {0}
            gone = [
                old
                for old, far in zip(gone, away, strict=True)
                if far > self._reach + SAME and old.contact.track not in tracks
            ]
        self._contacts = (now + gone)[:MOST_CONTACTS]

    def _forget(self, stamp: float) -> None:
        oldest = stamp - self._seconds
        while self._reported and (
            self._reported[0].stamps.max() / 1e9 < oldest or self._rows > MOST_ROWS
        ):
            self._rows -= len(self._reported.popleft().places)
        while self._events and self._events[0][0] < oldest:
            self._events.popleft()
        self._contacts = [held for held in self._contacts if held.stamp >= oldest]


def _places(contacts: list[Dead]) -> FloatArray:
    return np.array([dead.contact.position for dead in contacts])


@dataclass(frozen=True, slots=True)
class Moment:
    """A step, and the seconds before it, itself included."""

    step: Step
    past: Past


def moment_at(steps: Iterable[Step], time: float, reach: float, seconds: float = SECONDS) -> Moment:
    """The last step until a time; no step after it is asked for more than once.

    Args:
        steps: in order.
        time: [s].
        reach: the greatest distance between the same contact in two steps [m].
        seconds: length of the past that is kept [s].

    Raises:
        TimeError: the time lies outside the steps, or there are none.
    """
    past, last, first = Past(reach, seconds), None, None
    for step in steps:
        first = step if first is None else first
        if step.stamp > time + CLOSE:
            break
        past.add(step.stamp, step.fusion)
        last = step
    else:
        if first is None or last is None:
            raise TimeError("the recording leads to no step, so there is nothing to explain")
        if not time <= last.stamp + CLOSE:
            raise TimeError(
                f"there is nothing at {time:.9g} s: the steps reach from {first.stamp:.9g} s "
                f"to {last.stamp:.9g} s"
            )
    if last is None:
        raise TimeError(
            f"there is nothing at {time:.9g} s: the first step comes at {first.stamp:.9g} s"
        )
    return Moment(last, past)


@dataclass(frozen=True)
class View:
    """A step, its past, and the settings of its pipeline."""

    moment: Moment
    settings: Settings

    @property
    def stamp(self) -> float:
        """The time of the step [s]."""
        return self.moment.step.stamp

    @property
    def fusion(self) -> Fusion:
        """The fusion of the step."""
        return self.moment.step.fusion

    @property
    def past(self) -> Past:
        """The past, the step included."""
        return self.moment.past

    @cached_property
    def centres(self) -> FloatArray:
        """The centres of all voxels, shape (m, 3) [m]."""
        entries = self.fusion.field.entries
        return entries.grid.centres(entries.voxels)

    @cached_property
    def owners(self) -> NDArray[np.intp]:
        """The contact that each voxel belongs to, a row of the contacts or `NONE`, shape (m,)."""
        return self._owned[0]

    @cached_property
    def explained(self) -> NDArray[np.intp]:
        """The contact that each entry speaks of, a row of the contacts or `NONE`, shape (n,).

        Contacts of a set explain evidence wherever it lies, others what lies in their voxels.
        """
        entries, found = self.fusion.field.entries, self.fusion.found
        rows = self.owners[entries.places]
        if self.fusion.condensation.needs_members:
            rows[np.repeat(entries.flags(HypothesisKind.REGULAR), np.diff(entries.begin))] = NONE
        for number, member in reversed(found.items()):
            rows[member.explains] = number
        return rows

    @property
    def trouble(self) -> str:
        """Why it is not known which voxels the contacts are made of; empty when it is."""
        return self._owned[1]

    @cached_property
    def _owned(self) -> tuple[NDArray[np.intp], str]:
        try:
            return self.fusion.owners, ""
        except PluginError as error:  # of a plug-in's condensation; the rest stands
            return np.full(len(self.centres), NONE, np.intp), str(error)
