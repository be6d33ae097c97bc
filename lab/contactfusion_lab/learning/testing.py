"""How well networks do when they drive, beside the rule by hand (method §8)."""

import math
from pathlib import Path

from contactfusion_lab.experiments.push.experiment import Options, run_push
from contactfusion_lab.experiments.push.outcomes import outcome
from contactfusion_lab.experiments.push.tables import perception
from contactfusion_lab.experiments.push.trial import load
from contactfusion_lab.learning.lessons import MOUNTINGS

SEED = 7_000_000
"""Of the experiments, besides the seed of the training."""
SENSINGS = ("lidar", "rule")


def tested(weights: Path, count: int, seed: int, workers: int, out: Path) -> dict[str, float]:
    """Let networks push to random targets from random starts, and the rule likewise.

    Args:
        weights: of the networks.
        count: how many pushes from each mounting.
        seed: of the training.
        workers: how many processes.
        out: takes a folder of `experiment push` for each mounting.

    Returns:
        Figures by names that begin with the mounting and what perceives.
    """
    figures: dict[str, float] = {}
    for mounting in MOUNTINGS:
        folder = out / mounting
        options = Options(
            sensings=SENSINGS, lidar=mounting, weights=weights, targets=f"random:{count}",
            starts="random", seed=SEED + seed, workers=workers,
        )  # fmt: skip
        run_push(options, folder)
        for sensing in SENSINGS:
            tracks = [load(path) for path in sorted((folder / "trials" / sensing).rglob("*.npz"))]
            found, outcomes = perception(tracks, seed), [outcome(one) for one in tracks]
            name = f"{mounting}_{sensing}"
            figures |= {
                f"{name}_success_true": sum(one.success_true for one in outcomes) / len(outcomes),
                f"{name}_location_rmse_m": found.location_rmse[0],
                f"{name}_type_accuracy": found.type_accuracy[0],
                f"{name}_contact_accuracy": found.contact_accuracy[0],
            }
    # nothing was located, perhaps
    return {name: value for name, value in figures.items() if math.isfinite(value)}
