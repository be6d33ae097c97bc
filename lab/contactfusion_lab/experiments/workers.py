"""Many tasks, each in a process that may die without harm to the others."""

import multiprocessing
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Generic, TypeVar, final

from contactfusion.errors import ConfigurationError, ContactFusionError
from contactfusion.terminal import note

T = TypeVar("T")
R = TypeVar("R")
TOLD = 50
"""Where nobody looks, every so many tasks are told."""
POOLS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


@dataclass(frozen=True)
class Died:
    """What comes of a task whose process has ended twice.

    Attributes:
        how: such as "was killed by SIGKILL".
    """

    how: str


def each(
    make: Callable[[T], R], tasks: Sequence[T], workers: int
) -> Generator[tuple[T, R | Died], None, None]:
    """Do tasks in processes that share nothing with this one, and give what comes of each.

    A task whose process ends is tried again when all others are done, alone.

    Args:
        make: does one task; it can be pickled, as tasks and results can.
        tasks: what to do; results come in the order in which they are ready.
        workers: how many processes.

    Raises:
        ConfigurationError: there are no workers.
    """
    require_workers(workers)
    return _each(make, tasks, workers)


def require_workers(workers: int) -> None:
    """Make sure that somebody works.

    Raises:
        ConfigurationError: there are no workers.
    """
    if workers < 1:
        raise ConfigurationError(f"it takes 1 worker or more, not {workers}", "workers")


def progress(done: Iterable[T], count: int) -> Iterator[T]:
    """Pass on what is done, and report how long the rest will take.

    Args:
        done: one by one.
        count: of all.
    """
    start = time.monotonic()
    for number, one in enumerate(done, 1):
        yield one
        if sys.stderr.isatty() or number % TOLD == 0:
            left = (time.monotonic() - start) / number * (count - number)
            end = "\r" if sys.stderr.isatty() else "\n"
            note(f"  {number} of {count}, {left:.0f} s left ", end, sys.stderr)


def reason_of(error: Exception) -> str:
    """Why a task failed: the sentence of an error of ours, or the kind of any other."""
    told = str(error)
    return told if isinstance(error, ContactFusionError) else f"{type(error).__name__}: {told}"


def failure(name: str, told: Died | str) -> str:
    """Which task failed, and why."""
    return f"{name}: its process {told.how}, twice" if isinstance(told, Died) else f"{name}: {told}"


def _each(
    make: Callable[[T], R], tasks: Sequence[T], workers: int
) -> Generator[tuple[T, R | Died], None, None]:
    again = []
    for task, done in _shared(make, tasks, workers):
        if isinstance(done, Died):
            again.append(task)
        else:
            yield task, done
    for task in again:
        yield from _shared(make, [task], 1)


def _shared(
    make: Callable[[T], R], tasks: Sequence[T], workers: int
) -> Iterator[tuple[T, R | Died]]:
    waiting = deque(tasks)
    team: dict[Connection, _Worker[T, R]] = {}
    try:
        while waiting or team:
            while waiting and len(team) < workers:
                worker = _Worker(make, waiting.popleft())
                team[worker.pipe] = worker
            for pipe in wait(list(team)):
                assert isinstance(pipe, Connection)
                worker = team[pipe]
                task, done = worker.task, worker.result()
                if isinstance(done, Died) or not waiting:
                    team.pop(pipe).end()
                else:
                    worker.give(waiting.popleft())
                yield task, done
    finally:
        for worker in team.values():
            worker.end()


@final
class _Worker(Generic[T, R]):
    """A process, and the task that it is at."""

    def __init__(self, make: Callable[[T], R], task: T) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(make, there), daemon=True)
        self._process.start()
        there.close()  # so that the pipe ends with the process
        self.give(task)

    def give(self, task: T) -> None:
        """Let it do a task."""
        self.task = task
        try:
            self.pipe.send(task)
        except OSError:
            return  # it has ended, as `result` will tell

    def result(self) -> R | Died:
        """What came of the task."""
        try:
            done: R = self.pipe.recv()
            return done
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode or 0
            if code < 0:
                return Died(f"was killed by {signal.Signals(-code).name}")
            return Died(f"ended with status {code}")

    def end(self) -> None:
        """End the process."""
        self.pipe.close()
        self._process.terminate()
        self._process.join()


def _serve(make: Callable[[T], R], pipe: Connection) -> None:
    """Do tasks until there are no more; interrupts are for the process that gives them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        while True:
            pipe.send(make(pipe.recv()))
    except (EOFError, OSError):
        return  # nobody asks any more


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Let processes that begin within have one thread, unless the user says how many.

    There are as many workers as there are cores to use; a second thread of one would wait for the
    others, and a cycle of 5 ms would take 25.
    """
    mine = [name for name in POOLS if name not in os.environ]
    os.environ.update(dict.fromkeys(mine, "1"))
    try:
        yield
    finally:
        for name in mine:
            os.environ.pop(name, None)
