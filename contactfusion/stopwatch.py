"""Processing times of generators, against their budgets."""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import final

from contactfusion.assembly import AnyGenerator
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.readings import Reading
from contactfusion.state import State


@final
class StopWatch:
    """Calls generators for their clouds, and counts the calls that exceed a budget.

    Args:
        clock: the time [s].
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._calls: Counter[str] = Counter()
        self._overruns: Counter[str] = Counter()
        self._longest: dict[str, tuple[float, float]] = {}
        self.took = 0.0
        """The duration of the last call [s]."""

    def ask(
        self, generator: AnyGenerator, reading: Reading, state: State
    ) -> Sequence[HypothesisCloud]:
        """The clouds of a generator for a reading, timed."""
        start = self._clock()
        try:
            return generator.generate(reading, state)
        finally:
            name, budget = generator.name, generator.config.budget
            self.took = self._clock() - start
            self._calls[name] += 1
            self._overruns[name] += self.took > budget
            self._longest[name] = max(self._longest.get(name, (0.0, 0.0)), (self.took, budget))

    def lines(self) -> Iterator[str]:
        """A line for each generator that exceeded its budget."""
        for name, overruns in self._overruns.items():
            if overruns:
                longest, budget = self._longest[name]
                yield (
                    f"  {overruns} of {self._calls[name]} calls of '{name}' took longer than its "
                    f"budget of {budget:.3g} s (at most {longest:.3g} s)"
                )
