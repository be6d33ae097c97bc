"""ROBOT.yaml: where its files are, what it may hold, and what it names that is not there."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.robots.description import RobotConfig, read_robot
from contactfusion.robots.model import RobotModel
from tests.urdfs import REAL, built, joint, link, written

SHIPPED = "contactfusion.robots:arm_hand.yaml"
GRID = {"rows": 2, "columns": 2, "pitch": [0.01, 0.01]}
FULL: dict[str, Any] = {
    "urdf": "robot.urdf",
    "frames": {"tip": {"parent": "arm", "xyz": [0.1, 0.0, 0.0]}},
    "patches": {"skin": {"frame": "tip", "grid": GRID}},
    "wrists": {"wrist": {"frame": "arm", "sign": "on_robot"}},
    "cameras": {"eye": {"frame": "base", "width": 64, "height": 48, "fov": 60.0}},
    "fingers": {"finger": {"joints": ["hinge"], "links": ["arm"]}},
}


def two_links() -> tuple[str, ...]:
    return link("base"), link("arm"), joint("hinge", "base", "arm")


def described(folder: Path, **fields: Any) -> Path:
    """Write a ROBOT.yaml, beside its URDF, with these fields in place of good ones."""
    written(folder, *two_links())
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump({**FULL, **fields}))
    return path


def said(path: Path) -> str:
    """The one sentence about a description that cannot be used."""
    with pytest.raises((ConfigurationError, RobotError)) as caught:
        RobotModel(read_robot(path))
    assert "\n" not in str(caught.value)
    return str(caught.value)


# The shipped one


def test_the_shipped_description_is_of_the_shipped_robot() -> None:
    model = RobotModel(read_robot(SHIPPED))
    assert model.urdf.path.samefile(RobotConfig(urdf=REAL[0]).path())
    fingertips = {model.link_of(model.config.patches[f"tip_{n}"].frame) for n in (1, 2, 3)}
    assert fingertips == {f"finger_{n}_distal" for n in (1, 2, 3)}
    assert model.link_of(model.config.patches["palm"].frame) == "palm"
    assert model.beyond(model.config.wrists["wrist"].frame)[0] == "wrist_sensor"


def test_each_fingertip_of_the_shipped_hand_is_felt_where_it_can_be_touched() -> None:
    model = RobotModel(read_robot(SHIPPED))
    for n in (1, 2, 3):
        pose = model.pose_on_link(f"tip_{n}")
        taxels = model.config.patches[f"tip_{n}"].centres() @ pose[:3, :3].T + pose[:3, 3]
        assert np.hypot(taxels[:, 0], taxels[:, 1]).max() < 0.0095 + 0.001
        assert np.allclose(pose[:3, 2], [-1.0, 0.0, 0.0], atol=1e-4)  # where the finger closes


def test_the_shipped_camera_looks_at_the_place_before_the_robot() -> None:
    model = RobotModel(read_robot(SHIPPED))
    pose = model.pose_on_link(model.config.cameras["forehead"].frame)
    x, y, z = np.linalg.solve(pose, [0.6, 0.0, 0.1, 1.0])[:3]
    assert z > 0.5 and abs(x) < 1e-3 and abs(y) < 0.1 * z
    assert np.allclose(pose[:3, 0], [0.0, -1.0, 0.0], atol=1e-4)  # x goes right


# Where files are


def test_names_in_it_start_at_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "arm" / "meshes" / "kit").mkdir(parents=True)
    mesh = '<mesh filename="package://kit/arm.stl"/>'
    (tmp_path / "arm" / "meshes" / "kit" / "arm.stl").write_text("solid")
    written(tmp_path / "arm", link("base", mesh))
    (tmp_path / "arm" / "robot.yaml").write_text("urdf: robot.urdf\npackages: [meshes]\n")
    for start, path in ((tmp_path, "arm/robot.yaml"), (tmp_path / "arm", "robot.yaml")):
        monkeypatch.chdir(start)
        assert RobotModel(read_robot(Path(path))).link_names == ("base",)
    assert RobotModel(read_robot(tmp_path / "arm" / "robot.yaml")).link_names == ("base",)


def test_its_folder_may_be_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "deep" / "urdfs").mkdir(parents=True)
    written(tmp_path / "deep" / "urdfs", link("base"))
    (tmp_path / "deep" / "robot.yaml").write_text("urdf: robot.urdf\nfolder: urdfs\n")
    monkeypatch.chdir(tmp_path)
    assert read_robot(Path("deep/robot.yaml")).path() == Path("deep/urdfs/robot.urdf")


@pytest.mark.parametrize("name", REAL)
def test_a_robot_may_come_with_a_package(name: str) -> None:
    module, _, file = name.partition(":")
    spec = find_spec(module)
    assert spec and spec.submodule_search_locations
    assert RobotConfig(urdf=name).path() == Path(spec.submodule_search_locations[0]) / file


@pytest.mark.parametrize("module", ["pybullet_dat", "pybullet_dat.a", "", ".a", "os", "__main__"])
def test_a_package_that_is_not_installed_is_told(module: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        RobotConfig(urdf=f"{module}:arm.urdf").path()
    assert str(caught.value) == f"urdf: the Python package '{module}' is not installed"


def test_a_file_that_its_package_lacks_is_told_with_the_nearest() -> None:
    with pytest.raises(RobotError, match="no file 'pandaa.urdf' in .*did you mean 'panda.urdf'"):
        RobotModel(RobotConfig(urdf="pybullet_data:franka_panda/pandaa.urdf"))


def test_a_missing_urdf_is_told_with_the_nearest(tmp_path: Path) -> None:
    assert "did you mean 'robot.urdf'?" in said(described(tmp_path, urdf="robto.urdf"))


def test_a_missing_description_is_told_with_the_nearest(tmp_path: Path) -> None:
    described(tmp_path)
    assert "did you mean 'robot.yaml'?" in said(tmp_path / "robt.yaml")


# What it may hold


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"patchs": {}}, "patchs: unknown field; did you mean 'patches'?"),
        ({"urdf": ""}, "urdf: "),
        ({"urdf": None}, "urdf: "),
        ({"shapes": "visuals"}, "shapes: input should be 'collision' or 'visual'"),
        ({"spacing": 0.0}, "spacing: input should be greater than 0"),
        ({"patches": {"skin": {"frame": "arm"}}}, "patches.skin: give a grid or places"),
        (
            {"patches": {"skin": {"fram": "arm", "grid": GRID}}},
            "patches.skin.fram: unknown field; did you mean 'frame'?",
        ),
        ({"wrists": {"wrist": {"frame": "arm"}}}, "wrists.wrist.sign: this field is required"),
        (
            {"wrists": {"wrist": {"frame": "arm", "sign": "on_robt"}}},
            "wrists.wrist.sign: input should be 'on_robot' or 'by_robot', not 'on_robt'",
        ),
        ({"cameras": {"eye": {**FULL["cameras"]["eye"], "fov": 180}}}, "cameras.eye.fov: "),
        (
            {"cameras": {"eye": {**FULL["cameras"]["eye"], "reach": [2.0, 1.0]}}},
            "cameras.eye.reach: give the least distance, then the greatest",
        ),
        (
            {"fingers": {"finger": {"joints": [], "links": ["arm"]}}},
            "fingers.finger.joints: ",
        ),
    ],
)
def test_a_field_that_cannot_be_is_told_by_its_path(
    fields: dict[str, Any], words: str, tmp_path: Path
) -> None:
    sentence = said(described(tmp_path, **fields))
    assert "robot.yaml: " + words in sentence, sentence


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"still": {"hing": 0.0}}, "still.hing: unknown joint 'hing': did you mean 'hinge'?"),
        ({"links": ["amr"]}, "links: unknown link 'amr': did you mean 'arm'?"),
        ({"links": ["tip"]}, "links: unknown link 'tip': the links are: arm, base"),
        (
            {"frames": {"tip": {"parent": "amr"}}},
            "frames.tip.parent: unknown frame 'amr': did you mean 'arm'?",
        ),
        (
            {"frames": {"tip": {"parent": "arm", "xyz": [0, 0, -80]}}},
            "frames.tip.xyz.2: -80 m is implausible, the limit is -10 m; lengths are in metres: "
            "did you mean -0.08?",
        ),
        (
            {"patches": {"skin": {"frame": "tpi", "grid": GRID}}},
            "patches.skin.frame: unknown frame 'tpi': did you mean 'tip'?",
        ),
        (
            {"wrists": {"wrist": {"frame": "aarm", "sign": "on_robot"}}},
            "wrists.wrist.frame: unknown frame 'aarm': did you mean 'arm'?",
        ),
        (
            {"cameras": {"eye": {**FULL["cameras"]["eye"], "frame": "bas"}}},
            "cameras.eye.frame: unknown frame 'bas': did you mean 'base'?",
        ),
        (
            {"fingers": {"finger": {"joints": ["hinges"], "links": ["arm"]}}},
            "fingers.finger.joints: unknown joint 'hinges': did you mean 'hinge'?",
        ),
        (
            {"fingers": {"finger": {"joints": ["hinge"], "links": ["tip"]}}},
            "fingers.finger.links: unknown link 'tip': the links are: arm, base",
        ),
        (
            {"frames": {"tip": {"parent": "eye"}, "eye": {"parent": "tip"}}},
            "frames: the frames form a circle: eye -> tip -> eye",
        ),
        (
            {"frames": {"tip": {"parent": "arm"}, "arm": {"parent": "base"}}},
            "frames.arm: a link has this name already",
        ),
    ],
)
def test_what_it_names_and_the_robot_lacks_is_told_with_the_nearest(
    fields: dict[str, Any], words: str, tmp_path: Path
) -> None:
    assert said(described(tmp_path, **fields)).startswith(words)


def test_frames_may_stand_in_each_other(tmp_path: Path) -> None:
    frames = {"a": {"parent": "b", "xyz": (1, 0, 0)}, "b": {"parent": "arm", "xyz": (0, 1, 0)}}
    model = built(tmp_path, *two_links(), frames=frames)
    assert model.link_of("a") == "arm"
    assert np.array_equal(model.pose_on_link("a")[:3, 3], [1.0, 1.0, 0.0])


def test_a_description_without_sensors_is_one(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text("urdf: robot.urdf\n")
    written(tmp_path, link("base"))
    assert RobotModel(read_robot(tmp_path / "robot.yaml")).root == "base"


def test_a_colon_in_a_folder_is_no_package(tmp_path: Path) -> None:
    folder = tmp_path / "2024-05-01T10:00:00"
    folder.mkdir()
    assert read_robot(described(folder)).path() == folder / "robot.urdf"
