"""A generator in a process of its own, so that no cycle waits for it."""

import contextlib
import multiprocessing
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import TYPE_CHECKING, Any, cast

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.errors import PluginError
from contactfusion.generator import Generator, GeneratorConfig
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.readings import Reading
from contactfusion.state import State

if TYPE_CHECKING:
    from contactfusion.integrator.fusion import Fusion
Packed = Any
"""A reading and the state at its stamp, as bytes in a buffer."""


class Isolated(Generator[GeneratorConfig]):
    """Stands for a generator that runs elsewhere.

    Nobody waits for it on a live robot: a reading that comes while the generator is busy takes the
    place of the one that waits, so it always works on the newest, and its clouds come with the step
    after it is done. Where there is no clock, every reading is worked on, and each step waits for
    those before it, so that equal input gives equal contacts.

    Args:
        inner: the generator that goes to a process of its own.
        live: whether nobody waits for it.
    """

    def __init__(self, inner: Generator[Any], live: bool) -> None:
        super().__init__(inner.name, inner.config)
        # what a class declares for all its instances, this one borrows from another class
        self.readings = inner.readings  # type: ignore[misc]
        self.outputs = inner.outputs
        self._inner = inner
        self._live = live
        self._waiting = deque[Packed](maxlen=1 if live else None)
        self._busy = True  # until it says that it has started: a pipe that nobody reads may block
        self._outdated = False
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(inner, theirs), name=f"contactfusion {inner.name}", daemon=True
        )
        try:
            self._process.start()
        except Exception as error:  # pickle raises anything
            self._pipe.close()
            raise PluginError(
                f"'{inner.name}' cannot be isolated, for it cannot be pickled: {error}"
            ) from error
        finally:
            theirs.close()

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """Hand the reading over; live, give what has been finished."""
        given = reading, _portable(state, self.name)
        self._waiting.append(ForkingPickler.dumps(given))  # the state as it is now
        return self.collect(wait=False) if self._live or not self._busy else ()

    def most_hypotheses(self, grid: Grid) -> int | None:
        """As many as the generator that runs elsewhere gives."""
        return self._inner.most_hypotheses(grid)

    @property
    def owes(self) -> bool:
        """Whether a step has to wait for it."""
        return not self._live and bool(self._busy or self._waiting)

    def collect(self, wait: bool) -> Sequence[HypothesisCloud]:
        """Give the clouds of a reading that has been finished, and start on what waits.

        Args:
            wait: whether to wait until one is.

        Raises:
            PluginError: the generator raised, or its process ended.
        """
        clouds: Sequence[HypothesisCloud] = ()
        try:
            if self._busy and (wait or self._pipe.poll()):
                self._busy, outdated, self._outdated = False, self._outdated, False
                result = self._pipe.recv()
                if not outdated:
                    if isinstance(result, str):
                        raise PluginError(result)
                    clouds = result
            if self._waiting and not self._busy:
                self._pipe.send_bytes(self._waiting.popleft())
                self._busy = True
        except (EOFError, OSError):
            self._busy = False
            self._waiting.clear()
            self._process.join(timeout=0.05)  # its pipe closes just before it is gone
            how = f"exit code {self._process.exitcode}"
            raise PluginError(f"the process of '{self.name}' has ended ({how})") from None
        return clouds

    def reset(self) -> None:
        """Forget what waits and what is being worked on; a process that ended stays silent."""
        self._outdated = self._busy
        self._waiting.clear()
        with contextlib.suppress(OSError):
            self._pipe.send(None)

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self._process.join(timeout=0.2)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


@dataclass(frozen=True)
class _LastStep:
    """What a generator may ask of the last step; a whole `Fusion` does not travel."""

    contacts: tuple[Contact, ...]
    places: FloatArray

    def evidence(self, without: str) -> FloatArray:
        return self.places


def _portable(state: State, name: str) -> State:
    """Leave at home what is large and can be found again there."""
    if state.robot is not None:
        state = replace(state, surface=None)
    if state.fusion is None:
        return state
    last = _LastStep(state.fusion.contacts, state.evidence(without=name))
    return replace(state, fusion=cast("Fusion", last))


def _unpacked(state: State) -> State:
    return state if state.robot is None else replace(state, surface=state.robot.surface)


def _serve(generator: Generator[Any], pipe: Connection) -> None:
    """Answer readings with clouds, or with a sentence when the generator raises."""
    pipe.send([])
    while True:
        try:
            given = pipe.recv()
        except (EOFError, OSError):
            return
        if given is None:
            generator.reset()
            continue
        try:
            reading, state = given
            answer: object = list(generator.generate(reading, _unpacked(state)))
        except Exception as error:  # the cycle must hear of it, whatever it is
            answer = f"{type(error).__name__}: {error}"
        pipe.send(answer)
