"""Runs of a UR10e that presses a tool on a force sensor.

Joint angles over time are not recorded. The input is the residual of each joint, the current of its
motor less the set value; the force sensor is the truth.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.files import read_npz

JOINTS = 6
PERIOD = 0.002
"""Between two samples of the currents [s]."""
FORCE = "F0_blue"
"""The series of the force sensor."""
CURRENTS = [f"I{joint}" for joint in range(1, JOINTS + 1)]
SET_VALUES = [f"Id{joint}" for joint in range(1, JOINTS + 1)]
TOUCHING = 5.0
"""From which force on the tool touches [N]."""
MARGIN = 0.02
"""An alarm that is earlier than contact by more is false; motion that is nearer is not free [s]."""
SHORTEST = 0.2
"""A run has at least so much free motion before contact [s]."""
NOISES = 5.0
"""The force has left its noise when it is so many standard deviations above its mean."""
NAME = re.compile(
    r"(?:m_[\d.]+_)?(?P<profile>[a-z]+)_.*?(?P<controller>[A-Z]+)_control_F_(?P<force>[\d.]+)N_"
    r"(?P<settings>.+)_v_(?P<speed>[\d.]+)(?:_\d+)?"
)


@dataclass(frozen=True, eq=False)
class Run:
    """One run.

    Attributes:
        name: that of its file.
        profile: of the motion: `direct` down on the sensor, or a `ramp`.
        controller: of the force: `UR`, the arm's own, or `ACF`, an actuator in the tool.
        force: what is to be pressed [N].
        speed: of the approach [m/s].
        stamps: shape (n,) [s].
        residual: shape (n, 6), currents less their set values [A].
        set_values: shape (n, 6), of the currents [A].
        force_stamps: shape (m,) [s].
        forces: shape (m,), by the sensor under the tool [N].
    """

    name: str
    profile: str
    controller: str
    force: float
    speed: float
    stamps: FloatArray
    residual: FloatArray
    set_values: FloatArray
    force_stamps: FloatArray
    forces: FloatArray

    @cached_property
    def onset(self) -> float:
        """The first stamp at which the force is above 5 N [s]; inf where it never is."""
        above = self.forces > TOUCHING
        return float(self.force_stamps[above.argmax()]) if above.any() else np.inf

    @cached_property
    def leaves_noise(self) -> float:
        """From when on, until the onset, the force is above its noise [s]; inf without an onset."""
        if not np.isfinite(self.onset):
            return np.inf
        before = self.forces[self.force_stamps < self.onset]
        noise = self.forces[self.force_stamps < self.onset - MARGIN]
        quiet = before <= noise.mean() + NOISES * noise.std()
        return float(self.force_stamps[np.flatnonzero(quiet)[-1] + 1])

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """The samples of free motion before the contact, shape (n,)."""
        return self.stamps < self.onset - MARGIN

    @cached_property
    def force_now(self) -> FloatArray:
        """The force at the stamps of the currents, shape (n,) [N]."""
        return np.interp(self.stamps, self.force_stamps, self.forces)

    @cached_property
    def touching(self) -> NDArray[np.bool_]:
        """The samples of contact, shape (n,)."""
        return self.force_now > TOUCHING


def read(folder: Path) -> Iterator[Run]:
    """All runs in a folder, in the order of their names.

    Raises:
        RecordingError: there is none, or a file is not what it should be.
    """
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise RecordingError(f"there is no run, that is no .npz file, in '{folder}'")
    yield from map(read_run, paths)


def read_run(path: Path) -> Run:
    """One run.

    Raises:
        RecordingError: its name or its series are not what they should be.
    """
    name = NAME.fullmatch(path.stem)
    if name is None:
        raise RecordingError(
            f"{path}: the name is not as in direct_contact_UR_control_F_100N_damping_0_v_0.10_1"
        )
    series = dict(
        zip(
            (*CURRENTS, *SET_VALUES, FORCE),
            read_npz(path, *CURRENTS, *SET_VALUES, FORCE),
            strict=True,
        )
    )
    for key, values in series.items():
        if values.ndim != 2 or values.shape[1] != 2 or len(values) < 2:
            raise RecordingError(
                f"{path}: {key} has shape {values.shape} in place of rows of stamp and value"
            )
        if not np.isfinite(values).all() or (np.diff(values[:, 0]) <= 0.0).any():
            raise RecordingError(f"{path}: {key} is not finite, or its stamps do not ascend")
    stamps = np.asarray(series[CURRENTS[0]][:, 0], np.float64)
    for key in (*CURRENTS, *SET_VALUES):
        other = series[key][:, 0]
        if len(other) != len(stamps) or np.abs(other - stamps).max() > PERIOD / 2.0:
            raise RecordingError(f"{path}: {key} has other stamps than {CURRENTS[0]}")
    if abs(np.median(np.diff(stamps)) - PERIOD) > PERIOD / 10.0:
        raise RecordingError(f"{path}: {CURRENTS[0]} is not sampled every {PERIOD} s")
    currents, set_values = (
        np.stack([series[key][:, 1] for key in keys], axis=1).astype(np.float64)
        for keys in (CURRENTS, SET_VALUES)
    )
    run = Run(
        name=path.stem,
        profile=name["profile"],
        controller=name["controller"],
        force=float(name["force"]),
        speed=float(name["speed"]),
        stamps=stamps,
        residual=currents - set_values,
        set_values=set_values,
        force_stamps=np.asarray(series[FORCE][:, 0], np.float64),
        forces=np.asarray(series[FORCE][:, 1], np.float64),
    )
    if run.onset - max(stamps[0], run.force_stamps[0]) < SHORTEST:
        raise RecordingError(f"{path}: it begins less than {SHORTEST} s before the tool touches")
    return run
