"""A pipeline's configuration from a file."""

from pathlib import Path

import pytest
import yaml

from contactfusion import ContactFusionError, PipelineConfig, run_file
from contactfusion.errors import ConfigurationError

SPHERE = {"frame": "wrist", "shapes": [{"shape": "sphere", "radius": 0.05}]}
FIELDS = {
    "recording": {"type": "log", "file": "wrist.csv"},
    "scene": {"type": "push"},
    "surface": SPHERE,
    "integrator": {"frame": "wrist"},
}


def written(folder: Path, **fields: object) -> Path:
    path = folder / "hand.yaml"
    path.write_text(yaml.safe_dump(FIELDS | fields))
    return path


def test_a_file_gives_the_pipeline_without_what_it_runs_on(tmp_path: Path) -> None:
    config = PipelineConfig.from_file(str(written(tmp_path)))
    assert config.integrator.frame == "wrist" and config.surface is not None
    assert config.folder == tmp_path


def test_names_of_files_start_at_its_folder(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "robot.yaml").write_text("urdf: robot.urdf")
    path = written(tmp_path, robot="deep/robot.yaml", surface=None)
    robot = PipelineConfig.from_file(path).robot
    assert robot is not None and robot.path() == tmp_path / "deep" / "robot.urdf"


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"integrator": {"voxel_sise": 1}}, "integrator.voxel_sise: unknown field; did you mean"),
        ({"generators": {"skin": {}}}, "generators.skin.type: name the type of the generator"),
        ({"robot": "none.yaml"}, "robot: "),
    ],
)
def test_a_wrong_field_is_refused_as_by_run(
    fields: dict[str, object], sentence: str, tmp_path: Path
) -> None:
    path = written(tmp_path, **fields)
    with pytest.raises(ConfigurationError) as error:
        PipelineConfig.from_file(path)
    assert str(error.value).startswith(f"{path}: {sentence}")
    path.write_text(yaml.safe_dump({k: v for k, v in (FIELDS | fields).items() if k != "scene"}))
    with pytest.raises(ContactFusionError) as run:
        run_file(path, out=tmp_path / "out")
    assert str(run.value) == str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"there is no file 'hand.yaml' in "):
        PipelineConfig.from_file(tmp_path / "hand.yaml")
