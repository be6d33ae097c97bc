"""A hand that holds an object, or nothing: can the skin of its fingers distinguish them?

Untouched values and their noise are learned from trials with an empty hand, never from the trial
under test. The score of a trial is the largest touch among all taxels, in standard deviations of
the noise, over its last four frames; the hand's joints are not used. Empty hands come in two
postures, and taxels answer to posture too: an area of 1 does not mean that only touch was measured.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.figures import new_figure
from contactfusion.frames import FrameConfig
from contactfusion.generators.baselines import fit_baseline
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import CycleConfig, PipelineConfig
from contactfusion.readings import Reading, TactileImage
from contactfusion.recordings.icub import FINGERS, IcubConfig, IcubRecording
from contactfusion_lab.experiments.methods import Method
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.measures import CONFIDENCE, RESAMPLES, Measure, auc, proportion

NAME = "icub_grasp"
EMPTY, BEAR, UNRELIABLE = "none", "blue_bear", "full_coke"
FRAMES = 4
"""Number of frames at the end of a trial that are scored; every trial has them."""
LEAST_NOISE = 0.5
"""Values are whole numbers: no taxel is believed to be quieter than half of one."""
TAXELS, PITCH = 12, 0.004


@dataclass(frozen=True, eq=False)
class Trial:
    """One grasp.

    Attributes:
        object: what was grasped.
        number: of the trial.
        readings: all of them.
        values: shape (frames, 60), all fingers.
    """

    object: str
    number: int
    readings: tuple[Reading, ...]
    values: FloatArray


def measure(folder: Path, out: Path, method: Method) -> list[Measure]:
    """Measure how well touch distinguishes a full hand from an empty one; draw the scores."""
    trials = read(folder / "iCubGraspDataset")
    empty = [trial for trial in trials if trial.object == EMPTY]
    objects = sorted({trial.object for trial in trials} - {EMPTY, UNRELIABLE})
    full = [trial for trial in trials if trial.object in objects]

    measures = _areas("each empty trial left out", objects, full, *_left_out(full, empty))
    for parity, case in ((0, "calibrated on odd trials"), (1, "calibrated on even trials")):
        known = [trial for trial in empty if trial.number % 2 != parity]
        tested = [trial for trial in empty if trial.number % 2 == parity]
        baseline = learned(known)
        scores = [score(trial, *baseline) for trial in full]
        nothing = [score(trial, *baseline) for trial in tested]
        measures += _areas(case, objects, full, np.array(scores), np.array(nothing))
    measures += _detections(full, empty, method)
    _draw(objects, full, *_left_out(full, empty), out / "icub_grasp.png")
    return measures


def read(folder: Path) -> list[Trial]:
    """Read all trials.

    Raises:
        RecordingError: there are none.
    """
    trials = []
    for path in sorted(folder.glob("*.txt")):
        name, _, number = path.stem.rpartition("_")
        readings = tuple(IcubRecording(IcubConfig(file=path)).readings())
        images = [r for r in readings if isinstance(r, TactileImage)]
        values = np.array([image.values for image in images]).reshape(-1, len(FINGERS) * TAXELS)
        trials.append(Trial(name, int(number), readings, values))
    if not trials:
        raise RecordingError(f"there are no trials in '{folder}'")
    return trials


def learned(empty: list[Trial]) -> tuple[FloatArray, FloatArray]:
    """Learn untouched values and noise from empty hands, both of shape (60,)."""
    return fit_baseline(np.concatenate([trial.values for trial in empty]), LEAST_NOISE)


def score(trial: Trial, values: FloatArray, noise: FloatArray) -> float:
    """The largest touch among all taxels, in standard deviations of the noise."""
    last = trial.values[-FRAMES:].mean(axis=0)
    return float(((values - last) / noise).max())


def touched(trial: Trial, values: FloatArray, noise: FloatArray, method: Method) -> bool:
    """Whether the pipeline reports a contact in most of the last frames."""
    generators = {
        finger: {
            "type": "tactile",
            "sensor": finger,
            "patch": {"grid": {"rows": 3, "columns": 4, "pitch": (PITCH, PITCH)}},
            "baseline": {
                "values": tuple(values[i * TAXELS : (i + 1) * TAXELS]),
                "noise": tuple(noise[i * TAXELS : (i + 1) * TAXELS]),
                "touch": "falls",
            },
        }
        for i, finger in enumerate(FINGERS)
    }
    frames = {
        finger: FrameConfig(parent="hand", xyz=(0.0, 0.03 * i, 0.0))
        for i, finger in enumerate(FINGERS)
    }
    config = PipelineConfig(
        generators=generators,
        integrator=method.applied(IntegratorConfig(frame="hand")),
        frames=frames,
        cycle=CycleConfig(on=FINGERS[-1]),
    )
    steps = list(Pipeline(config).run(trial.readings))[-FRAMES:]
    return sum(bool(step.fusion.contacts) for step in steps) > FRAMES / 2


def _left_out(full: list[Trial], empty: list[Trial]) -> tuple[FloatArray, FloatArray]:
    """Score full hands by all empty trials, and each empty trial by the others."""
    baseline = learned(empty)
    nothing = [
        score(trial, *learned([other for other in empty if other is not trial])) for trial in empty
    ]
    return np.array([score(trial, *baseline) for trial in full]), np.array(nothing)


def _areas(
    case: str,
    objects: list[str],
    full: list[Trial],
    scores: FloatArray,
    nothing: FloatArray,
) -> list[Measure]:
    """The mean area under the ROC curve, and that of the bear; trials are resampled."""
    groups = [scores[[trial.object == name for trial in full]] for name in objects]
    areas = np.array([auc(group, nothing) for group in groups])
    rng = np.random.default_rng(0)
    drawn = np.array(
        [
            [auc(rng.choice(group, len(group)), again) for group in groups]
            for again in (rng.choice(nothing, len(nothing)) for _ in range(RESAMPLES // 4))
        ]
    )
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(drawn.mean(axis=1), [tail, 1.0 - tail])
    bear = objects.index(BEAR)
    bear_low, bear_high = np.quantile(drawn[:, bear], [tail, 1.0 - tail])
    n = len(scores) + len(nothing)
    bears = len(groups[bear]) + len(nothing)
    asked = case == "each empty trial left out"
    return [
        Measure(
            NAME, case, "mean area under ROC", float(areas.mean()), low, high, "", n,
            0.98 if asked else None,
        ),
        Measure(
            NAME, case, "blue bear, area under ROC", float(areas[bear]), bear_low, bear_high, "",
            bears, 0.9 if asked else None,
        ),
    ]  # fmt: skip


def _detections(full: list[Trial], empty: list[Trial], method: Method) -> list[Measure]:
    """Run the pipeline at its default noise threshold of five standard deviations."""
    baseline = learned(empty)
    found = np.array([touched(trial, *baseline, method) for trial in full])
    false = np.array(
        [
            touched(trial, *learned([other for other in empty if other is not trial]), method)
            for trial in empty
        ]
    )
    bear = np.array([trial.object == BEAR for trial in full])
    case = "contact reported at 5 σ"
    return [
        Measure(NAME, case, "all but the bear", *proportion(found[~bear]), "", int((~bear).sum())),
        Measure(NAME, case, "blue bear", *proportion(found[bear]), "", int(bear.sum())),
        Measure(
            NAME, case, "empty hands", *proportion(false), "", len(false), None, "less",
            "each calibrated on the others",
        ),
    ]  # fmt: skip


def _draw(
    objects: list[str], full: list[Trial], scores: FloatArray, nothing: FloatArray, path: Path
) -> None:
    figure = new_figure(9.0, 5.0)
    axes = figure.subplots()
    groups = [nothing, *(scores[[t.object == name for t in full]] for name in objects)]
    for number, group in enumerate(groups):
        colour = "#d55e00" if number == 0 else "#0072b2"
        x = number + np.linspace(-0.3, 0.3, len(group))
        axes.plot(x, np.maximum(np.sort(group), 0.1), "o", markersize=4, color=colour)
    axes.axhline(5.0, color="#888888", linewidth=0.8, label="floor of the tactile generator, 5 σ")
    axes.set(yscale="log", ylabel="largest touch [σ of the untouched hand]")
    axes.set_title("scores of trials: empty hand, and each object")
    axes.set_xticks(range(len(groups)), ["empty hand", *objects], rotation=40, ha="right")
    axes.legend(loc="lower right", fontsize="small")
    save_figure(figure, path, dpi=120)
