"""The runner: each trial is a whole file, none is made twice, and failures are named."""

import json
import time
from pathlib import Path

import pytest

from contactfusion.errors import ConfigurationError, RobotError
from contactfusion_lab.trials.executor import Local, ShippedFile
from contactfusion_lab.trials.runner import ordered, run
from lab.tests.here import Here
from lab.tests.trial_toys import Squares, content


@pytest.fixture
def marks(tmp_path: Path) -> Path:
    (tmp_path / "marks").mkdir()
    return tmp_path / "marks"


def test_each_trial_is_a_file_and_all_are_evaluated(marks: Path, tmp_path: Path) -> None:
    run(Squares(4, marks), Here(), tmp_path / "out")
    assert content(tmp_path / "out") == {
        "settings.json": b'{\n "power": 2\n}\n',
        "sum.txt": b"14 0\n",
        "trials/even/000.txt": b"0\n",
        "trials/odd/001.txt": b"1\n",
        "trials/even/002.txt": b"4\n",
        "trials/odd/003.txt": b"9\n",
    }


def test_what_is_there_is_not_made_again(marks: Path, tmp_path: Path) -> None:
    run(Squares(2, marks), Here(), tmp_path / "out")
    for mark in marks.iterdir():
        mark.unlink()
    run(Squares(4, marks), Here(), tmp_path / "out")
    assert {mark.name for mark in marks.iterdir()} == {"2", "3"}
    assert (tmp_path / "out" / "sum.txt").read_text() == "14 0\n"


def test_an_interrupt_keeps_what_is_done(marks: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(Squares(4, marks), Here(stop=3), tmp_path / "out")
    assert len(list((tmp_path / "out" / "trials").rglob("*.txt"))) == 3
    run(Squares(4, marks), Here(), tmp_path / "out")
    run(Squares(4, marks), Here(), tmp_path / "whole")
    assert content(tmp_path / "out") == content(tmp_path / "whole")


def test_trials_that_fail_are_named_and_the_others_kept(marks: Path, tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="^2 of 4 squares were not made: odd/001: no way$"):
        run(Squares(4, marks, fails=(1, 3)), Here(), tmp_path / "out")
    assert (tmp_path / "out" / "sum.txt").read_text() == "4 2\n"
    with pytest.raises(RobotError, match="1 of 4 .* even/002: its process was killed by SIGSEGV"):
        run(Squares(4, marks), Here(crashing=(2,)), tmp_path / "crashed")


def test_where_nothing_was_made_nothing_is_evaluated(marks: Path, tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="1 of 1"):
        run(Squares(1, marks, fails=(0,)), Here(), tmp_path / "out")
    assert not (tmp_path / "out" / "sum.txt").exists()


def test_a_worker_that_crashes_costs_no_other_trial_and_changes_no_bytes(
    marks: Path, tmp_path: Path
) -> None:
    with pytest.raises(RobotError, match="^1 of 6 .* odd/003: its process was killed by SIGKILL"):
        run(Squares(6, marks, crashes_once=(1,), crashes=(3,)), Local(2), tmp_path / "out")
    run(Squares(6, marks), Local(1), tmp_path / "out")
    run(Squares(6, marks), Here(), tmp_path / "whole")
    assert content(tmp_path / "out") == content(tmp_path / "whole")


def test_films_are_of_trials_that_were_made(
    marks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RobotError) as caught:
        run(Squares(4, marks, fails=(2,)), Here(), tmp_path, ("000", "odd/001", "002"))
    assert str(caught.value) == (
        "1 of 4 squares were not made: even/002: no way; "
        "1 of 3 films were not made: odd/001: ZeroDivisionError: oh"
    )
    output = capsys.readouterr().out
    assert "not filmed: even/002, which was not made" in output and "0.gif; recording: " in output


def test_the_folder_of_another_experiment_is_left_alone(marks: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "settings.json").write_text(json.dumps({"power": 3}))
    with pytest.raises(ConfigurationError, match="holds squares of other power"):
        run(Squares(4, marks), Here(), tmp_path / "out")
    assert not list(marks.iterdir())


def slow_first(task: int) -> int:
    time.sleep(0.0 if task else 0.5)
    if task == 3:
        raise RobotError("no way")
    return task


def test_results_come_in_the_order_of_the_tasks() -> None:
    tasks = {str(row): row for row in range(3)}
    assert list(ordered(slow_first, tasks, Local(2))) == [0, 1, 2]
    results = ordered(slow_first, {"3": 3, **tasks}, Here())
    with pytest.raises(RobotError, match="^3: no way$"):
        next(results)


def test_a_file_goes_along_where_it_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "cpm.safetensors").write_bytes(b"weights")
    (tmp_path / "cpm.json").write_bytes(b"card")
    (tmp_path / "other.json").write_bytes(b"other")
    path = ShippedFile(tmp_path / "cpm.safetensors")
    rebuild, parts = path.__reduce__()
    assert rebuild(*parts) == path  # it is there
    (tmp_path / "cpm.json").write_bytes(b"another card")
    there = rebuild(*parts)
    assert there != path and there.read_bytes() == b"weights"
    assert there.with_suffix(".json").read_bytes() == b"card"
    assert not there.with_name("other.json").exists()
    assert rebuild(*parts) == there
