"""One loop plays recordings, scenes and readings: what is due, what is observed, what is sent."""

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from contactfusion import Pipeline, PipelineConfig
from contactfusion.changes import Change
from contactfusion.controller import Command
from contactfusion.errors import ConfigurationError, RecordingError, WritingError
from contactfusion.loop import Observer, play, together
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


def test_faults_leave_changes_as_they_are() -> None:
    class Changing(Cycles):
        def arrivals(self) -> Iterator[Arrival]:
            yield Arrival(None, (), changes=(Change("threshold 0.9"),))
            yield from super().arrivals()

    listener = pipeline(faults=[SILENT])
    list(play(listener, Changing(4)))
    assert listener.integrator.config.threshold == 0.9


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


class BrokenOff(Kept):
    """A recording that is cut off."""

    def readings(self) -> Iterator[Reading]:
        yield from super().readings()
        raise RecordingError("cut off")


def test_a_stream_that_breaks_off_is_played_to_there_and_then_says_so() -> None:
    config: dict[str, Any] = {"cycle": {"every": 0.1}}
    readings = [seen(0.1 * n) for n in range(4)]
    wanted = [step.stamp for step in pipeline(**config).run(readings)]
    stamps = []
    with pytest.raises(RecordingError, match="^cut off$"):
        for step in pipeline(**config).run(BrokenOff(readings)):
            stamps.append(step.stamp)
    assert stamps == wanted and len(stamps) == 3


def test_a_clock_that_jumps_back_ends_the_stream_and_stamps_out_of_order_do_not() -> None:
    config: dict[str, Any] = {"cycle": {"on": "eye"}}
    assert len(list(pipeline(**config).run([seen(2.0), seen(1.5), seen(2.1)]))) == 3
    stamps = []
    with pytest.raises(RecordingError, match=r"jumped back from 2.000 s to 0.900 s"):
        for step in pipeline(**config).run([seen(1.0), seen(2.0), seen(0.9), seen(3.0)]):
            stamps.append(step.stamp)
    assert stamps == [1.0, 2.0]


def test_a_clock_that_jumps_ahead_makes_no_steps_in_between() -> None:
    steps = pipeline(cycle={"every": 0.1}).run([seen(0.0), seen(3600.0)])
    assert len(list(steps)) < 1000


def test_an_observer_that_fails_harms_no_other_and_is_told_at_the_end() -> None:
    taken = list[float]()

    def fails(step: Any) -> None:
        raise ZeroDivisionError(f"at {step.stamp:.1f}")

    failing, sound = Observer(step=fails), Observer(step=lambda step: taken.append(step.stamp))
    readings = [seen(0.1 * n) for n in range(5)]
    played = list[float]()
    with pytest.raises(ZeroDivisionError, match="at 0.0"):
        for step in play(pipeline(cycle={"on": "eye"}), readings, [failing, sound]):
            played.append(step.stamp)
    assert played == taken and len(taken) == 5
    assert isinstance(failing.failure, ZeroDivisionError) and sound.failure is None


def test_outputs_that_are_together_end_each_by_itself() -> None:
    ended = dict[str, str]()

    @contextmanager
    def output(name: str, error: Exception | None = None) -> Iterator[Observer]:
        def take(reading: Reading) -> None:
            if error is not None:
                raise error

        try:
            yield Observer(take)
            ended[name] = "whole"
        except OSError as met:
            ended[name] = "cut"
            raise WritingError(f"{name} can't be written: {met}") from None

    full = OSError("no space")
    with pytest.raises(WritingError, match="^two can't be written: no space$"):
        with together([output("one"), output("two", full), output("three")]) as observers:
            with pytest.raises(OSError, match="no space"):
                list(play(pipeline(), [seen(0.0)], observers))
    assert ended == {"one": "whole", "two": "cut", "three": "whole"}
    ended.clear()
    with pytest.raises(KeyboardInterrupt), together([output("one")]):
        raise KeyboardInterrupt
    assert ended == {}


def test_an_interrupt_while_outputs_end_waits_until_all_have() -> None:
    ended = []

    @contextmanager
    def output(name: str) -> Iterator[Observer]:
        yield Observer()
        signal.raise_signal(signal.SIGINT)
        ended.append(name)

    with pytest.raises(KeyboardInterrupt), together([output("one"), output("two")]):
        pass
    assert ended == ["two", "one"]


def test_a_command_that_a_stream_cannot_take_ends_the_run_with_its_reason() -> None:
    class Fixed(Cycles):
        def send(self, command: Command | None) -> None:
            super().send(command)
            if len(self.sent) == 2:
                raise ConfigurationError("it has no gripper", "controller")

    steps = []
    with pytest.raises(ConfigurationError, match="^controller: it has no gripper$"):
        for step in play(pipeline(), Fixed(4)):
            steps.append(step)
    assert len(steps) == 1
