"""A flat skin that is pressed at several places: what is pressed, and how it is counted."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import cdist, pdist

from contactfusion.errors import ConfigurationError
from contactfusion.readings import TactileImage
from contactfusion_lab.experiments import skin
from contactfusion_lab.experiments.methods import DEFAULT_METHOD
from contactfusion_lab.experiments.skin import Touch, matched, pressed, run_skin, touches


def test_presses_are_apart_and_press_the_taxels_below_them() -> None:
    for presses in (1, 6):
        touch = pressed(presses, 0.02, np.random.default_rng(3))
        assert touch.places.shape == (presses, 3) and np.abs(touch.places).max() <= 0.04
        assert presses == 1 or pdist(touch.places).min() >= 0.02
        away = np.linalg.norm(skin.centres()[:, None] - touch.places, axis=2).min(axis=1)
        assert touch.values[away < 0.0025].min() > 5.0 * skin.NOISE
        assert touch.values[away > 0.02].max() < 5.0 * skin.NOISE


def test_each_touch_has_chance_of_its_own() -> None:
    few, many = dict(touches(5, 1, 0.02)), dict(touches(5, 2, 0.02))
    assert [*few] == [f"{presses}-000" for presses in range(1, 7)] and len(many) == 12
    for name, touch in few.items():
        np.testing.assert_array_equal(touch.values, many[name].values)


def test_what_is_missed_and_what_is_false_is_counted() -> None:
    touch = pressed(2, 0.02, np.random.default_rng(0))
    whole = matched("a", touch, DEFAULT_METHOD)
    assert whole.exact and whole.recall == 1.0 and whole.error < 0.003
    beside = Touch(touch.places + [0.0, 0.03, 0.0], touch.values)
    moved = matched("a", beside, DEFAULT_METHOD)
    assert (moved.exact, moved.recall, moved.false) == (False, 0.0, 2)
    assert moved.gospa == pytest.approx(skin.CUTOFF * 2.0**0.5) and np.isnan(moved.error)


def test_presses_that_a_skin_tells_apart_are_found(tmp_path: Path) -> None:
    rows = [matched(name, touch, DEFAULT_METHOD) for name, touch in touches(7, 5, 0.02)]
    assert np.mean([row.recall for row in rows]) > 0.95
    assert np.mean([row.false for row in rows]) < 0.05
    run_skin(1, 0.02, 7, [DEFAULT_METHOD], tmp_path)
    text = (tmp_path / "table.md").read_text()
    assert "| 6 | sets/members |" in text and (tmp_path / "skin.png").is_file()


def test_a_rule_that_stands_twice_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="'sets/members' stands twice among the rules"):
        run_skin(1, 0.02, 7, [DEFAULT_METHOD] * 2, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_presses_stay_two_contacts_while_taxels_err() -> None:
    rng = np.random.default_rng(1)
    touch = Touch(np.array([[-0.0115, 0.001, 0.0], [0.0135, 0.001, 0.0]]), np.zeros(0))
    weights = np.exp(-0.5 * cdist(skin.centres(), touch.places, "sqeuclidean") / skin.SPREAD**2)
    pipeline, seen = skin.pipeline_of(DEFAULT_METHOD), list[int]()
    for step in range(40):
        values = weights @ [0.3, 1.5] + skin.NOISE * rng.standard_normal(len(weights))
        pipeline.receive(
            TactileImage(stamp=0.05 * step, frame="skin", sensor="skin", values=values)
        )
        fusion = pipeline.step(0.05 * step).fusion
        seen.append(len(fusion.contacts))
        assert step == 0 or not fusion.changes
    assert set(seen) == {2}
