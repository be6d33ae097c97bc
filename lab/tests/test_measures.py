"""Figures with their intervals."""

import numpy as np
import pytest

from contactfusion_lab.trials.measures import grouped, mcnemar, resampled


def test_a_mean_has_the_interval_of_its_standard_error() -> None:
    values = np.random.default_rng(0).normal(5.0, 2.0, 400)
    mean, low, high = resampled(values, np.mean, np.random.default_rng(1))
    assert mean == values.mean()
    assert (high - low) / 2.0 == pytest.approx(1.96 * 2.0 / 20.0, rel=0.1)


def test_what_only_one_of_two_has_is_tested_by_coins() -> None:
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(3, 3) == 1.0
    assert mcnemar(6, 0) == mcnemar(0, 6) == 2 * 0.5**6


def test_a_single_value_is_its_own_interval() -> None:
    assert resampled(np.array([2.0]), np.median, np.random.default_rng(0)) == (2.0, 2.0, 2.0)


def test_where_whole_groups_are_drawn_the_interval_is_as_wide_as_theirs() -> None:
    values = np.repeat(np.random.default_rng(0).normal(0.0, 1.0, 20), 30)
    groups = np.repeat(np.arange(20), 30)
    _, low, high = grouped(
        values, lambda some: float(some.mean()), groups, np.random.default_rng(1)
    )
    assert (high - low) / 2.0 == pytest.approx(1.96 * values.std() / np.sqrt(20.0), rel=0.15)
