"""Recordings of ROS: bags of ROS 1, rosbag2 and MCAP, bare or in folders (extra `record`)."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, final

from pydantic import Field

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
    Recording,
    SensorTopics,
    Tap,
    Window,
)
from contactfusion.recordings.ros.channels import Channel
from contactfusion.recordings.ros.contents import contents_of, topics_of
from contactfusion.recordings.ros.files import Bag
from contactfusion.recordings.ros.order import Entry, Heard, Sorter, TopicTally
from contactfusion.recordings.ros.topics import Topic, listeners
from contactfusion.stream import Trouble
from contactfusion.time import LONGEST_SECONDS, NANOSECONDS_PER_SECOND, to_nanoseconds


class RosConfig(Model):
    """A recording of ROS."""

    file: Path
    """A `.bag`, `.db3` or `.mcap`, a folder of rosbag2, or a folder of such files."""
    sensors: dict[str, str] = Field(default_factory=dict)
    """Topics by the names of their sensors, and no others are read but for transforms; when empty,
    all that can be read are. Then a sensor is called like its topic without the first slash, or
    like the topic above for `/<sensor>/depth` of a camera and `/<sensor>/<object>` of a pose."""
    ignored: tuple[str, ...] = ()
    """Topics that are not read at all; those of transforms may be among them."""
    start: float = Field(default=0.0, ge=0, le=LONGEST_SECONDS)
    """What was logged earlier is left out, but for static transforms [s after the first]."""
    duration: float | None = Field(default=None, gt=0, le=LONGEST_SECONDS)
    """What was logged so long after `start`, or later, is left out [s]; None: nothing is."""


@final
class RosRecording(Recording):
    """The readings of a recording of ROS 1 or 2.

    The stamp and the frame of a reading are those of its header; stamps count from the first of the
    whole recording, also when only a part of it is read. Headers that are up to a second
    out of order are sorted; a message is only held for so long, so long files need no more memory.

    Args:
        config: the file, the topics, and the time.
        folder: where a relative file name starts.
        tap: hears every message of the file within the time, also those that are no readings, each
            time that the readings are read.
        sensors: topics by the names of sensors, in place of those of the configuration.

    Raises:
        DependencyError: rosbags is not installed.
        RecordingError: the file is missing or can't be read, or a topic is not there or can't be.
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
        """That of which this is a part: as long as it lives, so does a file made for it."""
        self.tally: dict[str, TopicTally] = {}
        """By topic what was heard of it, while readings are read."""
        with Bag(self.path) as bag:
            self.contents: dict[str, Topic] = contents_of(bag)
            """All its topics by name."""
            self._readable = self._not_ignored()
            self.sensors = topics_of(self.path, self._readable, sensors)
            """The topics of each sensor, transforms among them."""
            self.epoch_ns = self._begin_ns = self._first_stamp(bag, None)
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
        """Open the file."""
        return cls(config, folder)

    @property
    def streams(self) -> Mapping[str, SensorTopics]:
        """Topics of one sensor and kind, by the name of the sensor.

        Where topics of other kinds are of the same sensor, as the images of a camera that tells
        clouds, too, they stand under their own names.
        """
        found: dict[str, SensorTopics] = {}
        for sensor, topics in self.sensors.items():
            for topic in topics:
                kind = self.contents[topic].kind
                assert kind is not None
                told = found.setdefault(sensor, SensorTopics(kind, ()))
                name = sensor if told.kind is kind else topic.removeprefix("/")
                before = found[name].topics if name in found else ()
                found[name] = SensorTopics(kind, (*before, topic))
        return found

    def part(
        self, sensors: Mapping[str, Sequence[str]], window: Window = WHOLE, tap: Tap | None = None
    ) -> "RosRecording":
        """What some topics hold in a window of this part, and all transforms.

        Args:
            sensors: topics by the name that their sensor gets.
            window: the part that is played.
            tap: takes the messages as they are.
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
        """The same recording, of which some topics are not read at all.

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
            RecordingError: once all readings before it are given, a clock that jumps, or the end of
                a file that is cut off or damaged.
        """
        self.tally = {topic: TopicTally() for topic in self.contents}
        topics = self._heard(self.tally)
        sorter = Sorter(self.epoch_ns, self._begin_ns)
        problem: RecordingError | None = None
        with Bag(self.path) as bag:
            for said in self._static_before(bag, topics):
                _put(sorter, *said)
            try:
                start, stop = self._window(bag)
                found = messages(bag, topics, start, stop, self.tally, self._tap)
                for said in found:
                    _put(sorter, *said)
                    for entry in sorter.due():
                        yield from self._made(entry)
            except RecordingError as error:
                problem = error
        for entry in sorter.rest():
            yield from self._made(entry)
        if problem:
            raise RecordingError(_in(self.path, problem))

    def troubles(self) -> Iterator[Trouble]:
        """What the reader of each topic met; nothing before the readings are read."""
        for sensor, topics in self.sensors.items() if self.tally else ():
            for topic in topics:
                heard, kind = self.tally[topic], self.contents[topic].kind
                met = ", ".join(self._met(topic))
                if not met:
                    continue
                loss, several = "", len(topics) > 1
                if heard.refused + heard.unreadable > heard.readings:
                    some = f"only {heard.readings} readings" if heard.readings else "nothing"
                    whose = f"'{sensor}', {topic}," if several else f"'{sensor}'"
                    loss = f"of {whose} {some} could be used: {met}"
                yield Trouble(sensor, kind, f"{topic}: {met}" if several else met, loss)

    def _met(self, topic: str) -> Iterator[str]:
        """What the reader of a topic met."""
        heard, publishers = self.tally[topic], self.contents[topic].publishers
        if publishers > 1:
            yield f"{publishers} publishers"
        if heard.out_of_order:
            yield f"{heard.out_of_order} out of order"
        if heard.unreadable:
            yield f"{heard.unreadable} unreadable: {heard.why_unreadable}"
        if heard.refused:
            yield f"{heard.refused} refused: {heard.why_refused}"

    def _heard(self, tally: Mapping[str, TopicTally]) -> dict[str, Heard]:
        """What hears the topics that are read, by topic."""
        found = listeners(self.sensors, self._readable)
        return {topic: Heard(topic, one, tally[topic], {}) for topic, one in found.items()}

    def _not_ignored(self) -> dict[str, Topic]:
        """The topics that may be read."""
        for name in self._config.ignored:
            if name not in self.contents:
                hint = name_hint(name, self.contents, "topics")
                raise RecordingError(f"{self.path} has no topic '{name}' to ignore; {hint}")
        return {
            name: one for name, one in self.contents.items() if name not in self._config.ignored
        }

    def _made(self, entry: Entry) -> Iterator[Reading]:
        """Make the reading of an entry, or count why there is none."""
        stamp, _, heard, part = entry
        try:
            reading = heard.listener.reading(part, (stamp - self.epoch_ns) / NANOSECONDS_PER_SECOND)
        except InvalidReadingError as error:
            heard.tally.refuse(error)
        except (RecordingError, PluginError) as error:
            heard.tally.cannot_read(error)
        else:
            heard.tally.readings += 1
            yield reading

    def _static_before(
        self, bag: Bag, topics: Mapping[str, Heard]
    ) -> Iterator[tuple[Heard, int, Message]]:
        """Messages of static transforms that were logged before the time that is read."""
        start, _ = self._window(bag)
        static = {name: one for name, one in topics.items() if one.listener.is_static}
        if start is not None and static:
            with suppress(RecordingError):  # it comes up again later
                yield from messages(bag, static, stop_ns=start, tap=self._tap, taps_all=False)

    def _window(self, bag: Bag) -> tuple[int | None, int | None]:
        """The stamps of the log between which messages are read [ns]; None: no bound."""
        start, duration = to_nanoseconds(self._config.start), self._config.duration
        begin = bag.first_ns + start
        end = None if duration is None else begin + to_nanoseconds(duration)
        return begin if start else None, end

    def _first_stamp(self, bag: Bag, start_ns: int | None) -> int:
        """The lowest stamp within a second of the first one since a moment in the log [ns]."""
        stamps: list[int] = []
        unused = {topic: TopicTally() for topic in self.contents}
        topics = {topic: one for topic, one in self._heard(unused).items()
                  if not one.listener.is_static}  # fmt: skip
        with suppress(RecordingError):
            for heard, _, message in messages(bag, topics, start_ns):
                stamps += [one.stamp for one in heard.listener.hear(message) if one.stamp]
                # what comes later than this can't have an earlier stamp than what came
                if stamps and stamps[-1] > stamps[0] + LONGEST_FALL:
                    break
        return min((one for one in stamps if one >= stamps[0] - LONGEST_FALL), default=0)


def _put(sorter: Sorter, heard: Heard, logged: int, message: Message) -> None:
    for part in heard.listener.hear(message):
        sorter.put(heard, part, logged)


def _in(path: Path, problem: RecordingError) -> str:
    """A problem with the name of its file."""
    return str(problem) if str(path) in str(problem) else f"{path}, {problem}"


def messages(
    bag: Bag,
    topics: Mapping[str, Heard],
    start_ns: int | None = None,
    stop_ns: int | None = None,
    tally: Mapping[str, TopicTally] | None = None,
    tap: Tap | None = None,
    taps_all: bool = True,
) -> Iterator[tuple[Heard, int, Message]]:
    """The messages of topics that are heard, with the stamps of the log [ns].

    Args:
        bag: an open one.
        topics: those that are heard.
        start_ns: only what was logged then or later [ns].
        stop_ns: only what was logged earlier [ns].
        tally: where messages are counted, of all topics; None: of those that are heard.
        tap: hears every message.
        taps_all: of every topic, or of those that are heard.

    Raises:
        RecordingError: at the end, when a file is cut off or damaged.
    """
    counts = tally or {topic: one.tally for topic, one in topics.items()}
    channels = [one for one in bag.channels if (tap and taps_all) or one.topic in topics]
    routes = {one: (topics.get(one.topic), counts[one.topic], _decoder(one)) for one in channels}
    told = {one: (one.topic, one.msgtype, one.definition()) for one in channels if tap}
    for channel, logged, raw in bag.messages(channels, start_ns, stop_ns):
        heard, count, decode = routes[channel]
        count.messages += 1
        cdr = _tried(channel.cdr, raw, count)
        if cdr is None:
            continue
        message = _tried(decode, cdr, count) if heard else None
        if heard and message is not None:
            yield heard, logged, message
        if tap:  # not of what ended the reading, such as a clock that jumped
            tap(RawMessage(*told[channel], logged, bytes(cdr)))


def _decoder(channel: Channel) -> Callable[[Any], Message]:
    """What makes a message of the CDR of a channel whose type is standard."""
    decode, msgtype = typestore().deserialize_cdr, channel.msgtype
    # of a view: what is large is not copied
    return lambda cdr: decode(memoryview(cdr), msgtype)


def _tried(call: Callable[[Any], Any], raw: Any, tally: TopicTally) -> Any:
    """What is made of bytes; None where nothing can be, which is counted."""
    try:
        return call(raw)
    except Exception as error:  # rosbags meets what is wrong with errors of many kinds
        tally.cannot_read(error)
        return None


@hookimpl
def contactfusion_recordings() -> dict[str, type[Recording]]:
    """Offer the recording."""
    return {"ros": RosRecording, "mcap": RosRecording}
