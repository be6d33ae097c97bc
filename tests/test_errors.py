"""Sentences on what plug-ins raise: cause, file and line."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from contactfusion.errors import (
    FrameError,
    Guard,
    PluginError,
    cause_in,
    cause_of,
    listed_once,
    name_hint,
    place_of,
)


class Plug:
    """Stands for a plug-in's class."""

    def fail(self, error: BaseException) -> None:
        raise error


def raised(call: Any) -> BaseException:
    with pytest.raises(BaseException) as caught:  # noqa: B017 whatever it is
        call()
    return caught.value


HERE = r"\(tests/test_errors\.py, line \d+\)"


def test_file_and_line_are_the_innermost_of_the_package_that_failed() -> None:
    told = cause_of(raised(lambda: json.loads("{")), Plug)
    assert re.fullmatch(rf"JSONDecodeError: Expecting property name .* {HERE}", told)
    line = int(told.rpartition(" ")[2].rstrip(")"))
    assert 'json.loads("{")' in Path(__file__).read_text().splitlines()[line - 1]


def test_where_the_package_is_not_in_the_traceback_its_class_is_named() -> None:
    error = raised(lambda: json.loads("{"))
    assert re.search(r"\(json/decoder\.py, line \d+\)$", cause_in(error, "json"))
    assert cause_in(error, "nowhere", Plug).endswith(f"({place_of(Plug)})")
    assert cause_in(error, "nowhere").endswith("(char 1)")
    assert re.fullmatch(r"tests/test_errors\.py, line \d+", place_of(Plug))
    assert place_of(int) == place_of(None) == ""


def test_an_error_of_contactfusion_says_all_by_itself() -> None:
    error = raised(lambda: Plug().fail(FrameError("unknown frame 'moon'")))
    assert cause_of(error, Plug) == "FrameError: unknown frame 'moon'"


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (ValueError("one\n  two"), "ValueError: one two "),
        (ValueError(), "ValueError ("),
        (ValueError("word " * 100), "word … ("),
        (SyntaxError("what", ("/a/b.py", 3, 1, "x")), "(b.py, line 3)"),
    ],
)
def test_a_cause_is_one_line_of_bounded_length(error: Exception, told: str) -> None:
    cause = cause_of(raised(lambda: Plug().fail(error)), Plug)
    assert told in cause and "\n" not in cause and len(cause) < 400


def test_a_guard_turns_what_is_raised_into_a_sentence() -> None:
    with pytest.raises(PluginError, match=rf"^the plug raised ValueError: odd {HERE}$") as caught:
        with Guard("the plug", Plug):
            Plug().fail(ValueError("odd"))
    assert isinstance(caught.value.__cause__, ValueError)
    with pytest.raises(PluginError, match="raised SystemExit: 3"):
        with Guard("the plug", Plug):
            Plug().fail(SystemExit(3))


@pytest.mark.parametrize("error", [FrameError("unknown"), KeyboardInterrupt()])
def test_a_guard_lets_sentences_and_interrupts_pass(error: BaseException) -> None:
    with pytest.raises(type(error)) as caught:
        with Guard("the plug", Plug):
            Plug().fail(error)
    assert caught.value is error


@pytest.mark.parametrize(
    ("name", "known", "hint"),
    [
        ("fx", ["Fx", "Fy"], "did you mean 'Fx'? The columns are: Fx, Fy"),
        ("FX", ["fx", "fy"], "did you mean 'fx'? The columns are: fx, fy"),
        ("frce", ["Force", "t"], "did you mean 'Force'? The columns are: Force, t"),
        ("q", ["Fx", "Fy"], "the columns are: Fx, Fy"),
        ("q", [], "there are no columns"),
    ],
)
def test_the_nearest_name_is_found_in_any_case(name: str, known: list[str], hint: str) -> None:
    assert name_hint(name, known, "columns") == hint


def test_a_list_stands_in_the_first_sentence_alone() -> None:
    first = "unknown frame 'mooon': did you mean 'moon'? The frames are: base, moon; name it"
    others = [
        "unknown frame 'sun': the frames are: base, moon; name it",
        "no sensor 'eye'; the sensors are: ear, nose",
        "no sensor 'toe'; the sensors are: ear, nose",
        "unknown frame 'bas': did you mean 'base'? The frames are: base, moon; name it",
    ]
    short = ["unknown frame 'sun'; name it", others[1], "no sensor 'toe'"]
    short += ["unknown frame 'bas': did you mean 'base'? Name it"]
    assert list(listed_once([first, *others])) == [first, *short]
    assert list(listed_once(others, printed=first)) == short
