"""What `contactfusion doctor ROBOT.yaml` tells of a robot and its wrists, and warns about."""

import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion import cli
from contactfusion.arrays import FloatArray
from contactfusion.doctor.robot import (
    camera_faults,
    check_robot,
    finger_faults,
    middle,
    patch_faults,
    recorded_wrenches,
    weigh,
    wrist_faults,
)
from contactfusion.errors import ConfigurationError, ContactFusionError
from contactfusion.identify.wrists import Sample, resting
from contactfusion.readings import Wrench
from contactfusion.robots.description import located
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from tests.urdfs import ARM_HAND, INERTIA, LIMIT, built, joint, link, real, written

SHIPPED = "contactfusion.robots:arm_hand.yaml"
GRID = {"rows": 2, "columns": 2, "pitch": (0.01, 0.01)}
TURN = np.pi
PLATE, BLOCK = '<box size="0.1 0.1 0.002"/>', '<box size="0.1 0.1 0.1"/>'
MASS, CENTRE = 1.5, np.array([0.01, -0.02, 0.06])
FORCE_BIAS, TORQUE_BIAS = np.array([3.0, -2.0, 7.0]), np.array([0.1, 0.2, -0.3])
NAMES = ("yaw", "pitch", "grip")
BOX = '<box size="0.1 0.1 0.1"/>'


def hand(folder: Path, *, shape: str = BLOCK, mass: float = 1.0, **fields: Any) -> RobotModel:
    """Build a base with a hand of one shape, centred at its link, on a hinge 0.5 m above."""
    return built(folder, *hand_links(shape, mass), **fields)


def hand_links(shape: str = BLOCK, mass: float = 1.0) -> tuple[str, ...]:
    return (
        link("base", BLOCK),
        link("hand", shape, mass=mass),
        joint("hinge", "base", "hand", xyz="0 0 0.5"),
    )


def patch(xyz: tuple[float, float, float], rpy: tuple[float, float, float]) -> dict[str, Any]:
    return {
        "frames": {"skin": {"parent": "hand", "xyz": xyz, "rpy": rpy}},
        "patches": {"skin": {"frame": "skin", "grid": GRID}},
    }


def camera(x: float, parent: str = "hand") -> dict[str, Any]:
    return {
        "frames": {"eye": {"parent": parent, "xyz": (x, 0.0, 0.0)}},
        "cameras": {"eye": {"frame": "eye", "width": 64, "height": 48, "fov": 60.0}},
    }


def at_middle(model: RobotModel) -> PosedRobot:
    return PosedRobot(model, middle(model), model.root, np.eye(4))


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What the command prints of the shipped robot, from another process; it draws it, too."""
    command = [sys.executable, "-c", "from contactfusion.cli import main; main()", "doctor"]
    folder = tmp_path_factory.mktemp("shipped")
    done = subprocess.run(
        [*command, SHIPPED, "--out", "arm.png"], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0 and done.stderr == ""
    assert (folder / "arm.png").read_bytes().startswith(b"\x89PNG")
    return done.stdout


# What it tells


def test_the_shipped_robot_has_nothing_to_warn_about(shipped: str) -> None:
    assert shipped.startswith(f"{located(SHIPPED)}: 19 links, 15 joints\n")
    assert shipped.endswith("picture: arm.png\nnothing to warn about\n")
    assert "warning" not in shipped


def test_every_link_is_told_with_its_mass_points_and_spheres(shipped: str) -> None:
    model = real(ARM_HAND)
    rows = {words[0]: words[1:] for line in shipped.splitlines() if len(words := line.split()) == 4}
    for number, name in enumerate(model.link_names):
        mass, points, spheres = rows[name]
        assert float(mass) == pytest.approx(model.urdf.links[name].mass, abs=1e-3)
        assert int(points) == len(model.parts[name].points)
        assert int(spheres) == np.sum(model.spheres.links == number)
    assert f"by {model.spheres.protrusion * 1000:.1f} mm at most" in shipped
    assert f"leave {model.spheres.gap * 1000:.1f} mm bare" in shipped


def test_every_joint_is_told_with_its_limits(shipped: str) -> None:
    for name, (low, high) in zip(real(ARM_HAND).joint_names, real(ARM_HAND).limits, strict=True):
        (line,) = [line for line in shipped.splitlines() if f"joint {name} " in line]
        assert f"{low:.3f} .. {high:.3f}" in line


def test_every_sensor_is_told_with_its_link_and_place(shipped: str) -> None:
    lines = [line.strip() for line in shipped.splitlines()]
    (wrist,) = [line for line in lines if line.startswith("wrist wrist:")]
    assert "on wrist_sensor at (0.000, 0.000, 1.265), 1.140 kg hang on it" in wrist
    assert "centre at (0.001, 0.000, 0.079) in its frame" in wrist
    (palm,) = [line for line in lines if line.startswith("patch palm:")]
    assert "on palm at (0.005, 0.000, 1.360), 16 taxels, z along (0.000, 0.000, 1.000)" in palm
    (eye,) = [line for line in lines if line.startswith("camera forehead:")]
    assert "on base at (-0.300, 0.000, 1.250), looks along (0.630, 0.000, -0.777)" in eye
    assert sum(line.startswith("patch tip_") for line in lines) == 3
    assert sum(line.startswith("finger finger_") for line in lines) == 3


def test_the_middle_of_limits_knows_wheels_and_what_is_still(tmp_path: Path) -> None:
    model = built(
        tmp_path,
        *map(link, "abcd"),
        joint("wheel", "a", "b", "continuous", ""),
        joint("hinge", "b", "c"),
        joint("stuck", "c", "d"),
        still={"stuck": 0.75},
    )
    assert middle(model).tolist() == [0.0, 0.5, 0.75]


def test_a_urdf_and_the_robot_of_a_configuration_are_looked_over_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path, link("a", BLOCK))
    (tmp_path / "robot.yaml").write_text("urdf: robot.urdf\n")
    (tmp_path / "named.yaml").write_text("robot: robot.yaml\nintegrator: {frame: a}\n")
    (tmp_path / "inline.yaml").write_text("robot: {urdf: robot.urdf}\n")
    for name in ("robot.urdf", "robot.yaml", "named.yaml", "inline.yaml"):
        assert check_robot(str(tmp_path / name))
        said = capsys.readouterr().out
        assert f"{name}: 1 links, 0 joints" in said and "middle of their limits" not in said
    (tmp_path / "inline.yaml").write_text("robot: {udf: robot.urdf}\n")
    with pytest.raises(ConfigurationError, match=r"inline.yaml: robot\.udf: unknown field"):
        check_robot(str(tmp_path / "inline.yaml"))


def test_a_joint_that_mimics_another_is_told_and_follows_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    follow = f'{LIMIT}<mimic joint="first" multiplier="-2"/>'
    robot = built(
        tmp_path,
        link("a", BLOCK),
        *map(link, "bc"),
        joint("first", "a", "b"),
        joint("second", "a", "c", inside=follow),
    )
    assert middle(robot).tolist() == [0.5, -1.0]
    (tmp_path / "robot.yaml").write_text("urdf: robot.urdf\n")
    assert check_robot(str(tmp_path / "robot.yaml"))
    assert "2.000 [rad], follows first: -2 times its position" in capsys.readouterr().out


def test_wheels_and_what_is_still_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(
        tmp_path,
        link("a", BLOCK),
        *map(link, "bcd"),
        joint("wheel", "a", "b", "continuous", ""),
        joint("stuck", "b", "c"),
        joint("slide", "c", "d", "prismatic", axis="1 2 0"),
    )
    (tmp_path / "robot.yaml").write_text("urdf: robot.urdf\nstill: {stuck: 0.75}\n")
    assert check_robot(str(tmp_path / "robot.yaml"))
    said = capsys.readouterr().out
    assert "joint wheel  without ends" in said
    assert "joint stuck  -1.000 .. 2.000 [rad], stays at 0.750" in said
    assert "joint slide  -1.000 .. 2.000 [m]" in said


# Patches


@pytest.mark.parametrize(
    ("xyz", "rpy", "fault"),
    [
        ((0.0, 0.0, 0.05), (0.0, 0.0, 0.0), ""),
        ((0.0, 0.0, 0.055), (0.3, 0.0, 2.0), ""),
        ((0.0, 0.0, 0.042), (0.0, 0.0, 0.0), ""),
        ((0.0, 0.0, -0.05), (TURN, 0.0, 0.0), ""),
        ((0.05, 0.0, 0.0), (0.0, TURN / 2, 0.0), ""),
        ((0.0, 0.0, 0.05), (TURN, 0.0, 0.0), "does not point out"),
        ((0.0, 0.0, 0.05), (TURN / 2, 0.0, 0.0), "does not point out"),
        ((0.05, 0.0, 0.0), (0.0, 0.0, 0.0), "does not point out"),
        ((0.0, 0.0, 0.065), (0.0, 0.0, 0.0), "lies 15 mm from the surface"),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "lies 45 mm from the surface"),
        ((0.06, 0.0, 0.05), (0.0, 0.0, 0.0), "lies 15 mm from the surface"),
    ],
)
def test_a_patch_lies_on_its_link_and_faces_out_of_it(
    xyz: Any, rpy: Any, fault: str, tmp_path: Path
) -> None:
    said = list(patch_faults(hand(tmp_path, **patch(xyz, rpy))))
    assert len(said) == bool(fault)
    assert all(fault in one and "'skin'" in one and "'hand'" in one for one in said), said


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_patch_on_a_thin_plate_may_face_out_of_either_side(side: float, tmp_path: Path) -> None:
    place = (0.0, 0.0, side * 0.001)
    model = hand(tmp_path, shape=PLATE, **patch(place, (0.0 if side > 0 else TURN, 0.0, 0.0)))
    assert not list(patch_faults(model))


def test_a_patch_on_a_coarse_surface_is_measured_to_the_surface_itself(tmp_path: Path) -> None:
    model = hand(tmp_path, spacing=0.05, **patch((0.0, 0.0, 0.05), (0.0, 0.0, 0.0)))
    assert not list(patch_faults(model))


def test_a_patch_around_a_corner_faces_out_with_most_of_it(tmp_path: Path) -> None:
    fields = patch((0.0, 0.0, 0.05), (0.0, 0.0, 0.0))
    over = {"places": [(0.0, 0.0, 0.0), (0.03, 0.0, 0.0), (0.05, 0.0, -0.03)], "size": (0.01, 0.01)}
    fields["patches"] = {"skin": {"frame": "skin", **over}}
    assert not list(patch_faults(hand(tmp_path, **fields)))


def test_a_patch_on_a_link_without_a_surface_is_told(tmp_path: Path) -> None:
    fields = patch((0.0, 0.0, 0.05), (0.0, 0.0, 0.0))
    (said,) = patch_faults(hand(tmp_path, links=("base",), **fields))
    assert said == "patch 'skin' is on link 'hand', which has no surface"


# Wrists, cameras, fingers


def test_a_link_with_a_shape_but_no_mass_on_a_wrist_is_told(tmp_path: Path) -> None:
    elements = [*hand_links(), link("nail", BLOCK), joint("n", "hand", "nail", "fixed", "")]
    wrists = {"wrist": {"frame": "hand", "sign": "on_robot"}}
    (said,) = wrist_faults(built(tmp_path, *elements, wrists=wrists))
    assert said == "link 'nail' hangs on wrist 'wrist' and has a shape, but no mass"


def test_what_does_not_hang_on_a_wrist_needs_no_mass(tmp_path: Path) -> None:
    wrists = {"wrist": {"frame": "hand", "sign": "on_robot"}}
    assert not list(wrist_faults(hand(tmp_path, wrists=wrists)))  # the base has none


def test_a_wrist_that_carries_nothing_is_told(tmp_path: Path) -> None:
    elements = [*hand_links(), link("end"), joint("e", "hand", "end", "fixed", "")]
    wrists = {"wrist": {"frame": "end", "sign": "on_robot"}}
    (said,) = wrist_faults(built(tmp_path, *elements, wrists=wrists))
    assert said == "nothing that hangs on wrist 'wrist' has a mass"


@pytest.mark.parametrize(
    ("x", "depth"), [(0.2, 0), (0.06, 0), (0.05, 0), (0.045, 0), (0.035, 15), (0.0, 50)]
)
def test_a_camera_deep_in_the_robot_is_told(x: float, depth: int, tmp_path: Path) -> None:
    said = list(camera_faults(at_middle(hand(tmp_path, **camera(x)))))
    assert said == ([f"camera 'eye' lies {depth} mm inside link 'hand'"] if depth else [])


def test_a_camera_inside_another_link_is_told_by_that_link(tmp_path: Path) -> None:
    fields = camera(0.0, "base")
    fields["frames"]["eye"]["xyz"] = (0.0, 0.0, 0.5)
    (said,) = camera_faults(at_middle(hand(tmp_path, **fields)))
    assert said == "camera 'eye' lies 50 mm inside link 'hand'"


def test_a_finger_whose_joints_do_not_move_it_is_told(tmp_path: Path) -> None:
    fingers = {"thumb": {"joints": ("hinge",), "links": ("hand", "base")}}
    (said,) = finger_faults(hand(tmp_path, fingers=fingers))
    assert said == "link 'base' of finger 'thumb' hangs on none of its joints"


# The command


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a robot whose patch looks the wrong way, and work in it."""
    written(tmp_path, *hand_links())
    fields = patch((0.0, 0.0, 0.05), (TURN, 0.0, 0.0))
    plain = yaml.safe_load(
        yaml.dump({"urdf": "robot.urdf", **fields}).replace("!!python/tuple", "")
    )
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(plain))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def ask(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str
) -> tuple[int, str, str]:
    """Call the command in this process: its status, and what it says."""
    monkeypatch.setattr(sys, "argv", ["contactfusion", "doctor", *arguments])
    capsys.readouterr()
    status: Any = 0
    try:
        cli.main()
    except SystemExit as end:
        status = end.code
    said = capsys.readouterr()
    return int(status or 0), said.out, said.err


def test_a_robot_with_a_fault_gives_status_one(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = ask(monkeypatch, capsys, "robot.yaml")
    assert (status, err) == (1, "")
    assert "warning: the z of patch 'skin' does not point out of link 'hand'\n" in out
    assert out.endswith("1 to put right\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["robto.yaml"], ["robto.yaml", "did you mean 'robot.yaml'"]),
        (["contactfusion.robots:arm_hnd.yaml"], ["did you mean 'arm_hand.yaml'"]),
        (["no_such_package:robot.yaml"], ["the Python package 'no_such_package' is not installed"]),
        (["broken.yaml"], ["broken.yaml", "patches.skin.frame", "did you mean 'hand'"]),
        (["robot.yaml", "--recording", "lgo.yaml"], ["did you mean 'log.yaml'"]),
        (["--out", "robot.png"], ["name the ROBOT.yaml"]),
        (["--recording", "log.yaml"], ["name the ROBOT.yaml"]),
        (["robot.yaml", "--out", "robot.urdf/a.png"], ["the folder robot.urdf cannot be made"]),
    ],
)
def test_what_cannot_be_used_is_one_sentence(
    arguments: list[str],
    words: list[str],
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    broken = (folder / "robot.yaml").read_text().replace("frame: skin", "frame: hnad")
    (folder / "broken.yaml").write_text(broken)
    (folder / "log.yaml").write_text("type: log\n")
    status, _, err = ask(monkeypatch, capsys, *arguments)
    (line,) = err.splitlines()
    assert status == 1 and line.startswith("contactfusion: ")
    assert all(word in line for word in words), line


def test_a_robot_that_cannot_be_touched_is_told(tmp_path: Path) -> None:
    written(tmp_path, link("base"))
    (tmp_path / "robot.yaml").write_text("urdf: robot.urdf\n")
    with pytest.raises(ContactFusionError, match="no link has a <collision> shape"):
        check_robot(str(tmp_path / "robot.yaml"))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    """Two turning links that carry a sensor, on whose flange sits a tool with a gripper."""
    return arm(tmp_path_factory.mktemp("arm"))


def arm(folder: Path, sign: str = "on_robot", **wrist: Any) -> RobotModel:
    return built(folder, *elements(), wrists={"wrist": {"frame": "flange", "sign": sign, **wrist}})


def elements() -> tuple[str, ...]:
    tool = (
        f'<link name="tool"><inertial><origin xyz="{" ".join(map(str, CENTRE))}"/>'
        f'<mass value="{MASS}"/>{INERTIA}</inertial></link>'
    )
    free = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
    return (
        link("base", BOX),
        link("turret"),
        link("flange"),
        tool,
        link("jaw"),
        joint("yaw", "base", "turret", inside=free, axis="0 0 1"),
        joint("pitch", "turret", "flange", inside=free, xyz="0 0 0.3", axis="0 1 0"),
        joint("screw", "flange", "tool", "fixed", ""),
        joint("grip", "tool", "jaw", axis="1 0 0"),
    )


def gravity_at(pitch: float) -> FloatArray:
    """Gravity in the flange, by hand: it turns about y only, as a yaw leaves gravity alone."""
    return 9.81 * np.array([np.sin(pitch), 0.0, -np.cos(pitch)])


def wrench_at(pitch: float) -> FloatArray:
    """What the tool does to the sensor's robot side without contact."""
    weight = MASS * gravity_at(pitch)
    return np.concatenate([weight + FORCE_BIAS, np.cross(CENTRE, weight) + TORQUE_BIAS])


PITCHES = (-2.5, -1.2, -0.4, 0.3, 1.1, 2.0, 2.9)


def sample(stamp: float, pitch: float, *, factor: float = 1.0, noise: Any = 0.0) -> Sample:
    wrench = factor * wrench_at(pitch) + noise
    reading = Wrench(
        stamp=stamp, frame="flange", sensor="wrist", force=wrench[:3], torque=wrench[3:]
    )
    return Sample(reading, np.array([0.2, pitch, 0.1]))


def rows(factor: float = 1.0, pitches: Sequence[float] = PITCHES) -> list[Sample]:
    """One row a pose, a second apart."""
    return [sample(float(n), pitch, factor=factor) for n, pitch in enumerate(pitches)]


def told(
    model: RobotModel, samples: Sequence[Sample], sensor: str = "wrist"
) -> tuple[str, list[str]]:
    lines, wrong = weigh(model, "wrist", {sensor: samples})
    return "\n".join(lines), wrong


# What gravity tells


@pytest.mark.parametrize("described", ["on_robot", "by_robot"])
@pytest.mark.parametrize(("true", "factor"), [("on_robot", 1.0), ("by_robot", -1.0)])
def test_gravity_tells_the_sign(true: str, factor: float, described: str, tmp_path: Path) -> None:
    said, wrong = told(arm(tmp_path, described), rows(factor))
    assert f"gravity says sign {true}" in said
    assert bool(wrong) == (true != described)
    if wrong:
        assert wrong == [
            f"wrist 'wrist': gravity says sign {true}, the description says {described}"
        ]


@pytest.mark.parametrize("factor", [1.0, -1.0])
def test_a_load_that_is_as_described_is_found_so(model: RobotModel, factor: float) -> None:
    said, _ = told(model, rows(factor))
    assert "wrist 'wrist' in 7 poses at rest" in said
    assert "mass 1.500 kg, by the URDF 1.500 kg" in said
    assert "(10.0, -20.0, 60.0) mm, by the URDF (10.0, -20.0, 60.0) mm: 0.0 mm apart" in said


def test_the_fit_can_be_copied_into_a_configuration(model: RobotModel) -> None:
    said, _ = told(model, rows())
    fields = yaml.safe_load(said.splitlines()[-1])["compensation"]
    assert fields["mass"] == pytest.approx(MASS)
    assert fields["centre_of_mass"] == pytest.approx(CENTRE)
    assert fields["force_bias"] == pytest.approx(FORCE_BIAS)
    assert fields["torque_bias"] == pytest.approx(TORQUE_BIAS)


def test_a_tool_that_the_urdf_does_not_know_is_seen(model: RobotModel) -> None:
    heavier = [
        Sample(
            Wrench(
                stamp=one.reading.stamp,
                frame="flange",
                sensor="wrist",
                force=one.reading.force + 0.5 * gravity_at(one.positions[1]),
                torque=one.reading.torque,
            ),
            one.positions,
        )
        for one in rows()
    ]
    said, wrong = told(model, heavier)
    assert "mass 2.000 kg, by the URDF 1.500 kg" in said and not wrong


def test_noise_is_averaged_over_a_pose(model: RobotModel) -> None:
    rng = np.random.default_rng(0)
    samples = [
        sample(2.0 * n + 0.01 * k, pitch, noise=rng.normal(0, [0.3] * 3 + [0.02] * 3))
        for n, pitch in enumerate(PITCHES)
        for k in range(100)
    ]
    said, wrong = told(model, samples)
    assert "wrist 'wrist' in 7 poses at rest: gravity says sign on_robot" in said and not wrong
    mass = float(said.split("mass ")[1].split()[0])
    assert mass == pytest.approx(MASS, abs=0.02)


# What it cannot tell


@pytest.mark.parametrize(
    ("pitches", "words"),
    [
        ([0.3], "rested in 0 poses; 3 that are turned far from each other"),
        ([0.3, 0.3], "rested in 1 poses"),
        ([0.3, 2.0], "rested in 2 poses"),
        ([0.3, 0.32, 0.31, 0.33], "do not separate weight and bias; turn the sensor further"),
    ],
)
def test_poses_that_do_not_tell_are_told_in_one_sentence(
    pitches: list[float], words: str, model: RobotModel
) -> None:
    said, (wrong,) = told(model, rows(pitches=pitches))
    assert not said and wrong.startswith("wrist 'wrist'") and words in wrong


def test_a_wrist_that_never_rests_is_told(model: RobotModel) -> None:
    moving = [sample(0.01 * n, 0.02 * n) for n in range(150)]
    said, (wrong,) = told(model, moving)
    assert not said and "rested in 0 poses" in wrong


def test_a_turned_frame_is_not_taken_for_a_sign(model: RobotModel) -> None:
    turned = [
        Sample(
            Wrench(
                stamp=one.reading.stamp,
                frame="flange",
                sensor="wrist",
                force=one.reading.force[[2, 1, 0]],
                torque=one.reading.torque[[2, 1, 0]],
            ),
            one.positions,
        )
        for one in rows()
    ]
    said, (wrong,) = told(model, turned)
    assert not said and "neither sign explains its wrenches" in wrong
    assert "is its frame turned" in wrong


def test_noise_without_a_load_tells_no_sign(model: RobotModel) -> None:
    rng = np.random.default_rng(1)
    noise = [
        Sample(
            Wrench(
                stamp=float(n),
                frame="flange",
                sensor="wrist",
                force=rng.normal(0, 0.3, 3),
                torque=rng.normal(0, 0.02, 3),
            ),
            np.array([0.0, pitch, 0.0]),
        )
        for n, pitch in enumerate(PITCHES)
    ]
    said, (wrong,) = told(model, noise)
    assert not said and "neither sign explains its wrenches" in wrong


def test_a_wrist_that_is_not_in_the_recording_is_told_with_the_nearest(model: RobotModel) -> None:
    _, (wrong,) = told(model, rows(), sensor="wirst")
    assert wrong.startswith("no wrench of wrist 'wrist' came: did you mean 'wirst'?")


def test_wrenches_in_another_frame_than_the_description_says_are_told(tmp_path: Path) -> None:
    _, (wrong,) = told(arm(tmp_path, frame="tool"), rows())
    assert wrong == "wrist 'wrist' is in 'tool', but its wrenches come in 'flange'"


# Poses at rest


def test_a_pose_is_at_rest_when_it_lasts_or_stands_alone() -> None:
    dense = [sample(0.01 * n, 0.3) for n in range(30)]  # 0.3 s at rest
    away = [sample(0.3 + 0.01 * n, 0.3 + 0.02 * n) for n in range(1, 50)]  # then it moves
    rest = [sample(0.8 + 0.01 * n, 1.3) for n in range(50)]
    alone = [sample(3.0, 2.0), sample(5.0, 2.5)]
    poses = resting([*dense, *away, *rest, *alone])
    assert [round(positions[1], 6) for positions, *_ in poses] == [0.3, 1.3, 2.0, 2.5]


def test_a_pose_is_the_mean_of_its_wrenches() -> None:
    noise = np.arange(30.0)[:, None] - 14.5
    (pose,) = resting([sample(0.01 * n, 0.3, noise=one) for n, one in enumerate(noise)])
    assert np.allclose(pose.wrench, wrench_at(0.3))


def test_nothing_at_all_has_no_poses() -> None:
    assert resting([]) == []


# Recordings


JOINTS = {"type": "joint_state", "frame": "base", "columns": list(NAMES), "names": list(NAMES)}
WRENCH = {"type": "wrench", "frame": "flange", "columns": ["fx", "fy", "fz", "tx", "ty", "tz"]}


def logged(
    folder: Path, samples: Sequence[Sample], readings: Mapping[str, Any] | None = None
) -> Path:
    """Write a recording of joints and wrenches: a log, and what is in it."""
    header = ["t", *NAMES, *WRENCH["columns"]]
    table = [
        [one.reading.stamp, *one.positions, *one.reading.force, *one.reading.torque]
        for one in samples
    ]
    np.savetxt(folder / "log.csv", table, delimiter=",", header=",".join(header), comments="")
    description = {
        "type": "log",
        "file": "log.csv",
        "time": {"column": "t"},
        "readings": readings or {"joints": JOINTS, "wrist": WRENCH},
    }
    (folder / "log.yaml").write_text(yaml.safe_dump(description))
    return folder / "log.yaml"


@pytest.mark.parametrize(("sign", "status"), [("by_robot", 0), ("on_robot", 1)])
def test_the_command_weighs_what_hangs_on_the_wrist(
    sign: str,
    status: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    recording = logged(tmp_path, rows(-1.0))
    arm(tmp_path)
    description = {"urdf": "robot.urdf", "wrists": {"wrist": {"frame": "flange", "sign": sign}}}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(description))
    arguments = ["doctor", str(tmp_path / "robot.yaml"), "--recording", str(recording)]
    monkeypatch.setattr(sys, "argv", ["contactfusion", *arguments])
    with pytest.raises(SystemExit) as end:
        cli.main()
    said = capsys.readouterr()
    assert (end.value.code or 0) == status and not said.err
    assert "gravity says sign by_robot" in said.out and "mass 1.500 kg" in said.out
    assert said.out.count("warning: ") == status


def test_wrenches_before_the_first_joints_are_left_out(tmp_path: Path, model: RobotModel) -> None:
    late = {**JOINTS, "columns": ["late", *NAMES[1:]]}
    path = logged(tmp_path, rows(), {"joints": late, "wrist": WRENCH})
    text = (tmp_path / "log.csv").read_text().splitlines()
    empty = [",".join(["0.0", "", *line.split(",")[2:]]) for line in text[1:2]]
    (tmp_path / "log.csv").write_text(
        "\n".join([text[0].replace("yaw", "late"), *empty, *text[2:]]) + "\n"
    )
    assert len(recorded_wrenches(model, path)["wrist"]) == len(PITCHES) - 1


@pytest.mark.parametrize(
    ("readings", "words"),
    [
        ({"joints": JOINTS}, "holds no wrench"),
        ({"wrist": WRENCH}, "no position of joint 'yaw' came (and 2 more)"),
        (
            {"joints": {**JOINTS, "names": ["jaw", "pitch", "grip"]}, "wrist": WRENCH},
            "no position of joint 'yaw' came: did you mean 'jaw'?",
        ),
    ],
)
def test_a_recording_that_does_not_fit_is_one_sentence(
    readings: dict[str, Any], words: str, tmp_path: Path, model: RobotModel
) -> None:
    path = logged(tmp_path, rows(), readings)
    with pytest.raises(ContactFusionError) as caught:
        recorded_wrenches(model, path)
    assert "log.yaml" in str(caught.value) and words in str(caught.value)
