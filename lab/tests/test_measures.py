"""Figures with their intervals; cases compared by paired tests, and corrections of several."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactfusion.arrays import FloatArray
from contactfusion_lab.trials.measures import (
    CASE,
    TRIAL,
    Comparison,
    compared,
    grouped,
    mcnemar,
    proportion,
    resampled,
)
from contactfusion_lab.trials.tables import comparisons_text

NAN = float("nan")


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


# Cases compared trial by trial


def case(name: str, errors: FloatArray, first: int = 0) -> pd.DataFrame:
    """Trials with these errors, of which those up to 3 cm succeed."""
    names = [f"box-{first + number:03d}" for number in range(len(errors))]
    return pd.DataFrame({CASE: name, TRIAL: names, "success": errors <= 0.03, "error": errors})


def both(first: FloatArray, second: FloatArray) -> tuple[Comparison, Comparison]:
    frame = pd.concat([case("b", second), case("a", first)], ignore_index=True)
    success, error = compared(frame, [("a", "b")], "success", ["error"], 0)
    return success, error


@pytest.fixture
def errors() -> FloatArray:
    drawn: FloatArray = np.random.default_rng(1).uniform(0.0, 0.06, 60)
    return drawn


def test_a_case_is_compared_with_another_trial_by_trial(errors: FloatArray) -> None:
    success, error = both(errors / 2.0, errors)
    assert (success.case, success.against, success.trials) == ("a", "b", 60)
    assert success.only_it == (errors > 0.03).sum() and success.only_other == 0
    assert success.p < 1e-3 and error.p < 1e-6 and error.stars == "***"
    assert error.difference == pytest.approx(-np.median(errors / 2.0))
    assert both(errors, errors / 2.0)[0].only_other == success.only_it


def test_success_is_tested_by_coins_and_numbers_by_signed_ranks() -> None:
    first = np.array([0.01] * 8 + [0.05] * 2)
    second = np.array([0.01] * 2 + [0.05] * 7 + [0.01])
    success, _ = both(first, second)
    assert (success.only_it, success.only_other) == (6, 1)
    assert success.p == pytest.approx(2 * 8 / 2**7)
    _, error = both(0.01 + 0.001 * np.arange(8.0), 0.02 + 0.002 * np.arange(8.0))
    assert error.p == pytest.approx(2 / 2**8)


def test_what_is_equal_does_not_differ(errors: FloatArray) -> None:
    success, error = both(errors, errors)
    assert success.p == error.p == 1.0 and error.stars == "n.s."
    assert error.difference == error.of_medians == error.low == error.high == 0.0


def test_the_interval_is_of_pairs(errors: FloatArray) -> None:
    _, error = both(errors - 0.001, errors)
    for value in (error.of_medians, error.low, error.high):
        assert value == pytest.approx(-0.001)


def test_the_interval_holds_the_difference_and_shrinks_with_trials() -> None:
    rng, widths = np.random.default_rng(3), []
    for n in (30, 3000):
        first, second = rng.uniform(0.0, 0.02, n), rng.uniform(0.0, 0.03, n)
        _, error = both(first, second)
        assert error.low is not None and error.high is not None
        assert error.of_medians == pytest.approx(np.median(first) - np.median(second))
        assert error.low < -0.005 < error.high
        widths.append(error.high - error.low)
    assert widths[1] < widths[0] / 4.0


def test_numbers_are_compared_where_both_have_one() -> None:
    success, error = both(np.array([0.01, 0.02, NAN, NAN]), np.array([0.02, NAN, 0.01, NAN]))
    assert (success.trials, error.trials) == (4, 1)
    assert error.difference == error.of_medians == error.low == pytest.approx(-0.01)
    assert (success.only_it, success.only_other) == (1, 1)


def test_trials_that_only_one_made_do_not_count() -> None:
    frame = pd.concat([case("a", np.zeros(3)), case("b", np.zeros(3), first=1)])
    (success,) = compared(frame, [("a", "b")], "success", [], 0)
    assert success.trials == 2


def test_without_a_common_value_there_is_nothing_to_compare() -> None:
    success, error = both(np.array([NAN]), np.array([0.01]))
    assert error.difference is error.of_medians is None and error.p == 1.0
    text = comparisons_text([success, error], {"error": ("ε cm", 100.0, ".2f")})
    assert text.splitlines()[2:] == [
        "| a | b | success | 1 | 0 | 1 |  |  | 1 | 1 |",
        "| a | b | ε cm | 0 |  |  | - | - | 1 | 1 |",
    ]
    assert comparisons_text([], {}) == ""


def test_of_several_p_values_the_least_counts_as_often_as_there_are() -> None:
    wins = np.array([0.01] * 6)
    frame = pd.concat([case("a", wins), case("b", wins + 0.03), case("c", wins + 0.03)])
    first, second = compared(frame, [("b", "a"), ("c", "a")], "success", [], 0)
    assert first.p == second.p == 0.03125
    assert first.p_holm == second.p_holm == 0.0625
    assert "| b | a | success | 6 | 0 | 6 |  |  | 0.031 | 0.062 |" in (
        comparisons_text([first, second], {})
    )


@settings(max_examples=20)
@given(st.lists(st.integers(0, 12), min_size=2, max_size=6))
def test_corrected_p_values_are_no_less_and_in_the_same_order(worse: list[int]) -> None:
    cases = [case("first", np.zeros(12))]
    cases += [
        case(str(row), np.where(np.arange(12) < count, 0.05, 0.0))
        for row, count in enumerate(worse)
    ]
    pairs = [(str(row), "first") for row in range(len(worse))]
    found = compared(pd.concat(cases), pairs, "success", [], 0)
    assert all(each.p <= each.p_holm <= 1.0 for each in found)
    ordered = sorted(found, key=lambda each: (each.p, each.p_holm))
    assert [each.p_holm for each in ordered] == sorted(each.p_holm for each in found)
    least = min(each.p for each in found)
    assert min(each.p_holm for each in found) == pytest.approx(min(len(found) * least, 1.0))


def test_the_interval_of_a_square_is_not_moved_by_the_variance_of_what_is_drawn() -> None:
    def square(values: FloatArray) -> float:  # of the mean, without its own variance
        return float(values.mean() ** 2 - values.var(ddof=1) / len(values))

    values = np.random.default_rng(1).standard_normal(40)
    variance = values.var(ddof=1) / len(values)  # what each draw adds in the mean
    ends = {
        is_biased: grouped(
            values, square, np.arange(40), np.random.default_rng(2), is_biased=is_biased
        )
        for is_biased in (False, True)
    }
    (value, low, high), moved = ends[False], ends[True]
    assert moved[0] == value
    assert low - moved[1] == pytest.approx(high - moved[2])
    assert low - moved[1] == pytest.approx(variance, rel=0.1)


@given(st.integers(2, 40), st.integers(1, 30), st.data())
def test_copies_of_a_hit_say_no_more_than_it_alone(count: int, copies: int, data: Any) -> None:
    hits = np.array(data.draw(st.lists(st.booleans(), min_size=count, max_size=count)))
    groups = np.repeat(np.arange(count), copies)
    once, repeated = proportion(hits, np.arange(count)), proportion(hits.repeat(copies), groups)
    np.testing.assert_allclose(repeated, once)
    share, low, high = once
    alone = proportion(hits)
    assert low <= alone[1] + 1e-12
    assert high >= alone[2] - 1e-12
    assert 0.0 <= low <= share <= high <= 1.0
    if share in (0.0, 1.0):
        assert once == pytest.approx(alone)


def test_the_interval_of_a_proportion_over_groups_holds_the_truth_as_often_as_it_says() -> None:
    rng, size, runs = np.random.default_rng(5), 20, 400
    covered = {"grouped": 0, "independent": 0}
    for _ in range(runs):
        chances = rng.beta(4.0, 1.0, 25)  # 0.8 in the mean
        hits = rng.random((25, size)) < chances[:, None]
        groups = np.repeat(np.arange(25), size)
        for name, owners in (("grouped", groups), ("independent", None)):
            _, low, high = proportion(hits.ravel(), owners)
            covered[name] += low <= 0.8 <= high
    assert 0.92 <= covered["grouped"] / runs <= 0.98
    assert covered["independent"] / runs < 0.75  # what is grouped is not independent


def test_of_nothing_there_is_no_figure() -> None:
    assert np.isnan(proportion(np.array([], np.bool_))).all()
    assert np.isnan(grouped(np.array([]), np.mean, np.array([]), np.random.default_rng(0))).all()


def test_a_case_without_trials_is_compared_with_none() -> None:
    frame = pd.DataFrame({CASE: ["a"], TRIAL: ["x"], "won": [True], "error": [0.1]})
    assert compared(frame, [("a", "b")], "won", ["error"], 0) == []
