"""What a push is felt with: files, what differs from them, and pushes by several sensings."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.controllers.face import NARROW
from contactfusion.errors import ConfigurationError, ContactFusionError
from contactfusion.generators import networks
from contactfusion.generators.networks import read_networks, shipped
from contactfusion.hypotheses import HypothesisKind
from contactfusion.pipeline import Pipeline
from contactfusion_lab.experiments.push.experiment import Options, read_plans, run_push
from contactfusion_lab.experiments.push.plan import Plan
from contactfusion_lab.experiments.push.suites import (
    SENSINGS,
    THRESHOLDS,
    Change,
    Sensing,
    read_sensing,
)
from contactfusion_lab.experiments.push.trial import (
    Cost,
    costs_of,
    load,
    push_cycles,
    report_costs,
    run_trial,
)
from contactfusion_lab.scenes.push.config import SkinConfig
from contactfusion_lab.scenes.push.scene import Cycle
from contactfusion_lab.trials.executor import Local
from lab.tests.test_push_experiment import content, small, target_file, targets
from tests.test_networks import some_weights, write

__all__ = ["targets"]  # a fixture
FUSED = ("skin", "lidar", "motion", "skin/free")


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """Write untrained networks."""
    (tmp_path / "networks").mkdir()
    return write(tmp_path / "networks", some_weights())


def feeling(name: str, weights: Path | None = None, **changes: Any) -> Sensing:
    return read_sensing(name, 12, Change(weights=weights, **changes))


def planned(options: Options) -> Plan:
    (plan,) = read_plans(options).values()
    return plan


def some_cycles(plan: Plan, count: int) -> list[Cycle]:
    push = plan.pushes()[0]
    pipeline = Pipeline(plan.pipeline_of(push, "tuned"), plan.sensing.ask)
    cycles = push_cycles(plan, push, pipeline)
    return [next(cycles) for _ in range(count)]


class TestSensing:
    @pytest.mark.parametrize("name", SENSINGS)
    def test_what_is_switched_on_follows_from_the_generators(
        self, name: str, weights: Path
    ) -> None:
        wanted = {
            "skin": (), "lidar": ("lidar",), "rule": ("lidar",), "rgbd": ("camera",),
            "rule_tuned": ("lidar",),
            "fused": ("lidar",), "fused_rule": ("lidar",), "fused_camera": ("lidar", "camera"),
        }  # fmt: skip
        assert feeling(name, weights).sees == wanted[name]

    def test_another_sensor_takes_the_place_of_the_files(self, weights: Path) -> None:
        suite = feeling("fused_camera", weights, lidar="lidar_tilted", camera="camera_large")
        assert suite.sees == ("lidar_tilted", "camera_large")
        assert suite.pipeline.generators["lidar"]["sensor"] == "lidar_tilted"
        assert suite.pipeline.generators["skin"]["sensor"] == "skin"
        assert suite.settings() != feeling("fused_camera", weights).settings()

    @pytest.mark.parametrize("lidar", ["", *THRESHOLDS])
    def test_the_tuned_rule_has_thresholds_of_its_own_for_each_place(self, lidar: str) -> None:
        chosen = feeling("rule_tuned", lidar=lidar).pipeline.generators["lidar"]
        assert chosen.items() >= THRESHOLDS[lidar or "lidar"].items()
        assert chosen["sensor"] == (lidar or "lidar")
        plain = feeling("rule", lidar=lidar).pipeline.generators["lidar"]
        assert (plain["touch"], plain["near"]) == (0.007, 0.002)

    def test_a_rule_takes_the_place_of_the_files(self) -> None:
        suite = feeling("skin", rule="posterior/modes")
        integrator = suite.pipeline.integrator
        assert (integrator.rule, integrator.condensation) == ("posterior", "modes")
        assert integrator.voxel_size == feeling("skin").pipeline.integrator.voxel_size
        assert suite.label == "skin-posterior_modes"

    def test_a_label_states_what_differs(self, weights: Path) -> None:
        suite = feeling("fused", weights, rule="posterior", without=("motion", "skin/free"))
        assert suite.label == "fused-posterior-without_motion-without_skin_free"

    def test_a_generator_without_a_source_is_left_out_with_its_sensor(self, weights: Path) -> None:
        suite = feeling("fused", weights, without=("lidar",))
        assert list(suite.pipeline.generators) == ["skin", "motion"]
        assert (suite.sees, dict(suite.networks)) == ((), {})

    def test_networks_are_reported_by_what_is_in_their_file(self, weights: Path) -> None:
        held = feeling("lidar", weights).settings()
        copied = weights.with_name("copied.safetensors")
        copied.write_bytes(weights.read_bytes())
        copied.with_suffix(".json").write_bytes(weights.with_suffix(".json").read_bytes())
        assert feeling("lidar", copied).settings() == held
        other = write(weights.parent, some_weights(1))
        assert feeling("lidar", other).settings() != held
        json.dumps(held)

    def test_those_of_the_package_are_taken_unless_others_are_given(
        self, weights: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(networks, "shipped", lambda: weights)
        assert feeling("lidar").settings() == feeling("lidar", weights).settings()

    def test_a_preset_replaces_what_a_file_gives(self) -> None:
        one = feeling("rgbd", preset="paper")
        camera = one.pipeline.generators["camera"]
        assert (camera["ends"], camera["margin"], camera["body"]) == ("edge", 0.0, None)
        assert feeling("rgbd").pipeline.generators["camera"]["body"]
        assert one.networks["camera"] == read_networks(shipped("paper"))[0].weights_sha256
        assert one.label == "rgbd-paper"

    def test_what_is_chosen_goes_before_the_preset(self) -> None:
        one = feeling("lidar", Path("paper_lstm"), preset="paper", rule="posterior/modes")
        assert one.networks["lidar"] == read_networks(shipped("paper_lstm"))[0].weights_sha256
        assert one.pipeline.integrator.rule == "posterior"
        assert one.label == "lidar-paper-posterior_modes"

    def test_points_are_blurred_by_skins_only(self, weights: Path) -> None:
        assert feeling("rule").face.blur == NARROW
        assert feeling("fused", weights).face.blur == pytest.approx(0.125)

    @pytest.mark.parametrize(
        ("name", "changes", "problem"),
        [
            ("skni", {}, "unknown sensing 'skni'; did you mean 'skin'"),
            ("rule", {"lidar": "lidar_sid"}, "no 'lidar_sid'; did you mean 'lidar_side'"),
            ("rule", {"camera": "camra"}, "no 'camra'; did you mean 'camera'"),
            ("rule", {"rule": "posteriro"}, "no rule 'posteriro'; did you mean 'posterior'"),
            ("rule", {"rule": "de_morgan/modes"}, "'modes' needs the rule 'posterior'"),
            ("skin", {"without": ("motion",)}, "unknown source 'motion'; .* of 'skin' are: skin"),
            ("skin", {"without": ("skin",)}, "'skin' without skin feels nothing"),
            ("lidar", {"weights": Path("no.safetensors")}, "no file 'no.safetensors'"),
        ],
    )
    def test_what_is_wrong_is_reported_in_a_sentence(
        self, name: str, changes: dict[str, Any], problem: str
    ) -> None:
        with pytest.raises(ContactFusionError, match=problem) as caught:
            read_sensing(name, 12, Change(**changes))
        assert "\n" not in str(caught.value)


class TestSources:
    def options(self, weights: Path, targets: str, **changes: Any) -> Options:
        return small(targets, sensings=("fused",), weights=weights, **changes)

    def test_all_sources_speak_unless_they_are_left_out(self, weights: Path, targets: str) -> None:
        for without in ((), ("motion",), ("skin/free",), ("motion", "skin/free")):
            plan = planned(self.options(weights, targets, without=without))
            last = some_cycles(plan, 4)[-1].step.fusion
            spoken = {
                source
                for column, source in enumerate(last.space.sources)
                if not np.isnan(last.space.source_likelihoods[:, column]).all()
            }
            assert spoken - {"lidar"} == set(FUSED) - {"lidar", *without}
            nulled = "nulled" in last.space.verdicts
            assert nulled == ("skin/free" not in without)

    def test_shares_are_those_of_the_contact_on_the_face(self, weights: Path, targets: str) -> None:
        plan = planned(self.options(weights, targets))
        track, cost = run_trial(plan, plan.pushes()[0], "tuned")
        assert dict(track.sources) == {
            "lidar": HypothesisKind.REGULAR,
            "motion": HypothesisKind.SUPPORT,
            "skin": HypothesisKind.REGULAR,
        }
        assert track.sensing == "fused" and track.shares.shape == (len(track.stamp), 3)
        reported = track.estimate > 0
        assert reported.any() and track.shares[reported].sum(axis=1) == pytest.approx(
            np.ones(reported.sum())
        )
        assert (track.shares[~reported] == 0.0).all()
        assert (track.shares[reported, list(track.sources).index("skin")] > 0.0).mean() > 0.9
        assert 0.0 < cost.sensed < cost.cpu - cost.fused.sum()

    def test_a_lone_source_has_all_of_the_contact(self, targets: str) -> None:
        plan = planned(small(targets, sensings=("rule",)))
        track, _ = run_trial(plan, plan.pushes()[0], "tuned")
        assert track.ending == "arrived"
        assert track.shares[track.estimate > 0] == pytest.approx(1.0)


class TestPlans:
    def test_every_sensing_is_fused_by_every_rule(self, weights: Path, targets: str) -> None:
        options = small(targets, sensings=("skin", "rule"), rules=("de_morgan", "posterior/modes"))
        plans = read_plans(options)
        assert list(plans) == [
            "skin-de_morgan", "skin-posterior_modes", "rule-de_morgan", "rule-posterior_modes"
        ]  # fmt: skip
        first, *others = (plan.pushes() for plan in plans.values())
        assert all(pushes == first for pushes in others)

    @pytest.mark.parametrize(
        ("changes", "problem"),
        [
            ({"sensings": ("skin", "skin")}, "'skin' stands twice among the sensings"),
            ({"rules": ("de_morgan", "de_morgan")}, "'de_morgan' stands twice among the rules"),
            ({"lidar": "lidar_side"}, "'lidar_side' was chosen, but what feels here is skin"),
            (
                {"sensings": ("lidar", "rule"), "taxels": 24},
                "--taxels is of the skin, but what feels here is lidar and rule",
            ),
            (
                {"sensings": ("lidar",), "skin": SkinConfig(activation=0.5)},
                "--activation is of the skin, but what feels here is lidar",
            ),
            ({"weights": Path("no.safetensors")}, "was given, but there are no networks in skin"),
        ],
    )
    def test_what_is_not_used_is_reported(
        self, changes: dict[str, Any], problem: str, targets: str
    ) -> None:
        with pytest.raises(ConfigurationError, match=problem):
            read_plans(small(targets, **changes))


class TestExperiment:
    @pytest.mark.slow
    def test_sensings_stand_side_by_side(
        self, targets: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        out = tmp_path / "out"
        run_push(small(targets, sensings=("skin", "rule"), controllers=("tuned", "paper")), out)
        made = {str(path.parent.relative_to(out)) for path in out.rglob("*.npz")}
        pairs = ["skin/tuned", "skin/paper", "rule/tuned", "rule/paper"]
        assert made == {f"trials/{pair}" for pair in pairs}
        rows = list(csv.DictReader((out / "results.csv").read_text().splitlines()))
        assert [f"{row['sensing']}/{row['controller']}" for row in rows[::2]] == pairs
        assert {row["sources_two"] for row in rows} == {"0"}
        assert float(rows[0]["contact_accuracy"]) > 0.9
        summary = json.loads((out / "summary.json").read_text())
        assert list(summary["reached"]) == pairs
        compared = dict.fromkeys(
            (comparison["against"], comparison["case"]) for comparison in summary["tests"]
        )
        assert list(compared) == [
            ("skin/tuned", "skin/paper"), ("skin/tuned", "rule/tuned"),
            ("skin/paper", "rule/paper"),
        ]  # fmt: skip
        assert {path.name for path in out.glob("map_*.png")} == {
            f"map_{pair.replace('/', '_')}.png" for pair in pairs
        }
        timing = json.loads((out / "timing.json").read_text())
        assert list(timing) == ["skin", "rule"]
        assert timing["rule"]["sensing_share"] > timing["skin"]["sensing_share"]
        assert "rule: " in capsys.readouterr().out

    def test_a_folder_takes_more_sensings_and_refuses_another_of_the_name(
        self, targets: str, tmp_path: Path
    ) -> None:
        out = tmp_path / "out"
        run_push(small(targets), out)
        held = content(out / "trials")
        run_push(small(targets, sensings=("rule",), rules=("posterior",)), out)
        assert held.items() < content(out / "trials").items()
        rows = list(csv.DictReader((out / "results.csv").read_text().splitlines()))
        assert [row["sensing"] for row in rows] == ["skin"] * 2 + ["rule-posterior"] * 2
        other = small(targets, sensings=("rule",), rules=("posterior",), lidar="lidar_side")
        with pytest.raises(ConfigurationError, match="pushes of other sensings 'rule-posterior'"):
            run_push(other, out)

    def test_another_lidar_pushes_too(self, tmp_path: Path) -> None:
        near = target_file(tmp_path / "near.yaml", (0.4, 0.0))
        tracks = []
        for name in ("lidar", "lidar_side"):
            out = tmp_path / name
            run_push(small(near, sensings=("rule",), lidar=name), out)
            tracks.append(load(next(out.rglob("*.npz"))))
        assert {track.ending for track in tracks} == {"arrived"}
        n = min(len(track.stamp) for track in tracks)
        assert not np.array_equal(tracks[0].lateral[:n], tracks[1].lateral[:n], equal_nan=True)

    @pytest.mark.slow
    def test_a_recording_is_of_the_sensing_that_is_named(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        near = target_file(tmp_path / "near.yaml", (0.4, 0.0))
        options = small(near, sensings=("skin", "rule"), record=("rule/tuned/box-mu1-near-000",))
        run_push(options, tmp_path / "out")
        assert (tmp_path / "out/recordings/rule/tuned/box-mu1-near-000.mcap").is_file()
        assert capsys.readouterr().out.count("film: ") == 1


@pytest.mark.slow
def test_one_worker_and_two_give_the_same_bytes(targets: str, tmp_path: Path) -> None:
    faults = Path(__file__).parents[2] / "examples" / "faults" / "push_lidar_dropout.yaml"
    options = small(targets, sensings=("rule",), faults=faults)
    for workers in (1, 2):
        run_push(replace(options, executor=Local(workers)), tmp_path / str(workers))
    assert content(tmp_path / "1") == content(tmp_path / "2")


def test_costs_are_shares_of_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    costs = [Cost(6.0, 2.0, 0.5, np.full(100, 0.004)), Cost(6.0, 1.0, 0.1, np.full(50, 0.004))]
    shares = costs_of(costs)
    assert shares["trials_per_cpu_minute"] == pytest.approx(40.0)
    assert (shares["sensing_share"], shares["fusion_share"]) == pytest.approx((0.2, 0.2))
    assert shares["cycle_p99_ms"] == pytest.approx(4.0)
    report_costs({"fused": costs}, tmp_path)
    assert json.loads((tmp_path / "timing.json").read_text()) == {"fused": shares}
    assert "fused: 40 pushes a minute" in capsys.readouterr().out
