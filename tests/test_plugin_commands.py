"""Commands of plug-ins: found by entry point, imported when asked for, none harms the others."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from contactfusion import cli
from tests.test_cli import Ask, one_sentence

HELLO = '''
"""Commands of a stranger."""

import typer


def hello(name: str = "robot") -> None:
    """Greet a robot."""
    print(f"hello {name}")


group = typer.Typer(name="other", help="Commands of a stranger.")
group.command("hello")(hello)
group.command("bye")(hello)
'''
POINTS = {
    "hello": "cf_hello:hello",
    "strange": "cf_hello:group",
    "strange.more": "cf_hello:hello",
    "strange.bye": "cf_hello:hello",
    "tune.stranger": "cf_hello:hello",
    "run": "cf_hello:hello",
    "nowhere.hello": "cf_hello:hello",
    "broken": "cf_broken:hello",
    "absent": "cf_hello:goodbye",
}


@pytest.fixture
def ask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Ask]:
    """Install a distribution that adds commands."""
    (tmp_path / "cf_hello.py").write_text(HELLO)
    (tmp_path / "cf_broken.py").write_text("1 / 0\n")
    info = tmp_path / "stranger-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
    lines = "".join(f"{name} = {value}\n" for name, value in POINTS.items())
    (info / "entry_points.txt").write_text(f"[contactfusion_commands]\n{lines}")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    yield Ask(monkeypatch, capsys)
    for name in ("cf_hello", "cf_broken"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    "words",
    [["hello"], ["strange", "hello"], ["strange", "more"], ["tune", "stranger"]],
    ids=" ".join,
)
def test_a_command_is_added_also_to_a_group(words: list[str], ask: Ask) -> None:
    answer = ask(*words, "--name", "arm", "--quiet")
    assert (answer.status, answer.out, answer.err) == (0, "hello arm\n", "")
    assert "Greet a robot." in ask(*words, "-h").out


def test_nothing_is_imported_until_it_is_asked_for(ask: Ask) -> None:
    cli.command_line()
    assert ask("plugins").status == 0 and ask("tune", "fusion", "-h").status == 0
    assert not {"cf_hello", "cf_broken"} & set(sys.modules)


def test_a_name_that_is_taken_and_a_group_that_is_not_there_are_listed(ask: Ask) -> None:
    out = " ".join(ask("plugins").out.split())
    assert "run (stranger 1.0) cannot be used: the name 'run' is taken" in out
    assert "nowhere.hello cannot be used: there is no group 'nowhere'" in out
    assert "strange more command Greet a robot. stranger 1.0" in out
    assert "strange command Commands of a stranger. stranger 1.0" in out
    assert "Find contacts in" in ask("run", "-h").out


def test_one_that_cannot_be_imported_says_why_and_the_others_work(ask: Ask) -> None:
    assert one_sentence(ask("broken", "--any", "thing")) == (
        "the command 'broken' of stranger 1.0 cannot be used: ZeroDivisionError: division by zero "
        "(cf_broken.py, line 1)"
    )
    assert "'absent' of stranger 1.0 cannot be used: AttributeError" in one_sentence(ask("absent"))
    assert "Cannot be used: ZeroDivisionError" in " ".join(ask("-h").out.split())
    answer = ask("plugins", "--strict")
    assert answer.status == 1 and "broken cannot be used: ZeroDivisionError" in answer.out
    assert "strange.bye cannot be used: the name 'strange.bye' is taken" in answer.out
