"""A recording of a running robot, from the start or from when it is asked for."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import final

from contactfusion.errors import ConfigurationError
from contactfusion.files import make_folder
from contactfusion.loop import Observer
from contactfusion.pipeline import Step
from contactfusion.recordings.mcap import LATCHED
from contactfusion.recordings.recording import RawMessage
from contactfusion.run.outputs import Output, mcap_file
from contactfusion.run.session import Session

KEPT = 100
"""Number of latched messages that a recording holds from before it began."""


@final
class Tape:
    """Records what arrives, each step and each change, while it is asked to.

    Only a recording from the start on is played again exactly: one that begins later lacks what the
    pipeline remembers.

    Args:
        note: takes a sentence where a recording fails.
    """

    def __init__(self, note: Callable[[str], object]) -> None:
        self._note = note
        self._session: Session | None = None
        self._file: AbstractContextManager[Observer] | None = None
        self._output: Observer | None = None
        self._latched: dict[str, list[RawMessage]] = {}
        self.path: Path | None = None
        """The file that is recorded to; None: none."""

    def load(self, session: Session) -> None:
        """Take note of what is played, and of its configuration."""
        self._session = session

    def start(self, path: Path) -> str:
        """Begin a recording; a sentence on it.

        Raises:
            ConfigurationError: there is one already, or the name is none of an MCAP file.
            WritingError: the file can't be written.
        """
        if self._file is not None:
            raise ConfigurationError(f"{self.path} is being recorded; stop that first")
        if path.suffix != ".mcap":
            raise ConfigurationError(f"'{path}' is no name for a recording; let it end in .mcap")
        assert self._session is not None
        make_folder(path.parent)
        file = mcap_file(path, self._session)
        self._output = file.__enter__()
        self._file, self.path = file, path
        for kept in self._latched.values():
            for raw in kept:
                self.copy(raw, again=True)
        return f"recording to {path}"

    def stop(self) -> str:
        """End a recording, if there is one, and close its file whole; a sentence on it.

        Raises:
            WritingError: the file can't be written.
        """
        if self._file is None or self._output is None:
            raise ConfigurationError("nothing is being recorded")
        file, path, failure = self._file, self.path, self._output.failure
        self._file = self._output = self.path = None
        file.__exit__(type(failure) if failure else None, failure, None)
        if failure is not None:
            raise failure
        return f"{path} is recorded"

    def copy(self, raw: RawMessage, again: bool = False) -> None:
        """Record a message, the instant of a step, or a change.

        Args:
            raw: the message.
            again: whether it was kept from before.
        """
        if not again and raw.topic.rpartition("/")[2] in LATCHED:
            kept = self._latched.setdefault(raw.topic, [])
            kept.append(raw)
            del kept[:-KEPT]
        if isinstance(self._output, Output):
            self._output.copy(raw)
            self._watch()

    def step(self, step: Step) -> None:
        """Record what was found in a step."""
        if self._output is not None and self._output.failure is None:
            try:
                self._output.step(step)
            except Exception as error:
                self._output.failure = error
            self._watch()

    def flush(self) -> None:
        """Write what came so far to the disk, so that it outlives this process."""
        if isinstance(self._output, Output):
            self._output.flush()
            self._watch()

    def _watch(self) -> None:
        """End a recording that failed."""
        if self._output is not None and self._output.failure is not None:
            try:
                self.stop()
            except Exception as error:  # a full disk ends the recording, not the robot
                self._note(f"the recording ended: {error}")
