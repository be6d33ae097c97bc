"""The nearest sample of a body, against a look at all of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import inverse, pose_of
from contactfusion.nearest import CELL, MOST_NODES, NearestGrid
from contactfusion.shapes import BodyConfig, PartConfig

BOX = PartConfig(shape="box", size=(0.1, 0.06, 0.04)).sampled("box", 0.004).points
POSE = pose_of((0.3, -0.2, 0.1), Rotation.from_rotvec([0.4, -0.7, 1.1]).as_matrix())


def found(samples: FloatArray, points: FloatArray, reach: float = np.inf) -> FloatArray:
    return found_in(NearestGrid.of(samples), points, reach)


def found_in(grid: NearestGrid, points: FloatArray, reach: float = np.inf) -> FloatArray:
    samples = grid.samples
    distances, rows = np.full(len(points), reach), np.full(len(points), -1, np.intp)
    grid.improve(points, np.eye(4), 0, distances, rows)
    hit = rows >= 0
    own = np.linalg.norm(samples[rows[hit]] - points[hit], axis=1)
    np.testing.assert_allclose(distances[hit], own, atol=1e-12)
    return distances


def around(count: int, away: float, seed: int = 0) -> FloatArray:
    """Give places about `away` [m] off the box."""
    rng = np.random.default_rng(seed)
    places: FloatArray = BOX[rng.integers(0, len(BOX), count)] + rng.normal(0, away, (count, 3))
    return places


@pytest.mark.parametrize("away", [0.001, 0.005, 0.02])
def test_near_a_surface_it_is_the_nearest_but_for_a_few(away: float) -> None:
    points = around(4000, away)
    further = found(BOX, points) - cdist(points, BOX).min(axis=1)
    assert further.min() > -1e-12
    assert (further > 1e-9).mean() < 0.01 and further.max() < 0.002


def test_far_off_it_is_hardly_further_than_the_nearest() -> None:
    points = around(2000, 0.5)
    exact = cdist(points, BOX).min(axis=1)
    assert (found(BOX, points) / np.maximum(exact, 0.01)).max() < 1.1


@settings(max_examples=40)
@given(st.lists(st.tuples(*[st.floats(-0.1, 0.1)] * 3), min_size=1, max_size=30), st.integers(0, 9))
def test_few_samples_are_all_looked_at(samples: list[tuple[float, ...]], seed: int) -> None:
    places = np.array(samples)
    points = np.random.default_rng(seed).uniform(-0.15, 0.15, (50, 3))
    further = found(places, points) - cdist(points, places).min(axis=1)
    assert further.min() > -1e-12 and further.max() < 0.02


def test_beyond_the_reach_nothing_is_found() -> None:
    points = around(500, 0.05)
    limited = found(BOX, points, 0.02)
    exact = found(BOX, points)
    assert (limited[exact > 0.02] == 0.02).all()
    np.testing.assert_array_equal(limited[exact < 0.02], exact[exact < 0.02])


def test_points_in_another_frame_are_brought_to_the_samples() -> None:
    points = around(500, 0.01)
    moved = points @ POSE[:3, :3].T + POSE[:3, 3]
    distances, rows = np.full(500, np.inf), np.zeros(500, np.intp)
    NearestGrid.of(BOX).improve(moved, inverse(POSE), 0, distances, rows)
    np.testing.assert_allclose(distances, found(BOX, points), atol=1e-9)


def test_of_two_bodies_the_nearer_counts() -> None:
    fields: dict[str, Any] = {"shape": "sphere", "radius": 0.02}
    shapes = (PartConfig(**fields), PartConfig(**fields, xyz=(0.1, 0.0, 0.0), link="far"))
    surface = BodyConfig(frame="base", shapes=shapes).sampled(Path())
    points = np.array([[0.04, 0.0, 0.0], [0.06, 0.0, 0.0]])
    _, rows = surface.nearest(points)
    assert surface.links[rows].tolist() == [0, 1]


def test_a_wide_body_has_a_coarser_grid_and_its_nearest_samples_all_the_same() -> None:
    samples = PartConfig(shape="box", size=(4.0, 1.0, 0.9)).sampled("boom", 0.05).points
    grid = NearestGrid.of(samples)
    assert grid.cell == 2.0 * CELL and grid.nodes.size <= MOST_NODES
    points = samples[::7] + np.random.default_rng(0).normal(0, 0.01, samples[::7].shape)
    further = found_in(grid, points) - cdist(points, samples).min(axis=1)
    assert (further > 1e-9).mean() < 0.01
