"""The wheel, installed elsewhere, holds all that is needed and works from any folder."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from collections.abc import Iterable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
FOLDERS = ("contactfusion", "controllers", "generators", "integrator")

STEP = """
import numpy as np
import contactfusion
from contactfusion import HypothesisCloud, Integrator
cloud = HypothesisCloud("skin", "regular", 0.0, "base", np.zeros((1, 3)), np.array([0.5]))
integrator = Integrator()
integrator.receive(cloud)
(contact,) = integrator.step(0.0).contacts
assert contact.likelihood == 0.5
print(contactfusion.__file__)
"""


def run(*command: str | Path, cwd: Path) -> str:
    clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    done = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env={**clean, "NUMBA_DISABLE_JIT": "1"},  # compiling anew would take half a minute
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("checkout"), ROOT, FOLDERS)


def built(copy: Path, root: Path, folders: Iterable[str]) -> Path:
    """Build a wheel from a copy, so that nothing is left in the checkout."""
    caches = shutil.ignore_patterns("__pycache__")
    for name in folders:
        shutil.copytree(root / name, copy / name, symlinks=True, ignore=caches)
    for file in ("pyproject.toml", "README.md", "LICENSE", "MANIFEST.in"):
        if (root / file).exists():
            shutil.copy(root / file, copy)
    pip = (sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation")
    run(*pip, "--wheel-dir", copy / "dist", copy, cwd=copy)
    (wheel,) = (copy / "dist").glob("contactfusion*.whl")
    return wheel


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel into an environment of its own; give its folder of programs."""
    return installed(tmp_path_factory.mktemp("environment"), wheel)


def installed(home: Path, *wheels: Path) -> Path:
    """The folder of programs of a new environment with wheels.

    It borrows the libraries of the environment of the tests, but not the checkout, which is
    installed there.
    """
    venv.create(home, with_pip=False)
    programs = home / Path(sysconfig.get_path("scripts")).name
    python = programs / Path(sys.executable).name
    python = python if python.exists() else programs / "python"
    pip = (sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet")
    run(*pip, "--no-deps", "--no-index", "--no-compile", *wheels, cwd=home)
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    packages = Path(run(python, "-c", code, cwd=home).strip())
    for library in Path(sysconfig.get_path("purelib")).iterdir():
        ours = library.name.startswith(("contactfusion", "__editable__"))
        if not ours and not (packages / library.name).exists():
            (packages / library.name).symlink_to(library)
    return programs


def test_the_wheel_holds_every_module_once_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    modules = {
        Path(*((top,) if top == "contactfusion" else ("contactfusion", top)), *inside.parts)
        for top in FOLDERS
        for file in (ROOT / top).rglob("*.py")
        if (inside := file.relative_to(ROOT / top))
        and not (top == "contactfusion" and inside.parts[0] in FOLDERS)
    }
    held = [Path(name) for name in names if not Path(name).parts[0].endswith(".dist-info")]
    assert sorted(path for path in held if path.suffix == ".py") == sorted(modules)
    assert {path.parts[0] for path in held} == {"contactfusion"}
    assert "contactfusion/py.typed" in names


def test_the_wheel_brings_its_licence_its_command_and_its_plugins(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        (points,) = (name for name in archive.namelist() if name.endswith("entry_points.txt"))
        text = archive.read(points).decode()
        assert any(name.endswith("LICENSE") for name in archive.namelist())
    assert "contactfusion = contactfusion.cli:main" in text
    for name, module in PROJECT["project"]["entry-points"]["contactfusion"].items():
        assert f"{name} = {module}" in text


def test_the_installed_wheel_fuses_from_another_folder(environment: Path, tmp_path: Path) -> None:
    where = Path(run(environment / "python", "-c", STEP, cwd=tmp_path).strip())
    assert where.is_relative_to(environment.parent)


def test_the_installed_wheel_lists_plugins_that_can_all_be_used(
    environment: Path, tmp_path: Path
) -> None:
    said = run(environment / "contactfusion", "plugins", "--strict", cwd=tmp_path)
    assert "cannot be used" not in said
    for name in PROJECT["project"]["entry-points"]["contactfusion"]:
        assert name in said


@pytest.mark.parametrize(
    "words",
    [
        ["demo"],
        ["experiment", "push", "--targets", "grid"],
        ["train", "cpm"],
        ["tune", "push"],
        ["simulate", "push.yaml"],
    ],
)
def test_without_the_laboratory_its_commands_name_what_to_install(
    words: list[str], environment: Path, tmp_path: Path
) -> None:
    command = [str(environment / "contactfusion"), *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    named = " ".join(words if words[0] == "tune" else words[:1])
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (
        f"contactfusion: `contactfusion {named}` comes with contactfusion-lab; install it with: "
        "pip install contactfusion-lab\n"
    )
    assert "experiment" not in run(environment / "contactfusion", "--help", cwd=tmp_path)


def test_without_the_laboratory_a_scene_names_what_to_install(
    environment: Path, tmp_path: Path
) -> None:
    scene = ROOT / "examples" / "scenes" / "push_box.yaml"
    command = [str(environment / "contactfusion"), "run", str(scene)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.endswith(
        "contactfusion: scene.type: the scene 'push' comes with contactfusion-lab; install it "
        "with: pip install contactfusion-lab\n"
    )
