"""The order of what a recording of ROS holds: by header stamps, with an eye on the clocks."""

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
"""A clock that gets so far ahead of the log from one message to the next was set [ns]."""
LONGEST_PAUSE = 24 * LONGEST_LEAP
"""Where the log itself leaps so far its clock was set, too: nobody waits for so long [ns]."""
LONGEST_WAY = LONGEST_FALL // 2
"""What was measured before a clock was set is in the log so soon after it [ns]."""


@dataclass(slots=True)
class TopicTally:
    """What was heard of a topic.

    Attributes:
        messages: how many messages there were.
        readings: how many readings were made of them.
        out_of_order: how many stamps were lower than the one before.
        unreadable: how many messages could not be read, or held no reading.
        why_unreadable: what was wrong with the first of them.
        refused: how many held values that no sensor can have given, or came more than a second
            after later ones.
        why_refused: what was wrong with the first of them.
        first: its lowest stamp [s], or None.
        last: its highest [s], or None.
        longest_gap: the longest time from one stamp to the next [s].
        gap_at: the stamp at which that gap began [s].
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

    def heard(self, stamp: float) -> None:
        """Note the stamp of what is in order [s]."""
        if self.first is None or self.last is None:
            self.first = self.last = stamp
        elif stamp - self.last > self.longest_gap:
            self.longest_gap, self.gap_at = stamp - self.last, self.last
        self.first, self.last = min(self.first, stamp), max(self.last, stamp)


@dataclass(frozen=True, eq=False, slots=True)
class Heard:
    """One topic that is heard.

    Attributes:
        topic: the topic.
        listener: who hears it.
        tally: what was heard of it.
        clocks: by clock the newest stamp, and when that was logged [ns].
    """

    topic: str
    listener: Listener
    tally: TopicTally
    clocks: dict[str, tuple[int, int]]


@dataclass(frozen=True, slots=True)
class _Leap:
    """A clock that got more than a second ahead of the log, for which there may be reasons.

    Attributes:
        heard: the topic.
        before: the latest stamp of all topics before it [ns].
        after: that to which it leapt [ns].
        logged: when it did [ns].
    """

    heard: Heard
    before: int
    after: int
    logged: int


Entry = tuple[int, int, Heard, Part]
"""The stamp [ns], the number, the topic, and the part."""


@final
class Sorter:
    """Holds parts for a second of header time, and gives them in the order of their stamps.

    Args:
        epoch_ns: from where the stamps of readings count [ns].
        begin_ns: the first stamp that is expected [ns].
    """

    def __init__(self, epoch_ns: int, begin_ns: int) -> None:
        self._epoch, self._begin, self._latest = epoch_ns, begin_ns, begin_ns
        self._logged: int | None = None  # when the latest was
        self._held: list[Entry] = []
        self._count = 0
        self._leap: _Leap | None = None
        """The last one."""

    def put(self, heard: Heard, part: Part, logged: int) -> None:
        """Take a part that was logged at a stamp [ns].

        Raises:
            RecordingError: its clock jumped.
        """
        stamp, tally = part.stamp, heard.tally
        if heard.listener.is_static:
            near = abs(stamp - self._latest) <= LONGEST_FALL
            self._push(max(self._begin, stamp) if near else self._latest, heard, part)
            return
        if stamp == 0:
            tally.cannot_read("its header has no stamp")
            return
        before = heard.clocks.get(part.clock)
        step = LONGEST_LEAP + 1 if before is None else stamp - before[0]
        if not -LONGEST_FALL <= step <= LONGEST_LEAP:
            jump = self._jump(heard, stamp, logged, before)
            if jump and heard.listener.kind is Transform:  # an old tree of frames stops nothing
                tally.refuse(jump)
                return
            if jump:
                raise RecordingError(self._leapt(heard, stamp) or jump)
        elif step < 0:
            tally.out_of_order += 1
        heard.clocks[part.clock] = stamp, logged
        if stamp < self._latest - LONGEST_FALL:
            self._blame_leap(heard, stamp, logged, before)
            late = (self._latest - stamp) / NANOSECONDS_PER_SECOND
            tally.refuse(f"it came {late:.3g} s after later stamps")
            return
        tally.heard((stamp - self._epoch) / NANOSECONDS_PER_SECOND)
        self._advance(heard, stamp, logged, before)
        self._push(stamp, heard, part)

    def due(self) -> Iterator[Entry]:
        """Give what no later part can come before."""
        limit = self._latest - LONGEST_FALL
        while self._held and self._held[0][0] < limit:
            yield heapq.heappop(self._held)

    def rest(self) -> Iterator[Entry]:
        """Give all that is held."""
        while self._held:
            yield heapq.heappop(self._held)

    def _push(self, stamp: int, heard: Heard, part: Part) -> None:
        self._count += 1
        heapq.heappush(self._held, (stamp, self._count, heard, part))

    def _advance(
        self, heard: Heard, stamp: int, logged: int, before: tuple[int, int] | None
    ) -> None:
        """Note that it is as late as a stamp [ns], and a clock that got ahead of itself and all."""
        is_transform = heard.listener.kind is Transform
        if stamp < self._latest:
            return
        passed = 0 if self._logged is None else max(0, logged - self._logged)
        if is_transform:  # some are told for times to come, and nothing else is late for that
            stamp = min(stamp, self._latest + passed)
        elif (
            before is not None
            and stamp - before[0] - (logged - before[1]) > LONGEST_FALL
            and stamp - self._latest - passed > LONGEST_FALL
        ):
            self._leap = _Leap(heard, self._latest, stamp, logged)
        self._latest, self._logged = stamp, logged

    def _blame_leap(
        self, heard: Heard, stamp: int, logged: int, before: tuple[int, int] | None
    ) -> None:
        """Tell that one clock leapt ahead, when another goes on by the log as if nothing had been.

        Raises:
            RecordingError: so it is; what that clock told since then is forgotten.
        """
        leap = self._leap
        if leap is None or before is None or heard is leap.heard:
            return
        goes_on = abs(stamp - before[0] - (logged - before[1])) <= LONGEST_FALL
        is_between = leap.before - LONGEST_FALL <= stamp < leap.after
        if goes_on and is_between and logged - leap.logged >= LONGEST_WAY:
            raise RecordingError(self._leapt(leap.heard, stamp))

    def _leapt(self, heard: Heard, stamp: int) -> str:
        """Say that a clock leapt ahead, if it did, and forget what it told since then."""
        leap = self._leap
        if leap is None or heard is not leap.heard or stamp >= leap.after:
            return ""
        self._held = [entry for entry in self._held if entry[0] < leap.after]
        heapq.heapify(self._held)
        apart, at = _long(leap.after - leap.before), self._seconds(leap.before)
        return f"{heard.topic}: its clock jumps ahead by {apart} at {at} s"

    def _jump(self, heard: Heard, stamp: int, logged: int, before: tuple[int, int] | None) -> str:
        """Say by how much a clock jumped, and when; nothing when the log tells of a pause."""
        if before is None:
            passed = 0 if self._logged is None else logged - self._logged
            apart = stamp - self._latest - passed
            if abs(apart) > LONGEST_LEAP:
                return (
                    f"{heard.topic}: its clock is {_long(apart)} {_side(apart)} the others', as if "
                    f"it counted from being switched on; name by 'sensors' which topics to read, "
                    f"or leave it out by 'ignored' (--ignore)"
                )
            return self._pause(stamp)
        jumped = stamp - before[0]
        if 0 < jumped <= logged - before[1] + LONGEST_LEAP:
            return self._pause(stamp)
        way = "ahead" if jumped > 0 else "back"
        at = self._seconds(before[0])
        return f"{heard.topic}: its clock jumps {way} by {_long(jumped)} at {at} s"

    def _pause(self, stamp: int) -> str:
        """Say that headers and log leap together, as where the clock of all was set."""
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
    """Give a time in a unit that is easy to read."""
    seconds = abs(nanoseconds) / NANOSECONDS_PER_SECOND
    for unit, size in (("days", 86400.0), ("h", 3600.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.6g} s"
