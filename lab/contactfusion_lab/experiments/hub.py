"""A six-axis sensor in the hub of a turning wheel: what is left of bias and weight.

The recording gives the wrench in axes that stand still, and the angle of the wheel. Turned back
into the sensor's axes, the sensor's bias is constant and gravity turns. Mass, centre and bias are
fitted on one file and taken off in the other, at rest: while the sensor is unloaded.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, uniform_filter1d

from contactfusion.arrays import FloatArray
from contactfusion.figures import COLOURS, new_figure
from contactfusion.generators.compensation import Compensation, fit_compensation
from contactfusion.generators.force_torque import ForceTorqueConfig, ForceTorqueGenerator
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.pipeline import Pipeline
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import JointState, Odometry, Wrench
from contactfusion.recordings.opening import open_recording
from contactfusion_lab.trials.folder import save_figure
from contactfusion_lab.trials.measures import Measure, grouped, p50

NAME = "hub"
RATE = 240.0
GRAVITY = np.array([0.0, -9.81, 0.0])
"""Gravity in the fixed axes [m/s²]."""
REST_TORQUE, REST_SAMPLES, MARGIN = 0.75, 9, 24
"""At rest the smoothed moment about the axle is under this [N·m], also 0.1 s before and after."""
AVERAGE = 0.05
FILES = {
    "baseline": "pushrimkinetics_offsets_baseline.csv",
    "propulsion": "pushrimkinetics_offsets_propulsion.csv",
}


@dataclass(frozen=True, eq=False)
class Turning:
    """One file, in the axes of the sensor.

    Attributes:
        stamps: shape (n,) [s].
        angles: shape (n,) [rad], of the wheel.
        forces: shape (n, 3) [N], in the sensor's axes.
        torques: shape (n, 3) [N·m].
        rest: shape (n,), whether the sensor is unloaded.
    """

    stamps: FloatArray
    angles: FloatArray
    forces: FloatArray
    torques: FloatArray
    rest: NDArray[np.bool_]


def measure(folder: Path, out: Path) -> list[Measure]:
    """Measure what is left of force at rest, each file compensated by the other; draw it."""
    files = {name: read(folder, file) for name, file in FILES.items()}
    measures: list[Measure] = []
    left: dict[str, FloatArray] = {}
    for fitted, applied in (("baseline", "propulsion"), ("propulsion", "baseline")):
        known, tested = files[fitted], files[applied]
        fit = fit_compensation(
            known.forces[known.rest],
            known.torques[known.rest],
            _turned(np.tile(GRAVITY, (len(known.angles), 1)), known.angles)[known.rest],
        )
        for average in (0.0, AVERAGE):
            residual = residuals(tested, fit.compensation, average)
            case = f"fitted on {fitted}, at rest in {applied}"
            if average:
                case += f", averaged over {average} s"
            else:
                left[applied] = residual
            measures += _left(case, residual[tested.rest], tested.stamps[tested.rest])
    _draw(files, left, out / "hub.png")
    return measures


def read(folder: Path, file: str) -> Turning:
    """Read one file, with its wrenches rotated into the axes of the sensor."""
    recording = open_recording(
        {
            "type": "log",
            "file": file,
            "header": False,
            "time": {"rate": RATE},
            "readings": {
                "wheel": {
                    "type": "joint_state",
                    "frame": "chair",
                    "names": ["wheel"],
                    "columns": [4],
                    "scale": float(np.pi / 180.0),
                },
                "hub": {"type": "wrench", "frame": "chair", "columns": "19..24"},
            },
        },
        folder,
    )
    angles, wrenches = [], []
    for reading in recording.readings():
        if isinstance(reading, JointState):
            angles.append(float(reading.positions[0]))
        elif isinstance(reading, Wrench):
            wrenches.append(reading)
    angle = np.array(angles)
    torques = np.array([wrench.torque for wrench in wrenches])
    quiet = np.abs(uniform_filter1d(torques[:, 2], REST_SAMPLES)) < REST_TORQUE
    return Turning(
        stamps=np.array([wrench.stamp for wrench in wrenches]),
        angles=angle,
        forces=_turned(np.array([wrench.force for wrench in wrenches]), angle),
        torques=_turned(torques, angle),
        rest=binary_erosion(quiet, np.ones(2 * MARGIN + 1, np.bool_), border_value=1),
    )


def residuals(turning: Turning, compensation: Compensation, average: float) -> FloatArray:
    """The residual force after the force-torque generator, in the fixed axes.

    Args:
        turning: one file.
        compensation: fitted on the other.
        average: the window of the generator's average [s].

    Returns:
        Shape (n, 3) [N].
    """
    config = ForceTorqueConfig(
        sign="on_robot", compensation=compensation, average=average, gravity=tuple(GRAVITY)
    )
    generator = ForceTorqueGenerator("hub", config)
    pipeline = Pipeline(PipelineConfig(integrator=IntegratorConfig(frame="chair")))
    left = np.empty((len(turning.stamps), 3))
    for row, stamp in enumerate(turning.stamps):
        half = -0.5 * turning.angles[row]
        pipeline.receive(
            Odometry(
                stamp=stamp,
                frame="chair",
                child_frame="hub",
                position=np.zeros(3),
                orientation=np.array([0.0, 0.0, np.sin(half), np.cos(half)]),
            )
        )
        wrench = Wrench(
            stamp=stamp, frame="hub", force=turning.forces[row], torque=turning.torques[row]
        )
        compensated = generator.compensated(wrench, pipeline.state(stamp))
        assert compensated is not None
        left[row] = compensated[:3]
    return _turned(left, -turning.angles)


def _turned(vectors: FloatArray, angles: FloatArray) -> FloatArray:
    """Turn each vector by its angle about z; chair axes to sensor axes for the wheel's angle."""
    c, s = np.cos(angles), np.sin(angles)
    x, y, z = vectors.T
    return np.stack([c * x - s * y, s * x + c * y, z], axis=1)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _left(case: str, residual: FloatArray, stamps: FloatArray) -> list[Measure]:
    rng = np.random.default_rng(0)
    seconds = np.floor(stamps)
    measures = []
    for axis, name in enumerate("xy"):
        values, n = np.abs(residual[:, axis]), len(residual)
        middle, rms = (grouped(values, statistic, seconds, rng) for statistic in (p50, _rms))
        note = "intervals over seconds"
        measures += [
            Measure(NAME, case, f"|F{name}| left, median", *middle, "N", n, 0.7, "less", note),
            Measure(NAME, case, f"|F{name}| left, rms", *rms, "N", n, 0.7, "less", note),
        ]
    return measures


def _draw(files: dict[str, Turning], left: dict[str, FloatArray], path: Path) -> None:
    figure = new_figure(10.0, 6.0)
    rows = figure.subplots(2, 1)
    for axes, (name, residual) in zip(rows, left.items(), strict=True):
        turning = files[name]
        raw = _turned(turning.forces, -turning.angles)[:, 0]
        axes.plot(turning.stamps, raw, color="#bbbbbb", linewidth=0.8, label="Fx as recorded")
        axes.plot(turning.stamps, residual[:, 0], color=COLOURS[0], linewidth=0.8, label="Fx left")
        rest = np.where(turning.rest, residual[:, 0], np.nan)
        axes.plot(turning.stamps, rest, color=COLOURS[2], linewidth=1.2, label="at rest")
        axes.set(ylabel="[N]", title=f"{name}, compensated by the other file")
        axes.legend(loc="upper right", fontsize="small")
    rows[-1].set_xlabel("time [s]")
    save_figure(figure, path, dpi=120)
