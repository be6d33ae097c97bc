"""Contacts over time: identity, belief carried from step to step, and what happens to them."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from contactfusion.arrays import FloatArray, frozen
from contactfusion.contacts import Contact
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.entries import Entries, Member
from contactfusion.integrator.kernels import EDGE
from contactfusion.surface import Anchor, Surface
from contactfusion.time import NANOSECONDS_PER_SECOND, to_seconds

NEAR = 3.0
"""A contact is the same as an earlier one within so many standard deviations of both."""
SLIDING = 0.2
"""Contacts slide no faster [m/s]: since the last news one may be found so much further."""
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
        believed: that it existed when there last was news of it, be it that it was missed.
        believed_at: then [ns].
        anchor: what its position moves with.
        averaged: number of steps of which its position is the mean.
        given: the highest probability of a contact by each of its sources.
        heard: the newest stamp at which each of these reported it, or missed it [ns].
        is_missed: whether they missed it since they reported it.
        found: where they did, shape (3,) [m], in the frame of contacts.
        found_at: when that was news [ns].
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
    """When contacts are followed, and which sources of evidence can tell of them then.

    Attributes:
        now: [ns].
        looks: the newest stamp at which each source could tell [ns].
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
        """The sources that could tell after stamps [ns] at which they were heard."""
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
        self._before = Step(0, {}, frozenset())
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
            # time alone makes nothing
            track.probability = min(self._later(track, step.now), track.believed)
        pairs = paired(
            [_expected(track, step) for track in self._tracks],
            [member.contact for member in members],
            [SLIDING * _seconds(step.now - track.found_at) for track in self._tracks],
            [bool(step.spoke(self._looked_before(each))) for each in heard],
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
        self._before = step
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

    def _looked_before(self, names: Iterable[str]) -> dict[str, int]:
        """The newest stamp at which each of some sources could tell in the step before [ns]."""
        return {name: self._before.looks.get(name, NEVER) for name in names}

    def _begun(self, member: Member, heard: Mapping[str, int], step: Step) -> Track:
        """A contact that was not there when its sources looked before."""
        looked = [name for name in member.given if name in self._before.looks]
        since = [step.looks[name] - self._before.looks[name] for name in looked]
        since = [time for time in since if time > 0]
        if looked and not since:  # they said it before, of another
            since = [step.now - self._before.now]
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
            is_missed=False,
            found=place,
            found_at=step.now,
            settled=here,
            settled_at=place,
        )

    def _confirm(self, track: Track, member: Member, heard: Mapping[str, int], step: Step) -> None:
        """Take what is said of a contact now; only what is new makes it more probable or less."""
        gone = {name: stamp for name, stamp in track.heard.items() if name not in heard}
        new = [name for name, stamp in heard.items() if stamp > track.heard.get(name, NEVER)]
        prior, factor, withdrawn = track.probability, 1.0, step.spoke(gone)
        if new:
            prior, factor = self._later(track, step.now), self._told(member, new, step)
        elif withdrawn:
            factor = self._missed(track, withdrawn)
        if not gone.keys() <= step.able:  # what they said has died, and what was believed of it
            prior = min(prior, member.contact.likelihood)
        elif not new and not withdrawn:
            return
        self._believe(track, _updated(prior, factor), step.now)
        before, found = track.contact, member.contact
        away = found.position - before.position
        track.averaged *= math.exp(-_seconds(step.now - track.found_at) / SMOOTHING)
        if _squared(away) > found.covariance.trace() / 3.0:  # it has moved on
            track.averaged = 0.0
        track.averaged += 1.0
        place = frozen(before.position + away / track.averaged)
        kept = replace(found, track=before.track, since=before.since)
        track.contact = _moved_to(kept, place)
        track.given = {  # of what fades, silence says as much as of what stops
            name: max(given, track.given.get(name, 0.0)) for name, given in member.given.items()
        }
        track.heard, track.is_missed = heard, False
        track.found, track.found_at = found.position, step.now

    def _told(self, member: Member, new: Sequence[str], step: Step) -> float:
        """The factor on the odds of a contact by those of its sources that tell of it anew.

        Where others stand by what they said, it takes nothing from that to be less sure.
        """
        factor = _odds(member.contact.likelihood)
        if len(new) < len(member.given):
            told = _odds(_by_any(member.given[name] for name in new))
            factor *= max(told, 1.0) / _odds(_by_any(member.given.values()))
        for name, each in member.factors.items():
            if name in step.looks and not step.spoke(self._looked_before([name])):
                factor /= each
        return factor

    def _miss(self, track: Track, step: Step) -> None:
        """Take it that nothing is said of a contact now."""
        if spoke := step.spoke(track.heard):
            self._believe(track, _updated(track.probability, self._missed(track, spoke)), step.now)
            track.heard = {name: step.looks.get(name, at) for name, at in track.heard.items()}
            track.is_missed = True
        elif not (track.is_missed and step.able.intersection(track.heard)):
            self._believe(track, 0.0, step.now)  # what was said of it is too old to live

    def _believe(self, track: Track, probability: float, now: int) -> None:
        track.probability = track.believed = probability
        track.believed_at = now

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


def _expected(track: Track, step: Step) -> Contact:
    """A contact where it is found if its sources have said nothing new: they do not follow."""
    if step.spoke(track.heard):
        return track.contact
    return replace(track.contact, position=track.found)


def paired(
    before: Sequence[Contact],
    now: Sequence[Contact],
    slid: Sequence[float] | None = None,
    news: Sequence[bool] | None = None,
) -> dict[int, int]:
    """Which contacts, as rows, are the same, those that lie the nearest together.

    What probably exists is paired first, what is reported before what is not, and with what is
    news before what is not.

    Args:
        before: contacts.
        now: those of a step.
        slid: how far each may have slid meanwhile [m]; without, not at all.
        news: which of those of the step are; without, all.
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
    further = np.zeros(len(before)) if slid is None else np.array(slid)
    squared = ((where[:, None] - there) ** 2).sum(axis=2)
    traces = np.trace(wide, axis1=1, axis2=2)[:, None] + np.trace(wider, axis1=1, axis2=2)
    most = (NEAR * np.sqrt(traces) + further[:, None]) ** 2
    rows, columns = np.nonzero(squared <= most)  # no width is larger than the trace
    widths = np.linalg.eigvalsh(wide[rows] + wider[columns])[:, -1]
    parts = np.full(squared.shape, np.inf)
    parts[rows, columns] = squared[rows, columns] / (NEAR * np.sqrt(widths) + further[rows]) ** 2
    parts[parts > 1.0] = np.inf
    if _is_unique(parts):
        return _nearest(parts)
    likely = np.array([contact.likelihood >= EVEN for contact in now])
    reported = np.array([contact.track > 0 for contact in before])
    new = np.ones(len(now), np.bool_) if news is None else np.array(news)
    pairs: dict[int, int] = {}
    for is_likely, is_reported, is_new in itertools.product((True, False), repeat=3):
        rows = np.flatnonzero(reported == is_reported)
        columns = np.flatnonzero((likely == is_likely) & (new == is_new))
        found = _nearest(parts[np.ix_(rows, columns)])
        pairs |= {int(rows[row]): int(columns[column]) for row, column in found.items()}
        parts[[*pairs]], parts[:, [*pairs.values()]] = np.inf, np.inf
    return pairs


def _is_unique(parts: FloatArray) -> bool:
    """Whether no row and no column is possible in several pairs; arguments as `_nearest`."""
    possible = np.isfinite(parts)
    return all(possible.sum(axis=axis).max(initial=0) <= 1 for axis in (0, 1))


def _nearest(parts: FloatArray) -> dict[int, int]:
    """As many pairs of a row and a column as possible, those of the least sum.

    Args:
        parts: shape (r, c), at most 1; ∞ of no pair.
    """
    possible = np.isfinite(parts)
    rows, columns = np.nonzero(possible)
    if not _is_unique(parts):
        from scipy.optimize import linear_sum_assignment

        rows, columns = linear_sum_assignment(np.where(possible, parts, 1.0 + min(parts.shape)))
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return {row: column for row, column in pairs if possible[row, column]}


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
