"""What `plugins` tells of each plug-in without importing it."""

import sys
from pathlib import Path

import pytest

from contactfusion.cli.plugin_listing import declared
from contactfusion.plugins import KINDS, Plugin, installed_plugins

HOOK = '''
from contactfusion import hookimpl
from cf_listed.base import Elsewhere as Other
class Near:
    """Is near.

    And more."""
class Plain: pass
@hookimpl
def contactfusion_generators():
    """Offer "near"."""
    return {"near": Near, "other": Other, "plain": Plain, **{n.__name__: n for n in (Near,)}}
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package that raises when it is imported."""
    package = tmp_path / "cf_listed"
    package.mkdir()
    (package / "__init__.py").write_text("raise RuntimeError")
    (package / "base.py").write_text('class Elsewhere:\n    "Is elsewhere."\n')
    (package / "sensors.py").write_text(HOOK)
    monkeypatch.syspath_prepend(str(tmp_path))
    return package


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("near", ("generator", "Is near.")),
        ("other", ("generator", "Is elsewhere.")),
        ("plain", ("generator", "")),
        ("Near", ("generator", "")),
    ],
)
def test_kind_and_purpose_are_read_from_the_source(
    name: str, told: tuple[str, str], folder: Path
) -> None:
    assert declared(Plugin(name, "cf_listed.sensors", "")) == told
    assert "cf_listed" not in sys.modules


@pytest.mark.parametrize("text", ["def (", "\x00", "x = 1"])
def test_what_cannot_be_parsed_has_neither(text: str, folder: Path) -> None:
    (folder / "sensors.py").write_text(text)
    for module in ("cf_listed.sensors", "cf_listed.no", "no_such_module", "sys", "cf_listed"):
        assert declared(Plugin("near", module, "")) == ("", "")


def test_of_a_module_with_several_kinds_all_are_told_where_the_name_is_not_literal(
    folder: Path,
) -> None:
    hook = "\ndef contactfusion_rules(): return dict(max=max)\n"
    (folder / "sensors.py").write_text(HOOK + hook)
    assert declared(Plugin("unknown", "cf_listed.sensors", "")) == ("generator, rule", "")


def test_of_every_built_in_plugin_kind_and_purpose_are_those_of_its_class() -> None:
    plugins = installed_plugins()
    ours = [p for p in plugins.listing() if p.distribution.startswith("contactfusion ")]
    assert len(ours) >= 28
    for plugin in ours:
        kind, purpose = declared(plugin)
        cls = plugins.offers(f"{kind}s")[plugin.name]
        assert f"{kind}s" in KINDS and purpose and purpose == (cls.__doc__ or "").splitlines()[0]
