"""Processes that do linear algebra in one thread each."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

POOLS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Let processes that begin within have one thread, unless the user says how many.

    There are as many workers as there are cores to use; a second thread of one would wait for the
    others, and a cycle of 5 ms would take 25.
    """
    mine = [name for name in POOLS if name not in os.environ]
    os.environ.update(dict.fromkeys(mine, "1"))
    try:
        yield
    finally:
        for name in mine:
            os.environ.pop(name, None)
