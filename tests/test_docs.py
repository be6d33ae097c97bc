"""The pages name every option, and their examples work."""

import json
import re
import runpy
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, get_args

import numpy as np
import pytest
import yaml
from pydantic import BaseModel

from contactfusion import Pipeline
from contactfusion.doctor.robot import camera_faults, finger_faults, patch_faults, wrist_faults
from contactfusion.integrator.config import PARTS, IntegratorConfig
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.plugins import installed_plugins
from contactfusion.readings import JointState, TactileImage, Wrench
from contactfusion.readings.canvas import Canvas
from contactfusion.readings.codec import Codec
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot
from contactfusion.run.configuration import RunConfig
from contactfusion.run.execute import run_file
from contactfusion.testing import check_codec, example_reading
from contactfusion.yaml_files import read_yaml
from scripts import links
from tests.kinds import Stranger, codec_of, installed

ROOT = Path(__file__).resolve().parents[1]
CONFIGURATION = ROOT / "docs" / "configuration.md"
ROBOTS = ROOT / "docs" / "robots.md"
SCENES = ROOT / "docs" / "scenes.md"
GENERATORS = {
    name: cls
    for name, cls in installed_plugins().offers("generators").items()
    if cls.__module__.startswith("contactfusion.")
}


def page(generator: str) -> Path:
    return ROOT / "docs" / "generators" / f"{generator}.md"


def examples(path: Path) -> list[dict[str, Any]]:
    blocks = re.findall(r"^```yaml\n(.*?)^```", path.read_text(), re.MULTILINE | re.DOTALL)
    return [yaml.safe_load(block) for block in blocks]


def fields(model: type[BaseModel], elsewhere: type[BaseModel] | None = None) -> Iterator[str]:
    """Every field of a model, and of the models within but for one that has a page of its own."""
    for name, info in model.model_fields.items():
        yield name
        for inner in models_in(info.annotation):
            if inner is not elsewhere:
                yield from fields(inner, elsewhere)


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from models_in(argument)


def unnamed(
    model: type[BaseModel], text: str, elsewhere: type[BaseModel] | None = None
) -> set[str]:
    """The fields that a page does not name, in code or in an example."""
    code = " ".join(re.findall(r"^```.*?^```|`[^`\n]+`", text, re.MULTILINE | re.DOTALL))
    return {name for name in fields(model, elsewhere) if not re.search(rf"\b{name}\b", code)}


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FURTHER = [
    *sorted({*ROOT.glob("*.md")} - {*PAGES}),
    *ROOT.glob("lab/*.md"),
    *ROOT.glob("examples/*/*.md"),
]


@pytest.mark.parametrize("path", [*PAGES, *sorted(FURTHER)], ids=lambda path: path.name)
def test_every_link_of_a_page_leads_to_a_file_and_to_a_heading_in_it(path: Path) -> None:
    assert links.faults(path) == []


def test_a_link_that_leads_nowhere_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# One, two\n[a](#one-two) [b](#three) ![c](no.png) [d](page.md#one-two) [e](page.md)\n"
        "[f](https://example.org/no.md) [g](page.md#four)\n```\n# three\n[h](no.md)\n```\n"
    )
    assert links.faults(page) == [
        f"{page}: {page} has no heading '#three'",
        f"{page}: there is no {tmp_path / 'no.png'}",
        f"{page}: {page} has no heading '#four'",
    ]


@pytest.mark.parametrize("name", ["ARCHITECTURE.md", "lab/ARCHITECTURE.md", "CONTRIBUTING.md"])
def test_modules_that_the_house_is_described_by_exist(name: str) -> None:
    named = set(re.findall(r"`([a-z_/0-9]+\.py)`", (ROOT / name).read_text()))
    assert len(named) > 10
    folders = (
        "contactfusion",
        "controllers",
        "generators",
        "integrator",
        "lab",
        "scripts",
        "tests",
    )
    paths = [f"/{path}" for folder in folders for path in (ROOT / folder).rglob("*.py")]
    assert {one for one in named if not any(path.endswith(f"/{one}") for path in paths)} == set()


def test_the_index_links_to_every_page() -> None:
    index = ROOT / "docs" / "index.md"
    linked = {target for target, _ in links.links(index)}
    assert linked >= {path.resolve() for path in PAGES[1:]} - {index}


def python_of(page: str) -> str:
    """The first example in Python of a page."""
    text = (ROOT / "docs" / page).read_text()
    (example, *_) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return str(example)


def test_the_example_of_the_first_fusion_prints_what_it_says(
    capsys: pytest.CaptureFixture[str],
) -> None:
    exec(python_of("first_fusion.md"), {})
    contact, without = capsys.readouterr().out.splitlines()
    assert "(0.300, 0.020, 0.100) m" in contact and "likelihood 0.90" in contact and without == "()"


def test_the_first_example_of_the_readme_prints_what_it_says(
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = (ROOT / "README.md").read_text()
    (example, *_) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    told = re.findall(r"^print\(.*\)  # (.*?)(?:: .*|, \.\.\.)$", example, re.MULTILINE)
    exec(example, {})
    printed = capsys.readouterr().out.splitlines()
    assert len(told) == len(printed) == 3
    assert [line.startswith(words) for words, line in zip(told, printed, strict=True)] == [True] * 3


def test_the_page_on_rules_says_what_its_example_prints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("sys.argv", ["compare_rules.py", str(tmp_path)])
    runpy.run_path(str(ROOT / "examples" / "compare_rules.py"))
    printed = " ".join(capsys.readouterr().out.split())
    page = (ROOT / "docs" / "rules.md").read_text()
    told = page.split("## Six situations")[1].split("## When you want another")[0]
    assert {*re.findall(r"\d+ mm off", told)} <= {*re.findall(r"\d+ mm off", printed)}
    stated = {"0.4", "0.9"}  # by sources
    likelihoods = {*re.findall(r"\b[01]\.\d+\b", told)} - stated
    assert likelihoods <= {*re.findall(r"\b[01]\.\d+\b", printed)}


@pytest.fixture
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stranger]:
    with installed(tmp_path, monkeypatch) as found:
        yield found


def test_the_kind_of_reading_of_the_page_on_plugins_keeps_the_contract(
    stranger: Stranger,
) -> None:
    pytest.importorskip("rosbags")
    blocks = re.findall(
        r"^```(python|toml)\n(.*?)^```",
        (ROOT / "docs" / "plugins.md").read_text(),
        re.MULTILINE | re.DOTALL,
    )
    (code,) = (text for language, text in blocks if language == "python" and "cf.Codec" in text)
    (point,) = (text for language, text in blocks if "contactfusion_readings" in text)
    (name, value) = re.findall(r'^(\w+) = "(.+)"$', point, re.MULTILINE)[0]
    assert value == "my_sensor:WarmthCodec"
    stranger.add(name, f"{code}\n\nTheCodec = WarmthCodec\n")
    check_codec(type(codec_of(name)))
    assert len(code.split("class WarmthColumns")[1].splitlines()) < 40


def test_the_page_on_plugins_names_every_member_of_a_codec() -> None:
    text = (ROOT / "docs" / "plugins.md").read_text()
    members = {name for name in vars(Codec) if not name.startswith("_")} - {"is_drawn"}
    assert {
        name for name in members if not re.search(rf"`[^`\n]*\b{name}\b|self.{name}", text)
    } == set()
    assert {name for name in vars(Canvas) if not name.startswith("_")} <= set(
        re.findall(r"`(\w+)`", text)
    )


def test_the_live_loop_reports_a_push_and_stops_the_robot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    surface = {"frame": "wrist", "shapes": [{"shape": "sphere", "radius": 0.05}]}
    options = {"type": "force_torque", "sensor": "wrist", "sign": "on_robot"}
    described = {"generators": {"wrist": options}, "integrator": {"frame": "wrist"}}
    (tmp_path / "hand.yaml").write_text(yaml.safe_dump({**described, "surface": surface}))

    class Driver:
        def read(self) -> Iterator[tuple[float, list[float], list[float]]]:
            yield time.monotonic(), [0.0, 0.0, -10.0], [0.0, 0.0, 0.0]

    class Robot:
        commands: ClassVar[list[object]] = []

        def is_running(self) -> bool:
            return len(self.commands) < 2

        def drive(self, command: object) -> None:
            self.commands.append(command)

        def stop(self) -> None:
            self.commands.append("stop")

    names: dict[str, Any] = {}
    exec(python_of("live.md"), names)
    names["run"](Driver(), Robot(), tmp_path / "hand.yaml")
    assert Robot.commands == [None, None, "stop"]
    assert re.search(r"contact at \(-?0\.000, -?0\.000, 0\.050\) m", capsys.readouterr().out)


@pytest.mark.parametrize("name", GENERATORS)
def test_the_page_of_a_generator_names_every_option(name: str) -> None:
    assert not unnamed(GENERATORS[name].Config, page(name).read_text())


@pytest.mark.parametrize("name", GENERATORS)
def test_the_example_of_a_generator_is_a_configuration(name: str) -> None:
    (example, *_) = examples(page(name))
    config = PipelineConfig(**example)
    config.frame_tree()
    if config.robot is not None:
        finds_its_robot(config, RobotModel(config.robot))
        return
    for options in example["generators"].values():
        built = GENERATORS[options.pop("type")].Config(**options)
        assert built.sensor in example["frames"]


def finds_its_robot(config: PipelineConfig, model: RobotModel) -> None:
    """Every generator takes a reading: the links, joints and frames that it names are there."""
    pipe = Pipeline(config)
    frames = {*config.frame_tree().frames, *model.link_names}
    rest = np.zeros(len(model.joint_names))
    joints = JointState(
        stamp=0.0, frame=model.root, names=model.joint_names, positions=rest, velocities=rest,
        efforts=np.ones(len(rest)),
    )  # fmt: skip
    pipe.receive(joints)
    for generator in pipe.generators.values():
        sensor = generator.config.sensor
        assert sensor
        if JointState in generator.readings:  # joints come in no frame of a sensor
            pipe.receive(replace(joints, sensor=sensor))
            continue
        assert sensor in frames
        reading = example_reading(generator.readings[0])
        pipe.receive(replace(reading, stamp=0.0, frame=sensor, sensor=sensor))
    sources = pipe.step(0.0).fusion.report.sources
    assert {name: (source.accepted, source.invalid) for name, source in sources.items()} == (
        dict.fromkeys(sources, (1, 0))
    )


@pytest.mark.parametrize("model", [PipelineConfig, IntegratorConfig, RunConfig])
def test_the_page_on_configuration_names_every_field(model: type[BaseModel]) -> None:
    assert not unnamed(model, CONFIGURATION.read_text(), elsewhere=RobotConfig)


def test_the_page_on_robots_names_every_field() -> None:
    assert not unnamed(RobotConfig, ROBOTS.read_text())


def test_the_example_of_the_page_on_robots_is_a_robot_without_faults() -> None:
    (described, _) = examples(ROBOTS)
    model = RobotModel(RobotConfig(**described))
    assert set(described) == set(RobotConfig.model_fields) - {"folder", "links", "files_within"}
    robot = PosedRobot(model, model.limits.mean(axis=1), model.root, np.eye(4))
    faults = [*patch_faults(model), *wrist_faults(model), *finger_faults(model)]
    assert faults + list(camera_faults(robot)) == []


def test_the_pipeline_of_the_page_on_robots_knows_its_robot(tmp_path: Path) -> None:
    described, pipeline = examples(ROBOTS)
    (tmp_path / "arm_hand.yaml").write_text(yaml.safe_dump(described))
    config = PipelineConfig(**pipeline, folder=tmp_path)
    assert config.robot is not None
    pipe = Pipeline(config)
    model = RobotModel(config.robot)
    heard = [name for name in model.joint_names if name not in described["still"]]
    rest = JointState(stamp=0.0, frame="base", names=tuple(heard), positions=np.zeros(len(heard)))
    pipe.receive(rest)
    push = {"force": np.array([0.0, 0.0, -20.0]), "torque": np.zeros(3)}
    pipe.receive(Wrench(stamp=0.0, frame="wrist_sensor", sensor="wrist", **push))
    pressed = np.zeros(15)
    pressed[7] = 40.0
    pipe.receive(TactileImage(stamp=0.0, frame="tip_1", sensor="tip_1", values=pressed))
    report = pipe.step(0.0).fusion.report
    assert {name: source.accepted for name, source in report.sources.items()} == {
        "wrist": 1,
        "tip_1": 1,
    }


def test_the_examples_of_the_page_on_scenes_are_those_that_run() -> None:
    folder = ROOT / "examples" / "scenes"
    assert examples(SCENES) == [
        read_yaml(folder / "panda.yaml"),
        read_yaml(folder / "panda_table.yaml"),
    ]


def test_the_example_of_the_page_on_configuration_holds_every_field_of_the_integrator() -> None:
    (example,) = examples(CONFIGURATION)
    assert set(example["integrator"]) == set(IntegratorConfig.model_fields) - set(PARTS.values())
    assert set(example) == set(RunConfig.model_fields) - {
        "folder",
        "identified",
        "robot",
        "scene",
        "files_within",
    }


def test_the_example_of_the_page_on_configuration_runs(tmp_path: Path) -> None:
    (example,) = examples(CONFIGURATION)
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(example))
    stamps = np.arange(0.0, 1.0, 0.01)
    pressed = stamps >= 0.5
    push = pressed[:, None] * np.array([[0.0, 0.0, -8.0, 0.0, 0.0, 0.0]])
    taxels = pressed[:, None] * np.array([[0.0, 0.0, 0.0, 0.0, 40.0, 0.0]])
    for name, columns, rows in (
        ("wrist", "fx,fy,fz,tx,ty,tz", push),
        ("palm", "p0,p1,p2,p3,p4,p5", taxels),
    ):
        table = np.column_stack([stamps, rows])
        np.savetxt(
            tmp_path / f"{name}.csv", table, delimiter=",", header=f"t,{columns}", comments=""
        )
    run_file(tmp_path / "robot.yaml", out=tmp_path / "results")
    summary = json.loads((tmp_path / "results" / "summary.json").read_text())
    accepted = {name: source["accepted"] for name, source in summary["sources"].items()}
    # two wrenches that fall into one step by rounding make hypotheses once
    assert accepted == {"wrist": pytest.approx(100, abs=1), "palm": 100}
    assert summary["steps_with_contact"] == pytest.approx(50, abs=2)
    last = (tmp_path / "results" / "contacts.csv").read_text().splitlines()[-1]
    assert "palm" in last and "wrist" in last
