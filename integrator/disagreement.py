"""Sources that lie apart from each other for long, in the same direction, by more than they state.

Noise averages out over time; the error of a mounting, of a zero or of a map does not.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.integrator.entries import Member
from contactfusion.time import NANOSECONDS_PER_SECOND

PROBABLE = 0.5
"""Contacts that are less probable are not compared."""
REMEMBERED = 10.0
"""Time in contact over which offsets are averaged [s]."""
LONG = 2.0
"""The least time in contact that two sources are compared for [s]."""
APART = 2.0
"""A mean offset of so many stated standard deviations is a disagreement; it ends at half of it."""
MOST = 32
"""So many sources of a contact, the first by name, are compared at most: each with each other."""
GAP = 0.5
"""Steps that are further apart count as no time in contact [s]."""


@dataclass
class Pair:
    """Two sources that locate the same contacts.

    Attributes:
        offset: shape (3,), mean of where the second finds them, from where the first does [m].
        variance: mean of what both state of it, by axis [m²].
        seconds: time in contact for which they were compared [s].
        apart: whether they disagree.
    """

    offset: FloatArray
    variance: float
    seconds: float = 0.0
    apart: bool = False

    @property
    def ratio(self) -> float:
        """The mean offset, in stated standard deviations."""
        return float(np.linalg.norm(self.offset)) / float(np.sqrt(self.variance))


class Disagreement:
    """Watches every two sources that locate the same contacts."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all offsets."""
        self._pairs: dict[tuple[str, str], Pair] = {}
        self._now: int | None = None

    def forget(self, source: str) -> None:
        """Forget the offsets of a source, which may stand elsewhere when it comes again."""
        self._pairs = {names: pair for names, pair in self._pairs.items() if source not in names}

    def watch(self, now: int, members: Sequence[Member]) -> Iterator[tuple[str, str]]:
        """The pairs that begin to disagree: the second source, and a sentence.

        Args:
            now: time of the step [ns].
            members: the contacts of the step.
        """
        elapsed = 0.0 if self._now is None else (now - self._now) / NANOSECONDS_PER_SECOND
        elapsed, self._now = (elapsed if elapsed <= GAP else 0.0), now
        apart: dict[tuple[str, str], list[tuple[FloatArray, float]]] = {}
        for member in members:
            if member.contact.likelihood < PROBABLE:
                continue
            centres = sorted(member.centres.items())[:MOST]
            for (first, (here, unsure)), (second, (there, other)) in itertools.combinations(
                centres, 2
            ):
                found = there - here, unsure**2 + other**2
                apart.setdefault((first, second), []).append(found)
        for (first, second), offsets in apart.items():
            offset = np.mean([each for each, _ in offsets], axis=0)
            variance = float(np.mean([each for _, each in offsets]))
            pair = self._averaged((first, second), offset, variance, elapsed)
            if pair.apart:
                pair.apart = pair.ratio > APART / 2.0
            elif pair.seconds >= LONG and pair.ratio > APART:
                pair.apart = True
                yield second, _sentence(first, second, pair)

    def _averaged(
        self, names: tuple[str, str], offset: FloatArray, variance: float, elapsed: float
    ) -> Pair:
        """Add an offset [m] with its variance by axis [m²] to the mean of a pair."""
        pair = self._pairs.setdefault(names, Pair(offset, variance))
        pair.seconds += elapsed
        part = elapsed / max(min(pair.seconds, REMEMBERED), elapsed, 1e-9)
        pair.offset = pair.offset + part * (offset - pair.offset)
        pair.variance += part * (variance - pair.variance)
        return pair


def _sentence(first: str, second: str, pair: Pair) -> str:
    x, y, z = 1e3 * pair.offset
    away = 1e3 * float(np.linalg.norm(pair.offset))
    return (
        f"'{second}' finds contacts {away:.0f} mm from where '{first}' does, "
        f"at ({x:.0f}, {y:.0f}, {z:.0f}) mm on average of {pair.seconds:.0f} s in contact: "
        f"{pair.ratio:.1f} times what both state; is one misplaced, or not calibrated?"
    )
