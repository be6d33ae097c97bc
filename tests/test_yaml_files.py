"""Configurations in YAML, changes by name=value, and files that are written whole."""

from pathlib import Path

import pytest

from contactfusion.errors import ConfigurationError, WritingError
from contactfusion.files import write_whole
from contactfusion.yaml_files import read_yaml, require_shallow, with_overrides


def written(folder: Path, text: str, name: str = "scene.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def refusal(path: Path) -> str:
    with pytest.raises(ConfigurationError) as caught:
        read_yaml(path)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_mapping_is_read_as_it_stands(tmp_path: Path) -> None:
    path = written(tmp_path, "integrator: {voxel_size: 0.01}\nframes:\n  pad: {parent: base}\n")
    assert read_yaml(path) == {
        "integrator": {"voxel_size": 0.01},
        "frames": {"pad": {"parent": "base"}},
    }


def test_a_missing_file_names_the_nearest_one_of_its_folder(tmp_path: Path) -> None:
    written(tmp_path, "a: 1", "push_box.yaml")
    assert "did you mean 'push_box.yaml'?" in refusal(tmp_path / "push_bx.yaml")
    assert "nor its folder" in refusal(tmp_path / "nowhere" / "scene.yaml")
    assert "is a folder" in refusal(tmp_path)


def test_a_tab_is_named_with_line_and_column(tmp_path: Path) -> None:
    message = refusal(written(tmp_path, "a:\n\tb: 1\n"))
    assert "line 2, column 1" in message
    assert "indent with spaces, not tabs" in message


def test_a_wrong_indent_is_named_with_line_and_column(tmp_path: Path) -> None:
    assert "line 3, column 2" in refusal(written(tmp_path, "a:\n  b: 1\n c: 2\n"))


@pytest.mark.parametrize("text", ["a: 1\nb: 2\na: 3\n", "x: {b: 1, a: 1, a: 2}\n"])
def test_a_repeated_key_is_refused(tmp_path: Path, text: str) -> None:
    message = refusal(written(tmp_path, text))
    assert "the key 'a' stands here twice" in message
    assert "line" in message


def test_a_merged_mapping_may_be_changed_in_a_key(tmp_path: Path) -> None:
    path = written(tmp_path, "a: &a {x: 1, y: 2}\nb: {<<: *a, y: 3}\n")
    assert read_yaml(path)["b"] == {"x": 1, "y": 3}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "is empty"),
        ("- 1\n- 2\n", "holds a list"),
        ("1: a\n", "the key 1 is not text"),
        ("a: 1\n---\nb: 2\n", "single document"),
        ("a: !!python/object:os.system x\n", "could not determine a constructor"),
    ],
)
def test_whatever_is_no_mapping_of_names_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    assert reason in refusal(written(tmp_path, text))


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_bytes(b"\xff\xfe\x00\x81")
    assert "is no YAML text" in refusal(path)


def test_overrides_change_a_copy() -> None:
    scene = {"integrator": {"voxel_size": 0.005}, "files": [{"rate": 1}, {"rate": 2}]}
    changed = with_overrides(
        scene,
        ["integrator.voxel_size=0.01", "files.1.rate=5", "cycle.every=0.1", "names=[a, b]", "x="],
    )
    assert changed == {
        "integrator": {"voxel_size": 0.01},
        "files": [{"rate": 1}, {"rate": 5}],
        "cycle": {"every": 0.1},
        "names": ["a", "b"],
        "x": None,
    }
    assert scene == {"integrator": {"voxel_size": 0.005}, "files": [{"rate": 1}, {"rate": 2}]}


def test_the_value_of_an_override_may_hold_an_equals_sign() -> None:
    assert with_overrides({}, ["a=b=c"]) == {"a": "b=c"}


@pytest.mark.parametrize(
    ("override", "reason"),
    [
        ("a", "is no change"),
        ("=1", "is no change"),
        ("a..b=1", "is no change"),
        ("number.b=1", "'number' is 3, not a mapping"),
        ("items.2=1", "no place in a list of 2"),
        ("items.x=1", "no place in a list of 2"),
        ("a=[1", "the value of 'a=[1'"),
        (f"{'.'.join('a' * 3000)}=1", "mappings are more than 50 within each other"),
    ],
)
def test_a_wrong_override_is_refused(override: str, reason: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        with_overrides({"number": 3, "items": [1, 2]}, [override])
    assert reason in str(caught.value)


def test_what_is_deeper_than_any_yaml_is_refused(tmp_path: Path) -> None:
    deepest = read_yaml(written(tmp_path, "a: " + "[" * 48 + "1" + "]" * 48))
    require_shallow(deepest)
    with pytest.raises(ConfigurationError, match="^lists and mappings are more than 50 within"):
        require_shallow({"a": deepest})


def test_a_file_is_written_whole_and_leaves_nothing_beside(tmp_path: Path) -> None:
    path = tmp_path / "new" / "results.csv"
    write_whole(path, "é\n")
    write_whole(path, b"second\n")
    assert path.read_bytes() == b"second\n"
    assert list(path.parent.iterdir()) == [path]


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "results.csv"
    write_whole(path, "old")

    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(WritingError, match="results.csv can't be written: no space left"):
        write_whole(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_on_and_off_are_text_as_keys_and_as_values(tmp_path: Path) -> None:
    path = tmp_path / "cycle.yaml"
    path.write_text("cycle: {on: wrench}\nstate: off\nready: true\n")
    assert read_yaml(path) == {"cycle": {"on": "wrench"}, "state": "off", "ready": True}


def test_a_key_that_is_no_text_is_refused_at_any_depth(tmp_path: Path) -> None:
    path = tmp_path / "deep.yaml"
    path.write_text("generators: {5: {type: tactile}}\n")
    with pytest.raises(ConfigurationError, match="the key 5 is not text"):
        read_yaml(path)


LAUGHS = "".join(f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 10)}]\n" for i in range(9))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"a: {'9' * 5000}\n", "line 1, column 4: '99999999999999999999' is no int: Exceeds"),
        ("a: !!float x\n", "line 1, column 4: 'x' is no float: could not convert"),
        ("a: !!int ''\n", "'' is no int"),
        ("a: !!bool x\n", "'x' is no bool"),
        ("a: !!timestamp 1\n", "could not determine a constructor"),
        ("a: !!binary aGk=\n", "could not determine a constructor"),
        ("a: !!set {b}\n", "could not determine a constructor"),
        (f"a: {'[' * 60}{']' * 60}\n", "lists and mappings are more than 50 within each other"),
        (f"a: {'[' * 100_000}\n", "lists and mappings are more than 50 within each other"),
        ("a: &b [*b]\n", "an alias names what it stands in"),
        ("a: &b {<<: *b}\n", "an alias names what it stands in"),
        ("a0: &a0 1\n" + LAUGHS, "it holds more than 100000 values"),
        (f"a: '{'x' * 2**19}'\n", "524294 bytes, more than 524288"),
    ],
)
def test_what_is_too_large_or_of_no_kind_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    assert reason in refusal(written(tmp_path, text))


def test_days_are_text_and_aliases_are_copies(tmp_path: Path) -> None:
    path = written(tmp_path, "day: 2001-01-01\na: &a [1, {b: 2}]\nc: *a\n")
    assert read_yaml(path) == {"day": "2001-01-01", "a": [1, {"b": 2}], "c": [1, {"b": 2}]}


def test_a_change_is_bounded_too() -> None:
    with pytest.raises(ConfigurationError, match="is no int"):
        with_overrides({}, [f"a={'9' * 5000}"])


@pytest.mark.parametrize("escape", ["\\U00110000", "\\UFFFFFFFF"])
def test_an_escape_that_is_no_character_is_a_sentence(escape: str, tmp_path: Path) -> None:
    assert "scene.yaml is no YAML text" in refusal(written(tmp_path, f'a: "{escape}"'))
    with pytest.raises(ConfigurationError, match="the value of 'a=.*' is no YAML"):
        with_overrides({}, [f'a="{escape}"'])
