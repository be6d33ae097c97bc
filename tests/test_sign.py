"""A wrong sign is told once it has lasted, and a right one is not."""

import numpy as np
import pytest

from contactfusion.generators.sign import SignWatch, WeightWatch


def said(reverse: list[bool], step: float = 0.1) -> list[int]:
    """The samples at which a sign is suspected."""
    watch = SignWatch()
    return [row for row, each in enumerate(reverse) if watch.suspects(step * row, each)]


def test_it_is_said_once_after_it_has_lasted() -> None:
    assert said([True] * 60) in ([20], [21])


def test_samples_that_are_explained_speak_against_it() -> None:
    assert said([True, False] * 60) == []
    assert said([True] * 15 + [False] * 100) == []


def test_gaps_are_no_time() -> None:
    assert said([True] * 60, step=1.0) == []


def turning(factor: float, sway: float = 1.0, bias: float = 3.0) -> int:
    """How often a load is suspected whose readings leave `factor` weights, as it turns."""
    rng, watch, count = np.random.default_rng(0), WeightWatch(), 0
    for stamp in np.arange(0.0, 5.0, 0.01):
        angle = sway * np.sin(stamp)
        weight = 10.0 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
        left = factor * weight + bias + 0.2 * rng.standard_normal(3)
        count += watch.suspects(float(stamp), weight, left)
    return count


@pytest.mark.parametrize(("factor", "times"), [(-2.0, 1), (0.0, 0), (0.1, 0), (-1.0, 0)])
def test_the_weight_of_a_turning_load_says_the_sign_whatever_the_bias(
    factor: float, times: int
) -> None:
    assert turning(factor) == times


def test_a_load_that_is_not_turned_says_nothing() -> None:
    assert turning(-2.0, sway=0.1) == 0
