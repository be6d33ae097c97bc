"""PCL at the integrator's work, through a C++ server built on the fly."""

import tempfile
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.native import Server, build
from benchmarks.surfaces import Floats

_SOURCE = Path(__file__).with_name("pcl_peer.cpp")
_PACKAGES = ("pcl_segmentation", "pcl_filters", "pcl_search")


class PclPeer:
    """One work of PCL on one cloud.

    ``condense`` is EuclideanClusterExtraction and weighted centroids, ``fuse`` VoxelGrid, ``fresh``
    VoxelGrid, EuclideanClusterExtraction and centroids.
    """

    def __init__(
        self, work: Literal["condense", "fresh", "fuse"], points: Floats, weights: Floats
    ) -> None:
        """Build the server if need be, start it and give it the cloud.

        Args:
            work: what a run does.
            points: shape (n, 3) [m].
            weights: shape (n,), for ``condense``.

        Raises:
            NativeError: g++ or libpcl is missing.
        """
        self._work = work
        self._server = Server(build(_SOURCE, packages=_PACKAGES))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "points"
            np.column_stack((points, weights)).astype(np.float32).tofile(path)
            self._server.ask(f"load {path}")

    def run(self) -> float:
        """Do the work once.

        Returns:
            the CPU time of PCL's thread [s].
        """
        return int(self._server.ask(f"run {self._work}")[1]) * 1e-9

    def labels(self) -> NDArray[np.int32]:
        """Give the clusters of the last ``condense``.

        Returns:
            shape (n,), the cluster of each point.
        """
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "labels"
            self._server.ask(f"labels {path}")
            return np.fromfile(path, dtype=np.int32)

    def close(self) -> None:
        """End the server."""
        self._server.close()
