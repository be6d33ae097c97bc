import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactfusion.errors import ConfigurationError
from contactfusion.generators.proximity import BoxConfig, ProximityConfig, without

PAPER = ProximityConfig()
NOWHERE = np.empty((0, 3))


def naive_lengths(points: np.ndarray, config: ProximityConfig) -> list[float]:
    """Go through O Eq 5-11 point by point."""
    (x_min, x_max), (y_min, y_max), (z_min, z_max) = (
        config.region.x,
        config.region.y,
        config.region.z,
    )
    g_x, g_y = config.cell
    cells: dict[tuple[int, int], list[float]] = {}
    for x, y, z in points.tolist():
        if x_min < x < x_max and y_min < y < y_max and z_min < z < z_max:
            row = min(int((x - x_min) * (1 / g_x)), config.rows - 1)
            column = min(int((y - y_min) * (1 / g_y)), config.columns - 1)
            cells.setdefault((column, row), []).append(x)
    lengths = []
    for column in range(config.columns):
        end = x_max
        for row in range(config.rows):
            held = cells.get((column, row), [])
            if len(held) >= config.occupied:
                end = sum(held) / len(held)
                break
        lengths.append(abs(end - (x_min + g_x / 2)))
    return lengths


def test_the_papers_region_has_16_rows_and_12_strips() -> None:
    assert (PAPER.rows, PAPER.columns) == (16, 12)
    assert PAPER.start == pytest.approx(0.31)
    assert PAPER.bounds()[[0, -1]] == pytest.approx([-0.3, 0.3])


def test_a_strip_without_a_point_reaches_to_the_end_of_the_region() -> None:
    assert PAPER.lengths_of_cloud(NOWHERE) == pytest.approx(np.full(12, 0.31))
    assert PAPER.lengths_of_edges(NOWHERE) == pytest.approx(np.full(12, 0.31))
    assert PAPER.empty == pytest.approx(0.31)


def test_a_cloud_ends_at_the_mean_of_the_nearest_occupied_cell() -> None:
    points = np.array([[0.342, -0.28, 0.0], [0.356, -0.27, 0.1], [0.45, -0.28, 0.0]])
    assert PAPER.lengths_of_cloud(points)[0] == pytest.approx(0.349 - 0.31)


def test_an_edge_ends_at_the_nearest_point() -> None:
    points = np.array([[0.356, 0.28, 0.0], [0.342, 0.27, 0.1], [0.45, 0.28, 0.0]])
    assert PAPER.lengths_of_edges(points)[11] == pytest.approx(0.342 - 0.31)


def test_the_norm_forgets_on_which_side_of_the_first_cells_middle_the_mean_lies() -> None:
    before, behind = np.array([[0.303, 0.0, 0.0]]), np.array([[0.317, 0.0, 0.0]])
    assert PAPER.lengths_of_cloud(before)[6] == pytest.approx(0.007)
    assert PAPER.lengths_of_cloud(behind)[6] == pytest.approx(0.007)


@pytest.mark.parametrize(
    "point",
    [(0.30, 0, 0), (0.62, 0, 0), (0.4, -0.3, 0), (0.4, 0.3, 0), (0.4, 0, -0.4), (0.4, 0, 0.5)],
)
def test_a_point_on_the_bounds_of_the_region_is_outside(point: tuple[float, ...]) -> None:
    assert PAPER.lengths_of_cloud(np.array([point])) == pytest.approx(np.full(12, 0.31))


def test_rows_that_are_not_finite_are_no_points() -> None:
    points = np.array([[np.nan, 0.0, 0.0], [0.32, np.inf, 0.0], [0.33, 0.01, 0.0]])
    assert PAPER.lengths_of_cloud(points)[6] == pytest.approx(0.02)


def test_where_two_points_occupy_a_cell_one_does_not() -> None:
    lone, pair = [[0.305, 0.01, 0.0]], [[0.401, 0.01, 0.0], [0.403, 0.02, 0.0]]
    careful = ProximityConfig(occupied=2)
    assert careful.lengths_of_cloud(np.array(lone + pair))[6] == pytest.approx(0.402 - 0.31)
    assert careful.lengths_of_cloud(np.array(lone))[6] == pytest.approx(0.31)


@given(st.integers(0, 2**32 - 1), st.integers(0, 400), st.integers(1, 3))
def test_it_equals_the_equations_taken_point_by_point(seed: int, count: int, least: int) -> None:
    points = np.random.default_rng(seed).uniform((0.25, -0.35, -0.5), (0.7, 0.35, 0.6), (count, 3))
    config = ProximityConfig(occupied=least)
    assert config.lengths_of_cloud(points) == pytest.approx(naive_lengths(points, config))


def test_a_region_that_is_no_whole_number_of_cells_is_refused() -> None:
    region = BoxConfig(x=(0.3, 0.63), y=(-0.3, 0.3), z=(-0.4, 0.5))
    with pytest.raises(ConfigurationError, match=r"along x, 0.33 m, is not a whole number"):
        ProximityConfig(region=region)


def test_a_box_takes_the_robots_own_points_away() -> None:
    robot = BoxConfig(x=(0.0, 0.31), y=(-1.0, 1.0), z=(-1.0, 0.0))
    points = np.array([[0.305, 0.0, -0.1], [0.305, 0.0, 0.1], [0.33, 0.0, -0.1]])
    assert without(points, [robot]).tolist() == points[1:].tolist()
