"""Patches of taxels: places and areas."""

from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError
from contactfusion.patches import PatchConfig


def patch(**fields: Any) -> PatchConfig:
    return PatchConfig(**fields)


def grid(rows: int, columns: int, *pitch: float) -> PatchConfig:
    return patch(grid={"rows": rows, "columns": columns, "pitch": pitch})


def test_a_grid_goes_row_by_row_around_the_origin() -> None:
    expected = [[-1, -4, 0], [-1, 0, 0], [-1, 4, 0], [1, -4, 0], [1, 0, 0], [1, 4, 0]]
    np.testing.assert_allclose(grid(2, 3, 2.0, 4.0).centres(), expected)


def test_places_are_centres_of_taxels_of_the_given_size() -> None:
    irregular = patch(places=[(0.0, 0.0, 0.0), (0.1, 0.2, 0.3)], size=(0.01, 0.02))
    np.testing.assert_array_equal(irregular.centres(), [[0.0, 0.0, 0.0], [0.1, 0.2, 0.3]])
    np.testing.assert_allclose(irregular.spreads(), np.hypot(0.01, 0.02) / np.sqrt(24.0))


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({}, "give a grid or places"),
        ({"grid": {"rows": 1, "columns": 1, "pitch": (1, 1)}, "places": [(0, 0, 0)]}, "grid or"),
        ({"places": [(0, 0, 0)]}, "places need the size of a taxel"),
        ({"grid": {"rows": 0, "columns": 1, "pitch": (1, 1)}}, "grid.rows"),
        ({"grid": {"rows": 1, "columns": 1, "pitch": (1, 0)}}, "grid.pitch.1"),
        ({"places": [(0, 0, 0)], "size": (-1, 1)}, "size.0"),
    ],
)
def test_half_a_description_is_refused(fields: dict[str, Any], problem: str) -> None:
    with pytest.raises(ConfigurationError, match=problem):
        patch(**fields)


def test_a_taxel_smaller_than_a_voxel_is_one_place() -> None:
    small = grid(2, 2, 0.004, 0.004)
    places, taxels = small.covered(0.005)
    np.testing.assert_array_equal(places, small.centres())
    assert taxels.tolist() == [0, 1, 2, 3]


def test_a_wider_taxel_is_covered_by_places_no_further_apart_than_a_voxel() -> None:
    places, taxels = grid(1, 1, 0.012, 0.010).covered(0.005)
    np.testing.assert_allclose(np.unique(places[:, 0]), [-0.004, 0.0, 0.004], atol=1e-12)
    np.testing.assert_allclose(np.unique(places[:, 1]), [-0.0025, 0.0025])
    assert len(places) == 6 and not taxels.any()


def test_neighbours_are_covered_without_a_seam() -> None:
    places, taxels = grid(1, 2, 0.01, 0.012).covered(0.005)
    np.testing.assert_allclose(np.diff(np.unique(places[:, 1].round(9))), 0.004)
    assert np.bincount(taxels).tolist() == [6, 6]


def test_near_is_over_the_area_or_closer_than_the_reach() -> None:
    row = grid(1, 3, 0.02, 0.02)
    points = np.array([[0.0, 0.0305, 0.0]])  # half a millimetre beyond the last taxel
    assert row.near(points, 0.001).tolist() == [False, False, True]
    assert row.near(points, 0.0001).tolist() == [False, False, False]
    assert row.near(points, 0.021).tolist() == [False, True, True]
    assert row.near(points + [0.0, 0.0, 0.002], 0.001).tolist() == [False, False, False]
    assert row.near(np.empty((0, 3)), 1.0).tolist() == [False, False, False]
