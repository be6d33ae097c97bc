"""The kernels of the rule `sets`, beside plain searches."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from contactfusion.integrator.cells import cell_list
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


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 300),
    reach=st.sampled_from((0.001, 0.006, 0.012, 0.02)),
    least=st.sampled_from((0.0, 0.4)),
)
def test_connected_is_what_a_chain_of_steps_joins_over_what_is_high_enough(
    seed: int, count: int, reach: float, least: float
) -> None:
    rng = np.random.default_rng(seed)
    points, values = rng.uniform(0, 0.1, (count, 3)), rng.uniform(0, 1, count)
    start = int(values.argmax())
    values[start] = 1.0
    found = connected(points, cell_list(points, 0.02), values, least, start, reach)
    linked = (cdist(points, points) <= reach) & (values >= least) & (values >= least)[:, None]
    _, labels = connected_components(csr_matrix(linked.astype(np.int8)))
    np.testing.assert_array_equal(found, np.flatnonzero(labels == labels[start]))


def test_a_chain_holds_while_its_steps_are_no_longer_than_its_reach() -> None:
    points = np.zeros((6, 3))
    points[:, 0] = [0.0, 0.012, 0.024, 0.0361, 0.048, 0.060]
    for start in range(6):
        found = connected(points, cell_list(points, 0.04), np.ones(6), 0.0, start, 0.01200001)
        assert found.tolist() == ([0, 1, 2] if start < 3 else [3, 4, 5])


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
