"""The kernels of fields over places, beside numpy and scipy that go over every pair."""

import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from contactfusion.arrays import FloatArray
from contactfusion.integrator import fields
from contactfusion.integrator.cells import ROOM, cell_list, heaviest, nearest, sparse_cells

TAIL = 0.1
seeds = st.integers(0, 2**32 - 1)
tails = st.sampled_from((0.0, TAIL))
sizes = st.sampled_from((0.001, 0.02, 0.1, 1.0))
many = settings(max_examples=150)


def kernel_density(
    places: FloatArray,
    positions: FloatArray,
    likelihoods: FloatArray,
    spreads: FloatArray,
    single: bool,
    tail: float,
) -> FloatArray:
    field = np.full(len(places), np.nan)
    tiles = cell_list(places, fields.TILE)
    variances = np.square(spreads)
    fields.kernel_density(places, tiles, positions, likelihoods, variances, single, tail, field)
    return field


def by_hand(
    places: FloatArray,
    positions: FloatArray,
    likelihoods: FloatArray,
    spreads: FloatArray,
    single: bool,
    tail: float,
) -> FloatArray:
    """Give the same field from the distances of all pairs."""
    squared = cdist(places, positions, "sqeuclidean") / np.square(spreads)
    near, wide = np.exp(-squared / 2.0), tail * np.exp(-squared / (2.0 * fields.WIDER**2))
    each = likelihoods * (near + wide if single else np.maximum(near, wide))
    each[squared >= end(tail) ** 2] = 0.0
    field: FloatArray = each.sum(axis=1) if single else each.max(axis=1, initial=0.0)
    return field


def end(tail: float) -> float:
    """Give the standard deviations after which a field ends."""
    return fields.FAR if tail else fields.REACH


def off_edges(
    places: FloatArray, positions: FloatArray, spreads: FloatArray, tail: float
) -> NDArray[np.bool_]:
    """Tell which places lie at the edge of no hypothesis, where single precision would count."""
    deviations = cdist(places, positions) / spreads
    nearest: FloatArray = np.abs(deviations / end(tail) - 1.0).min(axis=1)
    return nearest > 1e-4


def close_to(expected: FloatArray) -> object:
    return pytest.approx(expected, abs=1e-4 * expected.max(initial=1e-300), rel=0.0)


def scattered(rng: np.random.Generator, count: int, size: float) -> FloatArray:
    """Give points in a box whose sides are as unlike as those of a plate or of a rod."""
    centre, sides = rng.uniform(-2.0, 2.0, 3), size * rng.choice([1.0, 0.1, 0.0], 3)
    return centre + sides * rng.uniform(-0.5, 0.5, (count, 3))


# A field


@many
@given(
    seed=seeds,
    counts=st.tuples(st.integers(1, 300), st.integers(1, 60)),
    size=sizes,
    single=st.booleans(),
    tail=tails,
    even=st.booleans(),
)
def test_a_field_is_what_the_distances_of_all_pairs_give(
    seed: int, counts: tuple[int, int], size: float, single: bool, tail: float, even: bool
) -> None:
    rng = np.random.default_rng(seed)
    places = scattered(rng, counts[0], size)
    positions = places.mean(axis=0) + size * rng.normal(size=(counts[1], 3))
    likelihoods, spreads = np.full(counts[1], 0.3), np.full(counts[1], 0.012)
    if not even:
        likelihoods = 10.0 ** rng.uniform(-4.0, 0.0, counts[1])
        spreads = 10.0 ** rng.uniform(-2.4, -0.5, counts[1])
    expected = by_hand(places, positions, likelihoods, spreads, single, tail)
    found = kernel_density(places, positions, likelihoods, spreads, single, tail)
    clear = off_edges(places, positions, spreads, tail)
    assert found[clear] == close_to(expected[clear])


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("tail", [0.0, TAIL])
def test_a_field_over_a_large_surface_is_that_of_all_pairs(single: bool, tail: float) -> None:
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(-0.3, 0.3, 0.004), np.arange(-0.3, 0.3, 0.004))
    places = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    positions = rng.uniform(-0.3, 0.3, (400, 3)) * [1.0, 1.0, 0.05]
    likelihoods, spreads = rng.uniform(0.01, 1.0, 400), rng.uniform(0.004, 0.03, 400)
    expected = by_hand(places, positions, likelihoods, spreads, single, tail)
    found = kernel_density(places, positions, likelihoods, spreads, single, tail)
    clear = off_edges(places, positions, spreads, tail)
    assert clear.mean() > 0.9 and found[clear] == close_to(expected[clear])


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize(("tail", "ends"), [(0.0, 4.0), (TAIL, 9.0)])
def test_a_field_ends_after_four_standard_deviations_or_nine_with_a_tail(
    single: bool, tail: float, ends: float
) -> None:
    spread = 0.01
    places = np.zeros((2, 3))
    places[:, 0] = [0.999 * ends * spread, 1.001 * ends * spread]
    one = np.zeros((1, 3)), np.array([0.5]), np.array([spread])
    inside, outside = kernel_density(places, *one, single, tail)
    assert inside > 0.0 and outside == 0.0


@pytest.mark.parametrize("single", [False, True])
def test_without_hypotheses_a_field_is_zero(single: bool) -> None:
    none = np.empty((0, 3)), np.empty(0), np.empty(0)
    assert kernel_density(np.ones((7, 3)), *none, single, TAIL).tolist() == [0.0] * 7


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("count", [1, 7, 8, 9, 100])
def test_places_in_one_spot_all_get_the_same(count: int, single: bool) -> None:
    places = np.tile([0.3, -0.2, 0.1], (count, 1))
    positions = places[:1] + [[0.004, 0.0, 0.0], [0.0, 0.0, -0.008]]
    told = positions, np.array([0.5, 0.25]), np.array([0.004, 0.008])
    found = kernel_density(places, *told, single, TAIL)
    assert np.ptp(found) == 0.0
    assert found == close_to(by_hand(places, *told, single, TAIL))


@pytest.mark.parametrize("single", [False, True])
def test_hypotheses_in_one_spot_add_up_or_the_strongest_counts(single: bool) -> None:
    told = np.zeros((5, 3)), np.array([0.1, 0.3, 0.2, 0.1, 0.2]), np.full(5, 0.004)
    (found,) = kernel_density(np.zeros((1, 3)), *told, single, TAIL)
    assert found == pytest.approx(0.9 * 1.1 if single else 0.3)


@pytest.mark.parametrize("single", [False, True])
def test_of_two_hypotheses_a_wide_one_far_away_may_be_the_strongest(single: bool) -> None:
    places = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]])
    positions = np.array([[0.012, 0.0, 0.0], [0.2, 0.0, 0.0]])
    told = positions, np.array([1e-4, 1.0]), np.array([0.004, 0.3])
    found = kernel_density(places, *told, single, 0.0)
    assert found == close_to(by_hand(places, *told, single, 0.0))
    assert found[1] > found[0] > 0.7


FAR = [4000.0, -3000.0, 5000.0]


def with_one_lost() -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Give places on a table, and hypotheses near it but for one."""
    rng = np.random.default_rng(1)
    places = rng.uniform(0.0, 0.3, (3000, 3)) * [1.0, 1.0, 0.0]
    positions = rng.uniform(0.0, 0.3, (200, 3)) * [1.0, 1.0, 0.1]
    positions[50] = FAR
    return places, positions, rng.uniform(0.1, 0.9, 200), rng.uniform(0.004, 0.01, 200)


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("place_there", [False, True])
def test_one_hypothesis_kilometres_away_costs_neither_room_nor_time(
    single: bool, place_there: bool
) -> None:
    places, positions, likelihoods, spreads = with_one_lost()
    told = positions, likelihoods, spreads
    if place_there:
        places = np.vstack([places, FAR])
    kernel_density(places, *told, single, TAIL)
    tracemalloc.start()
    begin = time.process_time()
    found = kernel_density(places, *told, single, TAIL)
    took, (_, most) = time.process_time() - begin, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert took < 1.0 and most < 5e6
    assert found == pytest.approx(by_hand(places, *told, single, TAIL), abs=0.1)
    assert (found[-1] == pytest.approx(likelihoods[50], rel=0.11)) == place_there


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("place_there", [False, True])
def test_one_hypothesis_kilometres_away_changes_no_field(single: bool, place_there: bool) -> None:
    places, positions, likelihoods, spreads = with_one_lost()
    told = positions, likelihoods, spreads
    if place_there:
        places = np.vstack([places, FAR])
    found = kernel_density(places, *told, single, TAIL)
    expected = by_hand(places, *told, single, TAIL)
    clear = off_edges(places, positions, spreads, TAIL)
    assert found[clear] == close_to(expected[clear])


# Points by cells


@many
@given(seed=seeds, count=st.integers(1, 400), size=sizes, side=st.sampled_from((0.003, 0.03, 9.0)))
def test_every_point_is_dealt_to_the_cell_that_it_lies_in(
    seed: int, count: int, size: float, side: float
) -> None:
    points = scattered(np.random.default_rng(seed), count, size)
    listed = cell_list(points, side)
    assert sorted(listed.rows.tolist()) == list(range(count))
    assert listed.side >= side and listed.low == pytest.approx(points.min(axis=0), abs=0.0)
    assert len(listed.begins) == listed.counts.prod() + 1 <= ROOM + 8 * count + 1
    assert listed.begins[0] == 0 and listed.begins[-1] == count
    i, j, k = ((points - listed.low) / listed.side).astype(int).T
    cells = (i * listed.counts[1] + j) * listed.counts[2] + k
    numbers = np.repeat(np.arange(len(listed.begins) - 1), np.diff(listed.begins))
    assert np.array_equal(cells[listed.rows], numbers)


def test_where_there_would_be_too_many_cells_they_are_wider() -> None:
    near = np.zeros((5, 3))
    assert cell_list(near, 0.01).side == 0.01
    listed = cell_list(np.vstack([near, FAR]), 0.01)
    assert listed.side > 10.0 and listed.counts.prod() <= ROOM + 8 * 6


# The heaviest within reach


@many
@given(
    seed=seeds,
    counts=st.tuples(st.integers(1, 50), st.integers(1, 200)),
    radius=st.sampled_from((1e-6, 0.004, 0.016, 0.3)),
    side=st.sampled_from((0.005, 0.024)),
)
def test_the_heaviest_place_within_reach_is_found(
    seed: int, counts: tuple[int, int], radius: float, side: float
) -> None:
    rng = np.random.default_rng(seed)
    places = scattered(rng, counts[1], 0.1)
    points = places[rng.integers(0, counts[1], counts[0])] + rng.normal(0, 0.01, (counts[0], 3))
    points[0] += 100.0 * rng.normal(size=3)
    weights = rng.uniform(0.1, 1.0, counts[1])
    found = heaviest(points, places, cell_list(places, side), weights, radius)
    near = cdist(points, places) <= radius
    assert np.array_equal(found, (near * weights).max(axis=1))


@pytest.mark.parametrize("point", [FAR, [-1e4, 0.0, 0.0], [0.0, 0.1, 1e4], [0.0, 0.0, 0.0101]])
def test_out_of_reach_of_every_place_there_is_no_weight(point: list[float]) -> None:
    places = np.zeros((3, 3))
    listed = cell_list(places, 0.005)
    assert heaviest(np.array([point]), places, listed, np.ones(3), 0.01).tolist() == [0.0]


# Chains


# The nearest place


@many
@given(seed=seeds, size=sizes, side=st.sampled_from((0.003, 0.03, 9.0)))
def test_the_nearest_place_is_found_also_from_outside_of_all_cells(
    seed: int, size: float, side: float
) -> None:
    rng = np.random.default_rng(seed)
    places, points = scattered(rng, 30, size), scattered(rng, 40, 3.0 * size)
    found = nearest(points, places, cell_list(places, side))
    away = np.linalg.norm(points[:, None] - places, axis=2)
    assert np.array_equal(found, away.argmin(axis=1))


def test_a_few_places_far_apart_are_in_few_cells() -> None:
    corners = np.array([(0.0, 0.0, 0.0), (1.2, 1.2, 0.0)])
    assert len(sparse_cells(corners, 0.006).begins) <= 5
    assert sparse_cells(corners[:1], 0.006).side == 0.006
    row = np.zeros((100, 3))
    row[:, 0] = np.linspace(0.0, 0.5, 100)
    assert sparse_cells(row, 0.1).side == 0.1
