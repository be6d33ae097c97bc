"""Who imports whom; and what the command line does not wait for."""

import ast
import functools
import importlib
import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

import contactfusion

ROOT = Path(__file__).parents[1]
HEAVY = ("matplotlib", "numba", "open3d", "pybullet", "rerun", "scipy.spatial", "sklearn", "torch")
DATA = (
    "arrays",
    "contacts",
    "errors",
    "files",
    "grid",
    "hypotheses",
    "jit",
    "limits",
    "model",
    "nearest",
    "readings",
    "reason",
    "surface",
    "time",
    "units",
    "unpacking",
)
"""The data types and what they stand on."""
CORE = {
    *DATA,
    "assembly",
    "confined",
    "controller",
    "controllers",
    "estimate",
    "extras",
    "faults",
    "frames",
    "generator",
    "generators",
    "hooks",
    "hypotheses",
    "integrator",
    "isolation",
    "patches",
    "pipeline",
    "pipeline_config",
    "loop",
    "plugins",
    "robot_state",
    "preset",
    "robots",
    "rule",
    "segmenter",
    "segmenters",
    "shapes",
    "state",
    "stream",
    "thinning",
    "transform_buffer",
    "vendors",
    "vision",
    "yaml_files",
}
"""What runs in the loop, and what that stands on."""
OUTER = {path.stem for path in (ROOT / "contactfusion").iterdir() if path.stem[0] != "_"} - CORE
"""What stands outside and imports inward: all other modules and folders of the package."""
PIPELINE = ("assembly", "pipeline", "pipeline_config")
FORBIDDEN = {
    "integrator": {
        *PIPELINE,
        *("controller", "controllers", "generator", "generators", "robot_state", "robots"),
        *("plugins", "state", "transform_buffer"),
    },
    "generators": {
        *PIPELINE,
        *("controller", "controllers", "integrator", "robot_state", "transform_buffer"),
    },
    "controllers": {
        *PIPELINE,
        *("generator", "generators", "integrator", "robot_state", "transform_buffer"),
    },
    "contactfusion/robots": {
        *PIPELINE,
        *("controller", "controllers", "generator", "generators", "integrator", "plugins"),
    },
    "contactfusion/readings": {
        *PIPELINE,
        *("controller", "controllers", "faults", "generator", "generators", "integrator"),
        *("robot_state", "robots", "state", "transform_buffer"),
    },
    "contactfusion": {"controllers", "generators"},
}
"""What the modules of a folder may not import, beside the outer modules; those of the package's
root, of which many are outer themselves, may import these."""


def runtime_imports(tree: ast.AST) -> Iterator[str]:
    """Give the modules that a module imports, at its top or within; not those for types only."""
    for node in ast.iter_child_nodes(tree):
        match node:
            case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                continue
            case ast.Import(names=names):
                yield from (alias.name for alias in names)
            case ast.ImportFrom(module=str(module), names=names):
                yield module
                yield from (f"{module}.{alias.name}" for alias in names)
            case _:
                yield from runtime_imports(node)


@functools.cache
def imports_of(source: str) -> frozenset[str]:
    """What a module's source imports; each is parsed once in all tests."""
    return frozenset(runtime_imports(ast.parse(source)))


def imported_by(source: str) -> set[str]:
    """Give the modules of the framework that a source imports, without the package's name."""
    ours = (name for name in imports_of(source) if name.startswith("contactfusion."))
    return {name.removeprefix("contactfusion.") for name in ours}


def faults_of(source: str, forbidden: set[str]) -> set[str]:
    """The forbidden modules that a source imports."""
    return {name for name in imported_by(source) if name.split(".")[0] in forbidden}


def framework() -> list[Path]:
    """All modules that `pip install contactfusion` brings."""
    folders = ("contactfusion", "controllers", "generators", "integrator")
    return [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]


def lab_imports(source: str) -> set[str]:
    """The modules of the laboratory that a module's source imports."""
    found = imports_of(source)
    return {name for name in found if name.partition(".")[0] in ("contactfusion_lab", "lab")}


def test_nothing_in_the_framework_imports_the_laboratory() -> None:
    paths = framework()
    assert len(paths) > 100
    assert {path for path in paths if lab_imports(path.read_text())} == set()


def test_the_guard_sees_an_import_of_the_laboratory_wherever_it_stands() -> None:
    for source in (
        "import contactfusion_lab.demo",
        "from contactfusion_lab import cli",
        "def f():\n    from contactfusion_lab.scenes.push.scene import PushScene",
    ):
        assert lab_imports(source)
    assert not lab_imports("from contactfusion.labels import x")


def test_no_test_of_the_framework_needs_the_laboratory() -> None:
    paths = sorted((ROOT / "tests").rglob("*.py"))
    assert {path for path in paths if lab_imports(path.read_text())} == set()


def circles(sources: Mapping[str, str]) -> list[list[str]]:
    """Groups of modules that import each other at run time, at any depth of the code.

    Args:
        sources: the text of each module, by its name.
    """
    names = list(sources)
    arrows = np.zeros((len(names), len(names)), bool)
    for row, name in enumerate(names):
        found = imports_of(sources[name])
        arrows[row] = [other in found and other != name for other in names]
    count, labels = connected_components(arrows, connection="strong")
    groups = [[names[i] for i in np.flatnonzero(labels == label)] for label in range(count)]
    return [group for group in groups if len(group) > 1]


def module_name(path: Path) -> str:
    """The name by which a file of the framework is imported, whatever link leads to it."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    top = () if parts[0] == "contactfusion" else ("contactfusion",)
    return ".".join((*top, *parts)).removesuffix(".__init__")


def test_no_modules_of_the_framework_import_each_other_in_a_circle() -> None:
    paths = [path for path in framework() if not path.parent.is_symlink()]
    assert circles({module_name(path): path.read_text() for path in paths}) == []


def test_the_guard_sees_a_circle_also_through_a_function() -> None:
    one, other = "from a.c import f", "def g():\n    import a.b"
    assert circles({"a.b": one, "a.c": other, "a.d": one}) == [["a.b", "a.c"]]
    unseen = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import a.b"
    assert circles({"a.b": one, "a.c": unseen}) == []


def test_imports_are_found_where_they_hide() -> None:
    tree = ast.parse(
        "from typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    import a\n"
        "def f():\n    from b import c\n"
        "try:\n    import d.e\nexcept ImportError:\n    pass\n"
    )
    assert set(runtime_imports(tree)) == {"typing", "typing.TYPE_CHECKING", "b", "b.c", "d.e"}


def modules_of(name: str) -> list[Path]:
    """The module of a name, or those of the folder of that name."""
    path = ROOT / "contactfusion" / name
    return sorted(path.glob("*.py")) if path.is_dir() else [path.with_suffix(".py")]


@pytest.mark.parametrize(
    "path", [path for name in DATA for path in modules_of(name)], ids=lambda path: path.stem
)
def test_data_types_import_data_types_only(path: Path) -> None:
    finders = {"plugins"} if path.parts[-2:] == ("readings", "registry.py") else set()
    found = {name.split(".")[0] for name in imported_by(path.read_text())}
    assert found <= {*DATA, "frames", *finders}


def test_only_what_needs_all_kinds_of_reading_imports_their_registry() -> None:
    """Else a kind, or what a plug-in extends, would find plug-ins when it is imported."""
    users = {
        module_name(path).removeprefix("contactfusion.")
        for path in framework()
        if "readings.registry" in imported_by(path.read_text())
    }
    inner = {"controllers", "generator", "generators", "integrator", "readings", "robots", "state"}
    assert not {user for user in users if user.split(".")[0] in inner}


def arrows_of(folder: str) -> set[str]:
    """What the modules of a folder may not import."""
    return FORBIDDEN[folder] | (set() if folder == "contactfusion" else OUTER)


@pytest.mark.parametrize("folder", FORBIDDEN)
def test_imports_point_inward(folder: str) -> None:
    paths = sorted((ROOT / folder).glob("*.py"))
    assert len(paths) > 5 and not (ROOT / folder).is_symlink()
    found = {path.stem: faults_of(path.read_text(), arrows_of(folder)) for path in paths}
    assert {name: wrong for name, wrong in found.items() if wrong} == {}


@pytest.mark.parametrize(
    "name",
    ["assembly", "faults", "frames", "isolation", "pipeline", "pipeline_config", "robot_state"]
    + ["transform_buffer"],
)
def test_the_pipeline_imports_nothing_that_stands_outside(name: str) -> None:
    source = (ROOT / "contactfusion" / f"{name}.py").read_text()
    assert faults_of(source, OUTER) == set()


@pytest.mark.parametrize("folder", FORBIDDEN)
def test_the_guard_sees_each_forbidden_arrow_wherever_it_is_drawn(folder: str) -> None:
    for name in arrows_of(folder):
        for source in (
            f"import contactfusion.{name}",
            f"from contactfusion.{name} import f",
            f"from contactfusion import {name}",
            f"from contactfusion.{name}.inner import f",
            f"def f():\n    from contactfusion.{name} import g",
        ):
            assert faults_of(source, arrows_of(folder)), source
        typed = (
            f"from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import contactfusion.{name}"
        )
        assert not faults_of(typed, arrows_of(folder))
    assert {"view", "cli", "recordings"} <= OUTER and "plugins" in arrows_of("integrator")


# What is not loaded


def loaded_by(code: str) -> list[str]:
    """Run code in a new interpreter; give the heavy packages that it loaded."""
    tell = f"print('loaded', json.dumps([h for h in {HEAVY} if h in sys.modules]))"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys, json\n{code}\n{tell}"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    found: list[str] = json.loads(done.stdout.rsplit("loaded", 1)[1])
    return found


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["run", "-h"], ["plugins"]])
def test_the_command_line_answers_without_loading_anything_heavy(arguments: list[str]) -> None:
    code = (
        f"sys.argv = ['contactfusion', *{arguments}]\n"
        "from contactfusion.cli import main\n"
        "try: main()\nexcept SystemExit as end: assert not end.code, end.code"
    )
    assert loaded_by(code) == []


def test_clouds_and_configurations_need_nothing_heavy() -> None:
    names = "HypothesisCloud, HypothesisKind, IntegratorConfig, Generator, State, Surface, hookimpl"
    assert loaded_by(f"from contactfusion import {names}") == []


def test_the_fusion_core_needs_numba_and_nothing_else_that_is_heavy() -> None:
    assert loaded_by("from contactfusion import Integrator; Integrator().step(0.0)") == ["numba"]


@pytest.mark.parametrize("name", contactfusion.__all__)
def test_every_public_name_can_be_imported(name: str) -> None:
    assert getattr(contactfusion, name) is not None


def test_public_names_are_listed_and_strangers_refused() -> None:
    assert dir(contactfusion) == sorted(contactfusion.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'Integratro'"):
        importlib.import_module("contactfusion").__getattr__("Integratro")
