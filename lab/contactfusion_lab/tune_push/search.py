"""A cross-entropy search in a space of parameters: draw sets, rate them, move to the best."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.controllers.pushing_parameters import PushingParameters
from contactfusion.errors import ConfigurationError
from contactfusion.files import read_json, write_whole

POPULATION, ELITE = 24, 6
"""Number of sets of a round, and of those that the next round is drawn around."""
SPREAD, LEAST_SPREAD = 0.12, 0.015
"""Spread of the first round, and least spread later, as parts of each parameter's range."""
STEP = 0.7
"""Learning rate of the middle and the spreads towards those of the elite."""
LIMITS: dict[str, tuple[float, float]] = {
    "speed_gain": (0.1, 1.0),
    "slowest": (0.03, 0.15),
    "fastest": (0.1, 0.4),
    "eta": (0.5, 12.0),
    "beta": (0.02, 0.25),
    "k": (10.0, 120.0),
    "near": (0.05, 0.6),
    "heading_gain": (0.2, 0.95),
    "length": (0.015, 0.3),
    "fastest_turn": (0.15, 0.6),
    "realign.enter": (0.12, 0.29),
    "realign.leave": (0.03, 0.28),
    "realign.rate": (1.0, 12.0),
    "realign.turning": (0.02, 1.0),
    "settle": (0.2, 2.5),
    "smoothing": (0.01, 0.4),
}
"""The least and the greatest value of each, searched on a logarithmic scale; speeds are those that
a base of this size drives. Arrival, search and escape stay those of the initial set."""
HYSTERESIS = 0.95
"""`realign.leave` is at most this part of `realign.enter`."""


@dataclass(frozen=True)
class Candidate:
    """A set of parameters that was rated.

    Attributes:
        vector: as returned by `encoded`.
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
    """State of the search; a pure function of seed and rated candidates.

    Args:
        start: shape (n,), the initial set.
        seed: of all random draws.
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
        elite = sorted(candidates, key=lambda candidate: candidate.cost)[:ELITE]
        vectors = np.array([candidate.vector for candidate in elite])
        self.middle += STEP * (vectors.mean(axis=0) - self.middle)
        self.spread += STEP * (vectors.std(axis=0) - self.spread)
        self.spread = np.maximum(self.spread, LEAST_SPREAD)
        self._round += 1


def save_round(candidates: Sequence[Candidate], path: Path) -> None:
    """Write the candidates of a round."""
    write_whole(path, json.dumps([asdict(candidate) for candidate in candidates], indent=1) + "\n")


def load_round(path: Path) -> list[Candidate]:
    """Read the candidates of a round.

    Raises:
        ConfigurationError: the file is damaged.
    """
    try:
        rows = read_json(path)
        return [Candidate(**{**row, "vector": tuple(row["vector"])}) for row in rows]
    except (ValueError, TypeError, KeyError):
        raise ConfigurationError(f"{path} is damaged: remove it, and it is made again") from None


def require_searchable(parameters: PushingParameters) -> None:
    """Make sure that a set can be begun with.

    Raises:
        ConfigurationError: it lacks something that is searched.
    """
    if parameters.realign is None:
        raise ConfigurationError("a search begins with a set that realigns, such as tuned")


def encoded(parameters: PushingParameters) -> FloatArray:
    """A set as a vector in [0, 1]: 0 the least, 1 the greatest value of each parameter."""
    held = parameters.model_dump()
    return np.array([_place(_get(held, name), *limits) for name, limits in LIMITS.items()])


def decoded(vector: FloatArray, start: PushingParameters) -> PushingParameters:
    """The set of a vector; what is not searched is that of `start`.

    Args:
        vector: shape (n,), in [0, 1].
        start: the set that is begun with.
    """
    held = start.model_dump()
    for (name, (low, high)), share in zip(LIMITS.items(), vector, strict=True):
        value = low * (high / low) ** float(np.clip(share, 0.0, 1.0))
        _set(held, name, float(f"{value:.3g}"))
    realign = held["realign"]
    realign["leave"] = min(realign["leave"], float(f"{HYSTERESIS * realign['enter']:.3g}"))
    return PushingParameters(**held)


def changes(parameters: PushingParameters, start: PushingParameters) -> dict[str, Any]:
    """The fields in which a set differs, as `controller.parameters` takes them with `like`."""
    held, before = parameters.model_dump(mode="json"), start.model_dump(mode="json")
    return {name: value for name, value in held.items() if value != before[name]}


def _place(value: float | None, low: float, high: float) -> float:
    if value is None:  # a decaying gain: its value at half of the distance
        value = 0.5
    return float(np.clip(np.log(max(value, low) / low) / np.log(high / low), 0.0, 1.0))


def _get(held: dict[str, Any], name: str) -> Any:
    for part in name.split("."):
        held = held[part]
    return held


def _set(held: dict[str, Any], name: str, value: float) -> None:
    *parents, last = name.split(".")
    for part in parents:
        held = held[part]
    held[last] = value
