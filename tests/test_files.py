"""Arrays in npz files: what is wrong with one is said in a sentence."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen, run

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError, WritingError
from contactfusion.files import (
    read_json,
    read_npz,
    require_settings,
    require_spared,
    write_npz,
    write_whole,
)


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


@pytest.mark.parametrize(("make", "kind"), [(os.mkdir, "a folder"), (os.mkfifo, "no regular file")])
def test_what_is_no_file_is_not_replaced(
    make: Callable[[Path], None], kind: str, tmp_path: Path
) -> None:
    make(tmp_path / "out.csv")
    mode = (tmp_path / "out.csv").stat().st_mode
    with pytest.raises(WritingError, match=f"out.csv can't be written: it is {kind}"):
        write_whole(tmp_path / "out.csv", "")
    assert (tmp_path / "out.csv").stat().st_mode == mode


def test_a_link_to_an_output_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "a.csv").symlink_to("there/b.csv")
    for text in ("first", "second"):
        write_whole(tmp_path / "a.csv", text)
        assert (tmp_path / "a.csv").is_symlink()
        assert (tmp_path / "there" / "b.csv").read_text() == text


def test_an_output_that_is_a_link_to_itself_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "a.csv").symlink_to("a.csv")
    with pytest.raises(ConfigurationError, match="--out: .*a.csv is a link that leads to itself"):
        require_spared("--out", tmp_path / "a.csv", [])


def test_a_device_is_no_regular_file() -> None:
    with pytest.raises(ConfigurationError, match="^/dev/zero is no regular file$"):
        read_npz(Path("/dev/zero"), "a")


def test_a_link_to_nothing_is_no_hint_to_itself(tmp_path: Path) -> None:
    (tmp_path / "map.npz").symlink_to("none.npz")
    with pytest.raises(ConfigurationError, match=r"there is no file 'map\.npz' in [^;]*$"):
        read_npz(tmp_path / "map.npz", "a")


@pytest.mark.parametrize(
    ("text", "times"), [(b"", 1), (b"{", 1), (b"\xff\xfe", 1), (b"[", 100_000), (b"9", 5000)]
)
def test_what_is_no_json_is_a_sentence(tmp_path: Path, text: bytes, times: int) -> None:
    (tmp_path / "card.json").write_bytes(text * times)
    with pytest.raises(ConfigurationError, match=r"card\.json is no JSON text, or is cut off"):
        read_json(tmp_path / "card.json")


@pytest.mark.parametrize("times", [1, 100_000])
@pytest.mark.parametrize("text", ["[", "[[1, 2]]", "null", "\x00"])
def test_settings_that_are_damaged_are_a_sentence(tmp_path: Path, text: str, times: int) -> None:
    (tmp_path / "settings.json").write_text(text * times)
    with pytest.raises(ConfigurationError, match=r"settings\.json is damaged: give another --out"):
        require_settings({"a": 1}, tmp_path)


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


WRITER = """
import sys
from pathlib import Path
from contactfusion.files import unfinished
with unfinished(Path(sys.argv[1]), is_folder=sys.argv[1].endswith(".mcap")) as hidden:
    if hidden.is_dir():
        (hidden / "recording").mkdir()
        (hidden / "recording" / "recording.mcap").write_bytes(b"parts")
    else:
        hidden.write_text("parts")
    print(hidden, flush=True)
    sys.stdin.read()
"""


@contextmanager
def writing(path: Path) -> Iterator[tuple[Path, "Popen[str]"]]:
    """What another process is writing, for an hour already, and that process."""
    command = [sys.executable, "-c", WRITER, str(path)]
    with Popen(command, stdin=PIPE, stdout=PIPE, text=True) as process:
        assert process.stdout is not None
        hidden = Path(process.stdout.readline().strip())
        os.utime(hidden, (0, 0))
        yield hidden, process


def test_what_a_killed_writer_left_goes_with_the_next_one(tmp_path: Path) -> None:
    with (
        writing(tmp_path / "a[1].csv") as (old, killed),
        writing(tmp_path / "b.csv") as (new, other),
    ):
        for process in (killed, other):
            process.kill()
            process.wait()
    os.utime(new)
    strange = tmp_path / ".a[1].csv.other.1.00"
    strange.write_text("parts")
    os.utime(strange, (0, 0))
    write_whole(tmp_path / "a[1].csv", "whole")
    assert not old.exists()
    assert set(tmp_path.iterdir()) == {new, strange, tmp_path / "a[1].csv"}


def test_what_is_being_written_is_left_alone(tmp_path: Path) -> None:
    with writing(tmp_path / "live.mcap") as (hidden, _), writing(tmp_path / "a.csv") as (other, _):
        write_whole(tmp_path / "b.csv", "whole")
        assert set(tmp_path.iterdir()) == {hidden, other, tmp_path / "b.csv"}


@pytest.mark.parametrize("name", ["live.mcap", "l" * 250 + ".mcap", "é" * 120 + ".mcap"])
def test_a_recording_of_a_killed_process_is_named_and_kept(name: str, tmp_path: Path) -> None:
    with writing(tmp_path / name) as (_, process):
        process.kill()
    write_whole(tmp_path / "a.csv", "whole")
    (cut,) = tmp_path.glob("*.cut.mcap")
    assert cut.read_bytes() == b"parts"
    assert name.startswith(cut.name.removesuffix(".cut.mcap"))


NAMES = (
    ".a.unfinished",
    "..0badcafe.unfinished",
    "....0badcafe.unfinished",
    ".v.mcap.aaaa.unfinished",
)


@pytest.mark.parametrize("name", NAMES)
def test_a_folder_that_no_writer_named_is_left_alone(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "above" / "d"
    (folder / name).mkdir(parents=True)
    (folder / name / "x.mcap").write_text("hello")
    os.utime(folder / name, (0, 0))
    write_whole(folder / "o.txt", "whole")
    assert {*tmp_path.rglob("*")} == {
        folder.parent, folder, folder / "o.txt", folder / name, folder / name / "x.mcap"
    }  # fmt: skip


@pytest.mark.parametrize("name", [".a.unfinished", ".a.csv.0badcafe.unfinished"])
def test_a_pipe_by_the_name_of_what_is_written_delays_no_writer(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    command = [sys.executable, "-c", WRITER, str(tmp_path / "o.txt")]
    run(command, stdin=DEVNULL, stdout=DEVNULL, timeout=20.0, check=True)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_what_links_lead_to_is_not_taken_for_an_unfinished_recording(tmp_path: Path) -> None:
    folder, other = tmp_path / "d", tmp_path / "other"
    left = folder / ".v.mcap.0badcafe.unfinished"
    for made in (left, other):
        made.mkdir(parents=True)
    (other / "x.mcap").write_text("hello")
    (left / "x.mcap").symlink_to(other / "x.mcap")
    (folder / ".w.mcap.0badcafe.unfinished").symlink_to(other)
    write_whole(folder / "o.txt", "whole")
    assert not [*folder.glob("*.cut.mcap")]
    assert (other / "x.mcap").read_text() == "hello"


def test_arrays_that_are_encrypted_are_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, a=np.zeros(3))
    content = bytearray(path.read_bytes())
    content[6] |= 1
    content[content.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(bytes(content))
    with pytest.raises(ConfigurationError):
        read_npz(path)
