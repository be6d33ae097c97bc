"""A magnetic skin pressed on a grid of 1 mm: location by a map that never saw the place.

Whole grid points, with all their presses, are left out of the map in ten folds. Beside it: bins of
depth left out, blocks of 3 × 3 mm left out, and the mean of five nearest neighbours as baseline.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.figures import new_figure
from contactfusion.generators.taxel_map import TaxelMap
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import CycleConfig, PipelineConfig
from contactfusion.readings import Markers, TactileImage
from contactfusion.recordings.opening import open_recording
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.measures import Measure, grouped, p50, p90, proportion

NAME = "eflesh"
FOLDS = 10
BASELINE_NEIGHBOURS = 5
VOXEL_SIZE = 0.0002
MIN_SIGNAL = 100.0
"""Least length of the signal in contact; the lightest presses give 110."""


def measure(folder: Path, out: Path, method: Method) -> list[Measure]:
    """Measure location errors under three cross-validation splits; draw them over the grid."""
    readings, places = read(folder / "spatial_20250316")
    rng = np.random.default_rng(0)
    point = np.unique(places[:, :2], axis=0, return_inverse=True)[1].ravel()
    block = np.unique(np.floor(places[:, :2] / 0.003 + 1e-6), axis=0, return_inverse=True)[1]
    depth = np.digitize(places[:, 2], np.quantile(places[:, 2], [0.2, 0.4, 0.6, 0.8]))
    splits = {
        "grid points left out": _folds(point, rng),
        "depths left out": depth,
        "3 mm blocks left out": _folds(block.ravel(), rng),
    }
    measures: list[Measure] = []
    for split, fold in splits.items():
        located, baseline, sigma = locate(readings, places, fold, method)
        asked = split == "grid points left out"
        measures += _errors(split, located, places, point, asked)
        if asked:
            measures += _coverage(split, located, places, sigma, point)
            measures += _errors(f"{split}, mean of nearest", baseline, places, point, False)
            _draw(located, places, out / "eflesh.png")
    return measures


def read(folder: Path) -> tuple[list[TactileImage], FloatArray]:
    """Read the presses: the signals, and where the robot pressed, shape (n, 3) [m]."""
    press = {"type": "markers", "frame": "pad", "names": ["press"], "columns": "2..4"}
    recording = open_recording(
        {
            "type": "log",
            "files": [
                {
                    "file": "sensor_post_baselines.csv",
                    "time": {"column": 1},
                    "readings": {
                        "pad": {"type": "tactile_image", "frame": "pad", "columns": "2..16"}
                    },
                },
                {
                    "file": "states.csv",
                    "time": {"column": 1, "file": "sensor_post_baselines.csv"},
                    "readings": {"press": {**press, "scale": 0.001}},
                },
            ],
        },
        folder,
    )
    images, places = [], []
    for reading in recording.readings():
        if isinstance(reading, TactileImage):
            images.append(reading)
        elif isinstance(reading, Markers):
            places.append(reading.positions[0])
    rounded = np.array(places)
    rounded[:, :2] = rounded[:, :2].round(4)  # the robot's grid, without the noise of its floats
    return images, rounded


def locate(
    readings: list[TactileImage], places: FloatArray, fold: NDArray[np.intp], method: Method
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Locate every press by a map of the presses in the other folds.

    Returns:
        Places by the pipeline and by the mean of nearest neighbours, both of shape (n, 2) [m] and
        NaN where no contact was reported, and the stated standard deviation, shape (n,) [m].
    """
    signals = np.array([reading.values for reading in readings])
    flat = places * [1.0, 1.0, 0.0]
    located, baseline = np.full((2, len(places), 2), np.nan)
    sigma = np.empty(len(places))
    with tempfile.TemporaryDirectory() as folder:
        for number in np.unique(fold):
            here, rest = np.flatnonzero(fold == number), fold != number
            learned = TaxelMap.fit(signals[rest], flat[rest])
            learned.save(Path(folder) / "map.npz")
            sigma[here] = learned.sigma
            run = _run(readings, here, Path(folder), method)
            for row, place in zip(here, run, strict=True):
                located[row] = place
            _, nearest = learned.tree.query(
                signals[here] / np.linalg.norm(signals[here], axis=1, keepdims=True),
                k=BASELINE_NEIGHBOURS,
            )
            baseline[here] = flat[rest][np.asarray(nearest)].mean(axis=1)[:, :2]
    return located, baseline, sigma


def _run(
    readings: list[TactileImage], rows: NDArray[np.intp], folder: Path, method: Method
) -> Iterator[FloatArray]:
    pipeline = Pipeline(
        PipelineConfig(
            generators={
                "pad": {"type": "taxel_map", "map": folder / "map.npz", "min_signal": MIN_SIGNAL}
            },
            integrator=method.applied(IntegratorConfig(frame="pad", voxel_size=VOXEL_SIZE)),
            cycle=CycleConfig(on="pad"),
        )
    )
    for step in pipeline.run(readings[row] for row in rows):
        contacts = step.fusion.contacts
        yield contacts[0].position[:2] if contacts else np.full(2, np.nan)


def _folds(groups: NDArray[np.intp], rng: np.random.Generator) -> NDArray[np.intp]:
    """Share groups out at random over the folds."""
    fold_of_group = rng.permutation(groups.max() + 1) % FOLDS
    folds: NDArray[np.intp] = fold_of_group[groups]
    return folds


def _errors(
    case: str, located: FloatArray, places: FloatArray, point: NDArray[np.intp], asked: bool
) -> list[Measure]:
    errors = np.linalg.norm(located - places[:, :2], axis=1)
    known = np.isfinite(errors)
    rng = np.random.default_rng(0)
    middle = grouped(errors[known], p50, point[known], rng)
    tail = grouped(errors[known], p90, point[known], rng)
    n = int(known.sum())
    return [
        Measure(NAME, case, "contact reported", *proportion(known, point), "", len(known)),
        Measure(
            NAME, case, "location error p50", *middle, "m", n, 0.001 if asked else None, "less"
        ),
        Measure(NAME, case, "location error p90", *tail, "m", n, 0.002 if asked else None, "less"),
    ]


def _coverage(
    case: str,
    located: FloatArray,
    places: FloatArray,
    sigma: FloatArray,
    point: NDArray[np.intp],
) -> list[Measure]:
    """Coverage of one and two stated standard deviations, by axis."""
    offsets = np.abs(located - places[:, :2])
    known = np.isfinite(offsets).all(axis=1)
    points = np.repeat(point[known], 2)
    measures = []
    for times, ideal in ((1.0, 0.68), (2.0, 0.95)):
        within = (offsets <= times * sigma[:, None])[known].ravel()
        note = f"{ideal:g} were ideal"
        metric = f"truth within {times:g} stated σ"
        measures.append(
            Measure(NAME, case, metric, *proportion(within, points), "", len(within), note=note)
        )
    return measures


def _draw(located: FloatArray, places: FloatArray, path: Path) -> None:
    figure = new_figure(11.0, 5.0)
    field, spread = figure.subplots(1, 2)
    offsets = (located - places[:, :2]) * 1000.0
    errors = np.linalg.norm(offsets, axis=1)
    shown = field.scatter(*(places[:, :2] * 1000.0).T, c=errors, s=14, vmin=0.0, vmax=2.0)
    figure.colorbar(shown, ax=field, label="error [mm]")
    field.set(xlabel="x [mm]", ylabel="y [mm]", title="each press, place left out", aspect="equal")
    spread.plot(*offsets.T, ".", markersize=2, alpha=0.4)
    spread.set(xlabel="x error [mm]", ylabel="y error [mm]", aspect="equal")
    spread.set(xlim=(-4, 4), ylim=(-4, 4), title="errors")
    save_figure(figure, path, dpi=120)
