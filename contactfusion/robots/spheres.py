"""Spheres in place of links: quick to ask whether a point belongs to the robot.

A sphere whose centre lies at depth d inside a link may have the radius d + m: it protrudes by m at
most. Of many such spheres those are chosen, one after the other, that cover most of the surface
that no other covers yet.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.robots.solids import Solid
from contactfusion.shapes import unit_vectors

MARGIN, SLACK = 0.003, 0.002
"""A sphere protrudes by the first at most, and may leave the second of the surface bare [m]."""
DEPTHS = np.geomspace(0.002, 0.2, 12)
"""How deep under the surface centres are tried [m]."""
MOST = 0.005
"""No sphere is seen to reach further out of its link [m]."""
PROBES = unit_vectors(128)
"""A sphere's protrusion is measured at so many of its points; half as many miss 0.1 mm."""


@dataclass(frozen=True, eq=False)
class SphereModel:
    """The links of a robot as spheres, each in its link's frame.

    Attributes:
        centres: shape (n, 3) [m].
        radii: shape (n,) [m].
        links: shape (n,), the link that each belongs to, as an index into `link_names`.
        link_names: the links.
        protrusion: the furthest that a sphere reaches out of its link [m].
        gap: the furthest that a point of a link lies outside all of its spheres [m].
    """

    centres: FloatArray
    radii: FloatArray
    links: NDArray[np.int32]
    link_names: tuple[str, ...]
    protrusion: float
    gap: float


def fit_spheres(
    solids: Mapping[str, Solid], link_names: Sequence[str], spacing: float
) -> SphereModel:
    """Cover links with spheres.

    Args:
        solids: the shapes of each link that has some.
        link_names: all links.
        spacing: about the distance between the points that are covered [m].
    """
    centres, radii, links = [np.empty((0, 3))], [np.empty(0)], [np.empty(0, np.int32)]
    protrusion = gap = 0.0
    for name, solid in solids.items():
        link = _Sampled(*solid.samples(spacing / 2.0))
        places, sizes, furthest = _covering(solid, link, *solid.samples(spacing))
        protrusion = max(protrusion, furthest)
        gap = max(gap, _gap(link.points, places, sizes))
        centres.append(places)
        radii.append(sizes)
        links.append(np.full(len(sizes), link_names.index(name), np.int32))
    return SphereModel(
        np.concatenate(centres),
        np.concatenate(radii),
        np.concatenate(links),
        tuple(link_names),
        protrusion,
        gap,
    )


class _Sampled:
    """The surface of a link that tells inside from outside by the nearest of its points."""

    def __init__(self, points: FloatArray, normals: FloatArray) -> None:
        from scipy.spatial import KDTree

        self.points, self._normals, self._tree = points, normals, KDTree(points)

    def depths(self, places: FloatArray) -> FloatArray:
        """Give how deep places lie under the surface, shape (n,) [m], outside negative."""
        distances, rows = self._tree.query(places)
        depths = np.einsum("ij,ij->i", self.points[rows] - places, self._normals[rows])
        return np.asarray(np.minimum(depths, distances))


def _covering(
    solid: Solid, link: _Sampled, points: FloatArray, normals: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Choose centres and radii of spheres that cover the points, greedily.

    Returns:
        The centres and the radii, and how far a sphere protrudes at most [m].
    """
    from scipy.sparse import csc_array
    from scipy.spatial import KDTree

    centres = (points - DEPTHS[:, None, None] * normals).reshape(-1, 3)
    depths = link.depths(centres)
    inside = depths > 0.0
    # on the surface itself, for what is too thin to hold a centre
    centres = np.concatenate([points, centres[inside]])
    radii = np.concatenate([np.zeros(len(points)), depths[inside]]) + MARGIN
    covered = KDTree(points).query_ball_point(centres, radii + SLACK)
    counts = [len(rows) for rows in covered]
    sphere, point = np.repeat(np.arange(len(covered)), counts), np.concatenate(covered)
    covers = csc_array(
        (np.ones(len(point), np.int32), (sphere, point.astype(np.intp))),
        shape=(len(covered), len(points)),
    )
    gain = np.array(counts)
    bare = np.ones(len(points), np.bool_)
    picked: list[int] = []
    furthest = 0.0
    while gain.any():
        best = int(np.argmax(gain))
        protrusion = _protrusion(solid, link, centres[best], radii[best])
        if protrusion > MOST:
            gain[best] = 0  # the nearest points told inside from outside wrongly
            continue
        furthest = max(furthest, protrusion)
        picked.append(best)
        fresh = [row for row in covered[best] if bare[row]]
        bare[fresh] = False
        gain = np.maximum(gain - covers[:, fresh].sum(axis=1), 0)
    return centres[picked], radii[picked], furthest


def _protrusion(solid: Solid, link: _Sampled, centre: FloatArray, radius: float) -> float:
    """Measure how far a sphere reaches out of the solid [m], at points spread over it."""
    probes = centre + radius * PROBES
    outside = probes[link.depths(probes) < 0.0]
    return float(solid.distances(outside).max(initial=0.0)) if len(outside) else 0.0


def _gap(points: FloatArray, centres: FloatArray, radii: FloatArray) -> float:
    """Measure how far points lie outside all spheres [m]."""
    nearest = np.full(len(points), np.inf)
    for centre, radius in zip(centres, radii, strict=True):
        nearest = np.minimum(nearest, np.linalg.norm(points - centre, axis=1) - radius)
    return float(nearest.max(initial=0.0))
