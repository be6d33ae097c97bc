"""The places where a contact may be, and where a belief over them is densest."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import fields
from contactfusion.integrator.detections import Cloud

Rows = NDArray[np.intp]

TAIL = 0.1
"""Spreads may be stated too small: a second Gaussian, so high and three times as wide, is added."""
STEP = 2.4
"""Places are connected in steps of so many spacings."""
WIDTH = 1.6
"""Width of the kernel by which the densest place is found, in spacings."""
CORE, BASIN = 0.3, 0.1
"""Connected places of at least these parts of the heaviest are where a contact lies, and what
belongs to it."""
KEPT = 1.0 + BASIN * np.log(BASIN) / (1.0 - BASIN)
"""The part of a Gaussian's variance on a plane that lies in a basin."""
STEPS = 20
"""Of mean shift at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Basin:
    """Where one contact may be.

    Attributes:
        core: the places where it lies, as rows, ascending.
        mean: shape (3,) [m], their mean.
        rows: of the places that belong to it, ascending.
        weights: shape (b,), the probability of each of these; they sum to 1.
    """

    core: Rows
    mean: FloatArray
    rows: Rows
    weights: FloatArray


class Places(NamedTuple):
    """The places where a contact may be.

    Attributes:
        points: shape (c, 3) [m].
        normals: of the surface there, shape (c, 3); None without it.
        spacing: how far neighbouring places lie apart [m].
        narrowest: the least standard deviation of a hypothesis [m].
        tiles: the places by cells.
    """

    points: FloatArray
    normals: FloatArray | None
    spacing: float
    narrowest: float
    tiles: fields.Dealt

    @staticmethod
    def at(
        points: FloatArray, normals: FloatArray | None, spacing: float, narrowest: float
    ) -> "Places":
        """Places, put into cells."""
        tiles = fields.cell_list(points, fields.TILE)
        return Places(points, normals, spacing, narrowest, tiles)

    def where(self, wanted: NDArray[np.bool_]) -> "Places":
        """Some of the places; `wanted` has shape (c,)."""
        normals = None if self.normals is None else self.normals[wanted]
        return Places.at(self.points[wanted], normals, self.spacing, self.narrowest)

    def within(self, reach: float, of: FloatArray) -> NDArray[np.bool_]:
        """Which places lie within reach [m] of some points (n, 3) [m], n > 0, shape (c,)."""
        cells = fields.cell_list(of, reach)
        return fields.heaviest(self.points, of, cells, np.ones(len(of)), reach) > 0.0

    def field(self, cloud: Cloud) -> FloatArray:
        """How well a contact at each place explains a cloud, shape (c,)."""
        found = np.empty(len(self.points))
        variances = np.maximum(cloud.variances, self.narrowest**2)
        given = (cloud.positions, cloud.likelihoods, variances, cloud.single)
        tail = 0.0 if cloud.kind == HypothesisKind.NULL else TAIL
        fields.kernel_density(self.points, self.tiles, *given, tail, found)
        return found

    def densest(self, weights: FloatArray) -> Basin:
        """Where the densest contact of a belief may be.

        Args:
            weights: shape (c,), over the highest.
        """
        from scipy.spatial import KDTree

        heavy, some = np.flatnonzero(weights >= CORE), np.flatnonzero(weights >= BASIN)
        tops, densities = self.points[heavy], np.empty(len(heavy))
        tiles, widths = fields.cell_list(tops, fields.TILE), np.full(len(some), self._width**2)
        around = (self.points[some], weights[some], widths, True, 0.0)
        fields.kernel_density(tops, tiles, *around, densities)
        top = int(heavy[np.round(densities / densities.max(), 6).argmax()])  # the first of equals
        core, rows = self.connected(heavy, top), self.connected(some, top)
        if len(others := np.setdiff1d(heavy, core)):  # what is nearer to another contact is its own
            away, elsewhere = (
                KDTree(self.points[these]).query(self.points[rows])[0] for these in (core, others)
            )
            rows = rows[away <= elsewhere]
        mean = weights[core] @ self.points[core] / weights[core].sum()
        return Basin(core, mean, rows, weights[rows] / weights[rows].sum())

    def connected(self, rows: Rows, start: int) -> Rows:
        """Those of some places that hang together with one of these.

        Args:
            rows: of the places, ascending.
            start: the row of the one.
        """
        points, at = self.points[rows], int(np.searchsorted(rows, start))
        cells = fields.cell_list(points, fields.TILE)
        joined: Rows = rows[fields.linked(points, cells, at, STEP * self.spacing)]
        return joined

    def mode(self, basin: Basin) -> FloatArray:
        """Where mean shift leads from the mean of a basin's core, shape (3,) [m]."""
        points, place = self.points[basin.rows], basin.mean
        for _ in range(STEPS):
            squared = ((points - place) ** 2).sum(axis=1) / self._width**2
            near = basin.weights * np.exp(-0.5 * squared)
            shifted: FloatArray = near @ points / near.sum()
            if np.abs(shifted - place).max() < 1e-6:
                break
            place = shifted
        return np.array(place, np.float64)

    def moments(self, basin: Basin, about: FloatArray) -> FloatArray:
        """The second moments of a belief around a point, shape (3, 3) [m²].

        Those of the basin, for what a Gaussian has beyond it.
        """
        within = moments(self.points[basin.rows] - about, basin.weights)
        return np.asarray(within / KEPT, np.float64)

    @property
    def _width(self) -> float:
        return WIDTH * self.spacing


def moments(offsets: FloatArray, weights: FloatArray) -> FloatArray:
    """Second moments, shape (3, 3) [m²], of offsets (n, 3) [m] and weights (n,) that sum to 1."""
    return np.asarray((offsets * weights[:, None]).T @ offsets)
