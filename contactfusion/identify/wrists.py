"""Load and bias of a wrist's sensor from the poses in which the robot rested.

A wrench sensor at rest measures the weight of its load. Of both signs only one gives a positive
mass, so gravity decides whether the sensor measures the force on the robot or by it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.generators.compensation import Compensation, CompensationFit, fit_compensation
from contactfusion.readings import Wrench

STILL = 0.01
"""Joints that move by less are at rest [rad, m]."""
LASTING = 0.2
"""The least duration of a rest, or distance in time of a single sample from its neighbours [s]."""
LEAST_POSES = 3
LEFT_OVER = 0.2
"""The greatest share of the weight that a fit may leave unexplained."""
SIGNS = {"on_robot": 1.0, "by_robot": -1.0}


@dataclass(frozen=True, eq=False)
class Sample:
    """A wrench, with the joints' positions at its stamp.

    Attributes:
        reading: the wrench.
        positions: shape (n,), of the model's joints [rad, m].
    """

    reading: Wrench
    positions: FloatArray


class Rest(NamedTuple):
    """A pose at which the robot rested.

    Attributes:
        positions: shape (n,), of the joints [rad, m].
        wrenches: shape (m, 6) [N, N·m], of its samples as they are measured.
        first: its first sample, as a row.
    """

    positions: FloatArray
    wrenches: FloatArray
    first: int

    @property
    def wrench(self) -> FloatArray:
        """The mean wrench, shape (6,) [N, N·m]."""
        return np.asarray(self.wrenches.mean(axis=0))


def resting(samples: Sequence[Sample]) -> list[Rest]:
    """The poses at which the robot rested.

    A log may be dense, or have one row a pose: a rest is defined by how long the joints stay, or
    by the distance in time of a pose from its neighbours.
    """
    groups: list[list[Sample]] = []
    for sample in samples:
        if groups and np.abs(sample.positions - groups[-1][0].positions).max(initial=0.0) < STILL:
            groups[-1].append(sample)
        else:
            groups.append([sample])
    rests, row = [], 0
    for number, group in enumerate(groups):
        first, last = group[0].reading.stamp, group[-1].reading.stamp
        spans = [last - first]
        if number > 0:
            spans.append(first - groups[number - 1][-1].reading.stamp)
        if number + 1 < len(groups):
            spans.append(groups[number + 1][0].reading.stamp - last)
        if max(spans) >= LASTING:
            readings = (sample.reading for sample in group)
            wrenches = np.array([np.hstack([wrench.force, wrench.torque]) for wrench in readings])
            rests.append(Rest(group[0].positions, wrenches, row))
        row += len(group)
    return rests


@dataclass(frozen=True, eq=False)
class Weighed:
    """The load and the bias of a wrist.

    Attributes:
        sign: of the sensor, as gravity shows it.
        fit: of the wrenches on the robot, whatever the sign.
        errors: standard errors by leaving out each pose once, for each field of the compensation;
            NaN where the others do not suffice.
        noise: standard deviation of a sample by axis, shape (6,) [N, N·m].
        poses: the number of poses.
    """

    sign: str
    fit: CompensationFit
    errors: dict[str, FloatArray]
    noise: FloatArray
    poses: int


def weighed(rests: Sequence[Rest], gravities: FloatArray) -> Weighed:
    """Fit the load of a wrist, with the sign that gives a positive mass.

    Args:
        rests: the poses at which the robot rested.
        gravities: shape (n, 3) [m/s²], gravity in the sensor's frame at each pose.

    Raises:
        ConfigurationError: the poses do not separate weight and bias, or neither sign explains the
            wrenches.
    """
    if len(rests) < LEAST_POSES:
        raise ConfigurationError(
            f"rested in {len(rests)} poses; {LEAST_POSES} that are turned far from each other tell "
            "weight and bias apart"
        )
    wrenches = np.array([rest.wrench for rest in rests])
    fits: dict[str, CompensationFit] = {}
    why = ""
    for sign, factor in SIGNS.items():
        try:
            fits[sign] = _fit(factor * wrenches, gravities)
        except ConfigurationError as error:  # of the two signs one gives a negative mass
            why = error.problem
    if not fits:
        raise ConfigurationError(why)
    ((sign, fit),) = fits.items()
    weight = fit.compensation.mass * 9.81
    left = float(np.linalg.norm(fit.force_residual))
    if left > LEFT_OVER * weight:
        raise ConfigurationError(
            f"neither sign explains its wrenches, as {left:.2f} N are left over beside a "
            f"weight of {weight:.2f} N: is its frame turned, or did something touch?"
        )
    off = [
        SIGNS[sign] * rest.wrenches - fit.compensation.contactless(gravity)
        for rest, gravity in zip(rests, gravities, strict=True)
    ]
    noise = np.sqrt(np.square(np.concatenate(off)).mean(axis=0))
    errors = _errors(SIGNS[sign] * wrenches, gravities)
    return Weighed(sign, fit, errors, noise, len(rests))


def unloaded(rests: Sequence[Rest], sign: str) -> Weighed:
    """The bias of a wrist whose driver takes its load off, as the mean over rests.

    Args:
        rests: the poses at which the robot rested.
        sign: of the sensor.

    Raises:
        ConfigurationError: there are fewer than two rests.
    """
    if len(rests) < 2:
        raise ConfigurationError(f"rested in {len(rests)} poses; its bias takes two or more")
    wrenches = SIGNS[sign] * np.array([rest.wrench for rest in rests])
    mean, off = wrenches.mean(axis=0), wrenches.std(axis=0, ddof=1)
    (a, b, c), (d, e, f) = mean[:3].tolist(), mean[3:].tolist()
    bias = Compensation(force_bias=(a, b, c), torque_bias=(d, e, f))
    samples = SIGNS[sign] * np.concatenate([rest.wrenches for rest in rests]) - mean
    errors = off / np.sqrt(len(rests))
    return Weighed(
        sign,
        CompensationFit(bias, off[:3], off[3:]),
        {"force_bias": errors[:3], "torque_bias": errors[3:]},
        np.asarray(np.sqrt(np.square(samples).mean(axis=0))),
        len(rests),
    )


def _fit(wrenches: FloatArray, gravities: FloatArray) -> CompensationFit:
    return fit_compensation(wrenches[:, :3], wrenches[:, 3:], gravities)


def _errors(wrenches: FloatArray, gravities: FloatArray) -> dict[str, FloatArray]:
    """Standard errors of a compensation by the jackknife (Efron & Stein 1981)."""
    count, names = len(wrenches), tuple(Compensation.model_fields)
    try:
        left_out = [
            _fit(np.delete(wrenches, row, 0), np.delete(gravities, row, 0)).compensation
            for row in range(count)
        ]
    except ConfigurationError:
        return {name: np.full(1 if name == "mass" else 3, np.nan) for name in names}
    errors = {}
    for name in names:
        values = np.array([np.atleast_1d(getattr(fit, name)) for fit in left_out])
        errors[name] = np.sqrt((count - 1) * values.var(axis=0))
    return errors
