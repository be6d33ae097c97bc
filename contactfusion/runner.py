"""A pipeline on a live robot: watches how long each generator takes."""

from collections import Counter
from collections.abc import Callable, Sequence

from contactfusion.assembly import AnyGenerator
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.integrator.sources import EventKind
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.state import State
from contactfusion.stopwatch import StopWatch

OVERRUNS = 3
"""A generator that exceeds its budget this often in a row is unplugged."""


class Runner:
    """Runs a pipeline against a clock, and unplugs generators that are too slow.

    Args:
        config: the configuration of the pipeline.
        clock: gives seconds; `time.perf_counter` on a robot, anything else in a test.
    """

    def __init__(self, config: PipelineConfig, clock: Callable[[], float]) -> None:
        self._watch = StopWatch(clock)
        self._overruns: Counter[str] = Counter()
        self.pipeline = Pipeline(config, ask=self._timed, live=True)

    def receive(self, reading: Reading) -> None:
        """Pass a reading to the pipeline; then unplug generators that were too slow too often."""
        self.pipeline.receive(reading)
        for name, count in list(self._overruns.items()):
            if count >= OVERRUNS and name in self.pipeline.generators:
                self.pipeline.unplug(name)
                del self._overruns[name]
                self._note(name, f"'{name}' was unplugged after {count} overruns in a row")

    def _timed(
        self, generator: AnyGenerator, reading: Reading, state: State
    ) -> Sequence[HypothesisCloud]:
        try:
            return self._watch.ask(generator, reading, state)
        finally:
            took, budget = self._watch.took, generator.config.budget
            if took > budget:
                self._overruns[generator.name] += 1
                self._note(
                    generator.name, f"'{generator.name}' took {took:.3g} s of {budget:.3g} s"
                )
            else:
                del self._overruns[generator.name]

    def _note(self, name: str, message: str) -> None:
        self.pipeline.integrator.note(EventKind.OVERRUN, name, message)
