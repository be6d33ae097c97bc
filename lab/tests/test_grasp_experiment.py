"""`experiment grasp`: the same grasps by several columns, kept, resumed, and reported."""

import csv
import json
import re
from contextlib import closing
from dataclasses import asdict, replace
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
import yaml

from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.faults import Fault, FaultFile
from contactfusion.files import make_folder
from contactfusion.pipeline import Pipeline
from contactfusion.robots.model import shared_robot
from contactfusion.run.configuration import setting_of_recording
from contactfusion.run.session import Session
from contactfusion_lab.experiments.grasp import experiment, tables
from contactfusion_lab.experiments.grasp.experiment import COLUMNS, Options, columns_of, run_grasp
from contactfusion_lab.experiments.grasp.film import recorded
from contactfusion_lab.experiments.grasp.plan import (
    DEFAULT,
    NONE,
    Column,
    Grasp,
    Plan,
    check_columns,
    chosen_sources,
    read_plan,
)
from contactfusion_lab.experiments.grasp.trial import Row, content_of, load, run_trial
from contactfusion_lab.experiments.methods import DE_MORGAN, DEFAULT_METHOD, POSTERIOR
from contactfusion_lab.scenes.grasp.scene import GraspScene, grasped
from lab.tests.here import Here
from tests.test_cli import Ask, ask

__all__ = ["ask"]

OPEN_LOOP = Column(NONE, DE_MORGAN)
FILE: dict[str, Any] = yaml.safe_load(DEFAULT.read_text())
ROW = Row(
    trial="bottle-000",
    column="none",
    object="bottle",
    seed=1,
    offset=0.01,
    yaw=3.0,
    success=True,
    ending="lifted",
    reason="held for 2.5 s",
    height=0.12,
    moved=0.02,
    fallen=False,
    corrections=1,
    time=12.0,
    force=2.0,
)

OTHER = {"type": "dipole_field", "target": [1.0, 0.0]}


def plan(**fields: Any) -> Plan:
    options = {"names": ["bottle"], "faults": (), "noise": None, "seed": 0, **fields}
    return read_plan(DEFAULT, **options)


def my_file(folder: Path, **change: Any) -> Path:
    """The packaged file, changed."""
    fields = {**FILE, "robot": "contactfusion.robots:arm_hand.yaml", **change}
    file = folder / "my.yaml"
    file.write_text(yaml.safe_dump(fields, sort_keys=False))
    return file


def in_scene(**fields: Any) -> dict[str, Any]:
    return {"scene": {**FILE["scene"], **fields}}


def bottle(**fields: Any) -> dict[str, Any]:
    scene = FILE["objects"]["bottle"]
    return {"objects": {"bottle": {**scene, "object": {**scene["object"], **fields}}}}


def chosen(**fields: Any) -> Options:
    return Options(executor=Here(), **fields)


def rows(column: str, *successes: bool) -> list[Row]:
    return [
        replace(ROW, trial=f"bottle-{number:03d}", column=column, success=success)
        for number, success in enumerate(successes)
    ]


def without_physics(monkeypatch: pytest.MonkeyPatch, done: list[str] | None = None) -> None:
    """Replace every grasp by a result; its success follows from its number."""

    def made(plan: Plan, column: Column, grasp: Grasp) -> Row:
        if done is not None:
            done.append(f"{column.name}/{grasp.name}")
        success = column.sources != NONE or grasp.repeat % 2 == 0
        return replace(
            ROW,
            trial=grasp.name,
            column=column.name,
            object=grasp.object,
            seed=grasp.seed,
            success=success,
        )

    monkeypatch.setattr(experiment, "run_trial", made)


# What makes it up


def test_a_grasp_is_the_same_for_all_columns_and_however_many_there_are() -> None:
    few, many = (plan().grasps(["bottle"], repeats) for repeats in (2, 5))
    assert many[:2] == few
    assert len({grasp.seed for grasp in many}) == 5
    assert plan(seed=1).grasps(["bottle"], 1)[0].seed != few[0].seed


def test_sources_are_chosen_by_name_or_type() -> None:
    known = plan().pipeline.generators
    assert chosen_sources("tactile", known) == ["tip_1", "tip_2", "tip_3", "palm"]
    assert chosen_sources("force_torque+motion", known) == ["wrist", "motion"]
    assert chosen_sources("palm+wrist", known) == ["palm", "wrist"]
    assert chosen_sources("none", known) == []
    assert chosen_sources("all", known) == list(known)
    with pytest.raises(ConfigurationError, match="unknown source 'writs': did you mean 'wrist'"):
        chosen_sources("motion+writs", known)
    with pytest.raises(ConfigurationError, match="'tactile' stands twice in 'tactile\\+tactile'"):
        chosen_sources("tactile+tactile", known)


@pytest.mark.parametrize(
    ("first", "second"),
    [("force_torque+motion", "motion+force_torque"), ("tactile", "tip_1+tactile")],
)
def test_a_column_that_is_the_same_as_another_is_refused(first: str, second: str) -> None:
    columns = [Column(sources, DE_MORGAN) for sources in (first, second)]
    with pytest.raises(ConfigurationError) as caught:
        check_columns(plan(), columns, DEFAULT)
    assert str(caught.value) == f"sources: '{second}' is the same as '{first}'"


def test_without_sources_the_hand_goes_to_where_the_object_should_be_and_closes() -> None:
    config = plan().pipeline_of(OPEN_LOOP)
    assert config.generators == {}
    assert config.controller is not None
    assert config.controller["corrections"] == 0 and "attempts" not in config.controller
    assert config.controller["reach"] == pytest.approx(0.28 - 0.135)


def test_a_load_is_weighed_where_the_column_feels_the_wrist() -> None:
    told = plan()
    weighs = [
        "wrist" in (told.pipeline_of(column).controller or {}) for column in (*COLUMNS, OPEN_LOOP)
    ]
    assert weighs == [True, True, False, False, True, True, True, False]


def test_columns_are_all_sources_by_all_rules() -> None:
    assert columns_of([], []) == COLUMNS
    names = [column.name for column in columns_of(["tactile", "none"], [DE_MORGAN, POSTERIOR])]
    assert names == ["tactile-de_morgan_cluster_centroid", "tactile-posterior_modes", "none"]
    assert columns_of([], [POSTERIOR])[0].method == POSTERIOR


def test_without_a_rule_all_is_fused_as_the_integrator_does_with_nothing_set() -> None:
    (tactile,) = columns_of(["tactile"], [])
    for column in (COLUMNS[0], tactile):
        config = plan().pipeline_of(column).integrator
        assert config == plan().pipeline.integrator and config.rule == "sets"
    assert {column.method for column in COLUMNS if column.sources == "all"} == {
        DEFAULT_METHOD, DE_MORGAN, POSTERIOR,
    }  # fmt: skip


def test_every_column_of_the_table_is_a_pipeline() -> None:
    for column in COLUMNS:
        config = plan().pipeline_of(column, seed=4)
        assert config.integrator.rule == column.method.rule
        assert config.seed == 4


def test_cameras_are_on_where_anybody_looks_through_them() -> None:
    planned = plan()
    (grasp,) = planned.grasps(["bottle"], 1)
    rates = [planned.scene_of(column, grasp).camera_rate for column in COLUMNS]
    assert rates == [4.0, 0.0, 0.0, 0.0, 0.0, 4.0, 4.0]


def test_each_object_changes_the_scene() -> None:
    scenes = plan(names=["bottle", "mug", "carton"], noise="none").scenes
    assert scenes["bottle"].object.urdf == "contactfusion_lab.experiments.grasp:bottle.urdf"
    assert scenes["carton"].mass == 0.5
    assert scenes["mug"].noise.force == 0.0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"objects": {}}, "objects: give a scene of type grasp, and objects by name"),
        ({"scene": None}, "objects: give a scene of type grasp"),
        ({"controller": None}, "controller: a grasp needs a controller"),
        ({"robot": None}, "robot: a scene needs a robot by URDF"),
        ({"objects": {"bottle": {"masss": 1}}}, "objects.bottle.masss: unknown field.*'mass'"),
        ({"integratr": {}}, "integratr.*did you mean 'integrator'"),
        ({"objects": {"bottle": None}}, "objects.bottle: give by field what it changes.*not None"),
        ({"objects": {"bottle": [1]}}, r"objects.bottle: give by field.*not \[1\]"),
        *(
            ({"objects": {"bottle": {}, name: {}}}, rf"objects\.{re.escape(name)}: .*no slash")
            for name in ("../mug", "my\\mug", ".mug")
        ),
        ({"controller": {"type": "reactive_grap"}}, "controller.type: .*did you mean 'reactive_gr"),
        ({"controller": {**FILE["controller"], "toll": 1}}, "controller.toll: unknown field.*tool"),
        (in_scene(tool="plam"), "objects.bottle.tool: .*unknown link 'plam'.*did you mean 'palm'"),
        (in_scene(posture={"arm_22": 0.0}), "objects.bottle.posture.arm_22: unknown joint"),
        (bottle(pose={"parent": "palm"}), "objects.bottle.object.pose.parent: .*not in 'palm'"),
        (bottle(urdf="botle.urdf"), "objects.bottle.object: .*botle.urdf"),
        (bottle(urdf="no.such:bottle.urdf"), "objects.bottle.object.urdf: .*'no.such'"),
    ],
)
def test_a_wrong_file_is_reported_in_a_sentence(
    change: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError, match=f"my.yaml: {sentence}"):
        read_plan(my_file(tmp_path, **change), [], (), None, 0)


@pytest.mark.parametrize(
    ("sources", "change", "sentence"),
    [
        (
            "none",
            {"controller": OTHER},
            "sources: open loop, 'none', is for rea",
        ),
        ("none", {"controller": {**FILE["controller"], "depth": 0.5}}, "controller.reach: .*great"),
        ("palm", {"generators": {"palm": {"type": "tactle"}}}, "generators.palm.type: .*'tactile'"),
        (
            "wrist",
            {"generators": {"wrist": {"type": "force_torque", "wrist": "writs"}}},
            "generators.wrist.wrist",
        ),
    ],
)
def test_what_a_column_cannot_be_made_of_is_reported_before_anything_is_made(
    sources: str,
    change: dict[str, Any],
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done: list[str] = []
    without_physics(monkeypatch, done)
    options = chosen(config=my_file(tmp_path, **change), sources=[sources])
    with pytest.raises(ConfigurationError, match=f"my.yaml: {sentence}"):
        run_grasp(options, tmp_path / "out")
    assert done == [] and not (tmp_path / "out").exists()


def test_a_generator_that_no_column_uses_may_be_wrong(tmp_path: Path) -> None:
    generators = {**FILE["generators"], "eye": {"type": "not_installed"}}
    planned = read_plan(my_file(tmp_path, generators=generators), [], (), None, 0)
    check_columns(planned, [Column("wrist", DE_MORGAN)], DEFAULT)


def test_an_unknown_object_is_reported_with_the_nearest() -> None:
    with pytest.raises(ConfigurationError, match="unknown object 'botle': did you mean 'bottle'"):
        plan(names=["botle"])


# One grasp


@pytest.mark.slow
def test_a_grasp_is_measured_and_its_row_kept(tmp_path: Path) -> None:
    planned = plan()
    (grasp,) = planned.grasps(["bottle"], 1)
    row = run_trial(planned, OPEN_LOOP, grasp)
    assert (row.trial, row.column, row.seed) == ("bottle-000", "none", grasp.seed)
    assert abs(row.offset) <= 0.05 + 0.003 and abs(row.yaw) <= 30.0 + 0.1
    assert row.ending in ("lifted", "missed", "dropped") and row.reason
    assert 5.0 < row.time < 30.0 and row.force > 0.0
    (tmp_path / "row.json").write_bytes(content_of(row))
    assert load(tmp_path / "row.json", OPEN_LOOP, grasp) == row


@pytest.mark.parametrize(
    "text",
    [
        '{"trial": 1',
        "[]",
        *(
            json.dumps({**asdict(ROW), **wrong})
            for wrong in ({"success": "no"}, {"seed": 1.5}, {"time": None}, {"colour": "red"})
        ),
    ],
)
def test_a_damaged_row_is_reported_in_a_sentence(text: str, tmp_path: Path) -> None:
    (tmp_path / "row.json").write_text(text)
    sentence = "row.json is no grasp of this experiment: remove it, so that it is made again"
    with pytest.raises(ConfigurationError, match=sentence):
        load(tmp_path / "row.json", OPEN_LOOP, Grasp("bottle", 0, 1))


def test_a_row_is_that_of_its_own_grasp(tmp_path: Path) -> None:
    (tmp_path / "row.json").write_bytes(content_of(ROW))
    assert load(tmp_path / "row.json", OPEN_LOOP, Grasp("bottle", 0, 1)) == ROW
    others = [
        (OPEN_LOOP, Grasp("bottle", 1, 1)),
        (OPEN_LOOP, Grasp("bottle", 0, 2)),
        (COLUMNS[0], Grasp("bottle", 0, 1)),
    ]
    for column, grasp in others:
        with pytest.raises(
            ConfigurationError, match="is none/bottle-000 of seed 1, not .*: remove it"
        ):
            load(tmp_path / "row.json", column, grasp)


def test_a_damaged_grasp_is_reported_before_others_are_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    without_physics(monkeypatch, done)
    run_grasp(chosen(repeats=1, sources=["none"]), tmp_path)
    (tmp_path / "trials" / "none" / "bottle-000.json").write_text("{")
    with pytest.raises(ConfigurationError, match=r"none/bottle-000\.json is no grasp"):
        run_grasp(chosen(repeats=3, sources=["none"]), tmp_path)
    assert len(done) == 1


# The whole


def test_all_columns_make_all_grasps_and_leave_tables_and_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    without_physics(monkeypatch)
    run_grasp(chosen(repeats=4), tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {
        "trials", "settings.json", "results.csv", "summary.json", "table.md", "success.png",
        "places.png",
    }  # fmt: skip
    rows = list(csv.DictReader((tmp_path / "results.csv").read_text().splitlines()))
    assert len(rows) == 4 * len(COLUMNS)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["reached"]["none"]["all"]["success"]["hits"] == 2
    only_other = {
        each["case"]: each["only_other"]
        for each in summary["tests"]
        if each["measure"] == "success"
    }
    assert only_other == {column.name: 2 * (column == OPEN_LOOP) for column in COLUMNS[1:]}
    assert {each["against"] for each in summary["tests"]} == {"all-sets_members"}
    output = capsys.readouterr().out
    assert "| none | 2/4 | 2/4, 50.00 % [15.0, 85.0]" in output
    assert "**none**: 2 of 4" in (tmp_path / "table.md").read_text()


def test_it_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    without_physics(monkeypatch, done)
    run_grasp(chosen(repeats=2, sources=["none"]), tmp_path)
    run_grasp(chosen(repeats=3, sources=["none", "tactile"]), tmp_path)
    assert done == [
        "none/bottle-000", "none/bottle-001",
        "tactile-sets_members/bottle-000", "tactile-sets_members/bottle-001",
        "none/bottle-002", "tactile-sets_members/bottle-002",
    ]  # fmt: skip


def test_a_folder_of_other_settings_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_physics(monkeypatch)
    run_grasp(chosen(repeats=1), tmp_path / "one")
    with pytest.raises(ConfigurationError, match="holds grasps of other seed: give another --out"):
        run_grasp(chosen(repeats=1, seed=1), tmp_path / "one")
    with pytest.raises(ConfigurationError, match="other objects 'bottle'"):
        run_grasp(chosen(repeats=1, noise="full"), tmp_path / "one")
    (tmp_path / "one" / "settings.json").write_text("{")
    with pytest.raises(ConfigurationError, match="settings.json is damaged"):
        run_grasp(chosen(repeats=1), tmp_path / "one")
    make_folder(tmp_path / "two")
    (tmp_path / "two" / "mine.txt").write_text("mine")
    with pytest.raises(ConfigurationError, match="holds files, but no settings.json"):
        run_grasp(chosen(repeats=1), tmp_path / "two")


def test_a_grasp_that_cannot_be_made_is_reported_and_the_others_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_physics(monkeypatch)

    def sometimes(plan: Plan, column: Column, grasp: Grasp) -> Row:
        if grasp.repeat == 1:
            raise RobotError("no way")
        return replace(ROW, trial=grasp.name, column=column.name, seed=grasp.seed)

    monkeypatch.setattr(experiment, "run_trial", sometimes)
    with pytest.raises(RobotError, match="1 of 2 grasps were not made: none/bottle-001: no way"):
        run_grasp(chosen(repeats=2, sources=["none"]), tmp_path)
    assert "none/bottle-001: no way" in (tmp_path / "table.md").read_text()
    assert len(list(tmp_path.glob("trials/none/*.json"))) == 1


def test_a_grasp_that_was_not_made_is_not_filmed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    without_physics(monkeypatch)

    def never(plan: Plan, column: Column, grasp: Grasp) -> Row:
        raise RobotError("no way")

    monkeypatch.setattr(experiment, "run_trial", never)
    with pytest.raises(RobotError, match="^1 of 1 grasps were not made: none/bottle-000: no way$"):
        run_grasp(chosen(repeats=1, sources=["none"], record=["bottle-000"]), tmp_path)
    assert "not filmed: none/bottle-000, which was not made" in capsys.readouterr().out


def test_a_film_that_fails_is_reported_when_all_else_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_physics(monkeypatch)

    def blind(*_: Any) -> None:
        raise RobotError("no light")

    monkeypatch.setattr(experiment, "film", blind)
    with pytest.raises(RobotError, match="^1 of 1 films were not made: none/bottle-000: no light$"):
        run_grasp(chosen(repeats=1, sources=["none"], record=["bottle-000"]), tmp_path)
    assert (tmp_path / "table.md").is_file()


def test_without_grasps_of_the_first_column_nothing_is_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_physics(monkeypatch)
    made = vars(experiment)["run_trial"]

    def not_first(plan: Plan, column: Column, grasp: Grasp) -> Any:
        if column.sources == "wrist":
            raise RobotError("no way")
        return made(plan, column, grasp)

    monkeypatch.setattr(experiment, "run_trial", not_first)
    with pytest.raises(RobotError, match="2 of 6 grasps were not made"):
        run_grasp(chosen(repeats=2, sources=["wrist", "none", "tactile"]), tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert list(summary["reached"]) == ["none", "tactile-sets_members"]
    assert summary["tests"] == []
    assert "Compared" not in (tmp_path / "table.md").read_text()


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"repeats": 0}, "repeats: it takes 1 grasp or more"),
        ({"objects": ["bottle", "bottle"]}, "bottle"),
        ({"sources": ["skin"]}, "unknown source 'skin'"),
        ({"record": ["bottle-9"]}, "unknown trial 'bottle-9'.*did you mean 'bottle-0"),
    ],
)
def test_a_wrong_option_is_reported_before_anything_is_made(
    fields: dict[str, Any], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    without_physics(monkeypatch, done)
    with pytest.raises(ConfigurationError, match=sentence):
        run_grasp(chosen(**fields), tmp_path / "out")
    assert done == [] and not (tmp_path / "out").exists()


def test_faults_reach_the_pipeline_and_the_settings(tmp_path: Path) -> None:
    fault: dict[str, Any] = {"faults": [{"fault": "zeros", "sensor": "tip_1"}]}
    planned = plan(faults=FaultFile(**fault).faults)
    assert planned.pipeline_of(COLUMNS[-1]).faults[0].sensor == "tip_1"
    assert planned.settings(COLUMNS) != plan().settings(COLUMNS)


def test_the_command_line_runs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ask: Ask
) -> None:
    without_physics(monkeypatch)
    options = ["--repeats", "2", "--sources", "wrist+motion", "--rule", "posterior/modes"]
    answer = ask("experiment", "grasp", *options, "--out", str(tmp_path))
    assert answer.status == 0, answer.err
    assert (tmp_path / "trials" / "wrist+motion-posterior_modes" / "bottle-001.json").is_file()


# Tables


def test_results_are_one_line_a_grasp(tmp_path: Path) -> None:
    tables.evaluate([ROW], ["none"], (), 0, tmp_path)
    header, line = (tmp_path / "results.csv").read_text().splitlines()
    assert header.startswith("trial,column,object,seed,offset,yaw,success,ending")
    assert line.startswith("bottle-000,none,bottle,1,0.01,3,1,lifted,held for 2.5 s")
    reached = json.loads((tmp_path / "summary.json").read_text())["reached"]["none"]["all"]
    assert (reached["endings"], reached["fallen"]) == ({"lifted": 1}, 0)


def test_columns_are_compared_with_the_first_grasp_by_grasp(tmp_path: Path) -> None:
    found = [*rows("a", True, True, True), *rows("b", True, False, False)]
    tables.evaluate(found, ["a", "b"], ["c/bottle-000: no way"], 0, tmp_path)
    first, *_ = json.loads((tmp_path / "summary.json").read_text())["tests"]
    assert (first["measure"], first["only_it"], first["only_other"], first["p"]) == (
        "success", 0, 2, 0.5,
    )  # fmt: skip
    text = (tmp_path / "table.md").read_text()
    assert "- bottle-001: +1.0 cm aside: lifted, held for 2.5 s; 12.0 cm high" in text
    assert text.endswith("## Not made\n\n- c/bottle-000: no way\n")


BIASED: dict[str, Any] = {"faults": [{"fault": "bias", "sensor": "wrist", "amount": [5.0] * 6}]}


@pytest.mark.parametrize("faults", [(), FaultFile(**BIASED).faults], ids=["healthy", "biased"])
def test_a_grasp_that_is_recorded_can_be_replayed_and_explained(
    faults: tuple[Fault, ...], tmp_path: Path
) -> None:
    planned, column = plan(faults=faults), Column("force_torque+motion", DE_MORGAN)
    (grasp,) = planned.grasps(["bottle"], 1)
    config = planned.pipeline_of(column, grasp.seed)
    assert config.robot is not None
    scene = GraspScene(planned.scene_of(column, grasp), shared_robot(config.robot), grasp.seed)
    path = tmp_path / "grasp.mcap"
    some = islice(grasped(scene, Pipeline(config)), 12)
    steps = [cycle.step for cycle in recorded(planned, column, grasp, scene, some, path)]
    setting = setting_of_recording(path)
    assert set(setting.config().generators) == {"wrist", "motion"}
    assert setting.config().faults == faults
    with closing(Session(setting, path)) as session:
        again = list(session.steps())
    assert [step.stamp for step in again[:10]] == pytest.approx(
        [each.stamp for each in steps[1:11]]
    )
    modes = [step.command.mode if step.command else "" for step in steps]
    assert [step.command.mode if step.command else "" for step in again[:10]] == modes[1:11]
