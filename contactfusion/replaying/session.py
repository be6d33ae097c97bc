"""One replay: a pipeline on a recording, from its beginning, as often as one likes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

from contactfusion.errors import (
    ConfigurationError,
    FrameError,
    PluginError,
    RecordingError,
    name_hint,
)
from contactfusion.loop import Observer, play
from contactfusion.pipeline import Ask, Pipeline, Step, asked
from contactfusion.readings import Reading, Transform
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import Recording
from contactfusion.recordings.ros import RosRecording, Tap
from contactfusion.replaying.configuration import Setting
from contactfusion.replaying.inputs import Inputs, find_inputs
from contactfusion.stream import Arrival, Stream


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


@final
class Session(Stream):
    """A pipeline and the recording that it listens to.

    Args:
        setting: the configuration, and which topics are chosen.
        path: the recording.
        window: the part that is played.
        tap: who hears every message of a ROS recording as it is.
        watched: whether to play what no generator listens to, too, so that it can be looked at.
        ask: how a generator is asked for its clouds.

    Raises:
        ContactFusionError: the configuration or the recording is not what it should be, or topics
            and generators can't be matched.
    """

    def __init__(
        self,
        setting: Setting,
        path: Path,
        window: Window = WHOLE,
        tap: Tap | None = None,
        watched: bool = False,
        ask: Ask = asked,
    ) -> None:
        self.recording, self.inputs = _opened(setting, path, window, tap, watched)
        self.setting = setting
        self._broken: RecordingError | None = None
        try:
            self.pipeline = Pipeline(self.setting.config(self.inputs.generators), ask)
        except (ConfigurationError, FrameError, PluginError) as error:
            raise ConfigurationError(f"{setting.origin}: {error}") from error

    def fed(self, setting: Setting) -> Mapping[str, Any]:
        """Give the generators of a setting like this one, each with the sensor that feeds it."""
        generators = setting.config().generators
        sensors = {name: options.get("sensor") for name, options in self.inputs.generators.items()}
        return {
            name: {**options, "sensor": sensors[name]} if sensors.get(name) else options
            for name, options in generators.items()
        }

    def readings(self) -> Iterator[Reading]:
        """The readings of the recording, in their order.

        A recording that breaks off ends there, and `complain` says why.
        """
        return (reading for arrival in self.arrivals() for reading in arrival.readings)

    def arrivals(self) -> Iterator[Arrival]:
        """The readings as they arrive; transforms come ahead."""
        self._broken = None
        try:
            yield from self.recording.arrivals()
        except RecordingError as error:
            self._broken = error

    def complain(self) -> None:
        """Report why the recording broke off, once what came of it until then is kept.

        Raises:
            RecordingError: it did.
        """
        if self._broken:
            raise self._broken

    def steps(self, *observers: Observer) -> Iterator[Step]:
        """Play from the beginning."""
        self.pipeline.reset()
        return play(self.pipeline, self, observers)

    def close(self) -> None:
        """End what the pipeline runs beside itself."""
        self.pipeline.close()


def _opened(
    setting: Setting, path: Path, window: Window, tap: Tap | None, watched: bool
) -> tuple[Recording, Inputs]:
    whole = open_recording(path)
    if not isinstance(whole, RosRecording):
        topics = _without(path, whole.topics, setting.ignored)
        ignored = {name: kind for name, kind in whole.topics.items() if name not in topics}
        inputs = _inputs(setting, topics, setting.told, watched, ignored)
        return _Part(whole, inputs.sensors, window), inputs
    held = {name: stream.kind for name, stream in whole.streams.items()}
    if setting.ignored:
        whole = whole.without([f"/{topic.removeprefix('/')}" for topic in setting.ignored])
    streams = whole.streams
    names = {topic: name for name, stream in streams.items() for topic in stream.topics}
    told = {role: names.get(topic, topic) for role, topic in setting.told.items()}
    kinds = {name: stream.kind for name, stream in streams.items()}
    ignored = {name: kind for name, kind in held.items() if name not in kinds}
    inputs = _inputs(setting, kinds, told, watched, ignored)
    heard = dict[str, tuple[str, ...]]()
    for name, sensor in inputs.sensors.items():
        heard[sensor] = (*heard.get(sensor, ()), *streams[name].topics)
    return whole.part(heard, window.start, window.duration, tap), inputs


def _without(
    path: Path, topics: Mapping[str, type[Reading]], ignored: Sequence[str]
) -> Mapping[str, type[Reading]]:
    """The topics that may be read."""
    names = [topic.removeprefix("/") for topic in ignored]
    for name in names:
        if name not in topics:
            raise RecordingError(
                f"{path} has no topic '{name}' to ignore; {name_hint(name, topics, 'topics')}"
            )
    return {topic: kind for topic, kind in topics.items() if topic not in names}


def _inputs(
    setting: Setting,
    topics: Mapping[str, type[Reading]],
    told: Mapping[str, str],
    watched: bool,
    ignored: Mapping[str, type[Reading]],
) -> Inputs:
    try:
        return find_inputs(topics, setting.config().generators, told, watched, ignored)
    except PluginError as error:
        raise ConfigurationError(f"{setting.origin}: {error}") from error


@final
class _Part(Recording):
    """The wanted sensors of a recording under the names that are wanted, for a while."""

    def __init__(self, whole: Recording, sensors: Mapping[str, str], window: Window) -> None:
        self._whole, self._window = whole, window
        self._names = sensors
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
