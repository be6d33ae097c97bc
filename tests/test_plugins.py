"""Plug-ins: found, listed, refused and named; the documentation that tells of them."""

import inspect
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import EntryPoint, distributions
from pathlib import Path
from typing import Any

import pytest

from contactfusion import hooks
from contactfusion.errors import PluginError
from contactfusion.generator import GeneratorConfig
from contactfusion.hooks import GROUP
from contactfusion.plugins import KINDS, Plugin, Plugins, installed_plugins

ROOT = Path(__file__).parents[1]
HEAD = "from contactfusion import hookimpl\n"
OFFER = HEAD + "class {0}: pass\n@hookimpl\ndef contactfusion_{1}(): return {{'{2}': {0}}}\n"
GOOD = OFFER.format("Good", "generators", "good")

Writer = Callable[..., EntryPoint]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Writer]:
    """Write a plug-in's module, and give an entry point that leads to it."""
    monkeypatch.syspath_prepend(str(tmp_path))
    written: list[str] = []

    def writer(name: str, source: str = "", *, module: str | None = None) -> EntryPoint:
        module = module or f"cf_test_{name}"
        if source:
            (tmp_path / f"{module}.py").write_text(source)
            written.append(module)
        return EntryPoint(name, module, GROUP)

    yield writer
    for module in written:
        sys.modules.pop(module, None)


def test_listing_imports_none_of_them(write: Writer) -> None:
    plugins = Plugins(points=[write("good", GOOD), write("bad", "raise RuntimeError")])
    assert plugins.listing() == (
        Plugin("bad", "cf_test_bad", "no distribution"),
        Plugin("good", "cf_test_good", "no distribution"),
    )
    assert not {"cf_test_good", "cf_test_bad"} & set(sys.modules)
    assert plugins.failures == {}


def test_listing_what_is_installed_imports_no_generator_and_no_integrator() -> None:
    code = (
        "import sys; from contactfusion.plugins import installed_plugins\n"
        "assert installed_plugins().listing()\n"
        "heavy = [m for m in sys.modules if m.startswith(('contactfusion.g', 'contactfusion.i'))]\n"
        "assert not heavy and 'numba' not in sys.modules, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_every_built_in_plugin_loads_and_belongs_to_the_package() -> None:
    plugins = Plugins(strict=True)
    offered = {name for kind in KINDS for name in plugins.offers(kind)}
    ours = {p.name for p in plugins.listing() if p.distribution.split()[0] == "contactfusion"}
    assert {"de_morgan", "cluster_centroid"} <= ours <= offered


def test_finding_one_imports_no_more_than_its_module(write: Writer) -> None:
    plugins = Plugins(points=[write("good", GOOD), write("bad", "raise RuntimeError")])
    assert plugins.find("generators", "good").__name__ == "Good"
    assert "cf_test_bad" not in sys.modules and plugins.failures == {}


def test_a_name_that_no_entry_point_has_is_found_in_the_offers_of_all(write: Writer) -> None:
    plugins = Plugins(points=[write("other", GOOD), write("bad", "raise RuntimeError")])
    assert plugins.find("generators", "good").__name__ == "Good"


def test_every_kind_can_be_offered_by_one_module(write: Writer) -> None:
    source = (
        HEAD
        + """
class A: pass
@hookimpl
def contactfusion_generators(): return {"a": A}
@hookimpl
def contactfusion_controllers(): return {"b": A}
@hookimpl
def contactfusion_rules(): return {"c": A}
@hookimpl
def contactfusion_condensations(): return {"d": A}
@hookimpl
def contactfusion_segmenters(): return {"e": A}
@hookimpl
def contactfusion_recordings(): return {"f": A}
@hookimpl
def contactfusion_scenes(): return {"g": A}
"""
    )
    plugins = Plugins(points=[write("all", source)], strict=True)
    assert [[*plugins.offers(kind)] for kind in KINDS] == [[letter] for letter in "abcdefg"]


def test_two_entry_points_may_lead_to_one_module(write: Writer) -> None:
    points = [write("good", GOOD), write("again", module="cf_test_good")]
    assert list(Plugins(points=points, strict=True).offers("generators")) == ["good"]


BROKEN = {
    "raises at import": ("1 / 0", "ZeroDivisionError: division by zero"),
    "leaves at import": ("raise SystemExit(3)", "SystemExit: 3"),
    "is no Python": ("def (", "SyntaxError"),
    "misses a module": ("import no_such_thing_at_all", "No module named 'no_such_thing_at_all'"),
    "has an unknown hook": (
        HEAD + "@hookimpl\ndef contactfusion_generatorz(): return {}",
        "unknown hook 'contactfusion_generatorz'",
    ),
    "has a hook with arguments": (
        HEAD + "@hookimpl\ndef contactfusion_generators(robot): return {}",
        "{'robot'} are declared in the hookimpl but can not be found in the hookspec",
    ),
    "has both": (
        HEAD
        + "@hookimpl\ndef contactfusion_bogus(): return {}\n"
        + "@hookimpl\ndef contactfusion_generators(robot): return {}",
        "'robot'",
    ),
    "raises in its hook": (
        HEAD + "@hookimpl\ndef contactfusion_rules(): raise KeyError('lost')",
        "KeyError: 'lost'",
    ),
    "offers a list": (
        HEAD + "@hookimpl\ndef contactfusion_generators(): return ['a']",
        "contactfusion_generators() gives ['a'], not a mapping of classes",
    ),
    "offers nothing": (
        HEAD + "@hookimpl\ndef contactfusion_generators(): return None",
        "contactfusion_generators() gives None, not a mapping of classes",
    ),
    "offers no class": (
        HEAD + "@hookimpl\ndef contactfusion_generators(): return {'a': 7}",
        "contactfusion_generators() gives 7 for 'a', not a class",
    ),
}


@pytest.mark.parametrize(
    ("lacks", "extra"), [("torch", "learn"), ("rerun.blueprint", "view"), ("pyarrow", "parquet")]
)
def test_a_plugin_that_lacks_an_extra_says_how_to_install_it(
    lacks: str, extra: str, write: Writer, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (lacks, lacks.partition(".")[0]):
        monkeypatch.setitem(sys.modules, module, None)
    plugins = Plugins(points=[write("lacking", f"import {lacks}")])
    plugins.offers("generators")
    why = plugins.failures["lacking"]
    assert why.startswith("ModuleNotFoundError: ") and lacks.partition(".")[0] in why
    assert why.endswith(f"; install it with: pip install 'contactfusion[{extra}]'")


@pytest.mark.parametrize(("source", "cause"), BROKEN.values(), ids=BROKEN)
def test_a_broken_plugin_is_listed_with_its_cause_and_takes_no_other_down(
    source: str, cause: str, write: Writer
) -> None:
    after = OFFER.format("After", "controllers", "z")
    points = [write("broken", source), write("good", GOOD), write("z", after)]
    plugins = Plugins(points=points)
    assert list(plugins.offers("generators")) == ["good"]
    assert list(plugins.offers("controllers")) == ["z"]
    assert list(plugins.failures) == ["broken"] and cause in plugins.failures["broken"]
    assert [plugin.name for plugin in plugins.listing()] == ["broken", "good", "z"]
    with pytest.raises(PluginError) as error:
        plugins.find("rules", "broken")
    assert "the rule 'broken' cannot be used" in str(error.value) and cause in str(error.value)


@pytest.mark.parametrize("source", [source for source, _ in BROKEN.values()], ids=BROKEN)
def test_a_broken_plugin_raises_when_strict(source: str, write: Writer) -> None:
    plugins = Plugins(points=[write("broken", source)], strict=True)
    with pytest.raises(PluginError, match="the plug-in 'broken' cannot be used"):
        plugins.offers("generators")


def distribution(folder: Path, name: str, entry: str) -> list[EntryPoint]:
    """Lay out what an installed distribution leaves behind, and give its entry points."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\n{entry}\n")
    return [point for one in distributions(path=[str(folder)]) for point in one.entry_points]


@pytest.mark.parametrize("backwards", [False, True])
def test_of_two_distributions_the_first_by_name_keeps_a_name_and_ours_before_all(
    backwards: bool, tmp_path: Path
) -> None:
    points = [
        *distribution(tmp_path / "1", "aardvark", "good = a"),
        *distribution(tmp_path / "2", "zebra", "good = z"),
    ]
    points = points[::-1] if backwards else points
    plugins = Plugins(points=points)
    assert plugins.listing() == (Plugin("good", "a", "aardvark 1.0"),)
    assert plugins.failures == {"good (zebra 1.0)": "the name 'good' is taken by aardvark 1.0"}
    with pytest.raises(PluginError, match="taken by aardvark 1.0"):
        Plugins(points=points, strict=True)
    ours = Plugins(points=[*points, *distribution(tmp_path / "3", "contactfusion", "good = us")])
    assert ours.listing() == (Plugin("good", "us", "contactfusion 1.0"),)


def test_of_two_modules_that_offer_one_name_the_first_keeps_it(write: Writer) -> None:
    plugins = Plugins(points=[write("first", GOOD), write("second", GOOD)])
    assert plugins.offers("generators")["good"].__module__ == "cf_test_first"
    assert plugins.failures == {"second: good": "the name 'good' is taken by cf_test_first"}
    with pytest.raises(PluginError, match="'good' is taken by cf_test_first"):
        Plugins(points=[write("first"), write("second")], strict=True).offers("generators")


def test_an_unknown_name_gets_the_nearest_that_exists(write: Writer) -> None:
    plugins = Plugins(points=[write("good", GOOD)])
    with pytest.raises(PluginError, match="no generator 'goood'; did you mean 'good'"):
        plugins.find("generators", "goood")
    with pytest.raises(PluginError, match="no rule 'good'; there are no rules"):
        plugins.find("rules", "good")


def test_the_installed_plugins_are_found_once() -> None:
    assert installed_plugins() is installed_plugins()


def hook_signatures() -> Mapping[str, str]:
    """Give every hook with its argument list, e.g. ``contactfusion_rules()``."""
    specified = {
        name: hook
        for name, hook in vars(hooks).items()
        if hasattr(hook, f"{GROUP}_spec") and inspect.isfunction(hook)
    }
    return {
        name: f"{name}({', '.join(inspect.signature(hook).parameters)})"
        for name, hook in specified.items()
    }


def test_every_kind_has_a_hook() -> None:
    assert list(hook_signatures()) == [f"{GROUP}_{kind}" for kind in KINDS]


@pytest.mark.parametrize(("name", "signature"), hook_signatures().items())
def test_every_hook_is_documented_with_its_arguments_and_named_in_a_test(
    name: str, signature: str
) -> None:
    assert f"`{signature}`" in (ROOT / "docs" / "plugins.md").read_text()
    tests = "".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    assert f"def {name}(" in tests


@pytest.mark.parametrize("field", GeneratorConfig.model_fields)
def test_every_option_that_all_generators_have_is_documented_with_its_default(field: str) -> None:
    default: Any = GeneratorConfig.model_fields[field].default
    told = f"{default:g}" if isinstance(default, float) else str(default).lower()
    assert f"| `{field}` | {told} |" in (ROOT / "docs" / "plugins.md").read_text()


def test_the_generator_of_the_documentation_keeps_the_contract(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "plugins.md").read_text()
    blocks = [block.split("```")[0] for block in text.split("```python\n")[1:]]
    module, test = (block for block in blocks if "Whisker" in block)
    (tmp_path / "my_sensor.py").write_text(module)
    (tmp_path / "test_my_sensor.py").write_text(test)
    code = "import test_my_sensor as t; [f() for n, f in vars(t).items() if n.startswith('test')]"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)
    assert len(module.strip().splitlines()) <= 30
