"""GOSPA agrees with its definition, and its parts add up."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactfusion.arrays import FloatArray
from contactfusion_lab.trials.localisation import localisation

CUTOFF = 0.03
SETS = (
    st.integers(0, 4)
    .flatmap(
        lambda n: st.lists(
            st.tuples(*[st.floats(-0.05, 0.05, allow_nan=False)] * 3), min_size=n, max_size=n
        )
    )
    .map(lambda points: np.reshape(np.array(points, np.float64), (-1, 3)))
)


def by_definition(true: FloatArray, reported: FloatArray) -> float:
    """The least cost over all ways to pair, by trying each (Rahmathullah 2017, definition 1)."""
    few, many = sorted((true, reported), key=len)
    least = np.inf
    for rows in permutations(range(len(many)), len(few)):
        apart = np.linalg.norm(few - many[list(rows)], axis=1)
        least = min(least, float((np.minimum(apart, CUTOFF) ** 2).sum()))
    return float(np.sqrt(least + CUTOFF**2 / 2.0 * (len(many) - len(few))))


@given(SETS, SETS)
def test_it_is_the_metric_of_the_definition(true: FloatArray, reported: FloatArray) -> None:
    assert localisation(true, reported, CUTOFF).gospa == pytest.approx(
        by_definition(true, reported), abs=1e-12
    )


@given(SETS, SETS)
def test_missed_and_false_swap_with_the_sets_and_the_metric_stays(
    true: FloatArray, reported: FloatArray
) -> None:
    found, swapped = localisation(true, reported, CUTOFF), localisation(reported, true, CUTOFF)
    assert (found.missed, found.false) == (swapped.false, swapped.missed)
    assert found.gospa == pytest.approx(swapped.gospa, abs=1e-12)


@given(SETS, SETS)
def test_the_parts_add_up(true: FloatArray, reported: FloatArray) -> None:
    found = localisation(true, reported, CUTOFF)
    assert len(true) - found.missed == len(reported) - found.false >= 0
    parts = found.distance**2 + CUTOFF**2 / 2.0 * (found.missed + found.false)
    assert found.gospa**2 == pytest.approx(parts, abs=1e-15)


def test_a_contact_beyond_the_cutoff_is_missed_and_false() -> None:
    found = localisation(np.zeros((1, 3)), np.array([[0.0, 0.0, 0.031]]), CUTOFF)
    assert (found.distance, found.missed, found.false) == (0.0, 1, 1)
    assert found.gospa == pytest.approx(CUTOFF)
