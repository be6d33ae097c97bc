"""torch, or the sentence that says how to get it."""

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
    """Let torch give the same bits each time: on one thread, by deterministic algorithms only."""
    threads = torch.get_num_threads()
    strict = torch.are_deterministic_algorithms_enabled()
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    try:
        yield
    finally:
        torch.use_deterministic_algorithms(strict)
        torch.set_num_threads(threads)
