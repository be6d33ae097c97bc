"""The wheel of the laboratory, installed beside that of the framework, adds commands and scenes."""

import zipfile
from pathlib import Path

import pytest

from tests.test_wheel import built, installed, run, wheel

pytestmark = pytest.mark.slow

__all__ = ["wheel"]
LAB = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def lab_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("lab"), LAB, ["contactfusion_lab"])


def test_the_wheel_holds_every_module_and_file_of_the_laboratory(lab_wheel: Path) -> None:
    with zipfile.ZipFile(lab_wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    files = {
        str(path.relative_to(LAB))
        for path in (LAB / "contactfusion_lab").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert held == files


def test_it_adds_its_commands_scenes_and_baselines(
    wheel: Path, lab_wheel: Path, tmp_path: Path
) -> None:
    programs = installed(tmp_path / "environment", wheel, lab_wheel)
    sentence = run(programs / "contactfusion", "plugins", "--strict", cwd=tmp_path)
    kinds = {line.split()[0]: line.split()[1] for line in sentence.splitlines() if line[:1] != " "}
    assert {name: kinds[name] for name in ("grasp", "push", "touch")} == dict.fromkeys(
        ("grasp", "push", "touch"), "scene"
    )
    assert kinds["demo"] == kinds["experiment"] == kinds["train"] == "command"
    baselines = [kinds[name] for name in ("posterior", "modes", "cluster_mass")]
    assert baselines == ["rule", "condensation", "condensation"]
    for words in (["demo"], ["experiment", "push"], ["train", "cpm"], ["tune", "push"]):
        assert "Usage:" in run(programs / "contactfusion", *words, "-h", cwd=tmp_path)
