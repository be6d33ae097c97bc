"""The integrator's algorithm in C++, built on the fly: how fast could this run?"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from benchmarks.native import Server, build
from benchmarks.surfaces import Floats
from benchmarks.workloads import Cloud

_SOURCE = Path(__file__).with_name("twin.cpp")
_KIND_BITS = {"REGULAR": 1, "SUPPORT": 2}
CONTACT_FIELDS = 25
"""Position, likelihood, dispersion, covariance, extent, force, voxels and stamp of a contact."""


class Twin:
    """The twin with some cycles loaded."""

    def __init__(self, cycles: Sequence[Sequence[Cloud]]) -> None:
        """Build the server if need be, start it and give it the cycles.

        Args:
            cycles: each one cloud per source, all of one stamp.

        Raises:
            NativeError: g++ is missing.
        """
        kinds = {cloud.source: cloud.kind for cycle in cycles for cloud in cycle}
        self._sources = sorted(kinds)
        self._server = Server(build(_SOURCE))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "cycles"
            with path.open("wb") as file:
                _put(file, len(kinds), *(_KIND_BITS[kinds[name]] for name in self._sources))
                _put(file, len(cycles))
                for cycle in cycles:
                    _put(file, len(cycle))
                    for cloud in cycle:
                        self._put_cloud(file, cloud)
            self._server.ask(f"load {path}")

    def cycle(self, number: int) -> float:
        """Receive the clouds of one cycle and step.

        Returns:
            the CPU time of its thread [s].
        """
        return int(self._server.ask(f"cycle {number}")[1]) * 1e-9

    def contacts(self) -> Floats:
        """Give the last contacts, shape (contacts, 25 + sources), see ``CONTACT_FIELDS``."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "contacts"
            self._server.ask(f"contacts {path}")
            return np.fromfile(path).reshape(-1, CONTACT_FIELDS + len(self._sources))

    def reset(self) -> None:
        """Forget all hypotheses."""
        self._server.ask("reset")

    def _put_cloud(self, file: BinaryIO, cloud: Cloud) -> None:
        n = len(cloud.likelihoods)
        optional = [array for array in (cloud.spreads, cloud.forces) if array is not None]
        lengths = [0 if array is None else n for array in (cloud.spreads, cloud.forces)]
        stamp = round(cloud.stamp * 1e9)
        _put(file, self._sources.index(cloud.source), stamp, n, *lengths)
        for array in (cloud.positions, cloud.likelihoods, *optional):
            file.write(np.ascontiguousarray(array, np.float64).tobytes())

    def close(self) -> None:
        """End the server."""
        self._server.close()


def _put(file: BinaryIO, *numbers: int) -> None:
    file.write(np.array(numbers, np.int64).tobytes())
