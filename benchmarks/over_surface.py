"""The default rule beside others at the typical cycle, over the surface of the arm.

`python -m benchmarks.over_surface` prints the medians [ms] alone, for another CPU by the variables
of `haswell`.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from llvmlite.binding import get_host_cpu_features

from benchmarks import ours
from benchmarks.interleave import Spread
from benchmarks.surfaces import Body, random_rotation
from benchmarks.table import Row
from benchmarks.workloads import (
    ARM_LENGTH,
    ARM_RADIUS,
    LIVE_CYCLES,
    TIMEOUT,
    Cloud,
    typical_cycles,
)
from contactfusion import HypothesisCloud, HypothesisKind, Integrator, IntegratorConfig
from contactfusion.shapes import ShapeConfig
from contactfusion.surface import Surface

POINTS = 20_000
"""Of the robot's surface."""
ON_ARM = 9_800
"""So many of them on the arm: they are 4 mm apart there, as in a model of a robot."""
FOLLOWING = ("tactile", "force_torque")
"""Sources that follow a contact: each cloud takes the place of the one before."""
CYCLES = 20
"""Of a round, once the space is steady."""
HASWELL = "haswell"
"""A CPU with AVX2 and without AVX-512, as robots have."""
RULES = {"sets/members": "sets", "de_morgan": "de_morgan"}
PRESSES = (8, 16)
"""Numbers of contacts of which the growth is measured."""
SPACING = 0.004
"""Of the points of the plate that is pressed [m]."""


def rows(rounds: int) -> Iterator[Row]:
    """Measure the typical cycle with spreads; the wrench describes one contact."""
    native, haswell = _rounds(rounds), _elsewhere(rounds)
    for name, times in native.items():
        asked = 15.0 if name == "sets/members" else None
        yield Row(f"{name}, {POINTS:,} surface points", Spread.of(times), "ms", asked)
    ours_, theirs = native["sets/members"], haswell["sets/members"]
    for name, times in haswell.items():
        asked = 20.0 if name == "sets/members" else None
        yield Row(f"{name} as on {HASWELL}", Spread.of(times), "ms", asked)
    slower = [there / here for there, here in zip(theirs, ours_, strict=True)]
    yield Row("  sets/members there against the native one", Spread.of(slower), "x time", 2.0)
    few, many = ([_pressed(count) for _ in range(rounds + 1)][1:] for count in PRESSES)
    grown = [more / less for more, less in zip(many, few, strict=True)]
    yield Row(f"sets/members, {PRESSES[0]} presses of a skin", Spread.of(few), "ms")
    yield Row("  twice as many against it", Spread.of(grown), "x time", 2.2)
    denser = [_pressed(PRESSES[0], SPACING / np.sqrt(2.0)) for _ in range(rounds + 1)][1:]
    grown = [more / less for more, less in zip(denser, few, strict=True)]
    yield Row("  twice as many surface points against it", Spread.of(grown), "x time", 2.2)


def _rounds(rounds: int) -> Mapping[str, list[float]]:
    """The median of each rule in each round [ms]."""
    raw = typical_cycles(np.random.default_rng(0), LIVE_CYCLES + CYCLES, spreads=True)
    cycles = [[ours.frozen(cloud) for cloud in cycle] for cycle in raw]
    surface = _robot(np.random.default_rng(0), ON_ARM)
    configs = {name: IntegratorConfig(rule=rule, timeout=TIMEOUT) for name, rule in RULES.items()}
    found = [
        {name: _median(cycles, surface, config) for name, config in configs.items()}
        for _ in range(rounds + 1)
    ]
    return {name: [each[name] for each in found[1:]] for name in RULES}  # the first compiles


def _elsewhere(rounds: int) -> Mapping[str, list[float]]:
    """The rounds of a process that compiles for another CPU."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.over_surface", str(rounds)],
        env={**os.environ, **haswell()}, check=True, capture_output=True, text=True,
    )  # fmt: skip
    times: dict[str, list[float]] = json.loads(done.stdout)
    return times


def haswell() -> dict[str, str]:
    """The environment in which numba compiles for that CPU: its name alone leaves AVX-512 on."""
    features = get_host_cpu_features()
    for name in features:
        features[name] &= not name.startswith("avx512")
    return {"NUMBA_CPU_NAME": HASWELL, "NUMBA_CPU_FEATURES": features.flatten()}


def _pressed(count: int, spacing: float = SPACING) -> float:
    """The median of a cycle in which a skin is pressed at so many places [ms].

    Args:
        count: of the places.
        spacing: of the surface's points [m].
    """
    plate = ShapeConfig(shape="rectangle", size=(0.4, 0.2)).sampled("base", spacing)
    x, y = np.meshgrid(np.linspace(-0.18, 0.18, 8), np.linspace(-0.08, 0.08, count // 8 + 1)[1:])
    middles = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    around = np.array([(i, j, 0.0) for i in (-1, 0, 1) for j in (-1, 0, 1)]) * SPACING
    points = (middles[:, None] + around).reshape(-1, 3)
    full = np.full(len(points), 0.9), None, np.full(len(points), SPACING)
    cycles = [[Cloud("tactile", "REGULAR", 0.01 * k, points, *full)] for k in range(CYCLES)]
    return _median(cycles, plate, IntegratorConfig(timeout=TIMEOUT))


def _median(cycles: Sequence[Sequence[Cloud]], surface: Surface, config: IntegratorConfig) -> float:
    """The median CPU time of the last cycles, once the space is steady [ms]."""
    integrator, seconds = Integrator(config), []
    for source in FOLLOWING:
        integrator.plug(source, replace=True)
    for cycle in cycles:
        start = time.process_time()
        for cloud in cycle:
            integrator.receive(_handed_over(cloud))
        fusion = integrator.step(cycle[0].stamp, surface)
        seconds.append(time.process_time() - start)
        assert fusion.contacts
    return 1e3 * float(np.median(seconds[-CYCLES:]))


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


def _handed_over(cloud: Cloud) -> HypothesisCloud:
    kind = HypothesisKind[cloud.kind]
    arrays = (cloud.positions, cloud.likelihoods, cloud.forces, cloud.spreads)
    single = cloud.source == "force_torque"
    return HypothesisCloud(cloud.source, kind, cloud.stamp, "base", *arrays, single=single)


if __name__ == "__main__":
    print(json.dumps(dict(_rounds(int(sys.argv[1])))))
