"""Recordings of ROS of a robot by URDF: `run` and `replay` find the same contacts, /tf or not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import Pipeline
from contactfusion.errors import ConfigurationError, FrameError
from contactfusion.pipeline import Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import JointState
from contactfusion.robots.description import RobotConfig
from contactfusion.run.configuration import setting_of_file
from contactfusion.run.execute import run_file
from contactfusion.run.session import Session
from tests.gripper_bags import PUSHED, configured, messages_of
from tests.ros_bags import SECOND, mcap, ros1, transforms

WRIST = {"type": "force_torque", "sign": "on_robot"}
IN_BASE = PUSHED - (0.0, 0.0, 0.3)


def contacts(folder: Path, bag: Path, command: str, **changes: Any) -> str:
    """contacts.csv of a recording, by `run` or by `replay`."""
    folder = folder / command
    folder.mkdir()
    if command == "run":
        run_file(configured(folder, bag, **changes), out=folder / "out")
        return (folder / "out" / "contacts.csv").read_text()
    run_file(configured(folder, **changes), bag, out=folder / "contacts.csv")
    return (folder / "contacts.csv").read_text()


def places(csv: str) -> Any:
    """Stamps and positions of contacts, shape (n, 4) [s, m]."""
    return np.array([row.split(",")[:4] for row in csv.splitlines()[1:]], np.float64)


def places_of(step: Step) -> Any:
    """Positions of a step's contacts, shape (n, 3) [m]."""
    return np.array([contact.position for contact in step.fusion.contacts]).reshape(-1, 3)


@pytest.mark.parametrize("tf", [False, True])
def test_run_and_replay_find_the_same_contacts(tf: bool, tmp_path: Path) -> None:
    bag = mcap(tmp_path, messages_of(tf))
    found = contacts(tmp_path, bag, "run")
    assert contacts(tmp_path, bag, "replay") == found
    rows = places(found)
    assert len({*rows[:, 0]}) == 100
    away = np.linalg.norm(rows[:, 1:] - IN_BASE, axis=1)
    assert all(away[rows[:, 0] == stamp].min() < 0.005 for stamp in rows[:, 0])


def test_a_map_over_the_robot_changes_no_contact(tmp_path: Path) -> None:
    bags = [mcap(tmp_path / str(tf), messages_of(tf)) for tf in (False, True)]
    one, other = (contacts(bag.parent, bag, "run") for bag in bags)
    assert one == other


def test_run_hears_transforms_as_early_as_replay_does(tmp_path: Path) -> None:
    bag = mcap(tmp_path, messages_of(tf=True))
    found = contacts(tmp_path, bag, "run", integrator={"frame": "map"})
    assert contacts(tmp_path, bag, "replay", integrator={"frame": "map"}) == found
    rows = places(found)
    assert rows[0, 0] == pytest.approx(0.151)  # the first transform is of 0.15 s
    driven = 10.0 * rows[0, 0] + IN_BASE[0]
    assert rows[0, 1] == pytest.approx(driven, abs=0.005)


@pytest.mark.parametrize(("replace", "asked"), [(True, 20), (False, 100)])
def test_clouds_are_made_of_the_newest_wrench_before_a_step_where_they_replace_earlier_ones(
    replace: bool, asked: int, tmp_path: Path
) -> None:
    wrist = {"wrist": {**WRIST, "replace": replace}}
    path = configured(tmp_path, generators=wrist, cycle={"every": 0.05})
    session = Session(setting_of_file(path), mcap(tmp_path, messages_of(tf=False)))
    found = [places_of(step) for step in session.steps()]
    assert session.pipeline.given["wrist"] == asked and len(found) == 20
    session.pipeline.conflates = False
    for newest, every in zip(found, [places_of(step) for step in session.steps()], strict=True):
        np.testing.assert_array_equal(newest, every)
    assert session.pipeline.given["wrist"] == 100


def test_a_bag_of_ros1_gives_the_same(tmp_path: Path) -> None:
    bags = ros1(tmp_path / "1", messages_of(tf=True)), mcap(tmp_path / "2", messages_of(tf=True))
    one, other = (contacts(bag.parent, bag, "run") for bag in bags)
    assert one == other


def test_a_mimic_joint_that_is_measured_is_where_it_is_measured(tmp_path: Path) -> None:
    bags = [mcap(tmp_path / str(mimic), messages_of(False, mimic)) for mimic in (False, True)]
    one, other = (contacts(bag.parent, bag, "run") for bag in bags)
    assert one == other


def test_a_sensor_that_no_transform_joins_is_refused_with_what_places_it(tmp_path: Path) -> None:
    said = [one for one in messages_of(tf=False) if one[0] != "/tf_static"]
    bag = mcap(tmp_path, said)
    with pytest.raises(ConfigurationError, match="unknown frame 'ft_sensor'.*`robot.frames` can"):
        contacts(tmp_path, bag, "run", generators={"wrist": WRIST})
    frames = {"ft_sensor": {"parent": "tool", "xyz": [0.03, 0.0, 0.0]}}
    robot = {"urdf": "gripper.urdf", "frames": frames}
    csv = contacts(tmp_path, bag, "replay", generators={"wrist": WRIST}, robot=robot)
    assert len(places(csv)) >= 100


def test_a_sensor_on_no_link_is_refused_with_what_places_it(tmp_path: Path) -> None:
    said = [one for one in messages_of(tf=False) if one[0] != "/tf_static"]
    bag = mcap(tmp_path, said)
    frames = {"ft_sensor": {"parent": "world"}, "footprint": {"parent": "world"}}
    with pytest.raises(
        ConfigurationError, match="no transform joins 'ft_sensor' to a link .*`robot.frames`"
    ):
        contacts(tmp_path, bag, "run", generators={"wrist": WRIST}, frames=frames)


def test_the_driver_of_a_mimic_joint_that_is_not_measured_is_named(tmp_path: Path) -> None:
    said = [one for one in messages_of(tf=False) if one[0] != "/joint_states"]
    bag = mcap(tmp_path, said)
    sentence = "'wrist' needs the surface of the robot: no position of joint 'shoulder' came"
    with pytest.raises(ConfigurationError, match=sentence):
        contacts(tmp_path, bag, "run", generators={"wrist": WRIST})
    robot = {"urdf": "gripper.urdf", "still": {"shoulder": 0.0}}
    sentence = "no position of joint 'finger' came, which 'thumb' mimics .*`robot.still`"
    with pytest.raises(ConfigurationError, match=sentence):
        contacts(tmp_path, bag, "replay", generators={"wrist": WRIST}, robot=robot)


def test_frames_that_no_unknown_joint_parts_are_known_without_joints(tmp_path: Path) -> None:
    configured(tmp_path)
    pipe = Pipeline(PipelineConfig(robot=RobotConfig(urdf=str(tmp_path / "gripper.urdf"))))
    state = pipe.state(0.0)
    np.testing.assert_allclose(state.frames.pose("footprint", of="base")[:3, 3], (0, 0, 0.3))
    np.testing.assert_allclose(state.frames.pose("arm", of="tool")[:3, 3], (0.42, 0, 0))
    with pytest.raises(FrameError, match="'tool' hangs under 'arm', 'base' under 'footprint'"):
        state.frames.pose("base", of="tool")
    shoulder = JointState(
        stamp=0.0, frame="base", names=("shoulder",), positions=np.array([np.pi / 2])
    )
    pipe.receive(shoulder)
    state = pipe.state(0.0)
    np.testing.assert_allclose(state.frames.pose("base", of="tool")[:3, 3], (0, 0.42, 0), atol=1e-9)
    assert state.robot is None and "'finger' came, which 'thumb' mimics" in state.unplaced


def begun_late(folder: Path) -> Path:
    """A bag of ROS 1 whose static publishers send at 10 Hz on /tf, first at 0.1 s."""
    said = [one for one in messages_of(tf=False) if one[0] != "/tf_static"]
    for number in range(1, 11):
        now = number * SECOND // 10
        said.append(("/tf", now, transforms((now, "map", "footprint"), x=2.0)))
        said.append(("/tf", now, transforms((now, "tool", "ft_sensor"), x=0.03)))
        said.append(("/tf", now, transforms((now, "base", "lens"), x=0.1)))
    return ros1(folder, sorted(said, key=lambda one: one[1]))


def test_the_viewer_begins_with_what_can_be_placed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun")
    from contactfusion.run.asking import Source
    from contactfusion.run.watching import view_recording
    from tests.test_view import Contents

    source = Source(begun_late(tmp_path), configured(tmp_path))
    view_recording(source, tmp_path / "late.rrd", screenshot=None, at=None, web=False)
    remarks = capsys.readouterr().out.splitlines()
    assert remarks[0] == (
        "'base' is drawn where it was in 'map' nearest in time from 0.001 to 0.091 s: the "
        "transform of 'footprint' in 'map' is not known at 0.001 s: there is one from 0.100 to "
        "1.000 s"
    )
    assert remarks[1].startswith(
        "Wrench of 'wrench' is not drawn from 0.001 to 0.091 s: the transform of 'ft_sensor' in "
        "'tool' is not known at 0.001 s"
    )
    assert remarks[2].startswith("PointCloud of 'points' is not drawn at 0.002 s: the transform")
    assert len(remarks) == 4 and remarks[3].startswith("results: ")
    seen = Contents(tmp_path / "late.rrd")
    finger = seen.rows("/world/robot/right", "Transform3D:translation")
    assert [stamp for stamp, _ in finger] == pytest.approx([0.001])  # it stands still
    np.testing.assert_allclose(finger[0][1], [[2.42, -0.025, 0.3]], atol=1e-6)
    wrenches = seen.rows("/world/sensors/wrench", "Transform3D:translation")
    assert wrenches[0][0] == pytest.approx(0.101)


def test_the_viewer_says_how_long_the_robot_had_no_place_in_the_space(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun")
    from contactfusion.run.asking import Source
    from contactfusion.run.watching import view_recording

    source = Source(begun_late(tmp_path), configured(tmp_path, integrator={"frame": "map"}))
    view_recording(source, tmp_path / "late.rrd", screenshot=None, at=None, web=False)
    remarks = capsys.readouterr().out.splitlines()
    assert remarks[0].startswith("the robot is not drawn from 0.001 to 0.091 s: no transform joins")
