"""Calibration is measured without bias, and ellipsoids hold what they state."""

import numpy as np
import pytest

from contactfusion_lab.trials.calibration import (
    brier,
    calibration_error,
    level,
    radius,
    squared_calibration_error,
)


def test_the_error_of_honest_probabilities_is_near_0_where_the_plain_estimate_is_not() -> None:
    errors = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        probabilities = rng.random(100)
        errors.append(calibration_error(probabilities, rng.random(100) < probabilities) ** 2)
    plain = 10 * np.mean(0.25 * 0.67) / 100  # about the variance of a share of ten
    assert np.mean(errors) < 0.7 * plain


def test_the_error_of_probabilities_that_are_all_too_high_is_by_how_much() -> None:
    rng = np.random.default_rng(0)
    stated = np.full(20_000, 0.9)
    assert calibration_error(stated, rng.random(20_000) < 0.6) == pytest.approx(0.3, abs=0.02)


def test_without_two_probabilities_there_is_no_error() -> None:
    assert np.isnan(calibration_error(np.array([0.5]), np.array([True])))


def test_brier_of_certain_truths_is_0_and_of_certain_errors_1() -> None:
    events = np.array([True, False])
    assert brier(events.astype(float), events) == 0.0
    assert brier((~events).astype(float), events) == 1.0


def test_levels_of_a_gaussian_are_uniform_and_its_radius_holds_its_volume() -> None:
    rng = np.random.default_rng(1)
    root = np.array([[0.01, 0.0, 0.0], [0.004, 0.02, 0.0], [0.0, 0.001, 0.005]])
    covariance = root @ root.T
    levels = [level(root @ rng.standard_normal(3), covariance) for _ in range(4000)]
    assert np.quantile(levels, [0.25, 0.5, 0.95]) == pytest.approx([0.25, 0.5, 0.95], abs=0.03)
    round_one = np.eye(3) * 0.01**2
    assert radius(round_one) == pytest.approx(0.01 * np.sqrt(7.814727903251178))
    assert level(np.array([radius(round_one), 0.0, 0.0]), round_one) == pytest.approx(0.95)


def test_the_calibration_error_is_the_root_of_its_square() -> None:
    stated, events = np.full(40, 0.5), np.arange(40) % 4 == 0
    squared = squared_calibration_error(stated, events)
    assert calibration_error(stated, events) ** 2 == pytest.approx(squared)
    honest = np.full(40, 0.25)
    assert squared_calibration_error(honest, events) < 0.0 == calibration_error(honest, events)
