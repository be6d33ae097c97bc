"""Contacts over time: identity, belief carried from step to step, and what happens to them."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from contactfusion.arrays import FloatArray, frozen
from contactfusion.contacts import Contact
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.association import NEAR, paired
from contactfusion.integrator.entries import Entries, Member
from contactfusion.integrator.kernels import EDGE
from contactfusion.surface import Anchor, Surface
from contactfusion.time import NANOSECONDS_PER_SECOND, to_seconds

SLIDING = 0.2
"""Contacts slide no faster [m/s]: since the last news one may be found so much further."""
SMOOTHING = 0.2
"""Time over which the position of a contact at rest is averaged, and what was said fades [s]."""
POSSIBLE = 0.01
"""A contact that is less probable is forgotten."""
MISSED = 0.1
"""The probability, at least, that a source misses in a step what it found before."""
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

    def __str__(self) -> str:
        """When, which number, what happened, and the contact, in one line."""
        return f"{self.stamp:.3f} s: track {self.contact.track} {self.change}, {self.contact}"


@dataclass(slots=True, eq=False)
class Track:
    """A contact that is followed.

    Attributes:
        contact: as it was last found, where it is now.
        probability: that it exists; time alone makes it no more probable.
        believed: that it existed when there last was news of it, be it that it was missed.
        believed_at: then [ns].
        anchor: what its position moves with.
        averaged: number of steps of which its position is the mean.
        given: the highest probability of a contact by each of its sources of late.
        heard: the newest stamp at which each of these reported it, or missed it [ns].
        denied: those of sources that took back what they said, which others stand by.
        is_missed: whether they missed it since they reported it.
        found: where they did, shape (3,) [m], in the frame of contacts.
        found_at: when that was last said [ns].
        settled: where it was made or last moved to, as `anchor`.
        settled_at: its position then, shape (3,) [m], for surfaces that do not keep their parts.
    """

    contact: Contact
    probability: float
    believed: float
    believed_at: int
    anchor: Anchor
    averaged: float
    given: Mapping[str, float]
    heard: Mapping[str, int]
    denied: Mapping[str, float]
    is_missed: bool
    found: FloatArray
    found_at: int
    settled: Anchor
    settled_at: FloatArray

    @property
    def is_made(self) -> bool:
        """Whether it has been probable enough."""
        return self.contact.track > 0


class Step(NamedTuple):
    """When contacts are followed, and which sources of evidence can detect them then.

    Attributes:
        now: [ns].
        looks: the newest stamp at which each source measured [ns].
        able: those that could no longer ago than their entries live.
    """

    now: int
    looks: Mapping[str, int]
    able: frozenset[str]

    @staticmethod
    def of(entries: Entries) -> "Step":
        """The step of some entries."""
        sources = [each for each in entries.sources if each.kind == HypothesisKind.REGULAR]
        looks = {each.name: each.looked for each in sources if each.looked is not None}
        able = frozenset(each.name for each in sources if each.tells)
        return Step(entries.now, looks, able)

    def spoke(self, heard: Mapping[str, int]) -> list[str]:
        """The sources that measured after stamps [ns] of their detections."""
        return [name for name, stamp in heard.items() if self.looks.get(name, NEVER) > stamp]


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
        """As `Step.looks`, of the step before."""
        self._made = 0

    def follow(
        self, entries: Entries, members: Sequence[Member], surface: Surface | None
    ) -> tuple[tuple[Contact, ...], tuple[ContactEvent, ...]]:
        """The contacts of a step, the most probable first, and what happened to them.

        Args:
            entries: all live entries.
            members: what the evidence among them says now.
            surface: of the robot now, or None.
        """
        step = Step.of(entries)
        heard = [_heard(member, entries, step.looks) for member in members]
        for track in self._tracks:
            contact = track.contact
            place = _followed(track.anchor, surface, contact.position)
            track.contact = _moved_to(contact, place)
            track.probability = min(self._later(track, step.now), track.believed)
        pairs = paired(
            [_expected(track, step) for track in self._tracks],
            [member.contact for member in members],
            [SLIDING * _seconds(step.now - self._still_at(track)) for track in self._tracks],
            [not step.spoke(track.heard) for track in self._tracks],
            [bool(self._news(stamps)) for stamps in heard],
        )
        for number, track in enumerate(self._tracks):
            if number in pairs:
                row = pairs[number]
                self._confirm(track, members[row], heard[row], step)
            else:
                self._miss(track, step)
        new = sorted(set(range(len(members))) - set(pairs.values()))
        found = [self._tracks[number] for number in pairs]
        found += [self._begun(members[row], heard[row], step) for row in new]
        self._tracks += found[len(pairs) :]
        events = [
            event for track in self._tracks for event in self._events(track, step.now, surface)
        ]
        live = {id(track) for track in found}
        self._tracks = [
            track
            for track in self._tracks
            if id(track) in live or track.is_made or track.probability >= POSSIBLE
        ]
        self._looked = step.looks
        reported = [track.contact for track in self._tracks if self._is_reported(track)]
        reported.sort(key=lambda contact: (-round(contact.likelihood, 6), contact.track))
        return tuple(reported), tuple(events)

    def _after(self, probability: float, elapsed: int) -> float:
        """The probability of a contact some time [ns] later, if nothing is heard of it."""
        changed = EVEN * -np.expm1(-2.0 * self._rate * _seconds(elapsed))
        return float(probability * (1.0 - changed) + (1.0 - probability) * changed)

    def _later(self, track: Track, now: int) -> float:
        """The probability of a contact before what is said of it now."""
        return self._after(track.believed, now - track.believed_at)

    def _still_at(self, track: Track) -> int:
        """Since when a contact may have slid [ns]: there it was found, or said to be still."""
        if track.is_missed:
            return track.found_at
        return max(track.found_at, *(self._looked.get(name, NEVER) for name in track.heard))

    def _news(self, heard: Mapping[str, int]) -> list[str]:
        """The sources of a contact with a detection after the step before."""
        return [name for name, stamp in heard.items() if stamp > self._looked.get(name, NEVER)]

    def _begun(self, member: Member, heard: Mapping[str, int], step: Step) -> Track:
        """A contact that was not there when its sources looked before."""
        news = self._news(heard)
        since = [step.looks[name] - self._looked[name] for name in news if name in self._looked]
        if not news:  # its sources said it before, of another contact
            since = [0]
        prior = self._after(0.0, min(since)) if since else EVEN
        probability = _updated(prior, _odds(member.contact.likelihood))
        place = member.contact.position
        here = Anchor(None, place)
        return Track(
            contact=member.contact,
            probability=probability,
            believed=probability,
            believed_at=step.now,
            anchor=here,
            averaged=1.0,
            given=member.given,
            heard=heard,
            denied={},
            is_missed=False,
            found=place,
            found_at=step.now,
            settled=here,
            settled_at=place,
        )

    def _confirm(self, track: Track, member: Member, heard: Mapping[str, int], step: Step) -> None:
        """Take what is said of a contact now; only what is new makes it more probable or less."""
        there = heard.keys() | member.covered_by
        gone = {name: stamp for name, stamp in track.heard.items() if name not in there}
        new, withdrawn, dead = self._news(heard), step.spoke(gone), gone.keys() - step.able
        if not (new or withdrawn or dead):
            return
        prior, factor = track.probability, 1.0
        if new:
            factor = self._likelihood_ratio(member, heard, new, step)
            if factor > 1.0 or len(new) == len(heard):
                prior = self._later(track, step.now)
        elif withdrawn:
            factor = self._missed(track, withdrawn)
        if max((track.given[name] for name in dead), default=0.0) > max(member.given.values()):
            prior = min(prior, member.contact.likelihood)  # what was believed has died with them
        self._believe(track, _updated(prior, factor), step.now)
        self._hear(track, member, heard, withdrawn, dead, step)
        before, found = track.contact, member.contact
        kept = replace(found, track=before.track, since=before.since)
        place = before.position
        if new:
            away = found.position - place
            track.averaged *= _faded(step.now - track.found_at)
            if _squared(away) > found.covariance.trace() / 3.0:  # it has moved on
                track.averaged = 0.0
            track.averaged += 1.0
            place, track.found_at = frozen(place + away / track.averaged), step.now
        track.contact = _moved_to(kept, place)
        track.is_missed, track.found = False, found.position

    def _likelihood_ratio(
        self, member: Member, heard: Mapping[str, int], new: Sequence[str], step: Step
    ) -> float:
        """The factor on the odds of a contact by those of its sources with a new detection.

        Where others stand by what they said, it takes nothing from that to be less sure. They share
        the odds of all that each said once in turn. Resultants that speak for it count once; what
        speaks against it lives as long as its source's entries, as null does.
        """
        factor = _odds(member.contact.likelihood)
        if len(new) < len(heard):
            last = max(self._looked.get(name, NEVER) for name in new)
            turn = [name for name, stamp in heard.items() if name in new or stamp >= last]
            doubts = {name: math.log1p(-given) for name, given in member.given.items()}
            share = sum(doubts[name] for name in new) / sum(doubts[name] for name in turn)
            alone, together = (
                _odds(_by_any(member.given[name] for name in names)) for names in (new, turn)
            )
            ratio = max(alone, together**share, 1.0)
            factor *= ratio / _odds(_by_any(member.given.values()))
        for name, each in member.factors.items():
            if each > 1.0 and name in step.looks and step.looks[name] == self._looked.get(name):
                factor /= each
        return factor

    def _hear(
        self,
        track: Track,
        member: Member,
        heard: Mapping[str, int],
        withdrawn: Sequence[str],
        dead: Set[str],
        step: Step,
    ) -> None:
        """Keep which sources detect a contact, how surely, and which withdrew their detection."""
        ended = heard.keys() | dead | {*withdrawn}
        stand = [name for name in track.heard if name not in ended]  # in order: bytes hang on it
        faded = _faded(step.now - track.found_at)
        given = {name: track.given[name] for name in stand}
        for name, now in member.given.items():
            given[name] = now + max(track.given.get(name, 0.0) - now, 0.0) * faded
        denied = {**track.denied, **{name: track.given[name] for name in withdrawn}}
        track.denied = {name: given for name, given in denied.items() if name not in heard}
        track.heard = {**{name: track.heard[name] for name in stand}, **heard}
        track.given = given

    def _miss(self, track: Track, step: Step) -> None:
        """Take it that nothing is said of a contact now."""
        if spoke := step.spoke(track.heard):
            self._believe(track, _updated(track.probability, self._missed(track, spoke)), step.now)
            track.given = {**track.denied, **track.given}
            track.heard = {
                name: step.looks.get(name, track.heard.get(name, NEVER)) for name in track.given
            }
            track.denied, track.is_missed = {}, True
        elif step.able.isdisjoint(track.heard):  # what was said of it is too old to live
            self._believe(track, 0.0, step.now)

    def _believe(self, track: Track, probability: float, now: int) -> None:
        track.probability = track.believed = probability
        track.believed_at = now

    def _missed(self, track: Track, names: Sequence[str]) -> float:
        """The probability that sources do not find what they found before."""
        return math.prod(max(1.0 - track.given[name], MISSED) for name in names)

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


def _expected(track: Track, step: Step) -> Contact:
    """A contact where it is found if its sources have said nothing new: they do not follow."""
    if step.spoke(track.heard):
        return track.contact
    return replace(track.contact, position=track.found)


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


def _faded(elapsed: int) -> float:
    """What is left of the past after a time [ns]."""
    return math.exp(-_seconds(elapsed) / SMOOTHING)


def _seconds(time: int) -> float:
    """A time in ns, in s."""
    return time / NANOSECONDS_PER_SECOND


def _by_any(given: Iterable[float]) -> float:
    """The probability of a contact by any of some sources."""
    return 1.0 - math.prod(1.0 - each for each in given)


def _odds(probability: float) -> float:
    return probability / max(1.0 - probability, EDGE)


def _updated(prior: float, factor: float) -> float:
    """The probability after its odds are multiplied by a factor."""
    kept = prior * factor
    return kept / (1.0 - prior + kept)
