"""Arrays in npz files: what is wrong with one is said in a sentence."""

import os
import sys
from pathlib import Path
from subprocess import Popen

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError
from contactfusion.files import read_npz, unfinished, write_npz, write_whole


def test_what_was_written_is_read_bit_for_bit(tmp_path: Path) -> None:
    first, second = np.random.default_rng(0).normal(size=(3, 2)), np.array(7)
    write_npz(tmp_path / "arrays", first=first, second=second)
    again = read_npz(tmp_path / "arrays", "second", "first")
    assert [array.tobytes() for array in again] == [second.tobytes(), first.tobytes()]


def test_a_missing_file_is_an_error_with_the_nearest_name(tmp_path: Path) -> None:
    write_npz(tmp_path / "map.npz", a=1)
    with pytest.raises(ConfigurationError, match="did you mean 'map.npz'"):
        read_npz(tmp_path / "mep.npz", "a")


def test_a_name_longer_than_any_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="can't be read: File name too long"):
        read_npz(tmp_path / ("x" * 300), "a")


@pytest.mark.parametrize("length", [0, 1, 10, 100, -30])
def test_a_file_that_is_cut_off_is_an_error(tmp_path: Path, length: int) -> None:
    path = tmp_path / "map.npz"
    write_npz(path, a=np.arange(100))
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(ConfigurationError, match="map.npz is no npz file of numbers"):
        read_npz(path, "a")


def test_other_numpy_files_are_errors(tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    np.save(tmp_path / "one.npy", np.arange(3))
    (tmp_path / "one.npy").rename(path)
    with pytest.raises(ConfigurationError, match="is no npz file"):
        read_npz(path, "a")
    np.savez(path, a=np.array([{}], dtype=object))
    with pytest.raises(ConfigurationError, match="is no npz file of numbers"):
        read_npz(path, "a")


def test_a_missing_array_is_an_error_that_names_the_others(tmp_path: Path) -> None:
    write_npz(tmp_path / "map.npz", signals=1, places=2)
    with pytest.raises(ConfigurationError, match="lacks sigma; it holds signals, places"):
        read_npz(tmp_path / "map.npz", "signals", "sigma")


def test_what_a_killed_writer_left_goes_with_the_next_one(tmp_path: Path) -> None:
    path = tmp_path / "a[1].csv"
    dead = Popen([sys.executable, "-c", ""])
    dead.wait()
    mine = unfinished(tmp_path / "elsewhere" / path.name).name.rpartition(".")[0]
    assert mine.endswith(f".{os.getpid()}")
    prefix = mine.removesuffix(str(os.getpid()))
    kept = ["b.csv", f"{prefix}{os.getpid()}.00", f"{prefix}x.00", ".a[1].csv.other.1.00"]
    gone = [f"{prefix}{dead.pid}.00", f"{prefix}{dead.pid}.01"]
    fresh = f"{prefix}{dead.pid}.02"
    for name in (*kept, *gone, fresh):
        (tmp_path / name).write_text("parts")
    (tmp_path / gone[1]).unlink()
    (tmp_path / gone[1] / "recording").mkdir(parents=True)
    for name in (*kept, *gone):
        os.utime(tmp_path / name, (0, 0))
    write_whole(path, "whole")
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted([*kept, fresh, path.name])


def test_a_recording_of_a_killed_process_is_named_and_kept(tmp_path: Path) -> None:
    dead = Popen([sys.executable, "-c", ""])
    dead.wait()
    path = tmp_path / "live.mcap"
    hidden = unfinished(tmp_path / "elsewhere" / path.name).name.split(".")
    hidden[-2] = str(dead.pid)
    left = tmp_path / ".".join(hidden) / "recording" / "recording.mcap"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"parts")
    write_whole(tmp_path / "a.csv", "whole")
    assert (tmp_path / "live.cut.mcap").read_bytes() == b"parts"
