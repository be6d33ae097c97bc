"""Sensors that fail in pushes: at random times, and from where they are not believed to be."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError
from contactfusion.faults import Dropout, Silent
from contactfusion_lab.experiments.push.experiment import Options, read_plans, run_push
from contactfusion_lab.experiments.push.failing import RandomFault, drawn, read_failing
from contactfusion_lab.experiments.push.plan import Plan
from contactfusion_lab.experiments.push.trial import Track, load, run_trial
from lab.tests.test_push_experiment import content, small, target_file, targets
from tests.test_networks import some_weights, write

__all__ = ["targets"]  # a fixture
EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "faults").glob("push_*.yaml"))


def failing(folder: Path, text: str) -> Path:
    path = folder / "failing.yaml"
    path.write_text(text)
    return path


def planned(options: Options) -> Plan:
    (plan,) = read_plans(options).values()
    return plan


def tracked(options: Options, number: int = 0) -> Track:
    plan = planned(options)
    return run_trial(plan, plan.pushes()[number], "tuned")[0]


class TestTimes:
    FAULT = RandomFault({"fault": "silent", "sensor": "skin", "start": [1.0, 15.0], "end": 20})

    def test_they_are_drawn_for_each_push_and_again_the_same(self) -> None:
        starts = [drawn([self.FAULT], seed)[0].start or 0.0 for seed in range(300)]
        assert starts == [drawn([self.FAULT], seed)[0].start for seed in range(300)]
        assert 1.0 <= min(starts) < 1.5 and 14.5 < max(starts) <= 15.0
        assert np.mean(starts) == pytest.approx(8.0, abs=0.7)
        assert {drawn([self.FAULT], seed)[0].end for seed in range(3)} == {20.0}

    def test_each_fault_has_chance_of_its_own(self) -> None:
        other = RandomFault({"fault": "zeros", "sensor": "lidar", "start": [1.0, 15.0]})
        first, second = drawn([self.FAULT, other], 7)
        assert first.start != second.start
        assert drawn([self.FAULT, self.FAULT], 7)[0] == first == drawn([self.FAULT], 7)[0]

    def test_a_fault_without_a_range_is_what_it_was(self) -> None:
        fields = {"fault": "dropout", "sensor": "lidar", "probability": 0.3}
        assert drawn([RandomFault(fields)], 3) == (Dropout(sensor="lidar", probability=0.3),)

    def test_pushes_have_the_times_of_their_seeds(self, targets: str, tmp_path: Path) -> None:
        path = failing(tmp_path, "faults: [{fault: silent, sensor: skin, start: [1, 15]}]")
        plan = planned(small(targets, faults=path))
        made = [plan.pipeline_of(push, "tuned").faults for push in plan.pushes()]
        assert made[0] != made[1] and isinstance(made[0][0], Silent)
        assert [plan.pipeline_of(push, "paper").faults for push in plan.pushes()] == made


class TestFile:
    @pytest.mark.parametrize(
        ("text", "problem"),
        [
            ("faults: [{fault: silnt}]", "faults.0.fault: unknown fault 'silnt'; did you mean"),
            ("faults: [7]", "7 is no fault"),
            ("faults: [{fault: silent, start: [3]}]", r"faults.0.start: .* range \[from, to\]"),
            ("faults: [{fault: silent, start: [3, 1]}]", "faults.0.start: write a stamp"),
            ("faults: [{fault: silent, start: [a, 1]}]", "faults.0.start: write a stamp"),
            ("faults: [{fault: silent, start: [1, .inf]}]", "faults.0.start: write a stamp"),
            ("faults: [{fault: silent, start: [1, 9], end: 5}]", "faults.0.end: it lies before"),
            ("faults: []", "neither faults nor anything misplaced"),
            ("fautls: []", "fautls: unknown field; did you mean 'faults'"),
            ("misplaced: {camera: 3}", "misplaced.camera"),
        ],
    )
    def test_what_is_wrong_is_reported_in_a_sentence(
        self, text: str, problem: str, tmp_path: Path
    ) -> None:
        with pytest.raises(ConfigurationError, match=rf"failing\.yaml: .*{problem}") as caught:
            read_failing(failing(tmp_path, text))
        assert "\n" not in str(caught.value)

    def test_a_range_may_have_no_length(self, tmp_path: Path) -> None:
        path = failing(tmp_path, "faults: [{fault: silent, sensor: skin, start: [2, 2]}]")
        faults, misplaced = read_failing(path)
        assert drawn(faults, 9) == (Silent(sensor="skin", start=2.0),) and misplaced == {}

    @pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
    def test_the_examples_can_be_read(self, path: Path) -> None:
        faults, misplaced = read_failing(path)
        assert faults or misplaced


class TestPushes:
    @pytest.mark.slow
    def test_a_skin_that_dies_reports_nothing_from_then_on(
        self, tmp_path: Path, targets: str
    ) -> None:
        path = failing(tmp_path, "faults: [{fault: silent, sensor: skin, start: [1.0, 1.5]}]")
        track = tracked(small(targets, faults=path))
        start = (
            planned(small(targets, faults=path)).pipeline_of(track.push, "tuned").faults[0].start
        )
        assert start is not None
        alive = track.stamp < start
        assert (track.estimate[alive][1:] > 0).all()
        assert (track.estimate[track.stamp > start + 0.35] == 0).all()  # the timeout, and a cycle
        assert track.ending != "arrived"

    @pytest.mark.slow
    @pytest.mark.parametrize("fault", ["silent", "zeros", "stuck"])
    def test_the_lidar_goes_on_where_the_skin_dies(
        self, fault: str, tmp_path: Path, targets: str
    ) -> None:
        path = failing(tmp_path, f"faults: [{{fault: {fault}, sensor: skin, start: [0.5, 1.0]}}]")
        track = tracked(small(targets, sensings=("fused_rule",), faults=path))
        assert track.ending == "arrived" and track.distance[-1] < 0.05
        shares = dict(zip(track.sources, track.shares.T, strict=True))
        alive, later = (track.stamp > 0.0) & (track.stamp < 0.5), track.stamp > 1.5
        assert (shares["skin"][alive] > 0.0).all() and (shares["lidar"][later] > 0.0).mean() > 0.9
        assert (shares["skin"][later] > 0.0).any() == (fault == "stuck")

    def test_scans_that_are_lost_are_bridged(self, tmp_path: Path, targets: str) -> None:
        text = "faults: [{fault: dropout, sensor: point_cloud, probability: 0.3}]"
        options = small(targets, sensings=("rule",))
        track, whole = tracked(replace(options, faults=failing(tmp_path, text))), tracked(options)
        assert track.ending == "arrived"
        n = min(len(track.stamp), len(whole.stamp))
        assert not np.array_equal(track.lateral[:n], whole.lateral[:n], equal_nan=True)

    def test_where_odometry_is_lost_the_wheels_are_used(self, tmp_path: Path, targets: str) -> None:
        text = "faults: [{fault: dropout, sensor: odometry, probability: 0.3}]"
        track = tracked(small(targets, faults=failing(tmp_path, text)))
        assert track.ending == "arrived" and track.distance[-1] < 0.05

    def test_a_lidar_is_misplaced(self, tmp_path: Path) -> None:
        near = target_file(tmp_path / "near.yaml", (0.4, 0.0))
        options = small(near, sensings=("rule",))
        path = failing(tmp_path, "misplaced: {lidar: {mm: 15, degrees: 1}}")
        misplaced, whole = tracked(replace(options, faults=path)), tracked(options)
        assert not np.array_equal(misplaced.lateral[:5], whole.lateral[:5], equal_nan=True)


class TestExperiment:
    @pytest.mark.slow
    @pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
    def test_the_examples_run(
        self, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Untrained networks report nonsense; what matters is that it is pushed."""
        scene_of = Plan.scene_of
        monkeypatch.setattr(
            Plan,
            "scene_of",
            lambda self, push: scene_of(self, push).model_copy(update={"longest": 6.0}),
        )
        (tmp_path / "networks").mkdir()
        weights = write(tmp_path / "networks", some_weights())
        near = target_file(tmp_path / "near.yaml", (0.12, 0.0))
        sensing = "fused_camera" if "camera" in path.stem else "fused"
        options = small(near, sensings=(sensing,), weights=weights, faults=path)
        run_push(options, tmp_path / "out")
        track = load(next((tmp_path / "out").rglob("*.npz")))
        assert len(track.stamp) > 3 and (track.estimate > 0).any()

    @pytest.mark.parametrize(
        ("text", "problem"),
        [
            ("faults: [{fault: silent, sensor: sikn}]", "faults.0.sensor: .*did you mean 'skin'"),
            ("misplaced: {camra: {mm: 3}}", "misplaced.camra: .*did you mean 'camera'"),
        ],
    )
    def test_what_is_no_sensor_is_reported(
        self, text: str, problem: str, targets: str, tmp_path: Path
    ) -> None:
        with pytest.raises(ConfigurationError, match=problem):
            run_push(small(targets, faults=failing(tmp_path, text)), tmp_path / "out")
        assert not (tmp_path / "out").exists()

    def test_what_is_switched_off_changes_nothing(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        near = target_file(tmp_path / "near.yaml", (0.12, 0.0))
        text = "{faults: [{fault: silent, sensor: lidar}], misplaced: {camera: {mm: 3}}}"
        options = small(near)
        run_push(replace(options, faults=failing(tmp_path, text)), tmp_path / "failing")
        output = capsys.readouterr().out
        assert "faults.0.sensor: no sensing here uses 'lidar'" in output
        assert "misplaced.camera: no sensing here uses 'camera'" in output
        run_push(options, tmp_path / "whole")
        assert content(tmp_path / "failing/trials") == content(tmp_path / "whole/trials")

    def test_faults_of_other_times_are_another_experiment(
        self, targets: str, tmp_path: Path
    ) -> None:
        text: Any = "faults: [{{fault: silent, sensor: skin, start: [1, {}]}}]"
        options = small(targets, faults=failing(tmp_path, text.format(15)))
        run_push(options, tmp_path / "out")
        failing(tmp_path, text.format(10))
        with pytest.raises(ConfigurationError, match="holds pushes of other faults"):
            run_push(options, tmp_path / "out")
