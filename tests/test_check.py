"""`contactfusion check`: everything is built, the beginning is played, every fault is told."""

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion import cli
from contactfusion.check import check_file
from contactfusion.errors import ConfigurationError
from contactfusion.run.summary import NO_EVIDENCE
from contactfusion.yaml_files import read_yaml
from tests.urdfs import joint, link, written

BALL = '<sphere radius="0.05"/>'
WRENCH = {"type": "wrench", "frame": "tool", "columns": ["fx", "fy", "fz", "tx", "ty", "tz"]}
CONFIGURATION: dict[str, Any] = {
    "recording": {
        "type": "log",
        "file": "log.csv",
        "time": {"column": "t"},
        "readings": {
            "wrist": WRENCH,
            "palm": {"type": "tactile_image", "frame": "tool", "columns": ["p0", "p1"]},
        },
    },
    "generators": {
        "wrist": {"type": "force_torque", "sensor": "wrist", "sign": "on_robot"},
        "palm": {
            "type": "tactile",
            "sensor": "palm",
            "patch": {"grid": {"rows": 1, "columns": 2, "pitch": [0.01, 0.01]}},
        },
    },
    "surface": {"frame": "tool", "shapes": [{"shape": "rectangle", "size": [0.2, 0.2]}]},
    "frames": {"tool": {"parent": "base", "xyz": [0.0, 0.0, 0.5]}},
    "cycle": {"on": "wrist"},
    "faults": [{"fault": "silent", "sensor": "palm"}],
}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    rows = "".join(f"{n / 100:.2f},0,0,-5,0,0,0,0,9\n" for n in range(20))
    (tmp_path / "log.csv").write_text("t,fx,fy,fz,tx,ty,tz,p0,p1\n" + rows)
    path = tmp_path / "pipeline.yaml"
    path.write_text(yaml.safe_dump(CONFIGURATION, sort_keys=False))
    return path


def faults(file: Path, *overrides: str, recording: Path | None = None) -> list[str]:
    """The faults, without the name of the file that each begins with."""
    found = check_file(file, recording, overrides)
    assert bool(found.lines) != bool(found.faults)
    assert all(fault.startswith(f"{file}: ") and "\n" not in fault for fault in found.faults)
    return [fault.removeprefix(f"{file}: ") for fault in found.faults]


def test_a_sound_configuration_is_reported_line_by_line(file: Path) -> None:
    found = check_file(file)
    assert found.faults == ()
    assert found.lines == (
        "frame 'base', voxels of 5 mm; rule sets, condensation members; "
        "a step after each reading of 'wrist'",
        "frame 'tool' in 'base' at (0.0, 0.0, 0.5) m",
        "generator 'wrist' (force_torque): Wrench of 'wrist' -> 'wrist' (regular)",
        "generator 'palm' (tactile): TactileImage of 'palm' -> 'palm' (regular)",
        "surface: 2500 points in 'tool', x -0.098..0.098, y -0.098..0.098, z 0.000..0.000 m",
        "fault silent of palm",
        "recording: 'wrist' (Wrench), 'palm' (TactileImage)",
        "estimate: 2500 points of surface over 1600 voxels, about 620 kB",
        "estimate: clouds of 'palm' hold up to 8 hypotheses, about 2.8 kB",
    )


def test_a_pipeline_that_can_never_find_a_contact_is_told_so(file: Path) -> None:
    fields = yaml.safe_load(file.read_text())
    fields["generators"] = {"camera": {"type": "free_space", "sensor": "depth"}}
    fields |= {"faults": [], "cycle": {"every": 0.1}}
    lone = file.with_name("lone.yaml")
    del fields["recording"]
    lone.write_text(yaml.safe_dump(fields))
    assert NO_EVIDENCE in check_file(lone).lines
    assert NO_EVIDENCE not in check_file(file).lines


def test_the_extent_of_the_surface_shows_where_its_shapes_lie(file: Path) -> None:
    probe = "{shape: cylinder, radius: 0.02, length: 0.24, xyz: [0, 0, 0.15]}"
    lines = check_file(file, None, [f"surface.shapes=[{probe}]"]).lines
    (surface,) = (line for line in lines if line.startswith("surface: "))
    assert surface.endswith(" points in 'tool', x -0.020..0.020, y -0.020..0.020, z 0.030..0.270 m")


def test_every_fault_is_told_not_only_the_first(file: Path) -> None:
    told = faults(
        file,
        "integrator.voxel_size=5",
        "frames.tool.rpy=[0, 0, 90]",
        "generators.wrist.nois=3",
        "generators.palm.patch.grid.pitch=[10, 10]",
        "cycle.on=wrst",
        "faults.0.sensor=plam",
        "controller.type=reactive_pushng",
    )
    assert [fault.partition(": ")[0] for fault in told] == [
        "integrator.voxel_size",
        "frames.tool.rpy.2",
        "controller",
        "generators.wrist.nois",
        "generators.palm.patch.grid.pitch.0",
        "generators.palm.patch.grid.pitch.1",
        "cycle.on",
        "faults.0.sensor",
    ]
    assert "did you mean 'reactive_pushing'" in told[2]
    assert "did you mean 'wrist'?" in told[-2] and "did you mean 'palm'?" in told[-1]


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("generators.palm.type=tactle", "generators.palm: there is no generator 'tactle'; did you"),
        ("generators.palm.sensor=plam", "faults.0.sensor: the recording holds no 'palm'; did you "),
        ("generators.eye={type: free_space}", "generators.eye: the recording holds no DepthImage"),
        ("integrator.rule=de_morgn", "there is no rule 'de_morgn'; did you mean 'de_morgan'?"),
        ("surface.file=a.npz", "surface: give shapes or a file"),
        ("frames.base={parent: tool}", "the frames form a circle"),
        ("recording.file=lgo.csv", "recording: "),
        ("recording.tpye=log", "recording.tpye: unknown field; the fields are: delimiter"),
        ("recording.time.unit=ms", "recording: "),
        ("scene={type: touch}", "scene: give a recording or a scene, not both"),
        ("generators.palm.isolate=3", "generators.palm.isolate: input should be a valid boolean"),
    ],
)
def test_a_single_fault_is_one_sentence(file: Path, override: str, sentence: str) -> None:
    (told,) = faults(file, override)
    assert told.startswith(sentence) or sentence in told


def test_voxels_too_small_for_any_robot_are_a_fault(file: Path) -> None:
    (told, *_) = faults(file, "integrator.voxel_size=1.0e-300")
    assert told.startswith(
        "integrator.voxel_size: 1e-300 m is implausible, the limit is 1e-05 m; lengths are in"
    )


def test_a_pipeline_alone_can_be_checked(file: Path) -> None:
    del (fields := read_yaml(file))["recording"]
    file.write_text(yaml.safe_dump(fields))
    assert faults(file) == []


def test_what_is_no_yaml_is_one_sentence(file: Path) -> None:
    file.write_text("generators: [")
    with pytest.raises(ConfigurationError, match=r"pipeline.yaml, line 1, column"):
        check_file(file)


# A recording beside it, as for a replay


def described(file: Path, **readings: Any) -> Path:
    path = file.parent / "log.yaml"
    path.write_text(yaml.safe_dump({**CONFIGURATION["recording"], "readings": readings}))
    return path


def test_the_topics_of_a_recording_are_matched_as_a_replay_does(file: Path) -> None:
    palm = CONFIGURATION["recording"]["readings"]["palm"]
    recording = described(file, hand_ft=WRENCH, palm=palm)
    found = check_file(file, recording)
    assert found.faults == ()
    assert "recording: 'wrist' (Wrench), 'palm' (TactileImage)" in found.lines


def test_what_a_recording_lacks_is_told(file: Path) -> None:
    told = faults(file, recording=described(file, wrist=WRENCH))
    assert told == [
        "generators.palm: the recording holds no TactileImage",
        "faults.0.sensor: the recording holds no 'palm'; the sensors and types are: wrench, wrist",
    ]
    (lost,) = faults(file, recording=file.parent / "lost.mcap")
    assert "lost.mcap" in lost


# Frames that nothing joins to the space


NO_FRAMES = (
    "unknown frame 'tool': there are no frames; `frames` or a `robot` can place it in the "
    "integrator's frame 'base' (default of `integrator.frame`)"
)


def test_a_sensor_of_a_log_that_nothing_places_is_told(file: Path) -> None:
    of = ("surface.frame", "generators.wrist", "generators.palm")
    assert faults(file, "frames={}") == [f"{field}: {NO_FRAMES}" for field in of]
    told = faults(file, "frames={tol: {parent: base}}")
    assert [fault.partition(": ")[0] for fault in told] == [*of]
    assert "unknown frame 'tool': did you mean 'tol'?" in told[0]
    told = faults(file, "frames.tool.parent=bse")
    assert "nothing joins 'tool' to the integrator's frame 'base' (default of" in told[0]


def test_a_log_beside_the_configuration_is_no_different(file: Path) -> None:
    readings = CONFIGURATION["recording"]["readings"]
    told = faults(file, "frames={}", recording=described(file, **readings))
    assert told == faults(file, "frames={}") and len(told) == 3


def test_a_surface_that_nothing_places_is_told_where_a_generator_needs_it(file: Path) -> None:
    (told,) = faults(file, "surface.frame=tol")
    assert told.startswith("surface.frame: unknown frame 'tol': did you mean 'tool'?")
    (isolated,) = faults(file, "surface.frame=tol", "generators.wrist.isolate=true")
    assert isolated == told
    skin_alone = "generators={palm: {type: tactile, patch: {places: [[0, 0, 0]], size: [1, 1]}}}"
    assert faults(file, "surface.frame=tol", skin_alone, "cycle={every: 0.1}") == []


def test_of_several_sensors_that_a_generator_could_take_one_is_asked_for(file: Path) -> None:
    palm = {**CONFIGURATION["recording"]["readings"]["palm"], "columns": ["p0"]}
    patch = "generators={skin: {type: tactile, patch: {places: [[0, 0, 0]], size: [1, 1]}}}"
    fields = read_yaml(file)
    fields["recording"]["readings"] = {"lost": {**palm, "frame": "moon"}, "palm": palm}
    file.write_text(yaml.safe_dump(fields))
    (told,) = faults(file, patch, "cycle={every: 0.1}")
    assert told.endswith("several topics hold it: /lost, /palm; choose one: --topic skin=/lost")
    (told,) = faults(file, patch, "cycle={every: 0.1}", "generators.skin.sensor=lost", "faults=[]")
    assert told.startswith("generators.skin: unknown frame 'moon'")


def bag(folder: Path, without: str = "", joint_name: str = "turn") -> Path:
    """A recording of ROS of an arm that presses, of which one topic is left out."""
    pytest.importorskip("rosbags")
    from tests.first_bags import pressed
    from tests.ros_bags import joints, mcap

    named = joints(0, name=[joint_name], position=np.array([0.1]))
    said = [
        (topic, stamp, named if topic == "/joint_states" else one)
        for topic, stamp, one in pressed(seconds=0.2)
        if topic != without
    ]
    return mcap(folder / f"bag{without.replace('/', '_')}", said)


def pressing(file: Path, **fields: Any) -> Path:
    """A configuration for a replay of a bag of an arm that presses."""
    body = {"frame": "base", "shapes": CONFIGURATION["surface"]["shapes"]}
    wrist = {"type": "force_torque", "sign": "on_robot"}
    file.write_text(yaml.safe_dump({"surface": body, **fields, "generators": {"wrist": wrist}}))
    return file


def test_transforms_of_a_bag_place_its_sensors(file: Path) -> None:
    assert faults(pressing(file)) == []  # without a bag it is not known what places them
    assert faults(file, recording=bag(file.parent)) == []
    bare = bag(file.parent, without="/tf_static")
    fault = "generators.wrist: " + NO_FRAMES.replace("tool", "ft")
    assert faults(file, recording=bare) == [fault]
    assert faults(file, f"recording={{type: ros, file: {bare}}}") == [fault]
    told = faults(file, "integrator.frame=map", recording=bag(file.parent / "again"))
    assert [fault.partition(":")[0] for fault in told] == ["surface.frame", "generators.wrist"]
    space = "the integrator's frame 'map' (`integrator.frame`), which is unknown: the frames are: "
    assert f"nothing joins 'ft' to {space}" in told[1]


def test_joints_of_another_robot_than_the_recording_reports_are_told(file: Path) -> None:
    from tests.first_bags import arm

    pressing(file, robot={"urdf": str(arm(file.parent))}, surface=None)
    assert faults(file, recording=bag(file.parent)) == []
    told = faults(file, recording=bag(file.parent / "other", joint_name="panda_joint1"))
    assert told[0] == (
        "robot: no position of joint 'turn' came: the joints of the reading are: panda_joint1; "
        "one that nothing measures is placed by `robot.still`"
    )
    silent = bag(file.parent, without="/joint_states")
    assert "no position of joint 'turn' came: no reading" in faults(file, recording=silent)[0]
    assert faults(file, "robot.still.turn=0.1", recording=silent) == []


@pytest.mark.parametrize("stamps", [(0.25,), (0.05, 0.25)], ids=["late", "around the first"])
def test_transforms_need_not_come_with_the_first_reading(
    stamps: tuple[float, ...], file: Path
) -> None:
    pytest.importorskip("rosbags")
    from tests.first_bags import pressed
    from tests.ros_bags import SECOND, mcap, transforms

    said = [one for one in pressed(seconds=0.3) if one[0] == "/ft/wrench" and one[1] > SECOND // 10]
    for stamp in (int(stamp * SECOND) for stamp in stamps):
        said.append(("/tf", stamp, transforms((stamp, "base", "ft"))))
    recording = mcap(file.parent, sorted(said, key=lambda one: one[1]))
    assert faults(pressing(file), recording=recording) == []


def test_a_topic_or_a_cycle_that_the_recording_lacks_is_told(file: Path) -> None:
    recording = bag(file.parent)
    (told,) = check_file(pressing(file), recording, topics={"wrist": "/ft/wrnch"}).faults
    assert "no readings come of '/ft/wrnch'; did you mean '/ft/wrench'?" in told
    (told,) = faults(file, "cycle={on: ft/wrnch}", recording=recording)
    assert told.startswith("cycle.on: the recording holds no 'ft/wrnch'; ")
    sensors = f"recording={{type: ros, file: {recording}, sensors: {{wrist: /ft/wrnch}}}}"
    (told,) = faults(file, sensors)
    assert told.startswith("recording: ") and "did you mean '/ft/wrench'?" in told


# Robots


def on_arm(file: Path, **robot: Any) -> Path:
    """A file for the pipeline of a robot with one joint, and a patch on it that has a name."""
    urdf = written(file.parent, link("base", BALL), link("arm", BALL), joint("turn", "base", "arm"))
    patch = {**CONFIGURATION["generators"]["palm"]["patch"], "frame": "arm"}
    fields = {
        "robot": {"urdf": str(urdf), "patches": {"pad": patch}, **robot},
        "generators": {"palm": {"type": "tactile", "patch": "pad"}},
    }
    file.write_text(yaml.safe_dump(fields))
    return file


def test_a_robot_is_built_and_its_surface_sampled(file: Path) -> None:
    found = check_file(on_arm(file, still={"turn": 1.0}))
    assert found.faults == ()
    (robot,) = (line for line in found.lines if line.startswith("robot "))
    assert "root 'base', 2 links, 1 joints, " in robot and robot.endswith(" points of surface")


def test_a_faulty_robot_is_told_once_and_what_names_it_is_not_blamed(file: Path) -> None:
    (told,) = faults(on_arm(file, spacing=4))
    assert told.startswith("robot.spacing: 4 m is implausible, the limit is 1 m; ")
    (told,) = faults(on_arm(file, links=["amr"]))
    assert told.startswith("robot.links: unknown link 'amr': did you mean 'arm'?")


def test_the_faults_of_a_file_of_a_robot_are_told_one_by_one(file: Path) -> None:
    robot = file.parent / "arm.yaml"
    robot.write_text("urdf: arm.urdf\nspacing: 4\nlnks: []\n")
    told = faults(file, "surface=null", "robot=arm.yaml", "integrator.voxel_size=5")
    assert [fault.partition(" m ")[0].partition(";")[0] for fault in told] == [
        f"robot: {robot}: lnks: unknown field",
        f"robot: {robot}: spacing: 4",
        "integrator.voxel_size: 5",
    ]


def test_a_joint_that_stands_still_in_degrees_is_told(file: Path) -> None:
    assert faults(on_arm(file, still={"turn": 90})) == [
        "robot.still.turn: 90 lies beyond the joint's limits, -1.000 .. 2.000 [rad, m]"
    ]


# The command


def ask(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["contactfusion", "check", *arguments])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert isinstance(end.value.code, int)
    return end.value.code


def test_the_command_ends_with_ok(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ask(monkeypatch, str(file)) == 0
    said = capsys.readouterr()
    assert said.out.splitlines()[-1] == "OK" and said.err == ""
    assert {path.name for path in file.parent.iterdir()} == {"log.csv", "pipeline.yaml"}


def test_the_command_tells_each_fault_in_a_line_of_its_own(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = ("--set", "integrator.voxel_size=5", "--set", "cycle={every: 10}")
    assert ask(monkeypatch, str(file), *changes) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines() == [
        f"contactfusion: {file}: integrator.voxel_size: 5 m is implausible, the limit is 1 m; "
        "lengths are in metres: did you mean 0.005?",
        f"contactfusion: {file}: cycle.every: 10 s is implausible, the limit is 5 s; "
        "times are in seconds: did you mean 0.01?",
    ]


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ("surface=null", "every cloud of 'wrist' was refused: .* needs the surface of the robot"),
        ("generators.wrist.load=robot", "every cloud of 'wrist' was refused: .* needs the robot"),
        ("faults=[{fault: bias, sensor: wrist, amount: 1}]", "faults.0.amount: .* takes 6 numbers"),
        ("generators={}", "generators: none are configured, so nothing can be found"),
        ('generators={"": {type: force_torque, sign: on_robot}}', "generators.: a generator needs"),
    ],
)
def test_what_shows_at_the_first_reading_is_told(change: str, fault: str, file: Path) -> None:
    (told,) = faults(file, change)
    assert re.match(fault, told)
