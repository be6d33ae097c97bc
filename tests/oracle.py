"""method §1-3 in plain dictionaries: the oracle that the integrator is held against.

Slow on purpose, and written from the law alone: one entry per voxel and source in a dict of dicts,
one loop per sentence of the law. Nothing is shared with the integrator but the types of its input.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from contactfusion.errors import (
    ContactFusionError,
    FrameError,
    InvalidCloudError,
    SourceError,
    TimeError,
)
from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.integrator.config import IntegratorConfig

Vector = tuple[float, float, float]
Voxel = tuple[int, int, int]

MARGIN = 1e-6
"""How far below the threshold a likelihood may stay through rounding (method §2)."""
VOXEL_LIMIT = 2**20
TIE = 1e-4
"""Two axes of a cluster whose eigenvalues differ by less than this share are one."""


class Refused(Exception):
    """The law refuses; `reasons` are the errors that it may be refused with."""

    def __init__(self, *reasons: type[ContactFusionError]) -> None:
        super().__init__(", ".join(reason.__name__ for reason in reasons))
        self.reasons = reasons


@dataclass
class Source:
    """A plugged source, and what is remembered of it; times in nanoseconds."""

    kind: HypothesisKind
    timeout: int
    stale_after: int
    replace: bool
    newest: int | None = None
    first_step: int | None = None
    accepted: int = 0
    late: int = 0
    early: int = 0
    invalid: int = 0

    def active(self, now: int) -> bool:
        since = self.first_step if self.newest is None else self.newest
        return since is None or now - since <= self.stale_after


@dataclass
class Queued:
    """A cloud that waits for a step."""

    cloud: HypothesisCloud
    stamp: int
    counted: bool = False


@dataclass
class Entry:
    """What one source says about one voxel; force: Σ p·f and Σ p, or None; spread [m]."""

    likelihood: float
    stamp: int
    force: tuple[Vector, float] | None = None
    spread: float = 0.0


Entries = Mapping[Voxel, Mapping[str, Entry]]


@dataclass(frozen=True)
class Row:
    """One voxel of the fused space."""

    voxel: Voxel
    likelihood: float
    verdict: str
    likelihoods: Mapping[str, float]
    variance: float
    force: Vector | None
    stamp: int


@dataclass(frozen=True)
class ExpectedContact:
    """One contact; `extent` is None where the longest axis is not defined."""

    first: Voxel
    position: Vector
    likelihood: float
    dispersion: float
    covariance: tuple[Vector, ...]
    extent: tuple[Vector, Vector] | None
    force: Vector | None
    voxels: int
    shares: Mapping[str, float]
    stamp: int


@dataclass(frozen=True)
class ExpectedSource:
    """What the report says of one source."""

    accepted: int
    late: int
    early: int
    invalid: int
    active: bool


@dataclass(frozen=True)
class ExpectedFusion:
    """What one step gives."""

    config: IntegratorConfig
    now: int
    kinds: Mapping[str, HypothesisKind]
    timeouts: Mapping[str, int]
    entries: Entries
    sources: Mapping[str, ExpectedSource]
    rows: Sequence[Row] = field(init=False)
    contacts: Sequence[ExpectedContact] = field(init=False)

    def __post_init__(self) -> None:
        rows = fuse(self.config, self.kinds, self.entries)
        object.__setattr__(self, "rows", rows)
        object.__setattr__(self, "contacts", condense(self.config, self.kinds, rows))

    def without(self, name: str) -> "ExpectedFusion":
        left = {
            voxel: {other: entry for other, entry in there.items() if other != name}
            for voxel, there in self.entries.items()
        }
        return ExpectedFusion(
            self.config,
            self.now,
            {other: kind for other, kind in self.kinds.items() if other != name},
            self.timeouts,
            {voxel: there for voxel, there in left.items() if there},
            self.sources,
        )


class Oracle:
    """The integrator as the law has it (method §1-3)."""

    def __init__(self, config: IntegratorConfig) -> None:
        self.config = config
        self.sources: dict[str, Source] = {}
        self.unplugged: set[str] = set()
        self.queue: list[Queued] = []
        self.entries: dict[Voxel, dict[str, Entry]] = {}
        self.last: int | None = None

    def plug(
        self,
        name: str,
        *,
        kind: HypothesisKind,
        timeout: float | None = None,
        stale_after: float | None = None,
        replace: bool = False,
    ) -> None:
        source = self.sources.get(name)
        if source is not None and source.kind != kind:
            raise Refused(SourceError)
        if source is None:
            source = self.sources[name] = Source(kind, 0, 0, False)
            self.unplugged.discard(name)
        source.timeout = nanoseconds(self.config.timeout if timeout is None else timeout)
        source.stale_after = nanoseconds(
            self.config.stale_after if stale_after is None else stale_after
        )
        source.replace = replace

    def unplug(self, name: str) -> None:
        del self.sources[name]
        self.unplugged.add(name)
        self.queue = [queued for queued in self.queue if queued.cloud.source != name]
        self._forget(name)

    def receive(self, cloud: HypothesisCloud) -> None:
        known = {*self.sources, *self.unplugged}
        if cloud.source not in known and not self.config.strict_sources:
            self.plug(cloud.source, kind=cloud.kind)
        reasons = self._reasons_against(cloud)
        if reasons:
            if cloud.source in self.sources:
                self.sources[cloud.source].invalid += 1
            raise Refused(*reasons)
        self.queue.append(Queued(cloud, nanoseconds(cloud.stamp)))

    def ready(self, now: float) -> bool:
        time = nanoseconds(now)
        return all(
            any(self._acceptable(queued, time) for queued in self.queue if queued.cloud.source == n)
            for n, source in self.sources.items()
            if source.active(time)
        )

    def step(self, now: float) -> ExpectedFusion:
        time = nanoseconds(now)
        if self.last is not None and time < self.last:
            raise Refused(TimeError)
        self.last = time
        for source in self.sources.values():
            if source.first_step is None:
                source.first_step = time
        self._go_through_queue(time)
        self._expire(time)
        return ExpectedFusion(
            self.config,
            time,
            {name: source.kind for name, source in self.sources.items()},
            {name: source.timeout for name, source in self.sources.items()},
            {
                voxel: {name: replace(entry) for name, entry in there.items()}
                for voxel, there in self.entries.items()
            },
            {
                name: ExpectedSource(s.accepted, s.late, s.early, s.invalid, s.active(time))
                for name, s in self.sources.items()
            },
        )

    def reset(self) -> None:
        self.queue = []
        self.entries = {}
        self.last = None
        for source in self.sources.values():
            source.newest = None
            source.first_step = None

    def _reasons_against(self, cloud: HypothesisCloud) -> list[type[ContactFusionError]]:
        source = self.sources.get(cloud.source)
        reasons: list[type[ContactFusionError]] = []
        if cloud.frame != self.config.frame:
            reasons.append(FrameError)
        if source is None or source.kind != cloud.kind:
            reasons.append(SourceError)
        for position in cloud.positions.tolist():
            indices = voxel_of(position, self.config.voxel_size)
            if any(abs(index) >= VOXEL_LIMIT for index in indices):
                reasons.append(InvalidCloudError)
                break
        return reasons

    def _in_time(self, queued: Queued, now: int) -> bool:
        return queued.stamp <= now + nanoseconds(self.config.max_ahead)

    def _acceptable(self, queued: Queued, now: int) -> bool:
        newest = self.sources[queued.cloud.source].newest
        return self._in_time(queued, now) and (newest is None or queued.stamp >= newest)

    def _go_through_queue(self, now: int) -> None:
        held: list[Queued] = []
        for queued in self.queue:
            source = self.sources[queued.cloud.source]
            if not self._in_time(queued, now):
                source.early += not queued.counted
                queued.counted = True
                held.append(queued)
            elif not self._acceptable(queued, now):
                source.late += 1
            else:
                source.accepted += 1
                source.newest = queued.stamp
                self._apply(queued.cloud, queued.stamp)
        self.queue = held

    def _apply(self, cloud: HypothesisCloud, stamp: int) -> None:
        if self.sources[cloud.source].replace:
            self._forget(cloud.source)
        likelihoods = [float(np.float32(p)) for p in cloud.likelihoods.tolist()]
        for row, position in enumerate(cloud.positions.tolist()):
            voxel = voxel_of(position, self.config.voxel_size)
            likelihood = likelihoods[row]
            there = self.entries.setdefault(voxel, {})
            entry = there.get(cloud.source)
            if entry is not None and entry.stamp < stamp:
                del there[cloud.source]
                entry = None
            if likelihood > 0:
                if entry is None:
                    entry = there[cloud.source] = Entry(0.0, stamp)
                spread = 0.0 if cloud.spreads is None else float(np.float32(cloud.spreads[row]))
                # of several the likeliest, of equals the widest
                entry.likelihood, entry.spread = max(
                    (entry.likelihood, entry.spread), (likelihood, spread)
                )
                if cloud.forces is None:
                    entry.force = None
                else:
                    force = vector(cloud.forces[row].tolist())
                    total, weight = entry.force or ((0.0, 0.0, 0.0), 0.0)
                    entry.force = (
                        vector(t + likelihood * f for t, f in zip(total, force, strict=True)),
                        weight + likelihood,
                    )
            if not there:
                del self.entries[voxel]

    def _expire(self, now: int) -> None:
        for voxel, there in list(self.entries.items()):
            if self.config.expiry == "voxel":
                newest = max(entry.stamp for entry in there.values())
                if now - newest > nanoseconds(self.config.timeout):
                    there.clear()
            else:
                for name, entry in list(there.items()):
                    if now - entry.stamp > self.sources[name].timeout:
                        del there[name]
            if not there:
                del self.entries[voxel]

    def _forget(self, name: str) -> None:
        for voxel, there in list(self.entries.items()):
            there.pop(name, None)
            if not there:
                del self.entries[voxel]


def nanoseconds(seconds: float) -> int:
    return round(seconds * 1e9)


def vector(numbers: Iterable[float]) -> Vector:
    x, y, z = numbers
    return (x, y, z)


def voxel_of(position: Iterable[float], voxel_size: float) -> Voxel:
    x, y, z = (math.floor(component * (1.0 / voxel_size)) for component in position)
    return (x, y, z)


def centre_of(voxel: Voxel, voxel_size: float) -> Vector:
    return vector((index + 0.5) * voxel_size for index in voxel)


def de_morgan(likelihoods: Iterable[float]) -> float:
    """1 − Π(1 − p) (F Eq 1)."""
    return 1.0 - math.prod(1.0 - p for p in likelihoods)


def fuse(
    config: IntegratorConfig, kinds: Mapping[str, HypothesisKind], entries: Entries
) -> list[Row]:
    """Give every voxel that has an entry, by ascending index (method §2)."""
    rows = []
    for voxel, there in sorted(entries.items()):
        names = sorted(there)
        present = {kinds[name] for name in names}
        voices = [there[n].likelihood for n in names if kinds[n] is not HypothesisKind.NULL]
        likelihood = de_morgan(voices)
        if HypothesisKind.NULL in present:
            verdict = "nulled"
        elif HypothesisKind.REGULAR not in present:
            verdict = "support_only"
        elif likelihood >= config.threshold - MARGIN:
            verdict = "contact"
        else:
            verdict = "below_threshold"
        rows.append(
            Row(
                voxel,
                likelihood,
                verdict,
                {name: there[name].likelihood for name in names},
                _voxel_variance(there[n] for n in names if kinds[n] is not HypothesisKind.NULL),
                _voxel_force(there[n] for n in names if kinds[n] is HypothesisKind.REGULAR),
                max(entry.stamp for entry in there.values()),
            )
        )
    return rows


def _voxel_variance(entries: Iterable[Entry]) -> float:
    """Σ p·spread² / Σ p."""
    there = list(entries)
    total = sum(entry.likelihood for entry in there)
    return sum(entry.likelihood * entry.spread**2 for entry in there) / total if total else 0.0


def _voxel_force(entries: Iterable[Entry]) -> Vector | None:
    felt = []
    for entry in entries:
        if entry.force is not None:
            total, weight = entry.force
            felt.append((entry.likelihood, vector(component / weight for component in total)))
    return weighted_mean(felt)


def weighted_mean(weighted: Sequence[tuple[float, Vector]]) -> Vector | None:
    total = sum(weight for weight, _ in weighted)
    if total == 0:
        return None
    return vector(sum(weight * v[axis] for weight, v in weighted) / total for axis in range(3))


def condense(
    config: IntegratorConfig, kinds: Mapping[str, HypothesisKind], rows: Sequence[Row]
) -> list[ExpectedContact]:
    """Give the contacts, the likeliest first (method §3)."""
    certain = [row for row in rows if row.verdict == "contact"]
    if config.condensation == "threshold":
        groups = [[row] for row in certain]
    else:
        least = config.condensation_options.get("min_voxels", 1)
        groups = [g for g in clusters(certain, reach(config)) if len(g) >= least]
    contacts = [contact_of(config, kinds, group) for group in groups]
    return sorted(contacts, key=lambda one: (-round(one.likelihood * 1e6), one.first))


def reach(config: IntegratorConfig) -> int:
    """Give the largest squared offset, in voxels, that still joins two voxels."""
    if config.tolerance is None:
        return 4
    return math.floor((config.tolerance / config.voxel_size) ** 2 + 1e-6)


def squared_offset(a: Voxel, b: Voxel) -> int:
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


def clusters(rows: Sequence[Row], limit: int) -> list[list[Row]]:
    """Group rows by single linkage."""
    left = list(rows)
    groups = []
    while left:
        group = [left.pop(0)]
        for member in group:
            near = [row for row in left if squared_offset(row.voxel, member.voxel) <= limit]
            left = [row for row in left if squared_offset(row.voxel, member.voxel) > limit]
            group.extend(near)
        groups.append(sorted(group, key=lambda row: row.voxel))
    return groups


def contact_of(
    config: IntegratorConfig, kinds: Mapping[str, HypothesisKind], group: Sequence[Row]
) -> ExpectedContact:
    places = [centre_of(row.voxel, config.voxel_size) for row in group]
    weights = [row.likelihood for row in group]
    mass = sum(weights)
    centroid = weighted_mean(list(zip(weights, places, strict=True)))
    assert centroid is not None
    offsets = [vector(p - c for p, c in zip(place, centroid, strict=True)) for place in places]

    def moment(i: int, j: int) -> float:
        return sum(w * d[i] * d[j] for w, d in zip(weights, offsets, strict=True)) / mass

    within = sum(w * row.variance for w, row in zip(weights, group, strict=True)) / mass
    own = config.voxel_size**2 / 12 + within
    covariance = tuple(
        vector(moment(i, j) + (own if i == j else 0.0) for j in range(3)) for i in range(3)
    )
    felt = [(row.likelihood, row.force) for row in group if row.force is not None]
    sums = {
        name: sum(row.likelihoods.get(name, 0.0) for row in group)
        for name, kind in kinds.items()
        if kind is not HypothesisKind.NULL
    }
    return ExpectedContact(
        first=group[0].voxel,
        position=centroid,
        likelihood=max(weights),
        dispersion=math.sqrt(moment(0, 0) + moment(1, 1) + moment(2, 2)),
        covariance=covariance,
        extent=_extent(centroid, offsets, covariance),
        force=weighted_mean(felt),
        voxels=len(group),
        shares={name: total / sum(sums.values()) for name, total in sums.items()},
        stamp=max(row.stamp for row in group),
    )


def _extent(
    centroid: Vector, offsets: Sequence[Vector], covariance: tuple[Vector, ...]
) -> tuple[Vector, Vector] | None:
    if len(offsets) == 1:
        return centroid, centroid
    values, axes = np.linalg.eigh(np.array(covariance))
    if values[2] - values[1] <= TIE * values[2]:
        return None
    axis = vector(axes[:, 2].tolist())
    along = [sum(a * d for a, d in zip(axis, offset, strict=True)) for offset in offsets]
    start, end = (
        vector(c + reached * a for c, a in zip(centroid, axis, strict=True))
        for reached in (min(along), max(along))
    )
    return start, end
