"""Commands that lack something: room on the disk, a home, descriptors, a folder of their own."""

import os
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.torture.trial import Outcome, Row, command, digests

SCENES = Path("examples/scenes")
ROOM = 256
"""Of the full disk [kB]."""


def wants(folder: Path) -> Iterator[Row]:
    """Run commands that lack something; they say so, and leave no half of a file."""
    push = folder / "push.mcap"
    if not push.exists():
        command("record", SCENES / "push_fused.yaml", "--duration", "4", "--out", push)
    yield Row.of("full disk", [*_full(folder, push)])
    yield Row.of("home that can't be written", [*_homeless(folder, push)])
    yield Row.of("12 descriptors", [*_few(folder, push)])
    yield Row.of("two processes on one folder", [_two(folder)])


def _full(folder: Path, push: Path) -> Iterator[str]:
    with _small_disk(folder / "disk") as disk:
        for words in (
            ("record", SCENES / "push_fused.yaml", "--duration", "4", "--out", disk / "a.mcap"),
            ("run", SCENES / "push_fused.yaml", push, "--out", disk / "b.mcap"),
            ("run", SCENES / "push_fused.yaml", push, "--out", disk / "c.parquet"),
            ("run", SCENES / "push_fused.yaml", push, "--out", disk / "folder"),
            ("view", push, "--config", SCENES / "push_fused.yaml", "--save", disk / "d.rrd"),
        ):
            (disk / "ballast").write_bytes(bytes(1024 * (ROOM - 8)))
            done = command(*words)
            # what was written until then is kept by a name that says so
            files = [
                path for path in disk.rglob("*") if path.is_file() and ".cut." not in path.name
            ]
            left = [path.name for path in files if path.name != "ballast"]
            yield _told(done, "No space left") or (f"it left {left}" if left else "")
            for path in disk.iterdir():
                shutil.rmtree(path) if path.is_dir() else path.unlink()


def _homeless(folder: Path, push: Path) -> Iterator[str]:
    lost = {**os.environ, "HOME": "/proc/none", "XDG_CACHE_HOME": "/proc/none"}
    lost |= {"XDG_DATA_HOME": "/proc/none", "XDG_RUNTIME_DIR": "/proc/none"}
    for words in (
        ("doctor",),
        ("run", SCENES / "push_fused.yaml", push, "--out", folder / "home.mcap"),
        ("run", SCENES / "touch_box.yaml", "--out", folder / "home.mcap"),
        ("check", SCENES / "touch_box.yaml"),
    ):
        done = command(*words, environment=lost)
        yield done.fault or ("" if done.status == 0 else done.error[-200:])
    yield command("ctl", "status", environment=lost).fault


def _few(folder: Path, push: Path) -> Iterator[str]:
    for words in (
        ("run", SCENES / "push_fused.yaml", push, "--out", folder / "few.mcap"),
        ("inspect", push),
        ("check", SCENES / "touch_box.yaml"),
    ):
        yield command(*words, before=("sh", "-c", 'ulimit -n 12; exec "$0" "$@"')).fault


def _two(folder: Path) -> str:
    near, out = folder / "near.yaml", folder / "two"
    near.write_text("targets: [[0.4, 0.0], [0.45, 0.05], [0.4, -0.05]]\n", encoding="utf-8")
    words = ("experiment", "push", "--objects", "box", "--friction", "mu1", "--targets", str(near))
    alone, found = folder / "one", list[Outcome]()
    command(*words, "--out", alone)
    threads = [
        threading.Thread(target=lambda: found.append(command(*words, "--out", out)))
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if faults := [done.fault for done in found if done.fault]:
        return faults[0]
    if all(done.status for done in found):
        return f"none of both made it: {found[0].error[-200:]}"
    return "" if digests(out) == digests(alone) else "other bytes than those of one alone"


def _told(done: Outcome, words: str) -> str:
    """What is wrong with a command that should say something in one sentence."""
    if done.fault:
        return done.fault
    if done.status == 0:
        return "exit status 0"
    return "" if words in done.error else f"it says: {done.error.strip()[-200:]}"


@contextmanager
def _small_disk(folder: Path) -> Iterator[Path]:
    """A disk of its own; it takes the right to mount one."""
    folder.mkdir(exist_ok=True)
    size = f"size={ROOM}k"
    subprocess.run(["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(folder)], check=True)
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)
