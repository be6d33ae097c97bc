"""How thresholds of the LiDAR's rule are chosen; pushes are made up."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import pytest

from contactfusion.controllers.pushing_parameters import PushingParameters
from contactfusion_lab.experiments.push.plan import Plan, Push
from contactfusion_lab.experiments.push.suites import THRESHOLDS
from contactfusion_lab.tune_push import lidar_rule
from contactfusion_lab.tune_push.lidar_rule import (
    FIRST,
    KEPT,
    MOUNTINGS,
    NEAR,
    SECOND,
    SEED,
    TOUCH,
    plan_of,
    tuned,
    with_thresholds,
)
from contactfusion_lab.tune_push.rating import REPORTED, Rating
from lab.tests.here import Here

PAIRS = list(product(TOUCH, NEAR))
TABLES = (*REPORTED, 0, 600)
"""Seeds of the tables of results."""


def made_up(
    monkeypatch: pytest.MonkeyPatch, best: tuple[float, float]
) -> list[tuple[tuple[float, float], int]]:
    """Pushes that succeed the more, the nearer the thresholds are to the best; a list of which."""
    made = list[tuple[tuple[float, float], int]]()

    def rate(plan: Plan, _: PushingParameters, pushes: Sequence[Push]) -> Rating:
        options = plan.pipeline.generators["lidar"]
        pair = options["touch"], options["near"]
        made.append((pair, len(pushes)))
        off = abs(pair[0] - best[0]) + abs(pair[1] - best[1])
        return Rating((True,) * len(pushes), (10.0 + 100.0 * off,) * len(pushes))

    monkeypatch.setattr(lidar_rule, "rate_in_bullet", rate)
    return made


def test_the_best_pair_is_found_and_only_good_ones_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    made = made_up(monkeypatch, PAIRS[-2])
    found = tuned("lidar_side", PAIRS, SEED, Here())
    assert list(found)[0] == PAIRS[-2] and len(found) == KEPT
    assert made[: len(PAIRS)] == [(pair, FIRST) for pair in PAIRS]
    assert {count for _, count in made[len(PAIRS) :]} == {SECOND}


def test_both_draws_differ_and_no_table_is_made_of_them() -> None:
    first, second = plan_of("lidar", FIRST, SEED), plan_of("lidar", SECOND, SEED + 1)
    assert not {one.seed for one in first.pushes()} & {one.seed for one in second.pushes()}
    assert not {SEED, SEED + 1} & set(TABLES)


def test_only_thresholds_change() -> None:
    plan = plan_of("lidar_tilted", FIRST, SEED)
    changed = with_thresholds(plan, (0.03, 0.01))
    assert changed.pipeline.generators["lidar"] == plan.pipeline.generators["lidar"] | {
        "touch": 0.03,
        "near": 0.01,
    }
    assert changed.pushes() == plan.pushes() and changed.sensing.sees == ("lidar_tilted",)


def test_what_was_chosen_was_tried() -> None:
    assert tuple(THRESHOLDS) == MOUNTINGS
    assert all((one["touch"], one["near"]) in PAIRS for one in THRESHOLDS.values())


def test_the_table_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made_up(monkeypatch, PAIRS[0])
    monkeypatch.setattr(lidar_rule, "Local", lambda workers: Here())
    lidar_rule.main(tmp_path / "out", ["lidar"], 1)
    table = (tmp_path / "out" / "table.md").read_text()
    assert "| lidar | 0.007 | 0.002 | 18 of 18 | 10.0 |" in table
    assert table.strip() in capsys.readouterr().out
