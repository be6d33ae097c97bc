"""What faults do to the values of a reading: pure functions, a reading in and a reading out."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import Pose, points_in
from contactfusion.readings import (
    DepthImage,
    JointCommand,
    JointState,
    Markers,
    ObjectPose,
    Odometry,
    PointCloud,
    Reading,
    Switch,
    TactileImage,
    Transform,
    Twist,
    Wrench,
)

Elements = tuple[int, ...] | None
"""Which taxels or joints, counted from 0; None: all."""
POSE_AMOUNT = "3 or 6 numbers: x, y, z [m], and a turn about x, y, z [rad]"
AMOUNTS: dict[type[Reading], tuple[tuple[int, ...], str]] = {
    Wrench: ((6,), "6 numbers: force x, y, z [N], torque x, y, z [N·m]"),
    Twist: ((6,), "6 numbers: linear x, y, z [m/s], angular x, y, z [rad/s]"),
    Odometry: ((3, 6), POSE_AMOUNT),
    ObjectPose: ((3, 6), POSE_AMOUNT),
    Transform: ((3, 6), POSE_AMOUNT),
    PointCloud: ((1, 3), "1 or 3 numbers: x, y, z [m]"),
    Markers: ((1, 3), "1 or 3 numbers: x, y, z [m]"),
    DepthImage: ((1,), "1 number: depth [m]"),
}
"""How many numbers an amount has for a kind of reading, and what they are. Those of taxels and
joints depend on the reading."""
NO_TURN = (0.0, 0.0, 0.0, 1.0)
ELEMENT_ARRAYS: dict[type[Reading], tuple[str, ...]] = {
    TactileImage: ("values",),
    JointState: ("positions", "velocities", "efforts"),
    JointCommand: ("positions",),
}
"""The kinds of reading that have elements, and which arrays hold one number for each."""


def zeroed(reading: Reading) -> Reading:
    """Give what a driver sends that fills its message with zeros.

    Points and markers lie at the origin, a depth of 0 is no return, a switch is open, and a pose
    is the identity, as a quaternion of zeros is none.
    """
    match reading:
        case Wrench():
            return replace(reading, force=np.zeros(3), torque=np.zeros(3))
        case Twist():
            return replace(reading, linear=np.zeros(3), angular=np.zeros(3))
        case TactileImage() | JointState() | JointCommand():
            zeros = {name: np.zeros_like(array) for name, array in _arrays(reading).items()}
            return _with_arrays(reading, zeros)
        case Odometry():
            return replace(
                reading,
                position=np.zeros(3),
                orientation=np.array(NO_TURN),
                linear=None if reading.linear is None else np.zeros(3),
                angular=None if reading.angular is None else np.zeros(3),
            )
        case ObjectPose() | Transform():
            return replace(reading, position=np.zeros(3), orientation=np.array(NO_TURN))
        case PointCloud():
            return replace(reading, points=np.zeros_like(reading.points))
        case Markers():
            return replace(reading, positions=np.zeros_like(reading.positions))
        case DepthImage():
            return replace(reading, depth=np.zeros_like(reading.depth))
        case Switch():
            return replace(reading, closed=False)
    raise _unknown(reading)


def repeated(reading: Reading, other: Reading, elements: Elements = None) -> Reading:
    """Give a reading with the values of another one, or only some elements of it.

    Args:
        reading: its stamp is kept.
        other: of the same sensor.
        elements: the taxels or joints that are the other's.

    Raises:
        ConfigurationError: there is no such element.
    """
    if elements is None:
        return replace(other, stamp=reading.stamp)
    rows = _rows(reading, elements)
    _rows(other, elements)
    mixed, others = _arrays(reading), _arrays(other)
    for name in mixed.keys() & others.keys():
        mixed[name] = mixed[name].copy()
        mixed[name][rows] = others[name][rows]
    return _with_arrays(reading, mixed)


def changes(reading: Reading, amount: Sequence[float], elements: Elements = None) -> FloatArray:
    """Give what an amount changes in each value of a reading.

    Args:
        reading: the reading that is to be changed.
        amount: as `AMOUNTS` says; of taxels and joints one number for all values or positions, or
            one for each, of joints then for each velocity, then effort.
        elements: the taxels or joints that the amount is for.

    Returns:
        As `added` takes it: shape (n, 3) of points and markers, (h, w) of a depth image, (k, n) of
        n taxels or joints in k arrays, else (6,).

    Raises:
        ConfigurationError: the amount does not fit the reading.
    """
    check_amount(type(reading), reading.label, amount)
    numbers = np.array(amount, dtype=np.float64)
    match reading:
        case Wrench() | Twist():
            return numbers
        case Odometry() | ObjectPose() | Transform():
            return np.pad(numbers, (0, 6 - len(numbers)))
        case PointCloud():
            return np.broadcast_to(numbers, reading.points.shape)
        case Markers():
            return np.broadcast_to(numbers, reading.positions.shape)
        case DepthImage():
            return np.broadcast_to(numbers, reading.depth.shape)
    return _by_element(reading, numbers, _rows(reading, elements))


def check_amount(kind: type[Reading], label: str, amount: Sequence[float]) -> None:
    """Refuse an amount that does not fit a kind of reading.

    Raises:
        ConfigurationError: it has too few or too many numbers.
    """
    for known, (counts, what) in AMOUNTS.items():
        if issubclass(kind, known) and len(amount) not in counts:
            raise ConfigurationError(f"{label} takes {what}; it was given {len(amount)}", "amount")


def added(reading: Reading, change: FloatArray) -> Reading:
    """Add to the values of a reading.

    Pixels without a return keep none, and one that would get a depth of 0 or less loses it. A pose
    is turned by a rotation vector about the axes of its frame. The velocities of an odometry, and
    the colours and the mask of an image stay.

    Args:
        reading: the reading.
        change: what to add, of the shape that `changes` gives.
    """
    match reading:
        case Wrench():
            return replace(
                reading, force=reading.force + change[:3], torque=reading.torque + change[3:]
            )
        case Twist():
            return replace(
                reading, linear=reading.linear + change[:3], angular=reading.angular + change[3:]
            )
        case TactileImage() | JointState() | JointCommand():
            row_of = dict(zip(_element_arrays(reading), change, strict=True))
            arrays = _arrays(reading)
            return _with_arrays(reading, {name: arrays[name] + row_of[name] for name in arrays})
        case Odometry() | ObjectPose() | Transform():
            orientation = _turned(reading.orientation, change[3:])
            return replace(reading, position=reading.position + change[:3], orientation=orientation)
        case PointCloud():
            return replace(reading, points=reading.points + change)
        case Markers():
            return replace(reading, positions=reading.positions + change)
        case DepthImage():
            depth = reading.depth
            shifted = np.where(depth > 0.0, np.maximum(depth + change, 0.0), depth)
            return replace(reading, depth=shifted)
    raise _unknown(reading)


def moved(reading: Reading, pose: Pose) -> Reading:
    """Move all that a reading tells rigidly in its frame, as a wrong mounting does.

    With the rotation R and the shift t of the pose, a place p is told at R p + t; a wrench becomes
    (R f, R τ + t x R f), a twist (R v + t x R ω, R ω). Velocities of an odometry stay, for they are
    in the child frame.

    Args:
        reading: the reading.
        pose: shape (4, 4), the move [m].
    """
    turn, shift = pose[:3, :3], pose[:3, 3]
    match reading:
        case Wrench():
            force = turn @ reading.force
            return replace(
                reading, force=force, torque=turn @ reading.torque + np.cross(shift, force)
            )
        case Twist():
            angular = turn @ reading.angular
            return replace(
                reading, linear=turn @ reading.linear + np.cross(shift, angular), angular=angular
            )
        case Odometry() | ObjectPose() | Transform():
            from scipy.spatial.transform import Rotation

            turned = Rotation.from_matrix(turn) * Rotation.from_quat(reading.orientation)
            return replace(
                reading, position=turn @ reading.position + shift, orientation=turned.as_quat()
            )
        case PointCloud():
            return replace(reading, points=_moved_rows(pose, reading.points))
        case Markers():
            return replace(reading, positions=_moved_rows(pose, reading.positions))
    raise _unknown(reading)


def _element_arrays(reading: Reading) -> tuple[str, ...]:
    """Give the names of the arrays that hold one number for each element."""
    for kind, names in ELEMENT_ARRAYS.items():
        if isinstance(reading, kind):
            return names
    raise _unknown(reading)


def _arrays(reading: Reading) -> dict[str, FloatArray]:
    """Give those arrays by name; a robot may not tell velocities or efforts."""
    given = ((name, getattr(reading, name)) for name in _element_arrays(reading))
    return {name: array for name, array in given if array is not None}


def _with_arrays(reading: Reading, arrays: dict[str, Any]) -> Reading:
    return replace(reading, **arrays)


def _rows(reading: Reading, elements: Elements) -> NDArray[np.intp]:
    """Give the indices of taxels or joints; refuse those that do not exist."""
    count = len(next(iter(_arrays(reading).values())))
    if elements is None:
        return np.arange(count)
    if max(elements) >= count:
        raise ConfigurationError(
            f"{reading.label} has {count}, counted from 0; there is no {max(elements)}", "elements"
        )
    return np.array(elements, dtype=np.intp)


def _by_element(reading: Reading, numbers: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
    """Spread an amount over taxels or joints: a row for each array of the reading."""
    names, arrays = _element_arrays(reading), _arrays(reading)
    table = np.zeros((len(names), len(_rows(reading, None))))
    if len(numbers) == 1:
        table[0, rows] = numbers
        return table
    fitting = [count * len(rows) for count in range(1, len(names) + 1)]
    if len(numbers) not in fitting:
        counts = " or ".join(str(count) for count in sorted({1, *fitting}))
        raise ConfigurationError(
            f"{reading.label} takes {counts} numbers; it was given {len(numbers)}", "amount"
        )
    given = numbers.reshape(-1, len(rows))
    table[: len(given), rows] = given
    for name, row in zip(names, table, strict=True):
        if name not in arrays and row.any():
            raise ConfigurationError(f"{reading.label} has no {name} to change", "amount")
    return table


def _turned(orientation: FloatArray, turn: FloatArray) -> FloatArray:
    """Turn a quaternion by a rotation vector [rad]."""
    if not turn.any():
        return orientation
    from scipy.spatial.transform import Rotation

    return (Rotation.from_rotvec(turn) * Rotation.from_quat(orientation)).as_quat()


def _moved_rows(pose: Pose, points: FloatArray) -> FloatArray:
    """Move the points that there are; a lost one stays lost."""
    there = np.isfinite(points).all(axis=1)
    result = points.copy()
    result[there] = points_in(pose, points[there])
    return result


def _unknown(reading: Reading) -> ConfigurationError:
    return ConfigurationError(f"this fault does not know what to change in {reading.label}")
