"""Public libraries at the integrator's work, each in its fastest documented settings, one thread.

A peer is prepared once, its data in the form that it likes best, and then run many times. Settings
were chosen by measuring: where a documented variant is slower, it is named next to the choice.
"""

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from benchmarks.steady import FusedVoxels
from benchmarks.surfaces import Floats
from benchmarks.workloads import VOXEL_SIZE, Cloud

# Squared offsets of voxels are whole: 2.1 sides takes 4 and leaves 5, whatever rounding does.
VOXEL_TOLERANCE = 2.1 * VOXEL_SIZE  # m
POINT_TOLERANCE = 2.0 * VOXEL_SIZE  # m


@dataclass(frozen=True)
class Clusters:
    """What a peer found.

    Attributes:
        labels: shape (m,), the cluster of each row.
        centroids: shape (clusters, 3) [m], weighted.
    """

    labels: NDArray[np.integer[Any]]
    centroids: Floats


Condense = Callable[[], Clusters]


def same_partition(a: NDArray[np.integer[Any]], b: NDArray[np.integer[Any]]) -> bool:
    """Say whether two labellings part the rows alike, whatever names they give the parts.

    Args:
        a: shape (m,).
        b: shape (m,).

    Returns:
        whether rows share a label in ``a`` just when they share one in ``b``.
    """
    if len(a) != len(b):
        return False
    pairs = np.unique(np.stack((a, b)), axis=1).shape[1]
    return bool(pairs == len(np.unique(a)) == len(np.unique(b)))


def scipy_peer(fused: FusedVoxels) -> Condense:
    """Prepare KDTree pairs and connected components (a balanced tree is no faster)."""
    points, weights = fused.positions, fused.likelihoods

    def run() -> Clusters:
        tree = KDTree(points, balanced_tree=False)
        pairs = tree.query_pairs(VOXEL_TOLERANCE, output_type="ndarray")
        ones = np.ones(len(pairs), dtype=np.int8)
        graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
        labels = connected_components(graph, directed=False)[1]
        return Clusters(labels, _centroids(labels, points, weights))

    return run


def open3d_peer(fused: FusedVoxels) -> Condense:
    """Prepare Open3D's ``cluster_dbscan``."""
    open3d = importlib.import_module("open3d")
    points, weights = fused.positions, fused.likelihoods
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))

    def run() -> Clusters:
        labels = np.asarray(cloud.cluster_dbscan(eps=VOXEL_TOLERANCE, min_points=1))
        return Clusters(labels, _centroids(labels, points, weights))

    return run


def sklearn_peer(fused: FusedVoxels) -> Condense:
    """Prepare scikit-learn's DBSCAN (here its ball tree is faster than its k-d tree)."""
    cluster = importlib.import_module("sklearn.cluster")
    points, weights = fused.positions, fused.likelihoods
    dbscan = cluster.DBSCAN(eps=VOXEL_TOLERANCE, min_samples=1, algorithm="ball_tree", n_jobs=1)

    def run() -> Clusters:
        labels = dbscan.fit(points).labels_
        return Clusters(labels, _centroids(labels, points, weights))

    return run


def cc3d_peer(fused: FusedVoxels) -> Condense:
    """Prepare cc3d on the cropped dense array, then merge what lies two sides apart on an axis.

    Of the squared offsets up to 4, the 26 neighbours cover 1 to 3; 4 is (±2, 0, 0) and its like.
    """
    cc3d = importlib.import_module("cc3d")
    voxels, weights = fused.voxels, fused.likelihoods

    def run() -> Clusters:
        columns = np.ascontiguousarray(voxels.T)
        low = columns.min(axis=1)
        shape = [int(edge) for edge in columns.max(axis=1) - low + 3]  # two empty ones to look into
        strides = (1, shape[0], shape[0] * shape[1])
        x, y, z = columns - low[:, None]
        places = x + y * strides[1] + z * strides[2]
        dense = np.zeros(int(np.prod(shape)), dtype=np.uint8)
        dense[places] = 1
        image = dense.reshape(shape, order="F")
        labelled = cc3d.connected_components(image, connectivity=26, binary_image=True)
        labels = _merge_ahead(labelled.reshape(-1, order="F"), places, strides)
        centres = _centroids(labels, columns.T, weights)
        return Clusters(labels, (centres + 0.5) * VOXEL_SIZE)

    return run


def open3d_fresh(cloud: Cloud) -> Condense:
    """Prepare Open3D from hypotheses to centroids: ``voxel_down_sample``, then ``cluster_dbscan``.

    It keeps no likelihoods, which makes it faster: ``voxel_down_sample_and_trace`` and
    the tensor point cloud take about three times as long.
    """
    down_sample = open3d_fuse(cloud)

    def run() -> Clusters:
        voxels = down_sample()
        labels = np.asarray(voxels.cluster_dbscan(eps=POINT_TOLERANCE, min_points=1))
        return Clusters(labels, _centroids(labels, np.asarray(voxels.points), None))

    return run


def open3d_fuse(cloud: Cloud) -> Callable[[], Any]:
    """Prepare Open3D's ``voxel_down_sample`` alone; a run gives the down-sampled cloud."""
    open3d = importlib.import_module("open3d")
    places = cloud.positions.copy()  # Open3D refuses read-only arrays
    points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(places))

    def run() -> Any:
        return points.voxel_down_sample(VOXEL_SIZE)

    return run


CONDENSE: Mapping[str, Callable[[FusedVoxels], Condense]] = {
    "Open3D cluster_dbscan": open3d_peer,
    "scipy KDTree pairs + components": scipy_peer,
    "scikit-learn DBSCAN": sklearn_peer,
    "cc3d + exact merge": cc3d_peer,
}


def _merge_ahead(
    image: NDArray[np.integer[Any]], places: NDArray[np.int64], strides: tuple[int, ...]
) -> NDArray[np.int64]:
    own = image[places].astype(np.int64)
    count = int(own.max(initial=0)) + 1
    met = []
    for stride in strides:
        ahead = image[places + 2 * stride]
        apart = np.flatnonzero((ahead != own) & (ahead != 0))
        met.append(own[apart] * count + ahead[apart])
    root = list(range(count))
    for pair in np.unique(np.concatenate(met)).tolist():  # few: a graph library would cost more
        a, b = divmod(pair, count)
        while root[a] != a:
            a = root[a]
        while root[b] != b:
            b = root[b]
        root[max(a, b)] = min(a, b)
    for label in range(count):
        root[label] = root[root[label]]  # a root is always the smaller, so one pass suffices
    names: NDArray[np.int64] = np.unique(root[1:], return_inverse=True)[1]
    return names[own - 1]


def _centroids(
    labels: NDArray[np.integer[Any]], points: Floats | NDArray[np.int64], weights: Floats | None
) -> Floats:
    total = np.bincount(labels, weights)
    sums = [np.bincount(labels, x if weights is None else weights * x) for x in points.T]
    return np.stack(sums, axis=1) / total[:, None]
