"""Force plates, markers and events from C3D files."""

import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import DependencyError, RecordingError
from contactfusion.readings import Markers, Transform, Wrench
from contactfusion.recordings.c3d import C3DRecording
from contactfusion.recordings.opening import open_recording
from tests.real_data import real_data

ezc3d = pytest.importorskip("ezc3d")

CORNERS = np.array([[0.0, 600.0, 0.0], [400.0, 600.0, 0.0], [400.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
"""Of a plate [mm] whose x, y and z axes are the lab's -x, y and -z, as these corners tell."""


def c3d_file(
    folder: Path,
    *,
    lengths: str = "mm",
    torques: str = "Nmm",
    depth: float = 0.0,
    first_frame: int = 0,
    plates: bool = True,
) -> Path:
    """Write 5 frames of 3 points at 100 Hz, and of a plate at 1 kHz that bears 100 N."""
    scale = {"mm": 1.0, "m": 0.001}[lengths]
    content = ezc3d.c3d()
    content["header"]["points"]["first_frame"] = first_frame
    point = content["parameters"]["POINT"]
    point["RATE"]["value"] = [100.0]
    point["UNITS"]["value"] = [lengths]
    point["LABELS"]["value"] = ["HEEL", "TOE", "KNEE_ANGLE"]
    content.add_parameter("POINT", "ANGLES", ["KNEE_ANGLE"])
    points = np.ones((4, 3, 5))
    points[:3] = np.arange(15.0).reshape(3, 1, 5) * scale
    points[:3, 1, 2] = np.nan
    content["data"]["points"] = points
    content["parameters"]["ANALOG"]["RATE"]["value"] = [1000.0]
    content["parameters"]["ANALOG"]["LABELS"]["value"] = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
    content.add_parameter("ANALOG", "UNITS", ["N"] * 3 + [torques] * 3)
    moment = np.array([-1000.0, 2000.0, -3000.0]) * {"Nmm": 1.0, "Nm": 0.001}[torques]
    content["data"]["analogs"] = np.tile([[[-1.0], [2.0], [-100.0], *moment[:, None]]], 50)
    content.add_event([0, 1.53], "Left", "Foot Off")
    content.add_event([0, 1.52], "Right", "Foot Strike")
    if plates:
        content.add_parameter("FORCE_PLATFORM", "CORNERS", (CORNERS.T * scale)[..., None])
        origin = np.array([[0.0], [0.0], [-depth * scale]])
        content.add_parameter("FORCE_PLATFORM", "ORIGIN", origin)
        whole = {"USED": [1], "TYPE": [2], "ZERO": [1, 0], "CHANNEL": [[i + 1] for i in range(6)]}
        for name, value in whole.items():
            content.add_parameter("FORCE_PLATFORM", name, np.array(value, dtype=float))
            kept = content["parameters"]["FORCE_PLATFORM"][name]
            kept["type"], kept["value"] = ezc3d.ezc3d.INT, np.array(value)
    path = folder / "walk.c3d"
    content.write(str(path))
    return path


def opened(path: Path) -> C3DRecording:
    recording = open_recording(path)
    assert isinstance(recording, C3DRecording)
    return recording


def of_type(recording: C3DRecording, kind: type[Any]) -> list[Any]:
    return [reading for reading in recording.readings() if type(reading) is kind]


def refusal(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        open_recording(path)
    return str(caught.value)


@pytest.mark.parametrize("lengths, torques", [("mm", "Nmm"), ("m", "Nm"), ("mm", "Nm")])
def test_a_plate_gives_what_presses_on_it(tmp_path: Path, lengths: str, torques: str) -> None:
    recording = opened(c3d_file(tmp_path, lengths=lengths, torques=torques))
    wrenches = of_type(recording, Wrench)
    assert len(wrenches) == 50
    np.testing.assert_allclose([one.stamp for one in wrenches], np.arange(50) / 1000.0, atol=1e-12)
    for wrench in wrenches:
        assert wrench.sensor == wrench.frame == "plate_0"
        np.testing.assert_allclose(wrench.force, [-1, -2, -100])
        np.testing.assert_allclose(wrench.torque, [-1, -2, -3], rtol=1e-6)


def test_the_torque_is_brought_to_the_surface(tmp_path: Path) -> None:
    wrench = of_type(opened(c3d_file(tmp_path, depth=40.0)), Wrench)[0]
    shift = np.cross([0.0, 0.0, -0.04], [-1.0, -2.0, -100.0])
    np.testing.assert_allclose(wrench.torque, np.array([-1.0, -2.0, -3.0]) + shift, rtol=1e-6)


def test_the_frame_of_a_plate_is_at_the_centre_of_its_surface(tmp_path: Path) -> None:
    recording = opened(c3d_file(tmp_path))
    np.testing.assert_allclose(recording.corners["plate_0"], CORNERS * 0.001, atol=1e-7)
    frame = recording.frames()["plate_0"]
    assert frame.parent == "lab"
    assert frame.xyz == pytest.approx((0.2, 0.3, 0.0))
    np.testing.assert_array_equal(frame.pose()[:3, :3], np.eye(3))


@pytest.mark.parametrize("lengths", ["mm", "m"])
def test_markers_are_in_metres_lost_ones_nan_and_angles_left_out(
    tmp_path: Path, lengths: str
) -> None:
    markers = of_type(opened(c3d_file(tmp_path, lengths=lengths)), Markers)
    assert [one.stamp for one in markers] == [0.0, 0.01, 0.02, 0.03, 0.04]
    assert {(one.sensor, one.frame, one.names) for one in markers} == {
        ("markers", "lab", ("HEEL", "TOE"))
    }
    np.testing.assert_allclose(markers[1].positions, [[0.001, 0.006, 0.011]] * 2, rtol=1e-6)
    np.testing.assert_array_equal(np.isnan(markers[2].positions), [[False] * 3, [True] * 3])


def test_first_it_says_where_plates_stand_and_of_one_stamp_markers_come_first(
    tmp_path: Path,
) -> None:
    kinds = [type(one) for one in opened(c3d_file(tmp_path)).readings()]
    assert kinds[:13] == [Transform, Markers, *[Wrench] * 10, Markers]


def test_the_frame_of_a_plate_is_told_as_a_static_transform(tmp_path: Path) -> None:
    recording = opened(c3d_file(tmp_path))
    (told,) = of_type(recording, Transform)
    assert (told.frame, told.child_frame, told.static) == ("lab", "plate_0", True)
    assert tuple(told.position) == recording.frames()["plate_0"].xyz


def test_topics_name_every_sensor_and_its_kind(tmp_path: Path) -> None:
    recording = opened(c3d_file(tmp_path))
    measured = {one.sensor: type(one) for one in recording.readings() if one.sensor != "tf_static"}
    assert recording.topics == measured


def test_the_clock_is_that_of_the_original_trial(tmp_path: Path) -> None:
    recording = opened(c3d_file(tmp_path, first_frame=152))
    assert recording.epoch_ns == 1_520_000_000
    assert next(recording.readings()).stamp == 0.0
    strike, off = recording.events
    assert (strike.label, strike.context) == ("Foot Strike", "Right")
    assert (off.label, off.context) == ("Foot Off", "Left")
    assert (strike.stamp, off.stamp) == pytest.approx((0.0, 0.01), abs=1e-6)


def test_a_file_without_plates_gives_markers(tmp_path: Path) -> None:
    recording = opened(c3d_file(tmp_path, plates=False))
    assert {type(one) for one in recording.readings()} == {Markers}
    assert recording.frames() == {}


def test_a_zip_may_hold_the_file(tmp_path: Path) -> None:
    path = c3d_file(tmp_path)
    packed = tmp_path / "walk.c3d.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        archive.write(path, "folder/walk.c3d")
    assert len(of_type(opened(packed), Wrench)) == 50
    with zipfile.ZipFile(packed, "a") as archive:
        archive.writestr("__MACOSX/folder/._walk.c3d", "what macOS adds")
    assert len(of_type(opened(packed.rename(tmp_path / "WALK.C3D.ZIP")), Wrench)) == 50
    packed = tmp_path / "WALK.C3D.ZIP"
    with zipfile.ZipFile(packed, "a") as archive:
        archive.write(path, "other.c3d")
    assert "must hold one C3D file, not 2" in refusal(packed)
    packed.write_bytes(packed.read_bytes()[:100])
    assert "is cut off, or no zip file" in refusal(packed)


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_zip_with_a_wrong_byte_is_refused_whatever_packed_it(tmp_path: Path, method: int) -> None:
    packed = tmp_path / "walk.c3d.zip"
    with zipfile.ZipFile(packed, "w", method) as archive:
        archive.write(c3d_file(tmp_path), "walk.c3d")
    content = bytearray(packed.read_bytes())
    content[60:90] = bytes(byte ^ 255 for byte in content[60:90])
    packed.write_bytes(content)
    assert str(packed) in refusal(packed)


def test_broken_files_are_refused(tmp_path: Path) -> None:
    path = c3d_file(tmp_path)
    whole = path.read_bytes()
    assert "did you mean 'walk.c3d'" in refusal(tmp_path / "wlk.c3d")
    path.write_bytes(whole[:-200])
    assert "is cut off: it holds 4 of 5 frames" in refusal(path)
    for content in (whole[:1000], whole[:300], b"", b"hello\n" * 100):
        path.write_bytes(content)
        assert "can't be read as C3D" in refusal(path)


def test_a_file_that_crashes_or_hangs_its_library_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("contactfusion.recordings.c3d.SECONDS", 2.0)
    path = c3d_file(tmp_path)
    whole = path.read_bytes()
    crashing = bytearray(whole)
    crashing[803] ^= 0x80
    path.write_bytes(crashing)
    assert "it crashes the library that reads it (SIGSEGV)" in refusal(path)
    path.write_bytes(whole[:770])
    assert "it took longer than it may" in refusal(path)


@pytest.mark.parametrize("at", range(512, 1500, 90))
def test_a_byte_that_is_wrong_is_no_traceback(tmp_path: Path, at: int) -> None:
    path = c3d_file(tmp_path)
    broken = bytearray(path.read_bytes())
    broken[at] ^= 0xFF
    path.write_bytes(broken)
    try:
        list(open_recording(path).readings())
    except RecordingError as error:
        assert "\n" not in str(error)


def test_a_shift_in_an_unclear_unit_is_refused(tmp_path: Path) -> None:
    assert "lengths in mm but torques of plate 0 in another unit" in refusal(
        c3d_file(tmp_path, torques="Nm", depth=40.0)
    )


def test_without_ezc3d_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = c3d_file(tmp_path)
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(DependencyError, match=r"pip install 'contactfusion\[c3d\]'"):
        open_recording(path)


def test_a_walk_presses_where_the_foot_is() -> None:
    """The line of action meets the floor near the line from heel to toe."""
    recording = opened(real_data("force_plates/walk.c3d.zip"))
    wrenches, markers = of_type(recording, Wrench), of_type(recording, Markers)
    assert len(wrenches) == 4 * 4420 and len(markers) == 221
    clock = [one.stamp for one in markers]
    errors = []
    for plate, side in (("plate_3", "R"), ("plate_1", "L")):
        on_plate = [one for one in wrenches if one.sensor == plate and one.force[2] < -60.0]
        feet = []
        for name in (side + "HEE", side + "TOE"):
            track = np.array([one.positions[one.names.index(name)] for one in markers])
            stamps = [one.stamp for one in on_plate]
            feet.append(np.stack([np.interp(stamps, clock, axis) for axis in track.T], axis=1))
        heel, toe = (foot[:, :2] for foot in feet)
        force = np.array([one.force for one in on_plate])
        nearest = np.cross(force, [one.torque for one in on_plate])
        nearest /= (force**2).sum(axis=1, keepdims=True)
        floor = nearest - nearest[:, 2:] / force[:, 2:] * force
        floor += recording.frames()[plate].xyz
        along = (toe - heel) / np.linalg.norm(toe - heel, axis=1, keepdims=True)
        offset = floor[:, :2] - heel
        errors.append(np.abs(along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0]))
    lateral = np.concatenate(errors)
    assert lateral.size == 2650
    assert np.median(lateral) == pytest.approx(0.00393, abs=2e-5)
    assert lateral.max() < 0.012


def test_the_events_of_a_walk_are_on_its_clock() -> None:
    events = opened(real_data("force_plates/walk.c3d.zip")).events
    assert len(events) == 8
    assert (events[-2].label, events[-2].context) == ("Foot Strike", "Left")
    assert events[-2].stamp == pytest.approx(1.81, abs=1e-6)
