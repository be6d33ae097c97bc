"""The contract of streams: readings in, commands out, from a recording, a scene or a robot."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from contactfusion.readings import Reading, Transform

if TYPE_CHECKING:
    from contactfusion.controller import Command
    from contactfusion.pipeline import Pipeline


@dataclass(frozen=True, slots=True)
class Arrival:
    """What comes at one time.

    Attributes:
        stamp: the time [s]; None: it moves no clock, as a transform that comes ahead.
        readings: in their order.
        due: whether the pipeline is to step then, whatever its cycle policy.
    """

    stamp: float | None
    readings: tuple[Reading, ...]
    due: bool = False


class Stream(ABC):
    """Readings as they come, and what takes commands.

    Attributes:
        epoch_ns: the moment from which stamps count, in the stream's own clock [ns], so that float
            stamps lose nothing.
        end: the last stamp [s]; None where that is not known before all is read.
        topics: what it holds: for the name of each sensor the kind of its readings.
    """

    epoch_ns: int = 0
    end: float | None = None
    topics: Mapping[str, type[Reading]] = {}

    @abstractmethod
    def readings(self) -> Iterator[Reading]:
        """The readings in order of their stamps.

        Raises:
            RecordingError: the stream is truncated, or not what it says it is.
        """

    def arrivals(self) -> Iterator[Arrival]:
        """The readings with the times at which they come; here one by one, at their stamps."""
        for reading in self.readings():
            yield arrival_of(reading)

    def begin(self, pipeline: "Pipeline") -> None:
        """Take note of the pipeline that is going to listen.

        Raises:
            ConfigurationError: it does not fit the stream.
        """
        return None

    def send(self, command: "Command | None") -> None:
        """Take the command of a step, before the next arrival; here nothing obeys.

        Args:
            command: None of a pipeline without a controller.

        Raises:
            ConfigurationError: the stream cannot take it.
        """
        return None


def arrival_of(reading: Reading) -> Arrival:
    """A reading that comes at its stamp; a transform may come ahead, and moves no clock."""
    ahead = isinstance(reading, Transform)
    return Arrival(None if ahead else reading.stamp, (reading,))
