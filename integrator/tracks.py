"""Contacts over time: identity, belief carried from step to step, and what happens to them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from contactfusion.arrays import FloatArray, frozen
from contactfusion.contacts import Contact
from contactfusion.integrator.entries import Entries, Member
from contactfusion.integrator.kernels import EDGE
from contactfusion.surface import Anchor, Surface
from contactfusion.time import NANOSECONDS_PER_SECOND, to_seconds

NEAR = 3.0
"""A contact is the same as an earlier one within so many standard deviations of both."""
SLIDING = 0.2
"""Contacts slide no faster [m/s]: between steps one may be found so much further."""
SMOOTHING = 0.2
"""Time over which the position of a contact at rest is averaged [s]."""
POSSIBLE = 0.01
"""A contact that is less probable is forgotten."""
MISSED = 0.1
"""The probability, at least, that a source misses in a step what it found in the one before."""
EVEN = 0.5
"""The probability of a contact of which nothing is known."""
NEVER = -(2**63)
"""Before every stamp."""


class Change(StrEnum):
    """What happens to a contact."""

    MADE = "made"
    MOVED = "moved"
    BROKEN = "broken"


@dataclass(frozen=True, slots=True, eq=False)
class ContactEvent:
    """What happened to a contact in a step.

    Attributes:
        change: what happened.
        contact: the contact after it; of a broken contact as it last was.
        stamp: of the step [s].
    """

    change: Change
    contact: Contact
    stamp: float


@dataclass(slots=True, eq=False)
class Track:
    """A contact that is followed.

    Attributes:
        contact: as it was last found, where it is now.
        probability: that it exists.
        anchor: what its position moves with.
        averaged: number of steps of which its position is the mean.
        given: the probability of a contact by each of its sources.
        heard: the newest stamp at which each of these reported it [ns].
        found: where they did, shape (3,) [m], in the frame of contacts.
        settled: where it was made or last moved to, as `anchor`.
        settled_at: its position then, shape (3,) [m], for surfaces that do not keep their parts.
    """

    contact: Contact
    probability: float
    anchor: Anchor
    averaged: float
    given: Mapping[str, float]
    heard: Mapping[str, int]
    found: FloatArray
    settled: Anchor
    settled_at: FloatArray

    @property
    def is_made(self) -> bool:
        """Whether it has been probable enough."""
        return self.contact.track > 0


class Tracks:
    """The contacts of successive steps (method §3).

    Each is an on-off process: contacts are made and broken `rate` times a second. What is new in a
    step multiplies the odds by those of the evidence, and a source that no longer says what it said
    takes it back. So one wrong step neither makes nor breaks a contact.

    Args:
        rate: [1/s].
        existence: the probability from which a contact is reported.
    """

    def __init__(self, rate: float, existence: float) -> None:
        self._rate, self.existence = rate, existence
        self.clear()

    def clear(self) -> None:
        """Forget all contacts; the next is the first again."""
        self._tracks: list[Track] = []
        self._looked: Mapping[str, int] = {}
        self._now: int | None = None
        self._made = 0

    def follow(
        self,
        entries: Entries,
        members: Sequence[Member],
        looks: Mapping[str, int],
        surface: Surface | None,
    ) -> tuple[tuple[Contact, ...], tuple[ContactEvent, ...]]:
        """The contacts of a step, the most probable first, and what happened to them.

        Args:
            entries: all live entries.
            members: what the evidence among them says now.
            looks: the newest stamp at which each source of evidence could tell [ns].
            surface: of the robot now, or None.
        """
        now = entries.now
        elapsed = 0 if self._now is None else now - self._now
        heard = [_heard(member, entries, looks) for member in members]
        slid = SLIDING * elapsed / NANOSECONDS_PER_SECOND
        for track in self._tracks:
            contact = track.contact
            place = _followed(track.anchor, surface, contact.position)
            track.contact = _moved_to(contact, place)
        pairs = paired(
            [self._expected(track, looks) for track in self._tracks],
            [member.contact for member in members],
            slid,
        )
        for number, track in enumerate(self._tracks):
            later = self._after(track.probability, elapsed)
            if number in pairs:
                track.probability = later
                row = pairs[number]
                self._confirm(track, members[row], heard[row], looks, elapsed)
            else:  # nothing is made where nothing is found
                track.probability = later if track.is_made else min(later, track.probability)
                self._miss(track, looks)
        new = sorted(set(range(len(members))) - set(pairs.values()))
        found = [self._tracks[number] for number in pairs]
        found += [self._begun(members[row], heard[row], looks) for row in new]
        self._tracks += found[len(pairs) :]
        events = [event for track in self._tracks for event in self._events(track, now, surface)]
        live = {id(track) for track in found}
        self._tracks = [
            track
            for track in self._tracks
            if id(track) in live or track.is_made or track.probability >= POSSIBLE
        ]
        self._looked, self._now = dict(looks), now
        reported = [track.contact for track in self._tracks if self._is_reported(track)]
        reported.sort(key=lambda contact: (-round(contact.likelihood, 6), contact.track))
        return tuple(reported), tuple(events)

    def _after(self, probability: float, elapsed: int) -> float:
        """The probability of a contact some time [ns] later, if nothing is heard of it."""
        seconds = elapsed / NANOSECONDS_PER_SECOND
        changed = EVEN * -np.expm1(-2.0 * self._rate * seconds)
        return float(probability * (1.0 - changed) + (1.0 - probability) * changed)

    def _begun(self, member: Member, heard: Mapping[str, int], looks: Mapping[str, int]) -> Track:
        """A contact that was not there when its sources looked before."""
        since = [
            looks[name] - self._looked[name]
            for name in member.given
            if name in self._looked and looks[name] > self._looked[name]
        ]
        prior = self._after(0.0, min(since)) if since else EVEN
        probability = _updated(prior, _odds(member.contact.likelihood))
        place = member.contact.position
        here = Anchor(None, place)
        given = member.contact, probability, here, 1.0, member.given, heard
        return Track(*given, found=place, settled=here, settled_at=place)

    def _expected(self, track: Track, looks: Mapping[str, int]) -> Contact:
        """A contact where it is found if its sources have said nothing new: they do not follow."""
        if any(looks.get(name, NEVER) > stamp for name, stamp in track.heard.items()):
            return track.contact
        return replace(track.contact, position=track.found)

    def _confirm(
        self,
        track: Track,
        member: Member,
        heard: Mapping[str, int],
        looks: Mapping[str, int],
        elapsed: int,
    ) -> None:
        """Take what is said of a contact now; only what is new makes it more probable or less."""
        withdrawn = [
            name
            for name, stamp in track.heard.items()
            if name not in heard and looks.get(name, NEVER) > stamp
        ]
        if any(stamp > track.heard.get(name, NEVER) for name, stamp in heard.items()):
            factor = _odds(member.contact.likelihood)
        elif withdrawn:
            factor = self._missed(track, withdrawn)
        else:
            return
        track.probability = _updated(track.probability, factor)
        before, found = track.contact, member.contact
        away = found.position - before.position
        track.averaged *= float(np.exp(-elapsed / NANOSECONDS_PER_SECOND / SMOOTHING))
        if _squared(away) > found.covariance.trace() / 3.0:  # it has moved on
            track.averaged = 0.0
        track.averaged += 1.0
        place = frozen(before.position + away / track.averaged)
        kept = replace(found, track=before.track, since=before.since)
        track.contact = _moved_to(kept, place)
        track.given, track.heard, track.found = member.given, heard, found.position

    def _miss(self, track: Track, looks: Mapping[str, int]) -> None:
        """Take it that nothing is said of a contact now."""
        spoke = [name for name, stamp in track.heard.items() if looks.get(name, NEVER) > stamp]
        if not spoke:  # what was said of it is too old to live
            track.probability = 0.0
            return
        track.probability = _updated(track.probability, self._missed(track, spoke))
        track.heard = {name: looks.get(name, stamp) for name, stamp in track.heard.items()}

    def _missed(self, track: Track, names: Sequence[str]) -> float:
        """The probability that sources do not find what they found in the step before."""
        return float(np.prod([max(1.0 - track.given[name], MISSED) for name in names]))

    def _is_reported(self, track: Track) -> bool:
        return track.probability >= self.existence - EDGE

    def _events(self, track: Track, now: int, surface: Surface | None) -> Iterator[ContactEvent]:
        """What happened to a contact; brings its probability, number and anchor up to date."""
        stamp, contact = to_seconds(now), replace(track.contact, likelihood=track.probability)
        position = contact.position
        track.anchor = surface.anchor(position) if surface else Anchor(None, position)
        if not self._is_reported(track):
            if track.is_made:
                yield ContactEvent(Change.BROKEN, contact, stamp)
            track.contact = replace(contact, track=0, since=np.nan)
            return
        unsure = contact.covariance.trace() / 3.0
        away = position - _followed(track.settled, surface, track.settled_at)
        if not track.is_made:
            self._made += 1
            contact = replace(contact, track=self._made, since=stamp)
            track.settled, track.settled_at = track.anchor, position
            yield ContactEvent(Change.MADE, contact, stamp)
        elif _squared(away) > NEAR**2 * unsure:
            track.settled, track.settled_at = track.anchor, position
            yield ContactEvent(Change.MOVED, contact, stamp)
        track.contact = contact


def _heard(member: Member, entries: Entries, looks: Mapping[str, int]) -> dict[str, int]:
    """The newest stamp at which each source of a contact reported it [ns].

    A source whose clouds do not replace each other may have reported other places since.
    """
    newest = entries.newest(member.explains)
    return {name: newest.get(name, looks[name]) for name in member.given}


def paired(before: Sequence[Contact], now: Sequence[Contact], slid: float = 0.0) -> dict[int, int]:
    """Which contacts, as rows, are the same, the nearest first.

    What probably exists is paired first, and what is reported before what is not.

    Args:
        before: contacts.
        now: those of a step.
        slid: how far one may have slid meanwhile [m].
    """
    if not before or not now:
        return {}
    (where, wide), (there, wider) = (
        (
            np.array([contact.position for contact in contacts]),
            np.array([contact.covariance + contact.scatter for contact in contacts]),
        )
        for contacts in (before, now)
    )
    squared = ((where[:, None] - there) ** 2).sum(axis=2)
    traces = np.trace(wide, axis1=1, axis2=2)[:, None] + np.trace(wider, axis1=1, axis2=2)
    most = (NEAR * np.sqrt(traces) + slid) ** 2
    rows, columns = np.nonzero(squared <= most)  # no width is larger than the trace
    widths = np.linalg.eigvalsh(wide[rows] + wider[columns])[:, -1]
    away = squared[rows, columns] / (NEAR * np.sqrt(widths) + slid) ** 2
    found = sorted(
        (now[column].likelihood < EVEN, before[row].track == 0, part, row, column)
        for part, row, column in zip(away.tolist(), rows.tolist(), columns.tolist(), strict=True)
    )
    pairs: dict[int, int] = {}
    taken = set[int]()
    for _, _, part, row, column in found:
        if part <= 1.0 and row not in pairs and column not in taken:
            pairs[row] = column
            taken.add(column)
    return pairs


def _followed(anchor: Anchor, surface: Surface | None, otherwise: FloatArray) -> FloatArray:
    """Where an anchored point is now, shape (3,) [m]; where nothing tells, another."""
    if surface is None:
        return anchor.point if anchor.part is None else otherwise
    place = surface.follow(anchor)
    return otherwise if place is None else place


def _moved_to(contact: Contact, position: FloatArray) -> Contact:
    """A contact at another position, its extent with it."""
    if contact.position is position:
        return contact
    extent = frozen(contact.extent + (position - contact.position))
    return replace(contact, position=position, extent=extent)


def _squared(offset: FloatArray) -> float:
    return float(offset @ offset)


def _odds(probability: float) -> float:
    return probability / max(1.0 - probability, EDGE)


def _updated(prior: float, factor: float) -> float:
    """The probability after its odds are multiplied by a factor."""
    kept = prior * factor
    return kept / (1.0 - prior + kept)
