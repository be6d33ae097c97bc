"""The one loop: plays any stream through a pipeline, while observers look on."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

from contactfusion.errors import RecordingError
from contactfusion.faults import broken
from contactfusion.files import uninterrupted
from contactfusion.readings import Reading
from contactfusion.readings.registry import installed_kinds
from contactfusion.stream import LONGEST_STEP_BACK, Arrival, Stream, arrival_of

if TYPE_CHECKING:
    from contactfusion.pipeline import Pipeline, Step

T = TypeVar("T")
PAUSE = 60.0
"""When nothing is read for longer, no step is made until the one before the next reading [s]."""


def _ignore(what: object) -> None:
    """Take something, and do nothing."""


@dataclass(eq=False)
class Observer:
    """What looks on while a stream is played.

    Attributes:
        reading: takes each reading as the stream gives it, before faults change it.
        step: takes each step, once its command is sent.
        failure: what it raised; it takes nothing from then on.
    """

    reading: Callable[[Reading], object] = _ignore
    step: Callable[["Step"], object] = _ignore
    failure: Exception | None = field(default=None, init=False)


def play(
    pipeline: "Pipeline", stream: Stream | Iterable[Reading], observers: Sequence[Observer] = ()
) -> Iterator["Step"]:
    """Play a stream through a pipeline, with the faults of its configuration.

    The pipeline steps where the stream says that a step is due, else as its cycle policy says. A
    stream that breaks off is played to there, and an observer that fails harms no other: what they
    raised is raised after the last step.

    Args:
        pipeline: which listens.
        stream: what is played, from its beginning; readings alone arrive at their stamps.
        observers: which look on.

    Yields:
        Each step, once its command is sent and all observers have taken it.

    Raises:
        ConfigurationError: the pipeline does not fit the stream, or a fault a reading, or the
            stream cannot take a command.
        RecordingError: the stream broke off, or its clock jumped back.
    """
    if isinstance(stream, Stream):
        stream.begin(pipeline)
        arrivals = stream.arrivals()
    else:
        arrivals = map(arrival_of, stream)
    config, breaks = pipeline.config, list[RecordingError]()
    arrivals = _observed(_until_it_breaks(arrivals, breaks), observers)
    if config.faults:
        arrivals = broken(arrivals, config.faults, config.seed)
    every = config.cycle.every
    steps = _on(pipeline, arrivals) if every is None else _every(pipeline, every, arrivals)
    for step in steps:
        if isinstance(stream, Stream):
            stream.send(step.command)
        for observer in observers:
            _show(observer, observer.step, step)
        yield step
    for error in (*breaks, *(observer.failure for observer in observers)):
        if error is not None:
            raise error


@contextmanager
def together(outputs: Iterable[AbstractContextManager[Observer]]) -> Iterator[list[Observer]]:
    """Open outputs so that each is closed by itself: one that failed leaves the others whole.

    Args:
        outputs: each ends with what its own observer raised, if anything.

    Yields:
        The observers that are opened.

    Raises:
        Exception: the first that an output raised at its end.
        KeyboardInterrupt: once all are closed, if it came while they were.
    """
    opened: list[tuple[AbstractContextManager[Observer], Observer]] = []
    raised: BaseException | None = None
    try:
        for output in outputs:
            opened.append((output, output.__enter__()))
        yield [observer for _, observer in opened]
    except BaseException as error:
        raised = error
        raise
    finally:
        failures = list[Exception]()
        with uninterrupted():
            for output, observer in reversed(opened):
                cause = raised or observer.failure
                try:
                    output.__exit__(type(cause) if cause else None, cause, None)
                except Exception as met:  # such as an error of the system, with the file's name
                    observer.failure = observer.failure or met
                    failures.append(met)
                else:
                    failures += [observer.failure] if observer.failure else []
        if failures and raised is None:
            raise failures[-1]


def _show(observer: Observer, take: Callable[[T], object], what: T) -> None:
    """Pass something on to an observer that has not failed."""
    if observer.failure is None:
        try:
            take(what)
        except Exception as error:  # no observer harms another, or the run
            observer.failure = error


def _until_it_breaks(
    arrivals: Iterable[Arrival], breaks: list[RecordingError]
) -> Iterator[Arrival]:
    """The arrivals, up to where the stream breaks off or its clock jumps back: then the reason."""
    newest = -math.inf
    try:
        for arrival in arrivals:
            if arrival.stamp is not None:
                if arrival.stamp < newest - LONGEST_STEP_BACK:
                    raise RecordingError(
                        f"the clock of the stream jumped back from {newest:.3f} s to "
                        f"{arrival.stamp:.3f} s"
                    )
                newest = max(newest, arrival.stamp)
            yield arrival
    except RecordingError as error:
        breaks.append(error)


def _observed(arrivals: Iterable[Arrival], observers: Sequence[Observer]) -> Iterator[Arrival]:
    for arrival in arrivals:
        for reading in arrival.readings:
            for observer in observers:
                _show(observer, observer.reading, reading)
        yield arrival


def _every(pipeline: "Pipeline", period: float, arrivals: Iterable[Arrival]) -> Iterator["Step"]:
    """Steps at a period [s] from the first arrival on, and where one is due."""
    start, count, newest = None, 1, 0.0
    for arrival in arrivals:
        stamp = arrival.stamp
        if stamp is not None and not arrival.due:
            if start is None:
                start = newest = stamp
            while stamp > start + count * period:
                yield pipeline.step(start + count * period)
                count += 1
                if start + count * period > newest + PAUSE:  # go on with the step before it
                    last = math.ceil((stamp - start) / period) - 2  # or one more, by rounding
                    last += start + (last + 1) * period < stamp
                    count = max(count, last)
            newest = max(newest, stamp)
        yield from _taken(pipeline, arrival)
    if start is not None:
        yield pipeline.step(max(start + count * period, newest))


def _on(pipeline: "Pipeline", arrivals: Iterable[Arrival]) -> Iterator["Step"]:
    """Steps after each reading that the policy names, or when all sources have reported."""
    on = pipeline.config.cycle.on
    codec = installed_kinds().find(on) if on else None
    now = -math.inf
    for arrival in arrivals:
        yield from _taken(pipeline, arrival)
        if arrival.stamp is None or arrival.due:
            continue
        now = max(now, arrival.stamp)
        if on is None:
            due = pipeline.integrator.ready(now)
        else:
            due = any(
                reading.sensor == on or (codec is not None and isinstance(reading, codec.kind))
                for reading in arrival.readings
            )
        if due:
            yield pipeline.step(now)


def _taken(pipeline: "Pipeline", arrival: Arrival) -> Iterator["Step"]:
    """Pass changes and readings of an arrival to a pipeline; the step that is then due, if any."""
    for change in arrival.changes:
        change.carry_out(pipeline)
    for reading in arrival.readings:
        pipeline.take(reading)
    if arrival.due:
        assert arrival.stamp is not None
        yield pipeline.step(arrival.stamp)
