"""Do true contacts lie within the spreads that generators state?"""

from collections.abc import Sequence

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.pipeline_config import PipelineConfig
from contactfusion_lab.experiments.measures import Measure, proportion
from contactfusion_lab.experiments.touch.rows import modality_of
from contactfusion_lab.experiments.touch.trial import Trial

LEVELS = (0.68, 0.95)
"""So many true contacts should lie within."""
DRAWN = 1000
"""So many places are drawn from what a cloud states."""
LEAST = 1e-3
"""A place is not known better than to this [m]; keeps a spread of 0 from being a certainty."""


def level_of(cloud: HypothesisCloud, place: FloatArray, rng: np.random.Generator) -> float:
    """Tell how far out a place lies in what a cloud states: 0 in its midst, 1 beyond all of it.

    The cloud is read as a mixture of Gaussians, one a hypothesis, weighted by likelihood, as wide
    as its spread; the level is the part of the mixture that is denser than the place. Levels of
    true contacts are uniform when spreads are honest.

    Args:
        cloud: what a source said; not empty, with spreads.
        place: shape (3,) [m], where the contact was.
        rng: draws from the mixture.
    """
    assert cloud.spreads is not None
    weights = cloud.likelihoods / cloud.likelihoods.sum()
    spreads = np.maximum(cloud.spreads, LEAST)
    rows = rng.choice(len(weights), size=DRAWN, p=weights)
    drawn = cloud.positions[rows] + spreads[rows, None] * rng.standard_normal((DRAWN, 3))
    places = np.concatenate([place[None], drawn])
    densities = np.empty(len(places))
    for begin in range(0, len(places), 100):
        part = places[begin : begin + 100]
        squared = ((part[:, None] - cloud.positions) ** 2).sum(axis=2) / spreads**2
        densities[begin : begin + 100] = np.exp(-0.5 * squared) @ (weights / spreads**3)
    return float((densities[1:] > densities[0]).mean())


def honesty(
    trials: Sequence[Trial], config: PipelineConfig, rng: np.random.Generator
) -> list[Measure]:
    """Measure for each modality how many true contacts lie within its spreads.

    Args:
        trials: of touches with one true contact; others are left out.
        config: the pipeline that felt them.
        rng: draws from what is stated.
    """
    grid = Grid(config.integrator.frame, config.integrator.voxel_size)
    levels: dict[str, list[float]] = {}
    ruled_out: list[bool] = []
    for trial in trials:
        if len(trial.places) != 1 or trial.touch.short:
            continue
        for name, cloud in trial.clouds.items():
            if cloud.kind == HypothesisKind.NULL:
                there = grid.voxels(cloud.positions) == grid.voxels(trial.places)
                ruled_out.append(bool(there.all(axis=1).any()))
            elif cloud.likelihoods.any() and cloud.spreads is not None:
                level = level_of(cloud, trial.places[0], rng)
                levels.setdefault(modality_of(config, name), []).append(level)
    measures = []
    for modality, found in levels.items():
        for asked in LEVELS:
            value, low, high = proportion(np.array(found) <= asked)
            metric = f"true contacts within {asked:.0%} of what is stated"
            measures.append(Measure("spreads", modality, metric, value, low, high, "", len(found)))
    if ruled_out:
        value, low, high = proportion(np.array(ruled_out))
        metric = "true contacts ruled out"
        measures.append(
            Measure("spreads", "free space", metric, value, low, high, "", len(ruled_out),
                    better="less")
        )  # fmt: skip
    return measures
