"""The motion of an arm as means over short windows, in which its equation of motion is linear.

Over a window of length T the torques satisfy (p(T) − p(0))/T = mean(τ + Cᵀq' − g), the integral of
the equation that the generator's momentum observer follows (`generators/external_torque.py`): no
acceleration is needed, and the noise of encoders counts at the ends of a window only.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import savgol_filter

from contactfusion.arrays import FloatArray
from contactfusion.errors import RecordingError
from contactfusion.generators.external_torque import LONGEST, SLOW
from contactfusion.identify.recorded import Motion
from contactfusion.robots.dynamics import Dynamics

PERIOD = 0.01
"""Between the rows to which readings are averaged [s]."""
WIDTH = 0.1
"""Of a window [s]."""
SMOOTHED = 7
"""Velocities are the slope of a cubic over so many rows."""
LEAST = 5.0
"""The shortest motion that anything is identified from [s]."""
PLATEAU = 0.2
"""An effort that stays so long at exactly its greatest or least value is saturated [s]."""


@dataclass(frozen=True, eq=False)
class Windows:
    """Means over windows of the joints of one generator.

    Attributes:
        stamps: of their middles, shape (w,) [s].
        efforts: shape (w, k), in the joints' own units.
        torques: that motion and gravity take by the URDF, shape (w, k) [N·m, N].
        payload: those per unit of each inertial parameter, shape (w, k, 10).
        masses: those per unit of mass and first moments of each link, shape (w, k, 4 l).
        sliding: direction of the motion, from -1 to 1, shape (w, k).
        velocities: shape (w, k) [rad/s, m/s].
        sticking: share of friction that is unknown as the joint rests, shape (w, k).
        lagging: `efforts` that came so many rows later, by rows.
        period: between two rows [s].
        width: of a window [s].
    """

    stamps: FloatArray
    efforts: FloatArray
    torques: FloatArray
    payload: FloatArray
    masses: FloatArray
    sliding: FloatArray
    velocities: FloatArray
    sticking: FloatArray
    lagging: dict[int, FloatArray]
    period: float
    width: float

    @property
    def count(self) -> int:
        """The number of windows."""
        return len(self.stamps)


def windows_of(
    motion: Motion,
    efforts: FloatArray,
    dynamics: Dynamics,
    numbers: NDArray[np.intp],
    link: str | None,
    links: Sequence[str],
    lags: tuple[int, ...],
) -> Windows:
    """Average a motion over windows.

    Args:
        motion: of the joints.
        efforts: of the generator's joints, shape (m, k).
        dynamics: of the robot.
        numbers: of these joints among those of the robot, shape (k,).
        link: that carries a payload; None: motion and gravity load no joint, as where torques of
            contacts are reported.
        links: whose masses may be others than those of the URDF.
        lags: rows by which efforts are shifted, too.

    Raises:
        RecordingError: the motion is too short.
    """
    apart = np.diff(motion.stamps)
    period = max(PERIOD, float(np.median(apart))) if len(apart) else PERIOD
    parts = [
        _windows(stretch, efforts[rows], motion, rows, dynamics, numbers, link, links, lags, period)
        for stretch, rows in _stretches(motion.stamps, period)
    ]
    length = sum(part.width * part.count for part in parts)
    if length < LEAST:
        raise RecordingError(
            f"{length:.1f} s of efforts without a gap over {LONGEST:g} s are too few: move all "
            f"joints for {LEAST:g} s at least, better for a minute"
        )
    names = [field.name for field in fields(Windows)]
    arrays = [name for name in names if isinstance(getattr(parts[0], name), np.ndarray)]
    return Windows(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays},
        lagging={lag: np.concatenate([part.lagging[lag] for part in parts]) for lag in lags},
        period=period,
        width=parts[0].width,
    )


def _stretches(stamps: FloatArray, period: float) -> Iterator[tuple[FloatArray, slice]]:
    """Stamps without gaps in between, and their rows; those too short for windows are left out."""
    ends = np.flatnonzero(np.diff(stamps) > LONGEST) + 1
    for first, end in zip([0, *ends], [*ends, len(stamps)], strict=True):
        if stamps[end - 1] - stamps[first] > 2.0 * SMOOTHED * period + WIDTH:
            yield stamps[first:end], slice(first, end)


def _windows(
    stamps: FloatArray,
    efforts: FloatArray,
    motion: Motion,
    rows: slice,
    dynamics: Dynamics,
    numbers: NDArray[np.intp],
    link: str | None,
    links: Sequence[str],
    lags: tuple[int, ...],
    period: float,
) -> Windows:
    """Of a stretch without gaps."""
    edges = np.arange(stamps[0], stamps[-1], period)
    positions = averaged(stamps, np.array(motion.positions[rows]), edges)
    efforts = averaged(stamps, efforts, edges)
    rate = savgol_filter(positions, SMOOTHED, 3, deriv=1, delta=period, axis=0)
    count = len(positions)
    gravities = motion.gravities[rows]
    nearest = np.minimum(np.searchsorted(stamps, edges[1:]), len(stamps) - 1)
    momentum, drift = np.zeros((2, count, len(numbers)))
    further = np.zeros((2, count, len(numbers), 10))
    speeds = rate[:, numbers] if link is not None else np.zeros((count, len(numbers)))
    for row, (at, speed) in enumerate(zip(positions, rate, strict=True)):
        if link is None:
            break
        gravity = gravities[nearest[row]]
        momentum[row] = dynamics.momentum(at, speed)[numbers]
        drift[row] = dynamics.drift(at, speed, gravity)[numbers]
        columns = dynamics.payload_columns(link, at, speed, gravity)
        further[:, row] = columns[0][numbers], columns[1][numbers]
    sliding = np.tanh(speeds / SLOW)
    step = max(1, round(WIDTH / period))
    width = step * period

    def mean(values: FloatArray) -> FloatArray:
        integral = cumulative_trapezoid(values, dx=period, axis=0, initial=0)
        return np.asarray(np.diff(integral[::step], axis=0) / width)

    def change(values: FloatArray) -> FloatArray:
        return np.asarray(np.diff(values[::step], axis=0) / width)

    def of_links(which: int, rows: Sequence[int]) -> FloatArray:
        """Momentum (0) or drift (1) per unit of what links weigh, shape (len(rows), k, 4 l)."""
        found = np.zeros((len(rows), len(numbers), 4 * len(links)))
        for number, row in enumerate(rows):
            at = positions[row], rate[row], gravities[nearest[row]]
            for first, name in zip(range(0, 4 * len(links), 4), links, strict=True):
                columns = dynamics.payload_columns(name, *at)[which]
                found[number, :, first : first + 4] = columns[numbers, :4]
        return found

    ends = range(0, count, step)
    middles = [row + step // 2 for row in ends[:-1]]
    shifted = np.arange(count)
    return Windows(
        edges[0] + period / 2.0 + width * (np.arange(len(mean(sliding))) + 0.5),
        mean(efforts),
        change(momentum) - mean(drift),
        change(further[0]) - mean(further[1]),
        np.diff(of_links(0, ends), axis=0) / width - of_links(1, middles),
        mean(sliding),
        mean(speeds),
        mean(1.0 - sliding**2),
        {lag: mean(efforts[np.clip(shifted + lag, 0, count - 1)]) for lag in lags},
        period,
        width,
    )


def averaged(stamps: FloatArray, values: FloatArray, edges: FloatArray) -> FloatArray:
    """The means of values, shape (m, n), between edges, shape (e,): shape (e - 1, n)."""
    integral = cumulative_trapezoid(values, stamps, axis=0, initial=0)
    at = np.stack([np.interp(edges, stamps, column) for column in integral.T], axis=1)
    return np.asarray(np.diff(at, axis=0) / np.diff(edges)[:, None])


def spans(stamps: FloatArray, true: NDArray[np.bool_], least: float) -> list[tuple[float, float]]:
    """When a condition holds without a break for some time.

    Args:
        stamps: shape (n,) [s].
        true: whether it holds at each, shape (n,).
        least: the shortest time that counts [s].

    Returns:
        The first and the last stamp of each [s].
    """
    turns = np.diff(np.r_[0, true, 0].astype(np.int8))
    firsts, ends = np.flatnonzero(turns > 0), np.flatnonzero(turns < 0) - 1
    found = zip(stamps[firsts].tolist(), stamps[ends].tolist(), strict=True)
    return [(first, last) for first, last in found if last - first >= least - 1e-6]


def plateaus(stamps: FloatArray, efforts: FloatArray) -> dict[float, list[tuple[float, float]]]:
    """When an effort, shape (m,), stays at exactly its greatest or its least value.

    Returns:
        By that value the first and the last stamp of each time [s].
    """
    found = {
        float(end): spans(stamps, efforts == end, PLATEAU) for end in (efforts.max(), efforts.min())
    }
    return {value: held for value, held in found.items() if held}
