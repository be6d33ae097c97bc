"""The laboratory's commands: what is wrong is one sentence."""

from pathlib import Path

import pytest

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
        (
            ["touch", "--rule", "de_morgan", "--spreads", "2"],
            ["looks at spreads", "'posterior/modes'"],
        ),
        (["touch", "--rule", "de_morgan/modes"], ["'modes' needs a rule that gives a belief"]),
        (["touch", "--rule", "max"], ["the rule 'max' was removed: take 'sets'"]),
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
