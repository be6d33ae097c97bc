"""`contactfusion replay`: contacts on a recording, and a table of what came and what did not."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

from contactfusion.errors import ConfigurationError, WritingError
from contactfusion.loop import Observer
from contactfusion.readings import Reading, Transform
from contactfusion.recordings.messages import ros_name
from contactfusion.recordings.ros import RawMessage, RosRecording
from contactfusion.replaying.configuration import setting_of_file
from contactfusion.replaying.outputs import About, Output, open_output
from contactfusion.replaying.session import WHOLE, Session, Window
from contactfusion.replaying.tally import Tally
from contactfusion.step_summary import Summary, refuse
from contactfusion.stopwatch import StopWatch
from contactfusion.terminal import followed, is_quiet, note, progress

Watch = Callable[[Session], AbstractContextManager[Observer]]
"""Gives who else sees readings and steps, such as a viewer."""


@final
@dataclass(frozen=True)
class Options:
    """What is played, and how.

    Attributes:
        configuration: a YAML file.
        recording: what is played.
        overrides: fields of the configuration to change, as "a.b=c".
        topics: topics by role.
        window: the part that is played.
        rate: so many times as fast as it was recorded; None: as fast as it goes.
        out: the file that takes the contacts; None: none does.
        ignored: topics that are not read at all.
    """

    configuration: Path
    recording: Path
    overrides: Sequence[str] = ()
    topics: Mapping[str, str] = field(default_factory=dict)
    window: Window = WHOLE
    rate: float | None = None
    out: Path | None = None
    ignored: Sequence[str] = ()


def replay(options: Options, watch: Watch | None = None) -> None:
    """Play a recording to a pipeline, keep its contacts, and tell what came.

    What was found before the recording or a plug-in broke off, or before one interrupts, is kept.

    Args:
        options: what is played, and how.
        watch: gives who else sees readings and steps.

    Raises:
        ContactFusionError: configuration, recording or output are not what they should be, or
            something that the configuration needs never came.
        KeyboardInterrupt: somebody interrupted.
    """
    _refuse_itself(options)
    setting = setting_of_file(options.configuration, options.overrides)
    setting = setting.choosing(options.topics, options.ignored)
    outputs: list[Observer] = []

    def copy(message: RawMessage) -> None:
        for output in outputs:
            if isinstance(output, Output):
                output.message(message)

    wants_all = options.out is not None and options.out.suffix == ".mcap"
    tap = copy if wants_all else None
    stopwatch = StopWatch()
    with progress(f"opening {options.recording}"):
        session = Session(
            setting,
            options.recording,
            options.window,
            tap,
            watched=watch is not None,
            ask=stopwatch.ask,
        )
    tally, summary = Tally(), Summary(session.pipeline)
    pace = _pace(options.rate)
    counts = Observer(tally.add, summary.add)
    stopped: BaseException | None = None
    about: About | None = None
    began = time.perf_counter()
    try:
        with ExitStack() as stack:
            stack.callback(session.close)
            if options.out is not None:
                about = _about(session, options.out)
                outputs.append(stack.enter_context(open_output(options.out, about)))
            if watch is not None:
                outputs.append(stack.enter_context(watch(session)))
            try:
                task = f"replaying {options.recording}"
                steps = session.steps(pace, counts, *outputs)
                for _ in followed(steps, task, session.recording.end):
                    pass
            except (WritingError, OSError):  # the output names its file
                raise
            except (Exception, KeyboardInterrupt) as error:
                stopped = error
            if not _came(tally):
                if stopped is not None:
                    raise stopped
                _refuse_emptiness(options, session)
    except WritingError as error:
        stopped = error
    if not is_quiet():
        _tell(session, tally, summary, time.perf_counter() - began)
        for line in stopwatch.lines():
            print(line)
    for topic, kind in about.passed_over.items() if about else ():
        note(f"not copied: {topic}, as nothing defines {kind}")
    if options.out is not None and not isinstance(stopped, WritingError):
        print(f"results: {options.out}")
    if stopped is not None:
        raise stopped
    session.complain()
    _refuse_silence(options.configuration, session, tally, summary)


def _refuse_itself(options: Options) -> None:
    """Make sure that the recording is not what is written over."""
    if options.out is None:
        return
    out, recording = options.out.resolve(), options.recording.resolve()
    if out == recording or (recording.is_dir() and recording in out.parents):
        raise ConfigurationError(
            f"--out: {options.out} would replace the recording that is played; name another file"
        )


def _came(tally: Tally) -> bool:
    """Tell whether anything came but transforms."""
    return any(kind is not Transform for _, kind in tally.kinds)


def _refuse_emptiness(options: Options, session: Session) -> None:
    """Make sure that something came after the start, before an older file is replaced."""
    session.complain()
    if options.window.start:
        raise ConfigurationError(
            f"--start: of what is played, {options.recording} holds nothing after "
            f"{options.window.start:g} s"
        )


def _about(session: Session, out: Path) -> About:
    setting, copies = session.setting, isinstance(session.recording, RosRecording)
    if not copies:  # readings go to topics that are called like their sensors, and no others do
        sensors = session.inputs.sensors
        told = {
            role: ros_name(f"/{sensors[topic.removeprefix('/')]}")
            for role, topic in setting.told.items()
        }
        setting = replace(setting, told=told, ignored=())
    return About(session.recording.epoch_ns, setting.text(beside=out.parent), copies)


def _pace(rate: float | None) -> Observer:
    """What waits until each reading is due."""
    began: list[float] = []

    def wait(reading: Reading) -> None:
        assert rate is not None
        if not began:
            began.append(time.perf_counter() - reading.stamp / rate)
        time.sleep(max(0.0, began[0] + reading.stamp / rate - time.perf_counter()))

    return Observer() if rate is None else Observer(wait)


def _tell(session: Session, tally: Tally, summary: Summary, took: float) -> None:
    recording = session.recording
    for line in tally.table(_troubles(recording) if isinstance(recording, RosRecording) else {}):
        print(line)
    for line in (*session.inputs.taken, *session.inputs.missing):
        print(line)
    unplaced = (item for item in session.pipeline.unplaced.items() if item[1])
    if counts := ", ".join(f"{count} clouds of '{name}'" for name, count in unplaced):
        print(f"missing transforms: {counts} were refused")
    for line in summary.lines():
        print(line)
    span = tally.span
    speed = f", {span / took:.1f} times real time" if took > 0.0 else ""
    print(f"{span:.1f} s of recording in {took:.1f} s{speed}")


def _troubles(recording: RosRecording) -> dict[str, str]:
    """Report by sensor what its reader met."""
    troubles = {}
    for sensor, topics in recording.sensors.items():
        said = {topic: ", ".join(_met(recording, topic)) for topic in topics}
        several = len(topics) > 1
        told = [f"{topic}: {one}" if several else one for topic, one in said.items() if one]
        troubles[sensor] = "; ".join(told)
    return troubles


def _met(recording: RosRecording, topic: str) -> Iterator[str]:
    """Report what the reader of a topic met."""
    heard, publishers = recording.tally[topic], recording.contents[topic].publishers
    if publishers > 1:
        yield f"{publishers} publishers"
    if heard.out_of_order:
        yield f"{heard.out_of_order} out of order"
    if heard.unreadable:
        yield f"{heard.unreadable} unreadable: {heard.why_unreadable}"
    if heard.refused:
        yield f"{heard.refused} refused: {heard.why_refused}"


def _refuse_silence(path: Path, session: Session, tally: Tally, summary: Summary) -> None:
    """Make sure that all came that the configuration waits for, and that most of it was of use."""
    complaints = [*_lost(session), *summary.complaints(tally.kinds)]
    refuse(path, session.inputs.missing or complaints)


def _lost(session: Session) -> Iterator[str]:
    """Report the sensors that the pipeline listens to and of which less than half could be used."""
    recording = session.recording
    if not isinstance(recording, RosRecording):
        return
    for sensor, topics in recording.sensors.items():
        for topic in topics:
            heard, kind = recording.tally[topic], recording.contents[topic].kind
            if kind is None or not session.pipeline.listens(sensor, kind):
                continue
            if heard.refused + heard.unreadable > heard.readings:
                some = f"only {heard.readings} readings" if heard.readings else "nothing"
                whose = f"'{sensor}'" if len(topics) == 1 else f"'{sensor}', {topic},"
                yield f"of {whose} {some} could be used: {', '.join(_met(recording, topic))}"
