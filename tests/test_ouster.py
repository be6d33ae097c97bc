"""Ouster files: the environment that converts them, the converter, and what is made of scans."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion import cli
from contactfusion.doctor import installation
from contactfusion.errors import ConfigurationError, DependencyError, RecordingError
from contactfusion.readings import PointCloud
from contactfusion.recordings import ouster, ouster_converter
from contactfusion.recordings.ouster_converter import ConversionError
from contactfusion.recordings.ros import RosConfig, RosRecording
from tests.real_data import real_data

EPOCH = 1_651_329_893_557_452_800


class Scan:
    """What the SDK gives of a scan of three rings and four columns, one of which is missing."""

    def __init__(self, stamp: int) -> None:
        self.ranges = np.array([[1000, 0, 2000, 0], [500, 600, 700, 0], [1, 2, 3, 0]], np.uint32)
        self.timestamp = np.array([stamp, stamp + 1, stamp + 2, 0], np.uint64)
        self.status = np.array([1, 1, 1, 0])

    def field(self, name: str) -> Any:
        assert name == "RANGE"
        return self.ranges

    def complete(self) -> bool:
        return False


def project(scan: Scan) -> Any:
    return scan.ranges[:, :, None] * np.array([1e-3, 2e-3, -1e-3])


@pytest.fixture
def scans(monkeypatch: pytest.MonkeyPatch) -> list[Scan]:
    """Put scans in place of those that the SDK reads."""
    pytest.importorskip("mcap.writer")
    found = [Scan(EPOCH), Scan(EPOCH + 100_000_000)]
    monkeypatch.setattr(
        ouster_converter, "_scans", lambda source, meta: ((scan, project) for scan in found)
    )
    return found


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Let the user's data lie where there is none."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return tmp_path / "data" / "contactfusion" / "ouster"


@pytest.fixture
def ready() -> None:
    if not ouster.is_ready():
        pytest.skip(f"there is no environment for Ouster files: {ouster.COMMAND}")


def clouds(path: Path) -> list[PointCloud]:
    readings = RosRecording(RosConfig(file=path)).readings()
    return [one for one in readings if isinstance(one, PointCloud)]


# The converter


def test_a_scan_becomes_an_organised_cloud_with_nan_for_no_return(
    scans: list[Scan], tmp_path: Path
) -> None:
    out = tmp_path / "new" / "scan.mcap"
    told = ouster_converter.convert(Path("scan.osf"), out)
    assert told == f"{out}: 2 scans of 3 rings and 4 columns; columns are missing in 2"
    assert [one.name for one in out.parent.iterdir()] == ["scan.mcap"]
    first, second = clouds(out)
    assert (first.frame, first.sensor) == ("os_sensor", "ouster/points")
    assert (first.stamp, second.stamp) == (0.0, 0.1)
    assert RosRecording(RosConfig(file=out)).epoch_ns == EPOCH
    seen = scans[0].ranges > 0
    grid = first.points.reshape(3, 4, 3)
    assert np.isnan(grid[~seen]).all()
    np.testing.assert_allclose(grid[seen], project(scans[0])[seen], rtol=1e-6)


def test_the_cloud_has_its_ranges_beside_its_points(scans: list[Scan], tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    factory = pytest.importorskip("mcap_ros2.decoder").DecoderFactory()
    ouster_converter.convert(Path("scan.osf"), tmp_path / "scan.mcap")
    with (tmp_path / "scan.mcap").open("rb") as file:
        messages = reader.make_reader(file, decoder_factories=[factory]).iter_decoded_messages()
        (*_, cloud), _ = messages
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "range"]
    assert (cloud.height, cloud.width, cloud.point_step) == (3, 4, 16)
    ranges = np.frombuffer(cloud.data, "<f4").reshape(3, 4, 4)[:, :, 3]
    told = np.where(np.isnan(ranges), 0.0, 1000.0 * ranges)
    np.testing.assert_allclose(told, scans[0].ranges, rtol=1e-6)


def test_rows_can_be_left_out(scans: list[Scan], tmp_path: Path) -> None:
    ouster_converter.convert(Path("scan.osf"), tmp_path / "all.mcap")
    told = ouster_converter.convert(Path("scan.osf"), tmp_path / "some.mcap", every_nth_row=2)
    assert "2 scans of 2 rings and 4 columns" in told
    whole = clouds(tmp_path / "all.mcap")[0].points.reshape(3, 4, 3)
    some = clouds(tmp_path / "some.mcap")[0].points.reshape(2, 4, 3)
    np.testing.assert_array_equal(some, whole[::2])
    with pytest.raises(ConversionError, match="not the 0th"):
        ouster_converter.convert(Path("scan.osf"), tmp_path / "none.mcap", every_nth_row=0)


def test_without_a_scan_nothing_is_written(scans: list[Scan], tmp_path: Path) -> None:
    scans.clear()
    with pytest.raises(ConversionError, match="there is no scan in scan.osf"):
        ouster_converter.convert(Path("scan.osf"), tmp_path / "scan.mcap")
    assert not list(tmp_path.iterdir())


def test_a_scan_of_which_no_column_came_is_left_out(scans: list[Scan], tmp_path: Path) -> None:
    scans[0].status[:] = 0
    assert "1 scan of 3" in ouster_converter.convert(Path("scan.osf"), tmp_path / "scan.mcap")


def test_a_place_that_cannot_be_written_is_one_sentence(
    scans: list[Scan], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert ouster_converter.main(["scan.osf", str(tmp_path / "file" / "scan.mcap")]) == 1
    said = capsys.readouterr().err
    assert "scan.mcap can't be written: " in said and said.count("\n") == 1


# The environment


def test_without_the_environment_the_command_that_makes_it_is_told(
    elsewhere: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not ouster.is_ready()
    with pytest.raises(DependencyError, match="make it by: contactfusion doctor --ouster"):
        ouster.convert(Path("scan.osf"), tmp_path / "scan.mcap")
    installation.check()
    assert "Ouster files need: contactfusion doctor --ouster" in capsys.readouterr().out


def test_the_environment_is_made_once(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    commands: list[tuple[str, ...]] = []

    def run(command: tuple[str, ...], **options: Any) -> subprocess.CompletedProcess[str]:
        commands.append(command)
        (elsewhere / "bin").mkdir(parents=True, exist_ok=True)
        (elsewhere / "bin" / "python").touch()
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(ouster, "_python", lambda: elsewhere / "bin" / "python")
    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setattr(sys, "argv", ["contactfusion", "doctor", "--ouster"])
    for _ in range(2):
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert not end.value.code
    make, install = commands
    assert make[1:] == ("-m", "venv", "--clear", str(elsewhere))
    assert install[-len(ouster.REQUIREMENTS) :] == ouster.REQUIREMENTS
    said = capsys.readouterr().out
    assert said.count("making an environment for ouster-sdk==1.0.0") == 1
    assert said.count("convert by: contactfusion convert SOURCE OUT.mcap") == 2
    installation.check()
    assert "Ouster files can be converted: contactfusion convert" in capsys.readouterr().out
    monkeypatch.setattr(ouster, "REQUIREMENTS", ("ouster-sdk==1.0.1",))
    assert not ouster.is_ready()  # it holds something else than what is wanted by now


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("ERROR: No matching distribution found\nWARNING: pip is old\n", "No matching distribut"),
        ("it broke\n", "it broke"),
        ("", "no reason was given"),
    ],
)
def test_an_environment_that_cannot_be_made_is_one_sentence(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch, said: str, told: str
) -> None:
    def run(command: tuple[str, ...], **options: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 1, "", said)

    monkeypatch.setattr(subprocess, "run", run)
    with pytest.raises(DependencyError, match=f"can't be made: {told}") as error:
        ouster.make_environment()
    assert "WARNING" not in str(error.value)
    assert not ouster.is_ready()


# Real files


@pytest.fixture
def folder(ready: None) -> Path:
    return real_data("ouster")


REAL = {
    "512x10_raw.bag": [(128, 512)],
    "windowed_frame1.pcap": [(128, 512)],
    "OS-0-128_v3.0.1_1024x10_20241017_141645.osf": [(128, 1024)] * 3,
    "OS-0-128-U1_v2.3.0_1024x10.pcap": [(128, 1024)],
    "OS-0-32-U1_v2.2.0_1024x10.pcap": [(32, 1024)],
    "osf_fw_3.2_10scans.osf": [(8, 2048)] * 10,
}


@pytest.mark.parametrize("name", REAL)
def test_real_files_are_converted(folder: Path, tmp_path: Path, name: str) -> None:
    told = ouster.convert(folder / name, tmp_path / "scans.mcap")
    rings, columns = REAL[name][0]
    assert f"of {rings} rings and {columns} columns" in told
    found = clouds(tmp_path / "scans.mcap")
    assert [len(one.points) for one in found] == [rings * columns for rings, columns in REAL[name]]
    for one in found:
        seen = one.points[np.isfinite(one.points).all(axis=1)]
        assert len(seen) > 0.1 * len(one.points)
        distances = np.linalg.norm(seen, axis=1)
        assert distances.min() > 0.15 and distances.max() < 300.0
    steps = np.diff([one.stamp for one in found[1:]])
    np.testing.assert_allclose(steps, 0.1, atol=1e-3)


def test_every_fourth_row_of_a_real_scan_is_the_row_it_was(folder: Path, tmp_path: Path) -> None:
    source = folder / "512x10_raw.bag"
    ouster.convert(source, tmp_path / "all.mcap")
    ouster.convert(source, tmp_path / "some.mcap", every_nth_row=4)
    whole = clouds(tmp_path / "all.mcap")[0].points.reshape(128, 512, 3)
    some = clouds(tmp_path / "some.mcap")[0].points.reshape(32, 512, 3)
    np.testing.assert_array_equal(some, whole[::4])


def test_a_description_elsewhere_can_be_named(folder: Path, tmp_path: Path) -> None:
    name = "OS-0-32-U1_v2.2.0_1024x10"
    (tmp_path / "alone.pcap").write_bytes((folder / f"{name}.pcap").read_bytes())
    with pytest.raises(RecordingError, match="alone.pcap can't be read: .*metadata; name it by"):
        ouster.convert(tmp_path / "alone.pcap", tmp_path / "scans.mcap")
    meta = folder / f"{name}.json"
    told = ouster.convert(tmp_path / "alone.pcap", tmp_path / "scans.mcap", meta=meta)
    assert "1 scan of 32 rings" in told


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("missing.osf", None, "there is no file"),
        ("scan.osf", b"none", "scan.osf can't be read: "),
        ("scan.bag", b"none", "scan.bag can't be read: "),
        ("scan.txt", b"none", "scan.txt can't be read: .*file extension"),
        ("--help", b"none", "--help can't be read: "),
    ],
)
def test_what_is_no_recording_is_one_sentence(
    ready: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    content: bytes | None,
    told: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    if content is not None:
        Path(name).write_bytes(content)
    with pytest.raises(RecordingError, match=told) as error:
        ouster.convert(Path(name), Path("scans.mcap"))
    assert "\n" not in str(error.value)
    assert not Path("scans.mcap").exists()


@pytest.mark.parametrize(
    ("name", "kept", "told"),
    [
        ("OS-0-128_v3.0.1_1024x10_20241017_141645.osf", 900_000, "describes no sensor"),
        ("osf_fw_3.2_10scans.osf", 100_000, "there is no scan in"),
        ("512x10_raw.bag", 100_000, "can't be read: .*damaged"),
    ],
)
def test_a_file_that_is_cut_off_is_one_sentence(
    folder: Path, tmp_path: Path, name: str, kept: int, told: str
) -> None:
    cut = tmp_path / name
    cut.write_bytes((folder / name).read_bytes()[:kept])
    with pytest.raises(RecordingError, match=told):
        ouster.convert(cut, tmp_path / "scans.mcap")


def test_what_is_converted_is_not_replaced_and_the_output_is_an_mcap(tmp_path: Path) -> None:
    source = tmp_path / "scan.osf"
    source.write_bytes(b"packets")
    with pytest.raises(ConfigurationError, match="would replace what is read, scan.osf"):
        ouster.convert(source, source)
    with pytest.raises(ConfigurationError, match="let it end in .mcap"):
        ouster.convert(source, tmp_path / "scan.bag")
    assert source.read_bytes() == b"packets"
