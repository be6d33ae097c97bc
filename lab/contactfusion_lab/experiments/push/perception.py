"""How well contacts are perceived in closed loop: over all cycles of many pushes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion_lab.experiments.measures import CONFIDENCE, RESAMPLES
from contactfusion_lab.experiments.push.trial import Track


@dataclass(frozen=True)
class Perception:
    """What is perceived against what is true; each with its interval over resampled pushes.

    Attributes:
        location_rmse: root mean square error of l̂ where both tell of a contact [m].
        type_accuracy: of none, point and line.
        contact_accuracy: of contact or none.
    """

    location_rmse: tuple[float, float, float]
    type_accuracy: tuple[float, float, float]
    contact_accuracy: tuple[float, float, float]


def perception(tracks: Sequence[Track], seed: int) -> Perception:
    """Pool the cycles of pushes; the first of a push is before anything moves, and left out.

    Args:
        tracks: at least one.
        seed: of the bootstrap over pushes.
    """
    counts = np.array([_counted(track) for track in tracks])
    rows = np.random.default_rng(seed).integers(len(tracks), size=(RESAMPLES, len(tracks)))
    drawn = np.array([_measured(counts[row].sum(axis=0)) for row in rows])
    found = _measured(counts.sum(axis=0))
    return Perception(*(_interval(one, some) for one, some in zip(found, drawn.T, strict=True)))


def _interval(found: float, drawn: FloatArray) -> tuple[float, float, float]:
    """Give a figure with its interval; all are NaN where nothing was located."""
    there = drawn[np.isfinite(drawn)]
    if not len(there):
        return found, np.nan, np.nan
    low, high = np.quantile(there, [(1.0 - CONFIDENCE) / 2.0, (1.0 + CONFIDENCE) / 2.0])
    return float(found), float(low), float(high)


def _counted(track: Track) -> FloatArray:
    """Give sums over cycles: squared errors, how many; right types, right contacts, cycles."""
    errors = (track.lateral - track.contact[:, 1])[1:]
    errors = errors[np.isfinite(errors)]
    types = (track.kind == track.estimate)[1:]
    contacts = ((track.kind > 0) == (track.estimate > 0))[1:]
    return np.array([(errors**2).sum(), len(errors), types.sum(), contacts.sum(), len(types)])


def _measured(sums: FloatArray) -> FloatArray:
    squares, located, types, contacts, cycles = sums
    with np.errstate(invalid="ignore"):  # nothing was located: NaN
        return np.array([np.sqrt(squares / located), types / cycles, contacts / cycles])
