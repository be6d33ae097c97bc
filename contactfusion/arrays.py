"""Arrays as fields of frozen data: checked, converted and made read-only on entry."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

FloatArray = NDArray[np.float64]
SHORT = 8192
"""The greatest size of arrays whose product is never shared among threads."""
LARGEST = 1e30
"""A greater number measures nothing, and its powers are soon infinite."""


def frozen_array(
    value: ArrayLike,
    shape: tuple[int | None, ...],
    name: str,
    error: type[Exception],
    *,
    dtype: DTypeLike = np.float64,
    finite: bool = True,
) -> NDArray[Any]:
    """An array of the wanted shape that can never be written, see `frozen`.

    An array that is frozen already is shared, any other input is copied.

    Args:
        value: the input.
        shape: the wanted shape; None: any length.
        name: in an error.
        error: the type of error to raise.
        dtype: the wanted type of the elements.
        finite: whether NaN, infinity and numbers beyond 1e30 are refused.

    Raises:
        error: the shape differs, the values are no numbers, or one is not finite, or too large.
    """
    try:
        array = np.asarray(value, dtype=dtype)
    except (TypeError, ValueError, OverflowError) as cause:
        raise error(f"{name} are not numbers: {cause}") from None
    if array.shape != shape and not _fits(array.shape, shape):
        if array.size == 0 and shape[0] is None:
            array = array.reshape(tuple(0 if want is None else want for want in shape))
        else:
            wanted = ", ".join("n" if want is None else str(want) for want in shape)
            wanted = f"({wanted},)" if len(shape) == 1 else f"({wanted})"
            raise error(f"{name} have shape {array.shape}, not {wanted}")
    if finite and not _is_measurable(array):
        row = np.argwhere(~(np.abs(array) <= LARGEST))[0][0]
        fault = "is too large" if np.isfinite(array[row]).all() else "is not finite"
        raise error(f"row {row} of the {name} {fault}: {array[row]}")
    return array if isinstance(array.base, bytes) and array.flags.c_contiguous else frozen(array)


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """A contiguous copy that can never be written: its numbers are those of a bytes object.

    An array that owns its numbers can be made writeable again by any holder.
    """
    return np.ndarray(array.shape, array.dtype, array.tobytes())


def _is_measurable(array: NDArray[Any]) -> bool:
    # A small sum of squares is one of small numbers, and takes a fifth of the time; of a long
    # array the library would share it among threads, which takes longer.
    if array.size <= SHORT and np.vdot(array, array) <= LARGEST**2:
        return True
    return bool((np.abs(array) <= LARGEST).all())


def _fits(have: tuple[int, ...], want: tuple[int | None, ...]) -> bool:
    return len(have) == len(want) and all(
        b is None or a == b for a, b in zip(have, want, strict=True)
    )


def finite_number(value: float, name: str, error: type[Exception]) -> float:
    """The number as a float; raises `error` when it is none, not finite, or beyond 1e30."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise error(f"{name} is not a number: {value!r}") from None
    if not math.isfinite(number):
        raise error(f"{name} is not finite: {number}")
    if abs(number) > LARGEST:
        raise error(f"{name} is too large: {number}")
    return number
