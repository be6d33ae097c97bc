"""A recording format of a third party: opened by type and by suffix, refused in a sentence."""

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from contactfusion.plugins import installed_plugins
from tests.test_cli import Ask, one_sentence
from tests.test_plugin_scenes import install

DOCS = Path(__file__).parents[1] / "docs" / "recordings.md"
SECTION = DOCS.read_text().split("## A format of your own")[1]
MODULE = re.findall(r"```python\n(.*?)```", SECTION, re.S)[0]
"""The example of the documentation."""
MODULES = {
    "cf_bumps": MODULE,
    "cf_shut": MODULE.replace("def opened(", "def open(").replace('"bumps"', '"shut"'),
    "cf_failing": MODULE.replace("return cls(", "1 / 0  # ").replace('"bumps"', '"failing"'),
}
CONFIG = """
generators: {{eye: {{type: bumper_of_test, sensor: bumper}}}}
integrator: {{frame: base}}
cycle: {{on: bumper}}
recording: {{type: {kind}, file: walk.bumps{more}}}
"""
GENERATOR = """
import numpy as np
import contactfusion as cf


class Pressed(cf.Generator[cf.GeneratorConfig]):
    \"\"\"Regular: a contact where the bumper is.\"\"\"

    Config = cf.GeneratorConfig
    readings = (cf.Switch,)
    outputs = {"": cf.HypothesisKind.REGULAR}

    def generate(self, reading, state):
        return [self.cloud(reading, np.zeros((1, 3)), np.full(1, 0.9))]


@cf.hookimpl
def contactfusion_generators():
    return {"bumper_of_test": Pressed}
"""


@pytest.fixture
def ask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Ask]:
    modules = {**MODULES, "cf_pressed": GENERATOR}
    for module, source in modules.items():
        (tmp_path / f"{module}.py").write_text(source)
    points = {"bumps": "cf_bumps", "shut": "cf_shut", "failing": "cf_failing"}
    install(tmp_path, "stranger", {**points, "bumper_of_test": "cf_pressed"})
    (tmp_path / "walk.bumps").write_text("0.5\n1.0\n1.5\n")
    for kind in ("bumps", "bumsp", "shut", "failing"):
        (tmp_path / f"{kind}.yaml").write_text(CONFIG.format(kind=kind, more=""))
    (tmp_path / "odd.yaml").write_text(CONFIG.format(kind="bumps", more=", sensr: x"))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    installed_plugins.cache_clear()
    yield Ask(monkeypatch, capsys)
    installed_plugins.cache_clear()
    for name in modules:
        sys.modules.pop(name, None)


def test_a_format_of_a_third_party_is_played_by_type_and_by_suffix(ask: Ask) -> None:
    for words in (["bumps.yaml"], ["bumps.yaml", "walk.bumps"]):
        answer = ask("run", *words, "--out", "results")
        assert (answer.status, answer.err) == (0, "")
        assert json.loads(Path("results/summary.json").read_text())["contacts"] == 3
    answer = ask("check", "bumps.yaml")
    assert answer.status == 0 and "recording: 'bumper' (Switch)" in answer.out
    assert "bumps" in ask("plugins").out and "sensor" in ask("plugins", "bumps").out


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("bumsp", "bumsp.yaml: recording.type: unknown type 'bumsp'; did you mean 'bumps'?"),
        (
            "shut",
            "shut.yaml: the plug-in 'shut' cannot be used: Bumps does not implement `opened`",
        ),
        ("failing", "failing.yaml: the plug-in 'failing' raised ZeroDivisionError: division by "),
        ("odd", "odd.yaml: recording.sensr: unknown field; did you mean 'sensor'?"),
    ],
)
def test_what_is_wrong_with_one_is_a_sentence(name: str, sentence: str, ask: Ask) -> None:
    assert one_sentence(ask("run", f"{name}.yaml")).startswith(sentence)
    assert not Path("out").exists()
