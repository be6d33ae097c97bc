"""Interleaved rounds on one thread: what runs side by side meets the same machine."""

import gc
import os
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

Run = Callable[[], float]  # one run; its CPU time [s]

_POOLS = ("OMP", "MKL", "OPENBLAS", "NUMBA")


@dataclass(frozen=True)
class Spread:
    """A median and the range around it."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """Summarise values.

        Args:
            values: at least one.

        Returns:
            their median, smallest and largest.
        """
        return cls(statistics.median(values), min(values), max(values))


@dataclass(frozen=True)
class Rounds:
    """The CPU times of named runs, round by round.

    Attributes:
        seconds: of each name one time a round [s].
    """

    seconds: Mapping[str, Sequence[float]]

    def time(self, name: str) -> Spread:
        """Give the CPU time of one run.

        Args:
            name: which.

        Returns:
            [s].
        """
        return Spread.of(self.seconds[name])

    def ratio(self, name: str, base: str) -> Spread:
        """Say how many times longer one run takes than another, compared inside each round.

        Args:
            name: the run above the line.
            base: the run below it.

        Returns:
            the median and range of the rounds' ratios.
        """
        pairs = zip(self.seconds[name], self.seconds[base], strict=True)
        return Spread.of([above / below for above, below in pairs])


def one_thread() -> None:
    """Hold this process and its children to one thread; call it before numpy is imported.

    Open3D's thread pool heeds no variable, only the cores it may run on, so all share one core.

    Raises:
        RuntimeError: numpy is there already, with its thread pools.
    """
    if "numpy" in sys.modules:
        raise RuntimeError("one_thread() must come before the first import of numpy")
    for pool in _POOLS:
        os.environ[f"{pool}_NUM_THREADS"] = "1"
    if sys.platform == "linux":
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def timed(work: Callable[[], object]) -> Run:
    """Make a run of any callable, by the CPU time of the whole process.

    Args:
        work: called once a run, its result dropped after the clock stops.

    Returns:
        the run.
    """

    def run() -> float:
        start = time.process_time()
        result = work()
        seconds = time.process_time() - start
        del result
        return seconds

    return run


def interleave(
    runs: Mapping[str, Run], *, rounds: int = 5, repeats: Mapping[str, int] | None = None
) -> Rounds:
    """Time named runs in turn, round after round, after one round that does not count.

    Every round starts with another run, so that none always follows the same neighbour.

    Args:
        runs: by name.
        rounds: how many count; at least 5 for a table that others see.
        repeats: of short runs, how often each runs in one round (default 1); the median counts.

    Returns:
        the times.
    """
    often = repeats or {}
    names = list(runs)
    seconds: dict[str, list[float]] = {name: [] for name in names}
    for number in range(rounds + 1):
        first = number % len(names)
        for name in names[first:] + names[:first]:
            gc.collect()  # garbage of the neighbour is not this run's
            taken = statistics.median(runs[name]() for _ in range(often.get(name, 1)))
            if number > 0:
                seconds[name].append(taken)
    return Rounds(seconds)
