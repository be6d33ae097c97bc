"""Gravity tells the sign of a wrist, and weighs what it carries."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion import cli
from contactfusion.arrays import FloatArray
from contactfusion.errors import ContactFusionError
from contactfusion.readings import Wrench
from contactfusion.robots.model import RobotModel
from contactfusion.robots.weighing import Sample, heard, resting, weigh
from tests.urdfs import INERTIA, built, joint, link

MASS, CENTRE = 1.5, np.array([0.01, -0.02, 0.06])
FORCE_BIAS, TORQUE_BIAS = np.array([3.0, -2.0, 7.0]), np.array([0.1, 0.2, -0.3])
NAMES = ("yaw", "pitch", "grip")
BOX = '<box size="0.1 0.1 0.1"/>'


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
        ([0.3, 0.32, 0.31, 0.33], "do not tell weight and bias apart; turn the sensor further"),
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
    assert [round(positions[1], 6) for positions, _ in poses] == [0.3, 1.3, 2.0, 2.5]


def test_a_pose_is_the_mean_of_its_wrenches() -> None:
    noise = np.arange(30.0)[:, None] - 14.5
    (pose,) = resting([sample(0.01 * n, 0.3, noise=one) for n, one in enumerate(noise)])
    assert np.allclose(pose[1], wrench_at(0.3))


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
    assert len(heard(model, path)["wrist"]) == len(PITCHES) - 1


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
        heard(model, path)
    assert "log.yaml" in str(caught.value) and words in str(caught.value)
