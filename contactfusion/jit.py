"""The decorator of the compiled kernels."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit

P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of arrays; keep the machine code on disk where that can be written.

    numba notices a changed kernel by its own file only. Kernels that call each other therefore
    stand in one module.
    """
    compiled: Any  # numba's own types lose the signature
    try:
        compiled = njit(function, cache=True, nogil=True, error_model="numpy")
    except RuntimeError:  # "no locator available": no folder can take the cache
        compiled = njit(function, nogil=True, error_model="numpy")
    return cast("Callable[P, R]", compiled)
