"""Series of samples, and their readings in order of stamps."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

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
        origin: the file of the samples.
        stamps: shape (n,) [ns], in the order of the file.
        values: shape (n, k).
        rows: shape (n,), the row of each in the file, counted from 1.
        make: the reading of one sample, from its stamp [s] and values (k,).
    """

    origin: str
    stamps: StampArray
    values: FloatArray
    rows: NDArray[np.int64]
    make: Callable[[float, FloatArray], Reading]


LEAST_RATE: Final = 1e-6
"""The lowest rate of samples [Hz]; a lower one is damage, or its stamps would leave every clock."""


def even_stamps(count: int, rate: float, start: float = 0.0) -> StampArray:
    """`count` stamps [ns] at `rate` [Hz], the first at `start` [s]."""
    return np.rint((start + np.arange(count) / rate) * NANOSECONDS_PER_SECOND).astype(np.int64)


def first_stamp(series: Sequence[Series]) -> int:
    """The earliest stamp [ns] of all; 0 when there is no sample."""
    return min((int(samples.stamps.min()) for samples in series if samples.stamps.size), default=0)


def merged(series: Sequence[Series], epoch_ns: int) -> Iterator[Reading]:
    """The readings of all series in order of their stamps.

    Readings of one stamp come in the order of the series, those of one series in that of the file.

    Args:
        series: the samples.
        epoch_ns: the origin of the readings' seconds [ns].

    Raises:
        RecordingError: a sample is invalid for its sensor.
    """
    if not series:
        return
    stamps = np.concatenate([samples.stamps for samples in series])
    owners = np.repeat(np.arange(len(series)), [samples.stamps.size for samples in series])
    indices = np.concatenate([np.arange(samples.stamps.size) for samples in series])
    order = np.argsort(stamps, kind="stable")
    seconds = (stamps[order] - epoch_ns) / NANOSECONDS_PER_SECOND
    samples = zip(seconds, owners[order], indices[order], strict=True)
    for second, owner, index in samples:
        source = series[owner]
        try:
            yield source.make(float(second), source.values[index])
        except InvalidReadingError as error:
            raise RecordingError(f"{source.origin}, row {source.rows[index]}: {error}") from None
