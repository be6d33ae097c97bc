"""The executor of a cluster: workers of a dask scheduler, on whichever machines they run."""

import hashlib
import logging
import os
import platform
import re
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar, final

import contactfusion
import contactfusion_lab
from contactfusion.errors import ConfigurationError, ContactFusionError, DependencyError
from contactfusion_lab.trials.executor import Executor, Local, WorkerCrashed

try:
    from distributed import Client, Future, KilledWorker, get_worker
except ImportError:
    raise DependencyError(
        "distributed is not installed; install it with: pip install 'contactfusion-lab[cluster]'"
    ) from None

T = TypeVar("T")
R = TypeVar("R")
ADDRESS = r"(\w+://)?(\[[\da-fA-F:]+\]|[^\s:/]+):\d+"
"""The form of the address of a scheduler."""
CONNECT = 5.0
"""A scheduler answers within this [s]."""
WITHOUT = 60.0
"""For so long tasks wait for a worker, when none is left [s]."""
LOOK = 2.0
"""While nothing is ready, scheduler and workers are looked after at this period [s]."""
QUEUED = 64
"""Least number of tasks queued at the scheduler, which are at least two for each worker."""
PACKAGES = (
    "contactfusion", "contactfusion-lab", "distributed", "numba", "numpy", "open3d-cpu", "pin",
    "pybullet", "scipy",
)  # fmt: skip
"""Packages that have to be of the same version on all machines."""


@dataclass(frozen=True)
class Unfit:
    """The result of a worker whose versions differ from those of this process.

    Attributes:
        why: a sentence.
    """

    why: str


@final
@dataclass(frozen=True)
class Dask(Executor):
    """The workers of a dask scheduler; they send results back and write nothing.

    Attributes:
        scheduler: its address, such as "tcp://10.0.0.1:8786".

    Raises:
        ConfigurationError: nothing answers at the address, it has no workers, or one of them has
            other versions than this process or several threads.
    """

    scheduler: str

    def __post_init__(self) -> None:
        with _connected(self.scheduler):
            pass

    @property
    def local(self) -> Executor:
        """Processes on this machine."""
        return Local()

    def results(
        self, make: Callable[[T], R], tasks: Sequence[T]
    ) -> Generator[tuple[int, R | WorkerCrashed]]:
        """Do tasks; one that a worker was lost with, too often, is tried once more, alone.

        As often as the scheduler allows, it has other workers try it before: also where it only
        waited at a worker that another task made crash.

        Raises:
            ContactFusionError: the scheduler is lost, or all of its workers.
        """
        with _connected(self.scheduler) as client:
            again = []
            for row, result in self._shared(client, make, list(enumerate(tasks))):
                if isinstance(result, WorkerCrashed):
                    again.append(row)
                else:
                    yield row, result
            for row in again:
                yield from self._shared(client, make, [(row, tasks[row])])

    def _shared(
        self, client: Client, make: Callable[[T], R], tasks: Sequence[tuple[int, T]]
    ) -> Iterator[tuple[int, R | WorkerCrashed]]:
        queued = max(QUEUED, 2 * len(_workers(client)))
        waiting = deque(tasks)
        at_work: dict[int, Future[Any]] = {}
        ready = SimpleQueue[int]()
        while waiting or at_work:
            while waiting and len(at_work) < queued:
                row, task = waiting.popleft()
                at_work[row] = client.submit(_do, _versions(), make, task, pure=False)
                at_work[row].add_done_callback(partial(_note, ready, row))
            row = self._next(client, ready)
            yield row, self._result(at_work.pop(row))

    def _next(self, client: Client, ready: SimpleQueue[int]) -> int:
        """The row of a task that is done."""
        idle = 0.0
        while True:
            try:
                return ready.get(timeout=LOOK)
            except Empty:
                if client.status != "running":
                    raise self._lost() from None
                idle = 0.0 if _workers(client) else idle + LOOK
                if idle >= WITHOUT:
                    raise _without_workers(self.scheduler) from None

    def _result(self, future: "Future[Any]") -> Any:
        """The result of a task that is done."""
        try:
            result = future.result()
        except KilledWorker as error:
            return WorkerCrashed(f"its workers were lost, the last at {error.last_worker.address}")
        except (OSError, CancelledError):
            raise self._lost() from None
        except Exception as error:
            raise _unfit(self.scheduler, error) from None
        if isinstance(result, Unfit):
            raise ConfigurationError(result.why)
        return result

    def _lost(self) -> ContactFusionError:
        return ContactFusionError(
            f"the scheduler at {self.scheduler} is lost; what was done is kept: start again to "
            "go on"
        )


def _note(ready: SimpleQueue[int], row: int, future: "Future[Any]") -> None:
    ready.put(row)


@contextmanager
def _connected(scheduler: str) -> Iterator[Client]:
    """A client of a scheduler that has workers as they should be.

    Raises:
        ConfigurationError: there is none.
    """
    if not re.fullmatch(ADDRESS, scheduler):
        raise ConfigurationError(
            f"a dask scheduler has an address such as tcp://HOST:8786, not '{scheduler}'",
            "scheduler",
        )
    for name in list(logging.root.manager.loggerDict):
        if name.startswith("distributed"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters becomes a sentence
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of versions: they are compared below
            client = Client(scheduler, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        why = str(error).split("\n")[0]
        raise ConfigurationError(
            f"no dask scheduler answers at '{scheduler}' within {CONNECT:.0f} s: {why}", "scheduler"
        ) from None
    try:
        _require_workers(client, scheduler)
        yield client
    finally:
        with suppress(Exception):  # its scheduler may be gone
            client.close(timeout=CONNECT)


def _require_workers(client: Client, scheduler: str) -> None:
    """Make sure that there are workers, all of one thread and the versions of this process.

    Raises:
        ConfigurationError: there are none, or a worker is not.
    """
    workers = _workers(client)
    if not workers:
        raise _without_workers(scheduler)
    for address, worker in workers.items():
        if worker["nthreads"] != 1:
            raise ConfigurationError(_with_threads(address, worker["nthreads"]), "scheduler")
    try:
        found: Any = client.run(_versions)
    except Exception as error:
        raise _unfit(scheduler, error) from None
    for address, versions in found.items():
        if why := _other(address, versions, _versions()):
            raise ConfigurationError(why, "scheduler")


def _workers(client: Client) -> dict[str, Any]:
    """The workers of a scheduler, by address."""
    workers: dict[str, Any] = client.scheduler_info()["workers"]
    return workers


def _do(versions: dict[str, str], make: Callable[[T], R], task: T) -> R | Unfit:
    """Do a task on a worker, which may have come after the others were looked at."""
    worker = get_worker()
    if worker.state.nthreads != 1:
        return Unfit(_with_threads(worker.address, worker.state.nthreads))
    why = _other(worker.address, _versions(), versions)
    return Unfit(why) if why else make(task)


@cache
def _versions() -> dict[str, str]:
    """Versions that results depend on, and a digest of our own files."""
    found = {"Python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    digest = hashlib.sha256()
    for module in (contactfusion, contactfusion_lab):
        top = Path(module.__path__[0])
        files = [
            Path(folder, name)
            for folder, _, names in os.walk(top, followlinks=True)
            for name in names
            if Path(folder).name != "__pycache__"  # kernels are compiled for each machine
        ]
        for path in sorted(files):
            digest.update(str(path.relative_to(top)).encode() + path.read_bytes())
    return {**found, "code": digest.hexdigest()}


def _other(address: str, versions: dict[str, str], ours: dict[str, str]) -> str:
    """Differences of the versions of a worker from ours; empty if there are none."""
    for name, value in ours.items():
        if versions.get(name) != value:
            what = f"{name} {versions.get(name, 'missing')}, not {value} as here"
            if name == "code":
                what = "other code of contactfusion or contactfusion-lab than here"
            return f"the worker at {address} has {what}: results could differ; install the same"
    return ""


def _with_threads(address: str, threads: int) -> str:
    return (
        f"the worker at {address} has {threads} threads, but a trial takes a process: start it "
        "with --nthreads 1"
    )


def _without_workers(scheduler: str) -> ConfigurationError:
    start = f"dask worker {scheduler} --nthreads 1 --nworkers N"
    return ConfigurationError(
        f"the scheduler at '{scheduler}' has no workers: start some by '{start}'", "scheduler"
    )


def _unfit(scheduler: str, error: Exception) -> ConfigurationError:
    return ConfigurationError(
        f"the workers of '{scheduler}' cannot do this: {type(error).__name__}: {error}; install "
        "on them what is installed here",
        "scheduler",
    )
