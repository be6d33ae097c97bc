"""Output of a command: results and notes on stdout, and progress on stderr."""

import io
import os
import sys
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Protocol, TextIO, TypeVar, final

COMPILING = "compiling kernels, once, about 40 s"
"""The text while numba compiles kernels that are not in its cache on disk."""
_quiet = False


class Stamped(Protocol):
    """An object with a stamp [s], such as a reading or a step."""

    @property
    def stamp(self) -> float:
        """The stamp [s]."""
        ...


S = TypeVar("S", bound=Stamped)


def set_quiet(quiet: bool) -> None:
    """Set whether only results and errors are printed (`--quiet`)."""
    global _quiet
    _quiet = quiet


def is_quiet() -> bool:
    """Whether only results and errors are printed."""
    return _quiet


def printable(text: str, *, lines: bool = False) -> str:
    """A line without what a terminal obeys: names in files may hold its control sequences.

    Args:
        text: the line.
        lines: whether it is several, whose ends are kept; else names in files can end none.
    """
    kept = "\n\t" if lines else ""
    return "".join(
        mark if mark.isprintable() or mark in kept else mark.encode("unicode_escape").decode()
        for mark in text
    )


def say(text: str, end: str = "\n", file: TextIO | None = None, *, lines: bool = False) -> None:
    """Print a line of results, or several `lines`; also where `--quiet` is.

    They are printed on stdout unless `file` is another.
    """
    print(printable(text, lines=lines), end=end, file=file, flush=True)


def open_streams() -> None:
    """Open what takes the place of standard streams that are closed, and escape what they lack.

    Otherwise the next file that is opened would get what libraries print.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def note(text: str, end: str = "\n", file: TextIO | None = None, *, lines: bool = False) -> None:
    """Print a line of a summary, or several `lines`; not where `--quiet` is.

    They are printed on stdout unless `file` is another.
    """
    if not _quiet:
        say(text, end, file, lines=lines)


@contextmanager
def progress(task: str, end: float | None = None) -> Iterator[Callable[[float], None]]:
    """Progress of a task on stderr; none where that is no terminal, or with `--quiet`.

    Compilation by numba is reported, as the first run of an installation waits for it.

    Args:
        task: its name, e.g. "replay".
        end: the stamp at which it is complete [s]; None: unknown.

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
    """Progress on stderr: how much is done, and the remaining time.

    Args:
        what: the plural of what is counted.
        total: its number.
    """

    def __init__(self, what: str, total: int) -> None:
        self._what, self._total = what, total
        self._done = self._skipped = 0
        self._start = self._reported = time.monotonic()

    def skip(self, count: int) -> None:
        """Count work that was done before."""
        self._skipped += count

    def add(self, count: int) -> None:
        """Count work that is done now."""
        self._done += count
        now, there = time.monotonic(), self._done + self._skipped
        tty = sys.stderr.isatty()
        if there < self._total and now - self._reported < (0.5 if tty else 20.0):
            return
        self._reported = now
        left = (now - self._start) / self._done * (self._total - there)
        end = "\r" if tty and there < self._total else "\n"
        text = f"  {there} of {self._total} {self._what}, {left:.0f} s left "
        note(text, end, sys.stderr)
