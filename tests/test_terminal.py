"""What a command shows beside its results: only on a terminal, only on stderr, never if quiet."""

import io
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from numba import njit

from contactfusion.terminal import COMPILING, followed, is_quiet, note, progress, say, set_quiet

Printed = pytest.CaptureFixture[str]


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


def contactfusion(redirected: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Call the command line in a shell that redirects its streams."""
    words = f"{sys.executable} -m contactfusion plugins tactile {redirected}"
    given = {**os.environ, **environment}
    return subprocess.run(words, shell=True, env=given, capture_output=True, text=True)


def test_a_stream_that_is_closed_loses_only_what_is_printed_there() -> None:
    assert contactfusion(">&-").returncode == contactfusion("2>&-").returncode == 0


def test_a_full_disk_under_stdout_is_a_sentence() -> None:
    ended = contactfusion(">/dev/full")
    assert ended.returncode == 1
    assert ended.stderr == "contactfusion: the output: No space left on device\n"


def test_what_an_encoding_lacks_is_escaped(tmp_path: Path) -> None:
    named = tmp_path / "\N{GREEK SMALL LETTER ALPHA}.yaml"
    words = [sys.executable, "-m", "contactfusion", "check", str(named)]
    given = {**os.environ, "PYTHONIOENCODING": "ascii"}
    ended = subprocess.run(words, env=given, capture_output=True, text=True)
    assert ended.returncode == 1
    assert ended.stderr.startswith(r"contactfusion: there is no file '\u03b1.yaml'")


@dataclass
class Step:
    stamp: float


def screen_of(monkeypatch: pytest.MonkeyPatch) -> Screen:
    """Give a terminal in place of stderr; within a test, as capturing replaces it before."""
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    return screen


@pytest.fixture
def quiet() -> Iterator[None]:
    set_quiet(True)
    yield
    set_quiet(False)


def test_a_note_is_printed_unless_quiet(capsys: Printed) -> None:
    note("12 steps")
    assert capsys.readouterr() == ("12 steps\n", "")


@pytest.mark.usefixtures("quiet")
def test_quiet_has_no_notes_and_no_progress(
    monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    screen = screen_of(monkeypatch)
    note("12 steps")
    assert is_quiet() and list(followed([Step(0.0), Step(1.0)], "replaying")) == [
        Step(0.0),
        Step(1.0),
    ]
    assert screen.getvalue() == "" and capsys.readouterr().out == ""


def test_a_pipe_sees_no_progress(capsys: Printed) -> None:
    assert [step.stamp for step in followed([Step(0.0), Step(1.0)], "replaying", 2.0)] == [0.0, 1.0]
    assert capsys.readouterr() == ("", "")


def test_a_terminal_sees_how_far_it_is_on_stderr_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    screen = screen_of(monkeypatch)
    for _ in followed([Step(0.5)], "replaying [drive].mcap", 2.0):
        pass
    assert "replaying [drive].mcap" in screen.getvalue() and "0.5 of 2.0 s" in screen.getvalue()
    assert capsys.readouterr().out == ""


def test_progress_is_wiped_away_at_the_end_of_a_part_that_is_watched(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    screen = screen_of(monkeypatch)
    steps = followed([Step(0.5), Step(1.0)], "replaying")
    next(steps)
    steps.close()
    assert screen.getvalue().endswith("\x1b[2K")


def test_the_first_compilation_of_kernels_is_announced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    screen = screen_of(monkeypatch)

    doubled = njit(lambda number: 2.0 * number)  # in no cache
    with progress("running"):
        assert COMPILING not in screen.getvalue()
        assert doubled(2.0) == 4.0
        assert doubled(2.0) == 4.0
    shown = screen.getvalue()
    assert COMPILING in shown and shown.rindex("running") > shown.rindex(COMPILING)


def test_a_name_that_holds_control_sequences_is_printed_as_text(
    capsys: pytest.CaptureFixture[str],
) -> None:
    name = "frame \x1b]0;owned\x07\x1b[2J\r\x08\u202e größe 腕\n\tnext"
    say(name)
    note(name)
    line = "frame \\x1b]0;owned\\x07\\x1b[2J\\r\\x08\\u202e größe 腕\\n\\tnext\n"
    assert capsys.readouterr().out == 2 * line


def test_texts_of_several_lines_keep_them(capsys: Printed) -> None:
    say("a\n\tb\x1b", lines=True)
    note("c\nd", lines=True)
    assert capsys.readouterr().out == "a\n\tb\\x1b\nc\nd\n"


def test_the_type_of_a_generator_adds_no_line_to_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(
        'generators: {skin: {type: "a\\nOK\\n", sensor: skin}}\nintegrator: {frame: base}\n'
    )
    command = [sys.executable, "-m", "contactfusion", "check", str(path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "'a\\nOK\\n'" in done.stderr and len(done.stderr.splitlines()) == 1


def test_errors_and_warnings_of_a_command_hold_no_control_sequences(tmp_path: Path) -> None:
    path = tmp_path / "\x1b[31mred.yaml"
    command = [sys.executable, "-m", "contactfusion", "check", str(path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "\\x1b[31mred.yaml" in done.stderr and "\x1b" not in done.stderr
