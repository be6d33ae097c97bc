"""The hypothesis space: the newest entry of every voxel and source, while it lives (SPEC §1)."""

from collections.abc import Mapping, Sequence

import numpy as np

from contactfusion.grid import Grid
from contactfusion.integrator import kernels, store
from contactfusion.integrator.config import IntegratorConfig
from contactfusion.integrator.entries import Entries, Source
from contactfusion.integrator.inbox import Arrival
from contactfusion.integrator.sources import SourceRecord
from contactfusion.integrator.store import Columns, Int64Array
from contactfusion.time import to_nanoseconds

ALWAYS = -(1 << 62)
"""A stamp [ns] before all others."""


class Space:
    """Absorbs accepted clouds and lets old entries die; each step gets entries of its own.

    Args:
        grid: the frame and voxel size.
        config: timeout and expiry.
    """

    def __init__(self, grid: Grid, config: IntegratorConfig) -> None:
        self._grid = grid
        self._by_voxel = config.expiry == "voxel"
        self._voxel_timeout = to_nanoseconds(config.timeout)
        self._columns = _room(0, 0)
        self._ranges: dict[str, tuple[int, int, int]] = {}

    def absorb(
        self, accepted: Mapping[str, list[Arrival]], records: Sequence[SourceRecord], now: int
    ) -> Entries:
        """Merge accepted clouds into the entries, and drop the entries that are too old.

        Args:
            accepted: clouds by source, in order of arrival.
            records: the plugged sources by ascending name.
            now: the step's time [ns].
        """
        arrivals, begin, old = [], [0], []
        rows = 0
        for record in records:
            new = accepted.get(record.name, [])
            kept = self._ranges.get(record.name, (0, 0, -1))
            if record.replace and new:
                new, kept = new[-1:], (0, 0, -1)
            arrivals += new
            rows += sum(len(arrival.keys) for arrival in new)
            begin.append(rows)
            old.append(kept)
        old_range = np.array(old, np.int64).reshape(-1, 3)
        incoming = _stacked(arrivals, rows)
        row_begin = np.array(begin, np.int64)
        oldest = np.array([self._oldest(record, now) for record in records], np.int64)
        lengths = old_range[:, 1] - old_range[:, 0]
        room = int(lengths.sum()) + rows
        forceful = room if len(incoming.forces) else int(lengths[old_range[:, 2] >= 0].sum())
        out = _room(room, forceful)
        order = store.sort_rows(incoming.keys, row_begin)
        starts = store.merge(self._columns, old_range, incoming, row_begin, order, oldest, out)
        sources = tuple(Source(record.name, record.kind) for record in records)
        entries = self._lined_up(now, sources, out, starts)
        self._columns = entries.columns
        self._ranges = {
            source.name: (int(s[0]), int(e[0]), int(s[1]))
            for source, s, e in zip(sources, entries.starts[:-1], entries.starts[1:], strict=True)
        }
        return entries

    def drop(self, source: str) -> None:
        """Drop all entries of a source."""
        self._ranges.pop(source, None)

    def clear(self) -> None:
        """Drop all entries."""
        self._ranges.clear()

    def _oldest(self, record: SourceRecord, now: int) -> int:
        return ALWAYS if self._by_voxel else now - record.timeout

    def _lined_up(
        self, now: int, sources: tuple[Source, ...], columns: Columns, starts: Int64Array
    ) -> Entries:
        count, forces = starts[-1]
        columns = columns.picked(slice(count), slice(forces))
        entries = Entries.lined_up(self._grid, now, sources, columns, starts)
        if self._by_voxel:
            newest = kernels.newest_stamps(entries.rows, columns.stamps)
            alive = now - newest <= self._voxel_timeout
            if not alive.all():
                entries = entries.in_voxels(alive)
        return entries


def _room(entries: int, forces: int) -> Columns:
    return Columns(
        np.empty(entries, np.int64),
        np.empty(entries, np.float32),
        np.empty(entries, np.int64),
        np.empty(entries, np.float32),
        np.empty(entries, np.bool_),
        np.empty((forces, 4)),
    )


def _stacked(arrivals: Sequence[Arrival], rows: int) -> Columns:
    """Stack the rows of clouds."""
    forceful = any(arrival.cloud.forces is not None for arrival in arrivals)
    stacked = _room(rows, rows if forceful else 0)
    at = 0
    for arrival in arrivals:
        cloud, part = arrival.cloud, slice(at, at + len(arrival.keys))
        at = part.stop
        stacked.keys[part] = arrival.keys
        stacked.likelihoods[part] = cloud.likelihoods
        stacked.stamps[part] = arrival.stamp
        stacked.spreads[part] = 0.0 if cloud.spreads is None else cloud.spreads
        stacked.single[part] = cloud.single
        if forceful:
            stacked.forces[part, :3] = 0.0 if cloud.forces is None else cloud.forces
            stacked.forces[part, 3] = 0.0 if cloud.forces is None else 1.0
    return stacked
