"""An experiment whose trials are made at once, or whose worker crashes; workers import it."""

import os
import signal
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from contactfusion.errors import RobotError
from contactfusion.files import write_whole
from contactfusion_lab.trials.runner import Experiment, Made


@final
@dataclass(frozen=True)
class Squares(Experiment[int]):
    """The squares of numbers; a trial is a file that holds one.

    Attributes:
        count: of the numbers.
        folder: takes a mark of each worker that crashes, and of each trial that begins.
        fails: numbers that have none.
        crashes_once: numbers whose first worker crashes.
        crashes: numbers all of whose workers crash.
        pause: before each is ready [s].
    """

    count: int
    folder: Path
    fails: tuple[int, ...] = ()
    crashes_once: tuple[int, ...] = ()
    crashes: tuple[int, ...] = ()
    pause: float = 0.0
    trials = "squares"
    suffix = ".txt"
    addable = ()

    def tasks(self) -> dict[str, int]:
        """The numbers, by folders of even and odd ones."""
        return {f"{('even', 'odd')[row % 2]}/{row:03d}": row for row in range(self.count)}

    def settings(self) -> dict[str, Any]:
        """None."""
        return {"power": 2}

    def make(self, task: int) -> Made:
        """Square a number."""
        mark = self.folder / f"{task}"
        first = not mark.exists()
        mark.touch()
        if task in self.crashes or (task in self.crashes_once and first):
            os.kill(os.getpid(), signal.SIGKILL)
        if task in self.fails:
            raise RobotError("no way")
        time.sleep(self.pause)
        return Made(f"{task**2}\n".encode(), cost=task)

    def evaluate(self, out: Path, settings: Mapping[str, Any], failed: Sequence[str]) -> None:
        """Write the sum."""
        squares = [int(path.read_text()) for path in (out / "trials").rglob("*.txt")]
        write_whole(out / "sum.txt", f"{sum(squares)} {len(failed)}\n")

    def film(self, task: int, out: Path) -> tuple[Path, Path]:
        """No film of 1."""
        if task == 1:
            raise ZeroDivisionError("oh")
        return out / f"{task}.gif", out / f"{task}.mcap"


def content(out: Path) -> dict[str, bytes]:
    """The bytes of all files."""
    files = (path for path in out.rglob("*") if path.is_file())
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}
