"""What came of each topic, how regularly, and what was lost: the table that closes a replay."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import final

from contactfusion.readings import Reading

LEARNT = 200
"""So many intervals tell the period of a sensor."""
GAP = 1.5
"""An interval of more than so many periods is a gap: readings were dropped."""


@final
@dataclass
class SensorTally:
    """The readings of one sensor, counted as they pass.

    Attributes:
        kind: of its readings.
        readings: how many came.
        first: the first stamp [s].
        last: the last stamp [s].
        dropped: how many more would have come in its gaps.
        longest: the longest interval [s].
    """

    kind: str
    readings: int = 0
    first: float = math.nan
    last: float = math.nan
    dropped: int = 0
    longest: float = 0.0
    _period: float = math.nan
    _intervals: list[float] = field(default_factory=list)

    def add(self, stamp: float) -> None:
        """Count a reading [s]; stamps rise."""
        if self.readings:
            self._pass(stamp - self.last)
        else:
            self.first = stamp
        self.readings += 1
        self.last = stamp

    def close(self) -> None:
        """Learn the period of a sensor that told little."""
        if math.isnan(self._period) and self._intervals:
            self._learn()

    @property
    def rate(self) -> float:
        """Readings a second, over all its time; NaN before the second."""
        span = self.last - self.first
        return (self.readings - 1) / span if span > 0.0 else math.nan

    def _pass(self, interval: float) -> None:
        self.longest = max(self.longest, interval)
        if math.isnan(self._period):
            self._intervals.append(interval)
            if len(self._intervals) == LEARNT:
                self._learn()
        else:
            self._judge(interval)

    def _learn(self) -> None:
        self._period = median(self._intervals)
        for interval in self._intervals:
            self._judge(interval)
        self._intervals.clear()

    def _judge(self, interval: float) -> None:
        if self._period > 0.0 and interval > GAP * self._period:
            self.dropped += round(interval / self._period) - 1


@final
class Tally:
    """Counts readings by sensor and kind, in constant memory."""

    def __init__(self) -> None:
        self.streams: dict[str, SensorTally] = {}
        self.kinds: dict[tuple[str, type[Reading]], int] = {}
        """How many readings came, by sensor and type."""

    def add(self, reading: Reading) -> None:
        """Count a reading."""
        key = reading.sensor, type(reading)
        self.kinds[key] = self.kinds.get(key, 0) + 1
        name = reading.sensor or type(reading).__name__
        stream = self.streams.get(name)
        if stream is None:
            stream = self.streams[name] = SensorTally(type(reading).__name__)
        stream.add(reading.stamp)

    @property
    def span(self) -> float:
        """How long the recording is [s]; 0 when nothing came."""
        streams = [one for one in self.streams.values() if one.readings]
        if not streams:
            return 0.0
        return max(one.last for one in streams) - min(one.first for one in streams)

    def table(self, troubles: Mapping[str, str]) -> Iterator[str]:
        """Give the lines of the table.

        Args:
            troubles: what its reader met, by sensor.
        """
        rows = [("input", "kind", "readings", "rate Hz", "dropped", "longest gap s", "trouble")]
        for name, stream in sorted(self.streams.items()):
            stream.close()
            rate = "-" if math.isnan(stream.rate) else f"{stream.rate:.4g}"
            counts = f"{stream.readings}", rate, f"{stream.dropped}", f"{stream.longest:.3f}"
            rows.append((name, stream.kind, *counts, troubles.get(name, "")))
        for name in sorted(set(troubles) - set(self.streams)):
            if troubles[name]:
                rows.append((name, "-", "0", "-", "-", "-", troubles[name]))
        widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
        for row in rows:
            cells = [
                cell.ljust(width) if column < 2 else cell.rjust(width)
                for column, (cell, width) in enumerate(zip(row[:-1], widths, strict=True))
            ]
            yield "  ".join([*cells, row[-1]]).rstrip()
