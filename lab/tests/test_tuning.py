"""`tune push`: what is searched, on which pushes, and that it goes on where it stopped."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from contactfusion.controllers.pushing_parameters import SETS, PushingParameters
from contactfusion.controllers.reactive_pushing import ReactivePushingConfig
from contactfusion.errors import ConfigurationError
from contactfusion.terminal import Progress
from contactfusion_lab.experiments.push.plan import Plan, Push
from contactfusion_lab.scenes.push.config import PAPER, PushConfig
from contactfusion_lab.trials.executor import Local
from contactfusion_lab.tune_push import push, rating
from contactfusion_lab.tune_push.push import (
    Options,
    check_ranking,
    check_sets,
    correlation,
    tune_push,
)
from contactfusion_lab.tune_push.rating import (
    FAILED,
    Rating,
    random_pushes,
    rate_in_bullet,
    rate_in_plane,
)
from contactfusion_lab.tune_push.search import (
    LIMITS,
    POPULATION,
    Candidate,
    Search,
    changes,
    decoded,
    encoded,
)
from lab.tests.here import Here

TUNED = SETS["tuned"]
FEW = Options(seed=4, trials=6, rounds=2, confirm=6, executor=Here())


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Replace PyBullet by the plane, and times by nominal ones; count the pushes."""
    pushes = []

    def made(parameters: PushingParameters, trials: int, *rest: object) -> Rating:
        pushes.append(trials)
        times = np.linspace(10.0, 20.0, trials) / parameters.fastest
        return Rating((True,) * trials, tuple(times.tolist()))

    monkeypatch.setattr(rating, "rated_in_bullet", made)
    monkeypatch.setattr(
        push,
        "rated_in_plane",
        lambda sets, trials, *rest: [made(parameters, trials) for parameters in sets],
    )
    return pushes


def test_a_set_comes_back_from_its_vector() -> None:
    again = decoded(encoded(TUNED), TUNED)
    for name, value in TUNED.model_dump().items():
        if isinstance(value, float):
            assert getattr(again, name) == pytest.approx(value, rel=0.006)
    assert again.search == TUNED.search
    assert decoded(np.zeros(len(LIMITS)), TUNED).speed_gain == LIMITS["speed_gain"][0]
    highest = decoded(np.ones(len(LIMITS)), TUNED)
    assert highest.realign and highest.realign.leave < highest.realign.enter
    assert changes(TUNED, TUNED) == {}


def test_the_search_comes_near_the_best() -> None:
    best = np.linspace(0.3, 0.7, len(LIMITS))
    search = Search(np.full(len(LIMITS), 0.5), seed=1)
    for _ in range(25):
        search.learn(
            [
                Candidate(tuple(each.tolist()), 10, 10, float(np.sum((each - best) ** 2)), 1.0)
                for each in search.draw()
            ]
        )
    assert np.abs(search.middle - best).mean() < 0.03
    assert np.abs(np.full(len(LIMITS), 0.5) - best).mean() > 0.1


def test_pushes_are_of_the_papers_objects_and_never_those_that_are_reported() -> None:
    plan, pushes = random_pushes(60, 7)
    assert {push.object for push in pushes} == set(PAPER)
    assert {push.friction for push in pushes} == {"mu1", "mu2"}
    assert max(abs(push.offset) for push in pushes) <= 0.2
    for seed in (500, 2025):
        with pytest.raises(ConfigurationError, match="nothing is tuned on them"):
            random_pushes(6, seed)
        with pytest.raises(ConfigurationError, match=f"reported on seed {seed}"):
            tune_push(replace(FEW, seed=seed), Path("nowhere"))
    assert len({plan.scene_of(push).target for push in pushes}) == 60


def test_a_rating_puts_success_before_time() -> None:
    sure, fast = Rating((True,) * 4, (30.0,) * 4), Rating((True, True, True, False), (10.0,) * 4)
    assert sure.cost == 30.0
    assert fast.cost == pytest.approx((30.0 + FAILED) / 4)
    assert fast.mean_time == 10.0
    assert fast.rate[1] < 0.75 < fast.rate[2]
    assert np.isnan(Rating((False,), (300.0,)).mean_time)


def test_frictions_vary_in_the_plane_alike_for_all_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[float, float]] = []

    def noted(config: PushConfig, controller: object) -> object:
        seen.append((config.friction.ground, config.friction.robot))
        raise StopIteration

    monkeypatch.setattr(rating, "planar_trial", noted)
    plan, pushes = random_pushes(6, 7)
    for vary in (False, True, True):
        with pytest.raises(StopIteration):
            rate_in_plane(plan, pushes, vary, TUNED)
    assert seen[0] == (0.3, 0.35)
    assert seen[1] == seen[2] != seen[0]
    assert 0.24 <= seen[1][0] <= 0.36


def test_the_number_of_workers_changes_nothing() -> None:
    sets = [TUNED, SETS["tuned_neither"]]
    parameters, two = (
        rating.rated_in_plane(sets, 6, 3, executor, Progress("sets", 2))
        for executor in (Here(), Local(2))
    )
    assert parameters == two


def test_a_search_goes_on_where_it_stopped(tmp_path: Path, quick: list[int]) -> None:
    tune_push(FEW, tmp_path / "whole")
    sets = 2 * POPULATION + push.FINAL + push.CONFIRMED + 1
    assert len(quick) == sets
    tune_push(FEW, tmp_path / "whole")
    assert len(quick) == sets
    tune_push(replace(FEW, executor=Local(2)), tmp_path / "part")
    for gone in ("rounds/001.json", "choice.json", "confirmed/found_2.json", "parameters.yaml"):
        (tmp_path / "part" / gone).unlink()
    tune_push(FEW, tmp_path / "part")
    for path in sorted((tmp_path / "whole").rglob("*.*")):
        assert (tmp_path / "part" / path.relative_to(tmp_path / "whole")).read_bytes() == (
            path.read_bytes()
        )
    with pytest.raises(ConfigurationError, match="pushes of other trials"):
        tune_push(replace(FEW, trials=7), tmp_path / "part")
    for text in ("[{}]", "[" * 100_000):
        (tmp_path / "part" / "rounds" / "000.json").write_text(text)
        with pytest.raises(ConfigurationError, match="damaged"):
            tune_push(FEW, tmp_path / "part")


@pytest.mark.parametrize(("text", "times"), [("{}", 1), ("[", 100_000)])
def test_a_damaged_rating_is_a_sentence(tmp_path: Path, text: str, times: int) -> None:
    path = tmp_path / "rating.json"
    path.write_text(text * times)
    with pytest.raises(ConfigurationError, match=r"rating\.json is damaged: remove it"):
        rating.kept_in_bullet(TUNED, 1, 0, Here(), Progress("pushes", 1), path)


def test_what_is_found_can_be_used_by_name(tmp_path: Path, quick: list[int]) -> None:
    tune_push(FEW, tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["best"] != "tuned"  # faster is better here
    parameters = yaml.safe_load((tmp_path / "parameters.yaml").read_text())
    found = ReactivePushingConfig(target=(1.0, 0.0), parameters=parameters).parameters
    assert found.fastest > TUNED.fastest
    assert found.model_dump(mode="json") == summary["confirmed"][summary["best"]]["parameters"]
    rows = list(csv.DictReader((tmp_path / "tried.csv").read_text().splitlines()))
    assert len(rows) == 2 * POPULATION
    assert float(rows[0]["fastest"]) == pytest.approx(TUNED.fastest, rel=0.01)


def test_wrong_options_are_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="did you mean 'tuned'"):
        tune_push(replace(FEW, start="tunned"), tmp_path / "out")
    with pytest.raises(ConfigurationError, match="that realigns"):
        tune_push(replace(FEW, start="tuned_neither"), tmp_path / "out")
    (tmp_path / "notes.txt").touch()
    with pytest.raises(ConfigurationError, match="holds files, but no settings.json"):
        tune_push(FEW, tmp_path)


def test_pushes_in_pybullet_are_rated_by_what_is_true(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Plan, "scene_of", shortened(Plan.scene_of))
    plan, pushes = random_pushes(6, 7)
    good = rate_in_bullet(plan, TUNED, pushes[:2])
    blind = rate_in_bullet(plan, TUNED.model_copy(update={"arrival": 9.0}), pushes[:1])
    assert good.success == (True, True)
    assert blind.success == (False,)
    assert blind.time[0] < 1.0  # arrival is declared at once, and is not true


def shortened(scene_of: Callable[[Plan, Push], PushConfig]) -> Callable[[Plan, Push], PushConfig]:
    def scene(self: Plan, push: Push) -> PushConfig:
        return scene_of(self, push).model_copy(update={"longest": 40.0})

    return scene


@pytest.mark.slow
def test_the_plane_ranks_sets_as_pybullet_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Plan, "scene_of", shortened(Plan.scene_of))
    plan, pushes = random_pushes(6, 7)
    sets = [TUNED, check_sets()["length_0.30"], SETS["paper_neither"]]
    plane = [rate_in_plane(plan, pushes, False, parameters).cost for parameters in sets]
    bullet = [rate_in_bullet(plan, parameters, pushes).cost for parameters in sets]
    assert correlation(plane, bullet) == pytest.approx(1.0)


def test_the_check_reports_rates_and_their_correlation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    order = iter(range(100))

    def made(parameters: PushingParameters, trials: int, *rest: object) -> Rating:
        count = next(order) % len(check_sets())
        return Rating(tuple(row < count for row in range(trials)), (10.0,) * trials)

    monkeypatch.setattr(rating, "rated_in_bullet", made)
    monkeypatch.setattr(
        "contactfusion_lab.tune_push.push.rated_in_plane",
        lambda sets, trials, *rest, vary: [made(parameters, trials) for parameters in sets],
    )
    check_ranking(20, 1, Here(), tmp_path)
    assert "1.00 of rates, 1.00 of costs" in capsys.readouterr().out
    assert json.loads((tmp_path / "check.json").read_text())["sets"] == len(check_sets())
    assert np.isnan(correlation([1.0, 1.0], [0.0, 1.0]))
