"""Kernels: how well one contact at each point of the surface explains the torques of all joints.

A force f at a point x loads joint j with a_j(x) · f. The best force pushes into the surface within
its cone of friction; Gaussian noise of the torques, and a weak prior of the force, make this a
quadratic program in three unknowns, solved in closed form inside the cone and by angle on its edge
(after Manuelli & Tedrake 2016, with one contact and no time).
"""

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.jit import kernel

ANGLES, HALVINGS = 16, 5
"""Directions on the edge of the cone that are tried, and refinements of the best of them."""
COSINES, SINES = (turn(2.0 * np.pi * np.arange(ANGLES) / ANGLES) for turn in (np.cos, np.sin))


@kernel
def _products(
    point: FloatArray,
    joints: NDArray[np.bool_],
    linear: FloatArray,
    angular: FloatArray,
    torques: FloatArray,
    precisions: FloatArray,
    prior: float,
    square: FloatArray,
    given: FloatArray,
) -> None:
    """Write Σ a aᵀ/σ² + prior, shape (3, 3), and Σ τ a/σ², shape (3,), of a point."""
    square[:], given[:] = 0.0, 0.0
    for axis in range(3):
        square[axis, axis] = prior
    arm = np.empty(3)
    for joint in range(len(torques)):
        if not joints[joint] or precisions[joint] == 0.0:
            continue
        turn = angular[joint]
        arm[0] = linear[joint, 0] + turn[1] * point[2] - turn[2] * point[1]
        arm[1] = linear[joint, 1] + turn[2] * point[0] - turn[0] * point[2]
        arm[2] = linear[joint, 2] + turn[0] * point[1] - turn[1] * point[0]
        for row in range(3):
            given[row] += precisions[joint] * torques[joint] * arm[row]
            for column in range(3):
                square[row, column] += precisions[joint] * arm[row] * arm[column]


@kernel
def _solved(square: FloatArray, given: FloatArray, force: FloatArray) -> float:
    """Write the solution of square · force = given; the determinant. Square is symmetric."""
    a = square[1, 1] * square[2, 2] - square[1, 2] ** 2
    b = square[0, 2] * square[1, 2] - square[0, 1] * square[2, 2]
    c = square[0, 1] * square[1, 2] - square[0, 2] * square[1, 1]
    determinant = square[0, 0] * a + square[0, 1] * b + square[0, 2] * c
    d = square[0, 0] * square[2, 2] - square[0, 2] ** 2
    e = square[0, 1] * square[0, 2] - square[0, 0] * square[1, 2]
    f = square[0, 0] * square[1, 1] - square[0, 1] ** 2
    force[0] = (a * given[0] + b * given[1] + c * given[2]) / determinant
    force[1] = (b * given[0] + d * given[1] + e * given[2]) / determinant
    force[2] = (c * given[0] + e * given[1] + f * given[2]) / determinant
    return float(determinant)


@kernel
def _on_edge(
    square: FloatArray, given: FloatArray, inward: FloatArray, cosine: float, force: FloatArray
) -> float:
    """Write the best force on the edge of the cone of friction; what it explains.

    In axes along the normal and across it, what a force at an angle about the normal explains is a
    quotient of trigonometric polynomials: its size follows from the angle.
    """
    axes, turned, sums = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    least = 0
    for axis in range(3):
        if abs(inward[axis]) < abs(inward[least]):
            least = axis
    length = np.sqrt(1.0 - inward[least] ** 2)
    for axis in range(3):
        axes[0, axis] = inward[axis]
        axes[1, axis] = ((axis == least) - inward[least] * inward[axis]) / length
    axes[2, 0] = inward[1] * axes[1, 2] - inward[2] * axes[1, 1]
    axes[2, 1] = inward[2] * axes[1, 0] - inward[0] * axes[1, 2]
    axes[2, 2] = inward[0] * axes[1, 1] - inward[1] * axes[1, 0]
    for row in range(3):
        sums[row] = 0.0
        for axis in range(3):
            sums[row] += given[axis] * axes[row, axis]
        for column in range(row, 3):
            turned[row, column] = 0.0
            for first in range(3):
                for second in range(3):
                    turned[row, column] += (
                        axes[row, first] * square[first, second] * axes[column, second]
                    )
    sine = np.sqrt(1.0 - cosine**2)
    step, best, at, size = 2.0 * np.pi / ANGLES, 0.0, 0.0, 0.0
    for trial in range(ANGLES + 2 * HALVINGS):
        if trial < ANGLES:
            u, v, angle = COSINES[trial], SINES[trial], trial * step
        else:
            step *= 0.5 if (trial - ANGLES) % 2 == 0 else 1.0
            angle = at + (step if (trial - ANGLES) % 2 == 0 else -step)
            u, v = np.cos(angle), np.sin(angle)
        u, v = sine * u, sine * v
        explained = cosine * sums[0] + u * sums[1] + v * sums[2]
        if explained <= 0.0:
            continue
        costs = cosine * cosine * turned[0, 0] + u * u * turned[1, 1] + v * v * turned[2, 2]
        costs += 2.0 * (cosine * (u * turned[0, 1] + v * turned[0, 2]) + u * v * turned[1, 2])
        if explained * explained > best * costs:
            best, at, size = explained * explained / costs, angle, explained / costs
    u, v = sine * np.cos(at), sine * np.sin(at)
    for axis in range(3):
        force[axis] = size * (cosine * axes[0, axis] + u * axes[1, axis] + v * axes[2, axis])
    return best


@kernel
def explained(
    points: FloatArray,
    normals: FloatArray,
    loads: NDArray[np.bool_],
    linear: FloatArray,
    angular: FloatArray,
    torques: FloatArray,
    precisions: FloatArray,
    cosine: float,
    prior: float,
    gains: FloatArray,
    evidence: FloatArray,
    forces: FloatArray,
) -> None:
    """By how much a contact at each point explains torques better than none, and its force.

    Args:
        points: shape (m, 3) [m], in the frame of the joints' axes.
        normals: shape (m, 3), unit vectors out of the robot.
        loads: shape (m, n), which joints a force there loads.
        linear: shape (n, 3), how each joint moves a point at the origin.
        angular: shape (n, 3), likewise its rotation.
        torques: shape (n,) [N·m, N].
        precisions: shape (n,), one over their variances; 0: unknown.
        cosine: of the angle between normal and edge of the cone of friction.
        prior: one over the variance of a force, by axis [1/N²].
        gains: shape (m,), is overwritten: half of what χ² falls by.
        evidence: shape (m,), is overwritten: the logarithm of the likelihood ratio to no contact
            when the force is unknown.
        forces: shape (m, 3) [N], is overwritten: the likeliest force on the robot.
    """
    square, given, force, inward = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    for row in range(len(points)):
        _products(
            points[row], loads[row], linear, angular, torques, precisions, prior, square, given
        )
        determinant = _solved(square, given, force)
        pushes, size, best = 0.0, 0.0, 0.0
        for axis in range(3):
            inward[axis] = -normals[row, axis]
            pushes += force[axis] * inward[axis]
            size += force[axis] ** 2
            best += given[axis] * force[axis]
        if pushes < cosine * np.sqrt(size):
            best = _on_edge(square, given, inward, cosine, force)
        gains[row] = 0.5 * best
        evidence[row] = 0.5 * (best + 3.0 * np.log(prior) - np.log(determinant))
        forces[row] = force
