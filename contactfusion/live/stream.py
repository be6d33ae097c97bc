"""A running robot as a stream: its topics become readings, its clock the steps."""

import functools
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, final

from contactfusion.assembly import AnyGenerator
from contactfusion.changes import Change
from contactfusion.errors import ConfigurationError, RecordingError
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator.sources import EventKind
from contactfusion.live.clock import Clock, SimulatedTime, machine_time
from contactfusion.live.config import LiveConfig
from contactfusion.live.discovery import contents_of, mismatch, written_by_others
from contactfusion.live.queue import Packet, Queue
from contactfusion.live.transport import End, Quality, Transport
from contactfusion.pipeline import takes
from contactfusion.readings import JointState, Odometry, Reading, Transform
from contactfusion.readings.codec import Codec
from contactfusion.readings.messages import Message, header, message
from contactfusion.readings.poses import STATIC
from contactfusion.readings.registry import installed_kinds
from contactfusion.recordings.messages import defined, typestore
from contactfusion.recordings.recording import (
    WHOLE,
    RawMessage,
    Recording,
    SensorTopics,
    Tap,
    Window,
)
from contactfusion.recordings.ros.contents import streams_of, topics_of
from contactfusion.recordings.ros.delivery import CHANGES, CYCLES, Delivery, answers
from contactfusion.recordings.ros.order import TopicState, TopicTally
from contactfusion.recordings.ros.topics import Camera, Topic, last, listeners
from contactfusion.stream import LONGEST_STEP_BACK, Arrival, Trouble
from contactfusion.time import NANOSECONDS_PER_SECOND, to_nanoseconds

if TYPE_CHECKING:
    from contactfusion.controller import Command
    from contactfusion.pipeline import Pipeline

NETWORK = Path("the network")
"""What stands for a file in sentences on topics."""
TIMED = 256
"""Number of newest steps whose duration is kept."""
OLD = 1.0
"""A reading that is so much older than its message is of another clock, and says nothing of now
[s]."""
IDLE = 0.02
"""The longest wait for a message, before the loop looks at its clock [s]."""
YIELD = 5e-5
"""A pause in which threads that receive are given the interpreter [s]."""
END: Final = object()
"""In the queue: the stream ends."""


@final
class LiveStream(Recording):
    """The topics of a running robot.

    Messages are passed on in the order of their arrival. Steps are due at the period of the cycle
    policy by the clock of this machine (those that are missed are skipped), after the reading that
    it names (readings that came meanwhile share a step), or when all sources have reported.

    Args:
        transport: of the messages.
        config: where commands go, and when they are zero.
        sensors: topics by the names of the sensors that are listened to; None: none yet.
        tap: takes every message in its order, and the instants of steps and changes.
        clock: the time now [ns]; stamps of messages are by it.
    """

    has_messages = True
    holder = str(NETWORK)

    def __init__(
        self,
        transport: Transport,
        config: LiveConfig,
        sensors: Mapping[str, Sequence[str]] | None = None,
        tap: Tap | None = None,
        clock: Clock = machine_time,
    ) -> None:
        self._transport, self._config, self._tap, self._clock = transport, config, tap, clock
        self._ignored: tuple[str, ...] = ()
        self.queue = Queue()
        self.contents: dict[str, Topic] = {}
        """The topics that others write, by name."""
        self._reliable: dict[str, bool] = {}
        """Whether all writers of a topic are reliable, by name."""
        self.unread: dict[str, str] = {}
        """Why topics that could be of use can't be read, by name, as clauses."""
        self.sensors: Mapping[str, Sequence[str]] = sensors or {}
        """Those that are listened to, by the names of their sensors."""
        self.states: dict[str, TopicState] = {}
        """Those that are listened to, by name."""
        self._types: dict[str, str] = {}
        self._asked: dict[str, Quality] = {}
        """The quality of service that was asked for, by topic."""
        self._rematched = False
        """Whether what is on the network was matched since the loop began."""
        self.arrived: dict[str, int] = {}
        """The arrival of the last message by topic [ns since 1970]."""
        self.obey: Callable[[Command | None], object] = lambda command: None
        """Takes the command of a step."""
        self.idle: Callable[[int], object] = lambda now: None
        """Called each time that the loop comes round, with the time [ns since 1970]."""
        self.rematch: Callable[[LiveStream], Mapping[str, Sequence[str]]] = lambda stream: {}
        """Finds what is listened to, when topics come or go."""
        self.overruns = 0
        """Number of steps that were missed."""
        self._unnoted, self._noted_at = 0, 0
        """Of these, those that were not noted yet; and when some were last [ns since 1970]."""
        self.took = deque[float](maxlen=TIMED)
        """The durations of the newest steps, from readings to command [s]."""
        self.epoch_ns = self._logged = self._now = self._began = clock()
        self.look()

    def look(self) -> None:
        """Take note of what is on the network now."""
        self.refresh(self._transport.ends())

    def refresh(self, ends: Sequence[End]) -> bool:
        """Take note of what is on the network; whether its topics have changed."""
        contents = contents_of(ends)
        self.unread = {
            name: why
            for name, group in written_by_others(ends).items()
            if name not in self._ignored and (why := mismatch(group))
        }
        for name in self._ignored:
            contents.pop(name, None)
        before, self.contents = (self.contents, self._reliable), contents
        self.topics = {name: stream.kind for name, stream in self.streams.items()}
        self._reliable = {
            name: all(end.quality.reliable for end in ends if end.topic == name and end.writes)
            for name in contents
        }
        return before != (self.contents, self._reliable)

    @property
    def streams(self) -> Mapping[str, SensorTopics]:
        """All topics that can be read, by the names of their sensors."""
        if not any(topic.kind for topic in self.contents.values()):
            return {}
        return streams_of(topics_of(NETWORK, self.contents, {}), self.contents)

    def without(self, topics: Sequence[str]) -> "LiveStream":
        """The same without some topics, which need not be there yet."""
        made = LiveStream(self._transport, self._config, tap=self._tap, clock=self._clock)
        made._ignored = tuple(f"/{topic.removeprefix('/')}" for topic in topics)
        made.look()
        return made

    def part(
        self, sensors: Mapping[str, Sequence[str]], window: Window = WHOLE, tap: Tap | None = None
    ) -> "LiveStream":
        """The stream that listens to some topics."""
        made = LiveStream(self._transport, self._config, sensors, tap, self._clock)
        made._ignored = self._ignored
        return made

    def readings(self) -> Iterator[Reading]:
        """The readings as they arrive, once there is a pipeline."""
        for arrival in self.arrivals():
            yield from arrival.readings

    def begin(self, pipeline: "Pipeline") -> None:
        """Prepare to deliver to a pipeline.

        Raises:
            ConfigurationError: it has faults, which act on what is played.
        """
        if pipeline.config.faults:
            raise ConfigurationError("faults act on what `run` plays, not on a robot", "faults")
        self._pipeline = pipeline
        self._delivery = Delivery(pipeline, self.epoch_ns)

    def discovered(self, ends: Sequence[End]) -> None:
        """Listen to what has come on the network, also before the loop began."""
        changed = self.refresh(ends)
        if changed or not self._rematched:
            self._rematched = True
            found = self.rematch(self)
            gone = {  # whose silence counts on
                sensor: [topic for topic in topics if topic not in self.contents]
                for sensor, topics in self.sensors.items()
            }
            self.sensors = {
                sensor: [*dict.fromkeys((*found.get(sensor, ()), *gone.get(sensor, ())))]
                for sensor in {**found, **gone}
            }
            self.listen()

    def end_soon(self) -> None:
        """End after what the loop has in its hands; from any thread, or a signal handler."""
        self.queue.put(END)

    def arrivals(self) -> Iterator[Arrival]:
        """What arrives, and the steps that are due, until `end_soon`."""
        self.listen()
        self._began = self._time()
        policy = self._pipeline.config.cycle
        every = None if policy.every is None else to_nanoseconds(policy.every)
        named = None if policy.on is None else installed_kinds().find(policy.on)
        due_at = self._clock() + (every or 0)
        triggered, behind = 0, 0
        while True:
            now = self._time()
            self.idle(now)
            wait = IDLE if every is None else min(IDLE, max(0, due_at - now) / 1e9)
            what = self.queue.take(wait)
            behind = 0 if what is END else behind - 1
            if isinstance(what, Packet):
                for reading in self._delivered(what):
                    yield Arrival(None, (reading,))
                    if _is_named(reading, policy.on, named):
                        if not triggered:  # what came during the last step shares this one
                            time.sleep(YIELD)
                            behind = len(self.queue)
                        triggered += 1
                self._record_answers()
            elif isinstance(what, Change):
                if what.outcome.set_running_or_notify_cancel():  # who asked still waits
                    self._mark(CHANGES, message("std_msgs/String", data=what.text))
                    yield Arrival(None, (), changes=(what,))
            elif callable(what):
                what()
            now = self._time()
            if every is not None:
                due = now >= due_at
                missed = (now - due_at) // every if due else 0
                due_at += (missed + 1) * every if due else 0
            elif policy.on is not None:
                due, missed = triggered > 0 and behind <= 0, max(0, triggered - 1)
            else:
                due = self._pipeline.integrator.ready(self._delivery.seconds(now))
                missed = 0
            # without a period, what has waited for long enough might never be refused
            if due or (every is None and self._delivery.overdue(now)):
                if missed and due:
                    self._overrun(missed)
                triggered = 0
                yield from self._step()
            if what is END:
                return

    def send(self, command: "Command | None") -> None:
        """Pass on the command of a step."""
        self.obey(command)

    def stale(self, now: int) -> str:
        """Why what the pipeline believes is not fresh, as a clause; empty where it is.

        What can't be used keeps nothing fresh: damaged messages, NaN, stamps of another clock,
        readings of which all that is detected lacks a transform.

        Args:
            now: [ns since 1970].
        """
        evidence, state = self._listened()
        limit = to_nanoseconds(self._config.stale_after)
        newest = max(
            (self.arrived.get(topic, self._began) for topic in evidence), default=self._began
        )
        if now - newest > limit:
            return f"no sensor of contacts has reported for {(now - newest) / 1e9:.2f} s"
        for topic in state:
            silent = now - self.arrived.get(topic, now)
            if silent > limit:
                return f"{topic} has been silent for {silent / 1e9:.2f} s"
        return ""

    def troubles(self) -> Iterator[Trouble]:
        """What it met in the messages of each topic."""
        for topic, state in self.states.items():
            kind, tally = state.listener.kind, state.tally
            dropped = self.queue.dropped[topic]
            met = (
                (dropped, "dropped: they come faster than they are taken"),
                (tally.unreadable, f"unreadable: {tally.why_unreadable}"),
                (tally.refused, f"refused: {tally.why_refused}"),
            )
            notes = [f"{count} {what}" for count, what in met if count]
            if topic in self.contents and (several := self.contents[topic].publishers) > 1:
                notes.append(f"{several} publishers")
            if notes and kind is not None:
                yield Trouble(topic.removeprefix("/"), kind, ", ".join(notes))

    def close(self) -> None:
        """Leave the network."""
        self._transport.close()

    def listen(self) -> None:
        """Listen to the topics of the sensors that are there, and no longer to others."""
        there = {
            sensor: [name for name in topics if (known := self.contents.get(name)) and known.kind]
            for sensor, topics in self.sensors.items()
        }
        found = listeners(there, self.contents)
        for topic in self.states.keys() - found.keys():
            if topic in self.contents:  # a publisher that is gone may come back
                self._transport.ignore(topic)
                del self.states[topic]
        for topic, listener in found.items():
            before = self.states.get(topic)
            quality = Quality(self._reliable[topic], last(topic) == STATIC)
            msgtype = self.contents[topic].msgtype
            # a reader that asks for reliability hears no writer that came back without
            if before is not None and (
                self._asked[topic].reliable > quality.reliable or self._types[topic] != msgtype
            ):
                self._transport.ignore(topic)
                del self.states[topic]
            if topic not in self.states:
                self._types[topic], self._asked[topic] = msgtype, quality
                take = functools.partial(self.queue.packet, topic)
                try:
                    self._transport.listen(topic, msgtype, quality, take)
                except RecordingError as error:
                    self.unread[topic] = str(error)
                    continue
            if before and isinstance(listener, Camera) and isinstance(before.listener, Camera):
                listener.beside = before.listener.beside  # camera_info may have come only once
            tally = before.tally if before else TopicTally()
            self.states[topic] = TopicState(topic, listener, tally, {})

    def now(self) -> float:
        """The time since the epoch [s]."""
        return (self._clock() - self.epoch_ns) / NANOSECONDS_PER_SECOND

    def _time(self) -> int:
        """The time, which never falls [ns].

        Raises:
            RecordingError: the clock did, as where a simulation begins again.
        """
        now = self._clock()
        if now < self._now - to_nanoseconds(LONGEST_STEP_BACK):
            before, after = (stamp / NANOSECONDS_PER_SECOND for stamp in (self._now, now))
            raise RecordingError(
                f"the clock fell from {before:.3f} s to {after:.3f} s, as where a simulation "
                "begins again; so must this"
            )
        self._now = max(self._now, now)
        return self._now

    def _delivered(self, packet: Packet) -> Iterator[Reading]:
        """The readings that a message makes or places."""
        state = self.states.get(packet.topic)
        if state is None:
            return
        simulated = isinstance(self._clock, SimulatedTime)
        arrived = self._time() if simulated else packet.arrived
        state.tally.messages += 1
        try:
            sent = typestore().deserialize_cdr(packet.cdr, self._types[packet.topic])
        except Exception as error:  # rosbags meets damage with errors of many kinds
            state.tally.cannot_read(error)
            return
        logged = self._log(packet.topic, self._types[packet.topic], packet.cdr, arrived)
        tally, ages = state.tally, list[float]()
        useless = tally.refused + tally.unreadable
        for reading in self._delivery.of(state, sent, logged):
            ages.append(self._delivery.seconds(arrived) - reading.stamp)
            yield reading
        # what can't be used or placed, or is of another clock, is no sign of life
        if (
            tally.refused + tally.unreadable == useless
            and min(ages, default=0.0) <= OLD
            and not self._is_unplaced(packet.topic)
        ):
            self.arrived[packet.topic] = arrived

    def _step(self) -> Iterator[Arrival]:
        """A step now, with the readings that have waited for long enough."""
        self._pipeline.collect()
        self._record_answers()
        now = self._time()
        for reading in self._delivery.before_step(now):
            yield Arrival(None, (reading,))
        self._record_answers()
        self._mark(CYCLES, header(now, ""))
        began = time.perf_counter()
        yield Arrival(self._delivery.seconds(now), (), due=True)
        self.took.append(time.perf_counter() - began)

    def _record_answers(self) -> None:
        for text in answers(self._pipeline):
            self._mark(CHANGES, message("std_msgs/String", data=text))

    def _mark(self, topic: str, sent: Message) -> None:
        """Record the instant of a step, or a change."""
        if self._tap is not None:
            msgtype = sent.__msgtype__
            self._log(topic, msgtype, bytes(typestore().serialize_cdr(sent, msgtype)), self._now)

    def _log(self, topic: str, msgtype: str, cdr: bytes, arrived: int) -> int:
        """Record a message; its stamp in the log, which rises [ns since 1970]."""
        self._logged = max(self._logged + 1, arrived)
        if self._tap is not None:
            self._tap(RawMessage(topic, msgtype, defined(msgtype), self._logged, cdr))
        return self._logged

    def _overrun(self, missed: int) -> None:
        self.overruns += missed
        self._unnoted += missed
        if self._now - self._noted_at < NANOSECONDS_PER_SECOND:
            return
        steps = "a step was" if self._unnoted == 1 else f"{self._unnoted} steps were"
        text = f"{steps} missed: the loop is slow"
        self._pipeline.integrator.note(EventKind.OVERRUN, "cycle", text)
        self._unnoted, self._noted_at = 0, self._now

    def _listened(self) -> tuple[list[str], list[str]]:
        """The topics of evidence, and those of the robot's state that have come."""
        evidence, state = [], []
        for topic, known in self.states.items():
            kind = known.listener.kind
            if kind is None:
                continue
            if self._detectors(topic):
                evidence.append(topic)
            if issubclass(kind, JointState | Odometry):
                if self._pipeline.listens(self._sensor(topic), kind):
                    state.append(topic)
        return evidence, state

    def _sensor(self, topic: str) -> str:
        """The name of the sensor of a topic; empty where none is."""
        return next((sensor for sensor, names in self.sensors.items() if topic in names), "")

    def _detectors(self, topic: str) -> list[AnyGenerator]:
        """The generators that detect contacts by a topic.

        Joints are a sensor of contacts for an arm without skin, what places the robot never is.
        """
        kind, sensor = self.states[topic].listener.kind, self._sensor(topic)
        if kind is None or issubclass(kind, Odometry | Transform):
            return []
        return [
            generator
            for generator in self._pipeline.generators.values()
            if takes(generator, sensor, kind)
            and HypothesisKind.REGULAR in generator.sources.values()
        ]

    def _is_unplaced(self, topic: str) -> bool:
        """Whether no transform places what any generator detects by a topic of a sensor."""
        lost = self._pipeline.lost
        if not lost or self.states[topic].listener.kind is JointState:  # the robot's state, too
            return False
        detectors = self._detectors(topic)
        return bool(detectors) and all(each.name in lost for each in detectors)


def _is_named(reading: Reading, on: str | None, codec: "Codec[Reading] | None") -> bool:
    """Whether a step is due after a reading."""
    return on is not None and (
        reading.sensor == on or (codec is not None and isinstance(reading, codec.kind))
    )
