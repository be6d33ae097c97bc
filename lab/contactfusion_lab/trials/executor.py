"""Executors of tasks, the local one of processes, and files that go along with tasks."""

import hashlib
import multiprocessing
import os
import signal
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from glob import escape
from multiprocessing.connection import Connection, wait
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Generic, TypeVar, final

from contactfusion.errors import ConfigurationError
from contactfusion.files import write_whole

if TYPE_CHECKING:
    Native = Path
else:
    Native = type(Path())  # a bare Path cannot be derived from before Python 3.12
T = TypeVar("T")
R = TypeVar("R")
POOLS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


@dataclass(frozen=True)
class WorkerCrashed:
    """The result of a task whose workers crashed.

    Attributes:
        how: such as "its process was killed by SIGKILL, twice".
    """

    how: str


class Executor(ABC):
    """Workers that share nothing with this process, and do tasks."""

    @abstractmethod
    def results(
        self, make: Callable[[T], R], tasks: Sequence[T]
    ) -> Generator[tuple[int, R | WorkerCrashed]]:
        """Do tasks; one whose worker crashed is tried again.

        Args:
            make: does a task; can be pickled, as tasks and results can.
            tasks: what to do.

        Yields:
            The row of a task and its result, in the order in which they are ready.
        """

    @property
    @abstractmethod
    def local(self) -> "Executor":
        """The workers for what needs files of this machine, or writes some."""


@final
@dataclass(frozen=True)
class Local(Executor):
    """Processes on this machine, of one thread each.

    Attributes:
        workers: how many.

    Raises:
        ConfigurationError: there are none.
    """

    workers: int = 2

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise ConfigurationError(f"it takes 1 worker or more, not {self.workers}", "workers")

    @property
    def local(self) -> Executor:
        """Themselves."""
        return self

    def results(
        self, make: Callable[[T], R], tasks: Sequence[T]
    ) -> Generator[tuple[int, R | WorkerCrashed]]:
        """Do tasks; one whose process crashed is tried once more when the others are done."""
        again = []
        with _one_thread_each():
            for row, result in _shared(make, list(enumerate(tasks)), self.workers):
                if isinstance(result, WorkerCrashed):
                    again.append(row)
                else:
                    yield row, result
            for row in again:
                for _, result in _shared(make, [(row, tasks[row])], 1):
                    if isinstance(result, WorkerCrashed):
                        result = WorkerCrashed(f"{result.how}, twice")
                    yield row, result


def _shared(
    make: Callable[[T], R], tasks: Sequence[tuple[int, T]], workers: int
) -> Iterator[tuple[int, R | WorkerCrashed]]:
    waiting = deque(tasks)
    team: dict[Connection, _Worker[T, R]] = {}
    try:
        while waiting or team:
            while waiting and len(team) < workers:
                worker = _Worker(make, *waiting.popleft())
                team[worker.pipe] = worker
            for pipe in wait(list(team)):
                assert isinstance(pipe, Connection)
                worker = team[pipe]
                row, result = worker.row, worker.result()
                if isinstance(result, WorkerCrashed) or not waiting:
                    team.pop(pipe).end()
                else:
                    worker.send(*waiting.popleft())
                yield row, result
    finally:
        for worker in team.values():
            worker.end()


@final
class _Worker(Generic[T, R]):
    """A process, and the row of the task that it is at."""

    def __init__(self, make: Callable[[T], R], row: int, task: T) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(make, there), daemon=True)
        self._process.start()
        there.close()  # so that the pipe ends with the process
        self.send(row, task)

    def send(self, row: int, task: T) -> None:
        """Start a task."""
        self.row = row
        try:
            self.pipe.send(task)
        except OSError:
            return  # it has ended, as `result` will find

    def result(self) -> R | WorkerCrashed:
        """The result of its task."""
        try:
            result: R = self.pipe.recv()
            return result
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode or 0
            if code < 0:
                return WorkerCrashed(f"its process was killed by {signal.Signals(-code).name}")
            return WorkerCrashed(f"its process ended with status {code}")

    def end(self) -> None:
        """End the process."""
        self.pipe.close()
        self._process.terminate()
        self._process.join()


def _serve(make: Callable[[T], R], pipe: Connection) -> None:
    """Do tasks until there are no more; interrupts are for the process that sends them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        while True:
            pipe.send(make(pipe.recv()))
    except (EOFError, OSError):
        return  # the other end is closed


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Limit processes that begin within to one thread, unless the user has set a number.

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


class ShippedFile(Native):
    """A path that takes its file along where it is pickled, and those beside it of the same stem.

    Unpickled it is the same path, if the same files are there, and else that of a copy,
    which lasts as long as the process.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        files = sorted(self.parent.glob(f"{escape(self.stem)}.*"))
        return _arrived, (str(self), {path.name: path.read_bytes() for path in files})


def _arrived(path: str, files: dict[str, bytes]) -> ShippedFile:
    there = Path(path)
    beside = [there.with_name(name) for name in files]
    if all(copy.is_file() and copy.read_bytes() == files[copy.name] for copy in beside):
        return ShippedFile(there)
    digest = hashlib.sha256(b"".join(files.values())).hexdigest()
    folder = Path(_copies().name) / digest
    for name, content in files.items():
        if not (folder / name).is_file():
            write_whole(folder / name, content)
    return ShippedFile(folder / there.name)


@cache
def _copies() -> TemporaryDirectory[str]:
    """The folder of copies; it goes with the process."""
    return TemporaryDirectory(prefix="contactfusion_")
