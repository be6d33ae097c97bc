"""Export of trained networks in the format of the run-time, and their test in pushes."""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.files import write_whole
from contactfusion.generators.lstm import Weights
from contactfusion.generators.networks import KINDS, NetworksCard
from contactfusion.generators.proximity import ProximityConfig
from contactfusion_lab.experiments.push.experiment import Options, run_push
from contactfusion_lab.experiments.push.outcomes import outcomes_of
from contactfusion_lab.experiments.push.tables import perception
from contactfusion_lab.experiments.push.trial import load
from contactfusion_lab.learning.dataset import WINDOW, Dataset
from contactfusion_lab.learning.networks import predict
from contactfusion_lab.learning.training import Trained
from contactfusion_lab.trials.executor import Executor

SEED = 7_000_000
"""Seed of the experiments, to which the seed of the training is added."""
SENSINGS = ("lidar", "rule")


def write_networks(
    path: Path,
    location: Trained,
    kind: Trained,
    data: Dataset,
    proximity: ProximityConfig,
    rate: float,
    description: str,
    figures: Mapping[str, float] | None = None,
) -> NetworksCard:
    """Write the weights of both networks and the card beside them; each file appears whole.

    Args:
        path: the safetensors file; the card is a JSON file of the same name.
        location: the trained location estimator.
        kind: the trained type estimator.
        data: what they were trained on.
        proximity: configuration of the proximity lengths.
        rate: of the cycles of the trials [Hz].
        description: of the data, in words.
        figures: other measures; error and accuracy over validation are added.

    Returns:
        The card.

    Raises:
        ConfigurationError: a kind of contact has no cycle in validation, or the data were made with
            other strips than `proximity` has.
    """
    columns = data.training.rows.shape[1]
    if proximity.columns != columns:
        raise ConfigurationError(
            f"the data have {columns} proximity lengths, the cells give {proximity.columns}"
        )
    tensors = {
        f"{network.name}.{name}": array
        for network in (location, kind)
        for name, array in network.weights.items()
    }
    content = save(tensors)
    errors, right = _location_errors(location.weights, data), _types_right(kind.weights, data)
    card = NetworksCard(
        proximity=proximity,
        window=WINDOW,
        rate=rate,
        length=data.length,
        lateral=data.lateral,
        sigma=_sigma(errors, data),
        figures={
            "validation_location_rmse_m": float(np.sqrt(np.nanmean(errors**2))),
            "validation_type_accuracy": float(right.mean()),
            **(figures or {}),
        },
        seeds={network.name: network.options.seed for network in (location, kind)},
        data=description,
        data_sha256=data.sha256,
        weights_sha256=hashlib.sha256(content).hexdigest(),
    )
    write_whole(path, content)
    write_whole(
        path.with_suffix(".json"), json.dumps(card.model_dump(mode="json"), indent=1) + "\n"
    )
    return card


def _location_errors(weights: Weights, data: Dataset) -> FloatArray:
    """Estimated minus true location over validation, shape (w,) [m], NaN without contact."""
    outputs = predict("location", weights, data.validation, data.length)[:, 0]
    errors: FloatArray = data.lateral.unscaled(outputs) - data.validation.lateral
    return errors


def _types_right(weights: Weights, data: Dataset) -> NDArray[np.bool_]:
    outputs = predict("type", weights, data.validation, data.length)
    right: NDArray[np.bool_] = np.argmax(outputs, axis=1) == data.validation.kind
    return right


def _sigma(errors: FloatArray, data: Dataset) -> dict[str, float]:
    found = {}
    for kind in ("point", "line"):
        here = errors[data.validation.kind == KINDS.index(kind)]
        if not len(here):
            raise ConfigurationError(f"no cycle of the validation trials has {kind} contact")
        found[kind] = float(np.sqrt(np.mean(here**2)))
    return found


def tested(
    weights: Path, mountings: Sequence[str], count: int, seed: int, executor: Executor, out: Path
) -> dict[str, float]:
    """Measures of pushes to random targets from random starts, by networks and by the rule.

    Args:
        weights: of the networks.
        mountings: of the LiDAR.
        count: number of pushes from each mounting.
        seed: of the training.
        executor: the workers.
        out: takes a folder of `experiment push` for each mounting.

    Returns:
        Measures, by names that begin with mounting and sensing.
    """
    figures: dict[str, float] = {}
    for mounting in mountings:
        folder = out / mounting
        options = Options(
            sensings=SENSINGS, lidar=mounting, weights=weights, targets=f"random:{count}",
            starts="random", seed=SEED + seed, executor=executor,
        )  # fmt: skip
        run_push(options, folder)
        for sensing in SENSINGS:
            tracks = [load(path) for path in sorted((folder / "trials" / sensing).rglob("*.npz"))]
            found, outcomes = perception(tracks, seed), outcomes_of(tracks)
            name = f"{mounting}_{sensing}"
            figures |= {
                f"{name}_success_true": float(outcomes["success_true"].mean()),
                f"{name}_location_rmse_m": found["location_rmse"][0],
                f"{name}_type_accuracy": found["type_accuracy"][0],
                f"{name}_contact_accuracy": found["contact_accuracy"][0],
            }
    # NaN when no contact was located
    return {name: value for name, value in figures.items() if math.isfinite(value)}
