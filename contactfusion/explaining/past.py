"""What was lately: who said what where, which contacts have died, what happened to sources."""

import itertools
from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.fusion import Fusion
from contactfusion.integrator.sources import Event, EventKind
from contactfusion.integrator.store import Int64Array, unpack

SAME = 1e-9
"""Distances that differ by less are equal [m]."""
SECONDS = 3.0
"""What lies further back is forgotten [s]."""
MOST_ROWS, MOST_CONTACTS, MOST_EVENTS = 1_000_000, 500, 1000
"""More hypotheses, contacts and events are not remembered: the oldest are forgotten first."""
EVER = -(1 << 62)
"""A stamp before all others [ns]."""
TOLD = (EventKind.LATE, EventKind.REFUSED, EventKind.EARLY, EventKind.OVERRUN)


@dataclass(frozen=True, slots=True)
class Told:
    """New hypotheses of one source: places, shape (n, 3) [m], likelihoods, stamps [ns]."""

    source: str
    places: FloatArray
    likelihoods: FloatArray
    stamps: Int64Array


@dataclass(frozen=True, slots=True)
class Dead:
    """A contact that is no more, and the time of the last step that told it [s]."""

    contact: Contact
    stamp: float


class Past:
    """Remembers some seconds of steps; however long a recording is, its memory is bounded.

    Args:
        reach: contacts of two steps that lie so near together are one [m].
        seconds: how far back it remembers [s].
    """

    def __init__(self, reach: float, seconds: float = SECONDS) -> None:
        self._reach, self._seconds = reach, seconds
        self._told: deque[Told] = deque()
        self._rows = 0
        self._newest: dict[str, int] = {}
        self._contacts: list[Dead] = []
        self._events: deque[tuple[float, Event]] = deque(maxlen=MOST_EVENTS)

    def add(self, stamp: float, fusion: Fusion) -> None:
        """Remember a step at a time [s]; steps come in order."""
        entries = fusion.field.entries
        for source, (begin, end) in zip(
            entries.sources, itertools.pairwise(entries.begin.tolist()), strict=True
        ):
            if source.kind == HypothesisKind.NULL or end == begin:
                continue
            stamps = entries.columns.stamps[begin:end]
            new = stamps > self._newest.get(source.name, EVER)
            if new.any():
                places = entries.grid.centres(unpack(entries.columns.keys[begin:end][new]))
                likelihoods = entries.columns.likelihoods[begin:end][new].astype(np.float64)
                self._told.append(Told(source.name, places, likelihoods, stamps[new]))
                self._rows += len(places)
                self._newest[source.name] = int(stamps.max())
        self._link(stamp, fusion)
        self._events.extend((stamp, event) for event in fusion.report.events)
        self._forget(stamp)

    def last_told(self, source: str, place: FloatArray, reach: float) -> tuple[float, float] | None:
        """Give the likelihood and the stamp [s] of what a source last said near a place.

        Args:
            source: its name.
            place: shape (3,) [m].
            reach: how near [m].
        """
        for one in reversed(self._told):
            if one.source == source:
                near = ((one.places - place) ** 2).sum(axis=1) <= reach**2
                if near.any():
                    row = np.flatnonzero(near)[one.likelihoods[near].argmax()]
                    return float(one.likelihoods[row]), float(one.stamps[row]) / 1e9
        return None

    def dead(self, stamp: float) -> list[Dead]:
        """Give the contacts that are no more at a time [s], the newest first."""
        dead = [one for one in self._contacts if one.stamp < stamp]
        return sorted(dead, key=lambda one: -one.stamp)

    def events(self, source: str) -> list[tuple[float, Event]]:
        """Give what went wrong with the clouds of a source, with the time of each [s]."""
        return [
            (stamp, event)
            for stamp, event in self._events
            if event.source == source and event.kind in TOLD
        ]

    def _link(self, stamp: float, fusion: Fusion) -> None:
        """Forget contacts that live on in those of this step, and remember these."""
        now = [Dead(contact, stamp) for contact in fusion.contacts[:MOST_CONTACTS]]
        gone = self._contacts
        if now and gone:
            away = cdist(_places(gone), _places(now)).min(axis=1)
            gone = [one for one, far in zip(gone, away, strict=True) if far > self._reach + SAME]
        self._contacts = (now + gone)[:MOST_CONTACTS]

    def _forget(self, stamp: float) -> None:
        oldest = stamp - self._seconds
        while self._told and (self._told[0].stamps.max() / 1e9 < oldest or self._rows > MOST_ROWS):
            self._rows -= len(self._told.popleft().places)
        while self._events and self._events[0][0] < oldest:
            self._events.popleft()
        self._contacts = [one for one in self._contacts if one.stamp >= oldest]


def _places(contacts: list[Dead]) -> FloatArray:
    return np.array([one.contact.position for one in contacts])
