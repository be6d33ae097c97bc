"""The order of what a recording of ROS holds: by header stamps, with an eye on the clocks."""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

from contactfusion.errors import RecordingError
from contactfusion.readings import Transform
from contactfusion.recordings.log import LONGEST_FALL
from contactfusion.recordings.ros_listeners import Listener, Part
from contactfusion.time import NANOSECONDS_PER_SECOND

LONGEST_LEAP = 3600 * NANOSECONDS_PER_SECOND
"""A clock that gets so far ahead of the log from one message to the next was set [ns]."""


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
                raise RecordingError(jump)
        elif step < 0:
            tally.out_of_order += 1
        heard.clocks[part.clock] = stamp, logged
        if stamp < self._latest - LONGEST_FALL:
            late = (self._latest - stamp) / NANOSECONDS_PER_SECOND
            tally.refuse(f"it came {late:.3g} s after later stamps")
            return
        tally.heard((stamp - self._epoch) / NANOSECONDS_PER_SECOND)
        if stamp >= self._latest:
            self._latest, self._logged = stamp, logged
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

    def _jump(self, heard: Heard, stamp: int, logged: int, before: tuple[int, int] | None) -> str:
        """Say by how much a clock jumped, and when; nothing when the log tells of a pause."""
        if before is None:
            passed = 0 if self._logged is None else logged - self._logged
            apart = stamp - self._latest - passed
            if abs(apart) <= LONGEST_LEAP:
                return ""
            return (
                f"{heard.topic}: its clock is {_long(apart)} {_side(apart)} the others'; "
                f"name by 'sensors' which topics to read"
            )
        jumped = stamp - before[0]
        if 0 < jumped <= logged - before[1] + LONGEST_LEAP:
            return ""
        at = (before[0] - self._epoch) / NANOSECONDS_PER_SECOND
        way = "ahead" if jumped > 0 else "back"
        return f"{heard.topic}: its clock jumps {way} by {_long(jumped)} at {at:.3f} s"


def _side(apart: int) -> str:
    return "ahead of" if apart > 0 else "behind"


def _long(nanoseconds: int) -> str:
    """Give a time in a unit that is easy to read."""
    seconds = abs(nanoseconds) / NANOSECONDS_PER_SECOND
    for unit, size in (("days", 86400.0), ("h", 3600.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.6g} s"
