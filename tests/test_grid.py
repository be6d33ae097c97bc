"""The one rounding of places to voxels."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactfusion import Grid, HypothesisCloud, Integrator, IntegratorConfig
from contactfusion.arrays import FloatArray
from tests.clouds import REGULAR

REACH = 1 << 20
INDICES = st.integers(1 - REACH, REACH - 1)


def places(side: float) -> FloatArray:
    """Give 1e5 places: at random, on faces and edges of voxels, and one bit beside them."""
    rng = np.random.default_rng(0)
    faces = rng.integers(-1000, 1000, (30_000, 3)).astype(np.float64) * side
    return np.concatenate(
        [
            rng.uniform(-5.0, 5.0, (20_000, 3)),
            faces,
            np.nextafter(faces[:12_500], np.inf),
            np.nextafter(faces[:12_500], -np.inf),
            faces[:12_500].astype(np.float32).astype(np.float64),
            rng.integers(1 - REACH, REACH, (12_500, 3)).astype(np.float64) * side * (1.0 - 1e-9),
        ]
    )


@pytest.mark.parametrize("side", [0.005, 0.003, 0.1, 0.01, 1.0 / 128.0])
def test_the_integrator_rounds_as_the_grid_does(side: float) -> None:
    points = places(side)
    integrator = Integrator(IntegratorConfig(voxel_size=side))
    integrator.receive(
        HypothesisCloud("a", REGULAR, 0.0, "base", points, np.full(len(points), 0.01))
    )
    expected = np.unique(Grid("base", side).voxels(points), axis=0)
    assert len(points) == 100_000
    assert np.array_equal(integrator.step(0.0).space.voxels, expected)


def test_the_rounding_is_the_floor_of_x_times_the_inverse_side() -> None:
    points = places(0.005)
    expected = np.floor(points * (1.0 / 0.005))
    assert np.array_equal(Grid("base", 0.005).voxels(points), expected)


def test_voxels_are_half_open_also_below_zero() -> None:
    x = np.array([-0.02, -0.0151, -0.015, -0.01, -1e-300, -0.0, 0.0, 0.0149, 0.015])
    voxels = Grid("base", 0.01).voxels(np.stack([x, x, x], axis=1))
    assert voxels[:, 0].tolist() == [-2, -2, -2, -1, -1, 0, 0, 1, 1]


def test_a_single_precision_place_is_widened_before_it_is_rounded() -> None:
    point: Any = np.full((1, 3), 0.015, np.float32)
    expected = int(np.floor(float(np.float32(0.015)) * (1.0 / 0.005)))
    assert Grid("base", 0.005).voxels(point).tolist() == [[expected] * 3]


@given(INDICES, st.sampled_from([0.005, 0.003, 0.1, 1.0, 1.0 / 128.0]))
def test_the_centre_of_a_voxel_lies_in_it(index: int, side: float) -> None:
    grid = Grid("base", side)
    voxel = np.array([[index, -index, 0]])
    assert np.array_equal(grid.voxels(grid.centres(voxel)), voxel)
