"""The integrator at the work of the benchmark."""

import gc
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import FunctionType, ModuleType

import numpy as np

from benchmarks.interleave import Run
from benchmarks.naive import NaiveIntegrator, run_cycle
from benchmarks.surfaces import Floats
from benchmarks.twin import Twin
from benchmarks.workloads import LIVE_CYCLES, THRESHOLD, TIMEOUT, Cloud
from contactfusion import (
    Fusion,
    HypothesisCloud,
    HypothesisKind,
    Integrator,
    IntegratorConfig,
    arrays,
)
from contactfusion.integrator.condensations import ClusterCentroid, ClusterCentroidConfig

Cycles = Sequence[Sequence[Cloud]]
CONFIG = IntegratorConfig(rule="de_morgan", timeout=TIMEOUT, threshold=THRESHOLD)


def received(integrator: Integrator, cloud: Cloud) -> None:
    """Check a cloud as a user's generator hands it over, and receive it."""
    kind = HypothesisKind[cloud.kind]
    rows = (cloud.positions, cloud.likelihoods, cloud.forces, cloud.spreads)
    integrator.receive(HypothesisCloud(cloud.source, kind, cloud.stamp, "base", *rows))


def run_typical(integrator: Integrator, cycle: Sequence[Cloud]) -> Fusion:
    """Receive the clouds of one cycle, and step."""
    for cloud in cycle:
        received(integrator, cloud)
    return integrator.step(cycle[0].stamp)


def steady(integrator: Integrator, cycles: Cycles) -> Fusion:
    """Run some cycles, and give what the last one gave."""
    *before, last = cycles
    for cycle in before:
        run_typical(integrator, cycle)
    return run_typical(integrator, last)


class Lives:
    """The typical cycle, lived by the integrator, by its twin and by the naive version.

    Every run is one more cycle of a steady space; at the end of the cycles life starts again.
    """

    def __init__(self, cycles: Cycles, twin: Twin) -> None:
        """Prepare.

        Args:
            cycles: more than ``LIVE_CYCLES``.
            twin: with the same cycles loaded.
        """
        self._cycles, self._twin = cycles, twin
        self._integrator, self._naive = Integrator(CONFIG), NaiveIntegrator()

    def ours(self, space: bool = False) -> Run:
        """Make the run of the integrator, with or without a look at its space."""

        def cycle(number: int) -> float:
            if number == 0:
                self._integrator.reset()
            start = time.process_time()
            fusion = run_typical(self._integrator, self._cycles[number])
            if space:
                _ = fusion.space
            return time.process_time() - start

        return self._steady(cycle)

    def twin(self) -> Run:
        """Make the run of the twin."""

        def cycle(number: int) -> float:
            if number == 0:
                self._twin.reset()
            return self._twin.cycle(number)

        return self._steady(cycle)

    def naive(self) -> Run:
        """Make the run of the naive version."""

        def cycle(number: int) -> float:
            if number == 0:
                self._naive.space.clear()
            start = time.process_time()
            run_cycle(self._naive, self._cycles[number])
            return time.process_time() - start

        return self._steady(cycle)

    def _steady(self, cycle: Callable[[int], float]) -> Run:
        number = len(self._cycles)

        def run() -> float:
            nonlocal number
            if number == len(self._cycles):
                for number in range(LIVE_CYCLES):
                    cycle(number)
                number = LIVE_CYCLES
            seconds = cycle(number)
            number += 1
            return seconds

        return run


def condense_again(fusion: Fusion) -> Callable[[], object]:
    """Prepare the condensation of a fusion's field, contacts and all."""
    condensation = ClusterCentroid(ClusterCentroidConfig(), CONFIG.linking_distance)
    return lambda: tuple(condensation.condense(fusion.field, fusion.verdict_codes))


def fresh(cloud: Cloud, threshold: float = THRESHOLD) -> Callable[[], Fusion]:
    """Prepare fusion and condensation of one cloud in an empty space."""
    most = len(cloud.likelihoods)
    config = CONFIG.model_copy(update={"threshold": threshold, "max_hypotheses": most})
    return lambda: run_typical(Integrator(config), [cloud])


def frozen(cloud: Cloud) -> Cloud:
    """Give the cloud with read-only arrays, which are shared and not copied."""
    return replace(
        cloud,
        positions=arrays.frozen(cloud.positions),
        likelihoods=arrays.frozen(cloud.likelihoods),
        forces=None if cloud.forces is None else arrays.frozen(cloud.forces),
        spreads=None if cloud.spreads is None else arrays.frozen(cloud.spreads),
    )


def contact_rows(fusion: Fusion) -> Floats:
    """Give contacts as ``Twin.contacts`` does."""
    names = [source.name for source in fusion.field.entries.sources]
    rows = []
    for c in fusion.contacts:
        row = [*c.position, c.likelihood, c.dispersion, *c.covariance.ravel(), *c.extent.ravel()]
        rows.append([*row, *c.force, c.voxels, c.stamp, *(c.shares[name] for name in names)])
    return np.array(rows, np.float64)


def held_bytes(*roots: object) -> int:
    """Add up all memory that objects hold, arrays by what they were allocated with."""
    seen: set[int] = set()
    waiting, total = list(roots), 0
    while waiting:
        thing = waiting.pop()
        if id(thing) in seen or isinstance(thing, type | ModuleType | FunctionType):
            continue
        seen.add(id(thing))
        if isinstance(thing, np.ndarray):
            owner = thing.base if isinstance(thing.base, np.ndarray) else thing
            if id(owner) not in seen or owner is thing:
                total += owner.nbytes
            seen.add(id(owner))
        else:
            total += sys.getsizeof(thing)
            waiting += gc.get_referents(thing)
    return total


FIRST_CYCLE = """
import numpy as np
from contactfusion import HypothesisCloud, Integrator, IntegratorConfig
rng = np.random.default_rng(0)
integrator = Integrator(IntegratorConfig())
kinds = {"tactile": "regular", "wrist": "regular", "range": "regular", "motion": "support"}
for source, kind in kinds.items():
    forces = rng.normal(size=(1000, 3)) if source in ("tactile", "wrist") else None
    points, p = rng.uniform(0.0, 0.3, (1000, 3)), rng.uniform(0.1, 0.9, 1000)
    integrator.receive(HypothesisCloud(source, kind, 0.0, "base", points, p, forces))
assert integrator.step(0.0).contacts
"""


def first_cycle() -> float:
    """Import and step once in a fresh process.

    Returns:
        its CPU time [s].
    """
    child = os.posix_spawn(sys.executable, [sys.executable, "-c", FIRST_CYCLE], os.environ)
    _, status, usage = os.wait4(child, 0)
    if status != 0:
        raise RuntimeError(f"the first cycle of a fresh process failed with status {status}")
    return usage.ru_utime + usage.ru_stime
