"""An executor for tests: tasks are done in this process, as processes are slow to start."""

import pickle
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar, final

from contactfusion_lab.trials.executor import Executor, WorkerCrashed

T = TypeVar("T")
R = TypeVar("R")


@final
@dataclass(frozen=True)
class Here(Executor):
    """Tasks one by one in this process, with all that would go to another.

    Attributes:
        crashing: the rows of tasks whose worker crashes.
        stop: after so many results the user interrupts; None: never.
    """

    crashing: tuple[int, ...] = ()
    stop: int | None = None

    @property
    def local(self) -> Executor:
        """Without crashes."""
        return Here()

    def results(
        self, make: Callable[[T], R], tasks: Sequence[T]
    ) -> Generator[tuple[int, R | WorkerCrashed]]:
        for row, task in enumerate(tasks):
            if row == self.stop:
                raise KeyboardInterrupt
            if row in self.crashing:
                yield row, WorkerCrashed("its process was killed by SIGSEGV, twice")
                continue
            there, given = pickle.loads(pickle.dumps((make, task)))
            yield row, pickle.loads(pickle.dumps(there(given)))
