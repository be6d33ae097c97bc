"""Recordings of ROS: bags of ROS 1, rosbag2 and MCAP, bare or in folders (extra `record`)."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any, final

from pydantic import Field

from contactfusion.changes import Change
from contactfusion.errors import InvalidReadingError, PluginError, RecordingError, name_hint
from contactfusion.hooks import hookimpl
from contactfusion.model import Model
from contactfusion.readings import Reading
from contactfusion.readings.messages import Message
from contactfusion.recordings.log import LONGEST_FALL
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.recording import (
    WHOLE,
    RawMessage,
    RecordingFormat,
    SensorTopics,
    Tap,
    Window,
)
from contactfusion.recordings.ros.channels import Channel
from contactfusion.recordings.ros.contents import contents_of, streams_of, topics_of
from contactfusion.recordings.ros.delivery import CHANGES, CYCLES, Delivery, as_recorded
from contactfusion.recordings.ros.files import Bag
from contactfusion.recordings.ros.order import Entry, Sorter, TopicState, TopicTally
from contactfusion.recordings.ros.topics import Side, Topic, header_stamp, listeners
from contactfusion.stream import Arrival, Trouble
from contactfusion.time import LONGEST_SECONDS, NANOSECONDS_PER_SECOND, to_nanoseconds

if TYPE_CHECKING:
    from contactfusion.pipeline import Pipeline

MARKS = {CYCLES: "std_msgs/msg/Header", CHANGES: "std_msgs/msg/String"}
"""The types of what was recorded of a running pipeline, by topic."""
LONGEST_NOTE = 500
"""The longest sentence on a recorded change that could not be made [characters]."""


class RosConfig(Model):
    """A recording of ROS."""

    file: Path
    """A `.bag`, `.db3` or `.mcap`, a folder of rosbag2, or a folder of such files."""
    sensors: dict[str, str] = Field(default_factory=dict)
    """Topics by the names of their sensors; no others are read but transforms. When empty, all that
    can be read are. Then a sensor is named as its topic without the first slash, or as the topic
    above for `/<sensor>/depth` of a camera and `/<sensor>/<object>` of a pose."""
    ignored: tuple[str, ...] = ()
    """Topics that are not read at all; those of transforms may be among them."""
    start: float = Field(default=0.0, ge=0, le=LONGEST_SECONDS)
    """Start of the part that is read, in time of the log [s after the first message]; static
    transforms before it are read, too."""
    duration: float | None = Field(default=None, gt=0, le=LONGEST_SECONDS)
    """Duration of the part that is read [s]; None: to the end."""


@final
class RosRecording(RecordingFormat):
    """The readings of a recording of ROS 1 or 2.

    The stamp and the frame of a reading are those of its header; stamps count from the first of the
    whole recording, also when only a part of it is read. Headers that are up to a second out of
    order are sorted; messages are held for no longer, so long files need no more memory. What
    `contactfusion live` recorded is played as it arrived, with its steps and changes.

    Args:
        config: the file, the topics, and the time.
        folder: that of a relative file name.
        tap: receives every message of the file within the time, also those that are no readings,
            each time that the readings are read.
        sensors: topics by the names of sensors, in place of those of the configuration.

    Raises:
        DependencyError: rosbags is not installed.
        RecordingError: the file is missing or can't be read, or a topic does not exist or can't be.
    """

    Config = RosConfig
    suffixes = (".bag", ".active", ".db3", ".mcap")
    has_messages = True

    def __init__(
        self,
        config: RosConfig,
        folder: Path = Path(),
        tap: Tap | None = None,
        sensors: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        if sensors is None:
            sensors = {sensor: (topic,) for sensor, topic in config.sensors.items()}
        self.path, self._config, self._tap = folder / config.file, config, tap
        self._folder = folder
        self._whole: RosRecording | None = None
        """The recording of which this is a part: it keeps a file that was made for it."""
        self._delivery: Delivery | None = None
        self.tally: dict[str, TopicTally] = {}
        """Statistics by topic, while readings are read."""
        self._failed, self._why_failed = 0, ""
        """The number of recorded changes that could not be made, and why the first could not."""
        with Bag(self.path) as bag:
            self.contents: dict[str, Topic] = contents_of(bag)
            """All its topics by name."""
            self._readable = self._not_ignored()
            self.sensors = topics_of(self.path, self._readable, sensors)
            """The topics of each sensor, transforms among them."""
            self._is_live = CYCLES in self.contents and not config.start
            for mark in MARKS.keys() & self.contents.keys() if self._is_live else ():
                if (other := self.contents[mark].msgtype) != MARKS[mark]:
                    raise RecordingError(f"{self.path}: {mark} holds {other}, not {MARKS[mark]}")
            first = bag.first_ns if self._is_live else self._first_stamp(bag, None)
            self.epoch_ns = self._begin_ns = first
            _, stop = self._window(bag)
            last = bag.last_ns if stop is None else min(stop, bag.last_ns)
            self.end = (last - bag.first_ns) / NANOSECONDS_PER_SECOND
            if config.start:
                self._begin_ns = self._first_stamp(bag, self._window(bag)[0])
        self.topics: Mapping[str, type[Reading]] = {
            sensor: kind
            for sensor, topics in self.sensors.items()
            if (kind := self.contents[topics[-1]].kind)
        }

    @classmethod
    def opened(cls, config: RosConfig, folder: Path) -> "RosRecording":
        """The recording in the file."""
        return cls(config, folder)

    @property
    def streams(self) -> Mapping[str, SensorTopics]:
        """Topics of one sensor and kind, by the name of the sensor."""
        return streams_of(self.sensors, self.contents)

    def part(
        self, sensors: Mapping[str, Sequence[str]], window: Window = WHOLE, tap: Tap | None = None
    ) -> "RosRecording":
        """Some topics in a window of this recording, with all transforms.

        Args:
            sensors: topics by the name of their sensor.
            window: the part in time.
            tap: receives the messages as they are.
        """
        config = self._config
        spans = [window.duration, config.duration and config.duration - window.start]
        choice = {
            "start": config.start + window.start,
            "duration": min((span for span in spans if span is not None), default=None),
        }
        made = RosRecording(config.model_copy(update=choice), self._folder, tap, sensors)
        made._whole = self
        return made

    def without(self, topics: Sequence[str]) -> "RosRecording":
        """The same recording without some topics.

        Raises:
            RecordingError: there is no such topic.
        """
        names = [f"/{topic.removeprefix('/')}" for topic in topics]
        choice = {"ignored": (*self._config.ignored, *names)}
        made = RosRecording(self._config.model_copy(update=choice), self._folder)
        made._whole = self
        return made

    def readings(self) -> Iterator[Reading]:
        """The readings in order of their stamps; of one stamp, as they lie in the file.

        Raises:
            RecordingError: after the readings before it, a clock that jumps, or the end of a file
                that is cut off or damaged.
        """
        self.tally = {topic: TopicTally() for topic in self.contents}
        topics = self._states(self.tally)
        sorter = Sorter(self.epoch_ns, self._begin_ns)
        problem: RecordingError | None = None
        with Bag(self.path) as bag:
            for arrival in self._static_before(bag, topics):
                _put(sorter, *arrival)
            try:
                start, stop = self._window(bag)
                found = messages(bag, topics, start, stop, self.tally, self._tap)
                for arrival in found:
                    _put(sorter, *arrival)
                    for entry in sorter.due():
                        yield from self._made(entry)
            except RecordingError as error:
                problem = error
        for entry in sorter.rest():
            yield from self._made(entry)
        if problem:
            raise RecordingError(_in(self.path, problem))

    def begin(self, pipeline: "Pipeline") -> None:
        """Prepare the pipeline for what was recorded of a running robot."""
        if self._is_live:
            as_recorded(pipeline)
            self._delivery = Delivery(pipeline, self.epoch_ns)

    def arrivals(self) -> Iterator[Arrival]:
        """The readings at their stamps; of a running robot as they arrived, with its steps."""
        return self._as_arrived(self._delivery) if self._delivery else super().arrivals()

    def _as_arrived(self, delivery: Delivery) -> Iterator[Arrival]:
        self.tally = {topic: TopicTally() for topic in self.contents}
        topics = self._states(self.tally)
        self._failed = 0
        for mark in MARKS.keys() & self.contents.keys():
            topics[mark] = TopicState(mark, Side("", ()), self.tally[mark], {})
        try:
            with Bag(self.path) as bag:
                _, stop = self._window(bag)
                found = messages(bag, topics, None, stop, self.tally, self._tap)
                for state, logged, message in found:
                    if state.topic == CHANGES:
                        yield from self._changed(message.data)
                    else:
                        yield from _arrived(delivery, state, logged, message)
        except RecordingError as error:
            raise RecordingError(_in(self.path, error)) from None

    def _changed(self, text: str) -> Iterator[Arrival]:
        """A change as it was recorded: what it names lies beside the recording."""
        place = self.path.resolve()
        change = Change(text, place if place.is_dir() else place.parent)
        yield Arrival(None, (), changes=(change,))
        if change.outcome.done() and (error := change.outcome.exception()):
            self._failed += 1
            if self._failed == 1:
                self._why_failed = shorten(f"'{text}': {error}", LONGEST_NOTE, placeholder=" …")

    def troubles(self) -> Iterator[Trouble]:
        """Problems of each topic; none before the readings are read."""
        if self._failed:
            count = f"{self._failed} of {self.tally[CHANGES].messages}"
            yield Trouble(CHANGES, None, f"{count} could not be made: {self._why_failed}")
        for sensor, topics in self.sensors.items() if self.tally else ():
            for topic in topics:
                tally, kind = self.tally[topic], self.contents[topic].kind
                problems = ", ".join(self._met(topic))
                if not problems:
                    continue
                loss, several = "", len(topics) > 1
                if tally.refused + tally.unreadable > tally.readings:
                    some = f"only {tally.readings} readings" if tally.readings else "nothing"
                    whose = f"'{sensor}', {topic}," if several else f"'{sensor}'"
                    loss = f"of {whose} {some} could be used: {problems}"
                yield Trouble(sensor, kind, f"{topic}: {problems}" if several else problems, loss)

    def _met(self, topic: str) -> Iterator[str]:
        """Problems of a topic, in words."""
        tally, publishers = self.tally[topic], self.contents[topic].publishers
        if publishers > 1:
            yield f"{publishers} publishers"
        if tally.out_of_order:
            yield f"{tally.out_of_order} out of order"
        if tally.unreadable:
            yield f"{tally.unreadable} unreadable: {tally.why_unreadable}"
        if tally.refused:
            yield f"{tally.refused} refused: {tally.why_refused}"

    def _states(self, tally: Mapping[str, TopicTally]) -> dict[str, TopicState]:
        """The states of the topics that are read, by topic."""
        found = listeners(self.sensors, self._readable)
        return {
            topic: TopicState(topic, listener, tally[topic], {})
            for topic, listener in found.items()
        }

    def _not_ignored(self) -> dict[str, Topic]:
        """The topics that may be read."""
        for name in self._config.ignored:
            if name not in self.contents:
                hint = name_hint(name, self.contents, "topics")
                raise RecordingError(f"{self.path} has no topic '{name}' to ignore; {hint}")
        return {
            name: topic for name, topic in self.contents.items() if name not in self._config.ignored
        }

    def _made(self, entry: Entry) -> Iterator[Reading]:
        """The reading of an entry; without one, the reason is counted."""
        stamp, _, state, part = entry
        try:
            reading = state.listener.reading(part, (stamp - self.epoch_ns) / NANOSECONDS_PER_SECOND)
        except InvalidReadingError as error:
            state.tally.refuse(error)
        except (RecordingError, PluginError) as error:
            state.tally.cannot_read(error)
        else:
            state.tally.readings += 1
            yield reading

    def _static_before(
        self, bag: Bag, topics: Mapping[str, TopicState]
    ) -> Iterator[tuple[TopicState, int, Message]]:
        """Messages of static transforms that were logged before the time that is read."""
        start, _ = self._window(bag)
        static = {name: state for name, state in topics.items() if state.listener.is_static}
        if start is not None and static:
            with suppress(RecordingError):  # it is raised again later
                yield from messages(bag, static, stop_ns=start, tap=self._tap, taps_all=False)

    def _window(self, bag: Bag) -> tuple[int | None, int | None]:
        """The stamps of the log between which messages are read [ns]; None: no bound."""
        start, duration = to_nanoseconds(self._config.start), self._config.duration
        begin = bag.first_ns + start
        end = None if duration is None else begin + to_nanoseconds(duration)
        return begin if start else None, end

    def _first_stamp(self, bag: Bag, start_ns: int | None) -> int:
        """The lowest stamp within a second of the first since a stamp in the log [ns]."""
        stamps: list[int] = []
        unused = {topic: TopicTally() for topic in self.contents}
        topics = {topic: state for topic, state in self._states(unused).items()
                  if not state.listener.is_static}  # fmt: skip
        with suppress(RecordingError):
            for state, logged, message in messages(bag, topics, start_ns):
                parts = state.listener.parts(message)
                stamps += [part.stamp for part in parts if part.stamp or not logged]
                # later messages have no earlier stamps than this
                if stamps and stamps[-1] > stamps[0] + LONGEST_FALL:
                    break
        return min((stamp for stamp in stamps if stamp >= stamps[0] - LONGEST_FALL), default=0)


def _put(sorter: Sorter, state: TopicState, logged: int, message: Message) -> None:
    for part in state.listener.parts(message):
        sorter.put(state, part, logged)


def _arrived(
    delivery: Delivery, state: TopicState, logged: int, message: Message
) -> Iterator[Arrival]:
    """What a message of a running robot was to the pipeline."""
    if state.topic == CYCLES:
        now = header_stamp(message)
        for reading in delivery.before_step(now):
            yield Arrival(None, (reading,))
        yield Arrival(delivery.seconds(now), (), due=True)
    else:
        for reading in delivery.of(state, message, logged):
            yield Arrival(None, (reading,))


def _in(path: Path, problem: RecordingError) -> str:
    """A problem with the name of its file."""
    return str(problem) if str(path) in str(problem) else f"{path}, {problem}"


def messages(
    bag: Bag,
    topics: Mapping[str, TopicState],
    start_ns: int | None = None,
    stop_ns: int | None = None,
    tally: Mapping[str, TopicTally] | None = None,
    tap: Tap | None = None,
    taps_all: bool = True,
) -> Iterator[tuple[TopicState, int, Message]]:
    """The messages of topics that are read, with the stamps of the log [ns].

    Args:
        bag: an open one.
        topics: the topics, with their states.
        start_ns: earliest stamp in the log [ns].
        stop_ns: stamp in the log before which messages end [ns].
        tally: the statistics that count messages, of all topics; None: of those that are read.
        tap: receives every message.
        taps_all: of every topic, or of those that are read.

    Raises:
        RecordingError: at the end, when a file is cut off or damaged.
    """
    counts = tally or {topic: state.tally for topic, state in topics.items()}
    channels = [
        channel for channel in bag.channels if (tap and taps_all) or channel.topic in topics
    ]
    routes = {
        channel: (topics.get(channel.topic), counts[channel.topic], _decoder(channel))
        for channel in channels
    }
    described = {
        channel: (channel.topic, channel.msgtype, channel.definition())
        for channel in channels
        if tap
    }
    for channel, logged, raw in bag.messages(channels, start_ns, stop_ns):
        state, count, decode = routes[channel]
        count.messages += 1
        cdr = _tried(channel.cdr, raw, count)
        if cdr is None:
            continue
        message = _tried(decode, cdr, count) if state else None
        if state and message is not None:
            yield state, logged, message
        if tap:  # but not of a message that ended the reading, such as of a clock that jumped
            tap(RawMessage(*described[channel], logged, bytes(cdr)))


def _decoder(channel: Channel) -> Callable[[Any], Message]:
    """The decoder of the CDR of a channel whose type is standard."""
    decode, msgtype = typestore().deserialize_cdr, channel.msgtype
    # of a view: large messages are not copied
    return lambda cdr: decode(memoryview(cdr), msgtype)


def _tried(call: Callable[[Any], Any], raw: Any, tally: TopicTally) -> Any:
    """The result of a decoder; None where it fails, which is counted."""
    try:
        return call(raw)
    except Exception as error:  # rosbags raises errors of many kinds
        tally.cannot_read(error)
        return None


@hookimpl
def contactfusion_recordings() -> dict[str, type[RecordingFormat]]:
    """The recording."""
    return {"ros": RosRecording, "mcap": RosRecording}
