"""Scenes of plug-ins: one that fails, or whose name is taken, harms no other."""

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
import yaml

from contactfusion.plugins import installed_plugins
from tests.test_cli import Ask, one_sentence
from tests.urdfs import link, written

SCENE = '''
"""A scene of which only the verdict tells who brought it."""

from contactfusion import hookimpl
from contactfusion.model import Model
from contactfusion.readings import Wrench
from contactfusion.scene import Scene
from contactfusion.stream import Facts, Verdict


class Config(Model):
    """How often the robot is pushed."""

    type: str
    pushes: int = 3


class Pushed(Scene):
    """Pushes a robot."""

    Config = Config

    def __init__(self, pushes):
        self.pushes = pushes

    @classmethod
    def opened(cls, config, robot, seed):
        return cls(config.pushes)

    def readings(self):
        push = {"force": (0.0, 0.0, -5.0), "torque": (0.0, 0.0, 0.0)}
        stamps = range(self.pushes)
        return (Wrench(stamp=float(n), frame="base", sensor="wrist", **push) for n in stamps)

    def facts(self):
        return Facts(0.0, "base", (), ())

    def verdict(self, pipeline, last):
        return Verdict({"from": __name__}, ())


@hookimpl
def contactfusion_scenes():
    return {NAMES}
'''
MODULES = {
    "cf_lab_push": SCENE.replace("NAMES", '"push": Pushed'),
    "cf_lab_touch": "import no_such_simulator\n",
    "cf_shove": SCENE.replace("NAMES", '"shove": Pushed, "push": Pushed, "touch": Pushed'),
    "cf_nudge": SCENE.replace("NAMES", '"nudge": Pushed'),
    "cf_late": SCENE.replace("def readings(", "def walk(").replace("NAMES", '"late": Pushed'),
    "cf_broken": "1 / 0\n",
}
LAB = {"push": "cf_lab_push", "touch": "cf_lab_touch"}
STRANGER = {
    "broken": "cf_broken",
    "late": "cf_late",
    "nudge": "cf_nudge",
    "push": "cf_nudge",
    "shove": "cf_shove",
}
RUN = {
    "robot": {"urdf": "robot.urdf"},
    "generators": {"wrist": {"type": "force_torque", "sign": "on_robot"}},
    "integrator": {"frame": "base"},
    "cycle": {"on": "wrist"},
}


def install(folder: Path, name: str, points: Mapping[str, str]) -> None:
    """Write the metadata of an installed distribution; the first on the path hides others."""
    info = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = "".join(f"{point} = {module}\n" for point, module in points.items())
    (info / "entry_points.txt").write_text(f"[contactfusion]\n{lines}")


@pytest.fixture
def ask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Ask]:
    """Install a laboratory and a stranger's package, and work beside a file for each scene."""
    for module, source in MODULES.items():
        (tmp_path / f"{module}.py").write_text(source)
    install(tmp_path, "contactfusion-lab", LAB)
    install(tmp_path, "stranger", STRANGER)
    written(tmp_path, link("base", '<sphere radius="0.05"/>'))
    for scene in ("push", "touch", "broken", "late", "nudge", "shove", "shov"):
        text = yaml.safe_dump({**RUN, "scene": {"type": scene}})
        (tmp_path / f"{scene}.yaml").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    installed_plugins.cache_clear()
    yield Ask(monkeypatch, capsys)
    installed_plugins.cache_clear()
    for name in MODULES:
        sys.modules.pop(name, None)


def module_of(ask: Ask, scene: str) -> str:
    """The module whose scene runs under a name."""
    answer = ask("run", f"{scene}.yaml", "--out", "results")
    assert (answer.status, answer.err) == (0, "")
    summary = json.loads(Path("results/summary.json").read_text())
    assert summary["steps"] == 3
    return str(summary["truth"]["from"])


def test_a_scene_is_listed_without_being_imported(ask: Ask) -> None:
    answer = ask("plugins")
    out = " ".join(answer.out.split())
    assert answer.status == 0 and not set(MODULES) & set(sys.modules)
    assert "nudge scene Pushes a robot. stranger 1.0" in out
    assert (
        "push (stranger 1.0) cannot be used: the name 'push' is taken by contactfusion-lab 1.0"
    ) in out


def test_the_others_run_beside_one_that_fails_and_one_whose_name_is_taken(ask: Ask) -> None:
    assert module_of(ask, "nudge") == "cf_nudge"
    assert module_of(ask, "push") == "cf_lab_push"


@pytest.mark.parametrize("command", ["run", "check"])
@pytest.mark.parametrize(
    ("scene", "cause"),
    [
        ("broken", "ZeroDivisionError: division by zero (cf_broken.py, line 1)"),
        ("late", "does not implement `readings` of Scene (cf_late.py, line 18)"),
        ("touch", "No module named 'no_such_simulator' (cf_lab_touch.py, line 1)"),
        ("shov", "unknown type 'shov'; did you mean 'shove'?"),
    ],
)
def test_a_scene_that_cannot_be_used_says_why(
    command: str, scene: str, cause: str, ask: Ask
) -> None:
    answer = ask(command, f"{scene}.yaml")
    assert answer.status == 1 and "Traceback" not in answer.err
    assert f"{scene}.yaml: " in answer.err and cause in answer.err
    assert not Path("results").exists()


def test_a_check_opens_a_scene_and_does_not_run_it(ask: Ask) -> None:
    answer = ask("check", "nudge.yaml")
    assert (answer.status, answer.err) == (0, "") and "scene: nudge" in answer.out.splitlines()
    assert "scene.pushs: unknown field; did you mean 'pushes'?" in one_sentence(
        ask("check", "nudge.yaml", "--set", "scene.pushs=1")
    )
    wrong = one_sentence(ask("check", "nudge.yaml", "--set", "robot=nowhere.yaml"))
    assert wrong.startswith("nudge.yaml: robot: ") and "nowhere.yaml" in wrong


def test_an_offer_takes_no_name_of_another_entry_point_whichever_is_imported_first(
    ask: Ask,
) -> None:
    assert module_of(ask, "shove") == "cf_shove"
    assert module_of(ask, "push") == "cf_lab_push"
    assert "No module named 'no_such_simulator'" in one_sentence(ask("run", "touch.yaml"))


def test_strict_lists_each_with_its_cause(ask: Ask) -> None:
    answer = ask("plugins", "--strict")
    assert answer.status == 1
    for line in (
        "broken cannot be used: ZeroDivisionError: division by zero (cf_broken.py, line 1)",
        "late cannot be used: Pushed does not implement `readings` of Scene (cf_late.py, line 18)",
        "shove: push cannot be used: the name 'push' is taken by cf_lab_push",
        "shove: touch cannot be used: the name 'touch' is taken by cf_lab_touch",
    ):
        assert line in answer.out.splitlines()
    assert "6 plug-ins cannot be used" in one_sentence(answer)


def test_the_doctor_lists_each_and_finds_the_framework_sound(ask: Ask) -> None:
    answer = ask("doctor")
    assert answer.status == 0
    for line in (
        "plug-in broken cannot be used: ZeroDivisionError: division by zero (cf_broken.py, "
        "line 1); mend it, or take it out: pip uninstall stranger",
        "plug-in push (stranger 1.0) cannot be used: the name 'push' is taken by "
        "contactfusion-lab 1.0; mend it, or take it out: pip uninstall stranger",
        "plug-in shove: touch cannot be used: the name 'touch' is taken by cf_lab_touch; "
        "mend it, or take it out: pip uninstall stranger",
    ):
        assert line in [found.strip() for found in answer.out.splitlines()]
