"""The paper's algorithm as printed (F Algorithm 1, Eq 1, §III-C) in plain Python, the baseline.

One script, a dict of voxels, each a dict with a dict of likelihoods. It keeps one stamp per voxel,
as the paper does, and is not the oracle of the tests: those follow the specification.
"""

import math
from collections.abc import Sequence
from typing import TypedDict

from benchmarks.workloads import THRESHOLD, TIMEOUT, VOXEL_SIZE, Cloud

Voxel = tuple[int, int, int]
Vector = tuple[float, float, float]

_NEIGHBOURS = [
    (dx, dy, dz)
    for dx in range(-2, 3)
    for dy in range(-2, 3)
    for dz in range(-2, 3)
    if 0 < dx * dx + dy * dy + dz * dz <= 4
]


class Hypothesis(TypedDict):
    """What the space keeps of one voxel; magnitude in N, weight the Σ p behind the force."""

    likelihoods: dict[str, float]
    kinds: set[str]
    stamp: float
    magnitude: float
    direction: Vector
    weight: float


class NaiveIntegrator:
    """Felip's integrator: add hypotheses one by one, fuse, threshold, cluster, take centroids."""

    def __init__(self) -> None:
        """Start with an empty space."""
        self.space: dict[Voxel, Hypothesis] = {}

    def receive(self, cloud: Cloud) -> None:
        """Process incoming hypotheses (F Algorithm 1).

        Args:
            cloud: the hypotheses of one source.
        """
        likelihoods = cloud.likelihoods.tolist()
        forces = [None] * len(likelihoods) if cloud.forces is None else cloud.forces.tolist()
        for (x, y, z), p, force in zip(cloud.positions.tolist(), likelihoods, forces, strict=True):
            voxel = (
                math.floor(x / VOXEL_SIZE),
                math.floor(y / VOXEL_SIZE),
                math.floor(z / VOXEL_SIZE),
            )
            if voxel in self.space:
                hypothesis = self.space[voxel]
                hypothesis["likelihoods"][cloud.source] = p
                hypothesis["kinds"].add(cloud.kind)
                hypothesis["stamp"] = cloud.stamp
            else:
                hypothesis = self.space[voxel] = {
                    "likelihoods": {cloud.source: p},
                    "kinds": {cloud.kind},
                    "stamp": cloud.stamp,
                    "magnitude": 0.0,
                    "direction": (0.0, 0.0, 0.0),
                    "weight": 0.0,
                }
            if force is not None:
                _average_force(hypothesis, force, p)

    def step(self, now: float) -> list[tuple[Vector, float]]:
        """Expire, fuse and condense.

        Args:
            now: [s].

        Returns:
            of each contact its place [m] and its likelihood.
        """
        expired = [v for v, h in self.space.items() if now - h["stamp"] > TIMEOUT]
        for voxel in expired:
            del self.space[voxel]
        contacts = self.contact_voxels()
        return [_centroid(cluster, contacts) for cluster in clusters(contacts)]

    def contact_voxels(self) -> dict[Voxel, float]:
        """Fuse every voxel by De Morgan (F Eq 1) and keep those over the threshold.

        Returns:
            the fused likelihood of each; Null and lone Support hypotheses are discarded.
        """
        contacts = {}
        for voxel, hypothesis in self.space.items():
            kinds = hypothesis["kinds"]
            if "NULL" in kinds or "REGULAR" not in kinds:
                continue
            none_true = 1.0
            for p in hypothesis["likelihoods"].values():
                none_true *= 1.0 - p
            if 1.0 - none_true >= THRESHOLD:
                contacts[voxel] = 1.0 - none_true
        return contacts


def clusters(voxels: dict[Voxel, float]) -> list[list[Voxel]]:
    """Cluster voxels whose centres lie within two sides of each other.

    Args:
        voxels: the voxels to cluster; their values play no part.

    Returns:
        the voxels of each cluster.
    """
    unseen = set(voxels)
    found = []
    while unseen:
        seed = unseen.pop()
        cluster = [seed]
        for x, y, z in cluster:  # grows while it is walked: a breadth-first flood
            for dx, dy, dz in _NEIGHBOURS:
                neighbour = (x + dx, y + dy, z + dz)
                if neighbour in unseen:
                    unseen.remove(neighbour)
                    cluster.append(neighbour)
        found.append(cluster)
    return found


def run_cycle(integrator: NaiveIntegrator, cycle: Sequence[Cloud]) -> list[tuple[Vector, float]]:
    """Give one cycle to the naive integrator.

    Args:
        integrator: changed.
        cycle: its clouds, of one stamp.

    Returns:
        the contacts, as ``NaiveIntegrator.step`` gives them.
    """
    for cloud in cycle:
        integrator.receive(cloud)
    return integrator.step(cycle[0].stamp)


def _average_force(hypothesis: Hypothesis, force: Sequence[float], p: float) -> None:
    """Average magnitude and direction apart, weighted by likelihood, as the paper does."""
    magnitude = math.hypot(*force)
    if magnitude == 0.0 or p == 0.0:
        return
    old = hypothesis["weight"] / (hypothesis["weight"] + p)
    new = 1.0 - old
    x, y, z = hypothesis["direction"]
    hypothesis["direction"] = (
        old * x + new * force[0] / magnitude,
        old * y + new * force[1] / magnitude,
        old * z + new * force[2] / magnitude,
    )
    hypothesis["magnitude"] = old * hypothesis["magnitude"] + new * magnitude
    hypothesis["weight"] += p


def _centroid(cluster: Sequence[Voxel], likelihoods: dict[Voxel, float]) -> tuple[Vector, float]:
    total = sx = sy = sz = 0.0
    for x, y, z in cluster:
        h = likelihoods[x, y, z]
        total += h
        sx += h * (x + 0.5) * VOXEL_SIZE
        sy += h * (y + 0.5) * VOXEL_SIZE
        sz += h * (z + 0.5) * VOXEL_SIZE
    best = max(likelihoods[voxel] for voxel in cluster)
    return (sx / total, sy / total, sz / total), best
