"""The contract of recordings: finite streams, of which a part can be played."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self, final

from contactfusion.errors import RecordingError, name_hint
from contactfusion.model import Model
from contactfusion.readings import Reading, Transform
from contactfusion.stream import Arrival, Stream, arrival_of
from contactfusion.transform_buffer import transforms_ahead


class SensorTopics(NamedTuple):
    """Topics of one sensor that hold readings of one kind."""

    kind: type[Reading]
    topics: tuple[str, ...]


class RawMessage(NamedTuple):
    """A message as it lies in a recording.

    Attributes:
        topic: its topic.
        msgtype: its type as ROS 2 calls it, e.g. "sensor_msgs/msg/Imu".
        definition: that of its type in .msg of ROS 2; empty when the file does not tell.
        log_stamp_ns: when it was logged [ns].
        cdr: its bytes in the encoding of ROS 2.
    """

    topic: str
    msgtype: str
    definition: str
    log_stamp_ns: int
    cdr: bytes


Tap = Callable[[RawMessage], None]
"""Takes every message, once, as they lie in the file."""


@dataclass(frozen=True)
class Window:
    """The part of a recording that is played.

    Attributes:
        start: after its beginning [s].
        duration: how long [s]; None: to its end.
    """

    start: float = 0.0
    duration: float | None = None


WHOLE = Window()


class Recording(Stream):
    """A finite series of readings; its transforms arrive ahead of what needs them.

    Attributes:
        has_messages: whether it holds messages that a tap can take as they are.
        holder: what it is, in sentences on what it does not hold.
    """

    has_messages: bool = False
    holder: str = "the recording"

    @property
    def streams(self) -> Mapping[str, SensorTopics]:
        """Topics of one sensor and kind, by the name of the sensor."""
        return {name: SensorTopics(kind, (name,)) for name, kind in self.topics.items()}

    def arrivals(self) -> Iterator[Arrival]:
        """The readings at their stamps, each transform a second before them."""
        return map(arrival_of, transforms_ahead(self.readings()))

    def without(self, topics: Sequence[str]) -> "Recording":
        """The same recording, of which some topics are not read at all.

        Raises:
            RecordingError: there is no such topic.
        """
        for name in topics:
            if name not in self.topics:
                hint = name_hint(name, self.topics, "topics")
                raise RecordingError(f"there is no topic '{name}' to ignore; {hint}")
        kept = {name: (name,) for name in self.topics if name not in topics}
        part = self.part(kept)
        part.topics = {name: self.topics[name] for name in kept}
        return part

    def part(
        self, sensors: Mapping[str, Sequence[str]], window: Window = WHOLE, tap: Tap | None = None
    ) -> "Recording":
        """What some topics hold in a window, and all transforms.

        Args:
            sensors: topics by the name that their sensor gets.
            window: the part that is played.
            tap: takes the messages as they are, where there are any.
        """
        return _Part(self, sensors, window)


class RecordingFormat(Recording):
    """The contract of formats: recordings that are opened by a description or a suffix."""

    Config: ClassVar[type[Model]]
    """The type of the options; a field `file` holds what is opened by its suffix."""
    suffixes: ClassVar[tuple[str, ...]] = ()
    """Files with these suffixes are opened without a description, e.g. ".c3d"."""

    @classmethod
    @abstractmethod
    def opened(cls, config: Any, folder: Path) -> Self:
        """The recording of a description.

        Args:
            config: an instance of `Config`.
            folder: that of relative file names.

        Raises:
            RecordingError: the file is missing, truncated, or not of its declared format.
            DependencyError: a package that reads it is not installed.
        """


@final
class _Part(Recording):
    """The wanted sensors of a recording under the names that are wanted, for a while."""

    def __init__(
        self, whole: Recording, sensors: Mapping[str, Sequence[str]], window: Window
    ) -> None:
        self._whole, self._window = whole, window
        self._names = {topic: name for name, topics in sensors.items() for topic in topics}
        self.epoch_ns, self.topics = whole.epoch_ns, whole.topics
        self.end = whole.end

    def readings(self) -> Iterator[Reading]:
        begin, span = self._window.start, self._window.duration
        for reading in self._whole.readings():
            if span is not None and reading.stamp > begin + span:
                return
            if isinstance(reading, Transform):
                yield reading
                continue
            name = self._names.get(reading.sensor)
            if reading.stamp >= begin and name is not None:
                yield reading if name == reading.sensor else replace(reading, sensor=name)
