"""Load and bias of a force-torque sensor: mass, centre of mass, and offsets."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray, frozen_array
from contactfusion.errors import ConfigurationError
from contactfusion.model import Model
from contactfusion.units import ForceBias, Load, Offset, TorqueBias

SHARE = 0.05
"""Standard deviation of the mass of a load, as a share of it."""
FORGETS = 30.0
"""Time over which an estimated bias follows one that drifts [s]."""
CORRELATED = 0.3
"""Time over which deviations hang together, such as those of a hand that shakes [s]."""
UNLIKELY = 60.0
"""A larger square of a deviation of six axes, in standard deviations, is a contact."""
LEAST_SPAN = 0.05
"""The least spread of gravity's directions about a line: root mean square, per length."""


class Compensation(Model):
    """The wrench that a sensor measures without any contact, in its own frame.

    A load of mass m at c under gravity g gives f = m g + b_f and τ = c × m g + b_τ, where f is the
    force that the world exerts on the robot, whatever the sign of the sensor.
    """

    mass: Load = Field(default=0.0, ge=0)
    """Mass of the load [kg]."""
    centre_of_mass: Offset = (0.0, 0.0, 0.0)
    """Centre of mass of the load, in the sensor's frame [m]."""
    force_bias: tuple[ForceBias, ForceBias, ForceBias] = (0.0, 0.0, 0.0)
    """Offset of the force, in the sensor's frame [N]."""
    torque_bias: tuple[TorqueBias, TorqueBias, TorqueBias] = (0.0, 0.0, 0.0)
    """Offset of the torque, in the sensor's frame [N·m]."""

    def contactless(self, gravity: FloatArray) -> FloatArray:
        """The wrench (f, τ) without contact, shape (6,) [N, N·m].

        Args:
            gravity: shape (3,) [m/s²], in the sensor's frame.
        """
        weight = self.mass * gravity
        (x, y, z), (a, b, c) = self.centre_of_mass, weight.tolist()
        torque = np.array([y * c - z * b, z * a - x * c, x * b - y * a])
        return np.concatenate([weight + self.force_bias, torque + self.torque_bias])


class BiasEstimate:
    """What is left of bias and load after compensation, learned while nothing is touched.

    Each axis reads b + a · g: a bias, and a part of gravity, for the load may be heavier than said,
    and one axis reads a share of another. It is a Kalman filter of these four by axis. What
    deviates by more than noise does is a contact, and is not learned; what the filter does not
    know yet is noise.

    Args:
        deviations: shape (6,), of one sample by axis [N, N·m].
        bias: standard deviation of the force's bias [N]; the torque's is as many deviations.
    """

    def __init__(self, deviations: FloatArray, bias: float) -> None:
        self._deviations = deviations
        prior = np.array([bias, SHARE, SHARE, SHARE]) / deviations[0]
        self._learned, self._unsure = np.zeros((6, 4)), np.diag(prior**2)
        self._stamp: float | None = None
        self.unknown = 1.0
        """Standard deviation of what a sample reads without contact, in those of noise alone."""

    def update(
        self, stamp: float, wrench: FloatArray, gravity: FloatArray, mass: float, touched: bool
    ) -> FloatArray:
        """What a sample reads beside bias and load, shape (6,) [N, N·m].

        Args:
            stamp: of the sample [s].
            wrench: shape (6,), compensated [N, N·m].
            gravity: shape (3,) [m/s²], in the sensor's frame.
            mass: of the load [kg].
            touched: whether other sources have evidence of a contact, so that nothing is learned.
        """
        elapsed = 0.0 if self._stamp is None else max(stamp - self._stamp, 0.0)
        self._stamp = stamp
        samples = min(elapsed / CORRELATED, 1.0)  # as many are independent
        if samples:  # so much that the gain of the bias comes to rest at elapsed / FORGETS
            self._unsure[0, 0] += elapsed * min(elapsed, CORRELATED) / FORGETS**2 / samples
        weight = np.array([1.0, *(mass * gravity)])
        reach = self._unsure @ weight
        unknown = float(weight @ reach)
        surprise = wrench / self._deviations - self._learned @ weight
        is_contact = surprise @ surprise > UNLIKELY * (1.0 + unknown)
        if samples and not touched and not is_contact:
            variance = 1.0 / samples + unknown
            self._learned += np.outer(surprise, reach / variance)
            self._unsure -= np.outer(reach, reach) / variance
        self.unknown = float(np.sqrt(1.0 + weight @ self._unsure @ weight))
        return np.asarray(wrench - self._deviations * (self._learned @ weight))


@dataclass(frozen=True, eq=False)
class CompensationFit:
    """A compensation with its residuals over the poses of the fit.

    Attributes:
        compensation: mass, centre of mass and bias.
        force_residual: shape (3,) [N], root mean square by axis: the noise that is left.
        torque_residual: shape (3,) [N·m], root mean square by axis.
    """

    compensation: Compensation
    force_residual: FloatArray
    torque_residual: FloatArray


def fit_compensation(
    forces: FloatArray, torques: FloatArray, gravities: FloatArray
) -> CompensationFit:
    """Fit mass, centre of mass and bias by least squares over poses without contact.

    Args:
        forces: shape (n, 3) [N], on the robot, in the sensor's frame; those of a sensor that
            measures the force by the robot must be negated first.
        torques: shape (n, 3) [N·m], likewise.
        gravities: shape (n, 3) [m/s²], gravity in the sensor's frame at each pose.

    Raises:
        ConfigurationError: the arrays do not match, the poses do not separate weight and bias, or
            the mass comes out negative.
    """
    n, error = len(forces), ConfigurationError
    forces = frozen_array(forces, (n, 3), "forces", error)
    torques = frozen_array(torques, (n, 3), "torques", error)
    gravities = frozen_array(gravities, (n, 3), "gravities", error)
    span = _span(gravities) if n >= 3 else 0.0
    if span < LEAST_SPAN:
        raise ConfigurationError(
            f"{n} poses whose gravity leaves a line by {span:.3f} of its length do not separate "
            "weight and bias; turn the sensor further"
        )
    identity = np.tile(np.eye(3), (n, 1))
    by_mass = np.hstack([gravities.reshape(-1, 1), identity])
    mass, *force_bias = np.linalg.lstsq(by_mass, forces.ravel(), rcond=None)[0]
    moments = np.hstack([-_cross_matrices(gravities).reshape(-1, 3), identity])
    solution = np.linalg.lstsq(moments, torques.ravel(), rcond=None)[0]
    if mass <= 0.0:
        raise ConfigurationError(
            f"the fitted mass is {mass:.4g} kg: is the sign of the wrench, or of gravity, reversed?"
        )
    compensation = Compensation(
        mass=mass,
        centre_of_mass=tuple(solution[:3] / mass),
        force_bias=tuple(force_bias),
        torque_bias=tuple(solution[3:]),
    )
    expected = np.array([compensation.contactless(gravity) for gravity in gravities])
    return CompensationFit(
        compensation,
        np.sqrt(((forces - expected[:, :3]) ** 2).mean(axis=0)),
        np.sqrt(((torques - expected[:, 3:]) ** 2).mean(axis=0)),
    )


def _span(gravities: FloatArray) -> float:
    """Distance of the vectors from one line, as a fraction of their length."""
    across = np.linalg.svd(gravities - gravities.mean(axis=0), compute_uv=False)[1]
    length = np.sqrt(np.square(gravities).sum())
    return float(across / length) if length else 0.0


def _cross_matrices(vectors: FloatArray) -> FloatArray:
    """The matrices that multiply by v ×, shape (n, 3, 3)."""
    return np.cross(vectors[:, None, :], np.eye(3)).transpose(0, 2, 1)
