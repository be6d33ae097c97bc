"""Trials that are made up: an object before the face slides aside, and touches now and then."""

import numpy as np

from contactfusion_lab.learning.dataset import LabelledTrial, Split

MIDDLES = -0.275 + 0.05 * np.arange(12)
"""Of the strips before the face, to the left [m]."""
EMPTY = 0.31


def toy_trial(number: int, split: Split, cycles: int = 60, mountings: int = 2) -> LabelledTrial:
    """Make up a trial; one sensor reads a little more than the other."""
    rng = np.random.default_rng([number, len(split)])
    walk = np.cumsum(rng.normal(0.0, 0.01, cycles))
    lateral = np.clip(rng.uniform(-0.2, 0.2) + walk, -0.25, 0.25)
    width = rng.choice([0.04, 0.12])
    touching = np.cumsum(rng.random(cycles) < 0.1) % 3 != 0
    gap = np.where(touching, 0.0, 0.1)
    reached = np.abs(MIDDLES - lateral[:, None]) < width
    lengths = np.where(reached, gap[:, None], EMPTY)
    noise = rng.normal(0.0, 0.002, (mountings, cycles, 12))
    return LabelledTrial(
        name=f"{split}-{number}",
        split=split,
        round=0,
        mountings=tuple(f"lidar_{row}" for row in range(mountings)),
        stamp=np.linspace(0.0, 0.1 * (cycles - 1), cycles),
        descriptors=np.abs(lengths + noise),
        kind=np.where(touching, 1 if width < 0.1 else 2, 0).astype(np.uint8),
        lateral=np.where(touching, lateral, np.nan),
    )


def toy_trials(training: int, validation: int) -> list[LabelledTrial]:
    return [
        *(toy_trial(number, "training") for number in range(training)),
        *(toy_trial(number, "validation") for number in range(validation)),
    ]
