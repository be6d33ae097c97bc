"""Limits of what input may take: as stated, times `CONTACTFUSION_LIMITS` of the environment."""

import os
from typing import Final

from contactfusion.errors import ConfigurationError

VARIABLE: Final = "CONTACTFUSION_LIMITS"
GREATEST: Final = 1e6


def raised(limit: float) -> float:
    """A limit of memory or time, times the factor that the environment gives, 1 without any.

    Raises:
        ConfigurationError: the factor is no number from 1 to a million.
    """
    text = os.environ.get(VARIABLE, "1")
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not 1.0 <= factor <= GREATEST:
        raise ConfigurationError(
            f"{VARIABLE} is '{text[:40]}', no number from 1 to {GREATEST:,.0f}"
        )
    return limit * factor
