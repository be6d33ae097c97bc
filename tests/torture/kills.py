"""Commands that are killed at random moments: nothing half is left, and what is whole is used."""

import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from tests.torture.trial import CONTACTFUSION, Row, command, digests

KILLS = 60
"""Of each command."""
SCENES = Path("examples/scenes")
Words = tuple[str, ...]
COMMANDS: Mapping[str, Words] = {
    "record": ("record", str(SCENES / "push_fused.yaml"), "--duration", "4", "--out"),
    "run": ("run", str(SCENES / "touch_box.yaml"), "--out"),
    "replay": ("replay", str(SCENES / "push_fused.yaml"), "{push}", "--out"),
    "experiment push": (
        "experiment", "push", "--objects", "box", "--friction", "mu1", "--targets", "{near}",
        "--workers", "2", "--out",
    ),
    "experiment touch": (
        "experiment", "touch", "--objects", "box", "--directions", "2", "--repeats", "2", "--free",
        "0", "--workers", "2", "--out",
    ),
    "train": (
        "train", "cpm", "--rounds", "0", "--varied", "0", "--driven", "7", "--tested", "6",
        "--epochs", "1", "--early", "1", "--stride", "50", "--out",
    ),
    "tune": (
        "tune", "push", "--trials", "6", "--rounds", "2", "--confirm", "6", "--workers", "2",
        "--out",
    ),
}  # fmt: skip
"""Words of each command before its output; files that are made for it in braces."""
HOUR = 3600.0
"""A training on a busy machine takes a quarter of it [s]."""
RESUMED = 8.0
"""A command that goes on where it was is killed within that part of the time that it takes."""
MCAP = ("record", "run", "replay")
"""Commands whose output is a file."""


def kills(
    folder: Path, names: Sequence[str] = tuple(COMMANDS), count: int = KILLS
) -> Iterator[Row]:
    """Kill each command at random moments, let it end, and compare with one that was left alone."""
    made = _made(folder)
    for name in names:
        words = [word.format(**made) for word in COMMANDS[name]]
        suffix = ".mcap" if name in MCAP else ""
        alone = folder / f"alone_{name.replace(' ', '_')}{suffix}"
        began = time.monotonic()
        done = command(*words, alone, limit=HOUR)
        if done.status:
            yield Row(name, 1, 0, (done.fault or done.error[-200:],))
            continue
        lasts, expected = time.monotonic() - began, digests(alone)
        killed = alone.with_name(alone.name.replace("alone", "killed"))
        rng, faults = random.Random(name), list[str]()
        longest = lasts if suffix else lasts / RESUMED
        for _ in range(count):
            while not _killed([*words, str(killed)], rng.uniform(0.0, longest)):
                faults.append("" if digests(killed) == expected else "other bytes at the end")
                _remove(killed)
            faults.append(_half(digests(killed) if killed.exists() else {}, expected, suffix != ""))
            if suffix:
                _remove(killed)
        last = command(*words, killed, limit=HOUR)
        faults.append(
            last.fault or ("" if digests(killed) == expected else "other bytes at the end")
        )
        yield Row.of(f"{name}, SIGKILL", faults)
        _remove(alone)
        _remove(killed)


def _made(folder: Path) -> dict[str, str]:
    """The files that commands need."""
    push, near = folder / "push.mcap", folder / "near.yaml"
    if not push.exists():
        command("record", SCENES / "push_fused.yaml", "--duration", "4", "--out", push)
    near.write_text("targets: [[0.4, 0.0], [0.45, 0.05], [0.4, -0.05]]\n", encoding="utf-8")
    return {"push": str(push), "near": str(near)}


def _remove(path: Path) -> None:
    shutil.rmtree(path, ignore_errors=True)
    path.unlink(missing_ok=True)


def _killed(words: Sequence[str], after: float) -> bool:
    """Whether a command, and all its processes, were killed after a time [s], before it ended."""
    with subprocess.Popen(
        [*CONTACTFUSION, *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as process:
        try:
            process.wait(after)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return True
    return False


def _half(found: Mapping[str, str], expected: Mapping[str, str], is_file: bool) -> str:
    """Which file is there, and is not as it will be; of folders trials count, as tables grow.

    Args:
        found: digests after a kill.
        expected: those of a command that was left alone.
        is_file: whether the output is one file.
    """
    for name, digest in found.items():
        counts = is_file or name.startswith("trials")
        if counts and expected.get(name) != digest:
            return f"{name or 'the file'} is not whole"
    return ""
