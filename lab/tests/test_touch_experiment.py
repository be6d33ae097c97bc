"""`experiment touch`: its plan, what it makes of a touch, its tables, and how it goes on."""

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial import KDTree

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RecordingError, RobotError
from contactfusion.faults import Silent
from contactfusion.files import write_npz
from contactfusion.frames import points_in
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.pipeline import Pipeline
from contactfusion.robots.model import shared_robot
from contactfusion.robots.objects import ObjectModel
from contactfusion_lab.experiments.methods import DE_MORGAN, DEFAULT_METHOD, POSTERIOR, Method
from contactfusion_lab.experiments.touch import tables
from contactfusion_lab.experiments.touch.experiment import DRAWN, METHODS, Options, run_touch
from contactfusion_lab.experiments.touch.plan import DEFAULT, SHORT, Plan, Touch, read_plan
from contactfusion_lab.experiments.touch.record import COARSEST, Arrived, Record
from contactfusion_lab.experiments.touch.rows import (
    ALL_AND_SIMULATOR,
    ROWS,
    Outcome,
    everything,
    fused,
    modality_of,
    outcome,
    shared,
)
from contactfusion_lab.experiments.touch.tables import coverage, level_of
from contactfusion_lab.experiments.touch.trial import Trial, content_of, load, run_trial
from contactfusion_lab.scenes.touch.scene import TouchScene
from contactfusion_lab.trials.measures import CASE
from lab.tests.here import Here

EXAMPLES = Path(__file__).parents[2] / "examples"
BY_NAME = {row.name: row for row in ROWS}
PLACE = np.array([0.7, 0.0, 0.3])


@pytest.fixture(scope="module")
def plan() -> Plan:
    return read_plan(DEFAULT, [], 15, "prototype", (), 3)[0]


def test_the_number_of_places_is_that_of_the_scene_or_given() -> None:
    given = [read_plan(DEFAULT, [], 15, None, (), 3, places=places)[0] for places in (None, 3)]
    assert [plan.scene.places for plan in given] == [1, 3]


@pytest.fixture(scope="module")
def felt(plan: Plan) -> Trial:
    return run_trial(plan, touch())


SMALL = Options(
    objects=("box",),
    directions=1,
    repeats=1,
    methods=(DE_MORGAN,),
    seed=5,
    executor=Here(),
    free=0.0,
)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("touch")
    run_touch(SMALL, out)
    return out


def touch(short: bool = False, target: str = "box", direction: int = 4) -> Touch:
    return Touch(target, direction, 0, short, 11)


def cloud(
    source: str, places: object, likelihoods: object, *, single: bool = False, spread: float = 0.004
) -> HypothesisCloud:
    positions = np.reshape(np.asarray(places, np.float64), (-1, 3))
    kind = HypothesisKind.SUPPORT if source in ("near", "believed") else HypothesisKind.REGULAR
    return HypothesisCloud(
        source=source,
        kind=kind,
        stamp=0.5,
        frame="base",
        positions=positions,
        likelihoods=np.broadcast_to(np.asarray(likelihoods, np.float64), len(positions)),
        spreads=np.full(len(positions), spread),
        single=single,
    )


def record(*clouds: HypothesisCloud, places: object = PLACE) -> Record:
    """A record of one moment at 0.5 s, and of what was there 50 ms before: nothing."""
    truth = np.reshape(np.asarray(places, np.float64), (-1, 3))
    history = {each.source: [Arrived(0.5, each)] for each in clouds}
    return Record(0.5, history, np.array([0.0, 0.45]), np.zeros((2, 15)), [truth[:0], truth], ())


def trial(*clouds: HypothesisCloud, places: object = PLACE, short: bool = False) -> Trial:
    truth = np.reshape(np.asarray(places, np.float64), (-1, 3))
    links, onset = ("palm",) * len(truth), 0.45 if len(truth) else np.nan
    felt = record(*clouds, places=places)
    return Trial(touch(short), felt, truth, links, True, 6.0, onset)


def equal_clouds(one: HypothesisCloud, other: HypothesisCloud, tolerance: float) -> None:
    fields = ("source", "kind", "stamp", "frame", "single", "notes")
    assert [getattr(one, name) for name in fields] == [getattr(other, name) for name in fields]
    for name in ("positions", "likelihoods", "forces", "spreads"):
        values, same = getattr(one, name), getattr(other, name)
        assert (values is None) == (same is None)
        if values is not None:
            np.testing.assert_allclose(values, same, rtol=tolerance, atol=tolerance)


def judged(recorded: Trial, row: str, plan: Plan, method: Method = DE_MORGAN) -> Outcome:
    return outcome(recorded, BY_NAME[row], method, plan.pipeline)


class TestPlan:
    def test_every_touch_has_a_twin_in_free_air_of_the_same_seed(self, plan: Plan) -> None:
        touches = plan.touches(["box", "sprayer"], 2)
        assert len(touches) == len({each.name for each in touches}) == 2 * 2 * 15 * 2
        for full, twin in zip(touches[::2], touches[1::2], strict=True):
            assert twin == replace(full, short=True)
        assert len({each.seed for each in touches}) == len(touches) // 2

    def test_a_touch_is_the_same_in_a_larger_experiment(self, plan: Plan) -> None:
        assert set(plan.touches(["box"], 1)) < set(plan.touches(["cylinder", "box"], 3))

    def test_directions_are_spread_over_what_the_arm_reaches(self, plan: Plan) -> None:
        scenes = [plan.scene_of(touch(direction=number)) for number in range(15)]
        middles = {(sum(scene.azimuth) / 2.0, sum(scene.elevation) / 2.0) for scene in scenes}
        assert len(middles) == 15
        assert {azimuth for azimuth, _ in middles} == {100.0, 140.0, 180.0, 220.0, 260.0}
        assert {elevation for _, elevation in middles} == {20.0, 45.0, 70.0}

    def test_the_twin_stops_short(self, plan: Plan) -> None:
        assert plan.scene_of(touch()).short == 0.0
        assert plan.scene_of(touch(short=True)).short == SHORT

    def test_the_simulator_believes_in_the_target_alone(self, plan: Plan) -> None:
        (simulator,) = (
            options
            for options in plan.pipeline_of("sprayer").generators.values()
            if options["type"] == "simulator"
        )
        assert list(simulator["objects"]) == ["sprayer"]

    def test_a_mesh_stands_where_the_objects_stand(self, tmp_path: Path) -> None:
        mesh = tmp_path / "wedge.obj"
        mesh.write_text(
            "v 0 0 1\nv 0.1 0 1\nv 0 0.1 1\nv 0 0 1.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
        )
        plan, targets = read_plan(DEFAULT, [str(mesh), "box"], 15, "none", (), 0)
        assert targets == ("wedge", "box")
        x, y, z = plan.scene.objects["wedge"].pose.xyz
        table = plan.scene.objects["box"].pose.xyz[2] - 0.1
        assert (x, y) == (0.7, 0.0) and z == pytest.approx(table - 1.0)

    @pytest.mark.parametrize(("name", "height"), [("mug", 0.1), ("bracket", 0.2)])
    def test_an_object_of_the_examples_stands_on_the_table(self, name: str, height: float) -> None:
        path = EXAMPLES / "objects" / f"{name}.urdf"
        plan, targets = read_plan(DEFAULT, [str(path)], 15, "none", (), 0)
        assert targets == (name,)
        pose = plan.scene.objects[name].pose
        vertices = [v for v, _ in ObjectModel(plan.scene.objects[name]).solid.meshes]
        levels = points_in(pose.pose(), np.concatenate(vertices))[:, 2]
        table = plan.scene.surroundings["table"]
        assert levels.min() == pytest.approx(table.pose.xyz[2] + 0.02)
        assert np.ptp(levels) == pytest.approx(height)

    def test_no_two_objects_have_one_name(self, tmp_path: Path) -> None:
        for folder in ("a", "b"):
            (tmp_path / folder).mkdir()
            (tmp_path / folder / "cup.obj").write_text(
                "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
            )
        cups = [str(tmp_path / folder / "cup.obj") for folder in ("a", "b")]
        with pytest.raises(ConfigurationError, match="there is an object 'cup' already: rename"):
            read_plan(DEFAULT, cups, 15, "none", (), 0)
        with pytest.raises(ConfigurationError, match="'box' stands twice among the objects"):
            read_plan(DEFAULT, ["box", "box"], 15, "none", (), 0)

    def test_a_fault_that_would_reveal_to_the_simulator_the_truth_is_refused(self) -> None:
        silent = Silent(sensor="object_pose")
        with pytest.raises(ConfigurationError, match=r"faults\.0\.sensor: without the believed"):
            read_plan(DEFAULT, [], 15, "none", (silent,), 0)

    @pytest.mark.parametrize(
        ("text", "sentence"),
        [
            ("scene:\n", "scene: give a scene of type touch"),
            ("scene: {type: touch, objects: {}}\n", "scene.*objects"),
            ("{scene: {type: touch, tool: palm, objects: &o {box: {shapes: [{shape: sphere, "
             "radius: 0.1}], pose: {parent: base}}}}}\n", "robot: a scene needs a robot by URDF"),
        ],
    )  # fmt: skip
    def test_a_file_that_describes_no_touch_is_reported(
        self, tmp_path: Path, text: str, sentence: str
    ) -> None:
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        with pytest.raises(ConfigurationError, match=sentence) as caught:
            read_plan(path, [], 15, None, (), 0)
        assert str(caught.value).startswith(f"{path}: ")

    def test_what_is_not_known_is_reported(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigurationError, match="unknown object 'boxx'; did you mean 'box'"):
            read_plan(DEFAULT, ["boxx"], 15, "none", (), 0)
        with pytest.raises(RecordingError, match=r"no file 'cup\.stl'"):
            read_plan(DEFAULT, [str(tmp_path / "cup.stl")], 15, "none", (), 0)
        with pytest.raises(ConfigurationError, match="unknown noise 'ful'; did you mean 'full'"):
            read_plan(DEFAULT, [], 15, "ful", (), 0)


class TestOneTouch:
    def test_every_generator_spoke(self, plan: Plan, felt: Trial) -> None:
        spoke = {modality_of(plan.pipeline, name) for name in felt.clouds}
        assert spoke == {*everything(plan.pipeline).modalities, "simulator"}
        assert felt.record.refused == ()

    def test_the_force_finds_the_contact(self, plan: Plan, felt: Trial) -> None:
        assert len(felt.places)
        wrist = felt.clouds["wrist"].positions
        assert np.linalg.norm(wrist - felt.places[0], axis=1).min() < 0.02

    @pytest.mark.parametrize("method", [DEFAULT_METHOD, DE_MORGAN], ids=str)
    def test_every_generator_fused_is_what_the_pipeline_fuses(
        self, plan: Plan, method: Method
    ) -> None:
        every = {
            n: generator
            for n, generator in plan.pipeline_of("box").generators.items()
            if n != "believed"
        }
        integrator = method.applied(plan.pipeline.integrator)
        given = {"generators": every, "integrator": integrator}
        pipeline = Pipeline(plan.pipeline_of("box").model_copy(update=given))
        assert plan.pipeline.robot is not None
        scene = TouchScene(plan.scene_of(touch()), shared_robot(plan.pipeline.robot), touch().seed)
        stamp = 0.0
        for reading in scene.readings():
            pipeline.receive(reading)
            stamp = reading.stamp
        live = pipeline.step(stamp).fusion.contacts
        later = fused(
            run_trial(plan, touch()).last, everything(plan.pipeline), method, plan.pipeline
        ).contacts
        assert len(live) == len(later) > 0
        for first, second in zip(live, later, strict=True):
            np.testing.assert_array_equal(first.position, second.position)
            assert first.likelihood == second.likelihood

    def test_null_is_kept_where_others_have_hypotheses(self, plan: Plan, felt: Trial) -> None:
        air = felt.clouds["air"].positions
        evidence = [
            each.positions
            for each in felt.clouds.values()
            if len(each) and (each.kind == HypothesisKind.REGULAR or each.source == "near")
        ]
        grid = Grid("base", plan.pipeline.integrator.voxel_size)
        places = np.concatenate([*felt.last.occupied, *felt.record.contacts])
        occupied = set(map(tuple, grid.voxels(places).tolist()))
        distances, _ = KDTree(np.concatenate(evidence)).query(air, p=np.inf)
        near = np.asarray(distances) < COARSEST
        there = [tuple(voxel) in occupied for voxel in grid.voxels(air).tolist()]
        assert np.all(near | np.array(there))
        assert near.any()

    def test_a_file_holds_all_of_it(self, felt: Trial, tmp_path: Path) -> None:
        (tmp_path / "one.npz").write_bytes(content_of(felt))
        back = load(tmp_path / "one.npz")
        assert (back.touch, back.links, back.steady) == (felt.touch, felt.links, felt.steady)
        assert (back.force, back.onset) == (felt.force, felt.onset)
        np.testing.assert_array_equal(back.places, felt.places)
        one, other = felt.record, back.record
        assert (one.end, one.refused) == (other.end, other.refused)
        np.testing.assert_array_equal(one.joints, other.joints)
        np.testing.assert_array_equal(one.stamps, other.stamps)
        for places, same in zip(one.contacts, other.contacts, strict=True):
            np.testing.assert_array_equal(places, same)
        assert one.history.keys() == other.history.keys()
        for name, arrived in one.history.items():
            assert [each.stamp for each in arrived] == [each.stamp for each in other.history[name]]
            for number, (before, after) in enumerate(
                zip(arrived, other.history[name], strict=True)
            ):
                last = number == len(arrived) - 1
                equal_clouds(before.cloud, after.cloud, 0.0 if last else 1e-6)

    def test_the_same_touch_gives_the_same_bytes(
        self, plan: Plan, felt: Trial, tmp_path: Path
    ) -> None:
        (tmp_path / "one.npz").write_bytes(content_of(felt))
        (tmp_path / "two.npz").write_bytes(content_of(run_trial(plan, touch())))
        assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()

    @pytest.mark.parametrize("name", ["mug", "bracket"])
    def test_an_object_of_the_examples_is_touched(self, name: str) -> None:
        path = EXAMPLES / "objects" / f"{name}.urdf"
        plan, _ = read_plan(DEFAULT, [str(path)], 15, "none", (), 0)
        made, config = run_trial(plan, touch(target=name)), plan.scene.objects[name]
        away = ObjectModel(config).distances(config.pose.pose(), made.places)
        assert len(away) and np.abs(away).max() < 0.002

    def test_the_twin_touches_nothing(self, plan: Plan) -> None:
        in_air = run_trial(plan, touch(short=True))
        assert not len(in_air.places)
        assert not len(in_air.clouds["wrist"])


class TestOutcome:
    def test_a_contact_within_three_centimetres_is_detected(self, plan: Plan) -> None:
        near = trial(cloud("tip_1", PLACE + [0.029, 0.0, 0.0], 0.9))
        far = trial(cloud("tip_1", PLACE + [0.036, 0.0, 0.0], 0.9))
        for recorded, found in ((near, True), (far, False)):
            result = judged(recorded, "tactile", plan)
            assert (result.detected, result.false, result.contacts) == (found, not found, 1)
            expected = np.linalg.norm(recorded.clouds["tip_1"].positions[0] - PLACE)
            assert result.error == pytest.approx(expected, abs=0.0045)  # half a voxel's diagonal

    def test_the_error_is_that_of_the_most_likely(self, plan: Plan) -> None:
        places = [PLACE, PLACE + [0.1, 0.0, 0.0]]
        result = judged(trial(cloud("tip_1", places, [0.5, 0.9])), "tactile", plan)
        assert result.detected and result.false == 1
        assert result.error == pytest.approx(0.1, abs=0.005)

    def test_the_nearest_of_several_true_contacts_counts(self, plan: Plan) -> None:
        truth = [PLACE + [0.1, 0.0, 0.0], PLACE]
        result = judged(trial(cloud("tip_1", PLACE, 0.9), places=truth), "tactile", plan)
        assert result.true_contacts == 2 and result.false == 0
        assert result.error < 0.005

    def test_in_free_air_every_contact_is_false(self, plan: Plan) -> None:
        result = judged(trial(cloud("tip_1", PLACE, 0.9), places=(), short=True), "tactile", plan)
        assert (result.contacts, result.false, result.detected) == (1, 1, False)
        assert np.isnan(result.error)

    def test_support_counts_only_with_evidence(self, plan: Plan) -> None:
        weak = cloud("wrist", [PLACE + [0.1 * i, 0.0, 0.0] for i in range(20)], 0.05, single=True)
        believed = cloud("believed", PLACE, 0.5)
        assert judged(trial(weak, believed), "force", plan).contacts == 0
        assert judged(trial(believed), "all + simulator", plan).contacts == 0
        assert judged(trial(weak, believed), "all + simulator", plan).detected

    def test_range_is_evidence_in_the_papers_rows_and_support_in_ours(self, plan: Plan) -> None:
        seen = trial(cloud("near", PLACE, 0.9))
        assert judged(seen, "range", plan).detected and judged(seen, "all", plan).detected
        assert judged(seen, "all, range as support", plan).contacts == 0

    def test_a_modality_can_be_left_out(self, plan: Plan) -> None:
        both = trial(cloud("tip_1", PLACE, 0.9), cloud("wrist", PLACE + 0.1, 1.0, single=True))
        assert judged(both, "all", plan).contacts == 2
        fewer = outcome(both, BY_NAME["all"], DE_MORGAN, plan.pipeline, without="force")
        assert fewer.contacts == 1 and fewer.detected
        assert fewer.row == "all without force"

    @pytest.mark.parametrize("method", [DEFAULT_METHOD, POSTERIOR], ids=str)
    def test_spreads_are_multiplied_before_they_are_fused(self, plan: Plan, method: Method) -> None:
        def unsure(spread: float, factor: float) -> float:
            line = PLACE + np.outer(np.arange(8), [0.005, 0.0, 0.0])
            likelihoods = [0.8, *[0.02] * 7]
            force = cloud("wrist", line, likelihoods, single=True, spread=spread)
            skin = replace(cloud("tip_1", PLACE, 0.9), spreads=None)  # says nothing, stays so
            wider = replace(method, spreads=factor)
            fusion = fused(trial(skin, force).last, BY_NAME["all"], wider, plan.pipeline)
            return float(np.trace(fusion.contacts[0].covariance))

        assert unsure(0.004, 2.0) == unsure(0.008, 1.0) > 1.05 * unsure(0.004, 1.0)

    def test_modalities_that_share_a_voxel(self, plan: Plan) -> None:
        felt = trial(
            cloud("tip_1", PLACE, 0.9), cloud("wrist", PLACE, 1.0), cloud("near", np.zeros(3), 0.5)
        )
        pairs = shared(felt, plan.pipeline)
        assert pairs == {
            ("force", "range"): False, ("force", "tactile"): True, ("range", "tactile"): False
        }  # fmt: skip


def outcomes(errors: FloatArray, **changes: Any) -> pd.DataFrame:
    """Touches with these errors, and as many in free air, of which every tenth alarms."""
    errors = np.asarray(errors)
    silent, n = np.isnan(errors), len(errors)
    felt = {"short": False, "true_contacts": 1, "contacts": (~silent).astype(int),
            "detected": errors <= 0.03, "false": (errors > 0.03).astype(int), "error": errors,
            "sigma": 0.01, "force": 6.0, "latency": 0.1, "gospa": np.minimum(errors, 0.03),
            "gospa_distance": errors * (errors <= 0.03), "gospa_missed": 0, "gospa_false": 0,
            "recall": 1.0, "probability": np.where(silent, 0.0, 0.9), "level": 0.5, "lost": 0,
            "radius": 0.02}  # fmt: skip
    alarms = (np.arange(n) % 10 == 0).astype(int)
    air = {"short": True, "true_contacts": 0, "contacts": alarms, "detected": False,
           "false": alarms, "error": np.nan, "sigma": np.nan, "force": 0.0,
           "latency": np.nan, "lost": 0, "probability": 0.9 * alarms, "gospa": 0.0}  # fmt: skip
    frame = pd.concat([pd.DataFrame(felt), pd.DataFrame(air, range(n))], ignore_index=True)
    names: dict[str, Any] = {CASE: "all, m", "row": "all", "object": "box", "repeat": 0}
    return frame.assign(direction=[*range(n), *range(n)], **names, **changes)


class TestTables:
    def test_figures_are_those_of_the_touches(self) -> None:
        errors = np.concatenate([np.linspace(0.001, 0.029, 60), np.full(20, 0.05), [np.nan] * 20])
        made = tables.measures_of(outcomes(errors), 0)
        found = {each.metric: each for each in made}
        assert found["detected"].value == pytest.approx(0.6)
        assert found["detected"].low < 0.6 < found["detected"].high
        assert found["any contact"].value == pytest.approx(0.8)
        assert found["false alarms in free air"].value == pytest.approx(0.1)
        assert found["false contacts a touch"].value == pytest.approx(0.2)
        reported = errors[:80]
        assert found["ε mean"].value == pytest.approx(reported.mean())
        assert found["ε median"].value == pytest.approx(np.median(reported))
        assert found["ε p90"].value == pytest.approx(np.quantile(reported, 0.9))
        assert found["ε mean"].low < reported.mean() < found["ε mean"].high
        assert "ε median of several contacts" not in found

    def test_the_table_stands_beside_the_papers(self) -> None:
        made = list(tables.measures_of(outcomes(np.full(10, 0.02)), 0))
        text = tables.table_text(made, ["all", "fingers"], "m")
        assert "| all | 90.7, 4.31, 1.10 | 100 [72, 100] |" in text
        assert "| fingers |  | - |" in text

    def test_all_tables_have_a_caption_with_the_press_force_and_the_seeds_of_tuning(self) -> None:
        text = tables.forces_text(list(np.linspace(1.0, 6.0, 11)))
        assert text.startswith(
            "11 touches, pressed with 3.5 N (median; 10 % with less than 1.5 N, 10 % with more "
            "than 5.5 N)."
        )
        assert "chosen on touches of the seeds 7 and 8" in text
        assert tables.forces_text([]).startswith("0 touches")

    def test_touches_at_one_place_and_at_several_are_distinguished(self) -> None:
        single, several = outcomes(np.full(10, 0.02)), outcomes(np.full(4, 0.07), true_contacts=2)
        frame = pd.concat([single, several[~several["short"]]])
        text = tables.contacts_text(list(tables.measures_of(frame, 0)), ["all"], "m")
        expected = (
            "10 | 2.00 [2.00, 2.00] | 2.00 [2.00, 2.00]",
            "4 | 7.00 [7.00, 7.00] | 7.00 [7.00, ",
        )
        assert f"| all | {expected[0]} | {expected[1]}" in text


class TestHonesty:
    def places(self, sigma: float) -> FloatArray:
        drawn: FloatArray = sigma * np.random.default_rng(2).standard_normal((400, 3))
        return drawn

    def test_levels_of_honest_spreads_are_uniform(self) -> None:
        rng, stated = np.random.default_rng(0), cloud("tip_1", np.zeros(3), 1.0, spread=0.01)
        levels = np.array([level_of(stated, place, rng) for place in self.places(0.01)])
        for asked in (0.25, 0.5, 0.68, 0.95):
            assert (levels <= asked).mean() == pytest.approx(asked, abs=0.06)

    def test_spreads_that_are_too_small_hold_too_few(self) -> None:
        rng, stated = np.random.default_rng(0), cloud("tip_1", np.zeros(3), 1.0, spread=0.005)
        levels = np.array([level_of(stated, place, rng) for place in self.places(0.01)])
        assert (levels <= 0.95).mean() < 0.7

    def test_likelihood_weighs(self) -> None:
        rng = np.random.default_rng(0)
        stated = cloud("wrist", [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]], [0.9, 0.1], single=True)
        assert level_of(stated, np.zeros(3), rng) < 0.05
        # of the likelier one, what is denser than a ninth of its midst: 0.9 · P(χ²₃ ≤ 2 ln 9)
        there = level_of(stated, np.array([0.3, 0.0, 0.0]), rng)
        assert there == pytest.approx(0.70, abs=0.05)

    def test_contacts_that_null_rules_out_are_counted(self, plan: Plan) -> None:
        null = replace(cloud("air", PLACE + 0.001, 1.0), kind=HypothesisKind.NULL)
        made = coverage(
            [trial(null), trial(replace(null, positions=null.positions + 0.1))],
            plan.pipeline,
            np.random.default_rng(0),
        )
        assert [(each.case, each.metric, each.value) for each in made] == [
            ("free space", "true contacts ruled out", 0.5)
        ]


class TestExperiment:
    def test_it_writes_a_row_a_touch_row_and_method(self, plan: Plan, out: Path) -> None:
        with (out / "results.csv").open() as file:
            rows = list(csv.DictReader(file))
        every = len(everything(plan.pipeline).modalities)
        assert len(rows) == 2 * (len(ROWS) + 1 + len(ALL_AND_SIMULATOR.modalities) + every)
        assert {row["touch"] for row in rows} == {"box-00-0", "box-00-0-short"}
        summary = json.loads((out / "summary.json").read_text())
        assert (summary["touches"], summary["in free air"], summary["missed"]) == (1, 1, 0)
        assert "all + simulator" in (out / "table.md").read_text()
        assert (out / "pictures" / "box-00-0_de_morgan_cluster_centroid.png").is_file()
        assert (out / "touches_de_morgan_cluster_centroid.png").is_file()

    @pytest.mark.slow
    def test_it_goes_on_where_it_was_stopped_and_ends_the_same(self, out: Path) -> None:
        kept, lost = out / "trials" / "box-00-0.npz", out / "trials" / "box-00-0-short.npz"
        before, made = kept.stat().st_mtime_ns, lost.read_bytes()
        results = (out / "results.csv").read_bytes(), (out / "summary.json").read_bytes()
        lost.unlink()
        run_touch(SMALL, out)
        assert kept.stat().st_mtime_ns == before and lost.read_bytes() == made
        assert ((out / "results.csv").read_bytes(), (out / "summary.json").read_bytes()) == results

    def test_the_default_method_is_drawn_beside_that_of_the_papers(self) -> None:
        assert METHODS[:DRAWN] == (DEFAULT_METHOD, DE_MORGAN)

    @pytest.mark.slow
    def test_other_methods_and_spreads_only_fuse_again(self, out: Path, tmp_path: Path) -> None:
        copied = tmp_path / "copy"
        shutil.copytree(out, copied)
        made = {path: path.stat().st_mtime_ns for path in (copied / "trials").iterdir()}
        run_touch(replace(SMALL, methods=(DEFAULT_METHOD, DE_MORGAN), spreads=(2.0,)), copied)
        assert {path: path.stat().st_mtime_ns for path in made} == made
        text = (copied / "table.md").read_text()
        headings = [line for line in text.splitlines() if line.startswith("## ")]
        names = [str(DEFAULT_METHOD), str(DE_MORGAN), f"{DEFAULT_METHOD}, σ × 2"]
        assert headings == [f"## {name}" for name in ("Touches", *names, "by any method")]
        assert all(f"| {name} | one contact: n | " in text for name in names)
        assert (copied / "pictures" / "box-00-0_sets_members.png").is_file()
        assert (copied / "rows_sets_members_spreads_2.png").is_file()

    @pytest.mark.slow
    def test_it_compares_methods_and_what_the_simulator_adds(
        self, plan: Plan, out: Path, tmp_path: Path
    ) -> None:
        copied = tmp_path / "copy"
        shutil.copytree(out, copied)
        run_touch(replace(SMALL, methods=(DE_MORGAN, POSTERIOR)), copied)
        tests = json.loads((copied / "summary.json").read_text())["tests"]
        compared = {
            (*comparison["case"].rsplit(", ", 1), *comparison["against"].rsplit(", ", 1))
            for comparison in tests
        }
        assert 3 * len(compared) == len(tests)
        for method in map(str, (DE_MORGAN, POSTERIOR)):
            assert ("all + simulator", method, "all", method) in compared
        wide = [row.name for row in (*ROWS, everything(plan.pipeline)) if len(row.modalities) > 1]
        between = {row for row, first, _, second in compared if first != second}
        assert between == set(wide)
        assert all(other == str(DE_MORGAN) for _, _, _, other in compared - {
            (row, str(POSTERIOR), against, str(POSTERIOR)) for row, _, against, _ in compared
        })  # fmt: skip

    def test_a_folder_of_other_settings_is_refused(self, out: Path, tmp_path: Path) -> None:
        with pytest.raises(ConfigurationError, match="touches of other noise"):
            run_touch(replace(SMALL, noise="none"), out)
        faults = tmp_path / "faults.yaml"
        faults.write_text("faults: [{fault: silent, sensor: wrist}]\n")
        with pytest.raises(ConfigurationError, match="touches of other faults"):
            run_touch(replace(SMALL, faults=faults), out)

    @pytest.mark.slow
    def test_objects_may_be_added_but_not_changed(self, out: Path, tmp_path: Path) -> None:
        copied = tmp_path / "copy"
        shutil.copytree(out, copied)
        run_touch(replace(SMALL, objects=("box", "cylinder")), copied)
        assert (copied / "trials" / "cylinder-00-0.npz").is_file()
        run_touch(SMALL, copied)  # the cylinder may stay
        settings = json.loads((copied / "settings.json").read_text())
        settings["objects"]["box"]["sigma"] = 0.03
        (copied / "settings.json").write_text(json.dumps(settings))
        with pytest.raises(ConfigurationError, match="touches of other objects 'box'"):
            run_touch(SMALL, copied)
        (copied / "settings.json").write_text("{")
        with pytest.raises(ConfigurationError, match=r"settings\.json is damaged"):
            run_touch(SMALL, copied)
        (copied / "settings.json").unlink()
        with pytest.raises(ConfigurationError, match=r"holds files, but no settings\.json"):
            run_touch(SMALL, copied)

    def test_a_file_that_is_no_touch_is_reported(self, tmp_path: Path) -> None:
        for text in ("{}", "[" * 100_000):
            write_npz(tmp_path / "one.npz", **{"told": text, "read/joints": []})
            with pytest.raises(ConfigurationError, match=r"one\.npz is no trial of this"):
                load(tmp_path / "one.npz")

    @pytest.mark.slow
    def test_a_fault_of_a_sensor_that_there_is_not_is_reported(self, tmp_path: Path) -> None:
        faults = tmp_path / "faults.yaml"
        faults.write_text("faults: [{fault: silent, sensor: wirst}]\n")
        with pytest.raises(RobotError, match=r"2 of 2 .*no reading of 'wirst' came; did you mean"):
            run_touch(replace(SMALL, faults=faults), tmp_path / "out")

    @pytest.mark.slow
    def test_touches_that_fail_are_reported_and_the_others_kept(self, tmp_path: Path) -> None:
        mesh = tmp_path / "thing.ply"
        mesh.write_text(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
            "property float z\nelement face 4\nproperty list uchar int vertex_indices\n"
            "end_header\n0 0 0\n0.1 0 0\n0 0.1 0\n0 0 0.1\n"
            "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"
        )
        options = replace(SMALL, objects=("box", str(mesh)), draw=("thing-00-0", "box-00-0"))
        with pytest.raises(RobotError, match=r"2 of 4 .*PyBullet cannot read it; it reads \.obj"):
            run_touch(options, tmp_path / "out")
        pictures = {path.name for path in (tmp_path / "out" / "pictures").iterdir()}
        assert pictures == {"box-00-0_de_morgan_cluster_centroid.png"}

    def test_a_touch_to_draw_must_be_one_of_them(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigurationError, match="unknown touch 'box-1'; did you mean"):
            run_touch(replace(SMALL, draw=("box-1",)), tmp_path)

    @pytest.mark.slow
    def test_a_silent_wrist_is_no_longer_received(self, out: Path, tmp_path: Path) -> None:
        faults = tmp_path / "faults.yaml"
        faults.write_text("faults: [{fault: silent, sensor: wrist}]\n")
        run_touch(replace(SMALL, faults=faults), tmp_path / "out")
        healthy, silent = (
            load(each / "trials" / "box-00-0.npz") for each in (out, tmp_path / "out")
        )
        assert len(healthy.clouds["wrist"]) and "wrist" not in silent.clouds
        np.testing.assert_array_equal(healthy.places, silent.places)
