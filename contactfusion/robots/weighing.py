"""Weighs what hangs on a wrist by a recording at rest, and tells the sign of its sensor by gravity.

A wrench sensor at rest feels the weight of what it carries. Of both signs only one gives a positive
mass, so gravity tells whether the sensor gives the force on the robot or by it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RecordingError, RobotError, name_hint
from contactfusion.frames import inverse, points_in, vectors_in
from contactfusion.generators.compensation import CompensationFit, fit_compensation
from contactfusion.readings import Wrench
from contactfusion.recordings.opening import open_recording
from contactfusion.robot_state import History
from contactfusion.robots.model import RobotModel
from contactfusion.robots.posed import PosedRobot

GRAVITY = np.array([[0.0, 0.0, -9.81]])
"""In the root link's frame, whose z is taken to point up [m/s²]."""
STILL = 0.01
"""Joints that move by less are at rest [rad, m]."""
LASTING = 0.2
"""A rest lasts so long, or is that far in time from its neighbours [s]."""
LEAST_POSES = 3
LEFT_OVER = 0.2
"""A fit that leaves more of the weight unexplained explains nothing."""
SIGNS = {"on_robot": 1.0, "by_robot": -1.0}


@dataclass(frozen=True, eq=False)
class Sample:
    """A wrench, and where the joints were.

    Attributes:
        reading: the wrench.
        positions: shape (n,), of the model's joints [rad, m].
    """

    reading: Wrench
    positions: FloatArray


def heard(model: RobotModel, path: Path) -> dict[str, list[Sample]]:
    """Give the wrenches of a recording by the name of their sensor, with the joints then.

    Raises:
        RecordingError: the recording cannot be read.
        RobotError: the joints of the robot are not all in it.
    """
    history, samples = History(), dict[str, list[Sample]]()
    unknown: RobotError | None = None
    for reading in open_recording(path).readings():
        history.add(reading)
        if isinstance(reading, Wrench):
            try:
                positions = model.positions(history.joints(reading.stamp))
            except RobotError as error:  # the first wrench may come before the first joints
                unknown = error
                continue
            samples.setdefault(reading.sensor, []).append(Sample(reading, positions))
    if not samples and unknown is not None:
        raise RobotError(f"{path}: {unknown}")
    if not samples:
        raise RecordingError(f"{path} holds no wrench")
    return samples


def weigh(
    model: RobotModel, wrist: str, samples: Mapping[str, Sequence[Sample]]
) -> tuple[list[str], list[str]]:
    """Tell the sign of a wrist by gravity, and compare its load with the URDF's.

    Args:
        model: the robot.
        wrist: the name of the wrist in the description.
        samples: by the name of the sensor, in the order of their stamps.

    Returns:
        Lines that say what was found, and sentences on what is wrong.
    """
    sensor, config = f"wrist '{wrist}'", model.config.wrists[wrist]
    if wrist not in samples:
        hint = name_hint(wrist, samples, "wrenches of the recording")
        return [], [f"no wrench of {sensor} came: {hint}"]
    own = samples[wrist]
    if (frame := own[0].reading.frame) != config.frame:
        return [], [f"{sensor} is in '{config.frame}', but its wrenches come in '{frame}'"]
    poses = resting(own)
    if len(poses) < LEAST_POSES:
        return [], [
            f"{sensor} rested in {len(poses)} poses; {LEAST_POSES} that are turned far from each "
            "other tell weight and bias apart"
        ]
    wrenches = np.array([wrench for _, wrench in poses])
    robots = [PosedRobot(model, positions, model.root, np.eye(4)) for positions, _ in poses]
    to_sensor = [inverse(robot.pose_of(config.frame)) for robot in robots]
    gravities = np.array([vectors_in(pose, GRAVITY)[0] for pose in to_sensor])
    fits: dict[str, CompensationFit] = {}
    why = ""
    for sign, factor in SIGNS.items():
        signed = factor * wrenches
        try:
            fits[sign] = fit_compensation(signed[:, :3], signed[:, 3:], gravities)
        except ConfigurationError as error:  # of the two signs one gives a negative mass
            why = error.problem
    if not fits:
        return [], [f"{sensor}: {why}"]
    ((sign, fit),) = fits.items()
    weight = fit.compensation.mass * 9.81
    left = float(np.linalg.norm(fit.force_residual))
    if left > LEFT_OVER * weight:
        return [], [
            f"{sensor}: neither sign explains its wrenches, as {left:.2f} N are left over beside a "
            f"weight of {weight:.2f} N: is its frame turned, or did something touch?"
        ]
    loads = [robot.load_on(config.frame) for robot in robots]
    centres = [points_in(to, c[None])[0] for to, (_, c) in zip(to_sensor, loads, strict=True)]
    wrong = []
    if sign != config.sign:
        wrong.append(f"{sensor}: gravity says sign {sign}, the description says {config.sign}")
    mass, centre = loads[0][0], np.mean(centres, axis=0)
    return _compared(sensor, len(poses), sign, fit, mass, centre), wrong


def resting(samples: Sequence[Sample]) -> list[tuple[FloatArray, FloatArray]]:
    """Give the poses at which the robot rested.

    A log may be dense, or have one row a pose: what counts is how long the joints stay, or how far
    in time a pose stands from its neighbours.

    Returns:
        For each the joints, shape (n,) [rad, m], and the mean wrench, shape (6,) [N, N·m].
    """
    groups: list[list[Sample]] = []
    for sample in samples:
        if groups and np.abs(sample.positions - groups[-1][0].positions).max(initial=0.0) < STILL:
            groups[-1].append(sample)
        else:
            groups.append([sample])
    poses = []
    for number, group in enumerate(groups):
        first, last = group[0].reading.stamp, group[-1].reading.stamp
        spans = [last - first]
        if number > 0:
            spans.append(first - groups[number - 1][-1].reading.stamp)
        if number + 1 < len(groups):
            spans.append(groups[number + 1][0].reading.stamp - last)
        if max(spans) >= LASTING:
            wrenches = [np.hstack([one.reading.force, one.reading.torque]) for one in group]
            poses.append((group[0].positions, np.mean(wrenches, axis=0)))
    return poses


def _compared(
    sensor: str, count: int, sign: str, fit: CompensationFit, mass: float, centre: FloatArray
) -> list[str]:
    found = fit.compensation
    apart = np.linalg.norm(centre - found.centre_of_mass) * 1000.0
    return [
        f"{sensor} in {count} poses at rest: gravity says sign {sign}",
        f"  mass {found.mass:.3f} kg, by the URDF {mass:.3f} kg",
        f"  centre of mass {_mm(np.array(found.centre_of_mass))}, by the URDF {_mm(centre)}: "
        f"{apart:.1f} mm apart",
        f"  left over: force {_root_mean_square(fit.force_residual):.3f} N, "
        f"torque {_root_mean_square(fit.torque_residual):.4f} N·m by axis",
        f"  compensation: {found.model_dump_json()}",
    ]


def _mm(vector: FloatArray) -> str:
    return "(" + ", ".join(f"{1000.0 * number:.1f}" for number in vector) + ") mm"


def _root_mean_square(vector: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(vector))))
