"""Messages in the order of their arrival, as on a running robot: live, and when played again."""

import shlex
from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final, NamedTuple, final

from contactfusion.errors import InvalidReadingError, PluginError, RecordingError
from contactfusion.isolation import Isolated
from contactfusion.readings import Reading
from contactfusion.readings.codec import Role
from contactfusion.readings.messages import Message
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.ros.order import TopicState
from contactfusion.recordings.step_messages import OURS
from contactfusion.time import NANOSECONDS_PER_SECOND, to_nanoseconds

if TYPE_CHECKING:
    from contactfusion.pipeline import Pipeline

CYCLES: Final = f"{OURS}cycles"
"""The topic of the instants of steps, in the order of what arrived, as std_msgs/Header."""
CHANGES: Final = f"{OURS}changes"
"""The topic of changes of the pipeline while it ran, as std_msgs/String."""
AHEAD_NS = NANOSECONDS_PER_SECOND // 2
"""A stamp further ahead of its arrival is of another clock [ns]."""
BEHIND_NS = 10 * NANOSECONDS_PER_SECOND
"""Likewise a stamp further behind [ns]."""
SIMULATED = 1e9
"""The least time between a clock since 1970 and one since the start of a simulation [s]."""
MOST_WAITING = 10_000
"""Number of readings that wait for transforms; beyond, the oldest goes on without."""


class _Waiting(NamedTuple):
    reading: Reading
    until: int
    """[ns since 1970]"""


@final
class Delivery:
    """Makes readings of messages as they arrive; those without a place wait for transforms.

    What comes of it depends on the messages, their arrival and the instants of steps alone, so that
    a recording of them is played exactly as it was live.

    Args:
        pipeline: which listens; so long as its cycle waits, transforms may lag behind its steps.
        epoch_ns: the origin of stamps [ns since 1970].
    """

    def __init__(self, pipeline: "Pipeline", epoch_ns: int) -> None:
        self._pipeline, self._epoch_ns = pipeline, epoch_ns
        self._patience = to_nanoseconds(pipeline.config.cycle.wait)
        self._waiting = deque[_Waiting]()
        self._sensed = {
            codec.kind for codec in installed_kinds().all() if codec.role is Role.SENSED
        }
        pipeline.transform_lag = pipeline.config.cycle.wait
        pipeline.conflates = not pipeline.config.cycle.ready  # which waits for clouds

    def seconds(self, stamp_ns: int) -> float:
        """A stamp since 1970 [ns] as one since the epoch [s]."""
        return (stamp_ns - self._epoch_ns) / NANOSECONDS_PER_SECOND

    def of(self, state: TopicState, message: Message, arrived: int) -> Iterator[Reading]:
        """The readings that a message makes, and those that it places.

        Args:
            state: of its topic.
            message: the message.
            arrived: [ns since 1970].
        """
        tally, listener = state.tally, state.listener
        places = False
        for part in listener.parts(message):
            stamp = part.stamp or arrived  # some drivers leave it out
            if not (listener.is_static or -BEHIND_NS <= stamp - arrived <= AHEAD_NS):
                tally.refuse(of_another_clock(stamp - arrived))
                continue
            try:
                reading = listener.reading(part, self.seconds(stamp))
            except InvalidReadingError as error:
                tally.refuse(error)
                continue
            except (RecordingError, PluginError) as error:
                tally.cannot_read(error)
                continue
            tally.readings += 1
            tally.received(reading.stamp)
            if type(reading) not in self._sensed:
                places = True
                yield reading
            elif self._has_place(reading):
                yield reading
            else:
                self._waiting.append(_Waiting(reading, arrived + self._patience))
        if places or len(self._waiting) > MOST_WAITING:
            yield from self._placed(-1)

    def before_step(self, now: int) -> Iterator[Reading]:
        """The readings that have waited for long enough, with or without a place.

        Args:
            now: the instant of the step [ns since 1970].
        """
        yield from self._placed(now)

    def overdue(self, now: int) -> bool:
        """Whether a reading has waited for long enough [ns since 1970]."""
        return bool(self._waiting) and self._waiting[0].until <= now

    def _has_place(self, reading: Reading) -> bool:
        """Whether a reading need not wait, nor one before it of the same sensor."""
        if any(each.reading.sensor == reading.sensor for each in self._waiting):
            return False
        return self._pipeline.placed(reading)

    def _placed(self, now: int) -> Iterator[Reading]:
        """The readings, in order, that are placed by now, or wait no longer."""
        waiting, self._waiting = self._waiting, deque()
        late = set[str]()
        while waiting:
            reading, until = each = waiting.popleft()
            ends = until <= now or len(waiting) >= MOST_WAITING
            if ends or (reading.sensor not in late and self._pipeline.placed(reading)):
                yield reading
            else:
                late.add(reading.sensor)
                self._waiting.append(each)


def of_another_clock(ahead: int) -> str:
    """The clause on a stamp so far ahead of its arrival [ns]."""
    seconds = abs(ahead) / NANOSECONDS_PER_SECOND
    if seconds > SIMULATED:
        return "it counts simulated time, and this pipeline does not: --sim-time"
    side = "ahead of" if ahead > 0 else "behind"
    return f"its clock is {seconds:,.3f} s {side} this machine's: set both by NTP or PTP"


def answers(pipeline: "Pipeline") -> Iterator[str]:
    """The changes that say which clouds of isolated generators came since the last call."""
    for name, generator in pipeline.generators.items():
        if isinstance(generator, Isolated):
            while generator.answered:
                yield f"answer {shlex.quote(name)} {generator.answered.popleft()}"


def as_recorded(pipeline: "Pipeline") -> None:
    """Let isolated generators process only the readings that `answer` names, and undo changes."""
    pipeline.scripted = True
    pipeline.restore()
    for generator in pipeline.generators.values():
        if isinstance(generator, Isolated):
            generator.scripted = True
