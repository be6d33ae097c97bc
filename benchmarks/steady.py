"""What condensation receives in the typical cycle, worked out apart from any integrator."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.surfaces import Floats
from benchmarks.workloads import LIVE_CYCLES, THRESHOLD, VOXEL_SIZE, Cloud

_BITS, _HALF = 21, 2**20  # 21 bits an axis


@dataclass(frozen=True)
class FusedVoxels:
    """The voxels whose fused likelihood reaches the threshold.

    Attributes:
        voxels: shape (m, 3), integer places, by ascending (ix, iy, iz).
        likelihoods: shape (m,), the fused H.
        live: how many voxels have a live entry, these among them.
    """

    voxels: NDArray[np.int64]
    likelihoods: Floats
    live: int

    @property
    def positions(self) -> Floats:
        """The centres of the voxels, shape (m, 3) [m]."""
        centres: Floats = (self.voxels.astype(np.float64) + 0.5) * VOXEL_SIZE
        return centres


def voxel_keys(positions: Floats) -> NDArray[np.int64]:
    """Pack the voxel of every point into one integer that keeps the order of (ix, iy, iz).

    Args:
        positions: shape (n, 3) [m].

    Returns:
        shape (n,).
    """
    ix, iy, iz = (np.floor(positions * (1.0 / VOXEL_SIZE)).astype(np.int64) + _HALF).T
    keys: NDArray[np.int64] = (ix << 2 * _BITS) | (iy << _BITS) | iz
    return keys


def unpack(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give the voxels that keys stand for.

    Args:
        keys: shape (n,).

    Returns:
        shape (n, 3).
    """
    mask = (1 << _BITS) - 1
    axes = (keys >> 2 * _BITS, keys >> _BITS & mask, keys & mask)
    return np.column_stack(axes) - _HALF


def fuse(cycles: Sequence[Sequence[Cloud]]) -> FusedVoxels:
    """Fuse by De Morgan what still lives at the last of these cycles.

    Args:
        cycles: successive cycles, the first ones possibly long expired.

    Returns:
        the voxels with Regular evidence whose H reaches the threshold.
    """
    live = [cloud for cycle in cycles[-LIVE_CYCLES:] for cloud in cycle]
    keys = np.unique(np.concatenate([voxel_keys(cloud.positions) for cloud in live]))
    none_true = np.ones(len(keys))
    regular = np.zeros(len(keys), dtype=bool)
    for source in sorted({cloud.source for cloud in live}):
        clouds = [cloud for cloud in live if cloud.source == source]
        entries, likelihoods = _newest(clouds)
        rows = np.searchsorted(keys, entries)
        none_true[rows] *= 1.0 - likelihoods
        regular[rows] |= clouds[0].kind == "REGULAR"
    contact = regular & (none_true <= 1.0 - THRESHOLD + 1e-6)
    return FusedVoxels(unpack(keys[contact]), 1.0 - none_true[contact], len(keys))


def _newest(clouds: Sequence[Cloud]) -> tuple[NDArray[np.int64], Floats]:
    """Keep of one source, per voxel, the largest likelihood of the newest stamp."""
    keys = np.concatenate([voxel_keys(cloud.positions) for cloud in clouds])
    likelihoods = np.concatenate([cloud.likelihoods for cloud in clouds]).astype(np.float32)
    stamps = np.repeat([cloud.stamp for cloud in clouds], [len(c.positions) for c in clouds])
    order = np.lexsort((likelihoods, stamps, keys))
    last = np.flatnonzero(np.diff(keys[order], append=np.int64(-1)))
    return keys[order[last]], likelihoods[order[last]].astype(np.float64)
