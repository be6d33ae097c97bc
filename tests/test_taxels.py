"""Patches of taxels: places, areas, and what they read untouched."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError
from contactfusion.generators.taxels import BaselineConfig, PatchConfig, fit_baseline
from contactfusion.npz_files import write_npz


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
    assert irregular.edges() == (0.01, 0.02)


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


def test_one_number_serves_all_taxels() -> None:
    values, noise = BaselineConfig(values=3.0, noise=(1.0, 2.0)).load(2)
    assert values.tolist() == [3.0, 3.0] and noise.tolist() == [1.0, 2.0]


def test_a_baseline_file_replaces_both(tmp_path: Path) -> None:
    images = np.random.default_rng(0).normal(240.0, 3.0, (500, 4))
    values, noise = fit_baseline(images, 0.5)
    write_npz(tmp_path / "palm.npz", values=values, noise=noise)
    loaded = BaselineConfig(values=7.0, file=tmp_path / "palm.npz").load(4)
    np.testing.assert_array_equal(loaded, (values, noise))


def test_a_fit_gives_the_median_and_no_less_than_the_least_noise() -> None:
    rng = np.random.default_rng(0)
    images = np.stack([rng.normal(10.0, 2.0, 2000), np.full(2000, 5.0)], axis=1)
    images[0, 0] = 1e3  # one touch among many samples moves a median little
    values, noise = fit_baseline(images[1:], 0.5)
    assert values == pytest.approx([10.0, 5.0], abs=0.15)
    assert noise == pytest.approx([2.0, 0.5], abs=0.1)
    assert fit_baseline(images, 0.5)[0] == pytest.approx([10.0, 5.0], abs=0.15)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"values": (1.0, 2.0)}, "baseline: 2 numbers for the 3 taxels of the patch"),
        ({"noise": (1.0, 2.0)}, "baseline: 2 numbers for the 3 taxels of the patch"),
        ({"noise": 0.0}, "baseline: the noise must be positive"),
        ({"noise": (1.0, -1.0, 1.0)}, "baseline: the noise must be positive"),
    ],
)
def test_a_baseline_that_does_not_fit_is_refused(fields: dict[str, Any], problem: str) -> None:
    with pytest.raises(ConfigurationError, match=problem):
        BaselineConfig(**fields).load(3)


def test_a_baseline_file_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "palm.npz"
    baseline = BaselineConfig(file=path)
    with pytest.raises(ConfigurationError, match="there is no file 'palm.npz'"):
        baseline.load(2)
    path.write_text("no archive")
    with pytest.raises(ConfigurationError, match="is no npz file"):
        baseline.load(2)
    write_npz(path, values=np.zeros(2))
    with pytest.raises(ConfigurationError, match="lacks noise; it holds values"):
        baseline.load(2)
    write_npz(path, values=np.array([0.0, np.nan]), noise=np.ones(2))
    with pytest.raises(ConfigurationError, match="row 1 of the numbers of the baseline"):
        baseline.load(2)
    write_npz(path, values=np.zeros((2, 2)), noise=np.ones(2))
    with pytest.raises(ConfigurationError, match=r"have shape \(2, 2\), not \(2,\)"):
        baseline.load(2)
