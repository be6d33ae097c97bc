"""Four folders, one package: what must hold so that nobody imports a module twice."""

import os
import subprocess
import sys
import tomllib
from importlib.metadata import entry_points
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
OUTSIDE = ("controllers", "generators", "integrator")
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]


def package_of(folder: Path) -> str:
    parts = folder.relative_to(ROOT).parts
    return ".".join(parts if parts[0] == "contactfusion" else ("contactfusion", *parts))


def sources() -> list[Path]:
    """Give the folders of the package; the links inside it are not followed."""
    tops = [ROOT / "contactfusion", *(ROOT / name for name in OUTSIDE)]
    return [
        Path(folder) for top in tops for folder, _, files in os.walk(top) if "__init__.py" in files
    ]


def test_every_folder_with_modules_is_a_package() -> None:
    tops = [ROOT / "contactfusion", *(ROOT / name for name in OUTSIDE)]
    folders = {
        Path(folder) for top in tops for folder, _, files in os.walk(top) for f in files
        if f.endswith(".py")
    }  # fmt: skip
    assert folders == set(sources())


def test_the_packages_that_are_shipped_are_the_folders_that_there_are() -> None:
    assert sorted(SETUPTOOLS["packages"]) == sorted(map(package_of, sources()))


def test_the_folders_at_the_top_are_mapped_into_the_package() -> None:
    expected = {"contactfusion": "contactfusion"}
    assert SETUPTOOLS["package-dir"] == expected | {f"contactfusion.{n}": n for n in OUTSIDE}


@pytest.mark.parametrize("name", OUTSIDE)
def test_each_folder_at_the_top_is_linked_into_the_package_by_a_relative_link(name: str) -> None:
    link = ROOT / "contactfusion" / name
    assert link.is_symlink() and os.readlink(link) == f"../{name}"
    assert link.resolve() == ROOT / name


def test_there_are_no_other_links_in_the_package() -> None:
    links = {entry.name for entry in (ROOT / "contactfusion").rglob("*") if entry.is_symlink()}
    assert links == set(OUTSIDE)


def test_the_links_are_kept_as_links() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    paths = [f"contactfusion/{name}" for name in OUTSIDE]
    listed = subprocess.run(
        ["git", "ls-files", "--stage", *paths], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert [line.split()[0] for line in listed.stdout.splitlines()] == ["120000"] * len(OUTSIDE)


def test_the_package_says_that_it_is_typed() -> None:
    assert (ROOT / "contactfusion" / "py.typed").is_file()
    assert "py.typed" in SETUPTOOLS["package-data"]["contactfusion"]


def test_importing_all_of_it_makes_no_twin_modules() -> None:
    modules = sorted(
        f"{package_of(folder)}.{file.stem}"
        for folder in sources()
        for file in folder.glob("*.py")
        if file.stem != "__init__"
    )
    code = (
        "import importlib, sys\n"
        f"for name in {modules}: importlib.import_module(name)\n"
        f"twins = [m for m in sys.modules if m.split('.')[0] in {OUTSIDE}]\n"
        "assert not twins, twins"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_script_beside_the_clone_imports_the_package_and_not_the_folder(tmp_path: Path) -> None:
    (tmp_path / "contactfusion" / "docs").mkdir(parents=True)  # as a clone lies there
    (tmp_path / "script.py").write_text("import contactfusion; print(contactfusion.__file__)")
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "script.py"]
    done = subprocess.run(command, cwd=tmp_path, env=clean, capture_output=True, text=True)
    assert done.stdout.strip().endswith("__init__.py"), done.stdout + done.stderr


def test_this_very_run_has_imported_no_twin_modules() -> None:
    assert not [name for name in sys.modules if name.split(".")[0] in OUTSIDE]


def test_every_entry_point_of_the_project_is_installed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = project["entry-points"]["contactfusion"]
    installed = {
        point.name: point.value
        for point in entry_points(group="contactfusion")
        if point.dist is not None and point.dist.name == "contactfusion"
    }
    assert installed == wanted
