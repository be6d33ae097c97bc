"""Clouds that wait for the next step: accepted in order of arrival, dropped late, held early."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from contactfusion.errors import FrameError, InvalidCloudError
from contactfusion.grid import VOXEL_LIMIT, Grid
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.integrator.sources import Event, EventKind, SourceRecord
from contactfusion.integrator.store import Int64Array, rasterise
from contactfusion.time import LEAP, to_nanoseconds

OTHER_CLOCK = "its clock is another"


@dataclass(slots=True)
class Arrival:
    """A cloud with its voxels and its stamp [ns]."""

    cloud: HypothesisCloud
    keys: Int64Array
    stamp: int
    held: bool = False


class Inbox:
    """The clouds received since the last step, and those held back because they were early.

    Args:
        grid: the frame and voxel size of the hypothesis space.
        max_ahead: the greatest lead of a stamp over now [ns].
        most: the greatest number of hypotheses of a cloud.
    """

    def __init__(self, grid: Grid, max_ahead: int, most: int) -> None:
        self._grid, self._max_ahead, self._most = grid, max_ahead, most
        self._arrivals: list[Arrival] = []

    def put(self, cloud: HypothesisCloud) -> None:
        """Find the voxels of a cloud and keep it.

        Raises:
            FrameError: its frame is not the grid's.
            InvalidCloudError: a place is out of reach, or there are too many.
        """
        if len(cloud) > self._most:
            raise InvalidCloudError(
                f"the cloud of '{cloud.source}' holds {len(cloud)} hypotheses, more than "
                f"`integrator.max_hypotheses` allows, {self._most}"
            )
        if cloud.frame != self._grid.frame:
            raise FrameError(
                f"the cloud of '{cloud.source}' comes in frame '{cloud.frame}', "
                f"but the hypothesis space is in '{self._grid.frame}'"
            )
        keys = np.empty(len(cloud), np.int64)
        bad = rasterise(cloud.positions, 1.0 / self._grid.voxel_size, keys)
        if bad >= 0:
            x, y, z = cloud.positions[bad]
            reach = VOXEL_LIMIT * self._grid.voxel_size
            raise InvalidCloudError(
                f"row {bad} of the positions of '{cloud.source}' is out of reach: "
                f"({x:.6g}, {y:.6g}, {z:.6g}) m, and the space ends at ±{reach:.6g} m"
            )
        self._arrivals.append(Arrival(cloud, keys, to_nanoseconds(cloud.stamp)))

    def reported(self, now: int, sources: Mapping[str, SourceRecord]) -> set[str]:
        """The sources that a step at this time would accept a cloud from."""
        return {
            arrival.cloud.source
            for arrival in self._arrivals
            if arrival.stamp <= now + self._max_ahead
            and not sources[arrival.cloud.source].is_late(arrival.stamp)
        }

    def take(
        self, now: int, sources: Mapping[str, SourceRecord], events: list[Event]
    ) -> dict[str, list[Arrival]]:
        """Accept what is neither late nor early; early clouds stay.

        Late clouds are dropped, and those that are so early that their clock is another.

        Returns:
            The accepted clouds by source, in order of arrival.
        """
        accepted: dict[str, list[Arrival]] = {}
        held = []
        for arrival in self._arrivals:
            cloud = arrival.cloud
            source = sources[cloud.source]
            if arrival.stamp > now + max(self._max_ahead, to_nanoseconds(LEAP)):
                source.early += 1
                lead = (arrival.stamp - now) / 1e9
                message = f"a cloud of '{source.name}' is {lead:,.3f} s early: dropped, "
                events.append(Event(EventKind.EARLY, source.name, message + OTHER_CLOCK))
            elif arrival.stamp > now + self._max_ahead:
                if not arrival.held:
                    arrival.held = True
                    source.early += 1
                    lead = (arrival.stamp - now) / 1e9
                    message = f"a cloud of '{source.name}' is {lead:.3g} s early: held back"
                    events.append(Event(EventKind.EARLY, source.name, message))
                held.append(arrival)
            elif source.is_late(arrival.stamp):
                source.late += 1
                behind = (source.stamps[-1] - arrival.stamp) / 1e9
                message = f"a cloud of '{source.name}' is {behind:.3g} s late: dropped"
                events.append(Event(EventKind.LATE, source.name, message))
            else:
                source.accept(cloud, arrival.stamp)
                accepted.setdefault(source.name, []).append(arrival)
        self._arrivals = held
        return accepted

    def drop(self, source: str) -> None:
        """Drop all clouds of a source."""
        self._arrivals = [a for a in self._arrivals if a.cloud.source != source]

    def clear(self) -> None:
        """Drop all clouds."""
        self._arrivals = []
