"""The one loop: plays any stream through a pipeline, while observers look on."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from contactfusion.faults import broken
from contactfusion.readings import Reading
from contactfusion.readings.registry import installed_kinds
from contactfusion.stream import Arrival, Stream, arrival_of

if TYPE_CHECKING:
    from contactfusion.pipeline import Pipeline, Step

PAUSE = 60.0
"""When nothing is read for longer, no step is made until the one before the next reading [s]."""


def _ignore(what: object) -> None:
    """Take something, and do nothing."""


@dataclass(frozen=True)
class Observer:
    """What looks on while a stream is played.

    Attributes:
        reading: takes each reading as the stream gives it, before faults change it.
        step: takes each step, once its command is sent.
    """

    reading: Callable[[Reading], object] = _ignore
    step: Callable[["Step"], object] = _ignore


def play(
    pipeline: "Pipeline", stream: Stream | Iterable[Reading], observers: Sequence[Observer] = ()
) -> Iterator["Step"]:
    """Play a stream through a pipeline, with the faults of its configuration.

    The pipeline steps where the stream says that a step is due, else as its cycle policy says.

    Args:
        pipeline: which listens.
        stream: what is played, from its beginning; readings alone arrive at their stamps.
        observers: which look on.

    Yields:
        Each step, once its command is sent and all observers have taken it.

    Raises:
        ConfigurationError: the pipeline does not fit the stream, or a fault a reading.
    """
    if isinstance(stream, Stream):
        stream.begin(pipeline)
        arrivals = stream.arrivals()
    else:
        arrivals = map(arrival_of, stream)
    config = pipeline.config
    arrivals = _observed(arrivals, observers)
    if config.faults:
        arrivals = broken(arrivals, config.faults, config.seed)
    every = config.cycle.every
    steps = _on(pipeline, arrivals) if every is None else _every(pipeline, every, arrivals)
    for step in steps:
        if isinstance(stream, Stream):
            stream.send(step.command)
        for observer in observers:
            observer.step(step)
        yield step


def _observed(arrivals: Iterable[Arrival], observers: Sequence[Observer]) -> Iterator[Arrival]:
    for arrival in arrivals:
        for reading in arrival.readings:
            for observer in observers:
                observer.reading(reading)
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
    """Pass the readings of an arrival to a pipeline; the step that is then due, if any."""
    for reading in arrival.readings:
        pipeline.take(reading)
    if arrival.due:
        assert arrival.stamp is not None
        yield pipeline.step(arrival.stamp)
