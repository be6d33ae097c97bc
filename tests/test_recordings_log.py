"""Logs in CSV and NumPy files, described in a few lines of YAML."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contactfusion.errors import ConfigurationError, ContactFusionError, RecordingError
from contactfusion.readings import (
    JointCommand,
    JointState,
    Markers,
    ObjectPose,
    Odometry,
    Reading,
    Switch,
    TactileImage,
    Twist,
    Wrench,
)
from contactfusion.readings.wrench import WrenchColumns
from contactfusion.recordings.log import LogRecording
from contactfusion.recordings.opening import open_recording
from tests.real_data import real_data

HEADER = "t,fx,fy,fz,tx,ty,tz\n"
WRIST = {"type": "wrench", "frame": "wrist", "columns": ["fx", "fy", "fz", "tx", "ty", "tz"]}
SKIN = {"type": "tactile_image", "frame": "pad", "columns": [2]}


def log(folder: Path, text: str, reading: dict[str, Any] | None = None, **more: Any) -> Any:
    """Write a log and its description, and open it."""
    (folder / "log.csv").write_bytes(text.encode())
    description = {
        "type": "log",
        "file": "log.csv",
        "time": {"column": 1},
        "readings": {"sensor": reading or WRIST},
        **more,
    }
    (folder / "log.yaml").write_text(yaml.safe_dump(description))
    return open_recording(folder / "log.yaml")


def readings(recording: Any) -> list[Any]:
    return list(recording.readings())


def stamps(recording: Any) -> list[float]:
    return [reading.stamp for reading in recording.readings()]


def values(recording: Any) -> list[list[float]]:
    return [reading.values.tolist() for reading in recording.readings()]


def refusal(*arguments: Any, **more: Any) -> str:
    with pytest.raises(ContactFusionError) as caught:
        readings(log(*arguments, **more))
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_ten_lines_describe_a_log(tmp_path: Path) -> None:
    (tmp_path / "wrist.csv").write_text(HEADER + "1000,1,2,3,4,5,6\n1004,7,8,9,10,11,12\n")
    (tmp_path / "wrist.yaml").write_text("""
type: log
file: wrist.csv
time: {column: t, unit: ms}
readings:
  wrist:
    type: wrench
    frame: wrist_frame
    columns: [fx, fy, fz, tx, ty, tz]
    scale: [1, 1, 1, 0.001, 0.001, 0.001]     # moments in N·mm
""")
    recording = open_recording(tmp_path / "wrist.yaml")
    first, second = readings(recording)
    assert recording.epoch_ns == 1_000_000_000
    assert recording.topics == {"wrist": Wrench}
    assert isinstance(second, Wrench)
    assert (first.stamp, second.stamp) == (0.0, 0.004)
    assert (second.sensor, second.frame) == ("wrist", "wrist_frame")
    np.testing.assert_array_equal(second.force, [7, 8, 9])
    np.testing.assert_allclose(second.torque, [0.010, 0.011, 0.012])


@pytest.mark.parametrize(
    ("reading", "kind", "expected"),
    [
        ({"type": "wrench", "columns": "2..7"}, Wrench, {"force": [1, 2, 3], "torque": [4, 5, 6]}),
        ({"type": "tactile_image", "columns": "2..5"}, TactileImage, {"values": [1, 2, 3, 4]}),
        ({"type": "switch", "columns": 2}, Switch, {"closed": True}),
        ({"type": "switch", "columns": 15}, Switch, {"closed": False}),
        (
            {"type": "joint_state", "names": ["a", "b"], "columns": [2, 3]},
            JointState,
            {"positions": [1, 2]},
        ),
        (
            {"type": "joint_state", "names": ["a", "b"], "columns": "2..7"},
            JointState,
            {"positions": [1, 2], "velocities": [3, 4], "efforts": [5, 6]},
        ),
        (
            {"type": "joint_command", "names": ["a", "b"], "columns": [2, 3]},
            JointCommand,
            {"positions": [1, 2], "names": ("a", "b")},
        ),
        (
            {"type": "object_pose", "name": "mug", "columns": [2, 3, 4, 15, 15, 15, 2]},
            ObjectPose,
            {"name": "mug", "position": [1, 2, 3], "orientation": [0, 0, 0, 1]},
        ),
        ({"type": "twist", "columns": "2..7"}, Twist, {"linear": [1, 2, 3], "angular": [4, 5, 6]}),
        (
            {"type": "odometry", "child_frame": "base", "columns": [2, 3, 4, 15, 15, 15, 2]},
            Odometry,
            {"position": [1, 2, 3], "orientation": [0, 0, 0, 1]},
        ),
        (
            {
                "type": "odometry",
                "child_frame": "base",
                "columns": [2, 3, 4, 15, 15, 15, 2, "2..7"],
            },
            Odometry,
            {"linear": [1, 2, 3], "angular": [4, 5, 6]},
        ),
        (
            {"type": "markers", "names": ["a", "b"], "columns": "2..7"},
            Markers,
            {"names": ("a", "b"), "positions": [[1, 2, 3], [4, 5, 6]]},
        ),
    ],
)
def test_columns_make_every_reading_of_plain_values(
    tmp_path: Path, reading: dict[str, Any], kind: type[Reading], expected: dict[str, Any]
) -> None:
    row = ",".join(str(number) for number in [*range(14), 0])
    (only,) = readings(log(tmp_path, row + "\n", {"frame": "world", **reading}))
    assert type(only) is kind
    for name, value in expected.items():
        np.testing.assert_array_equal(getattr(only, name), value)


@pytest.mark.parametrize(
    "text",
    [
        "1,5,9\n2,6,9\n",
        "# a comment\n1,5,9 # another\n\n2,6,9",
        "1;5;9\r\n2;6;9\r\n",
        "1\t5\t9\n2\t6\t9\n",
        "  1 5   9\n 2 6 9\n",
        '"1","5","9"\n"2","6","9"\n',
        "t,p0,rest\n1,5,9\n2,6,9\n",
        "1,5,\n2,6,\n",
        "1,5,text\n2,6,text\n",
        "\ufefft,p0,rest\n1,5,9\n2,6,9\n",
    ],
)
def test_the_layout_of_a_text_table_is_found(tmp_path: Path, text: str) -> None:
    recording = log(tmp_path, text, SKIN)
    assert values(recording) == [[5.0], [6.0]]
    assert stamps(recording) == [0.0, 1.0]


def test_the_layout_can_be_said(tmp_path: Path) -> None:
    text = "7|8|9\n1|5|9\n"
    assert values(log(tmp_path, text, SKIN, delimiter="|", header=True)) == [[5.0]]
    by_name = {**SKIN, "columns": ["8", "9"]}
    assert values(log(tmp_path, text, by_name, delimiter="|", header=True)) == [[5.0, 9.0]]


def test_a_range_of_columns_is_written_out(tmp_path: Path) -> None:
    text = "t,p10,p9,p8,q01,q02\n0,10,9,8,1,2\n"
    recording = log(tmp_path, text, {**SKIN, "columns": ["p8..p10", "q01..q02"]})
    assert values(recording) == [[8.0, 9.0, 10.0, 1.0, 2.0]]
    assert "'p9..q3' is no range" in refusal(tmp_path, text, {**SKIN, "columns": "p9..q3"})
    vast = {**SKIN, "columns": "1..2000000000"}
    assert "'1..2000000000' is more than 10000 columns" in refusal(tmp_path, text, vast)


def test_what_ranges_write_out_is_bounded_in_sum(tmp_path: Path) -> None:
    text = "0,1\n"
    many = {**SKIN, "columns": ["1..5001", "1..5000"]}
    assert "sensor.columns: a reading has more than 10000 columns" in refusal(tmp_path, text, many)
    pads = {f"pad_{number}": {**SKIN, "columns": "1..10000"} for number in range(11)}
    sentence = refusal(tmp_path, text, readings=pads)
    assert "its readings have more than 100000 columns" in sentence


def test_a_name_that_a_range_repeats_is_bounded(tmp_path: Path) -> None:
    long = {**SKIN, "columns": "p" * 1000 + "1..9"}
    sentence = refusal(tmp_path, "0,1\n", long)
    assert "'pppppppppppppppppppp…' is a range of more than 500 characters" in sentence


@pytest.mark.parametrize(
    ("scale", "problem"), [(0, "a factor of 0 leaves nothing"), ("deg", "no column is an angle")]
)
def test_a_scale_that_no_wrench_has_is_refused(scale: Any, problem: str) -> None:
    with pytest.raises(ConfigurationError, match=problem):
        WrenchColumns(type="wrench", frame="a", columns=(1, 2, 3, 4, 5, 6), scale=scale)


@pytest.mark.parametrize(
    "reading",
    [
        {"type": "odometry", "child_frame": "base", "columns": "c1..c7"},
        {"type": "twist", "columns": "c1..c6"},
        {"type": "joint_state", "names": ["a"], "columns": "c1..c3"},
        {
            "type": "joint_state",
            "names": ["a"],
            "columns": "c1..c2",
            "holds": ["positions", "efforts"],
        },
    ],
)
def test_degrees_for_columns_that_are_no_angles_are_refused(
    reading: dict[str, Any], tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError, match="scale: not every column is an angle: give a"):
        log(tmp_path, "0,180\n", {"frame": "odom", "scale": "deg", **reading})


def test_degrees_become_radians(tmp_path: Path) -> None:
    reading = {"type": "joint_state", "frame": "base", "names": ["a"], "columns": 2, "scale": "deg"}
    (only,) = readings(log(tmp_path, "0,180\n", reading))
    assert only.positions == pytest.approx([np.pi])


def test_a_log_without_stamps_has_a_rate(tmp_path: Path) -> None:
    recording = log(tmp_path, "0,5\n0,6\n0,7\n", SKIN, time={"rate": 240, "start": 2.0})
    assert recording.epoch_ns == 2_000_000_000
    assert stamps(recording) == [0.0, 0.004166667, 0.008333333]


@pytest.mark.parametrize(
    ("unit", "cell"),
    [("s", "1743486221.5907585"), ("ns", "1743486221590758500"), ("us", "1743486221590758.5")],
)
def test_unix_times_keep_their_nanoseconds(tmp_path: Path, unit: str, cell: str) -> None:
    if np.finfo(np.longdouble).nmant < 63:
        pytest.skip("the long double of this platform is no longer than a double")
    recording = log(tmp_path, f"{cell},5\n", SKIN, time={"column": 1, "unit": unit})
    assert recording.epoch_ns == 1743486221590758500


def test_rows_a_little_out_of_order_are_sorted_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    recording = log(tmp_path, "0.0,1\n0.2,3\n0.1,2\n0.2,4\n", SKIN)
    assert values(recording) == [[1.0], [2.0], [3.0], [4.0]]
    assert isinstance(recording, LogRecording)
    assert len(recording.notes) == 1
    assert "1 of 4 rows were out of order" in recording.notes[0]
    assert recording.notes[0] in caplog.text


def test_a_clock_that_was_set_back_is_refused(tmp_path: Path) -> None:
    assert "time falls by 8 s at row 3" in refusal(tmp_path, "0,1\n10,2\n2,3\n", SKIN)


def test_a_row_with_a_missing_value_gives_no_reading_and_is_counted(tmp_path: Path) -> None:
    recording = log(tmp_path, "0,1\n1,\n2,nan\n3,inf\n4,5\n", SKIN)
    assert values(recording) == [[1.0], [5.0]]
    assert "3 of 5 rows give no reading of 'sensor'" in recording.notes[0]


def test_a_missing_value_of_one_sensor_leaves_the_other_alone(tmp_path: Path) -> None:
    both = {"left": SKIN, "right": {**SKIN, "columns": 3}}
    recording = log(tmp_path, "0,1,\n1,,2\n2,3,4\n", readings=both)
    assert [one.sensor for one in readings(recording)] == ["left", "right", "left", "right"]


def test_a_lost_marker_stays(tmp_path: Path) -> None:
    reading = {"type": "markers", "frame": "lab", "names": ["a", "b"], "columns": "2..7"}
    recording = log(tmp_path, "0,1,2,3,,,\n", reading)
    (only,) = readings(recording)
    np.testing.assert_array_equal(only.positions, [[1, 2, 3], [np.nan] * 3])
    assert recording.notes == []


def test_several_files_are_merged_by_their_stamps(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("10.0,1\n10.2,2\n")
    (tmp_path / "b.csv").write_text("10100,3\n10300,4\n")
    skin = {"type": "tactile_image", "frame": "pad", "columns": 2}
    recording = open_recording(
        {
            "type": "log",
            "files": [
                {"file": "a.csv", "time": {"column": 1}, "readings": {"a": skin}},
                {"file": "b.csv", "time": {"column": 1, "unit": "ms"}, "readings": {"b": skin}},
            ],
        },
        tmp_path,
    )
    assert recording.epoch_ns == 10_000_000_000
    assert [(one.stamp, one.sensor) for one in recording.readings()] == [
        (0.0, "a"),
        (0.1, "b"),
        (0.2, "a"),
        (0.3, "b"),
    ]


def test_of_one_stamp_the_joints_come_before_what_they_place(tmp_path: Path) -> None:
    joints = {"type": "joint_state", "frame": "base", "names": ["a"], "columns": [2]}
    rows = log(tmp_path, HEADER + "0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n",
               readings={"force": WRIST, "joints": joints})  # fmt: skip
    assert [type(each) for each in readings(rows)] == [JointState, Wrench] * 2
    assert [*rows.topics] == ["force", "joints"]


def test_the_stamps_of_one_file_serve_another_row_by_row(tmp_path: Path) -> None:
    (tmp_path / "clock.csv").write_text("stamp\n5\n6\n")
    time = {"file": "clock.csv", "column": "stamp"}
    assert stamps(log(tmp_path, "0,1\n0,2\n", SKIN, time=time)) == [0.0, 1.0]
    assert "holds 2 stamps for the 3 rows" in refusal(tmp_path, "0,1\n0,2\n0,3\n", SKIN, time=time)


def arrays(folder: Path, name: str, columns: Sequence[int | str], column: int | str) -> Any:
    return open_recording(
        {
            "type": "log",
            "file": name,
            "time": {"column": column, "unit": "ns"},
            "readings": {"skin": {"type": "tactile_image", "frame": "pad", "columns": columns}},
        },
        folder,
    )


def test_numpy_files_are_logs_too(tmp_path: Path) -> None:
    clock = np.array([1743486221590758501, 1743486221590758503])
    images = np.arange(12.0).reshape(2, 3, 2)
    np.savez(tmp_path / "a.npz", t=clock, left=images, right=np.array([7, 8]))
    recording = arrays(tmp_path, "a.npz", ["left", "right"], "t")
    assert values(recording) == [[0, 1, 2, 3, 4, 5, 7], [6, 7, 8, 9, 10, 11, 8]]
    assert stamps(recording) == [0.0, 2e-9]

    np.save(tmp_path / "a.npy", np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 5.0]]))
    assert values(arrays(tmp_path, "a.npy", [3, 2], 1)) == [[3, 2], [5, 4]]

    fields = np.array([(1, 2.5), (2, 3.5)], dtype=[("t", "i8"), ("p", "f4")])
    np.save(tmp_path / "b.npy", fields)
    assert values(arrays(tmp_path, "b.npy", ["p"], "t")) == [[2.5], [3.5]]


def test_broken_numpy_files_are_refused(tmp_path: Path) -> None:
    def refused(name: str, columns: Sequence[int | str], column: int | str) -> str:
        with pytest.raises(RecordingError) as caught:
            arrays(tmp_path, name, columns, column)
        return str(caught.value)

    path = tmp_path / "a.npz"
    np.savez(path, t=np.arange(9), p=np.arange(9.0), q=np.arange(8.0), words=np.array(["x"] * 9))
    assert "no array 'pp'; did you mean 'p'?" in refused("a.npz", ["pp"], "t")
    assert "no array 2" in refused("a.npz", [2], "t")
    assert "unequal lengths: 'p' 9, 'q' 8" in refused("a.npz", ["p", "q"], "t")
    assert "'words' is no array of numbers" in refused("a.npz", ["words"], "t")
    path.write_bytes(path.read_bytes()[:300])
    assert "is cut off, or holds no NumPy arrays" in refused("a.npz", ["p"], "t")

    path = tmp_path / "a.npy"
    np.save(path, np.ones((9, 3)))
    assert "has columns 1 to 3, not 4" in refused("a.npy", [4], 1)
    assert "has no field 'p'" in refused("a.npy", ["p"], 1)
    path.write_bytes(path.read_bytes()[:200])
    assert "is cut off, or holds no NumPy arrays" in refused("a.npy", [2], 1)
    np.save(path, np.array([{}]), allow_pickle=True)
    assert "holds no NumPy arrays" in refused("a.npy", [2], 1)


@pytest.mark.parametrize(
    ("text", "reading", "reason"),
    [
        ("0,1,2\n1,x,2\n", SKIN, "line 2: column 2 holds 'x', not a number"),
        (HEADER + "# c\n0,1,2,3,4,5,oh\n", WRIST, "line 3: column 'tz' holds 'oh'"),
        (HEADER + "0,1,2,3,4,5,6\n", {**WRIST, "columns": ["fx1"]}, "did you mean 'fx'?"),
        (HEADER + "0,1,2,3,4,5,6\n", {**WRIST, "columns": ["fx", "fy"]}, "needs 6 columns"),
        ("0,1,2\n1,2,3\n2,", {**SKIN, "columns": 3}, "column 3 is missing"),
        ("0,1,2\n1,2,3\n2,", {**SKIN, "columns": 3}, "line 3"),
        ("0,1,2\n1,2,3\n2,", {**SKIN, "columns": 3}, "the file is cut off there"),
        ("0,1.5\n1,2.5\n2,-", SKIN, "holds '-', not a number; the file is cut off there"),
        ("0,1\n,2\n", SKIN, "row 2: nan s is no stamp"),
        ("1743486221590,1\n", SKIN, "is no stamp; is the column right, and its unit?"),
        (
            "1700000000000000000,1\n1700000000010000000,1\n",
            SKIN,
            "row 1: 1.7e+18 s is no stamp; `unit` is s: did you mean ns?",
        ),
        (
            "0,1\n3000000000,1\n6000000000,1\n",
            SKIN,
            "row 3: 6000000000.0 s is no stamp; `unit` is s: did you mean ns?",
        ),
        ("0,1\n", {**SKIN, "columns": 3}, "has columns 1 to 2, not 3"),
        ("0,1\n", {**SKIN, "columns": "p"}, "has no header that names column 'p'"),
        ("t,p,p\n0,1,1\n", {**SKIN, "columns": "p"}, "has 2 columns 'p'"),
        ("", SKIN, "holds no rows"),
        ("# nothing\n", SKIN, "holds no rows"),
        (HEADER, WRIST, "holds no rows"),
        ("0,1\n", {**SKIN, "scale": [1, 2]}, "has 2 scales for 1 columns"),
        (
            "0,1,2,3,1,1,1,1\n",
            {"type": "odometry", "frame": "w", "child_frame": "b", "columns": "2..8"},
            "row 1: the orientation of Odometry of 'sensor' is no unit quaternion",
        ),
    ],
)
def test_a_log_that_is_not_what_it_should_be_is_refused(
    tmp_path: Path, text: str, reading: dict[str, Any], reason: str
) -> None:
    assert reason in refusal(tmp_path, text, reading)


@pytest.mark.parametrize(
    ("text", "columns", "wanted"),
    [
        ('t, a, b, c\n0, "x, 5, y", 7, 8\n', ["b", "c"], [7.0, 8.0]),
        ('t, a, b, c\n0, "5", 7, 8\n', ["a", "b"], [5.0, 7.0]),
        ('t,a,b\n0,1,"2\n1,3,"4\n', ["a", "b"], [1.0, 2.0, 3.0, 4.0]),
    ],
)
def test_a_quoted_cell_is_one_cell_also_after_a_blank(
    tmp_path: Path, text: str, columns: list[str], wanted: list[float]
) -> None:
    found = values(log(tmp_path, text, {**SKIN, "columns": columns}))
    assert [value for row in found for value in row] == wanted


def test_blanks_that_part_cells_are_counted_once(tmp_path: Path) -> None:
    recording = log(tmp_path, "t a b\n0  5 7\n", {**SKIN, "columns": ["b"]}, delimiter=" ")
    assert values(recording) == [[7.0]]


def test_a_quoted_cell_with_white_space_is_one_cell(tmp_path: Path) -> None:
    skin = {**SKIN, "columns": ["b"]}
    assert values(log(tmp_path, 't a b c\n0 "x 5" 7 8\n', skin)) == [[7.0]]
    sentence = refusal(tmp_path, 't a b c\n0 "x 5" 7\n', skin)
    assert "log.csv, line 2: 3 cells under 4 names" in sentence
    open_quote = 't a b\n0 1 "2\n1 3 "4\n'
    sentence = refusal(tmp_path, open_quote, {**SKIN, "columns": ["a"]})
    assert "log.csv, line 2: a quote stays open" in sentence


def test_quotes_of_names_between_white_space_belong_to_them(tmp_path: Path) -> None:
    assert values(log(tmp_path, '"t" "a"\n0 5\n', {**SKIN, "columns": ['"a"']})) == [[5.0]]


@pytest.mark.parametrize("cell", ["1_000", "١٢"])
def test_what_only_python_takes_for_a_number_is_none(tmp_path: Path, cell: str) -> None:
    text = f"t,a\n0,1\n1,{cell}\n"
    sentence = refusal(tmp_path, text, {**SKIN, "columns": ["a"]})
    assert f"log.csv, line 3: column 'a' holds '{cell}', not a number" in sentence


@pytest.mark.parametrize("suffix", ["gz", "bz2", "xz"])
def test_a_table_that_is_not_compressed_as_its_name_says_is_refused(
    tmp_path: Path, suffix: str
) -> None:
    name = f"log.csv.{suffix}"
    (tmp_path / name).write_text("0,1\n1,2\n")
    with pytest.raises(RecordingError, match=rf"{name} is compressed by its name: unpack it"):
        arrays(tmp_path, name, [2], 1)


def test_columns_under_a_header_without_names_have_numbers(tmp_path: Path) -> None:
    assert values(log(tmp_path, ",\n0,5\n1,6\n", SKIN)) == [[5.0], [6.0]]


def test_a_row_without_a_wanted_column_that_has_no_name_is_refused(tmp_path: Path) -> None:
    sentence = refusal(tmp_path, "t,a,\n0,5,7\n1,6\n", {**SKIN, "columns": [3]})
    assert "log.csv, line 3: column 3 is missing: the line has 2 cells" in sentence


def test_a_log_that_is_not_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"0,1\n1,\xff\xfe\n")
    with pytest.raises(RecordingError, match="is no text in UTF-8"):
        arrays(tmp_path, "a.csv", [2], 1)


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ({"time": {}}, "give either column or rate"),
        ({"time": {"column": 1, "rate": 5}}, "give either column or rate"),
        ({"time": {"rate": 5, "unit": "ms"}}, "unit does not go with rate"),
        ({"time": {"column": 1, "start": 3}}, "start does not go with column"),
        ({"readings": {"a": {**SKIN, "colums": 2}}}, "did you mean 'columns'?"),
        (
            {"readings": {"a": {**SKIN, "type": "point_cloud"}}},
            "readings.a.type: a log can't hold readings of 'point_cloud'; the types are: joint_c",
        ),
        ({"readings": {"a": {**SKIN, "type": "wrnch"}}}, "did you mean 'wrench'? The types are: "),
        ({"readings": {"a": {"columns": 2}}}, "readings.a.type: this field is required; the types"),
        ({"readings": {"a": 3}}, "readings.a: 3 is none; write it as {type: wrench, frame: …}"),
        ({"readings": {"a": {**SKIN, "scale": "mm"}}}, "readings.a"),
        ({"type": "lag"}, "did you mean 'log'?"),
        ({"delimeter": ","}, "did you mean 'delimiter'?"),
    ],
)
def test_a_wrong_description_is_refused_and_named(
    tmp_path: Path, more: dict[str, Any], reason: str
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        log(tmp_path, "0,1\n", **{"readings": {"a": SKIN}, **more})
    assert reason in str(caught.value)
    assert str(tmp_path / "log.yaml") in str(caught.value)


def test_what_can_be_opened_is_listed(tmp_path: Path) -> None:
    for name in ("a.csv", "a.xyz"):
        (tmp_path / name).write_text("0,1\n")
    with pytest.raises(RecordingError, match="did you mean 'a.csv'"):
        open_recording("a.csw", tmp_path)
    with pytest.raises(RecordingError, match="a.csv needs a description of its columns"):
        open_recording("a.csv", tmp_path)
    with pytest.raises(RecordingError, match=r"what can: \.c3d, \.zip, \.txt"):
        open_recording(tmp_path / "a.xyz")
    with pytest.raises(ConfigurationError, match="type: this field is required"):
        open_recording({"file": "a.csv"}, tmp_path)


def test_the_presses_of_eflesh_pair_row_by_row() -> None:
    folder = real_data("eflesh/spatial_20250316")
    description = yaml.safe_load("""
type: log
files:
  - file: sensor_post_baselines.csv
    time: {column: 1}
    readings:
      skin: {type: tactile_image, frame: pad, columns: 2..16}
  - file: states.csv
    time: {file: sensor_post_baselines.csv, column: 1}
    readings:
      press: {type: markers, frame: robot, names: [press], columns: 2..4, scale: 0.001}
""")
    recording = open_recording(description, folder)
    both = readings(recording)
    images, presses = both[::2], both[1::2]
    assert len(images) == len(presses) == 4805
    assert [one.stamp for one in images] == [one.stamp for one in presses]
    assert {type(one) for one in images} == {TactileImage}
    assert {one.values.shape for one in images} == {(15,)}
    places = np.concatenate([one.positions for one in presses])
    np.testing.assert_allclose(places.min(axis=0), [0.274, -0.115, 0.141], atol=1e-4)
    np.testing.assert_allclose(places.max(axis=0), [0.304, -0.085, 0.145], atol=1e-4)
    assert recording.epoch_ns == 1742155052516165000


def test_a_wheelchair_hub_is_read_without_a_header() -> None:
    description = yaml.safe_load("""
type: log
file: pushrimkinetics_offsets_propulsion.csv
time: {rate: 240}
readings:
  wheel: {type: joint_state, frame: chair, names: [wheel], columns: 4, scale: deg}
  hub: {type: wrench, frame: chair, columns: 19..24}
""")
    both = readings(open_recording(description, real_data("force_plates")))
    assert len(both) == 2 * 7682
    wheel, hub = both[:2]
    assert wheel.positions == pytest.approx([np.radians(299.09)])
    np.testing.assert_array_equal(hub.force, [5.35, -9.07, 2.45])
    np.testing.assert_array_equal(hub.torque, [0.32, -0.07, 0.30])
    assert both[-1].stamp == pytest.approx(7681 / 240, abs=1e-9)


def test_rows_wider_than_the_header_are_refused_as_with_decimal_commas(tmp_path: Path) -> None:
    (tmp_path / "wide.csv").write_text("t,fx\n0,1,0,5\n0,2,0,6\n")
    with pytest.raises(RecordingError, match="line 2: 4 cells under 2 names; are commas meant"):
        open_recording(
            {
                "type": "log",
                "file": "wide.csv",
                "time": {"column": "t"},
                "readings": {"a": {"type": "tactile_image", "frame": "a", "columns": ["fx"]}},
            },
            tmp_path,
        )


def test_a_last_line_that_does_not_end_is_told_as_it_may_be_cut_off(tmp_path: Path) -> None:
    options = {
        "file": "cut.csv",
        "time": {"column": "t"},
        "readings": {"a": {"type": "tactile_image", "frame": "a", "columns": ["fx"]}},
    }
    told = []
    for text in ("t,fx\n0,11.907\n", "t,fx\n0,11."):
        (tmp_path / "cut.csv").write_text(text)
        recording = open_recording({"type": "log", **options}, tmp_path)
        assert isinstance(recording, LogRecording)
        told.append(recording.notes)
    assert told[0] == [] and "the last line does not end" in told[1][0]


# The unit of stamps

TOO_FAST = ", faster than any sensor; `unit` is"


def rows(period: float, count: int = 50) -> str:
    return "".join(f"{number * period:.9g},5\n" for number in range(count))


@pytest.mark.parametrize(
    ("period", "time", "sentence"),
    [
        (0.01, {"column": 1, "unit": "ms"}, f"are 1e+05 a second{TOO_FAST} ms: did you mean s?"),
        (0.1, {"column": 1, "unit": "ms"}, f"are 1e+04 a second{TOO_FAST} ms: did you mean s?"),
        (10.0, {"column": 1, "unit": "us"}, f"are 1e+05 a second{TOO_FAST} us: did you mean ms?"),
        (10.0, {"column": 1}, "rows are 10 s apart; `unit` is s: did you mean ms?"),
        (10_000.0, {"column": 1}, "rows are 10000 s apart; `unit` is s: did you mean us?"),
        (1.0, {"rate": 1e-4}, "rows are 10000 s apart; `rate` is 0.0001, in rows a second"),
        (1.0, {"rate": 1e6}, "faster than any sensor; `rate` is 1e+06, in rows a second"),
    ],
)  # fmt: skip
def test_stamps_in_another_unit_are_refused_with_the_unit_that_fits(
    tmp_path: Path, period: float, time: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(RecordingError) as caught:
        log(tmp_path, rows(period), SKIN, time=time)
    assert str(caught.value).startswith(f"{tmp_path / 'log.csv'}: ")
    assert str(caught.value).endswith(sentence)


@pytest.mark.parametrize("period", [1.25e-4, 0.01, 5.0])
def test_sensors_from_8_khz_to_one_row_in_5_s_pass(tmp_path: Path, period: float) -> None:
    assert log(tmp_path, rows(period), SKIN).notes == []


def test_a_few_rows_at_one_stamp_or_after_a_pause_say_nothing_of_the_unit(tmp_path: Path) -> None:
    assert log(tmp_path, rows(1e-6, 9), SKIN).notes == []
    assert log(tmp_path, "7,5\n" * 50, SKIN).notes == []
    assert log(tmp_path, rows(0.01) + "90000,5\n", SKIN).notes == []


@pytest.mark.parametrize(
    ("column", "time", "stated", "unit"),
    [
        ("timestamp_ms", {}, "ms", "s"),
        ("t [ms]", {"unit": "s"}, "ms", "s"),
        ("t(us)", {"unit": "ms"}, "us", "ms"),
        ("time_ns", {"unit": "us"}, "ns", "us"),
        ("seconds", {"unit": "ms"}, "s", "ms"),
    ],
)
def test_a_unit_that_the_name_of_the_column_contradicts_is_refused(
    tmp_path: Path, column: str, time: dict[str, str], stated: str, unit: str
) -> None:
    table = f"{column},value\n" + "".join(f"{2 * number},5\n" for number in range(50))
    said = refusal(tmp_path, table, SKIN, time={"column": column, **time})
    assert said == (
        f"{tmp_path / 'log.yaml'}: time.unit: the column '{column}' states {stated} by its name, "
        f"`unit` is {unit}: set unit: {stated}, or, where the name is wrong, name the column by "
        "its number"
    )
    by_number = readings(log(tmp_path, table, SKIN, time={"column": 1, "unit": "s"}))
    assert by_number[-1].stamp == 98.0


@pytest.mark.parametrize("column", ["t", "stamp", "timestamp_ms", "Time (msecs)"])
def test_a_unit_that_the_name_of_the_column_states_or_leaves_open_passes(
    tmp_path: Path, column: str
) -> None:
    table = f"{column},value\n" + "".join(f"{2 * number},5\n" for number in range(50))
    found = readings(log(tmp_path, table, SKIN, time={"column": column, "unit": "ms"}))
    assert found[-1].stamp == pytest.approx(0.098)


def test_a_row_with_more_or_fewer_cells_is_refused_by_its_line(tmp_path: Path) -> None:
    row = "0.1,1,2,3,4,5,6\n"
    more = "0.2,1,5,2,3,4,5,6\n"  # a decimal comma shifts all that follow
    said = refusal(tmp_path, HEADER + row + more)
    assert "log.csv, line 3: 8 cells under 7 names; are commas meant as decimal points?" in said
    unnamed = {**WRIST, "columns": [2, 3, 4, 5, 6, 7]}
    said = refusal(tmp_path, row + row.replace("0.1", "0.2") + more, reading=unnamed)
    assert "log.csv, line 3: 8 cells under 7 in the first line" in said
    said = refusal(tmp_path, HEADER + row + "0.2,1,2\n" + row)
    assert "line 3: column 'fz' is missing: the line has 3 cells" in said
    wide = HEADER.replace("tz", "tz,note") + row.replace("6", '6,"a, b"') + "0.2,1,2,3,4,5,6\n"
    assert "line 3: 7 cells under 8 names" in refusal(tmp_path, wide)
    spaced = {"column": 1, "unit": "s"}
    assert "line 2: 3 cells under 2 in" in refusal(tmp_path, "0.1 5\n0.2 5 6\n", SKIN, time=spaced)


def test_delimiters_at_the_end_and_in_quotes_are_no_cells(tmp_path: Path) -> None:
    ends = 't,level,note,\n0.1,5,a\n0.2,6,"b, c",\n0.3,7,,\n0.4,8,d,,,\n'
    assert values(log(tmp_path, ends, SKIN)) == [[5.0], [6.0], [7.0], [8.0]]


def test_a_cell_longer_than_any_is_refused(tmp_path: Path) -> None:
    assert "field larger than" in refusal(tmp_path, f'{HEADER}0.1,"{"x" * 200_000}\n')
