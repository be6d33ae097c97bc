"""Tasks in processes of their own: none harms another."""

import os
import signal
from pathlib import Path

import pytest

from contactfusion.errors import ConfigurationError
from contactfusion_lab.trials.executor import POOLS, Local, WorkerCrashed


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch, pytestconfig: pytest.Config) -> None:
    monkeypatch.syspath_prepend(str(pytestconfig.rootpath))  # the processes import this module


def done(task: tuple[str, Path]) -> str:
    """Do a task: die always, die the first time, or give the number of the process."""
    what, folder = task
    mark = folder / f"{what}_died"
    if what == "dies" or (what == "dies_once" and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return str(os.getpid())


def test_a_task_whose_process_dies_is_tried_again_and_costs_no_other(tmp_path: Path) -> None:
    tasks = [(what, tmp_path) for what in ("a", "dies", "b", "dies_once", "c", "d")]
    found = {tasks[row][0]: made for row, made in Local(2).results(done, tasks)}
    assert found.keys() == {"a", "dies", "b", "dies_once", "c", "d"}
    assert found["dies"] == WorkerCrashed("its process was killed by SIGKILL, twice")
    assert not any(
        isinstance(found[name], WorkerCrashed) for name in ("a", "b", "c", "d", "dies_once")
    )


def test_nothing_is_done_in_this_process(tmp_path: Path) -> None:
    ((_, made),) = Local(3).results(done, [("a", tmp_path)])
    assert made != str(os.getpid())


def test_no_more_processes_are_started_than_wanted(tmp_path: Path) -> None:
    tasks = [("a", tmp_path), ("b", tmp_path), ("c", tmp_path)]
    assert len({made for _, made in Local(1).results(done, tasks)}) == 1


def test_processes_end_when_no_more_is_wanted(tmp_path: Path) -> None:
    results = Local(1).results(done, [(str(number), tmp_path) for number in range(9)])
    _, process = next(results)
    assert isinstance(process, str)
    os.kill(int(process), 0)
    results.close()
    with pytest.raises(ProcessLookupError):
        os.kill(int(process), 0)


@pytest.mark.parametrize("workers", [0, -1])
def test_without_workers_nothing_is_done(workers: int) -> None:
    with pytest.raises(ConfigurationError, match=f"workers: .* 1 worker or more, not {workers}"):
        Local(workers)


def threads(task: int) -> list[str]:
    return [os.environ[name] for name in POOLS]


def test_workers_have_one_thread_unless_the_user_sets_how_many(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in POOLS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(POOLS[0], "3")
    assert list(Local(1).results(threads, [0])) == [(0, ["3", "1", "1"])]
    assert os.environ[POOLS[0]] == "3" and POOLS[1] not in os.environ
