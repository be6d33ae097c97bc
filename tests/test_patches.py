"""Patches of taxels: places and areas."""

from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError
from contactfusion.patches import PatchConfig, TaxelAreas

ROW: dict[str, Any] = {"rows": 1, "columns": 3, "pitch": (0.1, 0.02)}
QUARTER = np.pi / 2.0


def patch(**fields: Any) -> PatchConfig:
    return PatchConfig(**fields)


def grid(rows: int, columns: int, *pitch: float) -> PatchConfig:
    return patch(grid={"rows": rows, "columns": columns, "pitch": pitch})


def test_a_grid_goes_row_by_row_around_the_origin() -> None:
    expected = [[-1, -4, 0], [-1, 0, 0], [-1, 4, 0], [1, -4, 0], [1, 0, 0], [1, 4, 0]]
    np.testing.assert_allclose(grid(2, 3, 0.2, 0.4).centres(), np.array(expected) / 10.0)


def test_places_are_centres_of_taxels_of_the_given_size() -> None:
    irregular = patch(places=[(0.0, 0.0, 0.0), (0.1, 0.2, 0.3)], size=(0.01, 0.02))
    np.testing.assert_array_equal(irregular.centres(), [[0.0, 0.0, 0.0], [0.1, 0.2, 0.3]])
    np.testing.assert_allclose(irregular.spreads(0.02), np.hypot(0.01, 0.02) / np.sqrt(24.0))


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({}, "give a grid or places"),
        ({"grid": {"rows": 1, "columns": 1, "pitch": (1, 1)}, "places": [(0, 0, 0)]}, "grid or"),
        ({"places": [(0, 0, 0)]}, "places need the size of a taxel"),
        ({"grid": {"rows": 0, "columns": 1, "pitch": (1, 1)}}, "grid.rows"),
        ({"grid": {"rows": 1, "columns": 1, "pitch": (1, 0)}}, "grid.pitch.1"),
        ({"places": [(0, 0, 0)], "size": (-1, 1)}, "size.0"),
        ({"grids": []}, "give a grid or places"),
        ({"grids": [ROW], "grid": ROW}, "give a grid or places, or several grids"),
        ({"grids": [ROW, {**ROW, "pitch": (0, 1)}]}, "grids.1.pitch.0"),
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
    assert TaxelAreas(row).near(points, 0.001).tolist() == [False, False, True]
    assert TaxelAreas(row).near(points, 0.0001).tolist() == [False, False, False]
    assert TaxelAreas(row).near(points, 0.021).tolist() == [False, True, True]
    assert TaxelAreas(row).near(points + [0.0, 0.0, 0.002], 0.001).tolist() == [False, False, False]
    assert TaxelAreas(row).near(np.empty((0, 3)), 1.0).tolist() == [False, False, False]


# Several grids: one ahead, upright; one on the left side, further down; one wider, flat on top


def around() -> PatchConfig:
    ahead = {**ROW, "xyz": (0.3, 0.0, 0.0), "rpy": (0.0, QUARTER, 0.0)}
    left = {**ROW, "columns": 2, "xyz": (0.0, 0.2, -0.1), "rpy": (0.0, QUARTER, QUARTER)}
    top = {"rows": 2, "columns": 1, "pitch": (0.2, 0.1), "xyz": (0.0, 0.0, 0.5)}
    return patch(grids=[ahead, left, top])


def test_several_grids_follow_each_other_each_where_it_is() -> None:
    expected = [
        [0.3, -0.02, 0.0],
        [0.3, 0.0, 0.0],
        [0.3, 0.02, 0.0],
        [0.01, 0.2, -0.1],  # its columns go back along x
        [-0.01, 0.2, -0.1],
        [-0.1, 0.0, 0.5],
        [0.1, 0.0, 0.5],
    ]
    np.testing.assert_allclose(around().centres(), expected, atol=1e-12)


def test_one_grid_of_several_is_like_a_grid() -> None:
    one, other = patch(grid=ROW), patch(grids=[ROW])
    np.testing.assert_array_equal(one.centres(), other.centres())
    np.testing.assert_array_equal(one.spreads(0.01), other.spreads(0.01))


def test_positions_spread_over_the_part_of_a_taxel_that_they_stand_for() -> None:
    widths = np.hypot([0.1] * 5 + [0.2] * 2, [0.02] * 5 + [0.1] * 2)
    np.testing.assert_allclose(around().spreads(0.2), widths / np.sqrt(24.0))
    parts = np.hypot([0.05] * 7, [0.02] * 5 + [0.05] * 2)
    np.testing.assert_allclose(around().spreads(0.05), parts / np.sqrt(24.0))


def test_each_grid_is_covered_on_its_own_plane() -> None:
    places, taxels = around().covered(0.05)
    assert np.bincount(taxels).tolist() == [2] * 5 + [8] * 2
    for taxel, centre in enumerate(around().centres()):
        own = places[taxels == taxel]
        np.testing.assert_allclose(own.mean(axis=0), centre, atol=1e-12)
        flat = (0, 0, 0, 1, 1, 2, 2)[taxel]
        np.testing.assert_allclose(own[:, flat], centre[flat], atol=1e-12)
    np.testing.assert_allclose(np.unique(places[taxels == 0, 2].round(9)), [-0.025, 0.025])
    np.testing.assert_allclose(np.unique(places[taxels == 6, 1].round(9)), [-0.025, 0.025])


@pytest.mark.parametrize(
    ("point", "taxels"),
    [
        ((0.3, 0.02, 0.049), [2]),  # high on the strip ahead
        ((0.3, 0.02, 0.06), []),
        ((0.31, 0.0, 0.0), []),  # before it
        ((-0.01, 0.2, -0.149), [4]),  # low on the strip to the left
        ((-0.01, 0.2, -0.04), []),
        ((0.15, 0.049, 0.5), [6]),
        ((0.0, 0.0, 0.501), [5, 6]),  # between both, and a bit above
    ],
)
def test_near_is_near_to_a_taxel_of_any_grid(
    point: tuple[float, float, float], taxels: list[int]
) -> None:
    near = TaxelAreas(around()).near(np.array([point]), 0.002)
    assert np.flatnonzero(near).tolist() == taxels


def test_neighbours_touch_at_an_edge_or_a_corner_of_their_own_plane() -> None:
    grid = {"rows": 2, "columns": 3, "pitch": (0.01, 0.03)}
    pairs = {(0, 1), (1, 2), (3, 4), (4, 5), (0, 3), (1, 4), (2, 5), (0, 4), (1, 3), (1, 5), (2, 4)}
    found = PatchConfig.model_validate({"grid": grid}).neighbours()
    assert {tuple(sorted(pair)) for pair in found.tolist()} == pairs
    twice = PatchConfig.model_validate({"grids": [grid, {**grid, "xyz": (0.01, 0.0, 0.0)}]})
    other = {(first + 6, second + 6) for first, second in pairs}
    assert {tuple(sorted(pair)) for pair in twice.neighbours().tolist()} == pairs | other


def test_taxels_apart_from_each_other_have_no_neighbours() -> None:
    for other in ((0.02, 0.0, 0.0), (0.0, 0.0, -0.02)):
        apart = {"places": [(0.0, 0.0, 0.0), other], "size": (0.01, 0.01)}
        assert not len(PatchConfig.model_validate(apart).neighbours())
