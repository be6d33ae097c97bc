"""What fuzzing found once is read with a sentence, or read; `make fuzz` looks for more."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from tests.fuzz.__main__ import CORPUS, inputs, kind_of, outcome
from tests.fuzz.mutations import mutated
from tests.fuzz.targets import TARGETS, Target

FOUND = sorted(path.name for path in CORPUS.iterdir())
OTHERS = ("order", "ouster")
"""Orders need a state, and Ouster files an environment: what is mutated is not read as it is."""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", FOUND)
def test_what_was_found_is_mended(name: str) -> None:
    target = TARGETS[name.partition("-")[0]]
    assert outcome(target, (CORPUS / name).read_bytes()) == ""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", TARGETS)
def test_the_first_inputs_of_each_target_are_answered(name: str) -> None:
    count = 8 if name == "c3d" else 25
    for number, content in islice(inputs(TARGETS[name], 0, 0), count):
        assert outcome(TARGETS[name], content) == "", number


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", [name for name in TARGETS if name not in OTHERS])
def test_what_is_mutated_is_read_as_it_is(name: str, tmp_path: Path) -> None:
    for number, base in enumerate(TARGETS[name].bases(tmp_path)):
        folder = tmp_path / f"read {number}"
        folder.mkdir()
        TARGETS[name].read(base, folder)


def test_an_input_is_the_same_again_and_what_it_meets_is_reported() -> None:
    base, rng = b"key: [1, 2]\nother: word\n", np.random.default_rng
    made = [mutated(base, rng((0, number)), True, [base]) for number in range(50)]
    assert made == [mutated(base, rng((0, number)), True, [base]) for number in range(50)]
    assert len(set(made)) > 40

    def read(content: bytes, folder: Path) -> None:
        raise KeyError(content.decode())

    found = outcome(Target(lambda folder: [base], read), b"name")
    assert found.startswith("KeyError test_fuzz_corpus.py:") and kind_of(found) in found
