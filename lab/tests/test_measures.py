"""Figures with their intervals, and tests of several at once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactfusion_lab.trials.measures import holm, mcnemar, resampled

P_VALUES = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8)


def test_a_mean_has_the_interval_of_its_standard_error() -> None:
    values = np.random.default_rng(0).normal(5.0, 2.0, 400)
    mean, low, high = resampled(values, np.mean, np.random.default_rng(1))
    assert mean == values.mean()
    assert (high - low) / 2.0 == pytest.approx(1.96 * 2.0 / 20.0, rel=0.1)


def test_what_only_one_of_two_has_is_tested_by_coins() -> None:
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(3, 3) == 1.0
    assert mcnemar(6, 0) == mcnemar(0, 6) == 2 * 0.5**6


def test_of_several_p_values_the_least_counts_as_often_as_there_are() -> None:
    assert holm([0.04, 0.01, 0.03]) == pytest.approx([0.06, 0.03, 0.06])
    assert holm([0.6, 0.7]) == [1.0, 1.0]


@given(P_VALUES)
def test_corrected_p_values_are_no_less_and_in_the_same_order(values: list[float]) -> None:
    corrected = holm(values)
    assert all(value <= one <= 1.0 for value, one in zip(values, corrected, strict=True))
    told = sorted(zip(values, corrected, strict=True))
    assert [one for _, one in told] == sorted(corrected)
    assert min(corrected) == min(len(values) * min(values), 1.0)
