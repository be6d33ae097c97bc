"""The places where a contact may be, and where a belief over them is densest."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import NONE
from contactfusion.hypotheses import HypothesisKind
from contactfusion.integrator import fields
from contactfusion.integrator.cells import Dealt, cell_list
from contactfusion.integrator.detections import Cloud
from contactfusion.integrator.nearby import Rows, connected, nearer, shifted
from contactfusion.surface import Surface

TAIL = 0.1
"""Spreads may be stated too small: a second Gaussian, so high and three times as wide, is added."""
STEP = 2.0
"""Places are connected in steps of so many spacings."""
WIDTH = 1.6
"""Width of the kernel by which the densest place is found, in reaches of the places."""
CORE, BASIN = 0.3, 0.1
"""Connected places of at least these parts of the heaviest are where a contact lies, and what
belongs to it."""
KEPT = 1.0 + BASIN * np.log(BASIN) / (1.0 - BASIN)
"""The part of a Gaussian's variance on a plane that lies in a basin."""
TILE = 7.0
"""Places of a surface are processed by cells of at least so many spacings, to fill vectors."""
TINY = 1e-12
"""A mean normal of a smaller square has no direction."""
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

    @property
    def top(self) -> int:
        """The row of the most probable place."""
        return int(self.rows[self.weights.argmax()])


class SourceField(NamedTuple):
    """How well a contact at each place explains what a source says.

    Attributes:
        heights: shape (c,).
        which: shape (c,), the strongest hypothesis there, or `NONE`; empty for a source of a single
            contact.
    """

    heights: FloatArray
    which: NDArray[np.int32]

    def copy(self) -> "SourceField":
        """The same, to be changed."""
        return SourceField(self.heights.copy(), self.which.copy())

    def where(self, wanted: NDArray[np.bool_]) -> "SourceField":
        """The field at some of the places; `wanted` has shape (c,)."""
        which = self.which[wanted] if len(self.which) else self.which
        return SourceField(self.heights[wanted], which)


@dataclass(frozen=True, eq=False)
class Places:
    """The places where a contact may be.

    Attributes:
        points: shape (c, 3) [m].
        normals: of the surface there, shape (c, 3); None without it.
        spacing: how far neighbouring places of a surface lie apart [m]; 0 without it.
        narrowest: the least standard deviation of a hypothesis [m].
        links: shape (c,), the link of each, as an index into the surface's; 0 without it.
        reaches: shape (c,), places that are no further apart than the sum of theirs hang together
            [m].
    """

    points: FloatArray
    normals: FloatArray | None
    spacing: float
    narrowest: float
    links: NDArray[np.int32]
    reaches: FloatArray

    @staticmethod
    def on(surface: Surface, rows: Rows | slice, spacing: float, narrowest: float) -> "Places":
        """Points of a surface, by their rows."""
        points, normals = surface.points[rows], surface.normals[rows]
        reaches = np.full(len(points), 0.5 * STEP * spacing)
        return Places(points, normals, spacing, narrowest, surface.links[rows], reaches)

    @cached_property
    def cells(self) -> Dealt:
        """The places by cells."""
        return cell_list(self.points, 2.0 * float(self.reaches.max()))

    @cached_property
    def tiles(self) -> Dealt:
        """The places by larger cells."""
        return cell_list(self.points, self._tile)

    def where(self, wanted: NDArray[np.bool_]) -> "Places":
        """Some of the places; `wanted` has shape (c,)."""
        normals = None if self.normals is None else self.normals[wanted]
        given = self.points[wanted], normals, self.spacing, self.narrowest
        return Places(*given, self.links[wanted], self.reaches[wanted])

    def at(self, position: FloatArray) -> "Places":
        """A single place off any surface, at a position of shape (3,) [m]."""
        given = None, self.spacing, self.narrowest, self.links[:1], self.reaches[:1]
        return Places(position[None], *given)

    def field(self, cloud: Cloud) -> SourceField:
        """The field of a source."""
        heights = np.empty(len(self.points))
        which = np.empty(0 if cloud.single else len(heights), np.int32)
        self._add_up(self.points, self.tiles, cloud, heights, which)
        return SourceField(heights, which)

    def search(self, field: SourceField, wanted: Rows, cloud: Cloud, rows: Rows) -> None:
        """Look for the strongest hypothesis again.

        Args:
            field: of a source of several contacts, is changed.
            wanted: at which places.
            cloud: the hypotheses of the source.
            rows: those that count.
        """
        points = self.points[wanted]
        heights, which = np.empty(len(points)), np.empty(len(points), np.int32)
        tiles = cell_list(points, self._tile)
        self._add_up(points, tiles, cloud.picked(rows), heights, which)
        field.heights[wanted] = heights
        field.which[wanted] = np.append(rows, NONE)[which]

    def _add_up(
        self,
        points: FloatArray,
        tiles: Dealt,
        cloud: Cloud,
        heights: FloatArray,
        which: NDArray[np.int32],
    ) -> None:
        variances = np.maximum(cloud.variances, self.narrowest**2)
        given = (cloud.positions, cloud.likelihoods, variances, cloud.single)
        tail = 0.0 if cloud.kind == HypothesisKind.NULL else TAIL
        fields.kernel_density(points, tiles, *given, tail, heights, which)

    def densest(self, weights: FloatArray) -> Basin:
        """Where the densest contact of a belief may be.

        Args:
            weights: shape (c,), over the highest.
        """
        heavy, some = np.flatnonzero(weights >= CORE), np.flatnonzero(weights >= BASIN)
        tops, densities = self.points[heavy], np.empty(len(heavy))
        tiles, widths = cell_list(tops, self._tile), (WIDTH * self.reaches[some]) ** 2
        around = (self.points[some], weights[some], widths, True, 0.0)
        fields.kernel_density(tops, tiles, *around, densities)
        top = int(heavy[np.round(densities / densities.max(), 6).argmax()])  # the first of equals
        core, rows = self.connected(weights, CORE, top), self.connected(weights, BASIN, top)
        inside = np.zeros(len(weights), np.bool_)
        inside[core] = True
        if len(others := heavy[~inside[heavy]]):  # what is nearer to another contact is its own
            rows = rows[nearer(self.points, rows, core, others)]
        mean = weights[core] @ self.points[core] / weights[core].sum()
        return Basin(core, mean, rows, weights[rows] / weights[rows].sum())

    def normal(self, basin: Basin) -> FloatArray | None:
        """The mean normal of a basin, shape (3,), or that of its top where there is none."""
        if self.normals is None:
            return None
        normal: FloatArray = basin.weights @ self.normals[basin.rows]
        return normal if normal @ normal > TINY else self.normals[basin.top]

    def anywhere(self, basin: Basin, weights: FloatArray) -> Basin:
        """A contact that lies in a basin or, as sources do not distinguish several, elsewhere.

        Args:
            basin: where it is densest.
            weights: shape (c,), of the belief.
        """
        rows = np.flatnonzero(weights >= BASIN * weights.max())
        return replace(basin, rows=rows, weights=weights[rows] / weights[rows].sum())

    def connected(self, values: FloatArray, least: float, start: int) -> Rows:
        """The places of at least some value that hang together with one of them, ascending.

        Args:
            values: shape (c,).
            least: the least value.
            start: the row of the one.
        """
        return connected(self.points, self.cells, values, least, start, self.reaches)

    def mode(self, basin: Basin) -> FloatArray:
        """Where mean shift leads from the mean of a basin's core, shape (3,) [m]."""
        width = WIDTH * float(self.reaches[basin.top])
        return shifted(self.points, basin.rows, basin.weights, basin.mean, width, STEPS)

    def moments(self, basin: Basin, about: FloatArray) -> FloatArray:
        """The second moments of a belief around a point, shape (3, 3) [m²].

        Those of the basin, for what a Gaussian has beyond it.
        """
        within = moments(self.points[basin.rows] - about, basin.weights)
        return np.asarray(within / KEPT, np.float64)

    @property
    def _tile(self) -> float:
        """The side of the cells that places are processed by [m]."""
        if self.normals is None:  # they lie as densely as hypotheses
            return fields.TILE
        return max(fields.TILE, TILE * self.spacing)


def moments(offsets: FloatArray, weights: FloatArray) -> FloatArray:
    """Second moments, shape (3, 3) [m²], of offsets (n, 3) [m] and weights (n,) that sum to 1."""
    return np.asarray((offsets * weights[:, None]).T @ offsets)
