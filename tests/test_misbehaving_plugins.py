"""A distribution whose plug-ins break their contract: what the command line says of each."""

import csv
import json
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from contactfusion.plugins import installed_plugins
from tests.misbehaving import GENERATORS, OTHERS, module, write_distribution
from tests.test_cli import LOG, RUN, Answer, Ask, one_sentence

HEALTHY = "  wrist: {type: force_torque, sign: on_robot, force_noise: 0.1, torque_noise: 0.01}\n"


@pytest.fixture
def ask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Ask]:
    """Install the distribution, and work in a folder with a recording."""
    write_distribution(tmp_path)
    (tmp_path / "wrist.csv").write_text("\n".join(LOG) + "\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    installed_plugins.cache_clear()
    yield Ask(monkeypatch, capsys)
    installed_plugins.cache_clear()
    for name in (*GENERATORS, *OTHERS):
        sys.modules.pop(module(name), None)


def run(ask: Ask, name: str, *arguments: str, options: str = "") -> Answer:
    """Run with a plug-in beside a healthy generator, which comes after it."""
    assert HEALTHY in RUN
    odd = f"  odd: {{type: {name}{options}}}\n"
    Path("run.yaml").write_text(RUN.replace(HEALTHY, odd + HEALTHY))
    return ask("run", "run.yaml", "--out", "out", *arguments)


def rows_of_healthy() -> list[list[str]]:
    """The rows of contacts.csv, without shares."""
    rows = csv.DictReader(Path("out/contacts.csv").read_text().splitlines())
    return [[cell for name, cell in row.items() if name != "shares"] for row in rows]


def alone(ask: Ask) -> list[list[str]]:
    Path("alone.yaml").write_text(RUN)
    assert ask("run", "alone.yaml", "--out", "out").status == 0
    return rows_of_healthy()


AT = r" \(misbehaving_\w+\.py, line \d+\)$"
START = {
    "init_raises": "generators.odd: the plug-in 'init_raises' raised ValueError: no taxels",
    "init_exits": "generators.odd: the plug-in 'init_exits' raised SystemExit: bye",
    "init_narrow": "generators.odd: the plug-in 'init_narrow' raised TypeError: Odd.__init__() "
    "takes 2 positional arguments but 3 were given",
    "init_detached": "the plug-in 'init_detached' cannot be used: Odd does not hand `name` and "
    "`config` to `super().__init__`",
    "abstract": "the plug-in 'abstract' cannot be used: Odd does not implement `generate` of "
    "Generator",
    "no_readings": "the plug-in 'no_readings' cannot be used: Odd needs `readings`, a tuple of "
    "the types of reading that it takes",
    "wrong_config": "the plug-in 'wrong_config' cannot be used: Odd has a `Config` that is no "
    "subclass of GeneratorConfig",
    "wrong_default": "the plug-in 'wrong_default' cannot be used: OddConfig has a default that "
    "it refuses itself: gain: input should be greater than 0, not -1.0",
    "wrong_outputs": "the plug-in 'wrong_outputs' cannot be used: Odd needs `outputs`, a mapping "
    "of names without a slash to HypothesisKind",
    "no_hook": "the generator 'no_hook' cannot be used: contactfusion_generators() lacks "
    "@hookimpl, so that it offers nothing",
    "no_generator": "the plug-in 'no_generator' cannot be used: Odd is no subclass of Generator",
    "import_raises": "the generator 'import_raises' cannot be used: ZeroDivisionError: division by "
    "zero",
}


@pytest.mark.parametrize("isolate", ["", ", isolate: true"], ids=["in process", "isolated"])
@pytest.mark.parametrize(("name", "sentence"), START.items(), ids=START)
def test_one_that_cannot_be_built_is_a_sentence_with_file_and_line(
    name: str, sentence: str, isolate: str, ask: Ask
) -> None:
    told = one_sentence(run(ask, name, options=isolate))
    assert re.fullmatch(re.escape(f"run.yaml: {sentence}") + AT, told), told
    assert not Path("out").exists()


LOOP = {
    "raises": ("", "'odd' raised ValueError: no taxels at all", True),
    "exits": ("", "'odd' raised SystemExit: 3", True),
    "forces": (
        "",
        "'odd' raised ValueError: cannot set WRITEABLE flag to True of this array",
        True,
    ),
    "huge": (
        "",
        "the cloud of 'odd' holds 2000001 hypotheses, more than `integrator.max_hypotheses` "
        "allows, 2000000",
        False,
    ),
    "raises, isolated": (", isolate: true", "'odd' raised ValueError: no taxels at all", True),
    "exits, isolated": (", isolate: true", "'odd' raised SystemExit: 3", True),
    "dies, isolated": (
        ", isolate: true",
        "the process of 'odd' has ended (exit code 3) 4 times: it stays out",
        False,
    ),
    "hangs, isolated": (
        ", isolate: true, patience: 1",
        "the process of 'odd' gave no answer within 1 s (`patience`): it stays out",
        False,
    ),
}


@pytest.mark.parametrize(("case", "told"), LOOP.items(), ids=LOOP)
def test_one_that_fails_in_the_loop_is_named_and_the_healthy_contacts_are_kept(
    case: str, told: tuple[str, str, bool], ask: Ask
) -> None:
    options, sentence, placed = told
    expected = alone(ask)
    answer = run(ask, case.partition(",")[0], options=options)
    assert re.search(re.escape(sentence) + (AT if placed else "$"), one_sentence(answer)), answer
    assert rows_of_healthy() == expected
    counted = json.loads(Path("out/summary.json").read_text())["sources"]
    assert (counted["odd"]["accepted"], counted["odd"]["invalid"]) == (0, 5)
    assert counted["wrist"]["accepted"] == 5


def test_a_rule_that_raises_ends_the_run_and_the_steps_before_it_are_kept(ask: Ask) -> None:
    Path("run.yaml").write_text(RUN)
    answer = ask("run", "run.yaml", "--out", "out", "--set", "integrator.rule=rule_raises")
    assert re.fullmatch(r"the rule Rule raised ValueError: no rule" + AT, one_sentence(answer))
    assert json.loads(Path("out/summary.json").read_text())["steps"] == 2
    assert len(rows_of_healthy()) == 2


def test_a_rule_that_cannot_be_built_is_a_sentence(ask: Ask) -> None:
    Path("run.yaml").write_text(RUN)
    answer = ask("run", "run.yaml", "--out", "out", "--set", "integrator.rule=rule_narrow")
    sentence = "run.yaml: integrator: the plug-in 'rule_narrow' raised TypeError: "
    assert one_sentence(answer).startswith(sentence)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("rule_stranger", "Rule is no subclass of Rule (misbehaving_rule_stranger.py, line 6)"),
        (
            "rule_misspelt",
            "Misspelt has a flag `needs_place`: did you mean `needs_places` of Rule? "
            "(misbehaving_rule_misspelt.py, line 7)",
        ),
    ],
)
def test_a_rule_that_breaks_the_contract_is_a_sentence(name: str, sentence: str, ask: Ask) -> None:
    Path("run.yaml").write_text(RUN)
    answer = ask("run", "run.yaml", "--out", "out", "--set", f"integrator.rule={name}")
    said = f"run.yaml: the plug-in '{name}' cannot be used: {sentence}"
    assert one_sentence(answer) == said


def test_a_controller_that_raises_is_counted_and_the_contacts_are_kept(ask: Ask) -> None:
    expected = alone(ask)
    Path("run.yaml").write_text(RUN + "controller: {type: pilot_raises}\n")
    answer = ask("run", "run.yaml", "--out", "out")
    reason = "the controller raised ValueError: no way"
    sentence = f"run.yaml: controller: it commanded nothing in 5 steps: {reason}"
    assert re.fullmatch(re.escape(sentence) + AT, one_sentence(answer))
    assert rows_of_healthy() == expected
    assert Path("out/commands.csv").read_text().count(f"fault,{reason}") == 0
    assert Path("out/commands.csv").read_text().count(reason) == 5


@pytest.mark.parametrize("isolate", ["", ", isolate: true"], ids=["in process", "isolated"])
def test_one_that_cannot_be_reset_is_named_by_a_replay(isolate: str, ask: Ask) -> None:
    odd = f"  odd: {{type: reset_raises{isolate}}}\n"
    described, fused = RUN.removeprefix("recording:\n").partition("generators:\n")[::2]
    Path("log.yaml").write_text(textwrap.dedent(described))
    Path("fuse.yaml").write_text(
        "generators:\n" + odd + fused.replace("{on: wrist}", "{every: 0.01}")
    )
    answer = ask("replay", "fuse.yaml", "log.yaml", "--out", "contacts.csv")
    assert re.search(
        "every cloud of 'odd' was refused: `reset` of 'odd' raised ValueError: no way back" + AT,
        one_sentence(answer),
    )
    assert len(Path("contacts.csv").read_text().splitlines()) > 1


def test_calls_over_budget_are_counted_on_the_console_alone(ask: Ask) -> None:
    answer = run(ask, "late", options=", budget: 0.01")
    told = r"  5 of 5 calls of 'odd' took longer than its budget of 0.01 s \(at most 0\.\d+ s\)\n"
    assert answer.status == 0 and re.search(told, answer.out)
    assert "budget" not in Path("out/summary.json").read_text()


def test_the_traceback_of_what_raised_is_shown_by_debug_alone(
    ask: Ask, caplog: pytest.LogCaptureFixture
) -> None:
    assert "Traceback" not in run(ask, "init_raises").err
    for debug in (["--debug", "run"], ["run", "--debug"]):
        answer = ask(*debug, "run.yaml", "--out", "out")
        assert answer.status == 1 and "Traceback" in answer.err
        assert "raise ValueError('no taxels')" in answer.err
    caplog.clear()
    assert "Traceback" not in run(ask, "raises").err and not caplog.records
    run(ask, "raises", "--debug")
    (record,) = caplog.records
    assert record.exc_info and "no taxels" in record.getMessage()


# What `plugins` says


def test_strict_names_all_that_fail_and_no_other(ask: Ask) -> None:
    answer = ask("plugins", "--strict")
    failing = {*START, "rule_narrow", "rule_stranger", "rule_misspelt"}
    told = dict(re.findall(r"^(\w+) cannot be used: (.*)$", answer.out, re.MULTILINE))
    assert set(told) == failing
    assert all(re.search(AT, why) for why in told.values())
    line = one_sentence(answer)
    assert line.startswith(f"{len(failing)} plug-ins cannot be used: ")
    assert set(line.partition(": ")[2].split(", ")) == failing


def test_listing_imports_none_and_tells_kind_and_purpose(ask: Ask) -> None:
    answer = ask("plugins")
    assert answer.status == 0
    assert re.search(
        r"^no_readings +generator +Is odd\. +misbehaving 1\.0", answer.out, re.MULTILINE
    )
    assert re.search(r"^rule_narrow +rule +Takes no configur", answer.out, re.MULTILINE)
    assert not {module(name) for name in (*GENERATORS, *OTHERS)} & set(sys.modules)


@pytest.mark.parametrize("name", ["import_raises", "wrong_config", "no_hook"])
def test_the_options_of_one_that_cannot_be_used_are_a_sentence(name: str, ask: Ask) -> None:
    assert "cannot be used" in one_sentence(ask("plugins", name))
