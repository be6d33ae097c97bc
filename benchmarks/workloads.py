"""The workloads of the benchmark: deterministic, given a generator of random numbers."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from benchmarks.surfaces import Body, Floats, on_bodies, random_rotation

VOXEL_SIZE = 0.005  # m
THRESHOLD = 0.1
PERIOD = 0.01  # s, between two cycles
TIMEOUT = 0.2  # s
LIVE_CYCLES = round(TIMEOUT / PERIOD) + 1  # an entry exactly at its timeout still lives
COUNTS = {"tactile": 100, "force_torque": 250, "range": 10_000, "motion": 5_000, "simulator": 1_000}

_SPREADS = {"tactile": 2e-3, "force_torque": 1e-2, "range": 3e-3, "motion": 5e-3, "simulator": 2e-2}
ARM_LENGTH, ARM_RADIUS = 0.8, 0.03  # m
_RINGS, _PER_RING, _OBJECT_WIDTHS = 8, 3, (0.055, 0.075)  # widths in m
_SPEED, _ORBIT = 0.046, 0.02  # m/s and m: everything circles, so every cycle sweeps as much space
_RANGE_NOISE, _RANGE_REACH = 0.0025, 0.032  # m
_RANGE_LAMBDA = 0.01  # m
_KINDS: dict[str, Literal["REGULAR", "SUPPORT"]] = {
    "tactile": "REGULAR",
    "force_torque": "REGULAR",
    "range": "REGULAR",
    "motion": "SUPPORT",
    "simulator": "SUPPORT",
}
_SHAPES: tuple[Literal["box", "cylinder", "ball"], ...] = ("box", "cylinder", "ball")


@dataclass(frozen=True)
class Cloud:
    """What one source gives in one cycle.

    Attributes:
        source: its name.
        kind: the name of its ``HypothesisKind``.
        stamp: [s].
        positions: shape (n, 3) [m].
        likelihoods: shape (n,).
        forces: shape (n, 3) [N], or None.
        spreads: shape (n,) [m], or None.
    """

    source: str
    kind: Literal["REGULAR", "SUPPORT"]
    stamp: float
    positions: Floats
    likelihoods: Floats
    forces: Floats | None = None
    spreads: Floats | None = None


def typical_cycles(
    rng: np.random.Generator, count: int, *, spreads: bool = False
) -> list[list[Cloud]]:
    """Make the typical cycle: 16,350 hypotheses of five sources, every 10 ms.

    An arm lies among objects and carries them along. After ``LIVE_CYCLES`` cycles the space is
    steady: about 35k voxels live, of which about 25k reach the threshold.

    Args:
        rng: the only source of chance.
        count: how many cycles.
        spreads: whether hypotheses carry their position uncertainty.

    Returns:
        ``count`` cycles, each one cloud per source; cycle k is stamped k · 10 ms.
    """
    pose = random_rotation(rng)
    size = np.array([2.0 * ARM_RADIUS, 2.0 * ARM_RADIUS, ARM_LENGTH])
    arm = Body("cylinder", size, np.zeros(3), pose)
    objects = _objects_along(rng, pose)
    cycles = [_cycle(rng, arm, objects, k * PERIOD) for k in range(count)]
    if spreads:
        return [[_with_spreads(cloud) for cloud in cycle] for cycle in cycles]
    return cycles


def fresh_cloud(rng: np.random.Generator, count: int) -> Cloud:
    """Make one cloud on surfaces whose area grows with it: about two points a voxel.

    Args:
        rng: the only source of chance.
        count: how many hypotheses, from 10k to 10M.

    Returns:
        a shuffled Regular cloud, every likelihood over the threshold.
    """
    area = count * 2.75e-5 / 2.0  # m²: what one voxel holds of a surface, for two points
    bodies = max(1, count // 5000)
    width = np.sqrt(area / bodies / 5.0)
    side = int(np.ceil(bodies ** (1.0 / 3.0)))
    cells = rng.permutation(side**3)[:bodies]
    centres = np.column_stack(np.unravel_index(cells, (side, side, side))) * (2.0 * width)
    scene = [
        Body(_SHAPES[i % 3], np.full(3, width), centre, random_rotation(rng))
        for i, centre in enumerate(centres)
    ]
    points = on_bodies(rng, scene, count)
    return Cloud("fresh", "REGULAR", 0.0, points, rng.uniform(0.15, 0.95, count))


def _objects_along(rng: np.random.Generator, pose: Floats) -> list[Body]:
    """Set rings of objects along the arm, each object just touching it, with gaps between."""
    objects = []
    for i in range(_RINGS * _PER_RING):
        ring, place = divmod(i, _PER_RING)
        along = ((ring + 0.5) / _RINGS - 0.5) * ARM_LENGTH
        angle = 2.0 * np.pi * place / _PER_RING + ring
        width = rng.uniform(*_OBJECT_WIDTHS)
        away = ARM_RADIUS + width / 2.0
        centre = np.array([away * np.cos(angle), away * np.sin(angle), along])
        size = np.full(3, width)
        objects.append(Body(_SHAPES[i % 3], size, pose @ centre, random_rotation(rng)))
    return objects


def _cycle(rng: np.random.Generator, arm: Body, objects: list[Body], stamp: float) -> list[Cloud]:
    phase = _SPEED * stamp / _ORBIT
    across, _, along = arm.rotation.T
    moved = _ORBIT * (np.cos(phase) * across + np.sin(phase) * along)
    ahead = _SPEED * PERIOD * (np.cos(phase) * along - np.sin(phase) * across)

    seen = on_bodies(rng, objects, 4 * COUNTS["range"])
    seen = seen + rng.normal(0.0, _RANGE_NOISE, seen.shape)
    distances = _distance(arm, seen)
    near = np.flatnonzero(distances < _RANGE_REACH)[: COUNTS["range"]]
    seen, distances = seen[near], distances[near]
    likely = _RANGE_LAMBDA**2 / (_RANGE_LAMBDA**2 + distances**2)  # F Eq 5
    touching = seen[np.argsort(distances)[: COUNTS["simulator"]]]
    touched = arm.sample(rng, 4000)
    contact = arm.rotation @ np.array([ARM_RADIUS, 0.0, ARM_LENGTH / 4.0])
    touched = touched[np.argsort(np.linalg.norm(touched - contact, axis=1))]
    skin = rng.permutation(touched[: COUNTS["tactile"]])
    wrist = rng.permutation(touched[: COUNTS["force_torque"]])

    def cloud(source: str, points: Floats, p: Floats | float, force: float = 0.0) -> Cloud:
        n = len(points)
        forces = rng.normal(force, 0.1, (n, 3)) if force else None
        return Cloud(source, _KINDS[source], stamp, points + moved, np.full(n, p), forces)

    return [
        cloud("tactile", skin, rng.uniform(0.02, 0.95, len(skin)), force=1.0),
        cloud("force_torque", wrist, 1.0 / len(wrist), force=5.0),
        cloud("range", seen, likely),
        cloud("motion", arm.sample(rng, COUNTS["motion"]) + ahead, 0.3),
        cloud("simulator", rng.permutation(touching), 0.5),
    ]


def _with_spreads(cloud: Cloud) -> Cloud:
    spreads = np.full(len(cloud.positions), _SPREADS[cloud.source])
    return replace(cloud, spreads=spreads)


def _distance(arm: Body, points: Floats) -> Floats:
    local = points @ arm.rotation
    radial = np.maximum(np.hypot(local[:, 0], local[:, 1]) - ARM_RADIUS, 0.0)
    axial = np.maximum(np.abs(local[:, 2]) - ARM_LENGTH / 2.0, 0.0)
    return np.hypot(radial, axial)
