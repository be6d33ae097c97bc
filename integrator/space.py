"""The hypothesis space: the newest entry of every voxel and source, while it lives (method §1)."""

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

Range = tuple[int, int, int]
"""Where a source's rows begin and end, and its first row of forces, or -1 when it has none."""
NOTHING: Range = (0, 0, -1)


class Space:
    """Merges accepted clouds and drops old entries; each step gets entries of its own.

    Args:
        grid: the frame and voxel size.
        config: timeout and expiry.
        places: whether entries keep the places of their hypotheses, or only the voxel; if so, a
            cloud that describes one contact replaces what its source said at earlier stamps.
    """

    def __init__(self, grid: Grid, config: IntegratorConfig, *, places: bool) -> None:
        self._grid, self._places = grid, places
        self._by_voxel = config.expiry == "voxel"
        self._voxel_timeout = to_nanoseconds(config.timeout)
        self._columns = _room(0, 0, places=places)
        self._ranges: dict[str, Range] = {}

    def absorb(
        self, accepted: Mapping[str, list[Arrival]], records: Sequence[SourceRecord], now: int
    ) -> Entries:
        """Merge accepted clouds into the entries, and drop the entries that are too old.

        Args:
            accepted: clouds by source, in order of arrival.
            records: the plugged sources by ascending name.
            now: the step's time [ns].
        """
        groups, kept = [], []
        for record in records:
            clouds = accepted.get(record.name, [])
            replaced = clouds and (record.replace or self._is_outdated(record, clouds[-1].stamp))
            kept.append(NOTHING if replaced else self._ranges.get(record.name, NOTHING))
            if replaced and record.replace:
                clouds = clouds[-1:]
            elif replaced:  # those of one stamp are one
                clouds = [each for each in clouds if each.stamp == clouds[-1].stamp]
            groups.append(clouds)
        rows, ranges = self._stacked(groups)
        out = _room(*_most(kept, ranges), places=self._places)
        old_range, row_range = _as_array(kept), _as_array(ranges)
        oldest = np.array([self._oldest(record, now) for record in records], np.int64)
        rows, order = store.sort_rows(rows, row_range)
        starts = store.merge(self._columns, old_range, rows, row_range, order, oldest, out)
        sources = tuple(self._source(record, now) for record in records)
        entries = self._lined_up(now, sources, out, starts)
        self._columns, starts = entries.columns, entries.starts.tolist()
        self._ranges = {
            source.name: (begin, end, forces)
            for source, (begin, forces), (end, _) in zip(sources, starts, starts[1:], strict=False)
        }
        return entries

    def drop(self, source: str) -> None:
        """Drop all entries of a source."""
        self._ranges.pop(source, None)

    def clear(self) -> None:
        """Drop all entries."""
        self._ranges.clear()

    def _is_outdated(self, record: SourceRecord, stamp: int) -> bool:
        """Whether a cloud of a stamp [ns] replaces what a source said of its single contact."""
        if not (self._places and record.single):
            return False
        begin, end, _ = self._ranges.get(record.name, NOTHING)
        return bool(self._columns.stamps[begin:end].max(initial=ALWAYS) < stamp)

    def _source(self, record: SourceRecord, now: int) -> Source:
        lifetime = self._voxel_timeout if self._by_voxel else record.timeout
        is_fresh = record.is_fresh(now, lifetime)
        return Source(
            name=record.name,
            kind=record.kind,
            misses=record.misses(now, lifetime),
            resultant=record.resultant if is_fresh else None,
            looked=record.looked,
            tells=record.looked is not None and now - record.looked <= lifetime,
            positions=record.positions,
        )

    def _oldest(self, record: SourceRecord, now: int) -> int:
        return ALWAYS if self._by_voxel else now - record.timeout

    def _lined_up(
        self, now: int, sources: tuple[Source, ...], columns: Columns, starts: Int64Array
    ) -> Entries:
        columns.shrink(*starts[-1])
        entries = Entries.lined_up(self._grid, now, sources, columns, starts)
        if self._by_voxel:
            newest = kernels.newest_stamps(entries.places, len(entries.keys), columns.stamps)
            alive = now - newest <= self._voxel_timeout
            if not alive.all():
                entries = entries.in_voxels(alive)
        return entries

    def _stacked(self, groups: Sequence[Sequence[Arrival]]) -> tuple[Columns, list[Range]]:
        """The stacked rows of clouds that are grouped by source, and the groups' ranges."""
        ranges, end, forces = [], 0, 0
        for group in groups:
            begin, end = end, end + sum(len(arrival.keys) for arrival in group)
            forceful = any(arrival.cloud.forces is not None for arrival in group)
            ranges.append((begin, end, forces if forceful else -1))
            forces += end - begin if forceful else 0
        stacked = _room(end, forces, places=self._places)
        for group, (at, _, force_at) in zip(groups, ranges, strict=True):
            for arrival in group:
                cloud, rows = arrival.cloud, slice(at, at + len(arrival.keys))
                stacked.keys[rows] = arrival.keys
                stacked.likelihoods[rows] = cloud.likelihoods
                stacked.stamps[rows] = arrival.stamp
                stacked.spreads[rows] = 0.0 if cloud.spreads is None else cloud.spreads
                stacked.single[rows] = cloud.single
                if self._places:
                    side = self._grid.voxel_size
                    store.offset_from_centres(cloud.positions, side, stacked.offsets[rows])
                if force_at >= 0:
                    force_rows = slice(force_at, force_at + len(arrival.keys))
                    felt = cloud.forces is not None
                    stacked.forces[force_rows, :3] = cloud.forces if felt else 0.0
                    stacked.forces[force_rows, 3] = felt
                    force_at = force_rows.stop
                at = rows.stop
        return stacked, ranges


def _room(entries: int, forces: int, *, places: bool) -> Columns:
    return Columns(
        np.empty(entries, np.int64),
        np.empty(entries, np.float32),
        np.empty(entries, np.int64),
        np.empty(entries, np.float32),
        np.empty(entries, np.bool_),
        np.empty((forces, 4)),
        np.empty((entries if places else 0, 4), np.float32),
    )


def _most(old: Sequence[Range], new: Sequence[Range]) -> tuple[int, int]:
    """The most entries and rows of forces that a merge can leave."""
    rows = forces = 0
    for (begin, end, force), (new_begin, new_end, new_force) in zip(old, new, strict=True):
        most = end - begin + new_end - new_begin
        rows += most
        forces += most if force >= 0 or new_force >= 0 else 0
    return rows, forces


def _as_array(ranges: Sequence[Range]) -> Int64Array:
    return np.array(ranges, np.int64).reshape(-1, 3)
