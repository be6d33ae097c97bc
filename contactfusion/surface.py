"""A surface on which contacts can lie, as sampled points with normals."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contactfusion.arrays import FloatArray, frozen, frozen_array
from contactfusion.errors import ConfigurationError
from contactfusion.frames import Pose, inverse, points_in, vectors_in

if TYPE_CHECKING:
    from scipy.spatial import KDTree

    from contactfusion.nearest import NearestGrid


@dataclass(frozen=True, eq=False)
class RigidPart:
    """Sampled points of one rigid body with normals, in the body's own frame; made once.

    Attributes:
        points: shape (n, 3) [m], at least one.
        normals: shape (n, 3), unit vectors out of the body.
        links: shape (n,), the link that each point belongs to, as an index into the surface's.
    """

    points: FloatArray
    normals: FloatArray
    links: NDArray[np.int32]

    @classmethod
    def of(cls, surfaces: "Sequence[Surface]", link: int) -> "RigidPart":
        """The points of some surfaces as one link, by its index."""
        points, normals = (
            frozen(np.concatenate([getattr(each, name) for each in surfaces]))
            for name in ("points", "normals")
        )
        return cls(points, normals, frozen(np.full(len(points), link, np.int32)))

    @cached_property
    def tree(self) -> "KDTree":
        """A k-d tree over the points."""
        from scipy.spatial import KDTree

        return KDTree(self.points)

    @cached_property
    def spacing(self) -> float:
        """The median distance of a point from its nearest neighbour [m]; 0 for a single point."""
        if len(self.points) == 1:
            return 0.0
        distances = np.asarray(self.tree.query(self.points, k=2)[0])
        return float(np.median(distances[:, 1]))

    @cached_property
    def grid(self) -> "NearestGrid":
        """The grid for search of the nearest point."""
        from contactfusion.nearest import NearestGrid

        return NearestGrid.of(self.points)

    @cached_property
    def ball(self) -> tuple[FloatArray, float]:
        """A bounding ball of the points: its centre, shape (3,) [m], and its radius [m]."""
        centre = (self.points.min(axis=0) + self.points.max(axis=0)) / 2.0
        return centre, float(np.linalg.norm(self.points - centre, axis=1).max())


@dataclass(frozen=True, slots=True, eq=False)
class Anchor:
    """A point that moves with a rigid part of a surface.

    Attributes:
        part: the part that it is nearest to; None: it stands still.
        point: shape (3,) [m], in the frame of the part, or of the surface.
    """

    part: RigidPart | None
    point: FloatArray


class Surface:
    """The surface of a rigid body or of a whole robot in one pose, as sampled points.

    A robot's is made of rigid parts in their poses; its points are computed on access.

    Args:
        frame: the frame of points and normals.
        points: shape (n, 3) [m].
        normals: shape (n, 3), unit vectors out of the body.
        links: shape (n,), the index into `link_names` that each point belongs to; empty: 0.
        link_names: the links of the body; empty: one link, named as the frame.

    Raises:
        ConfigurationError: the arrays do not match, or hold invalid values.
    """

    def __init__(
        self,
        frame: str,
        points: FloatArray,
        normals: FloatArray,
        links: ArrayLike = (),
        link_names: Sequence[str] = (),
    ) -> None:
        label, error = f"of the surface in '{frame}'", ConfigurationError
        points = frozen_array(points, (None, 3), f"points {label}", error)
        n = len(points)
        normals = frozen_array(normals, (n, 3), f"normals {label}", error)
        if n and abs(np.linalg.norm(normals, axis=1) - 1.0).max() > 1e-6:
            raise ConfigurationError(f"the normals {label} are not unit vectors")
        given = np.asarray(links)
        indices = given if len(given) else np.zeros(n, np.int32)
        indices = frozen_array(indices, (n,), f"links {label}", error, dtype=np.int32)
        self.frame = frame
        self.link_names = tuple(link_names) or (frame,)
        if n and not (indices.min() >= 0 and indices.max() < len(self.link_names)):
            raise ConfigurationError(f"a link index {label} has no name")
        self._parts: tuple[tuple[RigidPart, Pose], ...] = ()
        if n:
            self._parts = ((RigidPart(points, normals, indices), np.eye(4)),)

    @classmethod
    def of_parts(
        cls, frame: str, parts: Sequence[tuple[RigidPart, Pose]], link_names: Sequence[str]
    ) -> "Surface":
        """The surface of rigid parts, each transformed by its pose to `frame`."""
        surface = cls(frame, np.empty((0, 3)), np.empty((0, 3)), (), link_names)
        surface._parts = tuple(parts)
        return surface

    @classmethod
    def joined(cls, surfaces: Sequence["Surface"]) -> "Surface":
        """The surface of several in one frame, as one link."""
        frame = surfaces[0].frame
        return cls.of_parts(frame, [(RigidPart.of(surfaces, 0), np.eye(4))], [frame])

    @classmethod
    def rectangle(
        cls,
        frame: str,
        centre: FloatArray,
        first: FloatArray,
        second: FloatArray,
        spacing: float,
    ) -> "Surface":
        """A sampled rectangle such as a force plate or the face of a box.

        Args:
            frame: the frame of all vectors.
            centre: shape (3,) [m].
            first: shape (3,) [m], from the centre to the middle of one edge.
            second: shape (3,) [m], from the centre to the middle of the next edge, across `first`.
            spacing: greatest distance between neighbouring points [m].

        Returns:
            Points at the centres of equal cells; normals along first × second.
        """
        u, v = np.asarray(first, np.float64), np.asarray(second, np.float64)
        a, b = np.meshgrid(_centres(u, spacing), _centres(v, spacing), indexing="ij")
        points = np.asarray(centre, np.float64) + a.reshape(-1, 1) * u + b.reshape(-1, 1) * v
        normal = np.cross(u, v)
        normals = np.broadcast_to(normal / np.linalg.norm(normal), points.shape)
        return cls(frame, points, normals)

    @cached_property
    def points(self) -> FloatArray:
        """The points, shape (n, 3) [m], part by part."""
        return self._concatenated([points_in(pose, part.points) for part, pose in self._parts])

    @cached_property
    def normals(self) -> FloatArray:
        """The normals, shape (n, 3), unit vectors out of the body."""
        return self._concatenated([vectors_in(pose, part.normals) for part, pose in self._parts])

    @cached_property
    def links(self) -> NDArray[np.int32]:
        """The index into `link_names` that each point belongs to, shape (n,)."""
        parts = (part.links for part, _ in self._parts)
        return frozen(np.concatenate([np.zeros(0, np.int32), *parts]))

    @property
    def spacing(self) -> float:
        """The distance between neighbouring points [m]: the mean over parts, weighted by points."""
        counts = [len(part.points) for part, _ in self._parts]
        spacings = [part.spacing for part, _ in self._parts]
        return float(np.average(spacings, weights=counts)) if counts else 0.0

    def moved(self, pose: Pose, frame: str) -> "Surface":
        """The surface in another frame; `pose` transforms this frame to that one."""
        parts = [(part, pose @ own) for part, own in self._parts]
        return Surface.of_parts(frame, parts, self.link_names)

    def of_links(self, names: Collection[str]) -> "Surface":
        """The surface without the parts of other links."""
        parts = [each for each in self._parts if self.link_names[each[0].links[0]] in names]
        return Surface.of_parts(self.frame, parts, self.link_names)

    def near_line(self, start: FloatArray, direction: FloatArray, reach: float) -> "Surface":
        """The surface without the parts that lie further than `reach` [m] from a line.

        Args:
            start: shape (3,) [m], a point of the line.
            direction: shape (3,), of unit length.
            reach: [m].
        """
        centres, radii = self._balls
        offsets = centres - start
        across = np.linalg.norm(offsets - np.outer(offsets @ direction, direction), axis=1)
        parts = [self._parts[row] for row in np.flatnonzero(across <= radii + reach)]
        return Surface.of_parts(self.frame, parts, self.link_names)

    def nearest(
        self, points: FloatArray, reach: float = np.inf
    ) -> tuple[FloatArray, NDArray[np.intp]]:
        """The nearest point of the surface, or one that is hardly further.

        Near the surface one in a hundred is a few mm further than the nearest; see `nearest.py`.

        Args:
            points: shape (m, 3) [m], in the surface's frame.
            reach: greatest distance [m].

        Returns:
            Distances, shape (m,) [m], inf where no point is within reach, and the rows of the
            nearest points, shape (m,), there the number of points.
        """
        points = np.ascontiguousarray(points, np.float64)
        begins = np.cumsum([0, *(len(part.points) for part, _ in self._parts)])
        total = int(begins[-1])
        distances, rows = np.full(len(points), reach), np.full(len(points), total, np.intp)
        # the parts in the midst of the points first: their distances exclude the others
        middle = points.mean(axis=0) if len(points) else np.zeros(3)
        centres, radii = self._balls
        away = np.linalg.norm(centres - middle, axis=1) - radii
        for number in np.argsort(away, kind="stable"):
            part, pose = self._parts[number]
            part.grid.improve(points, inverse(pose), int(begins[number]), distances, rows)
        distances[rows == total] = np.inf
        return distances, rows

    def anchor(self, point: FloatArray) -> Anchor:
        """A point, shape (3,) [m], as one that moves with the nearest part."""
        number = 0
        if len(self._parts) != 1:
            (row,) = self.nearest(point[None])[1]
            begins = np.cumsum([0, *(len(part.points) for part, _ in self._parts)])
            if row == begins[-1]:
                return Anchor(None, point)
            number = int(np.searchsorted(begins, row, side="right")) - 1
        part, pose = self._parts[number]
        return Anchor(part, points_in(inverse(pose), point[None])[0])

    def follow(self, anchor: Anchor) -> FloatArray | None:
        """Where an anchored point is now, shape (3,) [m]; None: its part is not of this surface."""
        if anchor.part is None:
            return anchor.point
        for part, pose in self._parts:
            if part is anchor.part:
                return frozen(points_in(pose, anchor.point[None])[0])
        return None

    @cached_property
    def _balls(self) -> tuple[FloatArray, FloatArray]:
        """Bounding balls of the parts: centres, shape (k, 3) [m], and radii, shape (k,) [m]."""
        centres = np.empty((len(self._parts), 3))
        for row, (part, pose) in enumerate(self._parts):
            centres[row] = pose[:3, :3] @ part.ball[0] + pose[:3, 3]
        return centres, np.array([part.ball[1] for part, _ in self._parts])

    def _concatenated(self, arrays: list[FloatArray]) -> FloatArray:
        return frozen(np.concatenate([np.empty((0, 3)), *arrays]))


def _centres(half_edge: FloatArray, spacing: float) -> FloatArray:
    cells = max(1, int(np.ceil(2.0 * np.linalg.norm(half_edge) / spacing)))
    return (2.0 * np.arange(cells) + 1.0) / cells - 1.0
