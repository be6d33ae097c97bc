"""A pipeline and the stream that it listens to, as one configuration describes both."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, final

from contactfusion.errors import (
    ConfigurationError,
    FrameError,
    PluginError,
    RecordingError,
    naming,
)
from contactfusion.loop import Observer, play
from contactfusion.pipeline import Ask, Pipeline, Step, asked
from contactfusion.readings import Reading
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import WHOLE, Recording, Tap, Window
from contactfusion.run.configuration import RunConfig, Setting
from contactfusion.run.inputs import Inputs, find_inputs
from contactfusion.scene import open_scene
from contactfusion.stream import Stream, Verdict


@final
class Session:
    """A pipeline and the stream that it listens to.

    Args:
        setting: the configuration, and which topics are chosen.
        played: a stream, or a recording; None: the recording or the scene of the configuration.
        window: the part of a recording that is played.
        tap: takes every message of a recording of ROS as it is.
        watched: whether to play what no generator listens to, too, so that it can be looked at.
        ask: how a generator is asked for its clouds.
        live: whether no step waits for generators in processes of their own.

    Attributes:
        stream: what is played.
        inputs: which topics of a recording feed which generator.
        pipeline: which listens.

    Raises:
        ContactFusionError: the configuration or the recording is not what it should be, or topics
            and generators can't be matched.
    """

    def __init__(
        self,
        setting: Setting,
        played: Stream | Path | None = None,
        window: Window = WHOLE,
        tap: Tap | None = None,
        watched: bool = False,
        ask: Ask = asked,
        live: bool = False,
    ) -> None:
        self.setting = setting
        whole = played if isinstance(played, Stream) else _opened(setting, played)
        self.stream, self.inputs = matched(setting, whole, window, tap, watched)
        self._broken: RecordingError | None = None
        try:
            self.pipeline = Pipeline(setting.config(self.inputs.generators), ask, live=live)
        except (ConfigurationError, FrameError, PluginError) as error:
            raise ConfigurationError(f"{setting.origin}: {error}") from error
        # as on a running robot, whose sensors report far more often than it steps
        is_recording = isinstance(self.stream, Recording)
        self.pipeline.conflates = is_recording and not self.pipeline.config.cycle.ready

    def fed(self, setting: Setting) -> Mapping[str, Any]:
        """The generators of a setting like this one, each with the sensor that feeds it."""
        generators = setting.config().generators
        sensors = {name: options.get("sensor") for name, options in self.inputs.generators.items()}
        return {
            name: {**options, "sensor": sensors[name]} if sensors.get(name) else options
            for name, options in generators.items()
        }

    def play(self, *observers: Observer) -> Iterator[Step]:
        """Play from the beginning, as `contactfusion.loop.play` does."""
        self.pipeline.reset()
        return play(self.pipeline, self.stream, observers)

    def steps(self, *observers: Observer) -> Iterator[Step]:
        """Play from the beginning; where the stream breaks off, `complain` says why."""
        self._broken = None
        try:
            yield from self.play(*observers)
        except RecordingError as error:
            self._broken = error

    def readings(self) -> Iterator[Reading]:
        """The readings from the beginning; where the stream breaks off, `complain` says why."""
        self._broken = None
        try:
            yield from (item for arrival in self.stream.arrivals() for item in arrival.readings)
        except RecordingError as error:
            self._broken = error

    def complain(self) -> None:
        """Report why the stream broke off, once what came of it until then is kept.

        Raises:
            RecordingError: it did.
        """
        if self._broken:
            raise self._broken

    def verdict(self, last: Step | None) -> Verdict | None:
        """What really happened, once all is played; None where that is not known.

        Args:
            last: the last step; None: there was none.
        """
        return None if last is None else self.stream.verdict(self.pipeline, last)

    def losses(self) -> Iterator[str]:
        """A sentence on each sensor that is listened to and of which most could not be used."""
        for trouble in self.stream.troubles():
            kind = trouble.kind
            if trouble.loss and kind and self.pipeline.listens(trouble.sensor, kind):
                yield trouble.loss

    def close(self) -> None:
        """End what the pipeline runs beside itself, and release the stream."""
        self.pipeline.close()
        self.stream.close()


def stream_of(config: RunConfig) -> Stream:
    """The recording or the scene of a configuration, at its start.

    Raises:
        ContactFusionError: its description is wrong, or it cannot be opened.
    """
    if config.scene:
        assert config.robot is not None  # a scene needs one
        return open_scene(config.scene, config.robot, config.seed, config.folder)
    try:
        return open_recording(config.recording, config.folder)
    except ConfigurationError as error:
        raise error.under("recording") from None


def _opened(setting: Setting, recording: Path | None) -> Stream:
    if recording is not None:
        return open_recording(recording)
    config = setting.run_config()
    with naming(setting.origin):
        return stream_of(config)


def matched(
    setting: Setting,
    whole: Stream,
    window: Window = WHOLE,
    tap: Tap | None = None,
    watched: bool = False,
    generators: Mapping[str, dict[str, Any]] | None = None,
) -> tuple[Stream, Inputs]:
    """What is played of a stream, and what it feeds; of a scene, all to all that listen.

    Args:
        setting: the configuration, and which topics are chosen.
        whole: the stream.
        window: the part of a recording that is played.
        tap: takes every message of a recording of ROS as it is.
        watched: whether to play what no generator listens to, too.
        generators: options of those that run, with their sensors; None: those of the setting.

    Raises:
        ContactFusionError: topics and generators can't be matched.
    """
    if not isinstance(whole, Recording):
        if window != WHOLE or setting.topics or setting.ignored:
            raise ConfigurationError(
                f"{setting.origin}: --start, --duration, --topic and --ignore are for recordings; "
                "a scene is played as it is"
            )
        return whole, Inputs({}, setting.config().generators, (), ())
    held = {name: stream.kind for name, stream in whole.streams.items()}
    if setting.ignored:
        whole = whole.without([topic.removeprefix("/") for topic in setting.ignored])
    streams = whole.streams
    names = {topic: name for name, stream in streams.items() for topic in stream.topics}
    kinds = {name: stream.kind for name, stream in streams.items()}
    ignored = {name: kind for name, kind in held.items() if name not in kinds}
    config = setting.config()
    running = generators or {}
    roles = {
        running.get(role, {}).get("sensor") or role: names.get(topic, topic)
        for role, topic in setting.topics.items()
    }
    try:
        inputs = find_inputs(
            kinds,
            generators or config.generators,
            roles,
            watched,
            ignored,
            config.cycle.on,
            whole.holder,
        )
    except PluginError as error:
        raise ConfigurationError(f"{setting.origin}: {error}") from error
    read = dict[str, tuple[str, ...]]()
    for name, sensor in inputs.sensors.items():
        read[sensor] = (*read.get(sensor, ()), *streams[name].topics)
    return whole.part(read, window, tap), inputs
