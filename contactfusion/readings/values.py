"""How faults change the values of readings, by how a kind of reading holds its numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from typing import Any, Generic

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.frames import Pose, points_in
from contactfusion.readings.reading import R, Reading

Elements = tuple[int, ...] | None
"""Taxels, joints or the like, counted from 0; None: all."""


class Change(StrEnum):
    """What a fault does to the values of a reading."""

    ZEROED = "zeroed"
    ADDED = "added"
    MOVED = "moved"


MOVE_ITS_FRAME = {
    Change.MOVED: "which tells no places; change the pose of its frame under 'frames' instead"
}
"""Why a rigid move makes no sense for most kinds of reading."""


class Values(Generic[R]):
    """What faults can change in one kind of reading; here nothing.

    Attributes:
        senseless: the changes that make no sense, each with why and what to take instead: a clause
            that begins with "which".
        counts: how many numbers an amount may have; empty: that depends on the reading.
        meaning: what these numbers are, with their units.
        has_elements: whether single elements can fail.
    """

    senseless: Mapping[Change, str] = {}
    counts: tuple[int, ...] = ()
    meaning: str = ""
    has_elements: bool = False

    def check_amount(self, amount: Sequence[float], label: str) -> None:
        """Refuse an amount that does not fit the kind of reading.

        Args:
            amount: the numbers.
            label: the name of the reading in a sentence.

        Raises:
            ConfigurationError: they are too few or too many.
        """
        if self.counts and len(amount) not in self.counts:
            raise ConfigurationError(
                f"{label} takes {self.meaning}; it was given {len(amount)}", "amount"
            )

    def zeroed(self, reading: R) -> R:
        """The reading of a driver that fills its message with zeros.

        Raises:
            ConfigurationError: what they would change is not known.
        """
        raise _unknown(reading)

    def changes(self, reading: R, amount: Sequence[float], elements: Elements) -> FloatArray:
        """What an amount changes in each value of a reading.

        Args:
            reading: the reading that is to be changed.
            amount: numbers that fit it.
            elements: those that the amount is for.

        Returns:
            As `added` takes it. Noise is drawn in this shape.

        Raises:
            ConfigurationError: the amount does not fit the reading.
        """
        raise _unknown(reading)

    def added(self, reading: R, change: FloatArray) -> R:
        """The reading with a change, of the shape that `changes` has, added to its values."""
        raise _unknown(reading)

    def moved(self, reading: R, pose: Pose) -> R:
        """The reading of a sensor in a wrong pose: all moved rigidly in its frame.

        Args:
            reading: the reading.
            pose: shape (4, 4), the move [m]; a position p becomes R p + t.
        """
        raise _unknown(reading)

    def repeated(self, reading: R, other: R, elements: Elements = None) -> R:
        """The values of another reading with the stamp of this one.

        Args:
            reading: its stamp is kept.
            other: of the same sensor.
            elements: those that are the other's; None: all.

        Raises:
            ConfigurationError: there is no such element.
        """
        if elements is None:
            return replace(other, stamp=reading.stamp)
        raise _unknown(reading)


class ElementValues(Values[R]):
    """Arrays that hold one number for each element, such as a taxel or a joint.

    Args:
        names: the fields of the arrays, shape (n,) each; all but the first may be None.
        senseless: as `Values.senseless`.
    """

    has_elements = True

    def __init__(self, *names: str, senseless: Mapping[Change, str] = MOVE_ITS_FRAME) -> None:
        self._names, self.senseless = names, senseless

    def zeroed(self, reading: R) -> R:
        """Zeros in all arrays."""
        zeros = {name: np.zeros_like(array) for name, array in self._arrays(reading).items()}
        return with_arrays(reading, zeros)

    def changes(self, reading: R, amount: Sequence[float], elements: Elements) -> FloatArray:
        """A row for each array, shape (k, n).

        The amount is one number for the elements of the first array, or one for each of them, then
        for each of the second array, and so on.
        """
        numbers, rows = np.array(amount, dtype=np.float64), self._rows(reading, elements)
        arrays = self._arrays(reading)
        table = np.zeros((len(self._names), len(self._rows(reading, None))))
        if len(numbers) == 1:
            table[0, rows] = numbers
            return table
        fitting = [count * len(rows) for count in range(1, len(self._names) + 1)]
        if len(numbers) not in fitting:
            counts = " or ".join(str(count) for count in sorted({1, *fitting}))
            raise ConfigurationError(
                f"{reading.label} takes {counts} numbers; it was given {len(numbers)}", "amount"
            )
        given = numbers.reshape(-1, len(rows))
        table[: len(given), rows] = given
        for name, row in zip(self._names, table, strict=True):
            if name not in arrays and row.any():
                raise ConfigurationError(f"{reading.label} has no {name} to change", "amount")
        return table

    def added(self, reading: R, change: FloatArray) -> R:
        """A row added to each array that there is."""
        row_of = dict(zip(self._names, change, strict=True))
        arrays = self._arrays(reading)
        return with_arrays(reading, {name: arrays[name] + row_of[name] for name in arrays})

    def repeated(self, reading: R, other: R, elements: Elements = None) -> R:
        """The values of another reading, or only those of some elements."""
        if elements is None:
            return super().repeated(reading, other)
        rows = self._rows(reading, elements)
        self._rows(other, elements)
        mixed, others = self._arrays(reading), self._arrays(other)
        for name in mixed.keys() & others.keys():
            mixed[name] = mixed[name].copy()
            mixed[name][rows] = others[name][rows]
        return with_arrays(reading, mixed)

    def _arrays(self, reading: R) -> dict[str, FloatArray]:
        """The arrays by name; a robot may not report velocities or efforts."""
        given = ((name, getattr(reading, name)) for name in self._names)
        return {name: array for name, array in given if array is not None}

    def _rows(self, reading: R, elements: Elements) -> NDArray[np.intp]:
        """The indices of elements.

        Raises:
            ConfigurationError: there is no such element.
        """
        count = len(next(iter(self._arrays(reading).values())))
        if elements is None:
            return np.arange(count)
        if max(elements) >= count:
            raise ConfigurationError(
                f"{reading.label} has {count}, counted from 0; there is no {max(elements)}",
                "elements",
            )
        return np.array(elements, dtype=np.intp)


class PointValues(Values[R]):
    """An array of points; lost ones are NaN, and stay lost.

    Args:
        name: the field of the array, shape (n, 3) [m].
    """

    counts = (1, 3)
    meaning = "1 or 3 numbers: x, y, z [m]"

    def __init__(self, name: str) -> None:
        self._name = name

    def zeroed(self, reading: R) -> R:
        """As many points, all at the origin."""
        return with_arrays(reading, {self._name: np.zeros_like(getattr(reading, self._name))})

    def changes(self, reading: R, amount: Sequence[float], elements: Elements) -> FloatArray:
        """A row for each point, shape (n, 3)."""
        numbers = np.array(amount, dtype=np.float64)
        return np.broadcast_to(numbers, getattr(reading, self._name).shape)

    def added(self, reading: R, change: FloatArray) -> R:
        """The points, shifted each by its row."""
        return with_arrays(reading, {self._name: getattr(reading, self._name) + change})

    def moved(self, reading: R, pose: Pose) -> R:
        """The points that there are, moved."""
        points = getattr(reading, self._name)
        there = np.isfinite(points).all(axis=1)
        result = points.copy()
        result[there] = points_in(pose, points[there])
        return with_arrays(reading, {self._name: result})


class ScrewValues(Values[R]):
    """A pair of vectors: a free one, and one about the origin of the frame.

    A rigid move with the rotation R and the shift t takes a wrench to (R f, R τ + t x R f), a twist
    to (R v + t x R ω, R ω).

    Args:
        first: the field of the first vector of an amount, shape (3,).
        second: that of the second vector, shape (3,).
        free: which of the two no shift of the origin changes.
        meaning: what the six numbers of an amount are, with their units.
    """

    counts = (6,)

    def __init__(self, first: str, second: str, free: str, meaning: str) -> None:
        self._first, self._second, self._free = first, second, free
        self._bound = second if free == first else first
        self.meaning = meaning

    def zeroed(self, reading: R) -> R:
        """Zeros in both vectors."""
        return with_arrays(reading, {self._first: np.zeros(3), self._second: np.zeros(3)})

    def changes(self, reading: R, amount: Sequence[float], elements: Elements) -> FloatArray:
        """The amount itself, shape (6,)."""
        return np.array(amount, dtype=np.float64)

    def added(self, reading: R, change: FloatArray) -> R:
        """The vectors with three numbers added to each."""
        first, second = getattr(reading, self._first), getattr(reading, self._second)
        return with_arrays(
            reading, {self._first: first + change[:3], self._second: second + change[3:]}
        )

    def moved(self, reading: R, pose: Pose) -> R:
        """Both vectors turned, and the bound one taken to the shifted origin."""
        turn, shift = pose[:3, :3], pose[:3, 3]
        free = turn @ getattr(reading, self._free)
        bound = turn @ getattr(reading, self._bound) + np.cross(shift, free)
        return with_arrays(reading, {self._free: free, self._bound: bound})


def with_arrays(reading: R, arrays: Mapping[str, Any]) -> R:
    """A reading with other arrays in some of its fields."""
    return replace(reading, **arrays)


def _unknown(reading: Reading) -> ConfigurationError:
    return ConfigurationError(f"this fault does not know what to change in {reading.label}")
