"""The clouds of every source over time, beside the robot's joints and the truth; and its file."""

from bisect import bisect_right
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from contactfusion.arrays import FloatArray
from contactfusion.grid import VOXEL_LIMIT, Grid
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind, Resultant, kind_of
from contactfusion_lab.scenes.arm import STEP

REQUIRED = ("positions", "likelihoods")
OPTIONAL = ("forces", "spreads")
CYCLE = 50
"""Steps of the physics from fusion to fusion: 20 Hz."""
COARSEST = 0.03
"""Side of the largest voxels in which a record can be fused [m]: within this distance of evidence
all hypotheses of Null are kept."""


class Arrived(NamedTuple):
    """A cloud, and the time at which it arrived [s], which may be after its own stamp."""

    stamp: float
    cloud: HypothesisCloud


@dataclass(frozen=True, eq=False)
class Instant:
    """The state at one time.

    Attributes:
        stamp: [s].
        clouds: the newest of each source, in the space's frame, by its name.
        joints: shape (k,), the robot's joints as they were read [rad, m].
        contacts: shape (n, 3) [m], the true contacts in the space's frame.
    """

    stamp: float
    clouds: Mapping[str, HypothesisCloud]
    joints: FloatArray
    contacts: FloatArray

    @cached_property
    def occupied(self) -> list[FloatArray]:
        """Places of all hypotheses but those of Null; see `thinned`."""
        clouds = [each for each in self.clouds.values() if each.kind != HypothesisKind.NULL]
        return [each.positions for each in clouds]


@dataclass(frozen=True, eq=False)
class Record:
    """The clouds of every source, from beginning to end.

    Attributes:
        end: the last stamp [s].
        history: the clouds of each source in the order in which they arrived, by its name.
        stamps: shape (m,), when joints were read [s].
        joints: shape (m, k), as they were read [rad, m].
        contacts: of each of these stamps the true contacts in the space's frame, shape (n, 3) [m].
        refused: why readings or clouds were refused, each reason once.
    """

    end: float
    history: Mapping[str, Sequence[Arrived]]
    stamps: FloatArray
    joints: FloatArray
    contacts: Sequence[FloatArray]
    refused: tuple[str, ...]

    def at(self, stamp: float) -> Instant:
        """The state at a stamp [s]: all that has arrived until then."""
        clouds = {}
        for name, arrived in self.history.items():
            count = bisect_right(arrived, stamp, key=lambda each: each.stamp)
            if count:
                clouds[name] = arrived[count - 1].cloud
        row = max(int(np.searchsorted(self.stamps, stamp, "right")) - 1, 0)
        return Instant(stamp, clouds, self.joints[row], self.contacts[row])

    @property
    def ending(self) -> "Record":
        """The end alone: the newest clouds and joints."""
        newest = {name: arrived[-1:] for name, arrived in self.history.items()}
        last = slice(-1, None)
        return replace(
            self, history=newest, stamps=self.stamps[last], joints=self.joints[last],
            contacts=self.contacts[last],
        )  # fmt: skip

    def cycles(self, start: float) -> Iterator[Instant]:
        """The states at the cycles of 20 Hz from a stamp [s] on, and at the end."""
        number = int(np.ceil(np.round(start / (CYCLE * STEP), 6)))
        while (stamp := number * CYCLE * STEP) < self.end:
            yield self.at(stamp)
            number += 1
        yield self.at(self.end)


def thinned(
    null: HypothesisCloud,
    others: Sequence[FloatArray],
    grid: Grid,
    evidence: Sequence[FloatArray] = (),
) -> HypothesisCloud:
    """A cloud of Null without the voxels that hold no other hypothesis.

    Args:
        null: the cloud.
        others: places that keep the Null of their voxel, each of shape (n, 3) [m].
        grid: the voxels.
        evidence: places that keep all Null around them, see `COARSEST`.
    """
    rows = np.isin(_keys(grid, null.positions), _keys(grid, _stacked(others)))
    if evidence:
        away, _ = KDTree(_stacked(evidence)).query(
            null.positions, p=np.inf, distance_upper_bound=COARSEST
        )
        rows |= np.isfinite(away)
    arrays: dict[str, Any] = {
        name: None if getattr(null, name) is None else getattr(null, name)[rows]
        for name in (*REQUIRED, *OPTIONAL)
    }
    return replace(null, **arrays)


def worth_keeping(
    history: Mapping[str, Sequence[Arrived]],
    contacts: Sequence[FloatArray],
    grid: Grid,
    evidence: Collection[str],
) -> dict[str, list[Arrived]]:
    """Thin each cloud of Null by the hypotheses that others have until the next one replaces it.

    Args:
        history: the clouds of each source.
        contacts: true contacts, each of shape (n, 3) [m].
        grid: the voxels of the space.
        evidence: the sources that may count as evidence.
    """
    kept = {name: list(arrived) for name, arrived in history.items()}
    for arrived in kept.values():
        ends = [*(each.stamp for each in arrived[1:]), np.inf]
        for row, ((stamp, cloud), end) in enumerate(zip(arrived, ends, strict=True)):
            if cloud.kind == HypothesisKind.NULL:
                others = [
                    each for other in history.values() for each in _between(other, stamp, end)
                ]
                near = [each.positions for each in others if each.source in evidence and len(each)]
                occupied = [each.positions for each in others if each.kind != HypothesisKind.NULL]
                arrived[row] = Arrived(stamp, thinned(cloud, [*occupied, *contacts], grid, near))
    return kept


def _between(arrived: Sequence[Arrived], start: float, end: float) -> list[HypothesisCloud]:
    """The clouds that are the newest of their source at some time from start to end [s]."""
    first = bisect_right(arrived, start, key=lambda each: each.stamp) - 1
    found = arrived[max(first, 0) :]
    return [each.cloud for each in found if each.stamp <= start or each.stamp < end]


def _keys(grid: Grid, positions: FloatArray) -> NDArray[np.int64]:
    """A number for the voxel of each position, shape (n,)."""
    voxels = grid.voxels(positions) + VOXEL_LIMIT
    keys: NDArray[np.int64] = voxels @ np.array([1 << 42, 1 << 21, 1])
    return keys


def _stacked(parts: Sequence[FloatArray]) -> FloatArray:
    return np.concatenate([np.empty((0, 3)), *parts])


def arrays_of(record: Record) -> dict[str, Any]:
    """The arrays of a record by their names in a file; see `record_of`.

    The newest cloud of each source is kept as it is, those before in single precision.
    """
    arrays: dict[str, Any] = {
        "read/stamps": record.stamps,
        "read/joints": record.joints,
        "read/counts": [len(each) for each in record.contacts],
        "read/contacts": _stacked(record.contacts),
    }
    for source, arrived in record.history.items():
        clouds = [each.cloud for each in arrived]
        arrays[f"{source}/clouds"] = [
            (stamp, cloud.stamp, len(cloud), cloud.single, *_has(cloud)) for stamp, cloud in arrived
        ]
        for name in (*REQUIRED, *OPTIONAL):
            held = [getattr(cloud, name) for cloud in clouds]
            before = [each for each in held[:-1] if each is not None and len(each)]
            if before:
                arrays[f"{source}/before/{name}"] = np.concatenate(before).astype(np.float32)
            if held[-1] is not None:
                arrays[f"{source}/{name}"] = held[-1]
        if any(cloud.resultant for cloud in clouds):
            arrays[f"{source}/resultants"] = [_row_of(cloud.resultant) for cloud in clouds]
    return arrays


def fields_of(record: Record) -> dict[str, Any]:
    """The content of the file of a record beside arrays, for JSON."""
    return {
        "end": record.end,
        "refused": record.refused,
        "sources": {
            source: {
                "kind": str(arrived[-1].cloud.kind),
                "frame": arrived[-1].cloud.frame,
                "notes": [each.cloud.notes for each in arrived],
                "links": next(
                    (each.cloud.resultant.links for each in arrived if each.cloud.resultant), ()
                ),
            }
            for source, arrived in record.history.items()
        },
    }


def record_of(fields: Mapping[str, Any], arrays: Mapping[str, Any]) -> Record:
    """A record from the content of its file.

    Raises:
        KeyError, TypeError, ValueError: the content is that of another file.
    """
    bounds = np.cumsum(arrays["read/counts"])[:-1]
    return Record(
        fields["end"],
        {source: _history(source, held, arrays) for source, held in fields["sources"].items()},
        arrays["read/stamps"],
        arrays["read/joints"],
        np.split(arrays["read/contacts"], bounds),
        tuple(fields["refused"]),
    )


def _history(source: str, held: Mapping[str, Any], arrays: Mapping[str, Any]) -> list[Arrived]:
    kind, frame, notes = kind_of(held["kind"]), held["frame"], map(tuple, held["notes"])
    table = arrays[f"{source}/clouds"]
    links = tuple(held.get("links", ()))
    resultants = arrays.get(f"{source}/resultants", np.full((len(table), 11), np.nan))
    has = [*np.ones((2, len(table))), *table[:, 4:].T]
    positions, likelihoods, forces, spreads = (
        _unstacked(f"{source}/", name, table[:, 2] * flags, flags > 0.0, arrays)
        for name, flags in zip((*REQUIRED, *OPTIONAL), has, strict=True)
    )
    return [
        Arrived(
            float(stamp),
            HypothesisCloud(
                source, kind, float(measured), frame, positions[row], likelihoods[row],
                forces[row], spreads[row], bool(single), remarks, _resultant_of(resultant, links),
            ),
        )
        for row, ((stamp, measured, _, single, *_), remarks, resultant) in enumerate(
            zip(table, notes, resultants, strict=True)
        )
    ]  # fmt: skip


def _row_of(resultant: Resultant | None) -> FloatArray:
    """A resultant but for its links, shape (11,); NaN for none."""
    if resultant is None:
        return np.full(11, np.nan)
    deviations = resultant.force_deviation, resultant.torque_deviation
    return np.concatenate([resultant.force, resultant.torque, resultant.origin, deviations])


def _resultant_of(row: FloatArray, links: tuple[str, ...]) -> Resultant | None:
    """A resultant from its row; `links` are those of the part of the robot."""
    if np.isnan(row[0]):
        return None
    return Resultant(row[:3], row[3:6], row[6:9], float(row[9]), float(row[10]), links)


def _has(cloud: HypothesisCloud) -> list[bool]:
    return [getattr(cloud, name) is not None for name in OPTIONAL]


def _unstacked(
    prefix: str, name: str, counts: FloatArray, has: NDArray[np.bool_], arrays: Mapping[str, Any]
) -> list[Any]:
    """One array of each cloud of a source, None where it has none."""
    nothing = np.empty((0, 3) if name in ("positions", "forces") else 0)
    before = np.split(
        arrays.get(f"{prefix}before/{name}", nothing), np.cumsum(counts[:-1]).astype(np.intp)
    )
    parts = [part if there else None for part, there in zip(before, has[:-1], strict=False)]
    return [*parts, arrays.get(f"{prefix}{name}")]
