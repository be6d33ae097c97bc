"""A generator in a process of its own, so that no cycle waits for it."""

import contextlib
import multiprocessing
import os
import pickle
import queue
import signal
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import TYPE_CHECKING, Any

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.errors import PluginError, cause_in, cause_of
from contactfusion.generator import Generator, GeneratorConfig, checked_clouds
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud, Resultant
from contactfusion.readings import Reading
from contactfusion.state import State

if TYPE_CHECKING:
    from contactfusion.robots.model import RobotModel

START = 60.0
"""Time to start a process, or the patience of its generator where that is longer [s]."""
LOOK = 1.0
"""The time between two looks at whether the parent lives [s]."""
RESTARTS = 3
"""Number of restarts of a process that ended; then its generator stays out."""
Packed = Any
"""Input of the process, as bytes in a buffer: the generator with the robot that it is prepared for,
then readings, each with the state at its stamp."""
ABSORBED = 64
"""The most readings that wait for a live generator which absorbs those that newer ones follow."""


@dataclass(frozen=True)
class Answered:
    """What a generator makes of a reading.

    Attributes:
        clouds: of the reading; none of its preparation.
        resultant: the generator's own after it.
        stamp: of the reading [s].
        waits_for: likewise the generator's own.
        trouble: what failed beside the clouds, in a sentence; else empty.
    """

    clouds: Sequence[HypothesisCloud] = ()
    resultant: Resultant | None = None
    stamp: float = 0.0
    waits_for: str = ""
    trouble: str = ""


Answer = Answered | PluginError | None
"""Output of the process: what it made, why there is nothing, or None when it has ended."""


class Isolated(Generator[GeneratorConfig]):
    """Proxy of a generator that runs in another process.

    On a live robot no step waits for it: a reading that arrives while the generator is busy
    replaces the waiting one, which it absorbs if it can, so it always works on the newest, and its
    clouds come with the step after they are done. Without a clock, every reading is processed, and
    each step waits for those before it, so that equal input gives equal contacts; an answer that
    takes longer than the `patience` of the generator ends its process, and the generator stays out.
    A process that ends by itself, or on a live robot by its patience, is started again at most
    `RESTARTS` times.

    Args:
        inner: the generator that runs in a process of its own.
        live: whether no step waits for it.
        model: the robot that it is prepared for, or None.

    Raises:
        PluginError: the generator cannot be pickled.
    """

    def __init__(
        self, inner: Generator[Any], live: bool, model: "RobotModel | None" = None
    ) -> None:
        super().__init__(inner.name, inner.config)
        # a class declares these for all its instances; this one takes those of another class
        self.readings = inner.readings  # type: ignore[misc]
        self.needs_body = inner.needs_body  # type: ignore[misc]
        self.outputs = inner.outputs
        self._inner = inner
        self._live = live
        self._absorbs = inner.absorbs
        most = None if not live else ABSORBED if self._absorbs else 1
        self._waiting = deque[tuple[int, Packed]](maxlen=most)
        self._module = type(inner).__module__
        self._patience = START
        self.ends = 0
        """How often its process ended and was started again; a reading was lost each time."""
        self._busy = self._outdated = False
        self.answered = deque[int](maxlen=16)
        """The numbers of the readings whose clouds have come, the newest last; the first is 1."""
        self.scripted = False
        """Whether `answer` alone chooses which readings are processed, as it was recorded."""
        self._given = 0
        self._waits_for = ""
        self.measured = 0.0
        """The stamp of the reading of the resultant [s]."""
        self.trouble = ""
        """What failed beside the last clouds, until the pipeline has reported it."""
        self.out = ""
        """Why it stays out until the next `reset`; empty while it takes part."""
        try:
            self._packed: Packed = ForkingPickler.dumps((inner, model))
        except Exception as error:  # pickle raises anything
            raise PluginError(
                f"'{inner.name}' cannot be isolated, for it cannot be pickled: "
                + cause_of(error, type(inner))
            ) from error
        self._start()

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Send the reading; live, the clouds that are done."""
        given = reading, _portable(state, self.name)
        self._given += 1
        self._waiting.append((self._given, ForkingPickler.dumps(given)))  # the state as it is now
        return () if self.scripted or (self._busy and not self._live) else self.collect(wait=False)

    def answer(self, number: int) -> Sequence[HypothesisCloud]:
        """The clouds of a reading by its number; those before it that wait are not answered.

        Raises:
            PluginError: as `collect` does, or there is no such reading.
        """
        if number not in (waiting for waiting, _ in self._waiting):
            raise PluginError(f"'{self.name}' was given no reading {number}")
        if self._busy:  # with its preparation
            self._received(wait=True)
        self._send(number)
        return self._received(wait=True)

    def most_hypotheses(self, grid: Grid) -> int | None:
        """That of the inner generator."""
        most: int | None = self._inner.most_hypotheses(grid)
        return most

    @property
    def waits_for(self) -> str:
        """What the inner generator waited for after its last reading."""
        return self._waits_for

    @property
    def owes(self) -> bool:
        """Whether a step has to wait for it."""
        return not (self._live or self.scripted) and bool(self._busy or self._waiting)

    def collect(self, wait: bool) -> Sequence[HypothesisCloud]:
        """The clouds of a reading that is done; the next reading is sent.

        Args:
            wait: whether to wait for them.

        Raises:
            PluginError: the generator raised, its process ended or gave no answer in time, or it
                stays out.
        """
        if self.scripted:
            return ()
        clouds = self._received(wait) if self._busy else ()
        if self._waiting and not self._busy:
            self._send(self._waiting[-1 if self._live else 0][0])
        return clouds

    def _send(self, number: int) -> None:
        """Send a reading that waits, and those before it to be absorbed."""
        while self._waiting[0][0] < number:
            earlier, before = self._waiting.popleft()
            if self._absorbs and not self.out and number - earlier < ABSORBED:
                self._todo.put(ABSORB)
                self._todo.put(before)
        _, waiting = self._waiting.popleft()
        if self.out:
            raise PluginError(self.out)
        self._todo.put(waiting)
        self._asked, self._busy, self._sent_at = number, True, time.monotonic()

    def _received(self, wait: bool) -> Sequence[HypothesisCloud]:
        """The clouds of the reading that was sent; nothing as long as it is processed."""
        try:
            answer = self._answers.get(block=wait, timeout=self._patience)
        except queue.Empty:
            why = f"gave no answer within {self._patience:g} s (`patience`)"
            if wait:
                raise self._stay_out(why) from None
            if self._live and time.monotonic() - self._sent_at > self._patience:
                self._process.kill()
                raise self._started_again(why) from None
            return ()
        self._busy, outdated, self._outdated = False, self._outdated, False
        self._patience = self.config.patience
        if answer is None:
            answer = self._after_end()
        if outdated:
            return ()
        if self._asked:
            self.answered.append(self._asked)
        made = Answered() if isinstance(answer, PluginError) else answer
        self.resultant, self.measured, self._waits_for = made.resultant, made.stamp, made.waits_for
        self.trouble = made.trouble
        if isinstance(answer, PluginError):
            raise answer
        return answer.clouds

    def reset(self) -> None:
        """Drop the readings that wait or are being processed; a process that ended starts again."""
        self._waiting.clear()
        self.ends = self._given = 0
        self.resultant, self._waits_for = None, ""
        if self.out:
            self.out = ""
            self._start()
        elif self._busy:
            self._outdated = True
        self._todo.put(RESET)

    def close(self) -> None:
        """End the process."""
        self._todo.put(END)
        self._process.join(timeout=0.2)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._courier.join(timeout=0.2)  # children of the process may hold the pipe

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve,
            args=(theirs, self.name, self._module),
            name=f"contactfusion {self.name}",
            daemon=True,
        )
        self._process.start()
        theirs.close()
        self._todo, self._answers = queue.SimpleQueue[Packed](), queue.SimpleQueue[Answer]()
        self._courier = threading.Thread(
            target=_carry, args=(ours, self._todo, self._answers), daemon=True
        )
        self._courier.start()
        self._todo.put(self._packed)
        self._asked, self._busy, self._outdated = 0, True, False
        self._sent_at = time.monotonic()
        self._patience = max(START, self.config.patience)

    def _after_end(self) -> PluginError:
        """Start again after the process ended, or stay out."""
        self._process.join(timeout=0.1)  # its pipe closes just before it ends
        how = f"has ended (exit code {self._process.exitcode})"
        if not self._asked and self._process.exitcode == 1 and _is_script():
            how += ', as where a script does not begin its work below `if __name__ == "__main__":`'
        return self._started_again(how)

    def _started_again(self, how: str) -> PluginError:
        """Start again unless that was done too often; the reading in process is lost."""
        if self.ends == RESTARTS:
            return self._stay_out(f"{how} {RESTARTS + 1} times")
        self.ends += 1
        if self._live:  # what waits would keep the new process busy with the past
            self._waiting.clear()
        self.close()
        self._start()
        again = f"it is started again, {self.ends} of {RESTARTS} times"
        return PluginError(f"the process of '{self.name}' {how}: {again}")

    def _stay_out(self, why: str) -> PluginError:
        self.close()
        self._busy = False
        self.out = f"the process of '{self.name}' {why}: it stays out"
        return PluginError(self.out)


@dataclass(frozen=True)
class _Travelling:
    """The last step as a generator may access it; a whole `Fusion` is not sent."""

    contacts: tuple[Contact, ...]
    places: FloatArray

    def evidence(self, without: str) -> FloatArray:
        return self.places


def _is_script() -> bool:
    """Whether this process runs a script, which its children run again as far as its guard."""
    main = sys.modules["__main__"]
    return main.__spec__ is None and hasattr(main, "__file__")


def _portable(state: State, name: str) -> State:
    """The state without large parts that the process can compute itself."""
    if state.robot is not None:
        state = replace(state, surface=None)
    if state.fusion is None:
        return state
    last = _Travelling(state.fusion.contacts, state.evidence(without=name))
    return replace(state, fusion=last)


def _unpacked(state: State) -> State:
    return state if state.robot is None else replace(state, surface=state.robot.surface)


END = object()
"""The message that ends the courier."""
RESET, ABSORB = b"", b"absorb"
"""The message that resets the generator, and what precedes a reading that it is to absorb; neither
gets an answer."""


def _carry(
    pipe: Connection, todo: "queue.SimpleQueue[Packed]", answers: "queue.SimpleQueue[Answer]"
) -> None:
    """Send work to a process and receive its answers; only this thread ever waits for the pipe."""
    with pipe:
        is_absorbed = False
        while (given := todo.get()) is not END:
            answer: Answer = Answered()
            is_answered = not (given is RESET or given is ABSORB or is_absorbed)
            is_absorbed = given is ABSORB
            try:
                pipe.send_bytes(given)
                if is_answered:
                    answer = pipe.recv()
            except (EOFError, OSError):
                answer = None
            except Exception as error:  # unpickling the plug-in's objects may raise anything
                answer = PluginError(f"an answer cannot be unpickled: {cause_in(error, '')}")
            if is_answered:
                answers.put(answer)


def _end_with_parent(parent: int) -> None:
    """End once the parent has: a plug-in that is busy does not see that the pipe is closed."""
    while os.getppid() == parent:
        time.sleep(LOOK)
    os._exit(1)


def _serve(pipe: Connection, name: str, module: str) -> None:
    """Answer messages: the generator itself, then readings; a reset gets no answer.

    A generator that cannot be prepared, or be reset, answers every reading with the reason.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupted parent closes the pipe
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    generator: Any = None
    unfit: PluginError | None = None
    unready: PluginError | None = None
    failed: PluginError | None = None  # to absorb: the next answer reports it

    def attempt(who: str, do: Callable[[], Packed]) -> Packed | PluginError:
        try:
            return do()
        except PluginError as error:
            return error
        except BaseException as error:
            failed = PluginError(f"{who} raised {cause_in(error, module, type(generator))}")
            failed.add_note("".join(traceback.format_exception(error)))
            return failed

    def prepare() -> None:
        nonlocal generator
        generator, model = pickle.loads(given)
        if model is not None:
            generator.prepare(model)

    def reset() -> None:
        generator.reset()

    def absorb() -> None:
        reading, state = pickle.loads(given)
        generator.absorb(reading, _unpacked(state))

    def answered() -> Packed:
        reading, state = pickle.loads(given)
        clouds = checked_clouds(generator.generate(reading, _unpacked(state)))
        resultant, waits_for, trouble = None, "", failed
        try:
            resultant, waits_for = generator.resultant, generator.waits_for
        except Exception as error:  # the clouds count all the same
            who = f"`resultant` or `waits_for` of '{name}'"
            trouble = PluginError(f"{who} raised {cause_in(error, module, type(generator))}")
        left = resultant, reading.stamp, waits_for, str(trouble or "")
        return ForkingPickler.dumps(Answered(clouds, *left))

    with contextlib.suppress(EOFError, OSError):
        given = pipe.recv_bytes()
        unfit = attempt(f"`prepare` of '{name}'", prepare)
        pipe.send(unfit or Answered())
        while True:
            given = pipe.recv_bytes()
            if given == RESET:
                unready = unfit or attempt(f"`reset` of '{name}'", reset)
                continue
            if given == ABSORB:
                given = pipe.recv_bytes()
                if not (unfit or unready):
                    failed = failed or attempt(f"`absorb` of '{name}'", absorb)
                continue
            answer = unfit or unready or attempt(f"'{name}'", answered)
            failed = None
            if isinstance(answer, PluginError):
                pipe.send(answer)
            else:
                pipe.send_bytes(answer)
