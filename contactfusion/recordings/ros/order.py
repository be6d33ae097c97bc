"""The order of a recording of ROS: by header stamps, with checks of the clocks."""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

from contactfusion.errors import RecordingError
from contactfusion.readings import Transform
from contactfusion.recordings.log import LONGEST_FALL
from contactfusion.recordings.ros.topics import Listener, Part
from contactfusion.time import NANOSECONDS_PER_SECOND

LONGEST_LEAP = 3600 * NANOSECONDS_PER_SECOND
"""The greatest lead of a clock over the log between messages [ns]; beyond, the clock was set."""
LONGEST_PAUSE = 24 * LONGEST_LEAP
"""The greatest leap of the log itself [ns]; beyond, its clock was set, too."""
LONGEST_DELAY = LONGEST_FALL // 2
"""The greatest delay in the log of messages that were stamped before a clock was set [ns]."""


@dataclass(slots=True)
class TopicTally:
    """Statistics of a topic.

    Attributes:
        messages: number of messages.
        readings: number of readings that were made of them.
        out_of_order: number of stamps that are lower than the one before.
        unreadable: number of messages that could not be read, or held no reading.
        why_unreadable: the problem of the first of them.
        refused: number of messages with values that are invalid for their sensor, or that came more
            than a second after later ones.
        why_refused: the problem of the first of them.
        first: its lowest stamp [s], or None.
        last: its highest stamp [s], or None.
        longest_gap: the longest time from one stamp to the next [s].
        gap_at: the stamp at the start of that gap [s].
    """

    messages: int = 0
    readings: int = 0
    out_of_order: int = 0
    unreadable: int = 0
    why_unreadable: str = ""
    refused: int = 0
    why_refused: str = ""
    first: float | None = None
    last: float | None = None
    longest_gap: float = 0.0
    gap_at: float = 0.0

    def cannot_read(self, reason: object) -> None:
        """Count a message that can't be read."""
        self.unreadable += 1
        self.why_unreadable = self.why_unreadable or str(reason)

    def refuse(self, reason: object) -> None:
        """Count a message that is refused."""
        self.refused += 1
        self.why_refused = self.why_refused or str(reason)

    def received(self, stamp: float) -> None:
        """Count a stamp that is in order [s]."""
        if self.first is None or self.last is None:
            self.first = self.last = stamp
        elif stamp - self.last > self.longest_gap:
            self.longest_gap, self.gap_at = stamp - self.last, self.last
        self.first, self.last = min(self.first, stamp), max(self.last, stamp)


@dataclass(frozen=True, eq=False, slots=True)
class TopicState:
    """The state of a topic that is read.

    Attributes:
        topic: the topic.
        listener: the reader of its messages.
        tally: its statistics.
        clocks: by clock the newest stamp, and its stamp in the log [ns].
    """

    topic: str
    listener: Listener
    tally: TopicTally
    clocks: dict[str, tuple[int, int]]


@dataclass(frozen=True, slots=True)
class _Leap:
    """A clock that passed the log by more than a second, for which there may be reasons.

    Attributes:
        state: of the topic.
        before: the latest stamp of all topics before it [ns].
        after: the stamp to which it leapt [ns].
        logged: its stamp in the log [ns].
    """

    state: TopicState
    before: int
    after: int
    logged: int


Entry = tuple[int, int, TopicState, Part]
"""The stamp [ns], the number, the topic's state, and the part."""


@final
class Sorter:
    """Holds parts for a second of header time, and yields them in the order of their stamps.

    Args:
        epoch_ns: the origin of the stamps of readings [ns].
        begin_ns: the first expected stamp [ns].
    """

    def __init__(self, epoch_ns: int, begin_ns: int) -> None:
        self._epoch, self._begin, self._latest = epoch_ns, begin_ns, begin_ns
        self._logged: int | None = None  # stamp of the latest in the log
        self._held: list[Entry] = []
        self._count = 0
        self._leap: _Leap | None = None
        """The last leap."""

    def put(self, state: TopicState, part: Part, logged: int) -> None:
        """Insert a part that was logged at a stamp [ns].

        Raises:
            RecordingError: its clock jumped.
        """
        stamp, tally = part.stamp, state.tally
        if state.listener.is_static:
            near = abs(stamp - self._latest) <= LONGEST_FALL
            self._push(max(self._begin, stamp) if near else self._latest, state, part)
            return
        if stamp == 0 and logged:  # else it is that of a log that starts at 0
            tally.cannot_read("its header has no stamp")
            return
        before = state.clocks.get(part.clock)
        step = LONGEST_LEAP + 1 if before is None else stamp - before[0]
        if not -LONGEST_FALL <= step <= LONGEST_LEAP:
            jump = self._jump(state, stamp, logged, before)
            if jump and state.listener.kind is Transform:  # an old tree of frames stops nothing
                tally.refuse(jump)
                return
            if jump:
                raise RecordingError(self._leapt(state, stamp) or jump)
        elif step < 0:
            tally.out_of_order += 1
        state.clocks[part.clock] = stamp, logged
        if stamp < self._latest - LONGEST_FALL:
            self._blame_leap(state, stamp, logged, before)
            late = (self._latest - stamp) / NANOSECONDS_PER_SECOND
            tally.refuse(f"it came {late:.3g} s after later stamps")
            return
        tally.received((stamp - self._epoch) / NANOSECONDS_PER_SECOND)
        self._advance(state, stamp, logged, before)
        self._push(stamp, state, part)

    def due(self) -> Iterator[Entry]:
        """The parts that no later part can precede."""
        limit = self._latest - LONGEST_FALL
        while self._held and self._held[0][0] < limit:
            yield heapq.heappop(self._held)

    def rest(self) -> Iterator[Entry]:
        """All parts that are left."""
        while self._held:
            yield heapq.heappop(self._held)

    def _push(self, stamp: int, state: TopicState, part: Part) -> None:
        self._count += 1
        heapq.heappush(self._held, (stamp, self._count, state, part))

    def _advance(
        self, state: TopicState, stamp: int, logged: int, before: tuple[int, int] | None
    ) -> None:
        """Advance the latest stamp [ns]; record a clock that passed both its log and all topics."""
        is_transform = state.listener.kind is Transform
        if stamp < self._latest:
            return
        passed = 0 if self._logged is None else max(0, logged - self._logged)
        if is_transform:  # some are stamped in the future, and make no other topic late
            stamp = min(stamp, self._latest + passed)
        elif (
            before is not None
            and stamp - before[0] - (logged - before[1]) > LONGEST_FALL
            and stamp - self._latest - passed > LONGEST_FALL
        ):
            self._leap = _Leap(state, self._latest, stamp, logged)
        self._latest, self._logged = stamp, logged

    def _blame_leap(
        self, state: TopicState, stamp: int, logged: int, before: tuple[int, int] | None
    ) -> None:
        """Blame one clock for a leap when another follows the log without one.

        Raises:
            RecordingError: it does; later parts of the blamed clock are dropped.
        """
        leap = self._leap
        if leap is None or before is None or state is leap.state:
            return
        goes_on = abs(stamp - before[0] - (logged - before[1])) <= LONGEST_FALL
        is_between = leap.before - LONGEST_FALL <= stamp < leap.after
        if goes_on and is_between and logged - leap.logged >= LONGEST_DELAY:
            raise RecordingError(self._leapt(leap.state, stamp))

    def _leapt(self, state: TopicState, stamp: int) -> str:
        """The sentence that a clock leapt, if it did; then its later parts are dropped."""
        leap = self._leap
        if leap is None or state is not leap.state or stamp >= leap.after:
            return ""
        self._held = [entry for entry in self._held if entry[0] < leap.after]
        heapq.heapify(self._held)
        apart, at = _long(leap.after - leap.before), self._seconds(leap.before)
        return f"{state.topic}: its clock jumps ahead by {apart} at {at} s"

    def _jump(
        self, state: TopicState, stamp: int, logged: int, before: tuple[int, int] | None
    ) -> str:
        """The sentence on a clock's jump and its time; empty when the log has a pause."""
        if before is None:
            passed = 0 if self._logged is None else logged - self._logged
            apart = stamp - self._latest - passed
            if abs(apart) > LONGEST_LEAP:
                return (
                    f"{state.topic}: its clock is {_long(apart)} {_side(apart)} the others', as if "
                    f"it counted from being switched on; name by 'sensors' which topics to read, "
                    f"or leave it out by 'ignored' (--ignore)"
                )
            return self._pause(stamp)
        jumped = stamp - before[0]
        if 0 < jumped <= logged - before[1] + LONGEST_LEAP:
            return self._pause(stamp)
        direction = "ahead" if jumped > 0 else "back"
        at = self._seconds(before[0])
        return f"{state.topic}: its clock jumps {direction} by {_long(jumped)} at {at} s"

    def _pause(self, stamp: int) -> str:
        """The sentence that headers and log leap together, as where the clocks of all were set."""
        pause = stamp - self._latest
        if pause <= LONGEST_PAUSE:
            return ""
        return (
            f"all clocks leap ahead by {_long(pause)} at {self._seconds(self._latest)} s, as where "
            f"they were set, or recording paused; what comes then is read by a later start"
        )

    def _seconds(self, stamp: int) -> str:
        return f"{(stamp - self._epoch) / NANOSECONDS_PER_SECOND:.3f}"


def _side(apart: int) -> str:
    return "ahead of" if apart > 0 else "behind"


def _long(nanoseconds: int) -> str:
    """A duration in a unit that is easy to read."""
    seconds = abs(nanoseconds) / NANOSECONDS_PER_SECOND
    for unit, size in (("days", 86400.0), ("h", 3600.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.6g} s"
