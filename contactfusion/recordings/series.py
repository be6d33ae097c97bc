"""Series of samples, and the readings that they make in order of their stamps."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import InvalidReadingError, RecordingError
from contactfusion.readings import Reading
from contactfusion.time import NANOSECONDS_PER_SECOND

StampArray = NDArray[np.int64]
"""Stamps of shape (n,) in the clock of the recording [ns]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """The samples of one sensor.

    Attributes:
        origin: the file that they come from.
        stamps: shape (n,) [ns], in the order of the file.
        values: shape (n, k).
        rows: shape (n,), the row of the file that each came from, counted from 1.
        make: gives the reading for a stamp [s] and the values (k,) of one sample.
    """

    origin: str
    stamps: StampArray
    values: FloatArray
    rows: NDArray[np.int64]
    make: Callable[[float, FloatArray], Reading]


def even_stamps(count: int, rate: float, start: float = 0.0) -> StampArray:
    """Give `count` stamps [ns] at `rate` [Hz], the first at `start` [s]."""
    return np.rint((start + np.arange(count) / rate) * NANOSECONDS_PER_SECOND).astype(np.int64)


def first_stamp(series: Sequence[Series]) -> int:
    """Give the earliest stamp [ns] of all; 0 when there is no sample."""
    return min((int(one.stamps.min()) for one in series if one.stamps.size), default=0)


def merged(series: Sequence[Series], epoch_ns: int) -> Iterator[Reading]:
    """Give the readings of all series in order of their stamps.

    Readings of one stamp come in the order of the series, those of one series in that of the file.

    Args:
        series: the samples.
        epoch_ns: where the readings' seconds start [ns].

    Raises:
        RecordingError: a sample is none that its sensor can have given.
    """
    if not series:
        return
    stamps = np.concatenate([one.stamps for one in series])
    owners = np.repeat(np.arange(len(series)), [one.stamps.size for one in series])
    places = np.concatenate([np.arange(one.stamps.size) for one in series])
    order = np.argsort(stamps, kind="stable")
    seconds = (stamps[order] - epoch_ns) / NANOSECONDS_PER_SECOND
    samples = zip(seconds, owners[order], places[order], strict=True)
    for second, owner, place in samples:
        one = series[owner]
        try:
            yield one.make(float(second), one.values[place])
        except InvalidReadingError as error:
            raise RecordingError(f"{one.origin}, row {one.rows[place]}: {error}") from None
