"""The experiment on real Ouster scans: the proximity descriptor is what plain loops give."""

from pathlib import Path

import numpy as np
import pytest

from contactfusion.generators.proximity import ProximityConfig
from contactfusion_lab.experiments import ouster as experiment
from contactfusion_lab.experiments.ouster import by_loops
from tests.test_ouster import elsewhere, folder, ready

__all__ = ["elsewhere", "folder", "ready"]


def test_without_the_environment_scans_are_left_out(
    elsewhere: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not elsewhere.exists()
    assert experiment.measure(tmp_path, tmp_path) == []
    assert "left out: " in capsys.readouterr().out


def test_the_descriptor_of_real_scans_is_what_loops_give(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    measures = experiment.measure(folder, tmp_path)
    wrong = [measure for measure in measures if measure.metric == "difference from plain loops"]
    assert len(wrong) == 9 and all(each.met for each in wrong)
    near = {
        measure.case: measure.value
        for measure in measures
        if measure.metric == "points in the region"
    }
    assert near.pop("OS-0-32-U1_v2.2.0_1024x10, 32 rings") == 0
    assert min(near.values()) > 100
    assert "sensor taken to stand at (0.1, 0, 0) m, turned by -75°" in capsys.readouterr().out
    assert len(list(tmp_path.glob("*.png"))) == 4


@pytest.fixture
def config() -> ProximityConfig:
    return ProximityConfig()


def test_loops_give_what_can_be_worked_out_by_hand(config: ProximityConfig) -> None:
    points = np.array(
        [
            [0.33, -0.29, 0.0],  # the first strip: two in the nearest cell, one behind them
            [0.335, -0.26, 0.1],
            [0.5, -0.27, 0.0],
            [0.31, -0.24, 0.6],  # above the region
            [0.305, 0.29, 0.0],  # the last: before the middle of the first cell
            [np.nan, 0.0, 0.0],
        ]
    )
    lengths = by_loops(points, config)
    wanted = np.full(12, 0.31)
    wanted[0], wanted[11] = 0.0225, 0.005
    np.testing.assert_allclose(lengths, wanted, atol=1e-12)


def test_loops_and_the_descriptor_agree_on_random_points(config: ProximityConfig) -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        points = rng.uniform([0.2, -0.4, -0.5], [0.7, 0.4, 0.6], (rng.integers(0, 400), 3))
        np.testing.assert_allclose(
            config.lengths_of_cloud(points), by_loops(points, config), atol=1e-9
        )
