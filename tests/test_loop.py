"""One loop plays recordings, scenes and readings: what is due, what is observed, what is sent."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from contactfusion import Pipeline, PipelineConfig
from contactfusion.controller import Command
from contactfusion.errors import ConfigurationError
from contactfusion.loop import Observer, play
from contactfusion.readings import PointCloud, Reading, Transform
from contactfusion.recordings.recording import Recording
from contactfusion.stream import Arrival, Stream
from tests.toys import offer_toys, point

SILENT = {"fault": "silent", "sensor": "eye", "start": 0.25}


@pytest.fixture(autouse=True)
def toys(monkeypatch: pytest.MonkeyPatch) -> None:
    offer_toys(monkeypatch)


def pipeline(**fields: Any) -> Pipeline:
    return Pipeline(PipelineConfig(**fields))


def seen(stamp: float) -> PointCloud:
    return point(stamp, 0.1, 0.0, 0.0, sensor="eye")


def moved(stamp: float) -> Transform:
    return Transform(
        stamp=stamp,
        frame="map",
        child_frame="base",
        position=np.zeros(3),
        orientation=np.array([0.0, 0.0, 0.0, 1.0]),
    )


class Cycles(Stream):
    """A closed loop: two readings a cycle, the next cycle after a command."""

    def __init__(self, cycles: int) -> None:
        self.sent: list[Command | None] = []
        self._cycles = cycles

    def readings(self) -> Iterator[Reading]:
        return (reading for arrival in self.arrivals() for reading in arrival.readings)

    def arrivals(self) -> Iterator[Arrival]:
        for cycle in range(self._cycles):
            assert len(self.sent) == cycle
            yield Arrival(0.1 * cycle, (seen(0.1 * cycle), seen(0.1 * cycle)), due=True)

    def send(self, command: Command | None) -> None:
        self.sent.append(command)


class Kept(Recording):
    """A recording of some readings."""

    def __init__(self, readings: Sequence[Reading]) -> None:
        self._readings = readings

    def readings(self) -> Iterator[Reading]:
        yield from self._readings


@pytest.mark.parametrize("cycle", ["ready", {"every": 0.03}, {"on": "eye"}], ids=str)
def test_a_stream_that_says_when_a_step_is_due_needs_no_policy(cycle: Any) -> None:
    stream = Cycles(3)
    steps = list(play(pipeline(cycle=cycle), stream))
    assert [step.stamp for step in steps] == pytest.approx([0.0, 0.1, 0.2])
    assert stream.sent == [None] * 3


def test_observers_take_readings_before_the_step_and_the_step_after_its_command() -> None:
    stream, told = Cycles(2), list[str]()
    observer = Observer(
        lambda reading: told.append(f"reading {reading.stamp:.1f}"),
        lambda step: told.append(f"step {step.stamp:.1f}, {len(stream.sent)} sent"),
    )
    for step in play(pipeline(), stream, [observer]):
        told.append(f"out {step.stamp:.1f}")
    first = ["reading 0.0", "reading 0.0", "step 0.0, 1 sent", "out 0.0"]
    assert told == [*first, "reading 0.1", "reading 0.1", "step 0.1, 2 sent", "out 0.1"]


def test_an_observer_alone_changes_nothing() -> None:
    readings = [seen(0.1 * n) for n in range(5)]
    config: dict[str, Any] = {"cycle": {"every": 0.1}}
    stamps = [step.stamp for step in play(pipeline(**config), readings, [Observer()])]
    assert stamps == [step.stamp for step in pipeline(**config).run(readings)] != []


def test_observers_take_what_faults_then_lose() -> None:
    taken = list[Reading]()
    listener = pipeline(faults=[SILENT], generators={"eye": {"type": "echo", "sensor": "eye"}})
    list(play(listener, [seen(0.1 * n) for n in range(5)], [Observer(taken.append)]))
    assert len(taken) == 5 and listener.given["eye"] == 3


def test_faults_keep_the_clock_of_what_they_lose() -> None:
    readings = [seen(0.1 * n) for n in range(8)]
    config: dict[str, Any] = {"cycle": {"every": 0.1}}
    healthy, failing = pipeline(**config), pipeline(**config, faults=[SILENT])
    stamps = [[step.stamp for step in one.run(readings)] for one in (healthy, failing)]
    assert stamps[0] == stamps[1]


def test_receive_says_that_faults_act_on_what_is_played() -> None:
    with pytest.raises(ConfigurationError, match="^faults: faults act on what `run` plays, not on"):
        pipeline(faults=[SILENT]).receive(seen(0.0))


def test_transforms_of_a_recording_come_ahead_and_move_no_clock() -> None:
    readings = [seen(0.0), seen(0.5), moved(0.6), seen(2.0), moved(2.1)]
    arrivals = list(Kept(readings).arrivals())
    assert [arrival.stamp for arrival in arrivals] == [None, 0.0, 0.5, None, 2.0]
    stamps = [step.stamp for step in pipeline(cycle={"on": "eye"}).run(Kept(readings))]
    assert stamps == [0.0, 0.5, 2.0]


def test_a_stream_may_refuse_a_pipeline_before_anything_comes() -> None:
    class Picky(Cycles):
        def begin(self, pipeline: Pipeline) -> None:
            raise ConfigurationError("it does not fit", "controller")

    stream = Picky(2)
    with pytest.raises(ConfigurationError, match="^controller: it does not fit$"):
        next(play(pipeline(), stream))
    assert stream.sent == []
