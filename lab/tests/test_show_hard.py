"""`make show-hard`: what it makes, how long that takes, and the tables side by side."""

import json
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from contactfusion_lab.experiments.grasp.experiment import columns_of
from contactfusion_lab.experiments.methods import DE_MORGAN, DEFAULT_METHOD, POSTERIOR, Method
from contactfusion_lab.experiments.push.experiment import Options, read_plans
from contactfusion_lab.experiments.touch.experiment import METHODS, TouchExperiment
from contactfusion_lab.experiments.touch.plan import DEFAULT, read_plan
from contactfusion_lab.scenes.noise import PARTS
from contactfusion_lab.scenes.push.noise import PARTS as PUSH_PARTS
from scripts import show_hard


def given(case: show_hard.Case, name: str) -> list[str]:
    """The values of an option of a case."""
    return [
        value
        for option, value in zip(case.options, case.options[1:], strict=False)
        if option == f"--{name}"
    ]


@pytest.fixture(scope="module")
def cases() -> list[show_hard.Case]:
    """All folders."""
    return list(show_hard.cases())


@pytest.fixture
def out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that takes all others."""
    monkeypatch.setattr(show_hard, "OUT", tmp_path)
    return tmp_path


class TestCases:
    def test_every_noise_and_every_part_is_made_of_every_experiment(
        self, cases: list[show_hard.Case]
    ) -> None:
        made = {(case.experiment, noise) for case in cases for noise in given(case, "noise")}
        parts = {"touch": PARTS, "push": PUSH_PARTS, "grasp": PARTS}
        assert made == {
            (experiment, noise)
            for experiment, names in parts.items()
            for noise in ("prototype", "hard", *(f"prototype+{name}" for name in names))
        }

    def test_the_default_stands_beside_the_rules_that_it_is_compared_with(
        self, cases: list[show_hard.Case]
    ) -> None:
        rules = {(case.experiment, case.folder): given(case, "rule") for case in cases}
        assert [Method.named(name) for name in rules["touch", "hard"]] == [*METHODS]
        assert [Method.named(name) for name in rules["grasp", "hard"]] == [*METHODS]
        assert rules["push", "hard"] == []
        others = [Method.named(name) for name in rules["push", "hard_rules"]]
        assert others == [DE_MORGAN, POSTERIOR]
        assert rules["grasp", "hard_papers"] == ["de_morgan"]
        unseen = [Method.named(name) for name in rules["grasp", "hard_unseen"]]
        assert unseen == [DEFAULT_METHOD, DE_MORGAN, POSTERIOR]

    def test_no_two_share_a_folder(self, cases: list[show_hard.Case]) -> None:
        assert max(Counter(case.out for case in cases).values()) == 1

    def test_touches_are_counted_as_the_experiment_makes_them(
        self, cases: list[show_hard.Case]
    ) -> None:
        for case in cases:
            if case.experiment == "touch":
                (noise,), named = given(case, "noise"), given(case, "objects")
                directions, repeats, minutes = (
                    int(*given(case, name)) for name in ("directions", "repeats", "free")
                )
                plan, targets = read_plan(
                    DEFAULT, named[0].split(",") if named else [], directions, noise, (), 0
                )
                tasks = TouchExperiment(plan, targets, repeats, (), (), minutes).tasks()
                assert case.trials == len(tasks), case

    def test_pushes_are_counted_as_the_experiment_makes_them(
        self, cases: list[show_hard.Case]
    ) -> None:
        for case in cases:
            if case.experiment == "push":
                options = Options(
                    sensings=given(case, "sensing"),
                    rules=given(case, "rule"),
                    objects=[name for names in given(case, "objects") for name in names.split(",")],
                    noise=given(case, "noise")[0],
                    targets=given(case, "targets")[0],
                    starts=given(case, "starts")[0],
                )
                pushes = [push for plan in read_plans(options).values() for push in plan.pushes()]
                assert case.trials == len(pushes), case

    def test_grasps_are_counted_as_the_experiment_makes_them(
        self, cases: list[show_hard.Case]
    ) -> None:
        for case in cases:
            if case.experiment == "grasp":
                rules = [Method.named(name) for name in given(case, "rule")]
                columns = columns_of(given(case, "sources"), rules)
                objects = (given(case, "objects") or ["bottle"])[0].split(",")
                each = int(*given(case, "repeats"))
                assert case.trials == len(columns) * len(objects) * each, case


class TestMade:
    def test_a_folder_lacks_the_trials_without_a_file(self, out: Path) -> None:
        case = show_hard.Case("push", "hard", (), 3)
        assert case.missing == 3
        trials = case.out / "trials" / "skin" / "tuned"
        trials.mkdir(parents=True)
        for number in range(2):
            (trials / f"{number}.npz").touch()
        assert case.missing == 1
        assert case.hours == pytest.approx(show_hard.SECONDS["push"] / 3600.0 / 2.0)

    def test_a_folder_that_was_not_evaluated_is_made_again(self, out: Path) -> None:
        case = show_hard.Case("push", "hard", (), 1)
        (case.out / "trials").mkdir(parents=True)
        (case.out / "trials" / "0.npz").touch()
        assert case.missing == 1
        (case.out / "summary.json").write_text("{}")
        assert case.missing == 0
        (case.out / "trials" / "of_another_rule.npz").touch()
        assert case.missing == 0

    def test_a_folder_is_left_alone_when_no_trial_is_left_that_can_be_made(
        self, out: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        case = show_hard.Case("push", "hard", (), 1)
        case.out.mkdir(parents=True)
        (case.out / "summary.json").write_text('{"not made": ["it starts out of sight"]}')
        monkeypatch.setattr(subprocess, "run", None)
        assert show_hard.made(case)

    def test_a_command_that_fails_leaves_its_words_in_a_file(
        self, out: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        case = show_hard.Case("push", "hard", ("--noise", "loud"), 3)
        assert not show_hard.made(case)
        assert "3 of 3 trials are not made" in capsys.readouterr().out
        assert "loud" in (out / "push" / "hard.log").read_text()


def test_an_unknown_experiment_is_refused_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["show_hard.py", "pushh"])
    with pytest.raises(SystemExit, match="unknown experiment 'pushh'; did you mean 'push'"):
        show_hard.main()


def summary_of(experiment: str) -> dict[str, Any]:
    """A summary with one figure."""
    figure = {"low": 0.1, "high": 0.3}
    if experiment == "touch":
        measure = {"case": "force, max", "metric": "detected", "value": 0.2, **figure}
        return {"measures": [measure]}
    if experiment == "push":
        names = [name for _, name, _, _ in show_hard.PUSH_COLUMNS]
        measures = {name: {"median": 0.2, **figure} for name in names}
        pooled = {name: [0.5, 0.4, 0.6] for name in names[-3:]}
        return {"reached": {"skin": {"all": measures}}, "perceived": {"grid": {"skin": pooled}}}
    names = [name for _, name, _, _ in show_hard.GRASP_COLUMNS]
    return {"reached": {"all": {"all": {name: {"mean": 0.2, **figure} for name in names}}}}


class TestTable:
    def test_a_case_has_a_line_a_folder(self, out: Path) -> None:
        ready = [
            show_hard.Case(experiment, folder, (), 1)
            for experiment in show_hard.TABLES
            for folder in ("prototype", "hard")
        ]
        for case in ready:
            case.out.mkdir(parents=True)
            (case.out / "summary.json").write_text(json.dumps(summary_of(case.experiment)))
        text = show_hard.table_text(ready)
        assert "| force, max | prototype | 20 [10, 30] | - |" in text
        assert "| force, max | hard | 20 [10, 30] | - |" in text
        assert "| skin | hard | 20 [10, 30] | 20 [10, 30] | 0.2 [0.1, 0.3] |" in text
        assert text.count("| 50.0 [40.0, 60.0] | 50.0 [40.0, 60.0] |") == 2  # pooled
        assert "| all | hard | 20 [10, 30] | 20.0 [10.0, 30.0] | 0.20 [0.10, 0.30] |" in text
