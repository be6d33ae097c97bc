"""The kernels of the rule `sets`, beside plain searches."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE
from contactfusion.integrator.cells import cell_list, grouped
from contactfusion.integrator.nearby import (
    BETWEEN,
    Barrier,
    around,
    connected,
    labelled,
    linked,
    near,
    nearer,
    nearest_left,
    reached,
    shifted,
    spacings,
)


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


def test_reached_are_the_labels_left_with_a_point_within_reach(rng: np.random.Generator) -> None:
    points, others = rng.uniform(0, 0.1, (300, 3)), rng.uniform(-0.02, 0.12, (30, 3))
    labels, left = rng.integers(0, 40, 300).astype(np.int32), rng.random(40) < 0.7
    found = reached(points, cell_list(points, 0.013), labels, left, others, 0.012)
    near_any = cdist(points, others).min(axis=1) <= 0.012
    expected = np.isin(np.arange(40), labels[near_any]) & left
    assert expected.any()
    np.testing.assert_array_equal(found, expected)


def test_the_nearest_left_is_the_first_of_equals(rng: np.random.Generator) -> None:
    points = np.repeat(rng.uniform(0, 1, (50, 3)), 2, axis=0)
    cells, labels = cell_list(points, 0.05), np.repeat(np.arange(20, dtype=np.int32), 5)
    left = rng.random(20) < 0.5
    for place in (points[7], points[7] + 3.0):
        away = np.where(left[labels], cdist(points, place[None])[:, 0], np.inf)
        assert nearest_left(points, cells, labels, left, place) == away.argmin()


def test_labelled_holds_a_point_of_a_wanted_label(rng: np.random.Generator) -> None:
    which, labels = rng.integers(NONE, 30, 200).astype(np.int32), np.arange(30, dtype=np.int32) // 3
    wanted = np.arange(10) % 3 == 0
    expected = np.flatnonzero((which != NONE) & wanted[labels[which]])
    np.testing.assert_array_equal(labelled(which, labels, wanted), expected)


def test_grouped_rows_ascend_within_each_group(rng: np.random.Generator) -> None:
    groups = rng.integers(0, 6, 100)
    rows, begins = grouped(groups, 7)
    np.testing.assert_array_equal(rows, np.argsort(groups, kind="stable"))
    np.testing.assert_array_equal(np.diff(begins), np.bincount(groups, minlength=7))


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
    reaches, start = 0.5 * reach * rng.uniform(0.5, 1.0, count), int(values.argmax())
    values[start] = 1.0
    found = connected(points, cell_list(points, 0.02), values, least, start, reaches)
    links = cdist(points, points) <= reaches + reaches[:, None]
    links &= (values >= least) & (values >= least)[:, None]
    _, labels = connected_components(csr_matrix(links.astype(np.int8)))
    np.testing.assert_array_equal(found, np.flatnonzero(labels == labels[start]))


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 300),
    barred=st.integers(0, 100),
    reach=st.sampled_from((0.0, 0.001, 0.006, 0.012, 0.02, 0.3)),
    side=st.sampled_from((0.005, 0.02, 1.0)),
)
def test_linked_labels_what_chains_of_steps_join_that_no_barrier_bars(
    seed: int, count: int, barred: int, reach: float, side: float
) -> None:
    rng = np.random.default_rng(seed)
    points, others = rng.uniform(0, 0.1, (count, 3)), rng.uniform(0, 0.1, (barred + 1, 3))
    points[count // 2 :] = points[: count - count // 2]  # equal ones, too
    reaches, apart = 0.5 * reach * rng.uniform(0.5, 1.0, count), cdist(points, points)
    away = cdist(points, others).min(axis=1) if barred else np.full(count, np.inf)
    barrier = Barrier(others, cell_list(others, side), away)
    labels, number = linked(points, cell_list(points, side), reaches, barrier)
    links = apart <= reaches + reaches[:, None]
    if barred:
        middles = 0.5 * (points[:, None] + points).reshape(-1, 3)
        links &= cdist(middles, others).min(axis=1).reshape(links.shape) >= BETWEEN * apart
    expected, components = connected_components(csr_matrix(links.astype(np.int8)))
    assert number == expected
    np.testing.assert_array_equal(labels, components)  # both number them by their first point


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 100),
    most=st.sampled_from((0.001, 0.01, 1.0)),
    side=st.sampled_from((0.005, 0.02, 1.0)),
)
def test_spacings_are_distances_of_nearest_others(
    seed: int, count: int, most: float, side: float
) -> None:
    points = np.random.default_rng(seed).uniform(0, 0.1, (count, 3))
    apart = cdist(points, points) + np.diag(np.full(count, np.inf))
    rows = np.arange(0, count, 3)
    found = spacings(points, cell_list(points, side), rows, most)
    np.testing.assert_allclose(found[:, 0], np.minimum(apart.min(axis=1), most)[rows])


def test_beside_the_nearest_lies_the_next_row_of_a_grid_and_none_of_a_single_row() -> None:
    def found(*points: tuple[float, float]) -> FloatArray:
        places = 0.01 * np.array([(*point, 0.0) for point in points])
        return 100.0 * spacings(places, cell_list(places, 0.02), np.arange(len(places)), 0.05)

    oblong = [(x, 3.0 * y) for x in range(4) for y in range(3)]
    np.testing.assert_allclose(found(*oblong), np.tile((1.0, 3.0), (12, 1)))
    cross = found((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
    np.testing.assert_allclose(cross, np.ones((5, 2)))
    row = found(*((x, 0.0) for x in range(4)))
    np.testing.assert_allclose(row, np.tile((1.0, 5.0), (4, 1)))


def test_in_a_grid_a_barrier_bars_steps_over_it_and_none_beside_it() -> None:
    def joined(second: tuple[float, float], *barring: tuple[float, float]) -> bool:
        ends = 0.005 * np.array([(0.0, 0.0, 0.0), (*second, 0.0)])
        others = 0.005 * np.array([(*each, 0.0) for each in barring])
        barrier = Barrier(others, cell_list(others, 0.02), cdist(ends, others).min(axis=1))
        return linked(ends, cell_list(ends, 0.02), np.full(2, 0.02), barrier)[1] == 1

    assert not joined((2, 0), (1, 0))
    assert joined((2, 0), (1, 1), (1, -1))
    assert joined((1, 1), (1, 0), (0, 1))
    assert not joined((2, 2), (1, 1))


def test_what_hangs_together_with_a_low_place_is_found_with_it() -> None:
    points = np.linspace(0.0, 0.05, 6)[:, None] * [1.0, 0.0, 0.0]
    values, cells = np.array([1.0, 1.0, 0.2, 1.0, 0.0, 1.0]), cell_list(points, 0.011)
    reaches = np.full(6, 0.0055)
    assert connected(points, cells, values, 0.5, 2, reaches).tolist() == [0, 1, 2, 3]
    assert connected(points, cells, values, 2.0, 2, reaches).tolist() == [2]


def test_a_chain_holds_while_its_steps_are_no_longer_than_its_reach() -> None:
    points = np.zeros((6, 3))
    points[:, 0] = [0.0, 0.012, 0.024, 0.0361, 0.048, 0.060]
    for start in range(6):
        reaches = np.full(6, 0.006000005)
        found = connected(points, cell_list(points, 0.04), np.ones(6), 0.0, start, reaches)
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
