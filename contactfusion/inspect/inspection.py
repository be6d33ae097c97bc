"""Contents of a recording, before there is a configuration: topics, frames, clocks, uses."""

import json
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TypedDict, final

from contactfusion.errors import RecordingError
from contactfusion.plugins import installed_plugins
from contactfusion.readings import Reading, Transform
from contactfusion.readings.messages import Message
from contactfusion.readings.poses import STATIC, TRANSFORMS
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.log import LONGEST_FALL
from contactfusion.recordings.messages import typestore
from contactfusion.recordings.opening import is_ros, open_recording
from contactfusion.recordings.recording import Recording
from contactfusion.recordings.ros import RosRecording
from contactfusion.recordings.ros.channels import Channel
from contactfusion.recordings.ros.contents import TRUTH, contents_of, topics_of, why_unread
from contactfusion.recordings.ros.files import Bag
from contactfusion.recordings.ros.topics import Topic, last, listeners
from contactfusion.recordings.step_messages import OURS
from contactfusion.terminal import followed, printable, progress
from contactfusion.time import to_nanoseconds, to_seconds

DECODED = 20
"""Messages of /tf that are decoded, of those that begin alike and are of equal length."""
SHOWN_EVERY = 1000
"""Messages between two updates of the progress bar."""
EPOCHS = 1e8
"""Clocks beyond this count from 1970; others from when they started [s]."""
DEEPEST = 100
"""The greatest depth of a frame in the tree that is shown."""
WIDEST = 1000
"""The greatest width of a column of the table to which cells are filled up [characters]."""
FAR = 1.0
"""The least difference between a clock and that of the log that is remarked [s]."""


@final
@dataclass(frozen=True)
class Jump:
    """A jump of a header's clock: it falls, or passes the log, by more than a second.

    Attributes:
        at: time since the recording's start by the log [s].
        by: change of the clock [s]; negative is back.
    """

    at: float
    by: float


@final
@dataclass(frozen=True)
class TopicInspection:
    """A topic of a ROS recording, or a sensor of any other.

    Attributes:
        name: the topic.
        type: the type of its messages as ROS 2 calls it; empty in other recordings.
        messages: number of messages.
        rate: messages a second, by the log [Hz]; None under two.
        frames: the frames that its headers name, in order of appearance.
        publishers: number of nodes that sent it, as far as the file holds it.
        sensor: its name in a configuration; empty where it is not read.
        reading: the type of reading that its messages become; empty where there is none.
        generators: the installed types of generators that take such readings.
        use: the use of the readings beside generators.
        unread: why it becomes no readings.
        delay: the least and the greatest time from the stamp of a header to that of the log [s];
            None where headers have none, or are static.
        unstamped: number of headers whose stamp was never set.
        jumps: of its headers' clock.
    """

    name: str
    type: str
    messages: int
    rate: float | None = None
    frames: tuple[str, ...] = ()
    publishers: int = 1
    sensor: str = ""
    reading: str = ""
    generators: tuple[str, ...] = ()
    use: str = ""
    unread: str = ""
    delay: tuple[float, float] | None = None
    unstamped: int = 0
    jumps: tuple[Jump, ...] = ()


@final
@dataclass(frozen=True)
class FrameInspection:
    """A frame that a transform defines.

    Attributes:
        name: the frame.
        parent: its parent frame.
        static: whether the transform is static.
    """

    name: str
    parent: str
    static: bool


@final
@dataclass(frozen=True)
class Inspection:
    """Contents of a recording.

    Attributes:
        path: the file or folder.
        start_ns: when it starts, by the log, or by its own clock where it has none [ns].
        duration: from its first message to its last [s].
        topics: by name.
        frames: those that transforms define, by name.
        problem: why some of it could not be read; empty when all was.
    """

    path: Path
    start_ns: int
    duration: float
    topics: tuple[TopicInspection, ...]
    frames: tuple[FrameInspection, ...]
    problem: str = ""

    def ancestors(self, frame: str) -> tuple[str, ...]:
        """A frame and its ancestors, the root last."""
        parents = {frame.name: frame.parent for frame in self.frames}
        chain = {frame: None}
        while (parent := parents.get(frame)) is not None and parent not in chain:
            chain[parent] = None
            frame = parent
        return tuple(chain)


def inspect_recording(path: Path) -> Inspection:
    """The contents of a recording: topics, rates, frames, clocks, and the uses of its readings.

    All messages are read once; only headers and a few transforms are decoded.

    Args:
        path: whatever `open_recording` opens.

    Raises:
        ContactFusionError: nothing of it can be read.
    """
    if is_ros(path):
        return _of_ros(path, None)
    recording = open_recording(path)
    if isinstance(recording, RosRecording):
        return _of_ros(recording.path, recording.sensors)
    return inspect_readings(path, recording)


def as_json(inspection: Inspection) -> str:
    """An inspection as JSON, the names those of its attributes."""
    return json.dumps(asdict(inspection), indent=1, ensure_ascii=False, default=str)


# Recordings of ROS


@final
@dataclass
class _Statistics:
    """Statistics of a topic's clocks and frames; stamps in [ns]."""

    clocked: bool = False
    """Whether the messages of a channel should come in the order of their headers."""
    count: int = 0
    first: int = 0
    last: int = 0
    delays: list[int] = field(default_factory=list)
    """The least and the greatest delay from header to log."""
    unstamped: int = 0
    jumps: list[tuple[int, int]] = field(default_factory=list)
    frames: dict[str, None] = field(default_factory=dict)
    latest: dict[Channel, tuple[int, int]] = field(default_factory=dict)
    """The stamps of the header and of the log of the newest message, by channel."""

    @property
    def rate(self) -> float | None:
        """Messages a second [Hz]."""
        span = to_seconds(self.last - self.first)
        return (self.count - 1) / span if span > 0.0 else None

    def message(self, stamp: int) -> None:
        """Count a message, by its stamp in the log."""
        self.first = min(self.first, stamp) if self.count else stamp
        self.last = max(self.last, stamp)
        self.count += 1

    def header(self, channel: Channel, stamp: int, frame: str, logged: int) -> None:
        """Count the header of a message, with its stamp in the log."""
        self.frames[frame] = None
        if not stamp and logged:  # else it is that of a log that starts at 0
            self.unstamped += 1
            return
        delay = logged - stamp
        least, greatest = self.delays or (delay, delay)
        self.delays = [min(least, delay), max(greatest, delay)]
        if self.clocked and channel in self.latest:
            before, log_before = self.latest[channel]
            step, passed = stamp - before, max(0, logged - log_before)
            if step < -LONGEST_FALL or step - passed > LONGEST_FALL:
                self.jumps.append((logged, step))
        self.latest[channel] = stamp, logged


def _of_ros(path: Path, sensors: Mapping[str, Sequence[str]] | None) -> Inspection:
    """The inspection of a recording of ROS; `sensors` are those of its description, if any."""
    frames: dict[str, FrameInspection] = {}
    decoded = Counter[tuple[Channel, str, int]]()
    problem = ""
    with Bag(path) as bag:
        contents = contents_of(bag)
        statistics = {
            name: _Statistics(clocked=topic.msgtype != TRANSFORMS)
            for name, topic in contents.items()
        }
        duration = to_seconds(max(0, bag.last_ns - bag.first_ns))
        with progress(f"reading {path}", duration) as reach:
            try:
                for number, (channel, logged, raw) in enumerate(bag.messages(bag.channels)):
                    if number % SHOWN_EVERY == 0:
                        reach(to_seconds(logged - bag.first_ns))
                    topic = statistics[channel.topic]
                    topic.message(logged)
                    if channel.header is None:
                        continue
                    with suppress(struct.error):  # an empty list of transforms has no header
                        stamp, frame = channel.header(raw)
                        topic.header(channel, stamp, frame, logged)
                        key = channel, frame, len(raw)
                        if channel.msgtype == TRANSFORMS and decoded[key] < DECODED:
                            decoded[key] += 1
                            frames |= {frame.name: frame for frame in _placed(channel, raw)}
            except RecordingError as error:
                problem = str(error)
        first_ns = bag.first_ns
    if sensors is None:
        sensors = {}
        with suppress(RecordingError):  # it holds no readable topic
            sensors = topics_of(path, contents, {})
    names = {topic: sensor for sensor, topics in sensors.items() for topic in topics}
    beside = listeners(sensors, contents).keys() - names.keys()
    topics = tuple(
        _topic(topic, statistics[name], names.get(name, ""), name in beside, first_ns)
        for name, topic in sorted(contents.items())
    )
    return Inspection(path, first_ns, duration, topics, _sorted(frames), problem)


def _placed(channel: Channel, raw: bytes) -> Iterator[FrameInspection]:
    """The frames that a message of transforms defines."""
    static = last(channel.topic) == STATIC
    with suppress(Exception):  # of many kinds; a replay counts what is wrong with messages
        message: Message = typestore().deserialize_cdr(channel.cdr(raw), channel.msgtype)
        for transform in message.transforms:
            name, parent = transform.child_frame_id, transform.header.frame_id
            yield FrameInspection(name.removeprefix("/"), parent.removeprefix("/"), static)


def _topic(
    topic: Topic, statistics: _Statistics, sensor: str, is_beside: bool, first_ns: int
) -> TopicInspection:
    static = last(topic.name) == STATIC
    delays = [to_seconds(delay) for delay in statistics.delays]
    return TopicInspection(
        name=topic.name,
        type=topic.msgtype,
        messages=topic.count,
        rate=statistics.rate,
        frames=tuple(statistics.frames),
        publishers=topic.publishers,
        sensor=sensor,
        unread="" if sensor else _unread(topic, is_beside),
        delay=(delays[0], delays[1]) if delays and not static else None,
        unstamped=0 if static else statistics.unstamped,
        jumps=tuple(Jump(to_seconds(at - first_ns), to_seconds(by)) for at, by in statistics.jumps),
        **_uses(topic.kind if sensor else None),
    )


def _unread(topic: Topic, is_beside: bool) -> str:
    """Why a topic becomes no readings."""
    if is_beside:
        return "read with the depth image beside it"
    if topic.name.startswith(OURS):
        return "written by contactfusion"
    if topic.name.startswith(TRUTH):
        return "the truth of a simulation: read only where `sensors` names it"
    if topic.kind is not None:
        return "left out by `sensors`"
    why = why_unread(topic).lstrip(", ").removeprefix("and ").removeprefix("but ")
    return why or "no reading is made of this type"


# Other recordings


def inspect_readings(path: Path, recording: Recording) -> Inspection:
    """The contents of an open recording, by its readings alone.

    Args:
        path: its name in the inspection.
        recording: of any format but ROS.
    """
    statistics: dict[tuple[str, type[Reading]], _Statistics] = {}
    frames: dict[str, FrameInspection] = {}
    problem = ""
    try:
        for reading in followed(recording.readings(), f"reading {path}"):
            topic = statistics.setdefault((reading.sensor, type(reading)), _Statistics())
            topic.message(to_nanoseconds(reading.stamp))
            topic.frames[reading.frame] = None
            if isinstance(reading, Transform):
                name = reading.child_frame
                frames[name] = FrameInspection(name, reading.frame, reading.static)
    except RecordingError as error:
        problem = str(error)
    first = min((topic.first for topic in statistics.values()), default=0)
    latest = max((topic.last for topic in statistics.values()), default=0)
    topics = [
        TopicInspection(
            name=sensor,
            type="",
            messages=topic.count,
            rate=topic.rate,
            frames=tuple(topic.frames),
            sensor=sensor,
            **_uses(kind),
        )
        for (sensor, kind), topic in statistics.items()
    ]
    topics.sort(key=lambda topic: (topic.name, topic.reading))
    start_ns = recording.epoch_ns + first
    return Inspection(
        path, start_ns, to_seconds(latest - first), tuple(topics), _sorted(frames), problem
    )


# What both share


class _Uses(TypedDict):
    reading: str
    generators: tuple[str, ...]
    use: str


def _uses(kind: type[Reading] | None) -> _Uses:
    """The type of the readings, and what takes them."""
    if kind is None:
        return {"reading": "", "generators": (), "use": ""}
    codec = installed_kinds().of(kind)
    offered = installed_plugins().offers("generators")
    takers = (name for name, cls in offered.items() if issubclass(kind, cls.readings))
    return {
        "reading": kind.__name__,
        "generators": tuple(sorted(takers)),
        "use": codec.use if codec else "",
    }


def _sorted(frames: Mapping[str, FrameInspection]) -> tuple[FrameInspection, ...]:
    return tuple(frames[name] for name in sorted(frames))


# For people


def as_text(inspection: Inspection) -> str:
    """An inspection as a table of topics, a tree of frames, and remarks."""
    return "\n".join(map(printable, _lines(inspection)))


def _lines(inspection: Inspection) -> Iterator[str]:
    seconds = to_seconds(inspection.start_ns)
    start = f"{seconds:.3f} s"
    if seconds > EPOCHS:
        start = f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S} UTC"
    messages, count = sum(topic.messages for topic in inspection.topics), len(inspection.topics)
    yield (
        f"{inspection.path}: {messages} messages on {count} topic{'s' * (count != 1)} in "
        f"{inspection.duration:.1f} s, from {start}"
    )
    head = ("topic", "type", "messages", "rate Hz", "frame", "delay s", "reading", "for")
    yield from _table([head, *map(_row, inspection.topics)])
    yield from _tree(inspection)
    for topic in inspection.topics:
        yield from _remarks(topic)
    if inspection.problem:
        yield f"problem: {inspection.problem}"


def _row(topic: TopicInspection) -> tuple[str, ...]:
    delay = "-" if topic.delay is None else "{:.3f} to {:.3f}".format(*topic.delay)
    uses = "; ".join(filter(None, (topic.use, ", ".join(topic.generators))))
    return (
        topic.name,
        topic.type or "-",
        str(topic.messages),
        "-" if topic.rate is None else f"{topic.rate:.4g}",
        ", ".join(frame or "(none)" for frame in topic.frames) or "-",
        delay,
        topic.reading or "-",
        uses or topic.unread or "no installed generator",
    )


def _table(rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    widths = [min(WIDEST, max(map(len, column))) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        yield "  ".join(cells).rstrip()


def _tree(inspection: Inspection) -> Iterator[str]:
    """The frames as a tree, each below its parent."""
    children: dict[str, list[FrameInspection]] = {}
    for frame in inspection.frames:
        children.setdefault(frame.parent, []).append(frame)
    roots = _roots({frame.name: frame.parent for frame in inspection.frames})
    if roots:
        yield "frames:"
    waiting = [(root, "", 1) for root in sorted(roots, reverse=True)]
    shown, deeper = set[str](), 0
    while waiting:
        name, how, depth = waiting.pop()
        if depth <= DEEPEST:
            yield f"{'  ' * depth}{name}{how}"
        else:
            deeper += 1
        shown.add(name)
        waiting += [
            (frame.name, " (static)" if frame.static else "", depth + 1)
            for frame in reversed(children.get(name, []))
            if frame.name not in shown
        ]
    if deeper:
        yield f"frames below these, more than {DEEPEST} deep: {deeper}"
    named = {frame for topic in inspection.topics if topic.generators for frame in topic.frames}
    if alone := sorted(named - shown - {""}):
        yield f"frames that no transform names: {', '.join(alone)}"


def _roots(parents: Mapping[str, str]) -> set[str]:
    """The frames that have no parent, and all that circle, by the parents of the others."""
    roots, passed = set(parents.values()) - parents.keys(), set[str]()
    for start in parents:
        frame, chain = start, dict[str, None]()
        while frame in parents and frame not in passed and frame not in chain:
            chain[frame] = None
            frame = parents[frame]
        if frame in chain:
            names = list(chain)
            roots.update(names[names.index(frame) :])
        passed.update(chain)
    return roots


def _remarks(topic: TopicInspection) -> Iterator[str]:
    """Remarks on faults of a topic's clock and publishers that may spoil a replay."""
    if topic.publishers > 1:
        yield f"{topic.name}: {topic.publishers} publishers"
    if topic.unstamped:
        yield f"{topic.name}: {topic.unstamped} headers without a stamp"
    if topic.delay and max(map(abs, topic.delay)) > FAR:
        least, greatest = topic.delay
        yield f"{topic.name}: its clock is {least:.3f} to {greatest:.3f} s behind the log"
    if topic.jumps:
        jump = topic.jumps[0]
        how = "ahead" if jump.by > 0.0 else "back"
        more = f", and {len(topic.jumps) - 1} times more" if len(topic.jumps) > 1 else ""
        by = f"{abs(jump.by):.3f} s at {jump.at:.3f} s"
        yield f"{topic.name}: its clock jumps {how} by {by}{more}"
