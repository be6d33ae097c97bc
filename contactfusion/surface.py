"""A surface on which contacts can lie, as sampled points with normals."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray, frozen_array
from contactfusion.errors import ConfigurationError
from contactfusion.frames import Pose, points_in, vectors_in

if TYPE_CHECKING:
    from scipy.spatial import KDTree


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of a rigid body or of a whole robot in one pose, as sampled points.

    Attributes:
        frame: the frame of points and normals.
        points: shape (n, 3) [m].
        normals: shape (n, 3), unit vectors out of the body.
        links: shape (n,), the index into `link_names` that each point belongs to.
        link_names: the links of the body.
    """

    frame: str
    points: FloatArray
    normals: FloatArray
    links: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    link_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check every field and freeze the arrays."""
        keep = object.__setattr__
        label = f"of the surface in '{self.frame}'"
        error = ConfigurationError
        keep(self, "points", frozen_array(self.points, (None, 3), f"points {label}", error))
        n = len(self.points)
        keep(self, "normals", frozen_array(self.normals, (n, 3), f"normals {label}", error))
        if n and abs(np.linalg.norm(self.normals, axis=1) - 1.0).max() > 1e-6:
            raise ConfigurationError(f"the normals {label} are not unit vectors")
        links = self.links if len(self.links) else np.zeros(n, np.int32)
        keep(self, "links", frozen_array(links, (n,), f"links {label}", error, dtype=np.int32))
        keep(self, "link_names", tuple(self.link_names) or (self.frame,))
        if n and not (self.links.min() >= 0 and self.links.max() < len(self.link_names)):
            raise ConfigurationError(f"a link index {label} has no name")

    @cached_property
    def tree(self) -> "KDTree":
        """A k-d tree over the points."""
        from scipy.spatial import KDTree

        return KDTree(self.points)

    def moved(self, pose: Pose, frame: str) -> "Surface":
        """Give the surface in another frame; `pose` takes this frame to that one."""
        points, normals = points_in(pose, self.points), vectors_in(pose, self.normals)
        return Surface(frame, points, normals, self.links, self.link_names)


def rectangle(
    frame: str, centre: FloatArray, first: FloatArray, second: FloatArray, spacing: float
) -> Surface:
    """Sample a rectangle such as a force plate or the face of a box.

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
    return Surface(frame, points, normals)


def _centres(half_edge: FloatArray, spacing: float) -> FloatArray:
    cells = max(1, int(np.ceil(2.0 * np.linalg.norm(half_edge) / spacing)))
    return (2.0 * np.arange(cells) + 1.0) / cells - 1.0
