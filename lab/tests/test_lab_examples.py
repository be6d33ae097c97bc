"""Every example with a scene runs as a script, from any folder."""

from pathlib import Path

import pytest

from tests.test_examples import ALL, EXAMPLES, runs

SCENES = [path for path in ALL if path not in EXAMPLES]


@pytest.mark.slow
@pytest.mark.parametrize("example", SCENES, ids=lambda path: path.stem)
def test_the_example_runs_and_leaves_its_results_where_it_was_asked_to(
    example: Path, tmp_path: Path
) -> None:
    runs(example, tmp_path)
