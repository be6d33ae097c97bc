"""`contactfusion live`: the pipeline of a configuration on a running robot, from start to end."""

import functools
import json
import re
import shlex
import signal
import threading
import time
import webbrowser
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, closing, contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import final

from contactfusion.changes import Change, settle, words
from contactfusion.doctor.kernels import RULES, touch_kernels
from contactfusion.errors import ConfigurationError, ContactFusionError, naming
from contactfusion.integrator.sources import EventKind
from contactfusion.live.clock import Clock, SimulatedTime, machine_time
from contactfusion.live.commander import Commander
from contactfusion.live.config import LiveConfig
from contactfusion.live.control import PATIENCE, Control
from contactfusion.live.description import TOPIC, differences
from contactfusion.live.page import Address, Page
from contactfusion.live.results import Results
from contactfusion.live.status import Status
from contactfusion.live.stream import LiveStream
from contactfusion.live.tape import Tape
from contactfusion.live.transport import End, Quality, Transport
from contactfusion.loop import Observer
from contactfusion.pipeline import Step
from contactfusion.readings.messages import Message
from contactfusion.recordings.messages import typestore
from contactfusion.run.configuration import Setting, setting_of_file
from contactfusion.run.session import Session, matched
from contactfusion.run.summary import Summary
from contactfusion.runner import Budgets
from contactfusion.terminal import note, say

NUMBERS = r"[\d.e+-]+"
LOOK = 0.5
"""The time between two looks at what is on the network [s]."""
WATCH = 0.01
"""The least time between two looks at what is stale [s]."""
REPORT = 1.0
"""The time between two diagnostics [s]."""
SHOW = 0.1
"""The time between two snapshots for the page and `ctl` [s]."""
NO_TOPICS: Mapping[str, str] = {}


def run_live(
    path: Path,
    open_transport: Callable[[], Transport],
    *,
    overrides: Sequence[str] = (),
    topics: Mapping[str, str] = NO_TOPICS,
    ignored: Sequence[str] = (),
    name: str | None = None,
    record: Path | None = None,
    wait: float = 5.0,
    duration: float | None = None,
    sim_time: bool = False,
    web: Address | None = None,
    view: bool = False,
) -> None:
    """Run the pipeline of a YAML file on a robot until Ctrl-C or SIGTERM.

    However it ends, unless it is killed, the last commands are zero and the recording is whole.

    Args:
        path: the configuration; its recording or scene is left alone.
        open_transport: joins the network.
        overrides: fields to change, as "a.b=c".
        topics: topics by role.
        ignored: topics that are not read at all.
        name: as `contactfusion ctl` calls it; None: that of the file.
        record: the MCAP file that takes all that comes; None: none.
        wait: for the topics that generators need, before it starts without them [s].
        duration: end after so long [s]; None: by Ctrl-C.
        sim_time: whether the time on /clock counts, in place of that of this machine.
        web: where a page shows it; None: nowhere.
        view: whether to open the page in a browser of this machine, on any free port without `web`.

    Raises:
        ContactFusionError: the configuration, a plug-in, the network or the recording is not what
            it should be.
    """
    setting = setting_of_file(path, overrides).choosing(topics, ignored)
    with naming(path):
        try:
            fields = setting.fields.get("live")
            fields = {} if fields is None else fields
            if not isinstance(fields, Mapping):
                raise ConfigurationError(f"takes fields such as `twist`, not {fields!r}")
            config = LiveConfig(**fields)
        except ConfigurationError as error:
            raise error.under("live") from None
    transport = open_transport()
    tape = Tape(tell)
    budgets = Budgets(time.perf_counter)
    try:
        clock = SimulatedTime(transport, wait) if sim_time else machine_time
        network = LiveStream(transport, config, clock=clock)
        note("looking for topics ...")
        rule = setting.config().integrator.rule
        touch_kernels([rule] if rule in RULES else [])  # while others are discovered
        missing = _awaited(network, setting, wait)
        session = Session(setting, network, tap=tape.copy, ask=budgets.ask, live=True)
    except BaseException:
        transport.close()
        raise
    with closing(session):
        for sentence in (*session.inputs.taken, *missing):
            note(sentence)
        stream = session.stream
        assert isinstance(stream, LiveStream)
        tape.load(session)
        live = _Live(path.stem, setting, session, stream, transport, config, tape, budgets, clock)
        live.run(
            name or path.stem, record, duration, web or (Address.of("0") if view else None), view
        )


def _awaited(network: LiveStream, setting: Setting, wait: float) -> Sequence[str]:
    """Wait until all that generators need is there; what is missing then, in sentences."""
    ends = time.monotonic() + wait
    while True:
        _, inputs = matched(setting, network)
        if not inputs.missing or time.monotonic() > ends:
            return inputs.missing
        time.sleep(0.05)
        network.look()


def tell(text: str, by: Callable[[str], None] = note) -> None:
    """Print a line, unless the console is gone: that must not stop a robot."""
    with suppress(OSError, ValueError):
        by(text)


@final
class _Live:
    """What runs beside the loop, and in its gaps."""

    def __init__(
        self,
        name: str,
        setting: Setting,
        session: Session,
        stream: LiveStream,
        transport: Transport,
        config: LiveConfig,
        tape: Tape,
        budgets: Budgets,
        clock: Clock,
    ) -> None:
        self._setting, self._session, self._stream = setting, session, stream
        self._transport, self._tape, self._budgets = transport, tape, budgets
        pipeline = session.pipeline
        self._status = Status(name, pipeline, stream)
        frame = pipeline.grid.frame
        self._results = Results(transport, config, stream.epoch_ns, frame, clock)
        self._results.on_event = self._noted
        self._status.sent = self._results.sent
        self._commander = Commander(
            transport, config, pipeline.config.controller is not None, clock, self._stops
        )
        budgets.note = functools.partial(pipeline.integrator.note, EventKind.OVERRUN)
        stream.obey, stream.idle = self._commander.send, self._idle
        stream.rematch = self._rematched
        self._watched = self._reported = self._shown = 0.0
        self._ends: float | None = None
        self._troubled: set[str] = set()
        if pipeline.config.robot is not None:
            self._urdf = pipeline.config.robot.path().read_text(encoding="utf-8")
            transport.listen(TOPIC, "std_msgs/msg/String", Quality(True, True), self._described)

    def run(
        self,
        name: str,
        record: Path | None,
        duration: float | None,
        web: Address | None,
        view: bool,
    ) -> None:
        """Play until the end, and report."""
        summary = Summary(self._session.pipeline, most_events=0)
        began = time.monotonic()
        self._ends = None if duration is None else began + duration
        with ExitStack() as stack:
            stack.enter_context(_ended_by_signals(self._stream))
            stack.callback(self._close_tape)
            stack.enter_context(self._commander)
            stack.enter_context(Control(name, self.order))
            stack.enter_context(self._looking())
            if web is not None:
                tell(stack.enter_context(self._page(web, view)))
            if record is not None:
                tell(self._tape.start(record))
            tell(f"live as '{name}'; Ctrl-C ends it, `contactfusion ctl --name {name}` changes it")
            observer = Observer(step=self._step)
            for _ in self._session.play(summary.observer, observer):
                if observer.failure is not None:
                    raise observer.failure
        for line in summary.lines():
            tell(line)
        tell(f"{time.monotonic() - began:.1f} s")

    def order(self, text: str) -> str:
        """Carry out an order of `ctl` or of the page, from any thread; a sentence on it.

        Raises:
            ContactFusionError: it can't be.
        """
        order, _, rest = text.strip().partition(" ")
        if order == "status":
            return json.dumps(self._status.snapshot, indent=1)
        if order == "record":
            return self._record(rest.strip())
        if words(text)[0] == "answer":
            raise ConfigurationError("answers are recorded, and can't be ordered")
        change = Change(text.strip())
        change.outcome.add_done_callback(self._changed)
        self._stream.queue.put(change)
        return _result(change.outcome)

    def _changed(self, outcome: "Future[str]") -> None:
        """Publish a change that was made, in the thread of the loop."""
        if not outcome.cancelled() and outcome.exception() is None:
            self._results.event("info", outcome.result())

    def _record(self, what: str) -> str:
        """Begin or end a recording, in the thread of the loop."""
        try:
            verb, *files = shlex.split(what) or [""]
        except ValueError as error:
            raise ConfigurationError(f"'{what}': {error}") from None
        if verb not in ("start", "stop") or len(files) > (verb == "start"):
            raise ConfigurationError("write record start [FILE.mcap], or record stop")
        now = datetime.now().strftime("%Y%m%d-%H%M%S")
        path = Path(*files or (f"{self._setting.origin.stem}-{now}.mcap",)).absolute()
        outcome = Future[str]()
        outcome.add_done_callback(self._changed)
        do = functools.partial(self._tape.start, path) if verb == "start" else self._tape.stop
        self._stream.queue.put(functools.partial(settle, outcome, do))
        return _result(outcome)

    def _step(self, step: Step) -> None:
        self._tape.step(step)
        self._status.step(step)
        self._results.step(step, is_fresh=not self._commander.stopped)
        self._status.draw()

    def _idle(self, now: int) -> None:
        """In the gaps of the loop: watch what is stale, and report."""
        at = time.monotonic()  # simulated time may stand still, or leap
        if at - self._watched < WATCH:
            return
        self._watched = at
        stale = self._stream.stale(now)
        self._commander.comes_round(stale)
        self._status.stopped = self._commander.stopped
        if stale:
            self._results.none()
        for change in self._budgets.changes():
            change.outcome.add_done_callback(self._moved)
            self._stream.queue.put(change)
        if self._ends is not None and at >= self._ends:
            self._ends = None
            self._stream.end_soon()
        if at - self._shown >= SHOW:
            self._shown = at
            self._status.recording = str(self._tape.path or "")
            self._status.fields()
        if at - self._reported >= REPORT:
            self._reported = at
            self._tape.flush()
            self._results.diagnostics(self._status.diagnostics())
            met = {f"/{each.sensor}": each.note for each in self._stream.troubles()}
            unsent = {
                topic: f"{count} could not be sent"
                for topic, count in tuple(self._transport.unsent.items())
            }
            for topic, text in {**met, **self._stream.unread, **unsent}.items():
                kind = f"{topic} {re.sub(NUMBERS, '', text)}"  # what is counted counts on
                if kind not in self._troubled:
                    self._troubled.add(kind)
                    self._results.event("warning", f"{topic}: {text}")

    def _moved(self, outcome: "Future[str]") -> None:
        """Report why a generator that was too slow could not be moved."""
        if (error := outcome.exception()) is not None:
            self._results.event("warning", str(error))

    def _stops(self, text: str) -> None:
        """Take note that commands become zero, or go on; also from the thread of the watchdog."""
        self._stream.queue.put(functools.partial(self._results.event, "warning", text))

    def _described(self, cdr: bytes, arrived: int) -> None:
        """Compare the robot on the network with that of the configuration."""
        clauses: Iterable[str]
        try:
            described: Message = typestore().deserialize_cdr(cdr, "std_msgs/msg/String")
            clauses = differences(described.data, self._urdf)
        except Exception as error:  # rosbags meets damage with errors of many kinds
            clauses = (f"it can't be read: {error}",)
        for clause in clauses:
            text = f"the robot on {TOPIC} is another: {clause}"
            self._stream.queue.put(functools.partial(self._results.event, "warning", text))

    def _noted(self, level: str, text: str) -> None:
        self._status.event(level, text)
        if level != "info":
            tell(text)

    def _rematched(self, stream: LiveStream) -> Mapping[str, Sequence[str]]:
        """What is listened to, now that topics came or went."""
        try:
            part, _ = matched(self._setting, stream, generators=self._session.inputs.generators)
        except ContactFusionError as error:
            self._results.event("error", str(error))
            return stream.sensors
        assert isinstance(part, LiveStream)
        return part.sensors

    def _close_tape(self) -> None:
        if self._tape.path is not None:
            path = self._tape.path
            self._tape.stop()
            tell(f"results: {path}", say)

    @contextmanager
    def _looking(self) -> Iterator[None]:
        """Look at what is on the network, in a thread of its own."""
        ended = threading.Event()

        def look() -> None:
            known: Sequence[End] = ()
            while not ended.wait(LOOK):
                now = self._transport.ends()
                if now != known:
                    known = now
                    self._stream.queue.put(functools.partial(self._stream.discovered, now))

        thread = threading.Thread(target=look, name="discovery", daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    @contextmanager
    def _page(self, web: Address, view: bool) -> Iterator[str]:
        """Serve the page, and open it where it is wanted; its address, in a sentence.

        Raises:
            ConfigurationError: there is no browser.
        """
        status = self._status
        with Page(*web, lambda: status.snapshot, lambda: status.surface, self.order) as page:
            if view and not webbrowser.open(page.url):
                raise ConfigurationError(
                    "no browser opens here; --web 8080 serves the page for another machine",
                    "--view",
                )
            yield f"a page shows it: {page.url}"


def _result(outcome: "Future[str]") -> str:
    """What came of something that the loop does.

    Raises:
        ContactFusionError: it could not be done, or the loop has no time; then it won't be done.
    """
    try:
        return outcome.result(PATIENCE)
    except TimeoutError:
        if not outcome.cancel():  # the loop is at it
            raise ConfigurationError(
                f"it takes longer than {PATIENCE:g} s; an event will report it"
            ) from None
        raise ConfigurationError(f"the loop has no time for it within {PATIENCE:g} s") from None


@contextmanager
def _ended_by_signals(stream: LiveStream) -> Iterator[None]:
    """Let Ctrl-C, SIGTERM, a lost terminal end the stream after the step in hand, twice at once."""

    def end(number: int, frame: object) -> None:
        stream.end_soon()
        signal.signal(number, signal.default_int_handler)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ends = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as under nohup
        ends.append(signal.SIGHUP)
    before = {number: signal.signal(number, end) for number in ends}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
