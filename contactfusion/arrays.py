"""Arrays as fields of frozen data: checked, converted and made read-only on entry."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

FloatArray = NDArray[np.float64]
SHORT = 8192
"""The greatest size of arrays whose product is never shared among threads."""


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
        finite: whether NaN and infinity are refused.

    Raises:
        error: the shape differs, the values are no numbers, or a number is not finite.
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
    if finite and not _is_finite(array):
        index = np.argwhere(~np.isfinite(array))[0]
        raise error(f"row {index[0]} of the {name} is not finite: {array[index[0]]}")
    return array if isinstance(array.base, bytes) and array.flags.c_contiguous else frozen(array)


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """A contiguous copy that can never be written: its numbers are those of a bytes object.

    An array that owns its numbers can be made writeable again by any holder.
    """
    return np.ndarray(array.shape, array.dtype, array.tobytes())


def _is_finite(array: NDArray[Any]) -> bool:
    # A sum of squares that is finite is one of finite numbers, and takes a fifth of the time;
    # of a long array the library would share it among threads, which takes longer.
    if array.size <= SHORT and math.isfinite(np.vdot(array, array)):
        return True
    return bool(np.isfinite(array).all())


def _fits(have: tuple[int, ...], want: tuple[int | None, ...]) -> bool:
    return len(have) == len(want) and all(
        b is None or a == b for a, b in zip(have, want, strict=True)
    )


def finite_number(value: float, name: str, error: type[Exception]) -> float:
    """The number as a float; raises `error` when it is none, or not finite."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise error(f"{name} is not a number: {value!r}") from None
    if not math.isfinite(number):
        raise error(f"{name} is not finite: {number}")
    return number
