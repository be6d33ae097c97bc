"""The contract of streams: readings in, commands out, from a recording, a scene or a robot."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from contactfusion.contacts import Contact
from contactfusion.readings import ObjectPose, Reading, Transform

if TYPE_CHECKING:
    from contactfusion.changes import Change
    from contactfusion.controller import Command
    from contactfusion.pipeline import Pipeline, Step

LONGEST_STEP_BACK = 1.0
"""Stamps may be so much out of order; a clock that falls further has jumped [s]."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """What comes at one time.

    Attributes:
        stamp: the time [s]; None: it moves no clock, as a transform that comes ahead.
        readings: in their order.
        due: whether the pipeline is to step then, whatever its cycle policy.
        changes: of the pipeline, before the readings.
    """

    stamp: float | None
    readings: tuple[Reading, ...]
    due: bool = False
    changes: "tuple[Change, ...]" = ()


@dataclass(frozen=True, eq=False)
class Facts:
    """What is true at one instant, and no sensor measures.

    Attributes:
        stamp: [s].
        frame: of the contacts.
        contacts: where the robot is touched; each of likelihood 1.
        objects: where the objects stand, by name.
    """

    stamp: float
    frame: str
    contacts: tuple[Contact, ...]
    objects: tuple[ObjectPose, ...]


@dataclass(frozen=True)
class Verdict:
    """What really happened in a stream, beside what was found.

    Attributes:
        truth: for a summary; JSON.
        sentences: for people.
    """

    truth: dict[str, Any]
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class Trouble:
    """What a stream met in the readings of one sensor.

    Attributes:
        sensor: its name.
        kind: of its readings; None: it has none.
        note: what was met, e.g. "3 out of order".
        loss: a sentence where less than half of them could be used, else empty.
    """

    sensor: str
    kind: type[Reading] | None
    note: str
    loss: str = ""


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
        """The readings with the times at which they come; here each by itself, at its stamp."""
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

    def facts(self) -> Facts | None:
        """The true contacts and poses of objects now; None where the stream knows of none."""
        return None

    def verdict(self, pipeline: "Pipeline", last: "Step") -> Verdict | None:
        """What really happened, once all is played; None where the stream does not know.

        Args:
            pipeline: which listened.
            last: its last step.
        """
        return None

    def troubles(self) -> Iterable[Trouble]:
        """What it met in its readings so far."""
        return ()

    def close(self) -> None:
        """Release what it holds, such as files and connections; here nothing."""
        return None


def arrival_of(reading: Reading) -> Arrival:
    """A reading that comes at its stamp; a transform may come ahead, and moves no clock."""
    ahead = isinstance(reading, Transform)
    return Arrival(None if ahead else reading.stamp, (reading,))
