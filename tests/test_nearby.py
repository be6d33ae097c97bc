"""The kernels of the rule `sets`, beside plain searches."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from contactfusion.integrator.fields import cell_list
from contactfusion.integrator.nearby import around, connected, near, nearer, shifted


@pytest.fixture(params=range(4))
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    return np.random.default_rng(request.param)


def test_around_gives_what_is_left_in_the_box(rng: np.random.Generator) -> None:
    points, others = rng.uniform(0, 0.1, (300, 3)), rng.uniform(-0.02, 0.12, (3, 3))
    labels, left = rng.integers(0, 5, 300).astype(np.int32), np.array([1, 0, 1, 1, 0], np.bool_)
    found = around(points, cell_list(points, 0.013), labels, left, others, 0.01)
    low, high = others.min(axis=0) - 0.01, others.max(axis=0) + 0.01
    inside = ((low <= points) & (points <= high)).all(axis=1) & left[labels]
    np.testing.assert_array_equal(np.sort(found), np.flatnonzero(inside))


def test_around_is_empty_far_away(rng: np.random.Generator) -> None:
    points, all_left = rng.uniform(0, 0.1, (50, 3)), np.ones(1, np.bool_)
    cells, labels = cell_list(points, 0.01), np.zeros(50, np.int32)
    for far in (-1.0, 1.0):
        assert not len(around(points, cells, labels, all_left, np.full((1, 3), far), 0.01))


def test_near_is_within_reach_of_any(rng: np.random.Generator) -> None:
    points, others = rng.uniform(0, 1, (80, 3)), rng.uniform(0, 1, (5, 3))
    expected = cdist(points, others).min(axis=1) <= 0.3
    np.testing.assert_array_equal(near(points, others, 0.3), expected)


def test_connected_hang_together_in_steps_over_what_is_high_enough(
    rng: np.random.Generator,
) -> None:
    points, values = rng.uniform(0, 1, (200, 3)), rng.uniform(0, 1, 200)
    start = int(values.argmax())
    found = connected(points, cell_list(points, 0.2), values, 0.4, start, 0.17)
    linked = (cdist(points, points) <= 0.17) & (values >= 0.4)
    expected = np.arange(200) == start
    for _ in range(200):
        expected = expected | linked[expected].any(axis=0)
    np.testing.assert_array_equal(found, np.flatnonzero(expected))
    assert 1 < len(found) < (values >= 0.4).sum()


def test_nearer_compares_the_nearest_of_each_side(rng: np.random.Generator) -> None:
    points, rows = rng.uniform(0, 1, (60, 3)), rng.permutation(60)
    these, others, some = rows[:10], rows[10:20], rows[20:]
    away = cdist(points[some], points)
    expected = away[:, these].min(axis=1) <= away[:, others].min(axis=1)
    np.testing.assert_array_equal(nearer(points, some, these, others), expected)


def test_mean_shift_comes_to_rest_at_the_middle_of_a_bell(rng: np.random.Generator) -> None:
    points = rng.normal(0.3, 0.01, (4000, 3))
    place = shifted(points, np.arange(4000), np.ones(4000), points[0], 0.02, 50)
    np.testing.assert_allclose(place, 0.3, atol=2e-3)
