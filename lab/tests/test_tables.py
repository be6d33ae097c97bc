"""The table writer: a data frame as CSV, JSON and Markdown."""

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from contactfusion_lab.trials import tables
from contactfusion_lab.trials.measures import CASE
from contactfusion_lab.trials.tables import as_csv, cell, frame_of, markdown, write_results


@dataclass(frozen=True)
class Row:
    """A trial."""

    trial: str
    object: str
    case: str
    won: bool
    time: float
    count: int


def framed(*won: bool, case: str = "a", name: str = "box") -> pd.DataFrame:
    return frame_of(
        [Row(f"{name}, {n}", name, case, hit, 0.1 + n / 3.0, n) for n, hit in enumerate(won)], Row
    )


def test_flags_are_0_or_1_and_numbers_have_six_digits() -> None:
    frame = framed(True, False).assign(time=[1234567.0, float("nan")])
    assert as_csv(frame) == (
        'trial,object,case,won,time,count\n"box, 0",box,a,1,1.23457e+06,0\n"box, 1",box,a,0,,1\n'
    )
    assert as_csv(frame, "nan").endswith(",0,nan,1\n")
    assert as_csv(frame_of([], Row)) == "trial,object,case,won,time,count\n"


def test_all_of_it_is_written(tmp_path: Path) -> None:
    texts = {"Success": "text", "Not made": ""}
    write_results(tmp_path, framed(True), {"p": float("nan")}, texts)
    assert json.loads((tmp_path / "summary.json").read_text()) == {"p": None}
    assert (tmp_path / "table.md").read_text() == "## Success\n\ntext\n"
    (row,) = csv.DictReader((tmp_path / "results.csv").read_text().splitlines())
    assert CASE not in row and row["won"] == "1"


def test_a_table_in_markdown() -> None:
    assert markdown(["", "n"], [["a", "1"]]) == "|  | n |\n|---|---|\n| a | 1 |"
    assert cell(0.5, 0.25, 0.75, 100.0, ".0f") == "50 [25, 75]"
    assert cell(None, 0.0, 0.0) == cell(float("nan"), 0.0, 0.0) == "-"


def test_successes_stand_by_group_with_an_interval_of_all() -> None:
    frame = pd.concat([
        framed(*[True] * 8, *[False] * 2), framed(True, name="mug"), framed(False, case="b"),
    ])  # fmt: skip
    text = tables.success_text(frame, ["object"], {"won": ", won"}, [["paper", "9/10", "-", ""]])
    assert text.splitlines()[2:] == [
        "| paper | 9/10 | - |  |",
        "| a, won | 8/10 | 1/1 | 9/11, 81.82 % [52.3, 94.9] |",
        "| b, won | 0/1 | - | 0/1, 0.00 % [0.0, 79.3] |",
    ]
    assert text.splitlines()[0].startswith("|  | box | mug |")


@pytest.mark.parametrize("statistic", ["mean", "median"])
def test_a_summary_is_of_all_and_of_each_group(statistic: str) -> None:
    frame = pd.concat([framed(True, False, True), framed(False, name="mug")], ignore_index=True)
    summary = tables.summary_of(frame, ["object"], ["won"], ["time"], statistic, 0)
    assert {name: part["n"] for name, part in summary.items()} == {"all": 4, "box": 3, "mug": 1}
    assert summary["all"]["won"]["hits"] == 2 and summary["box"]["won"]["share"] == 2 / 3
    measured = summary["box"]["time"]
    assert measured[statistic] == pytest.approx(0.1 + 1 / 3)
    assert measured["low"] < measured[statistic] < measured["high"]
    text = tables.measures_text({"a": summary}, statistic, {"time": ("time s", 1.0, ".1f")})
    assert text.splitlines()[-1].startswith("| a | 0.3 [")


def test_the_figures_of_a_case_do_not_depend_on_the_others() -> None:
    times = np.random.default_rng(0).uniform(10.0, 20.0, 20)
    left, right = (framed(*[True] * 20, case=case).assign(time=times) for case in "ab")
    first, second = (
        tables.summary_of(part, ["object"], ["won"], ["time"], "mean", 3) for part in (left, right)
    )
    assert first["all"]["time"]["low"] != second["all"]["time"]["low"]
    assert first == tables.summary_of(left, ["object"], ["won"], ["time"], "mean", 3)


def test_a_measure_that_no_trial_has_is_none() -> None:
    frame = framed(True, True).assign(time=float("nan"))
    summary = tables.summary_of(frame, ["object"], ["won"], ["time"], "mean", 0)
    assert summary["all"]["time"] == {"n": 0, "mean": None, "low": None, "high": None}
    assert "| - |" in tables.measures_text({"a": summary}, "mean", {"time": ("s", 1.0, "g")})


def test_a_long_list_of_failures_is_cut() -> None:
    frame = framed(*[False] * 5, True)
    text = tables.failures_text(frame, "won", [f"sentence {row}" for row in range(6)], 3)
    assert text.splitlines()[0] == "**a**: 5 of 6 without success"
    assert text.splitlines()[1:] == [
        "- sentence 0", "- sentence 1", "- sentence 2", "- and 2 more, in results.csv"
    ]  # fmt: skip


def test_flags_of_which_some_are_unknown_are_0_or_1() -> None:
    frame = pd.DataFrame({"name": ["a", "b", "c"], "inside": [True, None, False]})
    assert as_csv(frame) == "name,inside\na,1\nb,\nc,0\n"
