"""Conventions of known drivers: what they fill in, and what they refuse."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion import Grid, State
from contactfusion.arrays import FloatArray
from contactfusion.cli.plugin_listing import describe_plugin
from contactfusion.errors import ConfigurationError
from contactfusion.frames import FrameTree, pose_at
from contactfusion.generators.force_torque import ForceTorqueConfig, ForceTorqueGenerator
from contactfusion.generators.joint_torque import JointTorqueConfig
from contactfusion.inspect.first_configuration import write_first
from contactfusion.readings import Wrench
from contactfusion.shapes import BodyConfig
from contactfusion.vendors import EFFORTS, VENDORS, WRENCHES, convention_of
from tests.arms import known


@pytest.mark.parametrize("vendor", WRENCHES)
def test_a_vendor_gives_the_sign_of_a_wrench(vendor: str) -> None:
    config = ForceTorqueConfig(vendor=vendor)
    assert config.sign == WRENCHES[vendor].options["sign"]


@pytest.mark.parametrize("vendor", EFFORTS)
def test_a_vendor_gives_the_kind_of_effort(vendor: str) -> None:
    given: dict[str, Any] = {"vendor": vendor, "joints": known()}
    assert JointTorqueConfig(**given).effort == EFFORTS[vendor].options["effort"]


def test_what_the_user_gives_stays() -> None:
    config = ForceTorqueConfig(vendor="franka_k_f_ext_hat_k", sign="on_robot")
    assert config.on_robot()


def test_every_convention_states_its_source() -> None:
    assert all(known.source for kind in VENDORS.values() for known in kind.values())


def refused(**options: Any) -> str:
    with pytest.raises(ConfigurationError) as raised:
        ForceTorqueConfig(**options)
    return str(raised.value)


def test_an_unknown_vendor_is_refused_with_the_nearest_name() -> None:
    said = refused(vendor="ur_actual_tcp_froce")
    assert said.startswith("vendor: unknown vendor 'ur_actual_tcp_froce': did you mean 'ur_actual")


@pytest.mark.parametrize("load", [{"compensation": {"mass": 1.0}}, {"load": "robot"}])
def test_gravity_is_not_taken_off_twice(load: dict[str, Any]) -> None:
    said = refused(vendor="ur_wrench", **load)
    assert "the driver takes gravity off what 'ur_wrench' reports" in said


@pytest.mark.parametrize(
    ("kind", "name", "vendor"),
    [
        (
            "force_torque",
            "/franka_robot_state_broadcaster/external_wrench_in_base_frame",
            "franka_o_f_ext_hat_k",
        ),
        ("force_torque", "/force_torque_sensor_broadcaster/wrench", "ur_wrench"),
        ("force_torque", "actual_TCP_force_0", "ur_actual_tcp_force"),
        ("force_torque", "/wrench", ""),
        ("joint_torque", "tau_ext_hat_filtered_3", "franka_tau_ext_hat_filtered"),
        ("joint_torque", "/joint_states", ""),
        ("joint_torque", "actual_current_5", "ur_actual_current"),
        ("joint_torque", "actual_current_window_5", ""),
        ("joint_torque", "actual_current_as_torque_5", ""),
    ],
)
def test_a_convention_is_known_by_its_topic_or_column(kind: str, name: str, vendor: str) -> None:
    assert convention_of(kind, name) == vendor


def found(vendor: str, force: FloatArray, place: FloatArray, yaw: float) -> FloatArray:
    """The mean place that a driver's wrench of a push gives, in the base [m].

    Args:
        vendor: the convention.
        force: shape (3,) [N], on the robot, in the base.
        place: shape (3,) [m], in the base.
        yaw: of the flange in the base [rad].
    """
    flange = pose_at(xyz=(0.4, 0.1, 0.3), rpy=(0.0, 0.0, yaw))
    shapes = [{"shape": "sphere", "radius": 0.06}]
    ball = BodyConfig.model_validate({"frame": "tool0", "shapes": shapes}).sampled(Path())
    frames = FrameTree({"tool0": ("base", flange)})
    state = State(
        now=0.0, grid=Grid("base", 0.005), frames=frames, surface=ball.moved(flange, "base")
    )
    torque = np.cross(place - flange[:3, 3], force)
    if WRENCHES[vendor].options.get("axes") is None:
        force, torque = flange[:3, :3].T @ force, flange[:3, :3].T @ torque
    if WRENCHES[vendor].options["sign"] == "by_robot":
        force, torque = -force, -torque
    generator = ForceTorqueGenerator("wrist", ForceTorqueConfig(vendor=vendor))
    (cloud,) = generator.generate(
        Wrench(stamp=0.0, frame="tool0", force=force, torque=torque), state
    )
    return np.asarray(cloud.positions.mean(axis=0), np.float64)


@pytest.mark.parametrize("vendor", ["ur_actual_tcp_force", "ur_wrench", "franka_k_f_ext_hat_k"])
@pytest.mark.parametrize("yaw", [0.0, 1.2])
def test_a_push_is_found_by_the_axes_and_the_sign_of_each_driver(vendor: str, yaw: float) -> None:
    place = np.array([0.4, 0.1 - 0.06, 0.3])
    assert found(vendor, np.array([0.0, 20.0, 0.0]), place, yaw) == pytest.approx(place, abs=0.012)


def test_init_proposes_the_convention_of_columns(tmp_path: Path) -> None:
    names = ["time", *(f"actual_TCP_force_{number}" for number in range(6))]
    rows = [[0.002 * row, 1.0, 2.0, 3.0, 0.1, 0.2, 0.3] for row in range(5)]
    table = tmp_path / "rtde.csv"
    lines = [",".join(names), *(",".join(map(str, row)) for row in rows)]
    table.write_text("\n".join(lines) + "\n")
    write_first(table, tmp_path / "first.yaml")
    text = (tmp_path / "first.yaml").read_text()
    fields = yaml.safe_load(text)
    assert fields["recording"]["readings"]["actual_TCP_force"]["columns"] == names[1:]
    assert fields["generators"]["actual_TCP_force"]["sign"] == "on_robot"
    assert "# vendor: ur_actual_tcp_force" in text  # without a robot no link is called base


def test_the_conventions_are_listed_with_their_sources(capsys: pytest.CaptureFixture[str]) -> None:
    describe_plugin("force_torque")
    listed = capsys.readouterr().out
    words = " ".join(listed.split())
    assert all(f"vendor {name} (" in words for name in WRENCHES)
    assert "libfranka issue 26" in words
