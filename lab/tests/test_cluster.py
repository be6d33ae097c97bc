"""Trials on a cluster: a real scheduler and workers, some of which are killed midway."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from contactfusion.errors import ConfigurationError, ContactFusionError, RobotError
from contactfusion_lab.trials import cluster
from contactfusion_lab.trials.cluster import Dask
from contactfusion_lab.trials.executor import Local
from contactfusion_lab.trials.runner import run
from lab.tests.here import Here
from lab.tests.trial_toys import Squares, content
from tests.test_cli import Ask, ask, one_sentence

__all__ = ["ask"]  # a fixture
DASK = Path(sys.executable).with_name("dask")
QUIET = ("--host", "127.0.0.1", "--no-dashboard")


@contextmanager
def program(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process of dask, which ends in the end."""
    environment = {**os.environ, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    with subprocess.Popen(
        [str(DASK), *arguments], env=environment, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        try:
            yield process
        finally:
            process.terminate()


class Cluster:
    """A scheduler with workers."""

    def __init__(self, stack: ExitStack) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        self.scheduler = stack.enter_context(program("scheduler", *QUIET, "--port", str(port)))
        self._stack = stack

    def add(self, workers: int, threads: int = 1) -> None:
        """Start workers, and wait for them."""
        from distributed import Client

        with Client(self.address, timeout=30, set_as_default=False) as client:
            count = len(client.scheduler_info()["workers"]) + workers
            self._stack.enter_context(
                program("worker", self.address, *QUIET, "--nworkers", str(workers),
                        "--nthreads", str(threads))
            )  # fmt: skip
            client.wait_for_workers(count, timeout=60)


@pytest.fixture(scope="module")
def two() -> Iterator[Cluster]:
    """A scheduler with two workers, which are started anew when they crash."""
    with ExitStack() as stack:
        found = Cluster(stack)
        found.add(2)
        yield found


@pytest.fixture
def marks(tmp_path: Path) -> Path:
    (tmp_path / "marks").mkdir()
    return tmp_path / "marks"


def test_a_cluster_gives_the_bytes_of_this_machine(
    two: Cluster, marks: Path, tmp_path: Path
) -> None:
    squares = Squares(100, marks)
    run(squares, Dask(two.address), tmp_path / "there")
    run(squares, Here(), tmp_path / "here")
    assert content(tmp_path / "there") == content(tmp_path / "here")


@pytest.mark.slow
def test_a_killed_worker_costs_no_trial_and_what_kills_all_is_named(
    two: Cluster, marks: Path, tmp_path: Path
) -> None:
    squares = Squares(12, marks, crashes_once=(1,), crashes=(3,))
    expected = "^1 of 12 squares were not made: odd/003: its workers were lost, the last at "
    with pytest.raises(RobotError, match=expected):
        run(squares, Dask(two.address), tmp_path / "there")
    assert len(list((tmp_path / "there" / "trials").rglob("*.txt"))) == 11


@pytest.mark.slow
def test_a_lost_scheduler_ends_in_a_sentence_and_nothing_that_was_done_is_lost(
    marks: Path, tmp_path: Path
) -> None:
    squares, out = Squares(30, marks, pause=0.2), tmp_path / "there"
    with ExitStack() as stack:
        found = Cluster(stack)
        found.add(1)
        executor = Dask(found.address)

        def killing(*arguments: Any) -> None:
            if len(list(out.rglob("*.txt"))) == 5:
                found.scheduler.send_signal(signal.SIGKILL)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("contactfusion_lab.trials.runner.Progress.add", killing)
            start = time.monotonic()
            with pytest.raises(ContactFusionError) as caught:
                run(squares, executor, out)
        assert time.monotonic() - start < 30.0
    assert str(caught.value) == (
        f"the scheduler at {found.address} is lost; what was done is kept: start again to go on"
    )
    done = len(list(out.rglob("*.txt")))
    assert 5 <= done < 30
    run(squares, Local(2), out)
    run(Squares(30, marks), Here(), tmp_path / "here")
    assert content(out) == content(tmp_path / "here")


@pytest.mark.slow
def test_workers_that_are_not_as_this_process_are_refused(
    two: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, other = cluster._versions(), cluster._other  # pyright: ignore[reportPrivateUsage]
    for name, difference in (
        ("numpy", rf"has numpy {ours['numpy']}, not 1\.0 as here"),
        ("code", "has other code of contactfusion or contactfusion-lab than here"),
    ):
        expected = {**ours, name: "1.0"}
        monkeypatch.setattr(
            cluster, "_other", lambda worker, found, _, to=expected: other(worker, found, to)
        )
        with pytest.raises(ConfigurationError, match=rf"the worker at tcp://127\..* {difference}"):
            Dask(two.address)


@pytest.mark.slow
def test_a_scheduler_without_workers_or_with_threads_is_refused() -> None:
    with ExitStack() as stack:
        found = Cluster(stack)
        with pytest.raises(ConfigurationError, match="has no workers: start some by 'dask worker"):
            Dask(found.address)
        found.add(1, threads=3)
        with pytest.raises(ConfigurationError, match="has 3 threads, .* with --nthreads 1"):
            Dask(found.address)


def test_where_nothing_answers_a_sentence_names_the_address_in_seconds(
    ask: Ask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    out = ("--out", str(tmp_path / "out"))
    start = time.monotonic()
    answer = ask(
        "experiment", "push", "--executor", "dask", "--scheduler", "tcp://127.0.0.1:9", *out
    )
    assert "no dask scheduler answers at 'tcp://127.0.0.1:9' within" in one_sentence(answer)
    assert time.monotonic() - start < 10.0 and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--executor", "dask"), "such as tcp://HOST:8786, not ''"),
        (("--executor", "dask", "--scheduler", "tcp://host"), "tcp://HOST:8786, not 'tcp://host'"),
        (("--executor", "dsk"), "unknown executor 'dsk'; did you mean 'dask'"),
        (
            ("--executor", "dask", "--scheduler", "tcp://host:8786", "--workers", "4"),
            "workers: --executor dask has the workers of its scheduler",
        ),
        (("--scheduler", "tcp://host:8786"), "scheduler: only --executor dask has a scheduler"),
    ],
)
@pytest.mark.parametrize(
    "command",
    [("experiment", "touch"), ("experiment", "push"), ("experiment", "grasp"), ("train", "cpm"),
     ("tune", "push")],
)  # fmt: skip
def test_options_that_do_not_fit_are_named(
    command: tuple[str, ...], options: tuple[str, ...], sentence: str, ask: Ask, tmp_path: Path
) -> None:
    answer = ask(*command, *options, "--out", str(tmp_path / "out"))
    assert sentence in one_sentence(answer) and not (tmp_path / "out").exists()


def test_without_distributed_the_extra_is_named(ask: Ask, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "contactfusion_lab.trials.cluster")
    monkeypatch.setitem(sys.modules, "distributed", None)
    answer = ask("experiment", "push", "--executor", "dask", "--scheduler", "tcp://127.0.0.1:9")
    assert "pip install 'contactfusion-lab[cluster]'" in one_sentence(answer)
