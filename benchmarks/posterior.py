"""The rule `posterior` and its modes at the typical cycle, over the surface of the arm."""

import time
from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks import ours
from benchmarks.interleave import Spread
from benchmarks.surfaces import Body, random_rotation
from benchmarks.table import Row
from benchmarks.workloads import (
    ARM_LENGTH,
    ARM_RADIUS,
    LIVE_CYCLES,
    THRESHOLD,
    TIMEOUT,
    Cloud,
    typical_cycles,
)
from contactfusion import HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.surface import Surface

POINTS = 20_000
"""Of the robot's surface."""
ON_ARM = 9_800
"""So many of them on the arm: they are 4 mm apart there, as in a model of a robot."""
FOLLOWING = ("tactile", "force_torque")
"""Sources that follow a contact: each cloud takes the place of the one before."""
CYCLES = 20
"""Of a round, once the space is steady."""
CONFIG = IntegratorConfig(
    timeout=TIMEOUT, threshold=THRESHOLD, rule="posterior", condensation="modes"
)


def rows(rounds: int) -> Iterator[Row]:
    """Measure the typical cycle with spreads; the wrench describes one contact."""
    raw = typical_cycles(np.random.default_rng(0), LIVE_CYCLES + CYCLES, spreads=True)
    cycles = [[ours.frozen(cloud) for cloud in cycle] for cycle in raw]
    for name, count in (("", ON_ARM), (", all near evidence", POINTS)):
        surface = _robot(np.random.default_rng(0), count)
        medians = [1e3 * float(np.median(_lived(cycles, surface))) for _ in range(rounds + 1)][1:]
        label = f"posterior/modes, {POINTS:,} surface points{name}"
        yield Row(label, Spread.of(medians), "ms", None if name else 10.0)


def _robot(rng: np.random.Generator, on_arm: int) -> Surface:
    """Sample the arm of the typical cycle, which lies as it does there, and its base away from it.

    Args:
        rng: the arm lies by its first numbers.
        on_arm: how many of the points are on the arm; the others are far from all evidence.
    """
    rotation = random_rotation(rng)
    size = np.array([2.0 * ARM_RADIUS, 2.0 * ARM_RADIUS, ARM_LENGTH])
    points = Body("cylinder", size, np.zeros(3), rotation).sample(rng, POINTS)
    local = points @ rotation
    outward = np.where(
        np.abs(np.abs(local[:, 2:]) - ARM_LENGTH / 2.0) < 1e-9,
        np.sign(local[:, 2:]) * np.array([0.0, 0.0, 1.0]),
        local * np.array([1.0, 1.0, 0.0]),
    )
    normals = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    points[on_arm:] += 2.0 * ARM_LENGTH * rotation[:, 0]
    return Surface("base", points, normals @ rotation.T)


def _lived(cycles: Sequence[Sequence[Cloud]], surface: Surface) -> list[float]:
    """Live all cycles; give the CPU time of each once the space is steady [s]."""
    integrator, seconds = Integrator(CONFIG), []
    for source in FOLLOWING:
        integrator.plug(source, replace=True)
    for cycle in cycles:
        start = time.process_time()
        for cloud in cycle:
            integrator.receive(_handed_over(cloud))
        fusion = integrator.step(cycle[0].stamp, surface)
        seconds.append(time.process_time() - start)
        assert fusion.contacts
    return seconds[LIVE_CYCLES:]


def _handed_over(cloud: Cloud) -> HypothesisCloud:
    kind = HypothesisKind[cloud.kind]
    arrays = (cloud.positions, cloud.likelihoods, cloud.forces, cloud.spreads)
    single = cloud.source == "force_torque"
    return HypothesisCloud(cloud.source, kind, cloud.stamp, "base", *arrays, single=single)
