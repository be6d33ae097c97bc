"""Limits of what input may take, and the factor that raises them."""

import time

import pytest

from contactfusion.confined import LimitError, confined
from contactfusion.errors import ConfigurationError
from contactfusion.estimate import too_much
from contactfusion.limits import VARIABLE, raised
from contactfusion.unpacking import most_bytes


@pytest.fixture(autouse=True)
def _plain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)


def test_without_a_factor_limits_are_as_stated() -> None:
    assert raised(2.5) == 2.5


@pytest.mark.parametrize("factor", ["", "many", "0.5", "-1", "nan", "inf", "1e7"])
def test_a_factor_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch, factor: str) -> None:
    monkeypatch.setenv(VARIABLE, factor)
    with pytest.raises(ConfigurationError, match=f"{VARIABLE} is '{factor}', no number from 1 to"):
        raised(1.0)


def test_a_factor_raises_what_is_allocated_and_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    unpacked = most_bytes(1000)
    assert too_much("a crane", 2e7, 250)
    monkeypatch.setenv(VARIABLE, "4")
    assert most_bytes(1000) == 4 * unpacked
    assert not too_much("a crane", 2e7, 250)
    assert "more than 10 GB" in too_much("a crane", 2e8, 250)


def test_a_factor_raises_the_time_of_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("contactfusion.confined.START_SECONDS", 0.0)
    with pytest.raises(LimitError, match="longer than 0 s"):
        confined(time.sleep, 0.0, seconds=0.01)
    monkeypatch.setenv(VARIABLE, "6000")
    assert confined(time.sleep, 0.0, seconds=0.01) is None
