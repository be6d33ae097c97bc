"""The command line: exit status, one sentence an error, and nothing half-written."""

import csv
import errno
import json
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml
from typer.main import get_command

from contactfusion import cli
from contactfusion.integrator.rules import DeMorgan
from contactfusion.plugins import Plugins, installed_plugins

RUN = """\
recording:
  type: log
  file: wrist.csv
  time: {column: t}
  readings:
    wrist: {type: wrench, frame: tool, columns: [fx, fy, fz, tx, ty, tz]}
generators:
  wrist: {type: force_torque, sign: on_robot, force_noise: 0.1, torque_noise: 0.01}
surface:
  frame: tool
  shapes: [{shape: sphere, radius: 0.05}]
frames:
  tool: {parent: base}
integrator: {frame: base, voxel_size: 0.005}
cycle: {on: wrist}
"""
LOG_YAML = """\
type: log
file: wrist.csv
time: {column: t}
readings:
  wrist: {type: wrench, frame: tool, columns: [fx, fy, fz, tx, ty, tz]}
"""
LOG = ["t,fx,fy,fz,tx,ty,tz"] + [f"{n / 100:.2f},0,0,-5,0,0,0" for n in range(5)]


class Answer(NamedTuple):
    status: int
    out: str
    err: str


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a folder with a configuration and its recording, and work in it."""
    (tmp_path / "wrist.yaml").write_text(RUN)
    (tmp_path / "wrist.csv").write_text("\n".join(LOG) + "\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def ask(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> "Ask":
    return Ask(monkeypatch, capsys)


class Ask:
    """Calls the command line in this very process; an exception that gets out fails the test."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch, self._capsys = monkeypatch, capsys

    def __call__(self, *arguments: str) -> Answer:
        self._monkeypatch.setattr(sys, "argv", ["contactfusion", *arguments])
        self._capsys.readouterr()
        try:
            cli.main()
            status = 0
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
        said = self._capsys.readouterr()
        return Answer(status, said.out, said.err)


def one_sentence(answer: Answer) -> str:
    """Give the complaint, which is one line that starts with the name of the program."""
    assert answer.status == 1
    (line,) = answer.err.splitlines()
    assert line.startswith("contactfusion: ") and "Traceback" not in answer.err
    return line.removeprefix("contactfusion: ")


# What works


def test_a_run_writes_contacts_and_a_summary(folder: Path, ask: Ask) -> None:
    answer = ask("run", "wrist.yaml", "--out", "results")
    assert (answer.status, answer.err) == (0, "")
    rows = list(csv.DictReader((folder / "results" / "contacts.csv").read_text().splitlines()))
    summary = json.loads((folder / "results" / "summary.json").read_text())
    assert len(rows) == summary["contacts"] > 0 and summary["steps"] == 5
    assert summary["sources"]["wrist"]["invalid"] == 0
    assert float(rows[0]["z"]) == pytest.approx(0.05, abs=0.01)
    assert {entry.name for entry in (folder / "results").iterdir()} == {
        "contacts.csv",
        "summary.json",
    }


def test_equal_runs_write_equal_bytes(folder: Path, ask: Ask) -> None:
    for name in ("one", "two"):
        assert ask("run", "wrist.yaml", "--out", name).status == 0
    for file in ("contacts.csv", "summary.json"):
        assert (folder / "one" / file).read_bytes() == (folder / "two" / file).read_bytes()


def test_a_field_can_be_changed_on_the_command_line(folder: Path, ask: Ask) -> None:
    quiet = "generators.wrist.min_force=9"
    assert ask("run", "wrist.yaml", "--set", quiet, "--out", "quiet").status == 0
    assert json.loads((folder / "quiet" / "summary.json").read_text())["contacts"] == 0


def commands() -> Iterator[tuple[str, ...]]:
    """Every command and group, as one calls it."""
    waiting: list[tuple[tuple[str, ...], Any]] = [((), get_command(cli.app))]
    while waiting:
        words, command = waiting.pop()
        yield words
        inner = getattr(command, "commands", {})
        waiting += [((*words, name), one) for name, one in inner.items()]


@pytest.mark.parametrize("words", [*commands()], ids=" ".join)
def test_every_command_and_group_has_a_short_help_and_can_be_quiet(
    words: tuple[str, ...], ask: Ask
) -> None:
    short, long = ask(*words, "-h"), ask(*words, "--help")
    assert short == long and short.status == 0 and not short.err
    assert "--quiet" in short.out and "-h" in short.out


def test_units_in_brackets_are_seen_in_the_help(ask: Ask) -> None:
    for words in commands():
        raw = " ".join(
            getattr(option, "help", None) or ""
            for option in getattr(command_at(words), "params", [])
        )
        units = re.findall(r"\[(?:s|m|N)\]", raw)
        assert Counter(re.findall(r"\[(?:s|m|N)\]", ask(*words, "-h").out)) == Counter(units)


def command_at(words: tuple[str, ...]) -> Any:
    command: Any = get_command(cli.app)
    for word in words:
        command = command.commands[word]
    return command


def test_the_version_is_that_of_the_package(ask: Ask) -> None:
    assert ask("--version") == Answer(0, f"contactfusion {version('contactfusion')}\n", "")


def test_the_package_is_a_program() -> None:
    command = [sys.executable, "-m", "contactfusion", "--version"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, f"contactfusion {version('contactfusion')}\n")


@pytest.mark.parametrize(
    "arguments",
    [
        ("--quiet", "run", "wrist.yaml"),
        ("run", "wrist.yaml", "--quiet"),
        ("run", "-q", "wrist.yaml"),
    ],
)
def test_quiet_prints_the_results_line_alone(
    arguments: tuple[str, ...], folder: Path, ask: Ask
) -> None:
    expected = "results: out/run/contacts.csv, out/run/summary.json\n"
    assert ask(*arguments) == Answer(0, expected, "")
    assert ask("run", "wrist.yaml").out.startswith("input ")  # quiet lasts for one command


def test_quiet_keeps_errors(folder: Path, ask: Ask) -> None:
    assert "wirst.yaml" in one_sentence(ask("-q", "run", "wirst.yaml"))


def test_a_replay_can_be_quiet(folder: Path, ask: Ask) -> None:
    (folder / "log.yaml").write_text(LOG_YAML)
    told = ask("replay", "wrist.yaml", "log.yaml", "--out", "contacts.csv", "-q")
    assert told == Answer(0, "results: contacts.csv\n", "")


def test_a_recording_is_inspected(folder: Path, ask: Ask) -> None:
    (folder / "log.yaml").write_text(LOG_YAML)
    shown = ask("inspect", "log.yaml")
    assert shown.status == 0 and "wrist" in shown.out and "force_torque" in shown.out
    told = json.loads(ask("inspect", "log.yaml", "--json").out)
    assert told["topics"][0]["reading"] == "Wrench"
    assert "did you mean 'log.yaml'" in one_sentence(ask("inspect", "lag.yaml"))


def test_a_first_configuration_is_written_once(folder: Path, ask: Ask) -> None:
    (folder / "log.yaml").write_text(LOG_YAML)
    assert ask("init", "log.yaml", "--out", "first.yaml").status == 0
    assert ask("replay", "first.yaml", "log.yaml").status == 0
    assert "--force replaces it" in one_sentence(ask("init", "log.yaml", "--out", "first.yaml"))
    again = ask("init", "log.yaml", "--out", "first.yaml", "--force", "-q")
    assert again == Answer(0, "results: first.yaml\n", "")


def test_a_window_is_refused_before_anything_is_replayed(
    folder: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rerun")
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("contactfusion.run.session.Session.__init__", None)
    (folder / "log.yaml").write_text(LOG_YAML)
    for arguments in (
        ("view", "log.yaml", "--config", "wrist.yaml"),
        ("replay", "wrist.yaml", "log.yaml", "--view", "--out", "contacts.csv"),
    ):
        sentence = one_sentence(ask(*arguments))
        assert all(cure in sentence for cure in ("no screen", "--web", "--screenshot", "--save"))
    assert not (folder / "contacts.csv").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ("view", "log.yaml", "--config", "wrist.yaml"),
        ("view", "log.yaml", "--config", "wrist.yaml", "--web"),
        ("replay", "wrist.yaml", "log.yaml", "--view"),
    ],
)
def test_a_viewer_that_is_not_installed_is_told_before_a_screen_that_is_not_there(
    arguments: tuple[str, ...], folder: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.setattr("contactfusion.run.session.Session.__init__", None)
    (folder / "log.yaml").write_text(LOG_YAML)
    assert "install it with: pip install 'contactfusion[view]'" in one_sentence(ask(*arguments))


@pytest.mark.parametrize("words", [*commands()], ids=" ".join)
def test_the_page_on_the_command_line_names_every_command(words: tuple[str, ...]) -> None:
    page = (Path(__file__).parents[1] / "docs" / "command_line.md").read_text()
    assert f"`{' '.join(words)}" in page


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["plugins"], ["doctor"]])
def test_a_question_is_answered(arguments: list[str], ask: Ask) -> None:
    answer = ask(*arguments)
    assert answer.status == 0 and answer.out and not answer.err


def test_the_options_of_a_plugin_are_told_with_defaults_and_meanings(ask: Ask) -> None:
    answer = ask("plugins", "force_torque")
    assert answer.status == 0
    assert all(word in answer.out for word in ("force_torque (generator)", "timeout", "meaning"))


@pytest.mark.parametrize("name", ["de_morgan", "cluster_centroid", "sets", "members"])
def test_a_plugin_without_options_is_told_by_its_first_sentence(name: str, ask: Ask) -> None:
    answer = ask("plugins", name)
    assert answer.status == 0 and answer.out.startswith(f"{name} (")


# What does not


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "wirst.yaml"], ["wirst.yaml", "did you mean 'wrist.yaml'"]),
        (["run", "no/such.yaml"], ["no/such.yaml"]),
        (["run", "."], ["is a folder"]),
        (["plugins", "force_torqe"], ["force_torqe", "did you mean 'force_torque'"]),
    ],
)
def test_what_is_not_there_is_named_with_the_nearest_that_is(
    arguments: list[str], words: list[str], folder: Path, ask: Ask
) -> None:
    sentence = one_sentence(ask(*arguments))
    assert all(word in sentence for word in words), sentence


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("integrator.voxle_size=0.01", ["integrator.voxle_size", "did you mean 'voxel_size'"]),
        ("integrator.voxel_size=-1", ["integrator.voxel_size", "the limit is 1e-05 m", "-1"]),
        ("integrator.voxel_size=.nan", ["integrator.voxel_size", "finite"]),
        ("integrator.threshold=1.5", ["integrator.threshold", "less than or equal to 1"]),
        ("integrator.rule=de_morgn", ["de_morgn", "did you mean 'de_morgan'"]),
        ("generators.wrist.type=force_torqe", ["force_torqe", "did you mean 'force_torque'"]),
        ("generators.wrist.typ=force_torque", ["generators.wrist.typ", "unknown field"]),
        ("generators.wrist=3", ["generators.wrist"]),
        ("recording.type=lgo", ["recording.type", "did you mean 'log'"]),
        ("recording.file=wirst.csv", ["wirst.csv", "did you mean 'wrist.csv'"]),
        ("recording.time.column=s", ["wrist.csv", "'s'"]),
        ("recording={}", ["recording"]),
        ("surface.shapes.0.radius=-1", ["surface.shapes.0.radius", "greater than 0"]),
        ("frames.tool.parent=bas", ["'wrist' needs the surface", "frames"]),
        ("cycle.on=wirst", ["wirst"]),
        (
            "generators.wirst.average=0.2",
            [
                "'generators.wirst.average=0.2': there is no generator 'wirst'",
                "did you mean 'wrist'",
            ],
        ),
        (
            "cycle.every=0.1",
            ["ready, every, on; --set 'cycle={on: wrist}' replaces it whole"],
        ),
        ("cycle={every: 0.1, ready: true}", ["--set 'cycle=ready' replaces it whole"]),
        ("integrator.frame=world", ["'wrist' needs the surface", "frames"]),
        ("integrator", ["'integrator' is no change"]),
        ("integrtor.threshold=0.5", ["integrtor", "did you mean 'integrator'"]),
    ],
)
def test_a_wrong_configuration_is_one_sentence_that_names_the_field(
    change: str, words: list[str], folder: Path, ask: Ask
) -> None:
    sentence = one_sentence(ask("run", "wrist.yaml", "--set", change, "--out", "results"))
    assert all(word in sentence for word in words), sentence


def test_changes_can_bring_a_generator_of_their_own(folder: Path, ask: Ask) -> None:
    options = ("type=force_torque", "sensor=wrist", "sign=on_robot")
    changes = [word for option in options for word in ("--set", f"generators.other.{option}")]
    assert "generator 'other' (force_torque)" in ask("check", "wrist.yaml", *changes).out


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            ["generators.wrist.tare=0.5"],
            [
                "generators.wrist",
                "no cloud for any of its 5 readings",
                "span 0.04 s",
                "unit of time",
            ],
        ),
        (
            ["recording.readings.wrist.frame=tol"],
            ["every cloud of 'wrist' was refused", "'tol'", "did you mean 'tool'"],
        ),
        (
            ["faults=[{fault: zeros, sensor: wirst}]"],
            ["faults.0.sensor", "no reading of 'wirst' came", "did you mean 'wrist'"],
        ),
        (["faults=[{fault: zeros, sensor: twist}]"], ["no reading of 'twist'", "wrench, wrist"]),
    ],
)
def test_a_run_that_found_nothing_for_a_reason_says_it_and_keeps_its_results(
    changes: list[str], words: list[str], folder: Path, ask: Ask
) -> None:
    options = [word for change in changes for word in ("--set", change)]
    sentence = one_sentence(ask("run", "wrist.yaml", *options, "--out", "results"))
    assert all(word in sentence for word in words), sentence
    assert json.loads((folder / "results" / "summary.json").read_text())["steps"] == 5
    assert (folder / "results" / "contacts.csv").exists()


def test_what_was_found_before_a_run_broke_off_is_kept(folder: Path, ask: Ask) -> None:
    unfit = "faults=[{fault: bias, sensor: wrist, amount: 1.0, start: 0.03}]"
    assert "faults.0.amount" in one_sentence(
        ask("run", "wrist.yaml", "--set", unfit, "--out", "results")
    )
    assert json.loads((folder / "results" / "summary.json").read_text())["steps"] == 3
    assert len((folder / "results" / "contacts.csv").read_text().splitlines()) == 4


def test_a_sensor_that_fails_on_purpose_is_no_failure(folder: Path, ask: Ask) -> None:
    silent = ["--set", "cycle={every: 0.01}", "--set", "faults=[{fault: silent, sensor: wrist}]"]
    assert ask("run", "wrist.yaml", *silent, "--out", "results").status == 0


def test_a_fault_that_starts_after_the_end_is_told(folder: Path, ask: Ask) -> None:
    answer = ask("run", "wrist.yaml", "--set", "faults=[{fault: zeros, start: 9}]", "--out", "late")
    assert answer.status == 0
    assert "faults.0 did nothing: it starts at 9 s, after the end" in answer.out


def test_remarks_are_counted_with_their_likely_cause(folder: Path, ask: Ask) -> None:
    """A torque along the force is no single contact: here, what no tare has taken off."""
    log = [LOG[0], *(f"{n / 100:.2f},0,0,-5,0,0,1" for n in range(5))]
    (folder / "wrist.csv").write_text("\n".join(log) + "\n")
    answer = ask("run", "wrist.yaml", "--out", "results")
    assert answer.status == 0, "no contact alone is no error"
    assert "0 contacts" in answer.out and "5 × more than one contact: tare?" in answer.out
    summary = json.loads((folder / "results" / "summary.json").read_text())
    assert summary["sources"]["wrist"]["remarks"] == {"more than one contact": 5}


def test_readings_that_a_tare_takes_are_counted(folder: Path, ask: Ask) -> None:
    answer = ask("run", "wrist.yaml", "--set", "generators.wrist.tare=0.03", "--out", "results")
    assert answer.status == 0 and "wrist: 3 of 5 readings gave no cloud" in answer.out


def test_a_rare_remark_gets_no_cause(folder: Path, ask: Ask) -> None:
    (folder / "wrist.csv").write_text("\n".join([*LOG, "0.05,0,0,-5,0,0,1"]) + "\n")
    assert "1 × more than one contact\n" in ask("run", "wrist.yaml", "--out", "results").out


@pytest.mark.parametrize(
    "change", ["integrator.voxel_size=-1", "recording.file=wirst.csv", "recording.time.column=s"]
)
def test_a_run_that_cannot_start_writes_nothing(change: str, folder: Path, ask: Ask) -> None:
    before = sorted(folder.iterdir())
    one_sentence(ask("run", "wrist.yaml", "--set", change, "--out", "results"))
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (RUN[: RUN.index("frames:") - 4], ["wrist.yaml", "line"]),
        (RUN.replace("generators:", "generators: ["), ["wrist.yaml", "line"]),
        (RUN.replace("  wrist: {type: force", "\twrist: {type: force"), ["wrist.yaml", "line"]),
        ("", ["wrist.yaml is empty"]),
        ("- 1\n", ["wrist.yaml holds a list"]),
        ("\x00\xff", ["wrist.yaml"]),
        (RUN.replace("voxel_size", "voxle_size"), ["wrist.yaml", "did you mean 'voxel_size'"]),
    ],
    ids=["cut off", "bracket", "tab", "empty", "list", "bytes", "key"],
)
def test_a_file_that_is_no_configuration_is_one_sentence_that_names_it(
    text: str, words: list[str], folder: Path, ask: Ask
) -> None:
    (folder / "wrist.yaml").write_text(text, encoding="latin-1")
    sentence = one_sentence(ask("run", "wrist.yaml", "--out", "results"))
    assert all(word in sentence for word in words), sentence
    assert not (folder / "results").exists()


@pytest.mark.parametrize(
    "log",
    [LOG[:2] + ["0.01,0,0"], LOG[:2] + ["0.01,0,0,five,0,0,0"], [], [LOG[0]], ["\x00\x01"]],
    ids=["cut off", "no number", "empty", "no rows", "bytes"],
)
def test_a_log_that_is_broken_is_one_sentence_that_names_it(
    log: list[str], folder: Path, ask: Ask
) -> None:
    (folder / "wrist.csv").write_text("\n".join(log))
    assert "wrist.csv" in one_sentence(ask("run", "wrist.yaml", "--out", "results"))
    assert not (folder / "results").exists()


def test_a_list_that_several_faults_share_is_printed_once(folder: Path, ask: Ask) -> None:
    changes = ["cycle={on: nose}", "faults=[{fault: zeros, sensor: nose}]"]
    sets = [word for change in changes for word in ("--set", change)]
    answer = ask("check", "wrist.yaml", *sets)
    assert answer.status == 1
    assert [line.partition("the recording ")[2] for line in answer.err.splitlines()] == [
        "holds no 'nose'; the sensors and types are: wrench, wrist",
        "holds no 'nose'",
    ]


NESTED = (
    "wrist.yaml is a configuration that `contactfusion run wrist.yaml` runs, and no recording: "
    "give a YAML file that holds only what stands under its `recording`"
)


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (["inspect", "wrist.yaml"], NESTED),
        (["init", "wrist.yaml", "--out", "new.yaml"], NESTED),
        (["replay", "wrist.yaml", "wrist.yaml"], NESTED),
        (["explain", "wrist.yaml", "--time", "1", "--config", "wrist.yaml"], NESTED),
        (
            ["replay", "wrist.yaml"],
            "give the recording after wrist.yaml, or play the one that it names with "
            "`contactfusion run wrist.yaml`",
        ),
        (
            ["replay", "wrist.yaml", "wrist.csv"],
            "wrist.csv needs a description of its columns, a YAML file with 'type: log' and "
            "'file: wrist.csv': `contactfusion inspect wrist.csv` prints one to copy",
        ),
    ],
)
def test_a_configuration_where_a_recording_is_asked_for_is_told_what_to_give(
    command: list[str], sentence: str, folder: Path, ask: Ask
) -> None:
    assert one_sentence(ask(*command)) == sentence


@pytest.mark.parametrize("command", [["run"], ["check"], ["replay", "wrist.yaml"], ["record"]])
@pytest.mark.parametrize("recording", ["wrist.csv", "drive.bag"])
def test_a_recording_where_a_configuration_is_asked_for_is_told_what_to_give(
    command: list[str], recording: str, folder: Path, ask: Ask
) -> None:
    (folder / "drive.bag").write_bytes(b"#ROSBAG V2.0\n\x00\xff")
    command = [*command[:1], recording, *command[1:]]
    assert one_sentence(ask(*command)) == (
        f"{recording} is a recording, and no configuration: `contactfusion init {recording} --out "
        f"{recording.split('.')[0]}.yaml` writes a first configuration for it"
    )


@pytest.mark.parametrize(
    ("fields", "what"),
    [
        ("recording: {type: ros, file: drive.bag}", "give the one that it names, drive.bag"),
        ("scene: {type: push}", "give the one that `contactfusion record new.yaml` makes"),
        ("generators: {}", "give the recording that it is for"),
    ],
)
def test_what_to_give_for_a_configuration_is_what_it_names(
    fields: str, what: str, folder: Path, ask: Ask
) -> None:
    (folder / "new.yaml").write_text(fields)
    assert what in one_sentence(ask("inspect", "new.yaml"))


@pytest.mark.parametrize("what", [["explain", "--time", "0.04"], ["ablate"]])
def test_a_configuration_that_names_its_recording_is_asked_about_it(
    what: list[str], folder: Path, ask: Ask
) -> None:
    command, *options = what
    by_itself = ask(command, "wrist.yaml", *options)
    fields = yaml.safe_load((folder / "wrist.yaml").read_text())
    (folder / "log.yaml").write_text(yaml.safe_dump(fields["recording"]))
    assert by_itself.status == 0
    assert by_itself.out == ask(command, "log.yaml", "--config", "wrist.yaml", *options).out


ASKED = ("log.yaml", "--config", "wrist.yaml")


@pytest.mark.parametrize(
    ("command", "option", "out", "read"),
    [
        (("view", *ASKED), "--save", "log.yaml", "log.yaml"),
        (("view", *ASKED), "--screenshot", "wrist.csv", "wrist.csv"),
        (("explain", *ASKED, "--time", "0"), "--picture", "./log.yaml", "log.yaml"),
        (("explain", *ASKED, "--time", "0"), "--picture", "wrist.yaml", "wrist.yaml"),
        (("replay", "wrist.yaml", "log.yaml"), "--out", "wrist.csv", "wrist.csv"),
        (("run", "wrist.yaml"), "--out", "wrist.csv", "wrist.csv"),
        (("run", "named.yaml"), "--out", ".", "contacts.csv"),
        (("run", "bag.yaml"), "--out", "bag/a.mcap", "bag"),
        (("ablate", "ablation.yaml"), "--out", ".", "ablation.csv"),
        (("init", "wrist.csv", "--force"), "--out", "wrist.csv", "wrist.csv"),
        (("doctor", "arm.urdf"), "--out", "arm.urdf", "arm.urdf"),
    ],
)
def test_what_is_read_is_not_replaced(
    command: tuple[str, ...], option: str, out: str, read: str, folder: Path, ask: Ask
) -> None:
    (folder / "log.yaml").write_text(LOG_YAML)
    (folder / "contacts.csv").write_bytes((folder / "wrist.csv").read_bytes())
    (folder / "named.yaml").write_text(RUN.replace("wrist.csv", "contacts.csv"))
    (folder / "ablation.csv").write_bytes((folder / "wrist.csv").read_bytes())
    (folder / "ablation.yaml").write_text(RUN.replace("wrist.csv", "ablation.csv"))
    (folder / "arm.urdf").write_text('<robot name="arm"><link name="base"/></robot>')
    (folder / "bag").mkdir()
    (folder / "bag.yaml").write_text("recording: {type: ros, file: bag}")
    before = {path: path.read_bytes() for path in folder.glob("*.*")}
    sentence = one_sentence(ask(*command, option, out))
    assert sentence.startswith(f"{option}: ")
    assert sentence.endswith(f" would replace what is read, {read}; name another file")
    assert {path: path.read_bytes() for path in folder.glob("*.*")} == before


LINGERING = """
import sys, threading, time
import contactfusion.run.execute
from contactfusion import cli
def run(*_, **__):
    threading.Thread(target=time.sleep, args=(600,), name="of a camera").start()
contactfusion.run.execute.run_file, cli.LINGER = run, 0.5
sys.argv = ["contactfusion", "run", "wrist.yaml"]
cli.main()
"""


def test_a_thread_that_a_plugin_leaves_does_not_keep_the_program_from_its_end(folder: Path) -> None:
    command = [sys.executable, "-c", LINGERING]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=folder)
    assert (ran.returncode, ran.stdout) == (0, "")
    assert ran.stderr == "contactfusion: threads that did not end are left: 'of a camera'\n"


def test_a_signal_inside_numba_interrupts_the_program_after_it() -> None:
    compiler: dict[str, Any] = {"__name__": "numba.core.dispatcher", "signal": signal}
    exec("def load():\n    signal.raise_signal(signal.SIGTERM)\n    return 'loaded'", compiler)
    before = {each: signal.getsignal(each) for each in (signal.SIGTERM, signal.SIGALRM)}
    signal.signal(signal.SIGTERM, cli.interrupt)
    loaded = None
    try:
        with pytest.raises(KeyboardInterrupt):
            loaded = compiler["load"]()
            time.sleep(10.0)
        assert loaded == "loaded"
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_a_file_that_the_system_refuses_is_one_sentence(
    folder: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", "secret.yaml")

    monkeypatch.setattr("contactfusion.run.execute.run_file", refuse)
    assert one_sentence(ask("run", "wrist.yaml")) == "secret.yaml: Permission denied"


def test_results_lie_where_they_were_asked_for_though_a_plugin_changes_the_folder(
    folder: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "elsewhere").mkdir()
    fuse = DeMorgan.fuse

    def strays(*arguments: Any, **named: Any) -> Any:
        monkeypatch.chdir(folder / "elsewhere")
        return fuse(*arguments, **named)

    monkeypatch.setattr(DeMorgan, "fuse", strays)
    command = ("run", "wrist.yaml", "--set", "integrator.rule=de_morgan", "--out", "a.csv")
    assert ask(*command).status == 0
    assert Path.cwd().name == "elsewhere"
    assert len((folder / "a.csv").read_text().splitlines()) > 1


def test_a_log_comes_back_from_its_recording_whatever_its_sensor_is_called_and_when_it_starts(
    folder: Path, ask: Ask
) -> None:
    named = RUN.replace("wrist: {type", "left-wrist: {type").replace("on: wrist", "on: left-wrist")
    (folder / "left.yaml").write_text(named)
    assert ask("run", "left.yaml", "--out", "first.csv").status == 0
    assert ask("run", "left.yaml", "--out", "left.mcap").status == 0
    played = ask("run", "left.yaml", "left.mcap", "--out", "again.csv")
    assert played.status == 0 and "unreadable" not in played.out
    assert (folder / "again.csv").read_bytes() == (folder / "first.csv").read_bytes()
    assert ask("explain", "left.mcap", "--time", "0").out.startswith("0.000 s: 1 contact")
    assert "without a stamp" not in ask("inspect", "left.mcap").out.split("/left_wrist")[-1]


def test_a_tuning_does_not_go_on_with_another_log_of_the_same_name(folder: Path, ask: Ask) -> None:
    (folder / "log.yaml").write_text(LOG_YAML)
    (folder / "labels.csv").write_text("start,end,x,y,z\n0,0.01,0,0,-0.05\n0.02,0.04,0,0,-0.05\n")
    asked = ("tune", "fusion", "log.yaml", "--config", "wrist.yaml", "--labels", "labels.csv")
    tuning = (*asked, "--vary", "integrator.threshold=0.5,0.99", "--out", "tuned")
    assert ask(*tuning).status == 0
    (folder / "wrist.yaml").write_text(f"# of the left arm\n{RUN}")
    assert ask(*tuning).status == 0
    (folder / "wrist.csv").write_text("\n".join(LOG[:-1]) + "\n")
    assert "tuned holds work of other recording" in one_sentence(ask(*tuning))


def test_results_are_kept_though_nothing_can_be_printed(
    folder: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(text: str) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("contactfusion.run.execute.note", full)
    assert ask("run", "wrist.yaml", "--out", "results").status == 1
    assert {file.name for file in (folder / "results").iterdir()} == {
        "contacts.csv",
        "summary.json",
    }


def test_a_configuration_without_a_recording_is_told_to_name_one(folder: Path, ask: Ask) -> None:
    (folder / "new.yaml").write_text("generators: {}")
    sentence = one_sentence(ask("explain", "new.yaml", "--time", "1"))
    assert sentence.endswith(
        "give the recording that it is for, and the configuration by --config new.yaml"
    )


def test_results_that_cannot_be_written_are_one_sentence(folder: Path, ask: Ask) -> None:
    (folder / "taken").write_text("a file stands where the folder should")
    assert "taken" in one_sentence(ask("run", "wrist.yaml", "--out", "taken"))
    assert (folder / "taken").read_text().startswith("a file")


@pytest.mark.parametrize("arguments", [["rnu"], ["run"], ["run", "--outt", "x"]])
def test_a_command_that_is_none_is_told_how_to_use_it(arguments: list[str], ask: Ask) -> None:
    answer = ask(*arguments)
    assert answer.status == 2 and "Traceback" not in answer.err


@pytest.mark.parametrize("debug", [[], ["--debug"]])
def test_what_nobody_expected_is_a_sentence_and_a_traceback_by_debug_alone(
    debug: list[str], folder: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("division by zero") from ValueError("\x1b[2J")

    monkeypatch.setattr("contactfusion.run.execute.run_file", fail)
    answer = ask("run", "wrist.yaml", *debug)
    assert answer.status == 1 and ("Traceback" in answer.err) == bool(debug)
    assert "\x1b" not in answer.err
    sentence = answer.err.splitlines()[-1]
    failed = "contactfusion: failed with ZeroDivisionError: division by zero (contactfusion/"
    assert sentence.startswith(failed)
    assert sentence.endswith("; run it with --debug for the traceback")


def test_an_interrupted_run_keeps_the_steps_before_it(
    folder: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Interrupted(DeMorgan):
        steps = 0

        def fuse(self, entries: Any, sources: Any, surface: Any) -> Any:
            self.steps += 1
            if self.steps == 3:
                raise KeyboardInterrupt
            return super().fuse(entries, sources, surface)

    monkeypatch.setattr(type(installed_plugins()), "find", found_with("de_morgan", Interrupted))
    by_it = ("--set", "integrator.rule=de_morgan")
    answer = ask("run", "wrist.yaml", *by_it, "--out", "results")
    assert answer.status == 130
    assert answer.err.splitlines()[-1] == "contactfusion: interrupted"
    assert json.loads((folder / "results" / "summary.json").read_text())["steps"] == 2


def found_with(name: str, cls: type[Any]) -> Any:
    """`Plugins.find` with another class under a name."""
    find = Plugins.find

    def found(plugins: Plugins, kind: str, wanted: str) -> type[Any]:
        return cls if wanted == name else find(plugins, kind, wanted)

    return found


def test_the_status_reaches_the_shell(folder: Path) -> None:
    code = "from contactfusion.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "run", "wirst.yaml"],
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1 and done.stdout == ""
    assert done.stderr.count("\n") == 1 and "did you mean 'wrist.yaml'" in done.stderr


@pytest.mark.parametrize(
    "change",
    ["integrator.condensation=modes", "faults=[{fault: bias, sensor: wrist, amount: 1}]"],
)
def test_a_fault_of_the_configuration_leaves_older_results(
    change: str, folder: Path, ask: Ask
) -> None:
    (folder / "run.yaml").write_text(RUN)
    assert ask("run", "run.yaml", "--out", "out").status == 0
    before = {path: path.read_bytes() for path in (folder / "out").iterdir()}
    assert one_sentence(ask("run", "run.yaml", "--out", "out", "--set", change)).startswith(
        f"run.yaml: {change.partition('=')[0]}"
    )
    assert {path: path.read_bytes() for path in (folder / "out").iterdir()} == before


@pytest.mark.parametrize("command", [("ablate",), ("tune", "fusion", "--labels", "labels.csv")])
def test_a_source_that_gives_nothing_fails_what_compares(
    command: tuple[str, ...], folder: Path, ask: Ask
) -> None:
    (folder / "run.yaml").write_text(RUN)
    (folder / "labels.csv").write_text("start,end,x,y,z\n0,0.01,,,\n0.02,0.03,,,\n")
    answer = ask(*command, "run.yaml", "--out", "out", "--set", "surface=null")
    assert answer.status == 1
    assert "every cloud of 'wrist' was refused" in answer.err


def test_a_folder_of_bags_is_no_configuration(folder: Path, ask: Ask) -> None:
    (folder / "bag").mkdir()
    (folder / "bag" / "a.mcap").write_bytes(b"")
    sentence = one_sentence(ask("check", "bag"))
    assert sentence.startswith("bag is a recording, and no configuration")
    assert "holds no configuration" in one_sentence(ask("explain", "bag", "--time", "0"))


def test_a_place_beyond_any_is_refused(folder: Path, ask: Ask) -> None:
    (folder / "run.yaml").write_text(RUN)
    sentence = one_sentence(ask("explain", "run.yaml", "--time", "0", "--at", "1e300,0,0"))
    assert sentence == "--at takes x,y,z in metres, within 1000, not '1e300,0,0'"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("view", "seen.rrd", "--save", "new.rrd"), "seen.rrd is drawn already: "),
        (("view", "seen.rrd", "--set", "a=1"), "seen.rrd is drawn already: "),
        (("view", *ASKED, "--web", "--screenshot", "a.png"), "--screenshot opens no browser"),
        (("doctor", "arm.urdf", "--live"), "one of these at a time: a robot and --live"),
        (("doctor", "--warm", "--live"), "one of these at a time: --warm and --live"),
        (("doctor", "--domain", "3"), "--ros and --domain are for the network: add --live"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(
    arguments: tuple[str, ...], sentence: str, ask: Ask
) -> None:
    assert sentence in one_sentence(ask(*arguments))
