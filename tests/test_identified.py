"""What was identified counts in a configuration by its field `identified`."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from contactfusion import PipelineConfig
from contactfusion.errors import ConfigurationError
from contactfusion.run.configuration import setting_of_file

EFFORT = {"noise": 0.2, "offset": 0.1, "constant": 1.0, "coulomb": 0.5, "viscous": 0.1}
FOUND: dict[str, Any] = {
    "robot": {
        "efforts": {"arm_1": EFFORT},
        "payload": {"frame": "link_7", "mass": 0.5, "centre_of_mass": [0.0, 0.0, 0.1]},
    },
    "generators": {"wrist": {"compensation": {"mass": 1.5}, "force_noise": 0.4}},
}
CONFIG = {
    "robot": {
        "urdf": "contactfusion.robots:arm_hand.urdf",
        "efforts": {"arm_1": {"noise": 9.0}, "arm_2": {"noise": 8.0}},
    },
    "generators": {"wrist": {"type": "force_torque", "sign": "on_robot", "force_noise": 0.1}},
    "identified": "found.yaml",
}


def written(folder: Path, found: dict[str, Any] = FOUND, **fields: Any) -> Path:
    (folder / "found.yaml").write_text(yaml.safe_dump(found))
    (folder / "config.yaml").write_text(yaml.safe_dump({**CONFIG, **fields}))
    return folder / "config.yaml"


def test_it_replaces_what_is_configured_and_nothing_else(tmp_path: Path) -> None:
    config = PipelineConfig.from_file(written(tmp_path))
    assert config.robot is not None and config.robot.payload is not None
    assert config.robot.efforts["arm_1"].coulomb == 0.5
    assert config.robot.efforts["arm_2"].noise == 8.0
    assert config.robot.payload.mass == 0.5
    wrist = config.generators["wrist"]
    assert wrist["force_noise"] == 0.4 and wrist["sign"] == "on_robot"


def test_a_robot_of_a_file_takes_it_too(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(CONFIG["robot"]))
    config = PipelineConfig.from_file(written(tmp_path, robot="robot.yaml"))
    assert config.robot is not None and config.robot.efforts["arm_1"].noise == 0.2


def test_of_a_robot_alone_no_generator_changes(tmp_path: Path) -> None:
    config = PipelineConfig.from_file(written(tmp_path, {"robot": FOUND["robot"]}))
    assert config.robot is not None and config.robot.efforts["arm_1"].noise == 0.2
    assert config.generators["wrist"]["force_noise"] == 0.1


def test_a_change_on_the_command_line_counts_more(tmp_path: Path) -> None:
    changes = ["robot.efforts.arm_1.noise=0.7", "generators.wrist.force_noise=0.9"]
    config = setting_of_file(written(tmp_path), changes).config()
    assert config.robot is not None and config.robot.efforts["arm_1"].noise == 0.7
    assert config.generators["wrist"]["force_noise"] == 0.9


def test_it_can_be_left_out_on_the_command_line(tmp_path: Path) -> None:
    config = setting_of_file(written(tmp_path), ["identified=null"]).config()
    assert config.robot is not None and config.robot.efforts["arm_1"].noise == 9.0


def test_a_configuration_that_is_kept_in_a_recording_holds_it_itself(tmp_path: Path) -> None:
    assert "found.yaml" not in setting_of_file(written(tmp_path)).text(tmp_path)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (
            {"generators": {"wirst": {}}},
            "identified.generators.wirst: there is no such generator; did you mean 'wrist'",
        ),
        ({"robot": {"effort": {}}}, "identified.robot.effort: unknown field; did you mean"),
    ],
)
def test_what_does_not_fit_is_named(found: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=words):
        PipelineConfig.from_file(written(tmp_path, found))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    path = written(tmp_path)
    (tmp_path / "found.yaml").unlink()
    with pytest.raises(ConfigurationError, match=r"no file 'found\.yaml'"):
        PipelineConfig.from_file(path)


def test_a_surface_has_no_efforts(tmp_path: Path) -> None:
    surface = {"frame": "hand", "shapes": [{"shape": "sphere", "radius": 0.1}]}
    path = written(tmp_path, {"robot": FOUND["robot"]}, robot=None, surface=surface)
    with pytest.raises(ConfigurationError, match=r"identified\.robot: the configuration has no"):
        PipelineConfig.from_file(path)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"identified": 5}, "identified: takes a file, or fields such as `robot`, not 5"),
        ({"identified": [1]}, "identified: takes a file, or fields such as `robot`, not"),
        ({"identified": {}, "generators": [1]}, "generators: input should be a valid dict"),
        (
            {"identified": {"generators": {"skin": {"floor": 5}}}, "generators": {"skin": 5}},
            "generators.skin: ",
        ),
    ],
)
def test_what_is_of_a_wrong_type_is_a_sentence(fields: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^{sentence}"):
        PipelineConfig(**fields)


def test_the_file_is_one_that_is_read(tmp_path: Path) -> None:
    path = written(tmp_path)
    assert tmp_path / "found.yaml" in setting_of_file(path).files(None)
