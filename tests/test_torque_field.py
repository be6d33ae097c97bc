"""Kernels: one contact at each point of the surface, as an explanation of joint torques."""

from typing import Any, cast

import numpy as np
import pytest
from scipy.optimize import minimize

from contactfusion.arrays import FloatArray
from contactfusion.generators.torque_field import explained


def field(
    points: FloatArray, normals: FloatArray, torques: FloatArray, friction: float = 0.5,
    strength: float = 50.0, sigma: float = 0.1, axes: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    linear, angular = axes or AXES
    count = len(points)
    gains, evidence, forces = np.empty(count), np.empty(count), np.empty((count, 3))
    explained(
        points, normals, np.ones((count, len(torques)), np.bool_), linear, angular, torques,
        np.full(len(torques), sigma**-2), 1.0 / np.hypot(1.0, friction), strength**-2,
        gains, evidence, forces,
    )  # fmt: skip
    return gains, evidence, forces


RNG = np.random.default_rng(3)
ORIGINS = np.array([(0.1 * k, 0.05 * (-1) ** k, 0.2 * k) for k in range(6)])
TURNS = RNG.standard_normal((6, 3))
TURNS /= np.linalg.norm(TURNS, axis=1, keepdims=True)
AXES = (np.cross(ORIGINS, TURNS), TURNS)
"""Six revolute joints: a point at p moves by turn × (p - origin)."""


def loads_of(point: FloatArray, force: FloatArray) -> FloatArray:
    """The torques of a force at a point."""
    return np.asarray((AXES[0] + np.cross(AXES[1], point)) @ force)


def by_search(point: FloatArray, normal: FloatArray, torques: FloatArray, friction: float) -> float:
    """What the best force in the cone explains, by a general solver."""
    arms = AXES[0] + np.cross(AXES[1], point)

    def cost(force: FloatArray) -> float:
        left = (torques - arms @ force) / 0.1
        return float(left @ left + force @ force / 50.0**2)

    def inside(force: FloatArray) -> float:
        pushes = -float(force @ normal)
        return friction * pushes - float(np.sqrt(np.sum((force + pushes * normal) ** 2) + 1e-12))

    starts = [-normal * size for size in (0.1, 5.0, 30.0)]
    bounds, solve = {"type": "ineq", "fun": inside}, cast("Any", minimize)
    found = [solve(cost, start, constraints=[bounds], method="SLSQP") for start in starts]
    fit = [float(each.fun) for each in found if inside(each.x) > -1e-6]
    costs = [cost(np.zeros(3)), *fit]
    return 0.5 * (costs[0] - min(costs))


@pytest.mark.parametrize("friction", [0.1, 0.5, 2.0])
def test_the_best_force_in_the_cone_is_found(friction: float) -> None:
    rng = np.random.default_rng(5)
    for _ in range(25):
        point, normal = rng.uniform(-0.3, 0.6, 3), rng.standard_normal(3)
        normal /= np.linalg.norm(normal)
        torques = loads_of(point, rng.standard_normal(3) * 10.0) + 0.1 * rng.standard_normal(6)
        gains, _, forces = field(point[None], normal[None], torques, friction)
        expected = by_search(point, normal, torques, friction)
        assert gains[0] == pytest.approx(expected, rel=2e-3, abs=0.02)
        pushes = -float(forces[0] @ normal)
        along = np.linalg.norm(forces[0] + pushes * normal)
        assert pushes >= -1e-9 and along <= friction * pushes * (1.0 + 1e-6) + 1e-9


def test_the_point_that_was_pushed_explains_most() -> None:
    rng = np.random.default_rng(6)
    points, normals = rng.uniform(-0.3, 0.6, (500, 3)), rng.standard_normal((500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    torques = loads_of(points[77], -12.0 * normals[77])
    gains, _, forces = field(points, normals, torques)
    assert gains.argmax() == 77
    np.testing.assert_allclose(forces[77], -12.0 * normals[77], rtol=0.02)


def test_without_torques_no_contact_is_more_likely_than_any() -> None:
    gains, evidence, _ = field(ORIGINS, TURNS, np.zeros(6))
    assert (gains == 0.0).all() and (evidence < -3.0).all()


def test_joints_beyond_a_point_tell_against_it() -> None:
    point, normal = ORIGINS[3:4] + 0.1, TURNS[3:4]
    torques = loads_of(point[0], -10.0 * normal[0])
    loads = np.ones((1, 6), np.bool_)
    loads[0, 4:] = False
    given = (point, normal, loads, *AXES, torques, np.full(6, 100.0), 0.9, 1e-3)
    out = np.empty(1), np.empty(1), np.empty((1, 3))
    explained(*given, *out)
    whole = field(point, normal, torques)[0]
    assert out[0][0] < whole[0] - 1.0
