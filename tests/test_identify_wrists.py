"""Load, bias and noise of wrists from a handful of poses."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion import check_file, identify_file
from contactfusion.arrays import FloatArray
from contactfusion.frames import inverse, vectors_in
from contactfusion.generators.compensation import Compensation
from contactfusion.identify.report import Identification
from contactfusion.robots.description import PayloadConfig
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.vendors import WRENCHES
from tests.arms import ARM, STILL, robot, whole

TRUTH = Compensation(
    mass=1.5,
    centre_of_mass=(0.01, -0.02, 0.06),
    force_bias=(3.0, -2.0, 7.0),
    torque_bias=(0.1, 0.2, -0.3),
)
NOISE = np.repeat([0.3, 0.02], 3)
LOAD = robot().load_on("wrist_sensor", robot().poses_at(whole(np.zeros(7))))[0]
"""Of the hand, by the URDF [kg]."""


def postures(count: int) -> FloatArray:
    """Positions of the arm that turn the wrist far, shape (count, 7) [rad]."""
    return np.random.default_rng(1).uniform(-1.5, 1.5, (count, 7))


def told(
    folder: Path, arm: FloatArray, sign: str = "by_robot", truth: Compensation | None = TRUTH,
    payload: PayloadConfig | None = None, along: str = "wrist_sensor",
    fields: Mapping[str, Any] | None = None, **options: Any,
) -> Identification:  # fmt: skip
    """What half a second in each posture tells.

    Args:
        folder: of all files.
        arm: the postures.
        sign: of the sensor.
        truth: load and bias; None: the sensor carries the hand.
        payload: that this holds.
        along: the frame whose axes the wrenches come along.
        fields: of the configuration.
        **options: of the generator.
    """
    carrying = RobotModel(robot().config.model_copy(update={"payload": payload}))
    rng, rows = np.random.default_rng(0), []
    for number, positions in enumerate(arm):
        posed = PosedRobot(carrying, whole(positions), robot().root, np.eye(4))
        pose = inverse(posed.pose_of("wrist_sensor"))
        gravity = vectors_in(pose, np.array([[0.0, 0.0, -9.81]]))[0]
        loaded = truth
        if loaded is None:
            mass, centre = posed.load_on("wrist_sensor")
            x, y, z = (pose @ [*centre, 1.0])[:3].tolist()
            moved = {"mass": mass, "centre_of_mass": (x, y, z)}
            loaded = TRUTH.model_copy(update=moved)
        factor = -1.0 if sign == "by_robot" else 1.0
        for step in range(50):
            wrench = factor * loaded.contactless(gravity) + NOISE * rng.standard_normal(6)
            turn = inverse(posed.pose_of(along)) @ posed.pose_of("wrist_sensor")
            wrench = vectors_in(turn, wrench.reshape(2, 3)).ravel()
            rows.append([number + 0.01 * step, *positions, *wrench])
    np.save(folder / "rests.npy", rows)
    joints = {"type": "joint_state", "frame": "base", "names": list(ARM), "columns": "2..8"}
    sensed = {"type": "wrench", "frame": "wrist_sensor", "columns": "9..14"}
    log = {
        "type": "log",
        "file": "rests.npy",
        "time": {"column": 1},
        "readings": {"arm": joints, "wrist": sensed},
    }
    (folder / "rests.yaml").write_text(yaml.safe_dump(log))
    config = {**configuration(**options), **(fields or {})}
    (folder / "wrist.yaml").write_text(yaml.safe_dump(config))
    return identify_file(folder / "wrist.yaml", folder / "rests.yaml", folder / "identified.yaml")


def configuration(**options: Any) -> dict[str, Any]:
    wrist = {"type": "force_torque", "sensor": "wrist", "sign": "by_robot", **options}
    return {
        "robot": {"urdf": "contactfusion.robots:arm_hand.urdf", "still": STILL, "spacing": 0.01},
        "generators": {"wrist": wrist},
        "integrator": {"frame": "base"},
    }


def test_load_bias_and_noise_come_back_and_check_passes(tmp_path: Path) -> None:
    found = told(tmp_path, postures(7))
    options = found.fields["generators"]["wrist"]
    assert options["compensation"]["mass"] == pytest.approx(TRUTH.mass, abs=0.02)
    for name, off in (("centre_of_mass", 0.003), ("force_bias", 0.1), ("torque_bias", 0.02)):
        assert options["compensation"][name] == pytest.approx(getattr(TRUTH, name), abs=off)
    assert options["force_noise"] == pytest.approx(0.3, rel=0.1)
    assert options["torque_noise"] == pytest.approx(0.02, rel=0.1)
    assert not found.kept and not found.warnings
    text = yaml.safe_dump({**configuration(), "identified": "identified.yaml"})
    (tmp_path / "taking.yaml").write_text(text)
    assert not check_file(tmp_path / "taking.yaml", tmp_path / "rests.yaml").faults


def test_standard_errors_hold_the_truth(tmp_path: Path) -> None:
    found = told(tmp_path, postures(9))
    (line,) = (line for line in found.lines if line.startswith("  mass"))
    value, error = (float(word) for word in line.split()[1:4:2])
    assert 0.0 < error < 0.02 and abs(value - TRUTH.mass) < 4.0 * error


def test_of_a_load_that_follows_from_the_robot_the_biases_are_told(tmp_path: Path) -> None:
    found = told(tmp_path, postures(7), truth=None, load="robot")
    compensation = found.fields["generators"]["wrist"]["compensation"]
    assert set(compensation) == {"force_bias", "torque_bias"}
    assert compensation["force_bias"] == pytest.approx(TRUTH.force_bias, abs=0.1)
    assert compensation["torque_bias"] == pytest.approx(TRUTH.torque_bias, abs=0.02)


def test_poses_that_do_not_tell_change_nothing(tmp_path: Path) -> None:
    found = told(tmp_path, postures(2))
    assert found.kept == [
        "wrist: rested in 2 poses; 3 that are turned far from each other tell weight and bias apart"
    ]
    assert not found.fields["generators"]


def test_a_sign_that_gravity_contradicts_is_named(tmp_path: Path) -> None:
    found = told(tmp_path, postures(7), sign="on_robot")
    (warning,) = found.warnings
    assert "gravity says sign on_robot, the configuration says by_robot" in warning
    assert not found.fields["generators"]


def test_a_payload_that_is_known_is_none_of_the_bias(tmp_path: Path) -> None:
    payload = PayloadConfig(frame="palm", mass=0.8, centre_of_mass=(0.0, 0.0, 0.08))
    known = {**configuration()["robot"], "payload": payload.model_dump(mode="json")}
    found = told(
        tmp_path, postures(7), truth=None, payload=payload, fields={"robot": known}, load="robot"
    )
    compensation = found.fields["generators"]["wrist"]["compensation"]
    assert compensation["force_bias"] == pytest.approx(TRUTH.force_bias, abs=0.1)
    assert compensation["torque_bias"] == pytest.approx(TRUTH.torque_bias, abs=0.02)


def test_wrenches_along_other_axes_are_turned(tmp_path: Path) -> None:
    options = told(tmp_path, postures(7), along="base", axes="base").fields["generators"]["wrist"]
    assert options["compensation"]["mass"] == pytest.approx(TRUTH.mass, abs=0.02)
    assert options["compensation"]["force_bias"] == pytest.approx(TRUTH.force_bias, abs=0.1)


def test_the_frame_of_a_sensor_may_hang_on_the_robot_by_the_configuration(tmp_path: Path) -> None:
    told(tmp_path, postures(7), truth=None, load="robot")
    log = (tmp_path / "rests.yaml").read_text().replace("frame: wrist_sensor", "frame: ati")
    (tmp_path / "rests.yaml").write_text(log)
    fields = {**configuration(load="robot"), "frames": {"ati": {"parent": "wrist_sensor"}}}
    (tmp_path / "wrist.yaml").write_text(yaml.safe_dump(fields))
    found = identify_file(tmp_path / "wrist.yaml", tmp_path / "rests.yaml")
    compensation = found.fields["generators"]["wrist"]["compensation"]
    assert compensation["force_bias"] == pytest.approx(TRUTH.force_bias, abs=0.1)


@pytest.mark.parametrize("mass", [0.0, 0.4])
def test_of_a_driver_that_takes_the_load_off_the_bias_is_told(mass: float, tmp_path: Path) -> None:
    truth = TRUTH.model_copy(update={"mass": mass})
    vendor = "franka_k_f_ext_hat_k"
    wrist = {"type": "force_torque", "sensor": "wrist", "vendor": vendor}
    sign = WRENCHES[vendor].options["sign"]
    found = told(tmp_path, postures(7), sign, truth, fields={"generators": {"wrist": wrist}})
    compensation = found.fields["generators"]["wrist"]["compensation"]
    assert set(compensation) == {"force_bias", "torque_bias"}
    assert compensation["force_bias"] == pytest.approx(TRUTH.force_bias, abs=0.1)
    warned = any("0.40 kg that its driver does not take off" in each for each in found.warnings)
    assert warned == (mass > 0.0) and len(found.warnings) == int(mass > 0.0)
    taking = {**yaml.safe_load((tmp_path / "wrist.yaml").read_text())}
    (tmp_path / "taking.yaml").write_text(
        yaml.safe_dump({**taking, "identified": "identified.yaml"})
    )
    assert not check_file(tmp_path / "taking.yaml", tmp_path / "rests.yaml").faults


def test_three_poses_state_no_errors(tmp_path: Path) -> None:
    found = told(tmp_path, postures(3))
    assert found.lines and not any("nan" in line for line in found.lines)
