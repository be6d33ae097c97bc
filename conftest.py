"""What holds for every test: the same random numbers each time, and no silent nonsense in numpy."""

import random
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
settings.load_profile("repeatable")


@pytest.fixture(autouse=True)
def repeatable() -> Iterator[None]:
    """Seed what anybody might draw from, and let numpy raise where it would give NaN or infinity.

    An underflow is no nonsense: a likelihood of 1e-46 is 0 as float32.
    """
    random.seed(0)
    np.random.seed(0)
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        yield
