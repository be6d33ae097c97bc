"""A cross-entropy search: draw sets around a middle, rate them, move to the best; repeat."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.files import write_whole

POPULATION, ELITE = 24, 6
"""Sets of a round, and how many of them the next round is drawn around."""
SPREAD, LEAST_SPREAD = 0.12, 0.015
"""Of the first round, and the least later, of each parameter's range."""
STEP = 0.7
"""How far the middle moves to that of the elite, and spreads to theirs."""


@dataclass(frozen=True)
class Candidate:
    """A set of parameters that was rated.

    Attributes:
        vector: as `space.encoded` gives it.
        trials: how many pushes it made.
        successes: how many were true successes.
        cost: mean time, failures as twice the longest [s].
        time: mean of those that succeeded [s]; None if none did.
    """

    vector: tuple[float, ...]
    trials: int
    successes: int
    cost: float
    time: float | None


class Search:
    """What the search believes; a pure function of seed and rated candidates.

    Args:
        start: shape (n,), the set that is begun with.
        seed: of all that is drawn.
    """

    def __init__(self, start: FloatArray, seed: int) -> None:
        self.middle = start.copy()
        self.spread = np.full(len(start), SPREAD)
        self._seed, self._round = seed, 0

    def draw(self) -> FloatArray:
        """Draw the sets of the next round, shape (POPULATION, n); the first is the middle."""
        rng = np.random.default_rng([self._seed, self._round])
        steps = rng.standard_normal((POPULATION, len(self.middle))).clip(-2.0, 2.0)
        steps[0] = 0.0
        drawn: FloatArray = (self.middle + self.spread * steps).clip(0.0, 1.0)
        return drawn

    def learn(self, candidates: Sequence[Candidate]) -> None:
        """Move to the best of a round."""
        elite = sorted(candidates, key=lambda one: one.cost)[:ELITE]
        vectors = np.array([one.vector for one in elite])
        self.middle += STEP * (vectors.mean(axis=0) - self.middle)
        self.spread += STEP * (vectors.std(axis=0) - self.spread)
        self.spread = np.maximum(self.spread, LEAST_SPREAD)
        self._round += 1


def save_round(candidates: Sequence[Candidate], path: Path) -> None:
    """Write the candidates of a round."""
    write_whole(path, json.dumps([asdict(one) for one in candidates], indent=1) + "\n")


def load_round(path: Path) -> list[Candidate]:
    """Read the candidates of a round.

    Raises:
        ConfigurationError: the file is damaged.
    """
    try:
        rows = json.loads(path.read_text())
        return [Candidate(**{**row, "vector": tuple(row["vector"])}) for row in rows]
    except (ValueError, TypeError, KeyError):
        raise ConfigurationError(f"{path} is damaged: remove it, and it is made again") from None
