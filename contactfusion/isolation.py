"""A generator in a process of its own, so that no cycle waits for it."""

import multiprocessing
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any

from contactfusion.errors import PluginError
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.readings import Reading
from contactfusion.state import State


class Isolated(Generator[GeneratorConfig]):
    """Stands for a generator that runs elsewhere.

    A reading that comes while the generator is busy takes the place of the one that waits, so it
    always works on the newest. Its clouds come with the step after it is done.

    Args:
        inner: the generator that goes to a process of its own.
    """

    def __init__(self, inner: Generator[Any]) -> None:
        super().__init__(inner.name, inner.config)
        self.readings = inner.readings  # type: ignore[misc]
        self.outputs = inner.outputs
        self._inner = inner
        self._waiting: tuple[Reading, State] | None = None
        self._busy = False
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(inner, theirs), name=f"contactfusion {inner.name}", daemon=True
        )
        self._process.start()
        theirs.close()

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Hand the reading over and give what has been finished."""
        self._waiting = reading, state
        return self.collect()

    def collect(self) -> Sequence[HypothesisCloud]:
        """Give the clouds that have been finished, and start on what waits.

        Raises:
            PluginError: the generator raised, or its process ended.
        """
        clouds: Sequence[HypothesisCloud] = ()
        try:
            if self._busy and self._pipe.poll():
                result = self._pipe.recv()
                self._busy = False
                if isinstance(result, str):
                    raise PluginError(result)
                clouds = result
            if self._waiting is not None and not self._busy:
                self._pipe.send(self._waiting)
                self._waiting, self._busy = None, True
        except (EOFError, OSError):
            self._waiting, self._busy = None, False
            how = f"exit code {self._process.exitcode}"
            raise PluginError(f"the process of '{self.name}' has ended ({how})") from None
        return clouds

    def reset(self) -> None:
        """Forget what waits; the generator itself starts again with the next reading."""
        self._waiting = None
        if not self._busy:
            self._pipe.send(None)

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self._process.join(timeout=0.2)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _serve(generator: Generator[Any], pipe: Connection) -> None:
    """Answer readings with clouds, or with a sentence when the generator raises."""
    while True:
        try:
            given = pipe.recv()
        except (EOFError, OSError):
            return
        if given is None:
            generator.reset()
            continue
        try:
            answer: object = list(generator.generate(*given))
        except Exception as error:  # the cycle must hear of it, whatever it is
            answer = f"{type(error).__name__}: {error}"
        pipe.send(answer)
