import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactfusion.grid import Grid
from contactfusion.thinning import voxel_downsample

SIDE = 0.01


@given(
    st.lists(st.tuples(*[st.integers(-6, 6)] * 3), max_size=40), st.sampled_from([1, 10_000])
)  # near to each other they are looked up in a table, far apart they are sorted
def test_of_each_voxel_the_first_place_is_kept(cells: list[tuple[int, ...]], apart: int) -> None:
    places = (apart * np.array(cells, np.float64).reshape(-1, 3) + 0.5) * SIDE
    expected = [row for row, cell in enumerate(cells) if cell not in cells[:row]]
    assert voxel_downsample(places, Grid("base", SIDE)).tolist() == expected


@pytest.mark.parametrize(
    ("x", "same"), [(0.0999, False), (0.1, True), (0.10999, True), (0.11, False)]
)
def test_voxels_are_those_of_the_grid(x: float, same: bool) -> None:
    places = np.array([[0.105, 0.0, 0.0], [x, 0.0, 0.0]])
    grid = Grid("base", SIDE)
    assert (len(voxel_downsample(places, grid)) == 1) is same
    assert bool((grid.voxels(places)[0] == grid.voxels(places)[1]).all()) is same


def test_rows_of_any_layout_are_taken() -> None:
    places = np.zeros((3, 4)).T[:, :3] + np.arange(4)[:, None]
    assert voxel_downsample(places, Grid("base", SIDE)).tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("wrong", [np.inf, -np.inf, 1e300, 2.0**21 * SIDE])
def test_places_that_no_table_can_hold_are_no_end_of_the_process(wrong: float) -> None:
    places = np.zeros((1000, 3))
    places[500], places[700] = wrong, [-2.0 * SIDE * 2**20, 0.0, 4.0]
    with np.errstate(invalid="ignore"):
        rows = voxel_downsample(places, Grid("base", SIDE))
    assert rows[0] == 0 and set(rows.tolist()) <= {0, 500, 700}
