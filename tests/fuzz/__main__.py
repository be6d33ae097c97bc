"""Mutate and read: `python -m tests.fuzz [TARGET…] --minutes 10 --seed 0`.

Input number N of a seed is the same on every machine. What a reader raises but a sentence, what
takes longer than 20 s or more than 2 GB, and what ends its process is printed, made smaller where
that is quick, and kept in `tests/fuzz/corpus`, which `tests/test_fuzz_corpus.py` reads again.
"""

import argparse
import hashlib
import json
import os
import resource
import select
import subprocess
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from contactfusion.errors import ContactFusionError
from tests.fuzz.mutations import mutated
from tests.fuzz.targets import TARGETS, Target

CORPUS = Path(__file__).with_name("corpus")
SECONDS = 20.0
"""The time that an input may take [s]."""
LARGE = 2**31
"""The memory that an input may take [bytes]."""
PATIENCE = 180.0
"""The time to start a worker [s]."""
SMALL = 20_000
"""The greatest size of a file of the corpus [bytes]."""


def outcome(target: Target, content: bytes) -> str:
    """What reading an input raised, and where; empty for a sentence, or nothing."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    with TemporaryDirectory(prefix="fuzz-") as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            target.read(content, Path(folder))
        except ContactFusionError as error:
            if "\n" in str(error):
                return f"a sentence of several lines: {str(error)[:200]!r}"
        except Exception as error:
            return f"{type(error).__name__} {_origin(error)}: {str(error)[:160]!r}"
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 - before
    return f"took {grown / 2**30:.1f} GiB" if grown > LARGE else ""


def _origin(error: BaseException) -> str:
    """The last line of ours, and the last of all, of a traceback."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "/contactfusion/" in f.filename or "/generators/" in f.filename]
    places = [f"{Path(f.filename).name}:{f.lineno}" for f in (*ours[-1:], frames[-1])]
    return " < ".join(dict.fromkeys(places))


def kind_of(found: str) -> str:
    """What is the same for findings of one fault."""
    return found.partition(": ")[0]


def inputs(target: Target, seed: int, start: int) -> Iterator[tuple[int, bytes]]:
    """Numbered inputs; those of the bases themselves come first."""
    with TemporaryDirectory() as folder:
        bases = target.bases(Path(folder))
    yield from ((number, base) for number, base in enumerate(bases) if number >= start)
    number = max(start, len(bases))
    while True:
        rng = np.random.default_rng((seed, number))
        base = bases[int(rng.integers(len(bases)))]
        yield number, mutated(base, rng, target.text, bases)
        number += 1


def smaller(target: Target, content: bytes, kind: str, trials: int = 150) -> bytes:
    """A smaller input of the same finding, roughly."""
    until = time.monotonic() + SECONDS
    size = len(content) // 2
    while size and trials > 0:
        at = 0
        while at < len(content) and trials > 0 and time.monotonic() < until:
            trials -= 1
            shorter = content[:at] + content[at + size :]
            if kind_of(outcome(target, shorter)) == kind:
                content = shorter
            else:
                at += size
        size //= 2
    return content


def work(name: str, seed: int, start: int) -> None:
    """Read inputs without end; a line before each, and one for each finding."""
    target, seen = TARGETS[name], set[str]()
    out = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(1, 2)
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (10 * 2**30, most))
    for number, content in inputs(target, seed, start):
        print(json.dumps({"number": number}), file=out)
        found = outcome(target, content)
        if not found:
            continue
        report = {"found": found}
        if kind_of(found) not in seen and not found.startswith("took"):
            seen.add(kind_of(found))
            print(json.dumps({"number": number}), file=out)
            report["file"] = keep(name, smaller(target, content, kind_of(found)))
        print(json.dumps(report), file=out)


def keep(name: str, content: bytes) -> str:
    """Keep an input in the corpus, unless it is large; its name."""
    if len(content) > SMALL:
        return ""
    path = CORPUS / f"{name}-{hashlib.sha256(content).hexdigest()[:8]}"
    path.write_bytes(content)
    return path.name


def fuzz(name: str, seed: int, seconds: float, say: Callable[[str], None]) -> Counter[str]:
    """Let workers read inputs for a while; the number of inputs and of findings by kind."""
    counts, start, until = Counter[str](), 0, time.monotonic() + seconds
    told = set[str]()
    while time.monotonic() < until:
        command = [sys.executable, "-m", "tests.fuzz", name, "--worker", f"{seed},{start}"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, bufsize=1) as worker:
            try:
                ended = _followed(worker, until, counts, told, say)
            finally:
                worker.kill()
        if ended is None:
            break
        number, how = ended
        counts[how] += 1
        with TemporaryDirectory():
            content = next(inputs(TARGETS[name], seed, number))[1]
        say(f"  {name}: input {number} {how}: {keep(name, content) or 'too large to keep'}")
        start = number + 1
    return counts


def _followed(
    worker: "subprocess.Popen[str]",
    until: float,
    counts: Counter[str],
    told: set[str],
    say: Callable[[str], None],
) -> tuple[int, str] | None:
    """Follow a worker: the input that ended it, and how; None when time is over."""
    assert worker.stdout
    number, patience, buffer = -1, PATIENCE, b""
    descriptor = worker.stdout.fileno()
    while True:
        ready, _, _ = select.select([descriptor], [], [], patience)
        if not ready:
            return max(number, 0), "too slow"
        piece = os.read(descriptor, 65536)
        if not piece:
            return max(number, 0), f"ended the process ({worker.wait()})"
        *lines, buffer = (buffer + piece).split(b"\n")
        for line in lines:
            report = json.loads(line)
            patience = SECONDS
            if "number" in report:
                counts["tried"] += report["number"] != number
                number = report["number"]
                continue
            found = report["found"]
            counts["too large" if found.startswith("took") else "uncaught"] += 1
            if kind_of(found) not in told:
                told.add(kind_of(found))
                say(f"  input {number}: {found} {report.get('file', '')}")
        if time.monotonic() > until:
            return None


def main() -> int:
    """Fuzz the targets of the command line; 1 where there are findings."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=", ".join(TARGETS))
    parser.add_argument("--minutes", type=float, default=10.0, help="for each target")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        seed, start = map(int, given.worker.split(","))
        work(given.targets[0], seed, start)
    if unknown := [name for name in given.targets if name not in TARGETS]:
        parser.error(f"unknown {', '.join(unknown)}; there are {', '.join(TARGETS)}")
    failed = False
    for name in given.targets or TARGETS:
        counts = fuzz(name, given.seed, 60.0 * given.minutes, lambda line: print(line, flush=True))
        row = ", ".join(f"{count} {what}" for what, count in counts.items())
        print(f"{name}: {row}", flush=True)
        failed = failed or len(counts) > 1
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
