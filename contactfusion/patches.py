"""Patches of taxels: their positions, and the areas that they cover."""

from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from contactfusion.arrays import FloatArray
from contactfusion.estimate import TAXEL, too_much
from contactfusion.frames import Pose, inverse, points_in, pose_at
from contactfusion.jit import kernel
from contactfusion.model import Model
from contactfusion.units import Angles, Offset, TaxelEdge

TOUCHING = 1.25
"""Taxels that are no further apart than so many of their edges touch each other."""


class TaxelGridConfig(Model):
    """Taxels in rows and columns on a plane."""

    rows: int = Field(ge=1)
    """Number of taxels along x."""
    columns: int = Field(ge=1)
    """Number of taxels along y; values come row by row."""
    pitch: tuple[TaxelEdge, TaxelEdge]
    """The distance between neighbours along x and y [m]; also the size of a taxel."""
    xyz: Offset = (0.0, 0.0, 0.0)
    """The centre of the grid in the frame of the patch [m]."""
    rpy: Angles = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of the grid in the frame of the patch [rad]; taxels face its z."""

    @model_validator(mode="after")
    def _affordable(self) -> Self:
        if problem := too_much("the grid", self.rows * self.columns, TAXEL, "taxels"):
            raise ValueError(problem)
        return self

    def pose(self) -> Pose:
        """The pose of the grid in the frame of the patch."""
        return pose_at(self.xyz, self.rpy)

    def places(self) -> FloatArray:
        """The centres of the taxels on the grid's own plane, shape (rows · columns, 3) [m]."""
        x = (np.arange(self.rows, dtype=np.float64) - (self.rows - 1) / 2.0) * self.pitch[0]
        y = (np.arange(self.columns, dtype=np.float64) - (self.columns - 1) / 2.0) * self.pitch[1]
        return _on_plane(x, y)


class PatchConfig(Model):
    """A patch of taxels, as a grid, as several, or one by one, in the frame of its readings."""

    grid: TaxelGridConfig | None = None
    """Taxels in rows and columns."""
    grids: tuple[TaxelGridConfig, ...] = ()
    """Several grids, as on the faces of a body; values come grid by grid."""
    places: tuple[Offset, ...] = ()
    """The centre of each taxel [m]."""
    size: tuple[TaxelEdge, TaxelEdge] | None = None
    """The edges of one taxel along x and y [m]; needed with `places`, else the grid's pitch."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.grid is not None) + bool(self.grids) + bool(self.places) != 1:
            raise ValueError("give a grid or places, or several grids")
        if self.places and self.size is None:
            raise ValueError("places need the size of a taxel")
        return self

    def sheets(self) -> list[tuple[Pose, FloatArray, tuple[float, float]]]:
        """The planes of the taxels.

        Returns:
            For each plane its pose, the centres on it, shape (n, 3) [m], and the edges of a taxel
            along its x and y [m].
        """
        grids = (self.grid,) if self.grid else self.grids
        if grids:
            return [(grid.pose(), grid.places(), self.size or grid.pitch) for grid in grids]
        assert self.size is not None  # places need it
        return [(np.eye(4), np.array(self.places), self.size)]

    def centres(self) -> FloatArray:
        """The centre of each taxel, shape (n, 3) [m]."""
        return np.concatenate([points_in(pose, centres) for pose, centres, _ in self.sheets()])

    def normals(self) -> FloatArray:
        """The direction that each taxel faces, shape (n, 3)."""
        facing = [(pose[:3, 2], len(centres)) for pose, centres, _ in self.sheets()]
        return np.repeat([normal for normal, _ in facing], [count for _, count in facing], axis=0)

    def spreads(self, side: float) -> FloatArray:
        """How unsure the positions of `covered` are, by axis, shape (n,), for each taxel [m].

        The standard deviation of a position anywhere on the part of the taxel that each stands for.

        Args:
            side: of a voxel [m].
        """
        parts = [
            (len(centres), [edge / _cells(edge, side) for edge in edges])
            for _, centres, edges in self.sheets()
        ]
        return np.repeat(
            [np.hypot(x, y) / np.sqrt(24.0) for _, (x, y) in parts], [count for count, _ in parts]
        )

    def neighbours(self) -> NDArray[np.intp]:
        """Pairs of taxels of a plane whose areas touch, at an edge or a corner, shape (p, 2)."""
        from scipy.spatial import KDTree

        pairs, count = [np.empty((0, 2), np.intp)], 0
        for _, centres, edges in self.sheets():
            tree = KDTree(centres / (*edges, max(edges)))  # taxels may lie over each other, too
            pairs.append(count + tree.query_pairs(TOUCHING, p=np.inf, output_type="ndarray"))
            count += len(centres)
        return np.concatenate(pairs)

    def count(self, side: float) -> int:
        """The number of positions of `covered`, for voxels of a side [m]."""
        return sum(
            len(centres) * _cells(edges[0], side) * _cells(edges[1], side)
            for _, centres, edges in self.sheets()
        )

    def covered(self, side: float) -> tuple[FloatArray, NDArray[np.intp]]:
        """Positions that cover each taxel, no further apart than a voxel.

        Args:
            side: of a voxel [m].

        Returns:
            Positions of shape (m, 3) [m], and the taxel of each, shape (m,).
        """
        positions, taxels, count = [], [], 0
        for pose, centres, edges in self.sheets():
            axes = []
            for edge in edges:
                cells = _cells(edge, side)
                axes.append(((2.0 * np.arange(cells) + 1.0) / cells - 1.0) * edge / 2.0)
            offsets = _on_plane(*axes)
            positions.append(points_in(pose, (centres[:, None, :] + offsets).reshape(-1, 3)))
            rows = np.arange(count, count + len(centres), dtype=np.intp)
            taxels.append(np.repeat(rows, len(offsets)))
            count += len(centres)
        return np.concatenate(positions), np.concatenate(taxels)


class TaxelAreas:
    """The areas of a patch's taxels, to test points against.

    Args:
        patch: the taxels.
    """

    def __init__(self, patch: PatchConfig) -> None:
        self._planes = [
            (inverse(pose), centres, np.array([*edges, 0.0]) / 2.0)
            for pose, centres, edges in patch.sheets()
        ]

    def near(self, points: FloatArray, reach: float) -> NDArray[np.bool_]:
        """Which taxels have a point over their area, or closer to it than `reach` [m].

        Args:
            points: shape (m, 3) [m], in the frame of the patch.
            reach: along each axis of a taxel [m].

        Returns:
            Shape (n,), for the n taxels of the patch.
        """
        return np.concatenate(
            [
                _any_within(points_in(to_plane, points), centres, half + reach)
                for to_plane, centres, half in self._planes
            ]
        )


@kernel
def _any_within(points: FloatArray, centres: FloatArray, half: FloatArray) -> NDArray[np.bool_]:
    """Around which centres (n, 3) a box of half edges (3,) holds one of the points (m, 3)."""
    found = np.zeros(len(centres), np.bool_)
    for row in range(len(centres)):
        for point in range(len(points)):
            inside = True
            for axis in range(3):
                inside &= np.abs(points[point, axis] - centres[row, axis]) <= half[axis]
            if inside:
                found[row] = True
                break
    return found


def _cells(edge: float, side: float) -> int:
    """The number of voxels along an edge."""
    return max(1, int(np.ceil(edge / side - 1e-9)))


def _on_plane(x: FloatArray, y: FloatArray) -> FloatArray:
    """All points of these coordinates on the plane z = 0, x by x, shape (m, 3)."""
    points = np.zeros((len(x) * len(y), 3))
    points[:, 0], points[:, 1] = np.repeat(x, len(y)), np.tile(y, len(x))
    return points
