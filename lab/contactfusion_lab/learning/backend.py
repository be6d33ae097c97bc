"""torch, or the error that names the extra to install."""

from collections.abc import Iterator
from contextlib import contextmanager

from contactfusion.errors import missing_extra

try:
    import torch
except ImportError:
    raise missing_extra("torch", "learn") from None

__all__ = ["repeatable", "torch"]


@contextmanager
def repeatable() -> Iterator[None]:
    """A context in which torch is deterministic: one thread, deterministic algorithms only."""
    threads = torch.get_num_threads()
    strict = torch.are_deterministic_algorithms_enabled()
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    try:
        yield
    finally:
        torch.use_deterministic_algorithms(strict)
        torch.set_num_threads(threads)
