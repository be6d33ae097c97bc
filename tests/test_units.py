"""Numbers that are plausible in another unit only, and the sentence that names it."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from contactfusion.errors import ConfigurationError
from contactfusion.faults import Calibration
from contactfusion.frames import FrameConfig
from contactfusion.generators.compensation import Compensation
from contactfusion.generators.force_torque import ForceTorqueConfig
from contactfusion.generators.free_space import FreeSpaceConfig
from contactfusion.generators.motion import MotionConfig
from contactfusion.generators.proximity import BoxConfig
from contactfusion.generators.range import RangeConfig
from contactfusion.generators.tactile import TactileConfig
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.model import Model
from contactfusion.patches import PatchConfig
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import CycleConfig, PipelineConfig
from contactfusion.plugins import installed_plugins
from contactfusion.recordings.icub import IcubConfig
from contactfusion.robots.description import CameraConfig, LidarConfig, RobotConfig
from contactfusion.robots.objects import ObjectConfig
from contactfusion.shapes import BodyConfig, ShapeConfig
from contactfusion.units import Metres, Radians, unit_of
from tests.urdfs import joint, link, written

EYE = {"frame": "eye", "width": 640, "height": 480, "fov": 60}
LENGTHS = "lengths are in metres: did you mean"
ANGLES = "angles are in radians"
TIMES = "times are in seconds: did you mean"


@pytest.mark.parametrize(
    ("model", "fields", "sentence"),
    [
        (
            IntegratorConfig,
            {"voxel_size": 5},
            f"voxel_size: 5 m is implausible, the limit is 1 m; {LENGTHS} 0.005?",
        ),
        (
            FrameConfig,
            {"parent": "base", "rpy": [0, 0, 90]},
            f"rpy.2: 90 rad is implausible, the limit is 6.3 rad; {ANGLES}: 90 degrees are 1.5708",
        ),
        (
            FrameConfig,
            {"parent": "base", "rpy": [-180, 0, 0]},
            "rpy.0: -180 rad is implausible, the limit is -6.3 rad; "
            f"{ANGLES}: -180 degrees are -3.1416",
        ),
        (
            FrameConfig,
            {"parent": "base", "xyz": [0, 0, 1200]},
            f"xyz.2: 1200 m is implausible, the limit is 1000 m; {LENGTHS} 1.2?",
        ),
        (
            CycleConfig,
            {"every": 10},
            f"every: 10 s is implausible, the limit is 5 s; {TIMES} 0.01?",
        ),
        (
            CameraConfig,
            {**EYE, "fov": 1.047},
            "fov: 1.047 degrees is implausible, the limit is 3.2 degrees; "
            "this angle is in degrees: 1.047 radians are 59.989",
        ),
        (
            ForceTorqueConfig,
            {"sign": "on_robot", "gravity": [0, 0, -9810]},
            "gravity.2: -9810 m/s² is implausible, the limit is -30 m/s²; "
            "accelerations are in metres per second²: did you mean -9.81?",
        ),
    ],
)
def test_the_sentence_states_the_limit_the_unit_and_what_was_meant(
    model: type[Model], fields: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        model(**fields)
    assert str(caught.value) == sentence


PAD = {"grid": {"rows": 2, "columns": 2, "pitch": [0.004, 0.004]}}


@pytest.mark.parametrize(
    ("model", "fields", "path"),
    [
        (IntegratorConfig, {"timeout": 500}, "timeout"),
        (IntegratorConfig, {"stale_after": 1000}, "stale_after"),
        (IntegratorConfig, {"tolerance": 10}, "tolerance"),
        (PatchConfig, {"grid": {**PAD["grid"], "pitch": [4, 0.004]}}, "grid.pitch.0"),
        (PatchConfig, {"grid": {**PAD["grid"], "xyz": [0, 25, 0]}}, "grid.xyz.1"),
        (PatchConfig, {"places": [[25, 0, 0]], "size": [0.004, 0.004]}, "places.0.0"),
        (PatchConfig, {**PAD, "size": [0.004, 4]}, "size.1"),
        (ShapeConfig, {"shape": "sphere", "radius": 2000}, "radius"),
        (ShapeConfig, {"shape": "box", "size": [1, 2000, 1]}, "size.1"),
        (ShapeConfig, {"shape": "sphere", "radius": 0.1, "rpy": [0, 45, 0]}, "rpy.1"),
        (BodyConfig, {"frame": "base", "spacing": 4, "file": "a.npz"}, "spacing"),
        (RobotConfig, {"urdf": "a.urdf", "spacing": 4}, "spacing"),
        (CameraConfig, {**EYE, "reach": [0.2, 4000]}, "reach.1"),
        (LidarConfig, {"frame": "lidar", "reach": [0.3, 50_000]}, "reach.1"),
        (ObjectConfig, {"urdf": "a.urdf", "frame": "a", "sigma": 20}, "sigma"),
        (TactileConfig, {"patch": PAD, "noise": 4}, "noise"),
        (TactileConfig, {"patch": PAD, "timeout": 500}, "timeout"),
        (ForceTorqueConfig, {"sign": "on_robot", "min_force": 20_000}, "min_force"),
        (ForceTorqueConfig, {"sign": "on_robot", "surface_tolerance": 10}, "surface_tolerance"),
        (Compensation, {"centre_of_mass": [0, 0, 50]}, "centre_of_mass.2"),
        (MotionConfig, {"ahead": 50}, "ahead"),
        (RangeConfig, {"around": 150}, "around"),
        (FreeSpaceConfig, {"box": [[0, 0, 0], [1200, 1, 1]]}, "box.1.0"),
        (BoxConfig, {"x": [300, 620], "y": [0, 1], "z": [0, 1]}, "x.0"),
        (IcubConfig, {"file": "a.txt", "period": 100}, "period"),
    ],
)
def test_millimetres_degrees_and_milliseconds_are_found(
    model: type[Model], fields: dict[str, Any], path: str
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        model(**fields)
    told = {fault.path: fault.problem for fault in caught.value.faults}
    assert (
        "is implausible, the limit is" in told[path]
        and "did you mean" in told[path]
        or (ANGLES in told[path])
    )


def pipeline(**fields: Any) -> PipelineConfig:
    return PipelineConfig(**fields)


def test_a_crane_and_a_micro_gripper_are_plausible() -> None:
    boom = {"shape": "box", "size": [100, 2, 2], "xyz": [50, 0, 0]}
    pipeline(
        surface={"frame": "boom", "spacing": 0.02, "shapes": [boom]},
        frames={"boom": {"parent": "base", "xyz": [0, 0, 80], "rpy": [0, 0, math.tau]}},
        integrator={"voxel_size": 0.05, "timeout": 60},
    )
    pipeline(
        surface={"frame": "tip", "spacing": 1e-4, "shapes": [{"shape": "sphere", "radius": 1e-3}]},
        integrator={"frame": "tip", "voxel_size": 1e-4, "timeout": 0.01},
    )


@pytest.mark.parametrize(
    ("shape", "sentence"),
    [
        (
            {"shape": "box", "size": [0.09, 0.11, 160]},
            f"size.2: 160 m is implausible beside 0.11 m; {LENGTHS} 0.16?",
        ),
        (
            {"shape": "cylinder", "radius": 0.03, "length": 200},
            f"length: 200 m is implausible beside 0.06 m; {LENGTHS} 0.2?",
        ),
    ],
)
def test_one_edge_in_millimetres_among_metres_is_found(
    shape: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        ShapeConfig(**shape)
    assert str(caught.value) == sentence


@pytest.mark.parametrize(
    "shape",
    [
        {"shape": "box", "size": [200, 200, 0.01]},
        {"shape": "box", "size": [0.05, 90, 0.05]},
        {"shape": "cylinder", "radius": 100, "length": 0.01},
        {"shape": "rectangle", "size": [0.05, 200]},
        {"shape": "sphere", "radius": 300},
    ],
    ids=["floor", "rail", "disc", "strip", "dome"],
)
def test_floors_rails_and_strips_are_plausible(shape: dict[str, Any]) -> None:
    ShapeConfig(**shape)


def test_a_sensor_is_mounted_no_further_away_than_the_robot_is_large(tmp_path: Path) -> None:
    def arm(reach: float, **fields: Any) -> Pipeline:
        links = [link(name) for name in ("base", "arm", "tool")]
        far = joint("flange", "arm", "tool", "fixed", "", xyz=f"0 0 {reach}")
        folder = tmp_path / f"{reach}"  # a robot is built once for each file
        folder.mkdir(exist_ok=True)
        urdf = written(folder, *links, joint("turn", "base", "arm"), far)
        return Pipeline(pipeline(robot=RobotConfig(urdf=str(urdf)), **fields))

    frames = {"cell": {"parent": "base", "xyz": [0, 0, 80]}}
    arm(1.0, frames=frames)
    frames["wrist"] = {"parent": "arm", "xyz": [0, 0, 80]}
    with pytest.raises(ConfigurationError) as caught:
        arm(1.0, frames=frames)
    assert str(caught.value) == (
        f"frames.wrist.xyz.2: 80 m is implausible, the limit is 10 m; {LENGTHS} 0.08?"
    )
    arm(60.0, frames=frames)


class Leg(Model):
    length: Metres = Field(default=1.0, ge=0, le=2)
    """[m]."""
    bends: tuple[Radians, ...] | None = None
    """[rad]."""
    share: float = Field(default=0.5, le=1)
    """Of the weight."""


def refusal(**fields: Any) -> str:
    with pytest.raises(ConfigurationError) as caught:
        Leg(**fields)
    return str(caught.value)


def test_a_wrong_sign_and_a_number_without_unit_are_told_as_ever() -> None:
    assert refusal(length=-1) == "length: input should be greater than or equal to 0, not -1"
    assert refusal(share=2) == "share: input should be less than or equal to 1, not 2"


def test_where_no_other_unit_helps_none_is_proposed() -> None:
    told = "length: 1e+06 m is implausible, the limit is 2 m; lengths are in metres"
    assert refusal(length=1e6) == told


def test_a_field_knows_its_unit_also_within_tuples() -> None:
    units = {name: unit_of(field) for name, field in Leg.model_fields.items()}
    symbols = {name: unit.symbol if unit else None for name, unit in units.items()}
    assert symbols == {"length": "m", "bends": "rad", "share": None}


@given(st.floats(2.0, 2000.0, exclude_min=True))
def test_the_proposal_is_itself_plausible(millimetres: float) -> None:
    meant = float(refusal(length=millimetres).partition("did you mean ")[2].rstrip("?"))
    assert meant == pytest.approx(millimetres / 1000.0, rel=1e-4)
    assert Leg(length=min(meant, 2.0)).length <= 2.0


# Every field with a unit has limits


def models() -> Iterator[type[Model]]:
    yield from (IntegratorConfig, FrameConfig, CycleConfig, PatchConfig, ShapeConfig, BodyConfig)
    for cls in installed_plugins().offers("generators").values():
        if cls.__module__.startswith("contactfusion."):
            yield cls.Config


@pytest.mark.parametrize("model", [*models()], ids=lambda model: model.__name__)
def test_every_length_and_time_declares_its_unit(model: type[Model]) -> None:
    symbols = ("m", "s", "rad", "N", "N·m", "kg", "m/s", "m/s²")
    for name, field in model.model_fields.items():
        described = [s for s in symbols if f"[{s}]" in (field.description or "")]
        unit = unit_of(field)
        holds_numbers = "float" in str(field.annotation)
        assert not (described and holds_numbers) or (unit and unit.symbol == described[0]), name


def test_faults_of_calibration_stay_in_millimetres() -> None:
    assert Calibration(mm=(5.0, 0.0, 0.0)).pose()[0, 3] == pytest.approx(0.005)
