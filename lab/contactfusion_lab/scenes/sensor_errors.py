"""Errors of sensors beside zeros and white noise: of wrists, taxels, ranges, and of arrival."""

import math
from collections.abc import Iterable
from typing import final

import numpy as np
from pydantic import Field, field_validator
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.spatial.distance import cdist

from contactfusion.arrays import FloatArray
from contactfusion.model import Model
from contactfusion.readings import (
    DepthImage,
    JointState,
    Odometry,
    PointCloud,
    Reading,
    TactileImage,
    Twist,
    Wrench,
)
from contactfusion_lab.scenes.ranges import AnyRange, Range

RECOVERY = 1.0
"""Time constant with which a taxel forgets a pressure [s]."""
ADJACENT = 1.5
"""Taxels within so many pitches are neighbours."""
STEP = 0.05
"""Step in depth beyond which a pixel may lie between two surfaces [m]."""


class TaxelNoise(Model):
    """Errors of taxels beside white noise; gains and dead taxels are drawn once a run."""

    gain: float = Field(default=0.0, ge=0, le=1)
    """Standard deviation of the logarithm of the gain, from taxel to taxel."""
    hysteresis: float = Field(default=0.0, ge=0, le=1)
    """Share of the greatest pressure that a taxel still reads when it has gone; it is forgotten
    with a time constant of 1 s."""
    crosstalk: float = Field(default=0.0, ge=0, le=1)
    """Share of the pressure of each neighbour that a taxel reads, too."""
    dead: int = Field(default=0, ge=0)
    """Number of taxels of each skin that always read 0."""


class RangeNoise(Model):
    """Errors of ranges beside white noise; the bias is drawn once a run."""

    bias: float = Field(default=0.0, ge=0, le=0.2)
    """Standard deviation of the scale error of all ranges of a sensor, as a share."""
    mixed: float = Field(default=0.0, ge=0, le=1)
    """Share of the measurements beside a step in depth that lie between both surfaces (mixed
    pixels)."""


class Delays(Model):
    """Times from measurement to arrival: each is drawn, uniformly, from a range [s]."""

    joints: AnyRange = (0.0, 0.0)
    """Of joint states, odometry and twists."""
    skins: AnyRange = (0.0, 0.0)
    """Of tactile images."""
    wrenches: AnyRange = (0.0, 0.0)
    """Of wrenches."""
    sights: AnyRange = (0.0, 0.0)
    """Of depth images and point clouds."""

    @field_validator("*")
    @classmethod
    def _late(cls, value: Range) -> Range:
        if value[0] < 0.0:
            raise ValueError("no reading arrives before it is measured: give times of at least 0")
        return value

    def of(self, reading: Reading) -> tuple[float, float]:
        """The range of a reading's delay [s]; none for kinds that are not measured."""
        kinds = {
            (JointState, Odometry, Twist): self.joints,
            (TactileImage,): self.skins,
            (Wrench,): self.wrenches,
            (DepthImage, PointCloud): self.sights,
        }
        return next(
            (delay for kind, delay in kinds.items() if isinstance(reading, kind)), (0.0, 0.0)
        )


@final
class WristErrors:
    """The errors of a force-torque sensor beside its zero.

    Args:
        drift: shape (6,), standard deviation of the rate of its zero [N/min, N·m/min].
        crosstalk: that of the share of each component of force in the others, and of each of
            torque.
        payload: that of the error of the mass that it carries, as a share of it.
        rng: draws all of them.
    """

    def __init__(
        self, drift: FloatArray, crosstalk: float, payload: float, rng: np.random.Generator
    ) -> None:
        self._drift = drift * rng.standard_normal(6)
        within = np.kron(np.eye(2), 1.0 - np.eye(3))
        self._mixing = np.eye(6) + crosstalk * within * rng.standard_normal((6, 6))
        self._payload = payload * rng.standard_normal()

    def read(self, stamp: float, wrench: FloatArray, weight: FloatArray) -> FloatArray:
        """What the sensor reads.

        Args:
            stamp: since its zero was right [s].
            wrench: the true one, shape (6,) [N, N·m].
            weight: its part that is the weight of what the sensor is believed to carry.

        Returns:
            Shape (6,) [N, N·m].
        """
        values: FloatArray = self._mixing @ (wrench + self._payload * weight)
        return values + stamp / 60.0 * self._drift


@final
class TaxelErrors:
    """The errors of the taxels of a skin.

    Args:
        centres: shape (n, 3), of the taxels [m].
        noise: the size of the errors.
        rng: draws gains and dead taxels.
    """

    def __init__(self, centres: FloatArray, noise: TaxelNoise, rng: np.random.Generator) -> None:
        count, self._hysteresis = len(centres), noise.hysteresis
        gains = np.exp(noise.gain * rng.standard_normal(count))
        gains[rng.permutation(count)[: noise.dead]] = 0.0
        mixing = np.eye(count)
        if noise.crosstalk and count > 1:
            apart = cdist(centres, centres) + np.diag(np.full(count, np.inf))
            mixing[apart < ADJACENT * apart.min()] = noise.crosstalk
        self._response = gains[:, None] * mixing
        self._remembered, self._stamp = np.zeros(count), 0.0

    def read(self, stamp: float, pressures: FloatArray) -> FloatArray:
        """What the taxels read of true values at a stamp [s]; both of shape (n,)."""
        elapsed, self._stamp = stamp - self._stamp, stamp
        forgotten = self._remembered * math.exp(-elapsed / RECOVERY)
        self._remembered = np.maximum(pressures, forgotten)
        lagging = pressures + self._hysteresis * (self._remembered - pressures)
        values: FloatArray = self._response @ lagging
        return values


@final
class RangeErrors:
    """The errors of the ranges of a sensor.

    Args:
        noise: the size of the errors.
        rng: draws the bias, and which measurements are mixed.
    """

    def __init__(self, noise: RangeNoise, rng: np.random.Generator) -> None:
        self._scale = 1.0 + noise.bias * rng.standard_normal()
        self._mixed, self._rng = noise.mixed, rng

    def read(self, ranges: FloatArray) -> FloatArray:
        """What is measured of true ranges of shape (h, w) [m]; where nothing is hit, 0 or inf."""
        hit = (ranges > 0.0) & np.isfinite(ranges)
        measured = np.where(hit, ranges * self._scale, ranges)
        if self._mixed:
            near = minimum_filter(np.where(hit, measured, np.inf), 3)
            far = maximum_filter(np.where(hit, measured, -np.inf), 3)
            rows = hit & (far - near > STEP) & (self._rng.random(ranges.shape) < self._mixed)
            part = self._rng.random(np.count_nonzero(rows))
            measured[rows] = near[rows] + part * (far[rows] - near[rows])
        return measured


@final
class Arrivals:
    """Readings on their way: they arrive late, those of each sensor in their order.

    Args:
        delays: of each kind of reading.
        rng: draws each delay.
    """

    def __init__(self, delays: Delays, rng: np.random.Generator) -> None:
        self._delays, self._rng = delays, rng
        self._waiting = list[tuple[float, Reading]]()
        self._last: dict[tuple[type[Reading], str], float] = {}

    def until(self, now: float, readings: Iterable[Reading]) -> list[Reading]:
        """The readings that arrive until now [s], in their order.

        Args:
            now: the stamp [s].
            readings: those measured since the last call.
        """
        for reading in readings:
            sensor = type(reading), reading.sensor
            due = reading.stamp + self._rng.uniform(*self._delays.of(reading))
            self._last[sensor] = due = max(due, self._last.get(sensor, 0.0))
            self._waiting.append((due, reading))
        self._waiting.sort(key=lambda each: each[0])
        count = sum(due <= now for due, _ in self._waiting)
        arrived, self._waiting = self._waiting[:count], self._waiting[count:]
        return [reading for _, reading in arrived]
