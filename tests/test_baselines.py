"""What taxels read untouched."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError
from contactfusion.files import write_npz
from contactfusion.generators.baselines import BaselineConfig, fit_baseline


def test_one_number_serves_all_taxels() -> None:
    values, noise = BaselineConfig(values=3.0, noise=(1.0, 2.0)).load(2)
    assert values.tolist() == [3.0, 3.0] and noise.tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("images", "noise"),
    [(np.empty((0, 4)), 0.5), (np.ones(4), 0.5), (np.full((3, 4), np.nan), 0.5)]
    + [(np.ones((3, 4)), noise) for noise in (0.0, -1.0, np.nan)],
)
def test_a_baseline_of_nothing_is_none(images: Any, noise: float) -> None:
    with pytest.raises(ValueError, match="images are finite|standard deviation is positive"):
        fit_baseline(images, noise)


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
