"""The search for settings of De Morgan: what is tried, how it is rated, on which touches."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from contactfusion import IntegratorConfig
from contactfusion.errors import RobotError
from contactfusion_lab.experiments.methods import (
    DE_MORGAN,
    DE_MORGAN_TUNED,
    TUNING_SEEDS,
    Method,
)
from contactfusion_lab.experiments.touch import tuned
from contactfusion_lab.experiments.touch.experiment import METHODS, TUNED_ON
from contactfusion_lab.experiments.touch.record import COARSEST
from contactfusion_lab.experiments.touch.rows import NEAR
from contactfusion_lab.experiments.touch.trial import Trial, content_of
from contactfusion_lab.trials.runner import Failure, Made
from lab.tests.here import Here
from lab.tests.test_touch_experiment import PLACE, cloud, trial

ROOT = Path(__file__).parents[2]
FEW = tuned.Options(1, 1, Here())


def kept(folder: Path, *trials: Trial) -> list[Path]:
    for number, each in enumerate(trials):
        (folder / f"{number}.npz").write_bytes(content_of(each))
    return [folder / f"{number}.npz" for number in range(len(trials))]


def test_what_is_tried_can_be_fused_and_told_apart() -> None:
    tried = tuned.candidates()
    assert len({str(each) for each in tried}) == len(set(tried)) == len(tried) == 1260
    for method in tried:
        applied = method.applied(DE_MORGAN.applied(tuned._pipeline().integrator))
        assert applied.voxel_size <= COARSEST and applied.rule == "de_morgan"
    papers = tried[0]
    assert papers.applied(tuned._pipeline().integrator).model_dump() == (
        IntegratorConfig(frame="base", rule="de_morgan", tolerance=0.01).model_dump()
    )
    assert papers.near == "evidence" and papers.p_max == 1.0


def test_the_tuned_method_is_one_of_what_was_tried() -> None:
    tried = [replace(each, name=DE_MORGAN_TUNED.name) for each in tuned.candidates()]
    assert DE_MORGAN_TUNED in tried and DE_MORGAN_TUNED in METHODS


def test_a_contact_at_its_place_costs_nothing_a_missed_and_a_false_one_alike(
    tmp_path: Path,
) -> None:
    skin = cloud("tip_1", PLACE, 0.9)
    files = kept(
        tmp_path,
        trial(skin),
        trial(),
        trial(skin, places=(), short=True),
        trial(cloud("tip_1", PLACE + 0.1, 0.9)),
    )
    ((_, costs),) = tuned.rated([DE_MORGAN], files, Here()).items()
    assert costs[0] < 0.005  # half a voxel's diagonal
    assert costs[1:] == pytest.approx([NEAR / np.sqrt(2.0), NEAR / np.sqrt(2.0), NEAR])


def test_range_as_support_and_likelihoods_that_are_cut_off_count(tmp_path: Path) -> None:
    files = kept(tmp_path, trial(cloud("near", PLACE, 0.9)))
    support = replace(DE_MORGAN, near="support")
    cut = replace(DE_MORGAN, p_max=0.05)
    evidence = replace(DE_MORGAN, near="evidence")
    costs = tuned.rated([support, cut, evidence], files, Here())
    missed = pytest.approx([NEAR / np.sqrt(2.0)])
    assert costs[support] == missed and costs[cut] == missed and costs[evidence] < 0.01


def test_the_best_of_the_first_seed_is_checked_on_the_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hand is felt at its place by a skin, and a camera sees much else."""
    made: list[int] = []

    def make(options: tuned.Options, seed: int, out: Path) -> list[Path]:
        made.append(seed)
        out.mkdir(parents=True)
        seen = cloud("near", [PLACE + 0.1, PLACE - 0.1], 0.9)
        skin = cloud("tip_1", PLACE + 0.001 * (seed - 7), 0.9)
        return kept(out, *[trial(skin, seen)] * 9)

    few = [each for each in tuned.candidates() if each.p_max == 1.0 and "mass -" in each.name]
    monkeypatch.setattr(tuned, "_made", make)
    monkeypatch.setattr(tuned, "candidates", lambda: few)
    best = tuned.tune(FEW, tmp_path)
    assert made == list(TUNING_SEEDS) and best.near == "support"
    assert "range as support" in (tmp_path / "table.md").read_text()
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["best"] == str(best)
    beside = [str(DE_MORGAN), "posterior/modes", str(DE_MORGAN_TUNED)]
    assert len(summary["gospa"]) == tuned.CHECKED + 3
    assert list(summary["gospa"])[-3:] == beside
    tried = pd.read_csv(tmp_path / "tried.csv")
    assert tried.groupby("round")["touches"].first().tolist() == [1, 3, 9]
    assert tried.groupby("round").size().tolist()[0] == len(few)


def test_a_touch_that_fails_ends_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        tuned, "kept", lambda *rest: iter([("a", Made(b"")), ("b", Failure("b: no way"))])
    )
    with pytest.raises(RobotError, match="1 of 6 touches were not made: b: no way"):
        tuned._made(FEW, 7, tmp_path)


def test_no_figure_is_of_a_seed_on_which_something_was_tuned() -> None:
    assert all(str(seed) in TUNED_ON for seed in TUNING_SEEDS)
    makefile = (ROOT / "Makefile").read_text()
    assert not any(f"experiment touch --seed {seed}" in makefile for seed in TUNING_SEEDS)
    assert isinstance(DE_MORGAN_TUNED, Method)
