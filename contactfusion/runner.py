"""A pipeline on a running robot: how long its generators take, and what is done about it."""

import functools
import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from contactfusion.assembly import AnyGenerator
from contactfusion.changes import Change
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.integrator.sources import EventKind
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.state import State
from contactfusion.stopwatch import StopWatch

OVERRUNS = 3
"""A generator that exceeds its budget this often in a row goes to a process of its own."""


class Budgets:
    """Watches how long generators take.

    Args:
        clock: gives seconds.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self.watch = StopWatch(clock)
        self._overruns: Counter[str] = Counter()
        self.note: Callable[[str, str], object] = lambda name, message: None
        """Takes the name of a generator, and a sentence."""

    def ask(
        self, generator: AnyGenerator, reading: Reading, state: State
    ) -> Sequence[HypothesisCloud]:
        """The clouds of a generator for a reading, timed."""
        try:
            return self.watch.ask(generator, reading, state)
        finally:
            took, budget = self.watch.took, generator.config.budget
            if took > budget:
                self._overruns[generator.name] += 1
                text = f"'{generator.name}' took {took:.3g} s of {budget:.3g} s"
                self.note(generator.name, text)
            else:
                del self._overruns[generator.name]

    def changes(self) -> Iterator[Change]:
        """The changes that free the loop of generators that were too slow too often."""
        for name, count in list(self._overruns.items()):
            if count >= OVERRUNS:
                del self._overruns[name]
                self.note(name, f"'{name}' leaves the loop after {count} overruns in a row")
                yield Change(f"isolate {shlex.quote(name)}")


class Runner:
    """Runs a pipeline against a clock, for a loop of your own; `contactfusion live` is ours.

    Generators that are too slow go to a process of their own; one that can't is unplugged.

    Args:
        config: the configuration of the pipeline.
        clock: gives seconds; `time.perf_counter` on a robot, anything else in a test.
    """

    def __init__(self, config: PipelineConfig, clock: Callable[[], float]) -> None:
        self._budgets = Budgets(clock)
        self.pipeline = Pipeline(config, ask=self._budgets.ask, live=True)
        self.pipeline.conflates = not config.cycle.ready
        self._budgets.note = functools.partial(self.pipeline.integrator.note, EventKind.OVERRUN)

    def receive(self, reading: Reading) -> None:
        """Pass a reading to the pipeline; then free the loop of generators that are too slow."""
        self.pipeline.receive(reading)
        for change in self._budgets.changes():
            change.carry_out(self.pipeline)
