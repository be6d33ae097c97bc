"""Generators that break the contract beside a healthy one, whose contact never changes."""

import itertools
import multiprocessing
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any

import numpy as np
import pytest

from contactfusion import Grid, Pipeline, PipelineConfig, State, Step
from contactfusion.errors import PluginError
from contactfusion.generator import GeneratorConfig
from contactfusion.integrator.sources import Event, EventKind
from contactfusion.isolation import Isolated
from contactfusion.readings import PointCloud
from contactfusion.runner import Runner
from tests.toys import Feeler, Slow, Tallying, Worn, offer_toys, point, wrench
from tests.wire import PROBE

PLACE = (0.1025, 0.0025, 0.0025)
HEALTHY = {"type": "feeler"}
PATIENCE = 30.0
"""How long a process of its own may take to start on a busy machine [s]."""


@pytest.fixture(autouse=True)
def _toys(monkeypatch: pytest.MonkeyPatch, pytestconfig: pytest.Config) -> None:
    offer_toys(monkeypatch)
    monkeypatch.syspath_prepend(str(pytestconfig.rootpath))  # a process of its own imports toys


def pipeline(live: bool = False, **other: dict[str, Any]) -> Pipeline:
    return Pipeline(PipelineConfig(generators={"healthy": HEALTHY, **other}), live=live)


def told_of_healthy(step: Step) -> tuple[object, ...]:
    (contact,) = step.fusion.contacts
    assert contact.shares["healthy"] == 1.0
    return contact.position.tobytes(), contact.likelihood, contact.covariance.tobytes()


def alone() -> tuple[object, ...]:
    pipe = pipeline()
    pipe.receive(wrench(0.0, *PLACE))
    return told_of_healthy(pipe.step(0.0))


@pytest.mark.parametrize(
    ("how", "named"),
    [
        ("raises", "'naughty' raised RuntimeError: out of order (tests/toys.py, line "),
        ("exits", "'naughty' raised SystemExit: that is all (tests/toys.py, line "),
        ("NaN", "row 0 of the positions of 'naughty' is not finite"),
        ("wrong shape", "positions of 'naughty' have shape (1, 2), not (n, 3)"),
        ("wrong frame", "unknown frame 'moon'"),
        ("p > 1", "row 0 of the likelihoods of 'naughty' is 1.5, outside [0, 1]"),
        ("nothing", "it gave NoneType, not a sequence of clouds"),
        ("an iterator", "it gave list_iterator, not a sequence of clouds"),
        ("no cloud", "it gave int, not a HypothesisCloud"),
        ("foreign source", "'naughty' gave a cloud of 'healthy', not of its own: naughty"),
        ("unknown kind", "unknown kind 'rumour'"),
        ("other kind", "'naughty' is plugged as regular but sent a cloud of null"),
        ("out of reach", "row 0 of the positions of 'naughty' is out of reach"),
    ],
)
def test_it_is_refused_counted_and_named_and_the_healthy_contact_stays(
    how: str, named: str
) -> None:
    pipe = pipeline(naughty={"type": "naughty", "how": how})
    for _ in range(3):
        pipe.receive(point(0.0, *PLACE))
    pipe.receive(wrench(0.0, *PLACE))
    step = pipe.step(0.0)
    refused = [event for event in step.events if event.kind == EventKind.REFUSED]
    assert [event.source for event in refused] == ["naughty"] * 3
    assert all(named in event.message for event in refused)
    counted = {name: source.invalid for name, source in step.fusion.report.sources.items()}
    assert counted == {"healthy": 0, "naughty": 3}
    assert told_of_healthy(step) == alone()


class Clock:
    """Time that passes only when somebody says so."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def pass_time(self, seconds: float) -> None:
        self.now += seconds


def runner_with_slow() -> Runner:
    clock = Clock()
    generators: Any = {"healthy": HEALTHY, "slow": {"type": "slow", "budget": 0.05}}
    runner = Runner(PipelineConfig(generators=generators), clock)
    lend(runner, clock)
    return runner


def lend(runner: Runner, clock: Clock) -> None:
    slow = runner.pipeline.generators["slow"]
    assert isinstance(slow, Slow)
    slow.pass_time = clock.pass_time


def overruns(runner: Runner) -> list[Event]:
    events = runner.pipeline.step(0.0).events
    return [event for event in events if event.kind == EventKind.OVERRUN]


def test_an_overrun_is_named_with_its_time_and_budget() -> None:
    runner = runner_with_slow()
    runner.receive(point(0.0, 0.06, 0.0, 0.0))
    (event,) = overruns(runner)
    assert event.message == "'slow' took 0.06 s of 0.05 s"


def test_after_three_overruns_in_a_row_it_leaves_the_loop_and_the_healthy_contact_stays() -> None:
    runner = runner_with_slow()
    apart = []
    try:
        for _ in range(4):
            runner.receive(point(0.0, 1.0, 0.0, 0.0))
            apart.append(isinstance(runner.pipeline.generators["slow"], Isolated))
        assert apart == [False, False, True, True]
        runner.receive(wrench(0.0, *PLACE))
        step = runner.pipeline.step(0.0)
    finally:
        runner.pipeline.close()
    told = [event.message for event in step.events if event.kind == EventKind.OVERRUN]
    assert told[-1] == "'slow' leaves the loop after 3 overruns in a row"
    assert told_of_healthy(step) == alone()


def test_one_that_can_have_no_process_of_its_own_is_unplugged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runner = runner_with_slow()
    monkeypatch.setattr(Slow, "__reduce__", lambda self: 1 / 0, raising=False)
    for _ in range(3):
        runner.receive(point(0.0, 1.0, 0.0, 0.0))
    assert "slow" not in runner.pipeline.generators
    step = runner.pipeline.step(0.0)
    assert (EventKind.UNPLUGGED, "slow") in [(e.kind, e.source) for e in step.events]


def test_one_call_in_time_starts_the_count_again() -> None:
    runner = runner_with_slow()
    for seconds in (1.0, 1.0, 0.05, 1.0, 1.0):
        runner.receive(point(0.0, seconds, 0.0, 0.0))
    assert len(overruns(runner)) == 4
    assert "slow" in runner.pipeline.generators


def test_one_that_raises_late_has_overrun_as_well() -> None:
    ticks = itertools.count()
    generators: Any = {"naughty": {"type": "naughty", "how": "raises"}}
    runner = Runner(PipelineConfig(generators=generators), lambda: float(next(ticks)))
    runner.receive(point(0.0, *PLACE))
    assert [event.source for event in overruns(runner)] == ["naughty"]


REMOTE = {"type": "remote", "isolate": True, "timeout": 300.0}


@pytest.fixture
def isolated() -> Iterator[Pipeline]:
    pipe = pipeline(live=True, remote=REMOTE)
    yield pipe
    pipe.close()


class Cycles:
    """Cycles of a pipeline whose healthy source speaks in each, and how long the longest took."""

    def __init__(self, pipe: Pipeline) -> None:
        self.pipe, self.now, self.longest, self.heard = pipe, 0.0, 0.0, 0
        self.healthy = pipeline()

    def cycle(self, ask: str | None = None) -> Step:
        self.now += 0.01
        start = time.perf_counter()
        if ask is not None:
            self.pipe.receive(point(self.now, 1.0, 1.0, 1.0, sensor=ask))
        self.pipe.receive(wrench(self.now, *PLACE))
        step = self.pipe.step(self.now)
        self.longest = max(self.longest, time.perf_counter() - start)
        self.healthy.receive(wrench(self.now, *PLACE))
        expected = told_of_healthy(self.healthy.step(self.now))[:2]
        near = min(step.fusion.contacts, key=lambda contact: contact.position[0])
        assert (near.position.tobytes(), near.likelihood) == expected
        return step

    def reset(self) -> None:
        """Begin again at 0 s."""
        self.pipe.reset()
        self.healthy.reset()
        self.now = 0.0

    def until_heard(self, ask: str) -> Step:
        """Ask, and run until the remote generator has answered or was refused."""
        step, start = self.cycle(ask), time.monotonic()
        while (heard := _heard(step)) == self.heard:
            assert time.monotonic() - start < PATIENCE, "the process never answered"
            time.sleep(0.002)
            step = self.cycle()
        self.heard = heard
        return step


def _heard(step: Step) -> int:
    remote = step.fusion.report.sources["remote"]
    return remote.accepted + remote.invalid


def refusals(step: Step) -> list[str]:
    return [event.message for event in step.events if event.kind == EventKind.REFUSED]


def test_an_isolated_generator_that_sleeps_keeps_nobody_waiting_and_is_heard_later(
    isolated: Pipeline,
) -> None:
    cycles = Cycles(isolated)
    cycles.until_heard("now")
    cycles.longest, asked = 0.0, cycles.now + 0.01
    step = cycles.until_heard("sleep")
    assert cycles.longest < 0.2
    assert refusals(step) == []
    far = max(step.fusion.contacts, key=lambda contact: contact.position[0])
    assert far.stamp == pytest.approx(asked) and step.stamp > asked + 0.1


def test_a_reading_may_be_large_while_the_process_is_still_starting(isolated: Pipeline) -> None:
    many = PointCloud(stamp=0.0, frame="base", points=np.ones((200_000, 3)))
    start = time.perf_counter()
    isolated.receive(many)
    assert time.perf_counter() - start < 0.2


def test_an_isolated_generator_knows_the_contacts_and_the_evidence_of_others(
    isolated: Pipeline,
) -> None:
    cycles = Cycles(isolated)
    cycles.until_heard("now")
    step = cycles.until_heard("now")
    assert step.fusion.report.notes == (("remote", "2 contacts, 1 places"),)


def test_an_isolated_generator_that_raises_is_named_and_goes_on(isolated: Pipeline) -> None:
    cycles = Cycles(isolated)
    (message,) = refusals(cycles.until_heard("raise"))
    assert message.startswith("'remote' raised RuntimeError: out of order (tests/toys.py, line ")
    assert refusals(cycles.until_heard("now")) == []


def test_an_isolated_generator_that_dies_is_started_again_three_times(isolated: Pipeline) -> None:
    cycles = Cycles(isolated)
    ended = "the process of 'remote' has ended (exit code 3)"
    for times in (1, 2, 3):
        (message,) = refusals(cycles.until_heard("die"))
        assert message == f"{ended}: it is started again, {times} of 3 times"
        assert refusals(cycles.until_heard("now")) == []
        lost = f"its process was started again, {times} of 3 times: readings are lost"
        assert isolated.ended == {"generators.remote": lost}
    for ask in ("die", "now", "now"):
        (message,) = refusals(cycles.until_heard(ask))
        assert message == f"{ended} 4 times: it stays out"
    assert isolated.ended == {"generators.remote": message}
    cycles.reset()
    cycles.heard = 0
    assert refusals(cycles.until_heard("now")) == []
    assert isolated.ended == {}
    isolated.unplug("remote")


@pytest.mark.parametrize("ask", ["hang", "half", "stop"])
def test_an_isolated_generator_that_hangs_is_started_again_and_delays_no_cycle(ask: str) -> None:
    pipe = pipeline(live=True, remote={**REMOTE, "patience": 0.3})
    cycles = Cycles(pipe)
    cycles.until_heard("now")
    cycles.longest = 0.0
    (message,) = refusals(cycles.until_heard(ask))
    assert message == (
        "the process of 'remote' gave no answer within 0.3 s (`patience`): it is started again, "
        "1 of 3 times"
    )
    assert cycles.longest < 0.5  # a process starts in one of them
    assert refusals(cycles.until_heard("now")) == []
    pipe.close()


def test_a_large_reading_for_a_process_that_stopped_delays_no_cycle() -> None:
    pipe = pipeline(live=True, remote={**REMOTE, "patience": 0.3})
    cycles = Cycles(pipe)
    cycles.until_heard("now")
    cycles.cycle("stop")
    cycles.longest = 0.0
    many = PointCloud(stamp=cycles.now, frame="base", points=np.ones((200_000, 3)), sensor="now")
    start = time.perf_counter()
    pipe.receive(many)
    assert time.perf_counter() - start < 0.2
    cycles.until_heard("now")
    assert cycles.longest < 0.5  # a process starts in one of them
    pipe.close()


def test_an_answer_that_is_only_half_written_keeps_no_cycle_waiting(isolated: Pipeline) -> None:
    cycles = Cycles(isolated)
    cycles.until_heard("now")
    cycles.longest = 0.0
    cycles.cycle("half")
    for _ in range(100):
        time.sleep(0.01)
        cycles.cycle()
    assert cycles.longest < 0.2


def test_the_traceback_of_an_isolated_generator_goes_to_the_log_the_first_time(
    isolated: Pipeline, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("DEBUG", logger="contactfusion")
    cycles = Cycles(isolated)
    for _ in range(2):
        cycles.until_heard("raise")
    assert caplog.text.count('raise RuntimeError("out of order")') == 1


@pytest.mark.parametrize(
    ("ask", "named"),
    [
        ("exit", "'remote' raised SystemExit: that is all (tests/toys.py, line "),
        ("numbers", "'remote' raised TypeError: it gave int, not a HypothesisCloud (tests/toys.py"),
        ("hang", "the process of 'remote' gave no answer within 1 s (`patience`): it stays out"),
        ("half", "the process of 'remote' gave no answer within 1 s (`patience`): it stays out"),
    ],
)
def test_without_a_clock_what_it_does_wrong_is_named_and_a_step_waits_so_long(
    ask: str, named: str
) -> None:
    pipe = pipeline(remote={**REMOTE, "patience": 1.0})
    pipe.receive(point(0.0, 1.0, 1.0, 1.0, sensor=ask))
    pipe.receive(point(0.0, 1.0, 1.0, 1.0, sensor="now"))
    pipe.receive(wrench(0.0, *PLACE))
    step = pipe.step(0.1)
    assert refusals(step)[0].startswith(named) and "healthy" in step.fusion.contacts[-1].shares
    assert _heard(step) == 2 and bool(pipe.ended) == ("stays out" in named)
    pipe.close()


@pytest.mark.parametrize("isolate", [False, True])
def test_one_that_cannot_be_reset_is_refused_with_the_reason_at_every_reading(
    isolate: bool,
) -> None:
    pipe = pipeline(worn={"type": "worn", "isolate": isolate})
    pipe.reset()
    for _ in range(2):
        pipe.receive(point(0.0, *PLACE))
    pipe.receive(wrench(0.0, *PLACE))
    step = pipe.step(0.1)
    reason = "`reset` of 'worn' raised RuntimeError: cannot be reset (tests/toys.py, line "
    assert [message.startswith(reason) for message in refusals(step)] == [True, True]
    assert told_of_healthy(step) == alone()
    pipe.close()


def test_one_that_cannot_be_prepared_in_its_process_says_so_at_every_reading() -> None:
    robot: Any = "any robot"
    worn = Isolated(Worn("worn", GeneratorConfig()), live=False, model=robot)
    reason = r"`prepare` of 'worn' raised RuntimeError: cannot be prepared \(tests/toys.py, line "
    for _ in range(2):
        with pytest.raises(PluginError, match=reason):
            worn.collect(wait=True)
        worn.generate(point(0.0, *PLACE), State(now=0.0, grid=Grid("base", 0.005)))
    worn.close()


@pytest.mark.parametrize("sensor", ["", "through its base"])
def test_one_that_writes_to_a_reading_by_force_is_named_and_harms_no_neighbour(sensor: str) -> None:
    generators: Any = {"forceful": {"type": "forceful"}, "healthy": HEALTHY}
    pipe = Pipeline(PipelineConfig(generators=generators))
    pipe.receive(wrench(0.0, *PLACE, sensor=sensor))
    step = pipe.step(0.0)
    (message,) = refusals(step)
    assert message.startswith("'forceful' raised ") and "(tests/toys.py, line " in message
    assert told_of_healthy(step) == alone()


def test_what_an_isolated_generator_was_doing_at_a_reset_is_never_heard(
    isolated: Pipeline,
) -> None:
    cycles = Cycles(isolated)
    cycles.until_heard("now")
    cycles.cycle("sleep")
    cycles.reset()
    step = cycles.until_heard("now")
    far = max(step.fusion.contacts, key=lambda contact: contact.position[0])
    assert far.stamp == pytest.approx(0.01)
    assert step.fusion.report.sources["remote"].accepted == 2


def test_without_a_clock_each_step_waits_for_all_readings_before_it() -> None:
    pipe = pipeline(remote=REMOTE)
    for ask in ("now", "now", "now"):
        pipe.receive(point(0.0, 1.0, 1.0, 1.0, sensor=ask))
    assert _heard(pipe.step(0.1)) == 3
    pipe.receive(point(0.2, 1.0, 1.0, 1.0, sensor="die"))
    (message,) = refusals(pipe.step(0.2))
    assert "the process of 'remote' has ended (exit code 3)" in message
    pipe.close()
    assert multiprocessing.active_children() == []


def answers_of(tallying: Isolated) -> Iterator[tuple[str, ...]]:
    """The notes of the next clouds, once they come."""
    ends = time.monotonic() + PATIENCE
    while time.monotonic() < ends:
        time.sleep(0.01)
        yield from (cloud.notes for cloud in tallying.collect(wait=False))
    raise AssertionError("no clouds came")


def test_what_waits_while_a_live_one_is_busy_is_absorbed_and_played_again_alike() -> None:
    live = Isolated(Tallying("tallying", GeneratorConfig()), live=True)
    again = Isolated(Tallying("tallying", GeneratorConfig()), live=False)
    again.scripted = True
    state, heard = State(now=0.0, grid=Grid("base", 0.005)), []
    try:
        answers = answers_of(live)
        for first, count in ((0.0, 1), (5.0, 2)):
            for stamp in first + np.arange(5.0):
                for each in (live, again):
                    each.generate(point(stamp, *PLACE), state)
            heard += [next(answers) for _ in range(count)]
        # the first of all waits for its preparation
        assert heard == [("0.0", "1.0", "2.0", "3.0"), (), ("6.0", "7.0", "8.0")]
        assert live.waits_for == "more than 3 readings"
        numbers = list(live.answered)
        assert [cloud.notes for n in numbers for cloud in again.answer(n)] == heard
    finally:
        live.close()
        again.close()


def test_what_it_cannot_say_of_itself_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    class Mute(Exception):
        def __str__(self) -> str:
            raise RuntimeError("no words")

    def fail(generator: object) -> None:
        raise Mute

    pipe = pipeline()
    for name in ("waits_for", "resultant", "sources"):
        monkeypatch.setattr(Feeler, name, property(fail))
    with pytest.raises(PluginError, match="^generators.healthy: the plug-in 'feeler' raised Mute"):
        pipeline()
    assert pipe.waits_for("healthy").startswith("`waits_for` of 'healthy' raised Mute (tests/")
    pipe.receive(wrench(0.0, *PLACE))
    step = pipe.step(0.0)
    assert refusals(step)[0].startswith("`resultant` of 'healthy' raised Mute (tests/")
    assert len(step.fusion.contacts) == 1


def test_what_cannot_be_absorbed_is_named_and_the_next_reading_counts() -> None:
    pipe = pipeline(live=True, tallying={"type": "tallying", "isolate": True})
    try:
        for stamp, sensor in ((0.0, "raise"), (0.1, "eye")):  # while it is prepared
            pipe.receive(point(stamp, *PLACE, sensor=sensor))
        ends, step = time.monotonic() + PATIENCE, pipe.step(0.2)
        while not (named := refusals(step)):
            assert time.monotonic() < ends, "no answer came"
            time.sleep(0.05)
            step = pipe.step(0.2)
        assert named[0].startswith("`absorb` of 'tallying' raised RuntimeError: out of order")
        assert step.fusion.report.sources["tallying"].accepted == 1
    finally:
        pipe.close()


HANGING = """
import multiprocessing, sys, time
from tests.toys import Remote, point
from contactfusion import Grid, State
from contactfusion.generator import GeneratorConfig
from contactfusion.isolation import Isolated
remote = Isolated(Remote("remote", GeneratorConfig()), live=True)
remote.generate(point(0.0, 1.0, 1.0, 1.0, sensor="hang"), State(now=0.0, grid=Grid("base", 0.005)))
while not remote.answered and remote._asked == 0:
    time.sleep(0.01)
    remote.collect(wait=False)
print(multiprocessing.active_children()[0].pid, flush=True)
time.sleep(600)
"""


def test_a_process_that_hangs_ends_with_its_parent(pytestconfig: pytest.Config) -> None:
    command = [sys.executable, "-c", HANGING]
    with Popen(command, stdout=PIPE, text=True, cwd=pytestconfig.rootpath) as parent:
        assert parent.stdout is not None
        child = Path("/proc") / parent.stdout.readline().strip()
        assert child.name.isdecimal() and child.exists()
        parent.kill()
    ends = time.monotonic() + PATIENCE
    while child.exists() and "State:\tZ" not in (child / "status").read_text():
        assert time.monotonic() < ends, "it goes on without its parent"
        time.sleep(0.1)


def test_a_script_without_a_guard_is_told_what_it_lacks(tmp_path: Path) -> None:
    fields = {**PROBE, "generators": {"wrist": {**PROBE["generators"]["wrist"], "isolate": True}}}
    script = tmp_path / "press.py"
    script.write_text(
        "import numpy as np\n"
        "from contactfusion import Pipeline, PipelineConfig, Wrench\n"
        f"pipe = Pipeline(PipelineConfig(**{fields!r}))\n"
        "push = dict(force=np.array([0.0, 0.0, -5.0]), torque=np.zeros(3))\n"
        "pipe.receive(Wrench(stamp=0.0, frame='probe', sensor='wrist', **push))\n"
        "print(pipe.step(0.1).events)\n"
    )
    ran = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert 'does not begin its work below `if __name__ == "__main__":`' in ran.stdout


def test_one_that_cannot_travel_cannot_be_isolated() -> None:
    with pytest.raises(PluginError, match="'odd' cannot be isolated, for it cannot be pickled"):
        pipeline(odd={"type": "unpicklable", "isolate": True})
