"""A command that is run to see what becomes of it."""

import hashlib
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

CONTACTFUSION = (sys.executable, "-m", "contactfusion")
LONGEST = 300.0
"""A command that takes longer hangs [s], where nothing else is said."""
HANGS = 124
"""The status of a command that was ended for it, as of `timeout`."""
TIMED = ("timing.json", "*.png", "*.log", "*.html")
"""Files whose bytes depend on the clock, or on fonts."""


@dataclass(frozen=True)
class Outcome:
    """What became of a command.

    Attributes:
        status: of its exit; negative: the signal that ended it.
        error: what it wrote to its standard error.
        seconds: how long it took.
    """

    status: int
    error: str
    seconds: float

    @property
    def fault(self) -> str:
        """What is wrong with how it ended, as a clause; empty where it did as it should."""
        if self.status == HANGS:
            return "it hangs"
        if "Traceback" in self.error:
            return f"a traceback: {self.error.strip().splitlines()[-1]}"
        if self.status not in (0, 1, 2, 130):
            return f"exit status {self.status}: {self.error.strip()[-200:]}"
        if self.status and not self.error.strip():
            return f"exit status {self.status} without a word"
        return ""


@dataclass(frozen=True)
class Row:
    """A row of the table.

    Attributes:
        what: was tried.
        tried: how often.
        survived: how often all was as it should be.
        notes: the first faults.
    """

    what: str
    tried: int
    survived: int
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, what: str, faults: Sequence[str]) -> "Row":
        """The row of trials by their faults, empty where there is none."""
        wrong = [fault for fault in faults if fault]
        return cls(what, len(faults), len(faults) - len(wrong), tuple(dict.fromkeys(wrong))[:5])


def command(
    *words: str | Path,
    environment: Mapping[str, str] | None = None,
    before: Sequence[str] = (),
    limit: float = LONGEST,
) -> Outcome:
    """Run contactfusion.

    Args:
        words: the arguments.
        environment: of the process; None: that of this one.
        before: words before those of contactfusion, such as of a shell that sets limits.
        limit: after which it is killed [s].
    """
    began = time.monotonic()
    try:
        done = subprocess.run(
            [*before, *CONTACTFUSION, *map(str, words)],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            timeout=limit,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        return Outcome(HANGS, "", limit)
    return Outcome(done.returncode, done.stderr, time.monotonic() - began)


def digests(folder: Path) -> dict[str, str]:
    """The digest of each file below a folder that does not depend on the clock, by its name.

    A file alone has an empty name.
    """
    files = [folder] if folder.is_file() else sorted(folder.rglob("*"))
    return {
        "" if path == folder else str(path.relative_to(folder)): hashlib.sha256(
            path.read_bytes()
        ).hexdigest()
        for path in files
        if path.is_file()
        and not any(path.match(pattern) for pattern in TIMED)
        and not any(part.startswith(".") for part in path.relative_to(folder.parent).parts)
    }
