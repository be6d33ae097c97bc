"""Which slow tests of the laboratory continuous integration may leave out."""

import subprocess
from pathlib import Path

import pytest

from scripts import changed

FILES = {
    "contactfusion": "contactfusion/__init__.py",
    "contactfusion.grid": "contactfusion/grid.py",
    "contactfusion.fusion": "contactfusion/fusion.py",
    "contactfusion.generators.skin": "generators/skin.py",
    "contactfusion.view": "contactfusion/view.py",
    "contactfusion_lab.push": "lab/contactfusion_lab/push.py",
    "contactfusion_lab.touch": "lab/contactfusion_lab/touch.py",
    "lab.tests.test_push": "lab/tests/test_push.py",
    "lab.tests.test_touch": "lab/tests/test_touch.py",
    "tests.toys": "tests/toys.py",
    "tests.test_view": "tests/test_view.py",
}
GRAPH = {
    **dict.fromkeys(FILES, ()),
    "contactfusion.fusion": ("contactfusion.grid",),
    "contactfusion.generators.skin": ("contactfusion.fusion",),
    "contactfusion.view": ("contactfusion.fusion",),
    "contactfusion_lab.push": ("contactfusion_lab.touch",),
    "contactfusion_lab.touch": ("contactfusion_lab.push",),
    "lab.tests.test_push": ("contactfusion_lab.push", "tests.toys"),
    "tests.test_view": ("contactfusion.view",),
}
PUSH, TOUCH = "lab.tests.test_push", "lab.tests.test_touch"


def run_for(*paths: str) -> dict[str, str]:
    return changed.causes([PUSH, TOUCH], paths, FILES, GRAPH, ["contactfusion.generators.skin"])


@pytest.mark.parametrize(
    ("path", "run"),
    [
        ("lab/tests/test_push.py", {PUSH}),
        ("lab/contactfusion_lab/touch.py", {PUSH}),
        ("tests/toys.py", {PUSH}),
        ("generators/skin.py", {PUSH, TOUCH}),
        ("contactfusion/grid.py", {PUSH, TOUCH}),
        ("contactfusion/view.py", set()),
        ("tests/test_view.py", set()),
        ("docs/push.md", set()),
        ("docs/pictures/demo.gif", set()),
        ("README.md", set()),
        ("examples/scenes/push_box.yaml", {PUSH, TOUCH}),
        ("pyproject.toml", {PUSH, TOUCH}),
        ("contactfusion/gone.py", {PUSH, TOUCH}),
    ],
)
def test_those_run_that_stand_on_a_file_and_all_for_a_file_that_is_no_module(
    path: str, run: set[str]
) -> None:
    assert run_for(path) == dict.fromkeys(run, path)
    assert run_for(path, "docs/index.md", "tests/test_view.py") == dict.fromkeys(run, path)


def test_without_a_change_none_runs() -> None:
    assert run_for() == {}


def test_the_report_names_what_is_left_out() -> None:
    assert [*changed.report([PUSH, TOUCH], run_for("tests/toys.py"), FILES)] == [
        "  lab/tests/test_push.py runs: tests/toys.py changed",
        "  lab/tests/test_touch.py LEFT OUT: nothing that it stands on changed",
        "slow tests: 1 of 2 files run",
    ]


def test_imports_are_found_wherever_they_stand_and_in_quotes() -> None:
    source = (
        "import contactfusion.grid\n"
        "def f():\n    from contactfusion import view\n"
        "LATE = 'contactfusion.fusion'\n"
        "import numpy"
    )
    found = {f"contactfusion.{name}" for name in ("grid", "view", "fusion")}
    assert changed.imports("contactfusion.cli", source, FILES) == {"contactfusion", *found}


def test_tests_that_start_other_programs_stand_on_all_that_is_no_test() -> None:
    source = "import subprocess\nimport tests.toys"
    every = {name for name in FILES if "tests" not in name.split(".")}
    assert changed.imports(PUSH, source, FILES) == {*every, "tests.toys"}
    assert changed.imports("contactfusion.view", "import subprocess", FILES) == set()


def test_every_module_of_this_repository_has_one_name() -> None:
    files = changed.module_files()
    assert len(set(files.values())) == len(files) > 300
    assert files["contactfusion.generators.tactile"] == "generators/tactile.py"
    assert files["tests.test_changed"] == "tests/test_changed.py"
    source = (changed.ROOT / "contactfusion" / "__init__.py").read_text()
    assert "contactfusion.pipeline" in changed.imports("contactfusion", source, files)


# The commit to compare with


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A repository with one commit, which is landed, and one beyond it."""
    git(tmp_path, "init", "--quiet")
    for name in ("kept", "gone"):
        (tmp_path / f"{name}.py").write_text("1\n")
    commit(tmp_path)
    git(tmp_path, "update-ref", f"refs/remotes/{changed.LANDED}", "HEAD")
    (tmp_path / "added.py").write_text("2\n")
    commit(tmp_path)
    return tmp_path


def git(folder: Path, *words: str) -> str:
    who = ["-c", "user.name=tester", "-c", "user.email=tester@localhost"]
    done = subprocess.run(
        ["git", *who, *words], cwd=folder, check=True, capture_output=True, text=True
    )
    return done.stdout.strip()


def commit(folder: Path) -> None:
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "a change")


def test_what_is_not_landed_is_compared_with_the_commit_that_it_left(repository: Path) -> None:
    base = changed.base_of(None, repository)
    assert base is not None and base == git(repository, "rev-parse", "HEAD^")
    (repository / "gone.py").unlink()
    (repository / "kept.py").write_text("3\n")
    (repository / "fresh file.py").write_text("4\n")
    assert changed.changed_files(base, repository) == {
        "added.py",
        "fresh file.py",
        "gone.py",
        "kept.py",
    }


def test_a_file_that_moved_has_changed_at_both_places(repository: Path) -> None:
    git(repository, "mv", "kept.py", "moved.py")
    assert {"kept.py", "moved.py"} <= changed.changed_files("HEAD", repository)


def test_with_what_is_landed_there_is_nothing_to_compare_but_a_commit_that_is_named(
    repository: Path,
) -> None:
    git(repository, "update-ref", f"refs/remotes/{changed.LANDED}", "HEAD")
    assert changed.base_of(None, repository) is None
    assert changed.base_of("HEAD^", repository) == git(repository, "rev-parse", "HEAD^")
    assert changed.changed_files("HEAD^", repository) == {"added.py"}
    git(repository, "update-ref", "-d", f"refs/remotes/{changed.LANDED}")
    assert changed.base_of(None, repository) is None
    with pytest.raises(subprocess.CalledProcessError):
        changed.base_of("nowhere", repository)
