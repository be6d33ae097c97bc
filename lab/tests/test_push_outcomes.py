"""What is made of pushes: measures, causes, tables, comparisons."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.figures import new_figure
from contactfusion.files import write_whole
from contactfusion_lab.experiments.push import figures, tables
from contactfusion_lab.experiments.push.outcomes import (
    CUTOFF,
    LIMIT,
    Outcome,
    cause,
    compare_all,
    outcome,
    outcomes_of,
)
from contactfusion_lab.experiments.push.plan import (
    Plan,
    Push,
    Targets,
    read_plan,
    read_targets,
)
from contactfusion_lab.experiments.push.tables import (
    GROUPS,
    PAPER,
    Reached,
    chosen_before,
    evaluate,
    perception,
)
from contactfusion_lab.experiments.push.trial import ARRAYS, Track, content_of
from contactfusion_lab.scenes.push.config import SkinConfig
from contactfusion_lab.scenes.push.scene import Ending
from contactfusion_lab.trials.folder import as_json, trial_file
from contactfusion_lab.trials.localisation import localisation
from contactfusion_lab.trials.measures import CASE
from contactfusion_lab.trials.tables import as_csv, frame_of

PUSH = Push("box", "mu1", "grid", 3, (2.0, 1.0), 0.0, 0.0, 7)
MODES = ("push", "search", "escape", "realign", "arrived")


def track(**changes: Any) -> Track:
    """Eleven cycles, straight ahead at 1 m/s, from 1.04 m to 0.04 m before the target."""
    n = 11
    stamp = np.arange(n) / 10.0
    fields: dict[str, Any] = {
        "push": PUSH,
        "sensing": "skin",
        "controller": "tuned",
        "ending": Ending.ARRIVED,
        "within": 0.05,
        "period": 0.1,
        "modes": MODES,
        "sources": {"lidar": "regular", "motion": "support", "skin": "regular"},
        "stamp": stamp,
        "base": np.stack([stamp, np.zeros(n), np.zeros(n)], axis=1),
        "object": np.zeros((n, 3)),
        "kind": np.full(n, 2, np.uint8),
        "contact": np.tile([0.3, 0.1], (n, 1)),
        "distance": 1.04 - stamp,
        "force": np.full(n, 20.0),
        "lateral": np.full(n, 0.1),
        "estimate": np.full(n, 2, np.uint8),
        "shares": np.tile([0.5, 0.0, 0.5], (n, 1)),
        "mode": np.zeros(n, np.uint8),
        "command": np.zeros((n, 3)),
    }
    return Track(**{**fields, **changes})


def without(rows: Any, record: Track, *, felt: bool = False) -> Track:
    """Take the contact from some cycles, in truth and unless felt in the estimate."""
    kind, distance, contact = record.kind.copy(), record.distance.copy(), record.contact.copy()
    kind[rows], distance[rows], contact[rows] = 0, np.nan, np.nan
    changed = replace(record, kind=kind, distance=distance, contact=contact)
    return changed if felt else unfelt(rows, changed)


def unfelt(rows: Any, record: Track) -> Track:
    estimate, lateral = record.estimate.copy(), record.lateral.copy()
    estimate[rows], lateral[rows] = 0, np.nan
    return replace(record, estimate=estimate, lateral=lateral)


def set_of(lateral: float) -> FloatArray:
    """A contact at a position along the face, or none."""
    return np.array([[lateral]]) if np.isfinite(lateral) else np.empty((0, 1))


def keep(record: Track, out: Path) -> Path:
    path = trial_file(out, f"{record.sensing}/{record.controller}/{record.push.name}", ".npz")
    write_whole(path, content_of(record))
    return path


class TestOutcome:
    def test_arrival_with_the_contact_at_the_target_is_a_true_success(self) -> None:
        result = outcome(track())
        assert (
            result.success_true
            and result.success_estimate
            and result.ever_true
            and result.cause == ""
        )
        assert result.time == 1.0 and result.path == pytest.approx(1.0)
        assert result.final_distance == result.least_distance == pytest.approx(0.04)

    def test_arrival_declared_too_early_is_one_by_estimate_only(self) -> None:
        result = outcome(track(distance=1.06 - np.arange(11) / 10.0))
        assert (result.success_true, result.success_estimate, result.ever_true) == (
            False,
            True,
            False,
        )
        assert result.cause == "arrived by estimate, 6.00 cm away in truth"

    def test_arrival_without_true_contact_is_no_true_success(self) -> None:
        result = outcome(without([10], track(), felt=True))
        assert not result.success_true and result.cause.endswith("without contact in truth")
        assert result.final_distance == pytest.approx(0.14)

    def test_arrival_declared_after_it_has_left_again_is_no_true_success(self) -> None:
        result = outcome(track(distance=np.abs(0.8 - np.arange(11) / 10.0)))
        assert result.ever_true and result.success_estimate and not result.success_true

    def test_to_have_been_there_is_not_to_arrive(self) -> None:
        passing = np.abs(0.5 - np.arange(11) / 10.0)
        result = outcome(track(distance=passing, ending=Ending.TIMEOUT))
        assert result.ever_true and not result.success_true and not result.success_estimate
        assert result.least_distance == 0.0 and result.final_distance == 0.5

    def test_lateral_places_are_means_of_what_is_there(self) -> None:
        result = outcome(unfelt([0, 1], track(lateral=np.linspace(-0.2, 0.2, 11))))
        assert result.lateral_true == pytest.approx(0.1)
        assert result.lateral_estimate == pytest.approx(
            np.abs(np.linspace(-0.2, 0.2, 11))[2:].mean()
        )
        errors = np.linspace(-0.2, 0.2, 11)[2:] - 0.1
        assert result.location_rmse == pytest.approx(np.sqrt((errors**2).mean()))
        assert result.type_accuracy == pytest.approx(9 / 10)

    def test_gospa_of_cycles_is_that_of_sets_of_one_contact_at_most(self) -> None:
        lateral = np.array([0.1, 0.1, 0.13, 0.25, np.nan, 0.1, 0.0, np.nan, 0.1, 0.19, 0.05])
        moved = without([5, 7], track(lateral=lateral), felt=True)
        one = outcome(moved)
        found = [
            localisation(set_of(true), set_of(estimated), CUTOFF)
            for true, estimated in zip(moved.contact[1:, 1], moved.lateral[1:], strict=True)
        ]
        assert one.gospa == pytest.approx(np.mean([each.gospa for each in found]))
        assert one.missed == sum(each.missed for each in found) / 10 == 0.3
        assert one.false == sum(each.false for each in found) / 10 == 0.3
        assert one.gospa_distance == pytest.approx(np.sqrt((0.03**2 + 0.09**2 + 0.05**2) / 5))

    def test_a_failure_counts_with_the_time_limit(self) -> None:
        assert outcome(track()).time_to_success == 1.0
        assert outcome(track(ending=Ending.AWAY)).time_to_success == LIMIT == 300.0

    def test_whether_there_is_a_contact_may_be_right_where_its_kind_is_not(self) -> None:
        kinds = np.array([2, 1, 1, 1, 2, 2, 2, 2, 2, 0, 0], np.uint8)
        result = outcome(track(estimate=kinds))
        assert (result.type_accuracy, result.contact_accuracy) == (5 / 10, 8 / 10)

    def test_sources_count_where_they_have_a_share_and_there_is_a_contact(self) -> None:
        shares = np.zeros((11, 3))
        shares[1:9] = [0.5, 0.0, 0.5]
        shares[3:6] = [0.0, 0.2, 0.8]
        shares[6] = [1.0, 0.0, 0.0]
        result = outcome(without([8], track(shares=shares), felt=True))
        assert result.sources_two == pytest.approx(6 / 9)
        assert result.evidence_two == pytest.approx(3 / 9)

    def test_a_contact_that_is_felt_but_not_there_has_no_error(self) -> None:
        result = outcome(without([4, 5], track(lateral=np.full(11, 0.12)), felt=True))
        assert result.location_rmse == pytest.approx(0.02)
        assert result.type_accuracy == pytest.approx(8 / 10)

    def test_turning_counts_until_the_contact_is_nearest(self) -> None:
        yaw = np.array([0.0, 0.1, -0.1, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0])
        base = np.stack([np.zeros(11), np.zeros(11), yaw], axis=1)
        distance = np.abs(0.5 - np.arange(11) / 10.0)
        assert outcome(track(base=base, distance=distance)).swept == pytest.approx(0.4 / 0.5)

    def test_turning_across_the_wrap_is_small(self) -> None:
        base = np.zeros((11, 3))
        base[:, 2] = np.where(np.arange(11) % 2, np.pi - 0.01, -np.pi + 0.01)
        assert outcome(track(base=base)).swept == pytest.approx(10 * 0.02 / 1.0)

    def test_searches_and_escapes_are_counted_where_they_begin(self) -> None:
        mode = np.array([1, 1, 0, 1, 2, 2, 3, 3, 0, 2, 4], np.uint8)
        result = outcome(track(mode=mode))
        assert (result.searches, result.escapes) == (2, 2)
        assert result.realigning == pytest.approx(2 / 10)

    def test_time_without_contact_is_the_truths(self) -> None:
        assert outcome(without([2, 3], track())).without_contact == pytest.approx(0.2)

    def test_the_row_before_any_cycle_has_no_part_in_shares(self) -> None:
        mode = np.array([3] + [0] * 10, np.uint8)
        result = outcome(without([0], track(mode=mode, estimate=np.full(11, 2, np.uint8))))
        assert (result.without_contact, result.type_accuracy, result.realigning) == (0.0, 1.0, 0.0)

    def test_a_push_that_ends_before_any_cycle_has_no_shares(self) -> None:
        arrays = {name: getattr(track(), name)[:1] for name in ARRAYS}
        result = outcome(track(**arrays))
        assert np.isnan([result.type_accuracy, result.realigning]).all()

    def test_a_push_that_never_touches_has_no_places(self) -> None:
        result = outcome(without(slice(None), track(ending=Ending.LOST)))
        values = [result.final_distance, result.swept, result.lateral_true, result.location_rmse]
        assert np.isnan(values).all() and result.cause == "never touched"

    def test_a_row_holds_successes_as_0_or_1_and_nothing_for_no_value(self) -> None:
        text = as_csv(outcomes_of([without(slice(None), track())]))
        (row,) = csv.DictReader(text.splitlines())
        assert (row["success_true"], row["success_estimate"]) == ("0", "1")
        assert (row["trial"], row["target_x"], row["swept"]) == ("box-mu1-grid-003", "2", "")


class TestCause:
    def test_a_contact_that_is_not_felt(self) -> None:
        record = unfelt(slice(1, None), track(ending=Ending.TIMEOUT, force=np.full(11, 1.4)))
        assert cause(record) == "felt nothing: presses with 1.4 N, under the activation"

    def test_a_contact_that_is_hardly_felt(self) -> None:
        record = unfelt(slice(1, 6), track(ending=Ending.TIMEOUT))
        assert cause(record).endswith("at best 0.04 m away; only 55% of the contact felt")

    def test_an_object_that_is_carried_away(self) -> None:
        assert cause(track(ending=Ending.AWAY)).startswith("object carried out of the field")

    def test_a_contact_that_is_lost_for_good(self) -> None:
        lateral = np.tile([0.3, 0.28], (11, 1))
        record = without(slice(3, None), track(ending=Ending.LOST, contact=lateral))
        assert (
            cause(record)
            == "lost at the left edge after 0.2 s, never found again; at best 0.84 m away"
        )

    def test_a_contact_that_is_lost_again_and_again(self) -> None:
        record = without([1, 3, 5, 7, 9, 10], track(ending=Ending.LOST))
        assert cause(record) == "lost 5 times, last +10 cm aside; at best 0.24 m away"

    def test_a_push_that_comes_no_nearer(self) -> None:
        distance = np.array([0.9, 0.7, 0.5, 0.51, 0.49, 0.5, 0.5, 0.6, 0.6, 0.5, 0.5])
        mode = np.array([0, 0, 0, 3, 3, 3, 3, 0, 0, 3, 3], np.uint8)
        result = track(
            ending=Ending.TIMEOUT, distance=distance, mode=mode, stamp=np.arange(11.0) * 10
        )
        assert cause(result) == "no progress for 80 s, mostly realign; at best 0.49 m away"


def outcomes(won: list[bool], controller: str = "tuned", **changes: Any) -> list[Outcome]:
    """One push to each target of the grid, with true success or without."""
    made = outcome(track(controller=controller))
    return [
        replace(made, trial=f"box-mu1-grid-{number:03d}", success_true=hit, **changes)
        for number, hit in enumerate(won)
    ]


def framed(found: list[Outcome]) -> pd.DataFrame:
    frame = frame_of(found, Outcome)
    return frame.assign(**{CASE: frame["sensing"] + "/" + frame["controller"]})


class TestTables:
    def test_the_table_stands_beside_the_papers(self) -> None:
        found = framed(outcomes([True] * 18 + [False] * 6))
        text = tables.success_text(found, "grid", "nominal")
        assert "| *paper, contact skin* | 23/24 | 23/24, 95.83 % |" in text
        assert "| skin/tuned, true | 18/24 | 18/24, 75.00 % [" in text
        assert "| skin/tuned, by estimate | 24/24 |" in text

    def test_other_targets_and_objects_have_no_row_of_the_papers(self) -> None:
        found = framed(outcomes([True]))
        assert "paper" in tables.success_text(found, "grid", "nominal")
        assert "paper" not in tables.success_text(found, "validation", "nominal")
        assert "paper" not in tables.success_text(found, "grid", "random")
        lshape = framed(outcomes([True], object="lshape"))
        assert "paper" not in tables.success_text(lshape, "grid", "nominal")

    def test_a_controller_that_lacks_an_object_has_no_share_of_it(self) -> None:
        first, second = outcomes([True]), outcomes([True], object="prism")
        found = framed([*first, *second, *outcomes([False], "paper")])
        text = tables.success_text(found, "grid", "nominal")
        assert "| skin/tuned, true | 1/1 | 1/1 | 2/2" in text
        assert "| skin/paper, true | 0/1 | - | 0/1" in text

    def test_other_targets_have_other_rows_of_the_papers(self) -> None:
        (result,) = outcomes([True])
        found = framed([result])
        new = tables.success_text(found, "new", "nominal")
        assert "| *paper, LiDAR* | 12/12 | 12/12, 100.00 % |" in new
        assert "skin*" not in new and "RGB-D" not in new
        whole = [replace(result, object=name, friction=friction) for name, friction in GROUPS]
        new = tables.success_text(framed(whole), "new", "nominal")
        assert "| *paper, LiDAR* | 12/12 | 12/12 | 11/12 | 11/12 | 11/12 | 12/12 | 69/72" in new
        assert "| *paper, RGB-D* | - | - | - | - | - | - | 62/72, 86.11 % |" in new

    def test_perception_stands_beside_the_papers(self) -> None:
        estimate = np.array([2, 1, 1, 1, 2, 2, 2, 2, 2, 0, 0], np.uint8)
        found = {"rule/tuned": perception([track(lateral=np.full(11, 0.12), estimate=estimate)], 0)}
        text = tables.perception_text(found, "grid", "nominal")
        assert "| *paper, LiDAR* | 4.15 | 89.4 | - |" in text
        assert "| rule/tuned | 2.00 [2.00, 2.00] | 50.0 [50.0, 50.0] | 80.0 [" in text
        assert "92.8 |" in tables.perception_text(found, "new", "nominal")
        assert "paper" not in tables.perception_text(found, "grid", "random")

    @pytest.mark.parametrize("row", PAPER)
    def test_the_papers_figures_give_its_rate(self, row: Reached) -> None:
        n = row.each * len(GROUPS)
        hits = sum(row.hits) if row.hits else round(row.share * n)
        assert hits / n == pytest.approx(row.share, abs=5e-5)

    def test_failures_are_listed_with_their_causes(self) -> None:
        made = outcomes([True, False], cause="never touched")
        text = tables.failures_text(framed(made))
        assert "1 of 2 without success" in text
        assert "- box-mu1-grid-001 to (2.00, 1.00): never touched" in text


class TestComparisons:
    def test_measures_are_compared_where_both_succeed(self) -> None:
        first = [replace(outcome, time=10.0 + n) for n, outcome in enumerate(outcomes([True] * 9))]
        other = [replace(outcome, time=12.0 + 2.0 * n, controller="paper")
                 for n, outcome in enumerate(outcomes([True] * 9))]  # fmt: skip
        other[0] = replace(other[0], success_true=False, time=1000.0)
        found = {each.measure: each for each in compare_all(framed([*first, *other]), 0)}
        assert (found["success_true"].trials, found["time"].trials) == (9, 8)
        assert found["time"].difference == 6.5 and found["time"].case == "skin/paper"
        assert found["time"].stars == "**" and found["swept"].stars == "n.s."

    def test_each_is_compared_with_the_first_that_differs_in_one_respect(self) -> None:
        pairs = [(s, c) for s in ("skin", "rule") for c in ("tuned", "paper")] + [("fused", "own")]
        found = [outcome for s, c in pairs for outcome in outcomes([True], c, sensing=s)]
        tests = compare_all(framed(found), 0)
        assert list(
            dict.fromkeys((comparison.against, comparison.case) for comparison in tests)
        ) == [
            ("skin/tuned", "skin/paper"),
            ("skin/tuned", "rule/tuned"),
            ("skin/paper", "rule/paper"),
            ("skin/tuned", "fused/own"),
        ]


def planned(targets: Targets, objects: tuple[str, ...] = (), starts: str = "nominal") -> Plan:
    return read_plan("skin", objects, (), (), targets, starts, 12, SkinConfig(), (), 5)


def pushed(plan: Plan, controller: str, out: Path) -> None:
    """Write a track of every push."""
    for push in plan.pushes():
        result = track(push=push, sensing=plan.sensing.label, controller=controller)
        keep(result, out)


class TestEvaluation:
    @pytest.mark.slow
    def test_all_that_a_folder_holds_is_reported_in_the_order_of_its_settings(
        self, tmp_path: Path
    ) -> None:
        new, grid = (planned(read_targets(name), ("cylinder", "box")) for name in ("new", "grid"))
        lone = planned(Targets("random", None, 3), ("prism",))
        for result, controller in (
            (new, "paper"),
            (grid, "tuned"),
            (new, "tuned"),
            (lone, "tuned"),
        ):
            pushed(result, controller, tmp_path)
        settings = lone.settings(["paper", "tuned", "tuned_neither"])
        settings["objects"] = dict.fromkeys(("cylinder", "box", "prism"))
        settings["targets"] = {**new.settings([])["targets"], "random": "by chance"} | (
            grid.settings([])["targets"]
        )
        evaluate(grid, settings, [], tmp_path, {})
        rows = list(csv.DictReader((tmp_path / "results.csv").read_text().splitlines()))
        assert [row["controller"] for row in rows] == ["paper"] * 48 + ["tuned"] * (48 + 3 + 96)
        assert [row["trial"] for row in rows][48:100:12] == [
            "cylinder-mu1-new-000", "cylinder-mu2-new-000", "box-mu1-new-000", "box-mu2-new-000",
            "prism-mu1-random-000",
        ]  # fmt: skip
        summary = json.loads((tmp_path / "summary.json").read_text())
        assert summary["targets"] == ["new", "random", "grid"]
        assert [
            (comparison["against"], comparison["case"], comparison["trials"])
            for comparison in summary["tests"]
        ] == [("skin/paper", "skin/tuned", 48)] * 7
        table = (tmp_path / "table.md").read_text()
        assert table.count("*paper, contact skin*") == 1 and "| skin/paper, true | 12/12 |" in table

    @pytest.mark.parametrize(
        "change",
        [
            {"seed": 8},
            {"target": (1.0, 1.5)},
            {"offset": 0.1},
            {"number": 7},
            {"friction": "mu3"},
            {"object": "prism"},
            {"targets": "new"},
        ],
    )
    def test_a_push_that_is_not_the_plans_is_refused(
        self, change: dict[str, Any], tmp_path: Path
    ) -> None:
        made = planned(Targets("near", ((0.4, 0.0),)), ("box",))
        push = replace(made.pushes()[0], **change)
        path = keep(track(push=push), tmp_path)
        with pytest.raises(ConfigurationError, match=f"^{path} holds another push than"):
            evaluate(made, made.settings(["tuned"]), [], tmp_path, {})

    def test_a_push_that_is_not_its_files_is_refused(self, tmp_path: Path) -> None:
        made = planned(Targets("random", None, 2), ("box",), "random")
        pushed(made, "tuned", tmp_path)
        folder = tmp_path / "trials" / "skin" / "tuned"
        evaluate(made, made.settings(["tuned"]), [], tmp_path, {})
        (folder / "box-mu1-random-000.npz").rename(folder / "box-mu2-random-000.npz")
        with pytest.raises(ConfigurationError, match=r"box-mu2-random-000\.npz holds another"):
            evaluate(made, made.settings(["tuned"]), [], tmp_path, {})

    def test_three_random_targets_give_all_figures(self, tmp_path: Path) -> None:
        made = planned(Targets("random", None, 3))
        pushed(made, "tuned", tmp_path)
        evaluate(made, made.settings(["tuned"]), [], tmp_path, {})
        names = {path.name for path in tmp_path.glob("*.png")}
        assert names == {"map_skin_tuned.png", "paths_skin_tuned.png", "bars.png"}

    def test_panels_reach_as_far_as_all_targets_and_one_without_any_does_not_fail(self) -> None:
        axes = new_figure(3.0, 3.0).subplots()
        figures._floor(axes, framed([]))  # pyright: ignore[reportPrivateUsage]
        assert axes.get_xlim() == (-figures.REACH[0], figures.REACH[0])
        (far,) = outcomes([True], target_x=-4.0)
        figures._floor(axes, framed([far]))  # pyright: ignore[reportPrivateUsage]
        assert axes.get_xlim() == pytest.approx((-4.3, 4.3))

    def test_json_has_null_for_what_is_no_number(self) -> None:
        value = {"p": float("nan"), "rows": [(float("inf"), 1.5, True, 3, "x", None)]}
        assert json.loads(as_json(value)) == {"p": None, "rows": [[None, 1.5, True, 3, "x", None]]}


def test_tables_say_what_was_tuned_and_trained_before() -> None:
    learned = {"skin": {}, "fused": {"lidar": "192 simulated pushes"}}
    assert chosen_before({"controllers": {"paper": {}}}, {"skin": {}}) == []
    tuned, trained = chosen_before({"controllers": {"paper": {}, "tuned": {}}}, learned)
    assert tuned.startswith("`tuned`: parameters searched on random pushes")
    assert trained == "networks of `fused`, lidar: 192 simulated pushes"
