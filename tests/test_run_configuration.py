"""What the configuration in a recording may name: a recording may come from anybody."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactfusion
from contactfusion.errors import ConfigurationError, RecordingError, RobotError
from contactfusion.pipeline import Pipeline
from contactfusion.readings import Wrench
from contactfusion.recordings.mcap import McapWriter
from contactfusion.run.configuration import TOPIC, setting_of_file, setting_of_recording
from contactfusion.run.session import Session
from contactfusion.segmenters.sam2 import Sam2Config, Sam2Segmenter
from tests.urdfs import link, written

KEPT = Path(__file__).parent / "data" / "kept.mcap"
"""Forty taxels of the mobile base over 0.3 s, written to out/kept.mcap by `contactfusion replay` of
a configuration in conf/, with `robot: contactfusion.robots:mobile_base.yaml`, by version 0.1.0 when
recordings were not bounded yet."""
EPOCH = 1_700_000_000_000_000_000
MESH = '<mesh filename="{}"/>'
DEEP = '{"a": ' * 900 + "1" + "}" * 900


def recorded(folder: Path, kept: Any = None, **configuration: Any) -> Path:
    """Write a recording whose configuration names what it likes."""
    whole = {"folder": ".", "topics": {}, "configuration": configuration} if kept is None else kept
    path = folder / "theirs.mcap"
    with McapWriter(path, EPOCH) as writer:
        writer.text(TOPIC, whole if isinstance(whole, str) else json.dumps(whole))
        for stamp in (0.0, 0.1):
            values = {"force": np.zeros(3), "torque": np.zeros(3)}
            writer.reading(Wrench(stamp=stamp, frame="base", sensor="wrist", **values))
    return path


def said(path: Path) -> str:
    """The one sentence that refuses a recording's configuration."""
    with pytest.raises((ConfigurationError, RecordingError, RobotError)) as caught:
        Pipeline(setting_of_recording(path).config())
    assert "\n" not in str(caught.value)
    return str(caught.value)


def refuses(path: Path, field: str, name: str) -> bool:
    """Whether the sentence names the recording, the field, the file name and the cure."""
    sentence = said(path)
    return (
        f"{field}: a configuration that comes from a recording may name files in " in sentence
        and f"not '{name}'" in sentence
        and sentence.endswith("give the configuration itself by --config FILE")
    )


@pytest.fixture
def beside(tmp_path: Path) -> Path:
    """A downloaded folder, beside which there are files of the user's own."""
    for folder in (tmp_path, tmp_path / "downloads"):
        folder.mkdir(exist_ok=True)
        written(folder, link("base"))
        (folder / "robot.yaml").write_text("urdf: robot.urdf\n")
        np.savez(folder / "body.npz", points=np.zeros((1, 3)), normals=[[0.0, 0.0, 1.0]])
    return tmp_path / "downloads"


# Code


def hidden(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Put a package with a robot on the path, of which no module may be imported."""
    (folder / "theirs" / "robots").mkdir(parents=True)
    (folder / "theirs" / "__init__.py").write_text("raise AssertionError('imported')")
    (folder / "theirs" / "robots" / "__init__.py").write_text("raise AssertionError('imported')")
    (folder / "theirs" / "robots" / "arm.yaml").write_text("urdf: robot.urdf\n")
    written(folder / "theirs" / "robots", link("base"))
    monkeypatch.syspath_prepend(folder)
    return folder / "theirs"


@pytest.mark.parametrize("module", ["theirs", "theirs.robots"])
@pytest.mark.parametrize("how", ["name", "urdf"])
def test_a_recording_names_no_package_that_offers_no_plugins_and_imports_nothing(
    module: str, how: str, beside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hidden(beside, monkeypatch)
    named = f"{module}:arm.yaml"
    sentence = said(recorded(beside, robot=named if how == "name" else {"urdf": named}))
    assert f"not of the Python package '{module}'" in sentence and "--config FILE" in sentence
    assert "theirs" not in sys.modules


def test_a_recording_names_files_of_a_package_with_plugins_and_nothing_is_imported(
    beside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = hidden(beside, monkeypatch)
    info = beside / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[contactfusion]\ntheirs = theirs.generators\n")
    config = setting_of_recording(recorded(beside, robot="theirs.robots:arm.yaml")).config()
    assert config.robot and config.robot.path() == package / "robots" / "robot.urdf"
    assert "theirs" not in sys.modules


def test_even_a_file_of_a_package_lies_in_that_package(beside: Path) -> None:
    name = "../../../../robot.yaml"
    assert f"not '{name}'" in said(recorded(beside, robot=f"contactfusion.robots:{name}"))


def test_a_users_own_configuration_names_any_package(
    beside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hidden(beside, monkeypatch)
    (beside / "mine.yaml").write_text("robot: theirs.robots:arm.yaml\n")
    assert setting_of_file(beside / "mine.yaml").config().robot
    assert "theirs" not in sys.modules


# Files


@pytest.mark.parametrize("name", ["../robot.yaml", "{up}/robot.yaml", "{here}/robot.yaml"])
def test_a_recording_names_no_robot_outside_its_folder_and_none_by_an_absolute_name(
    name: str, beside: Path
) -> None:
    name = name.format(up=beside.parent, here=beside)
    assert refuses(recorded(beside, robot=name), "robot", name)


@pytest.mark.parametrize("folder", ["..", "/", "{up}"])
def test_the_folder_that_a_recording_tells_leads_nowhere_else(folder: str, beside: Path) -> None:
    folder = folder.format(up=beside.parent)
    kept = {"folder": folder, "topics": {}, "configuration": {"robot": "robot.yaml"}}
    assert refuses(recorded(beside, kept), "robot", "robot.yaml")
    kept = {
        "folder": ".", "topics": {}, "configuration": {"robot": "robot.yaml", "folder": folder}
    }  # fmt: skip
    assert refuses(recorded(beside, kept), "robot", "robot.yaml")
    path = recorded(beside, robot={"urdf": "robot.urdf", "folder": folder})
    assert refuses(path, "robot.folder", folder)


def test_no_link_leads_out_of_the_folder_of_a_recording(beside: Path) -> None:
    (beside / "linked.yaml").symlink_to(beside.parent / "robot.yaml")
    (beside / "up").symlink_to(beside.parent)
    (beside / "round").symlink_to(beside / "round")
    for name in ("linked.yaml", "up/robot.yaml", "round"):
        assert refuses(recorded(beside, robot=name), "robot", name)


def test_a_recording_does_not_lift_its_own_bound(beside: Path) -> None:
    up = str(beside.parent)
    assert refuses(
        recorded(beside, robot="../robot.yaml", files_within=up), "robot", "../robot.yaml"
    )
    path = recorded(beside, robot={"urdf": "../robot.urdf", "files_within": up})
    assert refuses(path, "urdf", "../robot.urdf")


def test_a_name_that_no_file_can_have_is_refused(beside: Path) -> None:
    assert "may name files in" in said(recorded(beside, robot="a\0b"))


@pytest.mark.parametrize(
    ("field", "configuration"),
    [
        ("surface.file", {"surface": {"frame": "base", "file": "../body.npz"}}),
        ("urdf", {"robot": {"urdf": "../body.npz"}}),
        ("robot.packages.0", {"robot": {"urdf": "robot.urdf", "packages": ["../body.npz"]}}),
        ("generators.skin.baseline.file", {"skin": {
            "type": "tactile", "patch": "skin", "baseline": {"file": "../body.npz"}}}),
        ("generators.pad.map", {"pad": {
            "type": "taxel_map", "map": "../body.npz", "min_signal": 1.0}}),
        ("generators.eye.weights", {"eye": {"type": "lidar_cpm", "weights": "../body.npz"}}),
        ("generators.sim.objects.box.mesh", {"sim": {
            "type": "simulator",
            "objects": {"box": {"mesh": "../body.npz", "pose": {"parent": "base"}}}}}),
    ],
)  # fmt: skip
def test_no_file_of_any_kind_lies_outside_the_folder_of_a_recording(
    field: str, configuration: dict[str, Any], beside: Path
) -> None:
    if field.startswith("generators"):
        configuration = {
            "generators": configuration,
            "robot": "contactfusion.robots:mobile_base.yaml",
        }
    assert refuses(recorded(beside, **configuration), field, "../body.npz")


def test_an_object_by_urdf_lies_in_the_folder_of_a_recording(beside: Path) -> None:
    from contactfusion.model import rooted
    from contactfusion.robots.objects import ObjectConfig, ObjectModel

    config = ObjectConfig.model_validate({"urdf": "../robot.urdf", "pose": {"parent": "base"}})
    with pytest.raises(ConfigurationError, match=r"not '\.\./robot\.urdf'"):
        ObjectModel(rooted(config, beside, beside))


def test_a_recording_asks_no_network_for_a_model() -> None:
    for weights in ("facebook/sam2.1-hiera-tiny", "tiny"):
        config = Sam2Config(weights=weights, files_within=Path())
        with pytest.raises(ConfigurationError, match=f"no model of SAM 2, not '{weights}'; .*-"):
            Sam2Segmenter(config)


def test_robot_and_meshes_beside_a_recording_are_used(beside: Path) -> None:
    (beside / "arm" / "urdf").mkdir(parents=True)
    (beside / "arm" / "meshes").mkdir()
    (beside / "arm" / "meshes" / "base.stl").write_text("solid")
    written(beside / "arm" / "urdf", link("base", MESH.format("../meshes/base.stl")))
    (beside / "arm" / "arm.yaml").write_text("urdf: urdf/robot.urdf\n")
    for kept in (
        {"folder": "arm", "topics": {}, "configuration": {"robot": "arm.yaml"}},
        {"folder": "arm/urdf", "topics": {}, "configuration": {"robot": "../arm.yaml"}},
    ):
        config = setting_of_recording(recorded(beside, kept)).config()
        assert config.robot and config.robot.path().samefile(beside / "arm/urdf/robot.urdf")
        assert config.robot.files_within == beside


@pytest.mark.parametrize("name", ["../base.stl", "{up}/base.stl", "package://ros/base.stl"])
def test_a_robot_beside_a_recording_has_no_mesh_outside_whatever_package_it_is_in(
    name: str, beside: Path
) -> None:
    (beside.parent / "ros").mkdir()
    for folder in (beside.parent, beside.parent / "ros"):
        (folder / "package.xml").write_text("<package/>")
        (folder / "base.stl").write_text("solid")
    written(beside, link("base", MESH.format(name.format(up=beside.parent))))
    assert f"the mesh '{name.format(up=beside.parent)}' is" in said(
        recorded(beside, robot="robot.yaml")
    )


def test_a_mesh_beside_a_recording_is_no_link_to_elsewhere(beside: Path) -> None:
    (beside.parent / "base.stl").write_text("solid")
    (beside / "base.stl").symlink_to(beside.parent / "base.stl")
    written(beside, link("base", MESH.format("base.stl")))
    assert "outside the package of the file" in said(recorded(beside, robot="robot.yaml"))


# Recordings that are kept


def test_a_recording_of_former_days_is_played_though_its_configuration_lay_elsewhere() -> None:
    setting = setting_of_recording(KEPT)
    assert str(setting.folder).endswith("../conf") and not setting.folder.exists()
    contacts = [step.fusion.contacts for step in Session(setting, KEPT).steps()]
    assert [len(found) for found in contacts] == [1, 1, 1]
    assert contacts[-1][0].position.tolist() == pytest.approx([0.3, -0.025, -0.225], abs=1e-3)


@pytest.mark.parametrize(
    "kept", ["{", "[]", "7", '{"folder": "."}', {"folder": 1, "topics": {}, "configuration": {}},
             {"folder": ".", "topics": [], "configuration": {}},
             {"folder": ".", "topics": {}, "configuration": []}, "[" * 100_000,
             f'{{"folder": ".", "topics": {{}}, "configuration": {DEEP}}}']
)  # fmt: skip
def test_a_topic_that_no_replay_wrote_is_told_in_one_sentence(kept: Any, tmp_path: Path) -> None:
    path = recorded(tmp_path, kept)
    assert said(path).startswith(f"{path}: {TOPIC} is not what a run writes: ")


def test_a_recording_names_files_of_this_package_wherever_it_is_installed(beside: Path) -> None:
    """As recordings of experiments do, which hold what a ROBOT.yaml said."""
    home = Path(contactfusion.__file__).parent / "robots"
    config = setting_of_recording(
        recorded(beside, robot={"urdf": "arm_hand.urdf", "folder": str(home)})
    ).config()
    assert config.robot and config.robot.path() == home / "arm_hand.urdf"
    name = "../../../robot.yaml"
    assert refuses(recorded(beside, robot={"urdf": name, "folder": str(home)}), "urdf", name)
