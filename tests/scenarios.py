"""Random lives of an integrator: what happens to it, cycle by cycle.

A scenario is a list of actions that depends on its seed alone. It is drawn so that the rare cases
of method §1-3 come often: few voxels, shared by all sources, stamps on a common grid, timeouts and
tolerances that are hit exactly.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from random import Random

import numpy as np

from contactfusion.hypotheses import HypothesisCloud, HypothesisKind
from contactfusion.integrator.config import IntegratorConfig
from tests.clouds import law

Voxel = tuple[int, int, int]

OFFSETS = ((1, 0, 0), (1, -1, 0), (1, 1, 1), (0, 2, 1), (2, 1, -1), (2, 0, 2), (2, 2, 1), (0, 0, 3))
FRAME = "base"
NAMES = ("skin", "skin/free", "wrist", "range", "Lidar", "motion", "é", "a")
KINDS = (HypothesisKind.REGULAR, HypothesisKind.SUPPORT, HypothesisKind.NULL)
EDGE = 2**20 - 1
"""The last voxel of an axis."""


@dataclass(frozen=True)
class Plug:
    """A source is plugged in, or plugged again with other settings."""

    name: str
    kind: HypothesisKind
    timeout: float | None
    stale_after: float | None
    replace: bool


@dataclass(frozen=True)
class Unplug:
    """A source is taken out."""

    name: str


@dataclass(frozen=True)
class Receive:
    """A cloud comes in, good or bad."""

    cloud: HypothesisCloud


@dataclass(frozen=True)
class Ready:
    """Somebody asks whether all have reported."""

    now: float


@dataclass(frozen=True)
class Step:
    """A fusion.

    Attributes:
        now: when.
        look_later: whether its result is only looked at after the next step.
        without: a source to fuse again without.
    """

    now: float
    look_later: bool = False
    without: str | None = None


@dataclass(frozen=True)
class Reset:
    """The clock jumps back."""


Action = Plug | Unplug | Receive | Ready | Step | Reset


@dataclass(frozen=True)
class Scenario:
    """A configuration and all that happens under it."""

    seed: int
    config: IntegratorConfig
    actions: Sequence[Action]


@dataclass
class _Source:
    name: str
    kind: HypothesisKind
    period: int
    forces: float
    single: bool
    plugged: bool = False
    gone: bool = False
    silent_until: int = -1
    sent: list[int] = field(default_factory=list)


def scenario(seed: int) -> Scenario:
    """Draw the scenario of a seed: 30 to 42 cycles."""
    return _Author(seed).write()


class _Author:
    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.random = random = Random(seed)
        self.side = random.choice((0.005, 0.005, 0.01, 0.004, 0.02, 0.1, 0.3, 1 / 128))
        self.cycle_time = random.choice((0.1, 0.05, 0.01, 0.02, 0.125))
        self.start = random.choice((0.0, 0.0, 12.3, -5.0, 1.7e9))
        self.threshold = random.choice((0.1, 0.1, 0.3, 0.6, 0.7, 0.5, 0.05, 1.0))
        self.step_offset, tolerance = self._draw_tolerance()
        self.config = law(
            frame=FRAME,
            voxel_size=self.side,
            timeout=self._cycles(1, 6),
            expiry=random.choice(("source", "source", "voxel")),
            rule="de_morgan",
            condensation=random.choice(("cluster_centroid", "cluster_centroid", "threshold")),
            threshold=self.threshold,
            tolerance=tolerance,
            stale_after=self._cycles(3, 8),
            strict_sources=random.random() < 0.3,
            max_ahead=random.choice((0.0, 1.0, 2.0)) * self.cycle_time,
            min_voxels=random.choice((1, 1, 1, 2, 3)),
        )
        self.ahead = round(self.config.max_ahead / self.cycle_time)
        self.pool = self._draw_pool()
        self.sources = [
            _Source(
                name,
                random.choices(KINDS, (55, 25, 20))[0],
                random.choice((1, 1, 1, 2, 3)),
                random.choice((0.0, 0.5, 1.0)),
                random.random() < 0.2,
            )
            for name in random.sample(NAMES, random.randint(2, 6))
        ]
        self.actions: list[Action] = []

    def write(self) -> Scenario:
        for source in self.sources:
            if self.config.strict_sources or self._chance(0.6):
                self._plug(source)
        tick = 0
        for _ in range(self.random.randint(30, 42)):
            tick = self._cycle(tick)
        return Scenario(self.seed, self.config, self.actions)

    def _cycle(self, tick: int) -> int:
        if self._chance(0.01):
            self.actions.append(Reset())
            tick = max(0, tick - self.random.randint(0, 10))
            for source in self.sources:
                source.sent.clear()
        doings: list[Callable[[], None]] = [
            self._arrival(source, tick) for source in self.sources if self._speaks(source, tick)
        ]
        for chance, doing in (
            (0.15, self._change_plugs),
            (0.04, self._bad_cloud(tick)),
            (0.01, self._step_back(tick)),
            (0.10, self._ask(tick)),
        ):
            if self._chance(chance):
                doings.append(doing)
        self.random.shuffle(doings)
        for doing in doings:
            doing()
        if self._chance(0.6):
            self.actions.append(Ready(self._time(tick)))
        plugged = [source.name for source in self.sources if source.plugged]
        self.actions.append(
            Step(
                self._time(tick),
                look_later=self._chance(0.2),
                without=self.random.choice(plugged) if plugged and self._chance(0.1) else None,
            )
        )
        return tick + self.random.choices((0, 1, 2, 7), (5, 85, 8, 2))[0]

    def _speaks(self, source: _Source, tick: int) -> bool:
        if tick < source.silent_until:
            return False
        if self._chance(0.05):
            source.silent_until = tick + self.random.randint(3, 12)
        return tick % source.period == 0

    def _arrival(self, source: _Source, tick: int) -> Callable[[], None]:
        def arrive() -> None:
            stamp = self._draw_stamp(source, tick)
            self._send(source, stamp)
            if self._chance(0.15):
                self._send(source, stamp)
            if self._chance(0.03):
                self.actions.append(self.actions[-1])

        return arrive

    def _draw_stamp(self, source: _Source, tick: int) -> int:
        newest = max(source.sent, default=tick)
        draw = self.random.random()
        if draw < 0.65:
            return tick
        if draw < 0.73:
            return tick - 1
        if draw < 0.81:
            return newest
        if draw < 0.88:
            return newest - self.random.randint(1, 3)
        if draw < 0.94:
            return tick + self.ahead
        return tick + self.ahead + self.random.randint(1, 3)

    def _send(self, source: _Source, stamp: int) -> None:
        self._receive(source, self._draw_cloud(source, stamp))
        source.sent.append(stamp)

    def _receive(self, source: _Source, cloud: HypothesisCloud) -> None:
        self.actions.append(Receive(cloud))
        if not (source.plugged or source.gone or self.config.strict_sources):
            source.plugged, source.kind = True, cloud.kind

    def _plug(self, source: _Source) -> None:
        random = self.random
        self.actions.append(
            Plug(
                source.name,
                source.kind,
                random.choice((None, self._cycles(1, 6))),
                random.choice((None, self._cycles(3, 8))),
                self._chance(0.25),
            )
        )
        source.plugged, source.gone = True, False

    def _change_plugs(self) -> None:
        missing = [source for source in self.sources if not source.plugged]
        source = self.random.choice(self.sources + 3 * missing)
        draw = self.random.random()
        if not source.plugged:
            if source.gone and self._chance(0.3):
                source.kind = self.random.choice(KINDS)
            self._plug(source)
        elif draw < 0.6:
            self.actions.append(Unplug(source.name))
            source.plugged, source.gone = False, True
            source.sent.clear()
        elif draw < 0.9:
            self._plug(source)
        else:
            kind = self._another_kind(source)
            self.actions.append(Plug(source.name, kind, None, None, replace=True))

    def _another_kind(self, source: _Source) -> HypothesisKind:
        return self.random.choice([kind for kind in KINDS if kind is not source.kind])

    def _bad_cloud(self, tick: int) -> Callable[[], None]:
        def arrive() -> None:
            source = self.random.choice(self.sources)
            good = self._draw_cloud(source, tick)
            draw = self.random.random()
            if draw < 0.3:
                bad = replace(good, frame="elsewhere")
            elif draw < 0.6:
                bad = replace(good, kind=self._another_kind(source))
            else:
                far = self.random.choice((EDGE + 1.5, -EDGE - 0.5, 1e30)) * self.side
                bad = replace(
                    good,
                    positions=np.array([[0.0, far, 0.0]]),
                    likelihoods=np.array([self.random.choice((0.0, 0.5))]),
                    forces=None,
                    spreads=None,
                )
            self._receive(source, bad)

        return arrive

    def _step_back(self, tick: int) -> Callable[[], None]:
        stepped = bool(self.actions) and isinstance(self.actions[-1], Step)
        step = Step(self._time(tick) - 2.0 - 7 * self.cycle_time)
        return lambda: self.actions.append(step) if stepped else None

    def _ask(self, tick: int) -> Callable[[], None]:
        return lambda: self.actions.append(Ready(self._time(tick)))

    def _draw_cloud(self, source: _Source, stamp: int) -> HypothesisCloud:
        random = self.random
        count = 0 if self._chance(0.06) else random.randint(1, 10)
        voxels = random.choices(self.pool, k=count)
        likelihoods = self._draw_likelihoods(count)
        if source.single and (total := sum(likelihoods)) > 0:
            likelihoods = [p / total * random.choice((1.0, 0.8)) for p in likelihoods]
            likelihoods = [min(p, 1.0) for p in likelihoods]
        positions = np.array([self._point_in(voxel) for voxel in voxels]).reshape(count, 3)
        forces = np.array([[random.gauss(0, 10) for _ in range(3)] for _ in range(count)])
        spreads = np.array([random.uniform(0, self.side) for _ in range(count)])
        return HypothesisCloud(
            source=source.name,
            kind=source.kind,
            stamp=self._time(stamp),
            frame=FRAME,
            positions=positions,
            likelihoods=np.array(likelihoods),
            forces=forces.reshape(count, 3) if random.random() < source.forces else None,
            spreads=spreads if self._chance(0.2) else None,
            single=source.single,
        )

    def _draw_likelihoods(self, count: int) -> list[float]:
        random, threshold = self.random, self.threshold
        special = (
            0.0,
            1.0,
            1e-46,
            1e-30,
            threshold,
            threshold,
            1 - math.sqrt(1 - threshold),
            1 - math.sqrt(1 - threshold),
            max(threshold - 5e-7, 0.0),
            max(threshold - 2e-6, 0.0),
        )
        style = random.random()
        if style < 0.3:
            return [random.random() for _ in range(count)]
        if style < 0.5:
            return [random.uniform(0, 0.2) for _ in range(count)]
        if style < 0.6:
            return [threshold] * count
        if style < 0.65:
            return [0.0] * count
        return [random.choice(special) for _ in range(count)]

    def _draw_tolerance(self) -> tuple[Voxel, float | None]:
        """Give an offset between two voxels and the tolerance that it fills to the last bit."""
        random = self.random
        if self._chance(0.4):
            return random.choice(((2, 0, 0), (0, 2, 0), (0, 0, -2))), None
        if self._chance(0.15):
            offset = random.choice(((1, 0, 0), (0, 1, 0), (0, 0, 1)))
            return offset, random.choice((1.0, 3.5)) * random.uniform(0.3, 0.99) * self.side
        offset = random.choice(OFFSETS)
        return offset, math.sqrt(sum(component**2 for component in offset)) * self.side

    def _draw_pool(self) -> list[Voxel]:
        """Give the few voxels in which all of it happens."""
        random = self.random
        middle = random.choice(((0, 0, 0), (0, 0, 0), (-1, 3, -2), (-100_000, 7, 250_000)))
        if self._chance(0.05):
            middle = (EDGE - 16, -EDGE + 16, 0)

        def near(x: int, y: int, z: int) -> Voxel:
            return middle[0] + x, middle[1] + y, middle[2] + z

        dx, dy, dz = self.step_offset
        line = [near(n * dx, n * dy, n * dz) for n in range(-3, 5)]
        block = [near(x, y, 0) for x, y in itertools.product(range(-2, 2), repeat=2)]
        strewn = [near(*(random.randint(-5, 5) for _ in range(3))) for _ in range(12)]
        two = [near(x + s, y, 1) for s in (-4, 4) for x in (0, 1) for y in (0, 1)]
        bridge = [near(x, 0, 1) for x in range(-2, 4)]
        pools = (line, line, line + strewn, block, block + strewn, strewn, two + bridge)
        pool = random.choice(pools)
        return [*pool, (EDGE, -EDGE, EDGE)] if self._chance(0.05) else pool

    def _point_in(self, voxel: Voxel) -> list[float]:
        draw = self.random.random()
        if EDGE in map(abs, voxel):
            draw = 0.2
        if draw < 0.15:
            return [index * self.side for index in voxel]
        if draw < 0.3:
            return [(index + 0.5) * self.side for index in voxel]
        return [(index + self.random.uniform(0.01, 0.99)) * self.side for index in voxel]

    def _cycles(self, low: int, high: int) -> float:
        return self.random.randint(low, high) * self.cycle_time

    def _time(self, tick: int) -> float:
        return self.start + tick * self.cycle_time

    def _chance(self, probability: float) -> bool:
        return self.random.random() < probability
