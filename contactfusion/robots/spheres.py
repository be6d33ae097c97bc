"""Spheres in place of links: a fast test whether a point belongs to the robot.

A sphere whose centre lies at depth d inside a link may have the radius d + m: it protrudes by m at
most. Spheres are chosen greedily: each covers most of the surface that none covers yet.

Fitted spheres are kept in the user's cache: a robot whose shapes stay the same is fitted once. A
file is named by the hash of all inputs of the fit: the shapes with the bytes of their meshes, the
spacing, the source of the algorithm and the libraries that it calls.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import ContactFusionError
from contactfusion.files import read_npz, write_npz
from contactfusion.robots.solids import Solid
from contactfusion.robots.urdf import Mesh, Shapes
from contactfusion.shapes import unit_vectors

MARGIN, SLACK = 0.003, 0.002
"""The greatest protrusion of a sphere, and the greatest gap that counts as covered [m]."""
DEPTHS = np.geomspace(0.002, 0.2, 12)
"""Depths under the surface at which centres are tried [m]."""
MOST = 0.005
"""The greatest measured protrusion of a sphere that is accepted [m]."""
MOST_POINTS = 40_000
"""No more points of a link are covered: time and memory grow with their square."""
PROBES = unit_vectors(128)
"""Points at which the protrusion of a sphere is measured; with half as many it is 0.1 mm off."""
ALGORITHM = ("shapes.py", "robots/solids.py", "robots/spheres.py")
"""The modules whose source is the version of the algorithm."""
PACKAGE = Path(__file__).parents[1]
LIBRARIES = ("numpy", "scipy", "open3d", "open3d-cpu")
"""The packages whose versions enter the hash, where they are installed."""


@dataclass(frozen=True, eq=False)
class SphereModel:
    """The links of a robot as spheres, each in its link's frame.

    Attributes:
        centres: shape (n, 3) [m].
        radii: shape (n,) [m].
        links: shape (n,), the link that each belongs to, as an index into `link_names`.
        link_names: the links.
        protrusion: the greatest protrusion of a sphere from its link [m].
        gap: the greatest distance of a point of a link from its spheres [m].
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
    """Spheres that cover links.

    Args:
        solids: the shapes of each link that has some.
        link_names: all links.
        spacing: about the distance between the points that are covered, more on a link that would
            have over `MOST_POINTS` [m].
    """
    centres, radii, links = [np.empty((0, 3))], [np.empty(0)], [np.empty(0, np.int32)]
    protrusion = gap = 0.0
    for name, solid in solids.items():
        whole, normals = solid.samples(spacing)
        points, wider = whole, float(np.sqrt(len(whole) / MOST_POINTS))
        if wider > 1.0:
            points, normals = solid.samples(spacing * wider)
        link = _Sampled(*solid.samples(spacing * max(wider, 1.0) / 2.0))
        positions, sizes, furthest = _covering(solid, link, points, normals)
        protrusion = max(protrusion, furthest)
        seen = whole if wider > 1.0 else link.points
        gap = max(gap, _gap(seen, positions, sizes))
        centres.append(positions)
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
    """The sampled surface of a link; the nearest sample decides between inside and outside."""

    def __init__(self, points: FloatArray, normals: FloatArray) -> None:
        from scipy.spatial import KDTree

        self.points, self._normals, self._tree = points, normals, KDTree(points)

    def depths(self, positions: FloatArray) -> FloatArray:
        """Depths of positions under the surface, shape (n,) [m], negative outside."""
        distances, rows = self._tree.query(positions)
        depths = np.einsum("ij,ij->i", self.points[rows] - positions, self._normals[rows])
        return np.asarray(np.minimum(depths, distances))


def _covering(
    solid: Solid, link: _Sampled, points: FloatArray, normals: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Centres and radii of spheres that cover the points, chosen greedily.

    Returns:
        Centres (k, 3) [m], radii (k,) [m], and the greatest protrusion [m].
    """
    from scipy.sparse import csc_array
    from scipy.spatial import KDTree

    centres = (points - DEPTHS[:, None, None] * normals).reshape(-1, 3)
    depths = link.depths(centres)
    inside = depths > 0.0
    # on the surface itself, for shapes that are too thin to hold a centre
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
            gain[best] = 0  # the nearest samples mistook outside for inside
            continue
        furthest = max(furthest, protrusion)
        picked.append(best)
        fresh = [row for row in covered[best] if bare[row]]
        bare[fresh] = False
        gain = np.maximum(gain - covers[:, fresh].sum(axis=1), 0)
    return centres[picked], radii[picked], furthest


def _protrusion(solid: Solid, link: _Sampled, centre: FloatArray, radius: float) -> float:
    """The protrusion of a sphere from the solid [m], measured at points spread over it."""
    probes = centre + radius * PROBES
    outside = probes[link.depths(probes) < 0.0]
    return float(solid.distances(outside).max(initial=0.0)) if len(outside) else 0.0


def _gap(points: FloatArray, centres: FloatArray, radii: FloatArray) -> float:
    """The greatest distance of points from all spheres [m]."""
    nearest = np.full(len(points), np.inf)
    for centre, radius in zip(centres, radii, strict=True):
        nearest = np.minimum(nearest, np.linalg.norm(points - centre, axis=1) - radius)
    return float(nearest.max(initial=0.0))


def sphere_folder() -> Path | None:
    """The folder of the cache: in $XDG_CACHE_HOME, or in ~/.cache; None without a home."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    try:
        home = Path(given) if os.path.isabs(given) else Path.home() / ".cache"
    except RuntimeError:
        return None
    return home / "contactfusion" / "spheres"


def fitted_spheres(
    links: Mapping[str, Shapes], link_names: Sequence[str], spacing: float
) -> SphereModel:
    """The spheres that `fit_spheres` fits, bit for bit, from the cache where it holds them.

    A cache that is damaged or cannot be written costs time only.

    Args:
        links: the shapes of each link that has some.
        link_names: all links.
        spacing: about the distance between the points that are covered [m].

    Raises:
        RobotError: a mesh holds no triangles.
        DependencyError: open3d is not installed.
    """
    path = _file(links, link_names, spacing)
    if path and (kept := _read(path, link_names)):
        return kept
    solid = {name: Solid(shapes) for name, shapes in links.items()}
    fitted = fit_spheres(solid, link_names, spacing)
    if path:
        with suppress(ContactFusionError):
            write_npz(
                path,
                centres=fitted.centres,
                radii=fitted.radii,
                links=fitted.links,
                reach=[fitted.protrusion, fitted.gap],
            )
    return fitted


def _file(links: Mapping[str, Shapes], link_names: Sequence[str], spacing: float) -> Path | None:
    """The file of the spheres; None without a home, or when a mesh cannot be read."""
    folder = sphere_folder()
    with suppress(OSError):
        return folder / f"{_digest(links, link_names, spacing)}.npz" if folder else None
    return None


def _digest(links: Mapping[str, Shapes], link_names: Sequence[str], spacing: float) -> str:
    """The hash of all inputs of the fit."""
    digest = sha256()
    for module in ALGORITHM:
        digest.update(sha256((PACKAGE / module).read_bytes()).digest())
    for package in LIBRARIES:
        with suppress(PackageNotFoundError):
            digest.update(f"{package} {version(package)}\n".encode())
    digest.update(repr((spacing, *link_names)).encode())
    for name, shapes in links.items():
        digest.update(repr((name, len(shapes))).encode())
        for shape in shapes:
            if isinstance(shape, Mesh):
                digest.update(repr((shape.file.suffix, shape.scale, shape.xyz, shape.rpy)).encode())
                digest.update(sha256(shape.file.read_bytes()).digest())
            else:
                digest.update(shape.model_dump_json().encode())
    return digest.hexdigest()


def _read(path: Path, link_names: Sequence[str]) -> SphereModel | None:
    """The spheres that a file holds; None when there is none, or it is damaged."""
    try:
        centres, radii, links, reach = read_npz(path, "centres", "radii", "links", "reach")
    except (ContactFusionError, OSError):
        return None
    count = len(radii) if radii.ndim else -1
    held = [(array.dtype, array.shape) for array in (centres, radii, links, reach)]
    number = np.dtype(np.float64)
    if held != [
        (number, (count, 3)),
        (number, (count,)),
        (np.dtype(np.int32), (count,)),
        (number, (2,)),
    ]:
        return None
    protrusion, gap = reach.tolist()
    return SphereModel(centres, radii, links, tuple(link_names), protrusion, gap)
