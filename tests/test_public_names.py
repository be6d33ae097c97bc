"""`import contactfusion as cf` is enough for every example and every page."""

import ast
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

import contactfusion

ROOT = Path(__file__).parents[1]
OURS = ("contactfusion", "contactfusion_lab")
PUBLIC = {
    *("Arrival", "Facts", "Model", "Observer", "Stream", "Verdict", "play"),
    *("Contacts", "Field", "Reason"),
    *("Canvas", "Codec", "ColumnsConfig", "ElementValues", "PointValues", "Role", "Values"),
    *("check_codec", "message"),
    *("Command", "Condensation", "Contact", "ContactFusionError", "ContactHypothesis"),
    *("Controller", "Decision", "DepthImage", "Fusion", "Generator", "GeneratorConfig", "Grid"),
    *("HypothesisCloud", "HypothesisKind", "Integrator", "IntegratorConfig", "JointCommand"),
    *("JointState", "Markers", "McapWriter", "Note", "ObjectPose", "Odometry", "OfRobot"),
    *("Pipeline", "PipelineConfig", "PointCloud", "PushingConfig", "PushingController"),
    *(
        "Reading",
        "Recording",
        "RecordingFormat",
        "RobotModel",
        "Rule",
        "Runner",
        "Scene",
        "Segmenter",
    ),
    *("SegmenterConfig", "ShapeConfig", "State", "Step", "Surface", "Switch", "TactileImage"),
    *("TaxelMap", "Transform", "Twist", "Viewer", "Wrench"),
    *("check_file", "check_generator", "explain_fusion", "explain_moment", "fit_baseline"),
    *(
        "fit_compensation",
        "hookimpl",
        "identify_file",
        "open_recording",
        "open_scene",
        "plot_fusion",
    ),
    *("read_robot", "run_file"),
}
"""All that users may rely on: a name more or less is decided here."""
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "lab/README.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").rglob("*.md")),
]
SOURCES = [*sorted((ROOT / "examples").rglob("*.py")), *PAGES]


BLOCK = re.compile(r"^([ \t]*)``` *py(?:thon)?\b.*\n([\s\S]*?)^\1```", re.MULTILINE)


def blocks(text: str) -> Iterator[str]:
    """The Python blocks of a page, also those that are indented."""
    for block in BLOCK.finditer(text):
        yield textwrap.dedent(block[2])


def python_in(path: Path) -> list[str]:
    text = path.read_text()
    return list(blocks(text)) if path.suffix == ".md" else [text]


def names_used(source: str) -> Iterator[tuple[str, str]]:
    """What a source, whole or a fragment, imports or takes of our packages.

    Yields:
        The package, with the module within it where it reaches into one, and the name taken of it.
    """
    tree = ast.parse(source)
    known = {"cf": "contactfusion", **{package: package for package in OURS}}
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                for alias in names:
                    package, _, inner = alias.name.partition(".")
                    if package in OURS and inner:
                        yield alias.name, ""
                    elif package in OURS:
                        known[alias.asname or package] = package
            case ast.ImportFrom(module=str(module), names=names):
                if module.partition(".")[0] in OURS:
                    yield from ((module, alias.name) for alias in names)
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=ast.Name(id=name), attr=attribute) if name in known:
                yield known[name], attribute


def reaching_in(source: str) -> set[str]:
    """The modules of our packages that a source reaches into."""
    return {module for module, _ in names_used(source) if module not in OURS}


def taken(path: Path, package: str) -> set[str]:
    """The names of a package that the Python in a file takes."""
    return {name for code in python_in(path) for home, name in names_used(code) if home == package}


def test_there_are_sources_of_all_kinds() -> None:
    found = [path for path in SOURCES if any(map(list, map(names_used, python_in(path))))]
    assert {path.suffix for path in found} == {".md", ".py"} and len(found) > 25


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_examples_and_pages_import_the_packages_and_no_module_of_them(path: Path) -> None:
    assert [found for code in python_in(path) if (found := reaching_in(code))] == []


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_names_that_examples_and_pages_take_are_public(path: Path) -> None:
    assert taken(path, "contactfusion") <= set(contactfusion.__all__)


def test_the_public_names_are_these() -> None:
    assert set(contactfusion.__all__) == PUBLIC
    assert contactfusion.__all__ == sorted(PUBLIC)


def test_no_module_has_a_public_name() -> None:
    """Else the name would be the module's as soon as that is imported."""
    modules = {path.stem for path in Path(contactfusion.__file__).parent.iterdir()}
    assert modules & PUBLIC == set()


@pytest.mark.parametrize("name", contactfusion.__all__)
def test_a_public_name_has_a_docstring(name: str) -> None:
    assert documented(getattr(contactfusion, name), name)


def documented(held: object, name: str) -> bool:
    """Whether it has a docstring of its own, which dataclasses do not make by themselves."""
    text = held.__doc__ or ""
    return bool(text.strip()) and not text.startswith(f"{name}(")


def test_the_guard_sees_names_wherever_they_are_taken() -> None:
    for source, found in {
        "import contactfusion.figures": ("contactfusion.figures", ""),
        "from contactfusion.files import make_folder": ("contactfusion.files", "make_folder"),
        "from contactfusion_lab.demo import run": ("contactfusion_lab.demo", "run"),
        "def f():\n    from contactfusion import Contact": ("contactfusion", "Contact"),
        "import contactfusion as c\nc.figures.new_figure()": ("contactfusion", "figures"),
        "print(f'{cf.nothing()}')\nreturn": ("contactfusion", "nothing"),
        "contactfusion.nothing()": ("contactfusion", "nothing"),
    }.items():
        assert set(names_used(source)) == {found}, source
    assert not set(names_used("import numpy.linalg\nfrom os.path import join\nnumpy.linalg.norm"))


def test_blocks_are_found_where_they_stand() -> None:
    page = "```python\na\n```\n```yaml\nb: 1\n```\n- item\n\n  ```python\n  if c:\n      d\n  ```\n"
    assert list(blocks(page)) == ["a\n", "if c:\n    d\n"]
