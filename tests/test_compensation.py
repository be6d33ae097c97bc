"""Mass, centre of mass and biases from poses without contact."""

from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.generators.compensation import BiasEstimate, Compensation, fit_compensation
from contactfusion.generators.force_torque import ForceTorqueConfig

TRUTH = Compensation(
    mass=1.25,
    centre_of_mass=(0.01, -0.03, 0.08),
    force_bias=(12.0, -7.0, 3.5),
    torque_bias=(0.4, -0.2, 0.1),
)
Poses = tuple[FloatArray, FloatArray, FloatArray]


def gravities(count: int = 12, seed: int = 0) -> FloatArray:
    rotations = Rotation.random(count, rng=np.random.default_rng(seed))
    turned: FloatArray = rotations.apply([0.0, 0.0, -9.81])
    return turned


def poses(gravity: FloatArray, force_noise: float = 0.0, torque_noise: float = 0.0) -> Poses:
    rng = np.random.default_rng(1)
    wrenches = np.array([TRUTH.contactless(one) for one in gravity])
    wrenches += rng.normal(size=wrenches.shape) * np.repeat([force_noise, torque_noise], 3)
    return wrenches[:, :3], wrenches[:, 3:], gravity


def around(axis: FloatArray, angles: FloatArray) -> FloatArray:
    """Gravity in a sensor that starts upright and turns about one axis."""
    turned: FloatArray = Rotation.from_rotvec(angles[:, None] * axis).apply([0.0, 0.0, -9.81])
    return turned


def test_weight_pulls_the_way_of_gravity_and_turns_about_the_sensor() -> None:
    # 2 kg at x = 0.1 m under gravity along −z: −19.62 N along z, and +1.962 N·m about y.
    load = Compensation(mass=2.0, centre_of_mass=(0.1, 0.0, 0.0), force_bias=(1.0, 0.0, 0.0))
    wrench = load.contactless(np.array([0.0, 0.0, -9.81]))
    np.testing.assert_allclose(wrench, [1.0, 0.0, -19.62, 0.0, 1.962, 0.0])


@pytest.mark.parametrize("count", [3, 4, 50])
def test_exact_poses_give_exact_numbers(count: int) -> None:
    fit = fit_compensation(*poses(gravities(count)))
    for name in Compensation.model_fields:
        assert getattr(fit.compensation, name) == pytest.approx(getattr(TRUTH, name), abs=1e-9)
    np.testing.assert_allclose([fit.force_residual, fit.torque_residual], 0.0, atol=1e-9)


def test_one_axis_is_enough_when_it_turns_far() -> None:
    fit = fit_compensation(*poses(around(np.array([1.0, 0.0, 0.0]), np.linspace(0.0, 3.0, 20))))
    assert fit.compensation.centre_of_mass == pytest.approx(TRUTH.centre_of_mass, abs=1e-9)


def test_residuals_are_the_noise_and_estimates_are_near() -> None:
    fit = fit_compensation(*poses(gravities(2000), 0.2, 0.01))
    np.testing.assert_allclose(fit.force_residual, 0.2, rtol=0.06)
    np.testing.assert_allclose(fit.torque_residual, 0.01, rtol=0.06)
    found = fit.compensation
    assert found.mass == pytest.approx(TRUTH.mass, abs=0.003)
    assert found.centre_of_mass == pytest.approx(TRUTH.centre_of_mass, abs=2e-4)
    assert found.force_bias == pytest.approx(TRUTH.force_bias, abs=0.02)
    assert found.torque_bias == pytest.approx(TRUTH.torque_bias, abs=1e-3)


@pytest.mark.parametrize(
    "few",
    [
        np.tile([0.0, 0.0, -9.81], (50, 1)),  # never turned
        gravities(2),  # two poses
        np.repeat(gravities(2), 100, axis=0),  # two poses, each held for long
        around(np.array([1.0, 0.0, 0.0]), np.linspace(0.0, 0.3, 50)),  # 17 degrees about one axis
        np.zeros((10, 3)),  # no gravity at all
        np.empty((0, 3)),
    ],
)
def test_poses_that_do_not_turn_enough_are_refused(few: FloatArray) -> None:
    with pytest.raises(ConfigurationError, match="turn the sensor further"):
        fit_compensation(*poses(few) if len(few) else (few, few, few))


def test_a_reversed_sign_is_named() -> None:
    forces, torques, gravity = poses(gravities())
    with pytest.raises(ConfigurationError, match=r"-1\.25 kg: is the sign of the wrench, or of"):
        fit_compensation(-forces, -torques, gravity)
    with pytest.raises(ConfigurationError, match="is the sign"):
        fit_compensation(forces, torques, -gravity)


def test_arrays_that_do_not_fit_are_refused() -> None:
    forces, torques, gravity = poses(gravities())
    with pytest.raises(ConfigurationError, match=r"gravities have shape \(5, 3\), not \(12, 3\)"):
        fit_compensation(forces, torques, gravity[:5])
    forces[2, 1] = np.nan
    with pytest.raises(ConfigurationError, match="row 2 of the forces is not finite"):
        fit_compensation(forces, torques, gravity)


def test_a_fit_goes_into_a_configuration_as_its_text() -> None:
    fit = fit_compensation(*poses(gravities(), 0.2, 0.01))
    options: dict[str, Any] = {"compensation": yaml.safe_load(fit.compensation.model_dump_json())}
    config = ForceTorqueConfig(sign="on_robot", **options)
    assert config.compensation == fit.compensation


NOISE = np.repeat([0.1, 0.005], 3)
BIAS = np.array([0.6, -0.5, 0.4, 0.02, -0.03, 0.01])


def left_over(
    wrenches: FloatArray, gravity: FloatArray, mass: float = 0.0, touched: bool = False
) -> FloatArray:
    """What samples of 100 Hz read beside what was learned of the bias, shape (n, 6)."""
    estimate, rng = BiasEstimate(NOISE, 0.6), np.random.default_rng(2)
    noisy = wrenches + NOISE * rng.standard_normal(wrenches.shape)
    rows = enumerate(zip(noisy, gravity, strict=True))
    return np.array([estimate.update(n / 100, w, g, mass, touched) for n, (w, g) in rows])


def test_a_bias_is_learned_while_nothing_is_touched() -> None:
    still = np.tile([0.0, 0.0, -9.81], (400, 1))
    found = left_over(np.tile(BIAS, (400, 1)), still)
    assert np.abs(found[200:].mean(axis=0) / NOISE).max() < 0.5
    untold = left_over(np.tile(BIAS, (400, 1)), still, touched=True)
    np.testing.assert_allclose(untold.mean(axis=0), BIAS, atol=0.02)


def test_what_is_not_known_of_a_bias_is_known_better_with_each_sample() -> None:
    estimate, unknown = BiasEstimate(NOISE, 0.6), []
    for stamp in np.arange(200) / 100:
        estimate.update(float(stamp), BIAS, np.zeros(3), 0.0, touched=False)
        unknown.append(estimate.unknown)
    assert unknown[0] == pytest.approx(np.hypot(1.0, 0.6 / NOISE[0]))
    assert (np.diff(unknown) <= 1e-9).all() and 1.0 < unknown[-1] < 1.1


def test_a_contact_is_not_learned_however_long_it_lasts() -> None:
    pressed = np.tile(BIAS, (6000, 1))
    pressed[300:] += (0.0, 0.0, 3.0, 0.1, 0.0, 0.0)
    found = left_over(pressed, np.tile([0.0, 0.0, -9.81], (6000, 1)))
    np.testing.assert_allclose(found[-100:, 2].mean(), 3.0, atol=0.3)


def test_a_bias_that_drifts_is_followed() -> None:
    drift = np.outer(np.arange(12000) / 6000.0, [0.2, 0.0, 0.0, 0.0, 0.01, 0.0])
    found = left_over(BIAS + drift, np.tile([0.0, 0.0, -9.81], (12000, 1)))
    assert np.abs(found[-500:].mean(axis=0) / NOISE).max() < 1.5


def test_a_load_that_is_heavier_than_said_is_learned_as_the_hand_turns() -> None:
    angles = np.linspace(0.0, 4.0 * np.pi, 3000)
    turning = around(np.array([1.0, 0.0, 0.0]), angles)
    heavier = np.hstack([0.05 * 1.5 * turning, np.zeros((3000, 3))])
    found = left_over(BIAS + heavier, turning, mass=1.5)
    assert np.abs(found[1500:, :3]).mean() < 1.2 * NOISE[0]


def test_after_a_long_silence_a_contact_is_none_of_the_bias() -> None:
    estimate, rng = BiasEstimate(NOISE, 0.6), np.random.default_rng(3)
    pressed, left = BIAS + NOISE * (30.0, 0.0, 0.0, 0.0, 0.0, 0.0), np.zeros(6)
    stamps = [*np.arange(0.0, 30.0, 0.01), *np.arange(150.0, 152.0, 0.01)]
    for stamp in stamps:
        wrench = (BIAS if stamp < 100.0 else pressed) + NOISE * rng.standard_normal(6)
        left = estimate.update(float(stamp), wrench, np.zeros(3), 0.0, touched=False)
    assert left[0] == pytest.approx(30.0 * NOISE[0], rel=0.2)
