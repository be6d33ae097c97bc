"""Scenes by YAML: a pipeline runs on simulated readings, and its contacts are held to the truth."""

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.errors import ConfigurationError
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.loop import Observer, play
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.robots.description import read_robot
from contactfusion.run.execute import run_file
from contactfusion.scene import open_scene
from contactfusion.yaml_files import read_yaml
from contactfusion_lab.scenes.touch.scene import compared
from contactfusion_lab.scenes.touch.world import Touching

ROOT = Path(__file__).parents[2]
SCENES = ROOT / "examples" / "scenes"
BOX = SCENES / "touch_box.yaml"
PANDA = SCENES / "panda_table.yaml"
NEAR = 0.03
"""A contact so near a true one has found it [m]."""


def summary_of(folder: Path) -> dict[str, Any]:
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return summary


def found(folder: Path) -> FloatArray:
    """Positions of the contacts of the last step that had any, shape (n, 3) [m]."""
    rows = list(csv.DictReader((folder / "contacts.csv").read_text().splitlines()))
    last = [row for row in rows if row["stamp"] == rows[-1]["stamp"]]
    return np.array([[float(row[axis]) for axis in "xyz"] for row in last])


def nearest(folder: Path) -> FloatArray:
    """Distance of the nearest contact from each true one, shape (n,) [m]."""
    places = np.array(summary_of(folder)["truth"]["places"])
    distances: FloatArray = np.linalg.norm(found(folder)[:, None] - places, axis=2)
    return np.asarray(distances.min(axis=0))


# What works


@pytest.mark.parametrize("name", ["touch_box", "touch_cylinder", "touch_sprayer", "panda_table"])
def test_an_example_finds_where_it_really_touches(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_file(SCENES / f"{name}.yaml", out=tmp_path)
    truth = summary_of(tmp_path)["truth"]
    assert len(truth["places"]) == len(truth["forces"]) == len(truth["links"]) > 0
    assert (nearest(tmp_path) < NEAR).all()
    output = capsys.readouterr().out
    assert f"truth: {truth['links'][0]} touched at (" in output
    assert f"; nearest contact {nearest(tmp_path)[0] * 1000:.0f} mm away" in output


def test_every_example_of_a_scene_is_tried() -> None:
    scenes = {path.stem for path in SCENES.glob("*.yaml") if "scene" in read_yaml(path)}
    assert scenes == {
        "grasp_bottle",
        "grasp_mug",
        "panda_table",
        "push_box",
        "push_chair",
        "push_five",
        "push_fused",
        "touch_box",
        "touch_cylinder",
        "touch_sprayer",
    }


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_robot_by_configuration_alone_finds_its_contact(seed: int, tmp_path: Path) -> None:
    run_file(PANDA, out=tmp_path, seed=seed)
    assert set(summary_of(tmp_path)["truth"]["links"]) <= {"panda_leftfinger", "panda_rightfinger"}
    assert (nearest(tmp_path) < NEAR).all()


def test_a_seed_rules_the_scene_and_the_same_gives_the_same(tmp_path: Path) -> None:
    run_file(BOX, out=tmp_path / "one", seed=7)
    run_file(BOX, out=tmp_path / "same", seed=7)
    run_file(BOX, overrides=["seed=7"], out=tmp_path / "by file")
    run_file(BOX, overrides=["seed=7"], out=tmp_path / "other", seed=8)
    for file in ("contacts.csv", "summary.json"):
        content = (tmp_path / "one" / file).read_bytes()
        assert content == (tmp_path / "same" / file).read_bytes()
        assert content == (tmp_path / "by file" / file).read_bytes()
        assert content != (tmp_path / "other" / file).read_bytes()


@pytest.mark.slow
def test_the_command_line_takes_a_seed(tmp_path: Path) -> None:
    code = "from contactfusion.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "run", str(PANDA), "--seed", "5", "--out", str(tmp_path)],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0 and "truth: panda_" in done.stdout
    run_file(PANDA, out=tmp_path / "again", seed=5)
    assert summary_of(tmp_path)["truth"] == summary_of(tmp_path / "again")["truth"]


def test_what_another_world_of_the_process_sets_changes_nothing(tmp_path: Path) -> None:
    """Bullet has one threshold for all worlds."""
    import pybullet

    other = {"physicsClientId": pybullet.connect(pybullet.DIRECT)}
    for breaking in (0.02, 0.002):
        pybullet.setPhysicsEngineParameter(contactBreakingThreshold=breaking, **other)
        run_file(PANDA, out=tmp_path / str(breaking), seed=5)
    pybullet.disconnect(**other)
    assert summary_of(tmp_path / "0.02")["truth"] == summary_of(tmp_path / "0.002")["truth"]


def test_a_hand_that_stops_short_touches_nothing_and_that_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_file(BOX, overrides=["scene.short=0.02"], out=tmp_path)
    assert summary_of(tmp_path)["truth"] == {
        "frame": "base",
        "places": [],
        "forces": [],
        "links": [],
    }
    assert "truth: no contact, and none was there\n" in capsys.readouterr().out


def test_the_truth_is_reported_in_the_frame_of_the_contacts(tmp_path: Path) -> None:
    run_file(BOX, out=tmp_path / "base")
    moved = "frames.base={parent: world, xyz: [1.0, 0.0, 0.0], rpy: [0.0, 0.0, 1.5707963267948966]}"
    run_file(BOX, overrides=["integrator.frame=world", moved], out=tmp_path / "world")
    (x, y, z), *_ = summary_of(tmp_path / "base")["truth"]["places"]
    truth = summary_of(tmp_path / "world")["truth"]
    assert truth["frame"] == "world"
    np.testing.assert_allclose(truth["places"][0], [1.0 - y, x, z], atol=1e-9)
    assert nearest(tmp_path / "world")[0] < NEAR


def test_a_copy_works_in_any_folder_with_meshes_of_its_own(tmp_path: Path) -> None:
    fields = read_yaml(BOX)
    corners = [f"v {x} {y} {z}" for x in (-0.04, 0.04) for y in (-0.07, 0.07) for z in (-0.1, 0.1)]
    faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    lines = [*corners, *(f"f {face[:5]}\nf {face[0]} {face[4:]}" for face in faces)]
    (tmp_path / "box.obj").write_text("\n".join(lines) + "\n")
    box = {"mesh": "box.obj", "pose": {"parent": "base", "xyz": [0.7, 0.0, 0.35]}}
    fields["scene"]["objects"] = fields["generators"]["believed"]["objects"] = {"box": box}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(fields))
    run_file(tmp_path / "scene.yaml", out=tmp_path / "out")
    assert (nearest(tmp_path / "out") < NEAR).all()


# Reports of the truth


def touched(*places: tuple[float, float, float]) -> Touching:
    given = np.reshape(places, (-1, 3))
    return Touching(given, np.zeros_like(given), ("tip",) * len(places))


def contact(*place: float) -> Contact:
    position, nowhere = np.array(place), np.zeros((3, 3))
    ends, force = np.zeros((2, 3)), np.zeros(3)
    return Contact(position, 0.9, nowhere, np.eye(3), ends, force, 1, {}, 0.0, "base")


@pytest.mark.parametrize(
    ("truth", "contacts", "sentences"),
    [
        (touched(), [], ["no contact, and none was there"]),
        (touched(), [contact(0, 0, 0)], ["nothing was touched; contacts that are none: 1"]),
        (
            touched((0.0, 0.0, 0.5)),
            [],
            ["tip touched at (0.000, 0.000, 0.500) m; no contact was found"],
        ),
        (
            touched((0.0, 0.0, 0.5), (1.0, 0.0, 0.5)),
            [contact(0.0, 0.004, 0.5), contact(1.0, 0.0, 0.0)],
            [
                "tip touched at (0.000, 0.000, 0.500) m; nearest contact 4 mm away",
                "tip touched at (1.000, 0.000, 0.500) m; nearest contact 500 mm away",
            ],
        ),
    ],
)
def test_the_truth_is_one_sentence_for_each_true_contact(
    truth: Touching, contacts: list[Contact], sentences: list[str]
) -> None:
    assert list(compared(truth, contacts)) == sentences


# What does not work


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (["recording={type: log, file: a.csv}"], "scene: give a recording or a scene, not both"),
        (["scene={}"], "recording: give a recording, or a scene"),
        (["robot=null"], "robot: a scene needs a robot by URDF"),
        (["robot=contactfusion.robts:arm_hand.yaml"], "robot: the Python package 'contactfusion.r"),
        (["scene.type=tuoch"], "scene.type: unknown type 'tuoch'; did you mean 'touch'? The types"),
        (["scene={tool: palm}"], "scene.type: this field is required; the types of scene are:"),
        (["scene.tol=palm"], "scene.tol: unknown field; did you mean 'tool'?"),
        (["scene.tool=plam"], "scene: …: unknown link 'plam': did you mean 'palm'?"),
        (["scene.noise=ful"], "scene.noise: unknown noise 'ful'; did you mean 'full'?"),
        (["scene.posture.arm_9=1.0"], "scene.posture.arm_9: unknown joint 'arm_9'"),
        (["seed=-1"], "seed: input should be greater than or equal to 0"),
    ],
)
def test_a_scene_that_is_wrong_is_one_sentence_that_names_the_field(
    changes: list[str], sentence: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        run_file(BOX, overrides=changes, out=tmp_path / "out")
    message = str(caught.value)
    begin, _, rest = sentence.partition("…")
    assert message.startswith(f"{BOX}: {begin}") and rest in message and "\n" not in message
    assert not (tmp_path / "out").exists()


def test_a_scene_can_be_opened_in_python() -> None:
    scene = read_yaml(PANDA)["scene"]
    robot, received = read_robot(SCENES / "panda.yaml"), list[Reading]()
    pipeline = Pipeline(
        PipelineConfig(robot=robot, integrator=IntegratorConfig(frame="panda_link0"))
    )
    opened = open_scene(scene, robot, seed=1)
    *_, last = play(pipeline, opened, [Observer(received.append)])
    assert last.stamp > 0.1 and last.stamp - received[-1].stamp < 0.02
    assert opened.verdict(pipeline, last).truth["places"]


# A base that pushes


def test_a_controller_pushes_in_a_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_file(
        SCENES / "push_box.yaml",
        overrides=["controller.target=[1,0]", "scene.target=[1,0]"],
        out=tmp_path,
    )
    truth = summary_of(tmp_path)["truth"]
    assert truth["success"] and truth["ending"] == "arrived" and truth["distance"] < 0.05
    assert "truth: arrived after" in capsys.readouterr().out
    commands = list(csv.DictReader((tmp_path / "commands.csv").read_text().splitlines()))
    assert [row["mode"] for row in commands][:: len(commands) - 1] == ["approach", "arrived"]
    assert commands[-1]["vx"] == "0" and "from the target" in commands[-1]["reason"]
    assert len(commands) == summary_of(tmp_path)["steps"]


@pytest.mark.parametrize("name", ["push_fused", "push_five"])
def test_several_sensors_push_together(name: str, tmp_path: Path) -> None:
    short = ["controller.target=[0.6,0.1]", "scene.target=[0.6,0.1]", "scene.yaw=0"]
    run_file(SCENES / f"{name}.yaml", overrides=short, out=tmp_path)
    assert summary_of(tmp_path)["truth"]["success"]
    sources = summary_of(tmp_path)["sources"]
    assert len(sources) == (5 if name == "push_five" else 4)
    assert all(each["accepted"] and not each["invalid"] for each in sources.values())


def test_the_same_seed_pushes_along_the_same_path(tmp_path: Path) -> None:
    def pushed(seed: int, name: str) -> bytes:
        near = ["controller.target=[0.4,0.1]", "scene.target=[0.4,0.1]", f"seed={seed}"]
        run_file(SCENES / "push_chair.yaml", overrides=near, out=tmp_path / name)
        return (tmp_path / name / "commands.csv").read_bytes()

    assert pushed(1, "one") == pushed(1, "again") != pushed(2, "other")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (["scene.target=[-0.3,0]"], "scene.target: the target (-0.3, 0.0) lies under the robot"),
        (["scene.target=[7,0]"], "scene.target: (7.0, 0.0) is out of reach"),
        (["scene.target=[.nan,0]"], "scene.target.0: input should be a finite number"),
        (["scene.object=bax"], "scene.object: unknown object 'bax'; did you mean 'box'?"),
        (["scene.friction=mu3"], "scene.friction: unknown friction 'mu3'; did you mean 'mu2'?"),
        (["scene.offset=0.6"], "scene.offset: the object starts out of sight"),
        (["scene.period=0.07"], "scene.period: the physics takes 240 steps a second"),
        (["controller={type: reactive_pushin}"], "there is no controller 'reactive_pushin'"),
        (["controller.parameters=tuend"], "controller.parameters: unknown set 'tuend'; did you"),
    ],
)
def test_a_push_that_is_wrong_is_one_sentence(
    changes: list[str], sentence: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        run_file(SCENES / "push_box.yaml", overrides=changes, out=tmp_path / "out")
    message = str(caught.value)
    assert message.startswith(f"{SCENES / 'push_box.yaml'}: {sentence}") and "\n" not in message
    assert not (tmp_path / "out").exists()


def test_controller_and_scene_have_one_target(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"pushes to \(2, 2\), but the scene's target is"):
        run_file(SCENES / "push_box.yaml", overrides=["controller.target=[2,2]"], out=tmp_path)


# What is not loaded


def test_a_recording_needs_no_physics(tmp_path: Path) -> None:
    (tmp_path / "wrist.csv").write_text("t,fx,fy,fz,tx,ty,tz\n0.0,0,0,-5,0,0,0\n")
    wrench = {"type": "wrench", "frame": "tool", "columns": ["fx", "fy", "fz", "tx", "ty", "tz"]}
    log = {"type": "log", "file": "wrist.csv", "time": {"column": "t"}}
    described = {
        "recording": {**log, "readings": {"wrist": wrench}},
        "generators": {"wrist": {"type": "force_torque", "sign": "on_robot"}},
        "surface": {"frame": "tool", "shapes": [{"shape": "sphere", "radius": 0.05}]},
        "integrator": {"frame": "tool"},
    }
    (tmp_path / "run.yaml").write_text(yaml.safe_dump(described))
    code = (
        "import sys; from pathlib import Path; from contactfusion.run.execute import run_file\n"
        "run_file(Path('run.yaml'), out=Path('out'))\n"
        "print({'pybullet', 'open3d', 'pinocchio'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "set()"
