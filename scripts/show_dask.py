"""Pushes on a dask cluster that loses a worker, then its scheduler: `make show-dask`.

Scheduler and workers run on this machine. What is made is kept, so it goes on where it was stopped.
"""

import filecmp
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

OUT = Path("out/dask")
BIN = Path(sys.executable).parent
PUSHES = 200
WORKER_DIES, SCHEDULER_DIES = 100, 170
"""After so many pushes."""
TIMED = ("timing.json", "*.png")
"""What is not compared: times, and pictures, which hold no more than the other files."""
Process = subprocess.Popen[bytes]


def main() -> int:
    """Make the pushes on this machine and on a cluster, and compare."""
    started = time.monotonic()
    OUT.mkdir(parents=True, exist_ok=True)
    places = [[0.35 + 0.01 * (row % 20), -0.1 + 0.02 * (row // 20)] for row in range(PUSHES)]
    (OUT / "near.yaml").write_text(json.dumps({"targets": places}) + "\n")
    if (status := _pushed("local", []).wait()) != 0:
        return status
    if len(_files("cluster")) < SCHEDULER_DIES:
        with _cluster(2) as (address, scheduler, workers):
            running = _pushed("cluster", ["--executor", "dask", "--scheduler", address])
            _lose(running, scheduler, workers)
    with _cluster(2) as (address, _, _):
        status = _pushed("cluster", ["--executor", "dask", "--scheduler", address]).wait()
    wrong = list(_differences())
    print(f"{len(_files('cluster'))} of {PUSHES} pushes on the cluster")
    print(f"differs from this machine alone: {', '.join(wrong) or 'nothing'}")
    if (rates := OUT / "rates.json").exists():
        for workers, rate in json.loads(rates.read_text()).items():
            print(f"{rate:.0f} pushes a minute with {workers}")
    print(f"{time.monotonic() - started:.0f} s")
    return status or bool(wrong)


def _lose(running: Process, scheduler: Process, workers: Sequence[Process]) -> None:
    """Kill a worker, then the scheduler, and time what is made before each."""
    kept = len(_files("cluster"))
    first, begin = _reached(running, kept + 10)
    second, middle = _reached(running, max(WORKER_DIES, first + 10))
    workers[0].send_signal(signal.SIGKILL)
    print(f"a worker was killed after {second} pushes", flush=True)
    after, again = _reached(running, second + 2)
    third, end = _reached(running, max(SCHEDULER_DIES, after + 10))
    scheduler.send_signal(signal.SIGKILL)
    print(f"the scheduler was killed after {third} pushes", flush=True)
    status = running.wait()
    print(f"the experiment ended with status {status}; {len(_files('cluster'))} pushes are kept")
    rates = {
        "2 workers": 60.0 * (second - first) / (middle - begin),
        "1 worker": 60.0 * (third - after) / (end - again),
    }
    (OUT / "rates.json").write_text(json.dumps(rates) + "\n")


def _reached(running: Process, count: int) -> tuple[int, float]:
    """How many pushes there are, and when, once there are so many."""
    while (found := len(_files("cluster"))) < count:
        if running.poll() is not None:
            sys.exit(f"the experiment ended after {found} pushes")
        time.sleep(0.05)
    return found, time.monotonic()


def _files(folder: str) -> list[Path]:
    return list((OUT / folder / "trials").rglob("*.npz"))


def _pushed(folder: str, options: Sequence[str]) -> Process:
    command = [str(BIN / "contactfusion"), "experiment", "push", "--objects", "box"]
    command += ["--friction", "mu1", "--targets", str(OUT / "near.yaml"), *options]
    return subprocess.Popen([*command, "--out", str(OUT / folder)], stdout=subprocess.DEVNULL)


@contextmanager
def _cluster(count: int) -> Iterator[tuple[str, Process, list[Process]]]:
    """The address of a scheduler, its process, and those of its workers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    address = f"tcp://127.0.0.1:{port}"
    with ExitStack() as stack:
        scheduler = _started(stack, "scheduler", "--port", port)
        one = ("worker", address, "--nthreads", "1", "--no-nanny")
        workers = [_started(stack, *one) for _ in range(count)]
        from distributed import Client

        with Client(address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=60)
        yield address, scheduler, workers


def _started(stack: ExitStack, *arguments: str) -> Process:
    """A process of dask, of one thread for linear algebra, that ends with the stack."""
    command = [str(BIN / "dask"), *arguments, "--host", "127.0.0.1", "--no-dashboard"]
    environment = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", **os.environ}
    log = stack.enter_context((OUT / f"{arguments[0]}.log").open("ab"))
    process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
    stack.callback(process.wait)
    stack.callback(process.terminate)
    return process


def _differences() -> Iterator[str]:
    """The files that are only in a folder, or whose bytes differ."""
    here, there = OUT / "local", OUT / "cluster"
    names = {path.relative_to(side) for side in (here, there) for path in side.rglob("*")}
    for name in sorted(names):
        if any(name.match(pattern) for pattern in TIMED) or (here / name).is_dir():
            continue
        sides = here / name, there / name
        if not all(map(Path.exists, sides)) or not filecmp.cmp(*sides, shallow=False):
            yield str(name)


if __name__ == "__main__":
    sys.exit(main())
