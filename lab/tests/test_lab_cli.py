"""The laboratory's commands: what is wrong is one sentence."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from contactfusion_lab.experiments.methods import DE_MORGAN, POSTERIOR, Method
from contactfusion_lab.experiments.touch import experiment
from contactfusion_lab.experiments.touch.experiment import METHODS, Options
from tests.test_cli import Ask, ask, folder, one_sentence

__all__ = ["ask", "folder"]


def test_a_demo_that_cannot_be_written_is_one_sentence(folder: Path, ask: Ask) -> None:
    (folder / "taken").write_text("a file stands where the folder should")
    assert "taken" in one_sentence(ask("demo", "--out", "taken"))
    assert (folder / "taken").read_text().startswith("a file")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["touch", "--spreads", "0"], ["more than 0, not by 0"]),
        (["touch", "--rule", "de_morgan", "--spreads", "2"], ["looks at spreads", "'sets'"]),
        (["touch", "--rule", "max"], ["the rule 'max' was removed: take 'sets'"]),
        (["touch", "--rule", "sets/modes"], ["'modes' needs the rule 'posterior'"]),
        (["recordings", "--rule", "posteriori"], ["did you mean 'posterior'"]),
        (["recordings", "--data", "nowhere"], ["nowhere", "force_plates"]),
    ],
)
def test_an_experiment_that_cannot_start_is_one_sentence(
    arguments: list[str], words: list[str], folder: Path, ask: Ask
) -> None:
    sentence = one_sentence(ask("experiment", *arguments, "--out", "out"))
    assert all(word in sentence for word in words), sentence
    assert not (folder / "out" / "results.csv").exists()


@pytest.mark.parametrize(
    ("arguments", "methods"),
    [
        ([], METHODS),
        (["--preset", "paper"], [DE_MORGAN]),
        (["--preset", "paper", "--rule", "posterior/modes"], [POSTERIOR]),
    ],
)
def test_the_preset_of_the_papers_takes_their_rule_alone(
    arguments: list[str],
    methods: Sequence[Method],
    monkeypatch: pytest.MonkeyPatch,
    folder: Path,
    ask: Ask,
) -> None:
    given: list[Options] = []
    monkeypatch.setattr(experiment, "run_touch", lambda options, out: given.append(options))
    assert ask("experiment", "touch", *arguments).status == 0
    assert [options.methods for options in given] == [methods]
