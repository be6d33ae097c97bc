"""What a command shows beside its results: notes on stdout, and progress on stderr."""

import sys
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Protocol, TextIO, TypeVar, final

COMPILING = "compiling kernels, once, about 40 s"
"""Shown while numba compiles what is not in its cache on disk."""
_quiet = False


class Stamped(Protocol):
    """What has a stamp [s], such as a reading or a step."""

    @property
    def stamp(self) -> float:
        """The stamp [s]."""
        ...


S = TypeVar("S", bound=Stamped)


def set_quiet(quiet: bool) -> None:
    """Choose whether only results and errors are printed (`--quiet`)."""
    global _quiet
    _quiet = quiet


def is_quiet() -> bool:
    """Whether only results and errors are printed."""
    return _quiet


def note(text: str, end: str = "\n", file: TextIO | None = None) -> None:
    """Print a line of a summary, on stdout unless `file` is another; not where `--quiet` is."""
    if not _quiet:
        print(text, end=end, file=file, flush=True)


@contextmanager
def progress(task: str, end: float | None = None) -> Iterator[Callable[[float], None]]:
    """Show on stderr that a task is under way; nothing where that is no terminal, or `--quiet`.

    While numba compiles kernels it says so, as the first run of an installation waits for that.

    Args:
        task: what is done, e.g. "replay".
        end: the stamp at which it is complete [s]; None where that is not known.

    Yields:
        A function that takes the stamp reached so far [s].
    """
    if _quiet or not sys.stderr.isatty():
        yield lambda stamp: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn("line"),
        TextColumn("{task.description}", markup=False),
        *(() if end is None else (BarColumn(),)),
        TextColumn("{task.fields[reached]}"),
        TimeElapsedColumn(),
    )
    shown = Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False)
    number = shown.add_task(task, total=end, reached="")
    of = "" if end is None else f" of {end:.1f}"

    def describe(now: str) -> None:
        shown.update(number, description=now, refresh=True)

    def reach(stamp: float) -> None:
        shown.update(number, completed=stamp, reached=f"{stamp:.1f}{of} s")

    with shown, ExitStack() as stack:
        if "numba" in sys.modules:  # else there is nothing to compile
            stack.enter_context(_compilation(describe, task))
        yield reach


def followed(items: Iterable[S], task: str, end: float | None = None) -> Generator[S]:
    """The same items, with `progress` by their stamps."""
    with progress(task, end) as reach:
        for item in items:
            reach(item.stamp)
            yield item


@contextmanager
def _compilation(describe: Callable[[str], None], task: str) -> Iterator[None]:
    """Describe the compilation of kernels while it lasts, and the task again after it."""
    from numba.core.event import Listener, install_listener

    @final
    class Compilation(Listener):
        depth = 0

        def on_start(self, event: object) -> None:
            self.depth += 1
            describe(COMPILING)

        def on_end(self, event: object) -> None:
            self.depth -= 1
            if not self.depth:
                describe(task)

    with install_listener("numba:compile", Compilation()):
        yield


class Progress:
    """Reports on stderr how much is done, and how long the rest will take.

    Args:
        what: is counted.
        total: of them.
    """

    def __init__(self, what: str, total: int) -> None:
        self._what, self._total = what, total
        self._done = self._skipped = 0
        self._start = self._told = time.monotonic()

    def skip(self, count: int) -> None:
        """Note what was done before."""
        self._skipped += count

    def add(self, count: int) -> None:
        """Note what is done now."""
        self._done += count
        now, there = time.monotonic(), self._done + self._skipped
        tty = sys.stderr.isatty()
        if there < self._total and now - self._told < (0.5 if tty else 20.0):
            return
        self._told = now
        left = (now - self._start) / self._done * (self._total - there)
        end = "\r" if tty and there < self._total else "\n"
        text = f"  {there} of {self._total} {self._what}, {left:.0f} s left "
        note(text, end, sys.stderr)
