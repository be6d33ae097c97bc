"""A first configuration: it is valid, it runs as it stands, and it replaces nothing."""

import csv
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion.check import check_file
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.inspect.first_configuration import write_first
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import installed_plugins
from contactfusion.readings.messages import message
from contactfusion.run.configuration import RunConfig
from contactfusion.run.execute import run_file
from tests.first_bags import arm, cloud, pressed
from tests.ros_bags import SECOND, Said, joints, mcap, ros1, text, top, transforms, vector, wrench

Printed = pytest.CaptureFixture[str]


def written(out: Path) -> dict[str, Any]:
    fields: dict[str, Any] = yaml.safe_load(out.read_text())
    return fields


def contacts(path: Path) -> np.ndarray[Any, Any]:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return np.array([[float(row[axis]) for axis in "xyz"] for row in rows])


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return mcap(tmp_path / "bags", pressed())


def test_names_in_a_recording_add_no_lines_to_what_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    named, out = "a\nOK\n", tmp_path / "a.yaml"
    said = [(f"/{named}", i * SECOND, wrench(i * SECOND, frame=named)) for i in range(3)]
    write_first(mcap(tmp_path, said), out)
    assert "OK" not in capsys.readouterr().out.splitlines()
    assert "OK" not in out.read_text().splitlines()


def test_the_first_configuration_of_a_bag_replays_it(
    bag: Path, tmp_path: Path, capsys: Printed
) -> None:
    out = tmp_path / "first.yaml"
    write_first(bag, out)
    printed = capsys.readouterr().out
    assert "a ball of 5 cm about ft/wrench stands in" in printed
    assert "contacts lie on that ball" in printed
    assert "surface:  # a stand-in: contacts lie on this ball" in out.read_text()
    assert "eye/points is left out: it needs the robot: name its URDF by --robot" in printed
    assert (
        "ft_wrench: the sign is taken to be on_robot: push the tool along the sensor's -x, and the "
        "force must point to -x; else set sign: by_robot"
    ) in printed.splitlines()
    assert f"next: contactfusion replay {out} {bag}" in printed
    fields = written(out)
    assert set(fields["generators"]) == {"ft_wrench"}
    assert fields["generators"]["ft_wrench"]["tare"] == 0.5
    assert fields["integrator"] == {"frame": "base", "voxel_size": 0.005}
    run_file(out, bag, out=tmp_path / "contacts.csv")
    assert len(contacts(tmp_path / "contacts.csv")) > 10


@pytest.mark.parametrize("write", [mcap, ros1])
def test_with_the_robot_contacts_lie_on_its_tool(
    write: Any, tmp_path: Path, capsys: Printed
) -> None:
    pytest.importorskip("pinocchio")
    bag, out = write(tmp_path / "bags", pressed()), tmp_path / "configs" / "first.yaml"
    write_first(bag, out, robot=arm(tmp_path))
    fields = written(out)
    types = {name: one["type"] for name, one in fields["generators"].items()}
    assert types == {
        "eye_points": "range", "ft_wrench": "force_torque", "joint_states": "motion"
    }  # fmt: skip
    assert fields["robot"]["urdf"] == "../robot.urdf" and fields["integrator"]["frame"] == "base"
    assert "# links: base, arm, ft, tool" in out.read_text()
    assert "# joints: turn" in out.read_text()
    RunConfig(folder=out.parent, **fields)
    capsys.readouterr()
    run_file(out, bag, out=tmp_path / "contacts.csv")
    run_file(out, out=tmp_path / "run")
    differently = "ft: the URDF and /tf_static place it differently, 1.1 m and 0.1 rad apart"
    assert capsys.readouterr().out.count(differently) == 2
    assert f"{differently}; the URDF counts" in check_file(out).lines
    for found in (contacts(tmp_path / "contacts.csv"), contacts(tmp_path / "run" / "contacts.csv")):
        assert len(found) > 10
        away = np.linalg.norm(found - (0.0, 0.0, 0.5), axis=1)
        assert away == pytest.approx(np.full(len(found), 0.03), abs=0.006)


def test_a_robot_none_of_whose_joints_is_reported_is_another_robot(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    said = [one for one in pressed() if one[0] != "/joint_states"]
    others = [
        ("/joint_states", stamp, joints(stamp, name=["elbow"], position=np.array([0.1])))
        for _, stamp, _ in said[:9]
    ]
    bag, out = mcap(tmp_path / "bags", [*said, *others]), tmp_path / "first.yaml"
    with pytest.raises(ConfigurationError, match="the robot has turn; the recording has elbow"):
        write_first(bag, out, robot=arm(tmp_path))
    assert not out.exists()


def test_joints_that_nothing_reports_stand_still(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    said = [one for one in pressed() if one[0] != "/joint_states"]
    out = tmp_path / "first.yaml"
    write_first(mcap(tmp_path / "bags", said), out, robot=arm(tmp_path))
    assert written(out)["robot"]["still"] == {"turn": 0.0}
    PipelineConfig(folder=tmp_path, **{k: v for k, v in written(out).items() if k != "recording"})


def test_the_robot_that_a_bag_describes_is_taken(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    described = [("/robot_description", 0, text(arm(tmp_path).read_text())), *pressed()]
    bag, out = mcap(tmp_path / "bags", described), tmp_path / "out" / "first.yaml"
    write_first(bag, out)
    assert written(out)["robot"]["urdf"] == "first.urdf"
    assert (tmp_path / "out" / "first.urdf").read_text() == arm(tmp_path).read_text()
    assert {file.name for file in out.parent.iterdir()} == {"first.yaml", "first.urdf"}
    run_file(out, bag)


def test_a_description_that_is_damaged_is_left_out(
    tmp_path: Path, capsys: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pinocchio")
    bag = mcap(tmp_path / "bags", [("/robot_description", 0, text("<robot/>")), *pressed()])

    def damaged(cdr: bytes, msgtype: str) -> None:
        raise ValueError("it ends early")

    monkeypatch.setattr(
        "contactfusion.inspect.first_configuration.typestore",
        lambda: SimpleNamespace(deserialize_cdr=damaged),
    )
    write_first(bag, tmp_path / "first.yaml")
    assert "left out: /robot_description can't be read: it ends early" in capsys.readouterr().out


def test_a_robot_whose_meshes_are_elsewhere_is_left_out(tmp_path: Path, capsys: Printed) -> None:
    pytest.importorskip("pinocchio")
    mesh = '<mesh filename="package://arm/tool.stl"/>'
    urdf = arm(tmp_path).read_text().replace('<sphere radius="0.03"/>', mesh)
    said = [("/robot_description", 0, text(urdf)), *pressed()]
    out = tmp_path / "out" / "first.yaml"
    write_first(mcap(tmp_path / "bags", said), out)
    printed = capsys.readouterr().out
    assert "the robot_description is left out: link 'tool': the mesh 'package://arm/tool.stl'" in (
        printed
    )
    assert "name a URDF by --robot" in printed and "surface" in written(out)
    assert {file.name for file in out.parent.iterdir()} == {"first.yaml"}


def test_a_sensor_without_a_place_is_left_out_with_the_reason(
    tmp_path: Path, capsys: Printed
) -> None:
    said = [one for one in pressed(placed=False) if one[0] != "/imu"]
    said += [("/other", stamp, wrench(stamp, frame="moon")) for stamp in (0, SECOND)]
    out = tmp_path / "first.yaml"
    write_first(mcap(tmp_path / "bags", sorted(said, key=lambda one: one[1])), out)
    assert set(written(out)["generators"]) == {"ft_wrench"}
    why = "no transform joins its frame 'moon' to 'ft': say under `frames` where it is"
    assert f"other is left out: {why}" in capsys.readouterr().out
    assert why in out.read_text()


def test_noise_and_bias_are_those_of_the_first_half_second(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    said: list[Said] = []
    for number in range(100):
        stamp = number * SECOND // 100
        force, torque = rng.normal(0.0, 1.0, 3) + (0.0, 0.0, 20.0), rng.normal(0.0, 0.1, 3)
        both = message("geometry_msgs/Wrench", force=vector(*force), torque=vector(*torque))
        one = message("geometry_msgs/WrenchStamped", header=top(stamp, "ft"), wrench=both)
        said.append(("/ft", stamp, one))
    out = tmp_path / "first.yaml"
    write_first(mcap(tmp_path / "bags", said), out)
    (ft,) = written(out)["generators"].values()
    assert ft["force_noise"] == pytest.approx(1.0, rel=0.3)
    assert ft["torque_noise"] == pytest.approx(0.1, rel=0.3)
    assert ft["tare"] == 0.5 and "the first 0.5 s, at rest: their mean, " in out.read_text()


def test_the_average_that_a_comment_offers_is_an_option(bag: Path, tmp_path: Path) -> None:
    write_first(bag, tmp_path / "first.yaml")
    content = (tmp_path / "first.yaml").read_text()
    options = yaml.safe_load(content.replace("# average: ", "average: "))["generators"]["ft_wrench"]
    force_torque = installed_plugins().find("generators", options.pop("type"))
    assert force_torque.Config(**options).average == 0.1


def test_a_wrench_that_moves_from_the_start_is_not_tared(tmp_path: Path) -> None:
    said = [
        ("/ft", stamp, wrench(stamp, force=stamp / SECOND * 40.0))
        for stamp in range(0, SECOND, SECOND // 100)
    ]
    out = tmp_path / "first.yaml"
    write_first(mcap(tmp_path / "bags", said), out)
    assert "tare" not in written(out)["generators"]["ft"]


def test_only_clouds_and_no_robot_give_a_file_that_says_what_it_needs(
    tmp_path: Path, capsys: Printed
) -> None:
    out = tmp_path / "first.yaml"
    write_first(mcap(tmp_path / "bags", [("/eye", 0, cloud(0)), ("/eye", 1, cloud(1))]), out)
    assert written(out)["generators"] == {} and "surface" not in written(out)
    printed = capsys.readouterr().out
    assert "the sign is taken" not in printed
    assert f"next: give {out} a generator, of those in its comments" in printed


def test_a_recording_without_sensors_is_refused(tmp_path: Path) -> None:
    said: Sequence[Said] = [("/tf", 0, transforms((0, "a", "b"))), ("/joints", 0, joints())]
    with pytest.raises(ConfigurationError, match="holds no reading of a sensor .* inspect"):
        write_first(mcap(tmp_path / "bags", said), tmp_path / "first.yaml")
    assert not (tmp_path / "first.yaml").exists()


def test_what_exists_is_replaced_only_by_force(bag: Path, tmp_path: Path) -> None:
    out = tmp_path / "first.yaml"
    out.write_text("mine")
    with pytest.raises(ConfigurationError, match="first.yaml exists already; --force replaces it"):
        write_first(bag, out)
    assert out.read_text() == "mine"
    write_first(bag, out, force=True)
    assert written(out)["generators"]


def test_names_in_a_recording_begin_no_fields(tmp_path: Path) -> None:
    frame = "probe\nfaults: [{fault: silent}]\n#\x1b[2J"
    said: list[Said] = [
        ("/wrist", stamp, wrench(stamp, frame=frame)) for stamp in range(0, SECOND, SECOND // 10)
    ]
    write_first(mcap(tmp_path / "drive.mcap", said), tmp_path / "first.yaml")
    assert "faults" not in written(tmp_path / "first.yaml")
    assert "\x1b" not in (tmp_path / "first.yaml").read_text()


def test_equal_recordings_give_equal_files(bag: Path, tmp_path: Path) -> None:
    for name in ("a.yaml", "b.yaml"):
        write_first(bag, tmp_path / name)
    texts = [(tmp_path / name).read_text().replace(name, "") for name in ("a.yaml", "b.yaml")]
    assert texts[0] == texts[1]


# Of a URDF


def uncommented(content: str) -> dict[str, Any]:
    """The file with the examples of its comments taken in."""
    lines = content.splitlines()
    begin = lines.index("# generators:")
    end = lines.index("", begin)
    lines[begin:end] = [line.removeprefix("# ") for line in lines[begin:end]]
    fields: dict[str, Any] = yaml.safe_load("\n".join(lines))
    return fields


def test_the_first_configuration_of_a_robot_names_links_and_joints(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    urdf = arm(tmp_path)
    write_first(urdf, tmp_path / "first.yaml")
    fields = written(tmp_path / "first.yaml")
    config = PipelineConfig(folder=tmp_path, **fields)
    assert config.robot is not None and config.integrator.frame == "base"
    content = (tmp_path / "first.yaml").read_text()
    assert "# links: base, arm, ft, tool" in content and "# joints: turn" in content


def test_the_examples_of_sensors_are_options_that_their_generators_take(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    write_first(arm(tmp_path), tmp_path / "first.yaml")
    examples = uncommented((tmp_path / "first.yaml").read_text())
    assert len(examples["generators"]) == 8
    for options in PipelineConfig(folder=tmp_path, **examples).generators.values():
        given = {name: value for name, value in options.items() if name != "type"}
        installed_plugins().find("generators", options["type"]).Config(**given)


def test_a_urdf_that_is_none_is_refused_and_a_robot_needs_no_robot(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    (tmp_path / "a.urdf").write_text("<robot/>")
    with pytest.raises(RobotError, match="a.urdf: the <robot> has no name"):
        write_first(tmp_path / "a.urdf", tmp_path / "first.yaml")
    with pytest.raises(ConfigurationError, match="--robot is for recordings"):
        write_first(arm(tmp_path), tmp_path / "first.yaml", robot=arm(tmp_path))
    assert not (tmp_path / "first.yaml").exists()
