"""Stamps: seconds at the interface, int64 nanoseconds inside, rounded once."""

from contactfusion.errors import TimeError

NANOSECONDS_PER_SECOND = 1_000_000_000
LONGEST_SECONDS = 4.0e9
"""Stamps, timeouts and their sums stay below this [s], so that int64 nanoseconds hold them."""
LEAP = 2.0
"""A stamp further ahead of a step is of another clock [s]; recorded transforms come 1 s early."""


def to_nanoseconds(seconds: float) -> int:
    """Seconds, rounded to nanoseconds.

    Raises:
        TimeError: the number is NaN, or too large for int64 nanoseconds.
    """
    if not abs(seconds) <= LONGEST_SECONDS:
        raise TimeError(f"{seconds} s is no stamp: it must lie within ±{LONGEST_SECONDS:.0e} s")
    return round(seconds * NANOSECONDS_PER_SECOND)


def to_seconds(nanoseconds: int) -> float:
    """Nanoseconds as seconds."""
    return nanoseconds / NANOSECONDS_PER_SECOND
