"""The live entries of the hypothesis space lined up by voxel, and the field made of them."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.grid import Grid
from contactfusion.hypotheses import HypothesisKind, Resultant
from contactfusion.integrator import kernels
from contactfusion.integrator.store import Columns, Int64Array, mean_places, unpack
from contactfusion.time import NANOSECONDS_PER_SECOND

KIND_BITS = {
    HypothesisKind.REGULAR: kernels.REGULAR,
    HypothesisKind.SUPPORT: kernels.SUPPORT,
    HypothesisKind.NULL: kernels.NULL,
}


@dataclass(frozen=True, slots=True)
class Source:
    """One output of a plugged generator.

    Attributes:
        name: of the source.
        kind: evidence, support or null.
        misses: probability of a miss, that it finds nothing while there is a contact; 1 unless its
            probability of detection is known and its newest cloud is empty.
        resultant: of all contacts, as its newest cloud measures it.
        looked: the newest stamp at which it could detect contacts [ns], or None.
        tells: whether that is no longer ago than entries live.
        positions: of its newest hypotheses, before those of a voxel become one, shape (h, 3) [m].
    """

    name: str
    kind: HypothesisKind
    misses: float
    resultant: Resultant | None
    looked: int | None
    tells: bool
    positions: FloatArray = field(compare=False)


@dataclass(frozen=True, eq=False)
class Entries:
    """All live entries at one step; nothing in it is ever changed.

    Attributes:
        grid: the frame and size of the voxels.
        now: the step's time [ns].
        sources: k sources by ascending name.
        columns: the entries, grouped by source, by ascending voxel within each.
        starts: shape (k + 1, 2): each source's first entry, and its first row of forces or -1.
        keys: shape (m,), the voxels that have an entry, packed, ascending.
        places: shape (n,), the voxel of each entry, as a row of `keys`.
        bits: shape (m,), the kinds alive in each voxel, and whether with a force, see `kernels`.
    """

    grid: Grid
    now: int
    sources: tuple[Source, ...]
    columns: Columns
    starts: Int64Array
    keys: Int64Array
    places: NDArray[np.int32]
    bits: NDArray[np.uint8]

    @staticmethod
    def lined_up(
        grid: Grid, now: int, sources: tuple[Source, ...], columns: Columns, starts: Int64Array
    ) -> "Entries":
        """Line entries up by voxel."""
        n = len(columns.keys)
        keys, places, bits = np.empty(n, np.int64), np.empty(n, np.int32), np.empty(n, np.uint8)
        kinds = np.array([KIND_BITS[source.kind] for source in sources], np.uint8)
        kinds[(kinds == kernels.REGULAR) & (starts[:-1, 1] >= 0)] |= kernels.FORCE
        begin = np.ascontiguousarray(starts[:, 0])
        m = kernels.align(columns.keys, begin, kinds, keys, places, bits)
        return Entries(grid, now, sources, columns, starts, keys[:m], places, bits[:m])

    def without(self, name: str) -> "Entries":
        """The entries of all other sources."""
        at = next(i for i, source in enumerate(self.sources) if source.name == name)
        wanted = np.ones(len(self.columns.keys), np.bool_)
        wanted[self.starts[at, 0] : self.starts[at + 1, 0]] = False
        fewer = self._picked(wanted)
        starts = np.delete(fewer.starts, at, axis=0)
        sources = self.sources[:at] + self.sources[at + 1 :]
        return Entries.lined_up(self.grid, self.now, sources, fewer.columns, starts)

    def in_voxels(self, wanted: NDArray[np.bool_]) -> "Entries":
        """The entries of some voxels; `wanted` has shape (m,)."""
        return self._picked(wanted[self.places])

    def newest(self, rows: NDArray[np.intp]) -> dict[str, int]:
        """The newest stamp of some entries [ns], by source; `rows` has shape (r,)."""
        owners = np.searchsorted(self.starts[1:, 0], rows, side="right")
        stamps = self.columns.stamps[rows]
        return {
            self.sources[owner].name: int(stamps[owners == owner].max())
            for owner in np.unique(owners)
        }

    def _picked(self, wanted: NDArray[np.bool_]) -> "Entries":
        """Some of the entries; `wanted` has shape (n,)."""
        kept_before = np.concatenate([[0], np.cumsum(wanted)])
        starts = self.starts.copy()
        starts[:, 0] = kept_before[self.starts[:, 0]]
        force_rows = np.zeros(len(self.columns.forces), np.bool_)
        forces = 0
        for source, (begin, force_begin) in enumerate(self.starts[:-1]):
            if force_begin >= 0:
                kept = wanted[begin : self.starts[source + 1, 0]]
                force_rows[force_begin : force_begin + len(kept)] = kept
                starts[source, 1] = forces
                forces += int(kept.sum())
        starts[-1, 1] = forces
        columns = self.columns.picked(wanted, force_rows)
        return Entries.lined_up(self.grid, self.now, self.sources, columns, starts)

    def flags(self, *kinds: HypothesisKind) -> NDArray[np.bool_]:
        """Which sources are of one of these kinds, shape (k,)."""
        return np.array([source.kind in kinds for source in self.sources], np.bool_)

    @property
    def counted_voxels(self) -> NDArray[np.bool_]:
        """Which voxels hold more than null, shape (m,)."""
        return (self.bits & (kernels.REGULAR | kernels.SUPPORT)).astype(np.bool_)

    @cached_property
    def counted(self) -> NDArray[np.bool_]:
        """Which sources take part in the fused likelihood: all but null, shape (k,)."""
        return self.flags(HypothesisKind.REGULAR, HypothesisKind.SUPPORT)

    @cached_property
    def felt(self) -> tuple[Int64Array, FloatArray]:
        """The voxels with a force, as rows, and their centres, shape (v, 3) [m]."""
        rows = np.flatnonzero(self.bits & kernels.FORCE).astype(np.int64)
        return rows, self.grid.centres(unpack(self.keys[rows]))

    @cached_property
    def begin(self) -> Int64Array:
        """Where the entries of each source begin, shape (k + 1,); the last is n."""
        return np.ascontiguousarray(self.starts[:, 0])

    @property
    def by_source(self) -> list[tuple[Source, slice]]:
        """Each source with its entries, as rows of the columns."""
        ends = itertools.pairwise(self.begin.tolist())
        return [(source, slice(*end)) for source, end in zip(self.sources, ends, strict=True)]

    def parts(self, inside: NDArray[np.bool_]) -> Iterator[tuple[Source, NDArray[np.intp]]]:
        """Each source with its entries in some voxels, as rows of the columns.

        Args:
            inside: shape (m,), which voxels.
        """
        for source, own in self.by_source:
            yield source, own.start + np.flatnonzero(inside[self.places[own]])

    @property
    def voxels(self) -> Int64Array:
        """The voxels that have an entry, shape (m, 3)."""
        return unpack(self.keys)

    @property
    def positions(self) -> FloatArray:
        """Where the hypotheses of each entry lie, shape (n, 3) [m].

        Their mean, weighted by likelihood, for a rule that needs places; else the voxel's centre.
        """
        columns = self.columns
        return mean_places(columns.keys, columns.offsets, self.grid.voxel_size)

    @property
    def shared(self) -> FloatArray:
        """The part of each entry's likelihoods that is of weaker hypotheses, shape (n,).

        0 where a voxel holds one hypothesis of the source, or where no rule needs places.
        """
        columns = self.columns
        if not len(columns.offsets):
            return np.zeros(len(columns.keys))
        return np.maximum(1.0 - columns.likelihoods / columns.offsets[:, 3].astype(np.float64), 0.0)

    @property
    def likelihoods(self) -> NDArray[np.float32]:
        """What each source gave, shape (m, k), NaN where nothing."""
        return self._by_voxel(self.columns.likelihoods, np.float32(np.nan))

    @property
    def spreads(self) -> NDArray[np.float32]:
        """Standard deviations of the places, shape (m, k) [m], NaN where there is no entry."""
        return self._by_voxel(self.columns.spreads, np.float32(np.nan))

    @property
    def ages(self) -> FloatArray:
        """Time since each entry's stamp, shape (m, k) [s], NaN where there is no entry."""
        ages = (self.now - self.columns.stamps) / NANOSECONDS_PER_SECOND
        return self._by_voxel(ages, np.float64(np.nan))

    @property
    def single(self) -> NDArray[np.bool_]:
        """Which entries are of a cloud that describes one contact, shape (m, k)."""
        return self._by_voxel(self.columns.single, np.bool_(False))

    @property
    def forces(self) -> FloatArray:
        """The force in each voxel, shape (m, 3) [N], NaN where none."""
        return self.forces_in(np.arange(len(self.keys)))

    def forces_in(self, voxels: Int64Array) -> FloatArray:
        """The force in some voxels, shape (v, 3) [N], NaN where none; rows, ascending."""
        return kernels.voxel_forces(
            voxels,
            self.places,
            self.columns.likelihoods,
            self.starts,
            self.flags(HypothesisKind.REGULAR),
            self.columns.forces,
        )

    def _by_voxel(self, column: NDArray[Any], absent: np.generic) -> NDArray[Any]:
        table = np.full((len(self.keys), len(self.sources)), absent, column.dtype)
        for number, (_, own) in enumerate(self.by_source):
            table[self.places[own], number] = column[own]
        return table


@dataclass(frozen=True, eq=False)
class Member:
    """A contact of a set, and where it may be.

    Attributes:
        contact: as it is reported, if it is probable enough; its likelihood is the probability that
            it exists.
        places: shape (b, 3) [m], where it may be.
        weights: shape (b,), the probability of each place if it exists; they sum to 1.
        normal: out of the robot, shape (3,); None without a surface.
        reach: half the step by which places hang together [m].
        link: where it most probably is, as an index into the surface's.
        given: the probability of a contact by each source that it explains.
        factors: on its odds, by each source that speaks for or against it beside these: Support and
            Null there, those that are silent, and those that measure a resultant; in this order.
        explains: the entries that it explains, as rows of the columns; of what is the sum over
            several contacts each explains all.
        is_large: whether it is a line or a patch.
        centres: of several sources, where each alone locates it, shape (3,) [m], and how unsure
            that is, by axis [m].
        covered_by: the sources whose detections cover it, too, and are those of another contact.
    """

    contact: Contact
    places: FloatArray
    weights: FloatArray
    normal: FloatArray | None
    reach: float
    link: int
    given: Mapping[str, float]
    factors: Mapping[str, float] = field(default_factory=dict)
    explains: NDArray[np.intp] = field(default_factory=lambda: np.empty(0, np.intp))
    is_large: bool = False
    centres: Mapping[str, tuple[FloatArray, float]] = field(default_factory=dict)
    covered_by: frozenset[str] = frozenset()


class Field:
    """The fused likelihood of a contact, voxel by voxel.

    Args:
        entries: what it was made of.
        likelihoods: shape (m,), in the order of `entries.keys`; or a function that computes them on
            first use.
        members: of a rule that finds them, the contacts of a set, the most probable first.
    """

    def __init__(
        self,
        entries: Entries,
        likelihoods: FloatArray | Callable[[], FloatArray],
        members: Sequence[Member] | None = None,
    ) -> None:
        self.entries, self.members = entries, members
        self._likelihoods = likelihoods

    @cached_property
    def likelihoods(self) -> FloatArray:
        """The fused likelihoods, shape (m,), in the order of `entries.keys`."""
        return self._likelihoods() if callable(self._likelihoods) else self._likelihoods

    def given(self, row: int) -> dict[str, float]:
        """The likelihood that each source gave that takes part in a voxel, by ascending name."""
        entries = self.entries
        return {
            source.name: float(entries.columns.likelihoods[rows[0]])
            for source, rows in entries.parts(np.arange(len(entries.keys)) == row)
            if source.kind != HypothesisKind.NULL and len(rows)
        }
