"""Pushes from outside: somebody shoves the object while the robot pushes it."""

import math

import numpy as np
from pydantic import Field

from contactfusion.model import Model

STREAM = 5
"""Sets their chance apart from that of sensors, which has the same seed."""


class DisturbanceConfig(Model):
    """One shove, level, through the object's middle."""

    start: float = Field(ge=0)
    """When it begins [s]."""
    duration: float = Field(default=0.3, ge=0.01)
    """[s]."""
    force: tuple[float, float]
    """Along x and y of `odom` [N]."""
    height: float = Field(default=0.2, ge=0, le=10)
    """Above the floor [m]."""


class DisturbedConfig(Model):
    """Shoves by chance: when, and which way, is drawn anew for every seed."""

    count: int = Field(ge=1, le=100)
    """How many."""
    force: float = Field(gt=0)
    """Of each, any way [N]."""
    duration: float = Field(default=0.3, ge=0.01)
    """Of each [s]."""
    height: float = Field(default=0.2, ge=0, le=10)
    """Above the floor [m]."""
    before: float = Field(default=20.0, gt=0)
    """They all begin before this [s]."""


def drawn(config: DisturbedConfig, seed: int) -> tuple[DisturbanceConfig, ...]:
    """Draw shoves: their starts are uniform in time, their directions on the circle.

    Args:
        config: how many, and how strong.
        seed: of the push.
    """
    rng = np.random.default_rng([seed, STREAM])
    starts = np.sort(rng.uniform(0.0, config.before, config.count)).tolist()
    angles = rng.uniform(-math.pi, math.pi, config.count).tolist()
    return tuple(
        DisturbanceConfig(
            start=start,
            duration=config.duration,
            force=(config.force * math.cos(angle), config.force * math.sin(angle)),
            height=config.height,
        )
        for start, angle in zip(starts, angles, strict=True)
    )
