"""A table that nothing describes: what its columns are, and a description to begin with."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion.check import check_file
from contactfusion.errors import ConfigurationError, RecordingError
from contactfusion.inspect.first_configuration import write_first
from contactfusion.inspect.joint_columns import joint_columns, range_of
from contactfusion.inspect.log_columns import (
    BLANK,
    Stamps,
    as_json,
    as_text,
    described,
    inspect_table,
)
from contactfusion.readings import JointState
from contactfusion.readings.joints import JointStateColumns
from contactfusion.recordings.log import LogRecording
from contactfusion.recordings.opening import open_recording
from contactfusion.run.execute import run_file
from tests.arms import ARM, robot

SIX = ("fx", "fy", "fz", "tx", "ty", "tz")


def table(path: Path, names: Sequence[str], step: float = 0.01, rows: int = 200) -> Path:
    """A table whose first column rises by `step`; the others are noise about their number."""
    noise = np.random.default_rng(0).normal(0.0, 0.1, (rows, len(names) - 1))
    values = np.column_stack([step * np.arange(rows), noise + np.arange(1, len(names))])
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(values.tolist())
    return path


def description(path: Path) -> dict[str, Any]:
    fields: dict[str, Any] = yaml.safe_load("\n".join(described(inspect_table(path), path.name)))
    return fields


def test_a_column_has_its_first_values_its_ends_and_its_gaps(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,fx,who\n0,3,ann\n1,,bob\n2,-1.5,eve\n3,7,ann\n")
    t, fx, who = inspect_table(path).columns
    assert (t.first, t.least, t.greatest, t.missing) == ((0.0, 1.0, 2.0), 0.0, 3.0, 0)
    assert (fx.least, fx.greatest, fx.missing) == (-1.5, 7.0, 1)
    assert (who.first, who.least, who.use) == ((), None, "no numbers")


@pytest.mark.parametrize(
    ("name", "step", "stamps"),
    [
        ("t", 0.01, Stamps("t", "s", 100.0)),
        ("Time", 10.0, Stamps("Time", "ms", 100.0)),
        ("stamp", 1.0, Stamps("stamp", "ms", 1000.0)),
        ("t [s]", 1.0, Stamps("t [s]", "s", 1.0)),
        ("header.stamp", 1e7, Stamps("header.stamp", "ns", 100.0)),
        ("time_us", 5000.0, Stamps("time_us", "us", 200.0)),
        ("rosbagTimestamp", 5e6, Stamps("rosbagTimestamp", "ns", 200.0)),
        ("row", 0.01, None),
        ("t", 0.0, None),
        ("t", -0.01, None),
        ("t", 1e-5, None),
    ],
)
def test_stamps_are_a_column_that_is_called_so_and_rises(
    name: str, step: float, stamps: Stamps | None, tmp_path: Path
) -> None:
    found = inspect_table(table(tmp_path / "log.csv", [name, *SIX], step)).stamps
    assert (found is None) == (stamps is None)
    if found and stamps:
        assert (found.column, found.unit) == (stamps.column, stamps.unit)
        assert found.rate == pytest.approx(stamps.rate)


@pytest.mark.parametrize(
    ("names", "wrenches"),
    [
        (SIX, {"log_1": SIX}),
        (("Fx", "Fy", "Fz", "Mx", "My", "Mz"), {"log_1": ("Fx", "Fy", "Fz", "Mx", "My", "Mz")}),
        (
            ("Tx [Nm]", "Ty [Nm]", "Tz [Nm]", "Fx [N]", "Fy [N]", "Fz [N]"),
            {"log_1": ("Fx [N]", "Fy [N]", "Fz [N]", "Tx [Nm]", "Ty [Nm]", "Tz [Nm]")},
        ),
        (
            tuple(f"wrist.{what}.{axis}" for what in ("force", "torque") for axis in "xyz"),
            {"wrist": tuple(f"wrist.{w}.{a}" for w in ("force", "torque") for a in "xyz")},
        ),
        (
            tuple(f"{side}_{one}" for side in ("left", "right") for one in SIX),
            {side: tuple(f"{side}_{one}" for one in SIX) for side in ("left", "right")},
        ),
        (("fx", "fy", "fz"), {}),
        (("px", "py", "pz", "tx", "ty", "tz"), {}),
    ],
)
def test_a_wrench_is_six_columns_of_force_and_torque(
    names: Sequence[str], wrenches: dict[str, Any], tmp_path: Path
) -> None:
    assert inspect_table(table(tmp_path / "log 1.csv", ["t", *names])).wrenches == wrenches


def test_the_description_opens_the_table(tmp_path: Path) -> None:
    path = table(tmp_path / "wrist.csv", ["time_ms", *SIX], 10.0)
    recording = open_recording(description(path), tmp_path)
    readings = list(recording.readings())
    assert isinstance(recording, LogRecording) and not recording.notes
    assert len(readings) == 200 and readings[-1].stamp == pytest.approx(1.99)
    assert {(one.sensor, one.frame) for one in readings} == {("wrist", "wrist")}


def test_what_a_table_does_not_say_is_a_blank(tmp_path: Path) -> None:
    path = tmp_path / "numbers.csv"
    path.write_text("1,2\n3,4\n")
    fields = description(path)
    assert fields["time"] == {"rate": BLANK}
    assert fields["readings"]["numbers"]["columns"] == [BLANK]


def test_columns_without_a_name_of_their_own_have_numbers(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,a,a,\n0,1,2,3\n")
    assert [one.name for one in inspect_table(path).columns] == ["t", 2, 3, 4]


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_arrays_are_tables_too(suffix: str, tmp_path: Path) -> None:
    path, values = tmp_path / f"log{suffix}", np.arange(14.0).reshape(2, 7)
    if suffix == ".npy":
        np.save(path, values)
        assert [one.name for one in inspect_table(path).columns] == [*range(1, 8)]
    else:
        np.savez(path, t=values[:, 0], wrench=values[:, 1:])
        t, wrench = inspect_table(path).columns
        assert (t.name, wrench.name, wrench.use) == ("t", "wrench", "6 columns")


def test_a_file_without_numbers_is_no_table(tmp_path: Path) -> None:
    path = tmp_path / "words.csv"
    path.write_text("a,b\nc,d\n")
    with pytest.raises(RecordingError, match=r"^no column of numbers can be read: .*words\.csv"):
        inspect_table(path)


def test_a_table_whose_rows_differ_names_the_first_such_line(tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    path.write_text("t,fx,fy\n0,1,2\n1,1,2,3\n")
    with pytest.raises(RecordingError, match=r"wide\.csv, line 3: 4 cells under 3 names"):
        inspect_table(path)


def numbered(*names: str, count: int = 7, first: int = 1) -> list[str]:
    return [f"{name}{number}" for name in names for number in range(first, first + count)]


UR = numbered("actual_q_", "target_q_", "actual_qd_", "actual_current_", count=6, first=0)
SHOWN = [f"/joint_states/{joint}/{what}" for joint in "ab" for what in ("effort", "position")]


@pytest.mark.parametrize(
    ("names", "sensor", "held"),
    [
        (
            numbered("q", "dq", "tau_J"),
            "tau_J",
            {"positions": "q1..q7", "velocities": "dq1..dq7", "efforts": "tau_J1..tau_J7"},
        ),
        (numbered("q", "tau"), "joints", {"positions": "q1..q7", "efforts": "tau1..tau7"}),
        (
            UR,
            "actual_current",
            {
                "positions": "actual_q_0..actual_q_5",
                "velocities": "actual_qd_0..actual_qd_5",
                "efforts": "actual_current_0..actual_current_5",
            },
        ),
        ([f"state.q[{n}]" for n in range(6)], "joints", {"positions": ""}),
        (SHOWN, "joints", {"positions": "", "efforts": ""}),
    ],
)
def test_joints_are_columns_that_count_alike(
    names: Sequence[str], sensor: str, held: dict[str, str]
) -> None:
    found = joint_columns(names)
    assert found and found.sensor == sensor
    assert {kind: range_of(columns) for kind, columns in found.by_kind.items()} == held


@pytest.mark.parametrize(
    "names", [["q1"], numbered("p"), ["q1", "q3"], numbered("target_q_"), numbered("tau"), []]
)
def test_a_single_joint_gaps_commands_and_other_numbers_are_no_arm(names: Sequence[str]) -> None:
    assert joint_columns(names) is None


def test_efforts_are_those_of_a_known_driver_and_of_the_same_arm() -> None:
    franka = joint_columns(numbered("q", "tau_J", "tau_ext_hat_filtered_"))
    assert franka and franka.sensor == "tau_ext_hat_filtered"
    arms = joint_columns(numbered("right_tau", "left_q", "left_tau", "right_q"))
    assert arms and range_of(arms.efforts) == "left_tau1..left_tau7"


def test_named_joints_keep_their_names() -> None:
    found = joint_columns(SHOWN)
    assert found and found.names == ("a", "b")
    assert dict(found.uses())["/joint_states/b/effort"] == "effort of b [N·m or A]"


def test_an_inspection_ends_with_a_description_to_copy(tmp_path: Path) -> None:
    found = inspect_table(table(tmp_path / "wrist.csv", ["t", *SIX]))
    text = as_text(found)
    assert "200 rows of 7 columns" in text and "stamps in s: 100 Hz" in text
    assert text.endswith("\n".join(described(found, "wrist.csv")))
    stamps = json.loads(as_json(found))["stamps"]
    assert stamps == {"column": "t", "unit": "s", "rate": pytest.approx(100.0)}


def test_the_first_configuration_of_a_table_runs_as_it_stands(tmp_path: Path) -> None:
    out = tmp_path / "configs" / "wrist.yaml"
    write_first(table(tmp_path / "wrist.csv", ["t", *SIX]), out)
    assert not check_file(out).faults
    fields = yaml.safe_load(out.read_text())
    assert fields["recording"]["file"] == "../wrist.csv"
    assert fields["generators"]["wrist"]["tare"] == 0.5
    run_file(out, out=tmp_path / "results")
    assert (tmp_path / "results" / "contacts.csv").exists()


def test_a_first_configuration_with_blanks_is_checked_once_they_are_filled_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "q.yaml"
    write_first(table(tmp_path / "q.csv", ["row", *"abcdef"]), out)
    assert f"next: put in what {BLANK} stands for" in capsys.readouterr().out
    (fault,) = check_file(out).faults
    assert "recording.time.rate" in fault and BLANK in fault
    filled = out.read_text().replace(f"rate: {BLANK}", "rate: 100")
    out.write_text(filled.replace(f"[{BLANK}]", "[a, b, c, d, e, f]"))
    assert not check_file(out).faults


def test_joints_take_the_names_of_the_robot_that_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "arm.yaml"
    path = table(tmp_path / "arm.csv", ["t", *numbered("q", "tau")])
    write_first(path, out, robot=Path(robot().config.urdf))
    printed = capsys.readouterr().out
    assert "q1 to q7 are taken to be arm_1, arm_2" in printed
    assert "say what its efforts are, by `effort`, and how noisy they are" in printed
    recording = yaml.safe_load(out.read_text())["recording"]
    arm = recording["readings"]["joints"]
    assert arm["holds"] == ["positions", "efforts"] and arm["names"] == [*ARM]
    assert not check_file(out).faults
    reading = next(iter(open_recording(recording, tmp_path).readings()))
    assert isinstance(reading, JointState)
    assert reading.velocities is None and reading.efforts is not None


def test_columns_called_like_the_joints_of_the_robot_hold_their_positions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, urdf = tmp_path / "arm.yaml", Path(robot().config.urdf)
    path = table(tmp_path / "arm.csv", ["t", *SIX, *reversed(ARM)])
    assert inspect_table(path).joints is None
    write_first(path, out, robot=urdf)
    printed = capsys.readouterr().out
    assert f"{ARM[-1]} to {ARM[0]} are joints of {urdf} by their names" in printed
    assert f"next: give {out} a generator, of those in its comments" in printed
    arm = yaml.safe_load(out.read_text())["recording"]["readings"]["joints"]
    assert arm["names"] == [*reversed(ARM)] and arm["holds"] == ["positions"]


def test_the_names_of_the_robot_hide_no_velocities_and_efforts() -> None:
    names = numbered("q", "dq", "tau")
    assert joint_columns(names, numbered("q")) == joint_columns(names)


def test_columns_hold_positions_and_each_value_at_most_once() -> None:
    wrong: list[Any] = [["efforts"], ["positions", "positions"]]
    for holds in wrong:
        with pytest.raises(ConfigurationError, match="name positions, and each at most once"):
            JointStateColumns(
                type="joint_state", frame="base", names=("a",), columns=(1,), holds=holds
            )


def test_joints_without_their_robot_are_left_out_or_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = table(tmp_path / "both.csv", ["t", *SIX, *numbered("q")])
    write_first(both, tmp_path / "both.yaml")
    assert "the joints q1 to q7 are left out: name --robot URDF" in capsys.readouterr().out
    alone = table(tmp_path / "alone.csv", ["t", *numbered("q")])
    with pytest.raises(ConfigurationError, match=r"holds joints \(q1 to q7\) and no wrench: name"):
        write_first(alone, tmp_path / "alone.yaml")


def test_more_joints_than_the_robot_has_are_refused(tmp_path: Path) -> None:
    path = table(tmp_path / "arm.csv", ["t", *numbered("q", count=40)])
    with pytest.raises(ConfigurationError, match=r"holds 40 joints \(q1 to q40\), and"):
        write_first(path, tmp_path / "arm.yaml", robot=Path(robot().config.urdf))


def test_values_that_are_missing_are_null_in_json(tmp_path: Path) -> None:
    file = tmp_path / "gaps.csv"
    file.write_text("t,fx\n0.0,1\n0.1,\n0.2,3\n")
    held = json.loads(as_json(inspect_table(file)), parse_constant=pytest.fail)
    assert [column["first"] for column in held["columns"]][1] == [1.0, None, 3.0]
