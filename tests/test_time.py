"""Seconds outside, nanoseconds inside."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactfusion.errors import TimeError
from contactfusion.time import LONGEST_SECONDS, to_nanoseconds, to_seconds


@given(st.integers(-4 * 10**15, 4 * 10**15))
def test_microseconds_survive_the_way_in_and_out(microseconds: int) -> None:
    seconds = microseconds / 1e6
    assert abs(to_nanoseconds(seconds) - microseconds * 1000) <= 250  # half an ulp of 4e9 s
    assert to_seconds(to_nanoseconds(seconds)) == pytest.approx(seconds, abs=5e-7)


def test_stamps_are_rounded_not_cut() -> None:
    assert to_nanoseconds(0.1 + 0.2) == to_nanoseconds(0.3) == 300_000_000
    assert to_nanoseconds(-0.3) == -300_000_000


@pytest.mark.parametrize("seconds", [math.nan, math.inf, -math.inf, 1e300, 2 * LONGEST_SECONDS])
def test_a_time_that_nanoseconds_cannot_hold_is_refused(seconds: float) -> None:
    with pytest.raises(TimeError, match="is no stamp"):
        to_nanoseconds(seconds)


def test_the_sum_of_the_longest_stamp_and_timeout_fits_into_int64() -> None:
    assert 2 * to_nanoseconds(LONGEST_SECONDS) < 2**63
