"""Every example that needs no laboratory runs as a script, from any folder."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ALL = sorted((ROOT / "examples").glob("*.py"))
EXAMPLES = [path for path in ALL if "contactfusion_lab" not in path.read_text()]
BULLET = "pybullet build time"
"""PyBullet says this wherever it is imported."""


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_the_example_runs_and_leaves_its_results_where_it_was_told(
    example: Path, tmp_path: Path
) -> None:
    runs(example, tmp_path)


def runs(example: Path, tmp_path: Path) -> None:
    """Run an example; see it end well with results."""
    done = subprocess.run(
        [sys.executable, "-W", "error", str(example), "results"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    said = [line for line in done.stderr.splitlines() if not line.startswith(BULLET)]
    assert (done.returncode, said) == (0, [])
    assert done.stdout
    assert {entry.name for entry in tmp_path.iterdir()} == {"results"}
    assert any((tmp_path / "results").iterdir())


@pytest.mark.parametrize("example", ALL, ids=lambda path: path.stem)
def test_an_example_is_short_and_says_how_to_run_it(example: Path) -> None:
    text = example.read_text()
    assert f"python examples/{example.name}" in text and text.count("\n") <= 100
