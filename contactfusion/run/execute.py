"""`contactfusion run`: plays a recording or a scene to a pipeline, and keeps what is found."""

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing
from pathlib import Path
from types import MappingProxyType
from typing import final

from contactfusion.errors import ConfigurationError, WritingError
from contactfusion.files import write_whole
from contactfusion.loop import Observer, together
from contactfusion.readings import Reading, Transform
from contactfusion.recordings.recording import WHOLE, RawMessage, Window
from contactfusion.run.configuration import setting_of_file
from contactfusion.run.outputs import SUMMARY, Output, folder_of, opened_outputs
from contactfusion.run.session import Session
from contactfusion.run.summary import Summary, refuse
from contactfusion.stopwatch import StopWatch
from contactfusion.terminal import followed, note, progress, say

Watch = Callable[[Session], AbstractContextManager[Observer]]
"""Opens a further observer of readings and steps, such as a viewer."""
LAG = 0.1
"""A lag behind `--rate` that is reported [s]."""
NO_TOPICS: Mapping[str, str] = MappingProxyType({})


def run_file(
    path: str | Path,
    recording: str | Path | None = None,
    *,
    overrides: Sequence[str] = (),
    out: str | Path | None = None,
    seed: int | None = None,
    topics: Mapping[str, str] = NO_TOPICS,
    ignored: Sequence[str] = (),
    window: Window = WHOLE,
    rate: float | None = None,
    watch: Watch | None = None,
) -> None:
    """Play a recording or a scene to the pipeline of a YAML file, and report what came.

    What was found before a plug-in, an output or the recording broke off, or before an interrupt,
    is kept.

    Args:
        path: the configuration; relative names in it start at its folder.
        recording: what is played; None: the recording or the scene of the configuration.
        overrides: fields to change, as "a.b=c".
        out: the file (.mcap, .csv or .parquet) that takes the contacts, or the folder that takes
            contacts.csv, commands.csv and summary.json; None: nothing is written.
        seed: in place of the file's; None: that of the file.
        topics: topics of a recording by role.
        ignored: topics of a recording that are not read at all.
        window: the part of a recording that is played.
        rate: speed as a multiple of real time; None: as fast as possible.
        watch: opens a further observer.

    Raises:
        ContactFusionError: the rate, the file, a plug-in, the recording, the scene or an output is
            not what it should be, or something that the configuration needs never came.
        KeyboardInterrupt: the run was interrupted.
    """
    if rate is not None and not 0.0 < rate < math.inf:
        raise ConfigurationError(f"the rate is a positive multiple of real time, not {rate}")
    path, recording = Path(path), None if recording is None else Path(recording)
    out = None if out is None else Path(out)
    setting = setting_of_file(path, overrides, seed).choosing(topics, ignored)
    folder = folder_of(out, setting.files(recording))
    outputs: list[Observer] = []
    place = folder and folder.absolute()  # a plug-in may change the folder of the process

    def copy(message: RawMessage) -> None:
        for output in outputs:
            if isinstance(output, Output):
                output.copy(message)

    stopwatch, pace = StopWatch(), Pace(rate)
    with progress(f"opening {recording or path}"):
        tap = copy if out is not None and out.suffix == ".mcap" else None
        session = Session(setting, recording, window, tap, watch is not None, stopwatch.ask)
    summary = Summary(session.pipeline)
    stopped: BaseException | None = None
    task = f"running {path}" if recording is None else f"playing {recording}"
    began = time.perf_counter()
    with closing(session):
        files = opened_outputs(session, out, folder)
        try:
            with together([*files.values(), *([watch(session)] if watch else [])]) as opened:
                outputs += opened
                stopped = _play(session, task, [Observer(pace.wait), summary.observer, *opened])
                if isinstance(stopped, ConfigurationError) and not summary.steps:
                    raise ConfigurationError(f"{path}: {stopped}") from stopped
                if not summary.came and stopped is not None:
                    raise stopped
                if not summary.came and window != WHOLE:  # an older file is not replaced
                    span = f" for {window.duration:g} s" if window.duration is not None else ""
                    raise ConfigurationError(
                        f"--start, --duration: of what is played, {recording or path} holds "
                        f"nothing from {window.start:g} s on{span}"
                    )
        except (Exception, KeyboardInterrupt) as error:
            if not summary.came or (isinstance(stopped, ConfigurationError) and not summary.steps):
                raise  # an older file stays
            if stopped is None or any(stopped is output.failure for output in outputs):
                stopped = error  # it names the file
        took = time.perf_counter() - began
    fields = summary.fields()
    verdict = session.verdict(summary.last_step) if stopped is None else None
    if verdict:
        fields["truth"] = verdict.truth
    whole = [file for file, output in zip(files, outputs, strict=False) if not output.failure]
    if folder is not None and place is not None:
        try:
            write_whole(place / SUMMARY, json.dumps(fields, indent=2) + "\n")
            whole.append(folder / SUMMARY)
        except WritingError as error:
            stopped = stopped or error
    # what is kept does not hang on whether anything can be printed
    for line in (*_lines(session, summary, took), *pace.lines(), *stopwatch.lines()):
        note(line)
    for sentence in verdict.sentences if verdict else ():
        note(f"truth: {sentence}")
    if whole:
        say(f"results: {', '.join(map(str, whole))}")
    if stopped is not None:
        raise stopped
    complaints = [*session.losses(), *summary.complaints()]
    refuse(path, session.inputs.missing or complaints)


def _play(session: Session, task: str, observers: Sequence[Observer]) -> BaseException | None:
    """Play to the end; what stopped it, so that what was found before it is kept."""
    try:
        for _ in followed(session.play(*observers), task, session.stream.end):
            pass
    except (Exception, KeyboardInterrupt) as error:
        return error
    return None


@final
class Pace:
    """Waits until each reading is due.

    Args:
        rate: speed as a multiple of real time; None: as fast as possible.
    """

    def __init__(self, rate: float | None) -> None:
        self._rate = rate
        self._began: float | None = None
        self._behind = 0.0

    def wait(self, reading: Reading) -> None:
        """Wait until a reading is due."""
        if self._rate is None or isinstance(reading, Transform):  # transforms come ahead
            return
        due, now = reading.stamp / self._rate, time.perf_counter()
        self._began = now - due if self._began is None else self._began
        ahead = self._began + due - now
        self._behind = max(self._behind, -ahead)
        time.sleep(max(0.0, ahead))

    def lines(self) -> Iterator[str]:
        """A line where the pipeline could not keep up."""
        if self._behind > LAG:
            yield f"it fell behind --rate {self._rate:g} by up to {self._behind:.1f} s"


def _lines(session: Session, summary: Summary, took: float) -> Iterator[str]:
    """What came, what of it was of use, and what was found."""
    troubles: dict[str, str] = {}
    for trouble in session.stream.troubles():
        before = f"{troubles[trouble.sensor]}; " if trouble.sensor in troubles else ""
        troubles[trouble.sensor] = before + trouble.note
    yield from summary.tally.table(troubles)
    yield from (*session.inputs.taken, *session.inputs.missing)
    unplaced = (item for item in session.pipeline.unplaced.items() if item[1])
    if counts := ", ".join(f"{count} clouds of '{name}'" for name, count in unplaced):
        yield f"missing transforms: {counts} were refused"
    yield from summary.lines()
    span = summary.tally.span
    speed = f", {span / took:.1f} times real time" if took > 0.0 else ""
    yield f"{span:.1f} s played in {took:.1f} s{speed}"
