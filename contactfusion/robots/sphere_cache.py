"""Fitted spheres, kept in the user's cache: a robot whose shapes stay the same is fitted once.

A file is named by the hash of all that its spheres follow from: the shapes with the bytes of their
meshes, the spacing, the source of the algorithm and the libraries that it calls.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from contactfusion.errors import ContactFusionError
from contactfusion.files import read_npz, write_npz
from contactfusion.robots.solids import Solid
from contactfusion.robots.spheres import SphereModel, fit_spheres
from contactfusion.robots.urdf import Mesh, Shapes

ALGORITHM = ("shapes.py", "robots/solids.py", "robots/spheres.py")
"""The modules whose source counts as the version of the algorithm."""
PACKAGE = Path(__file__).parents[1]
LIBRARIES = ("numpy", "scipy", "open3d", "open3d-cpu")
"""The packages whose versions do, where they are installed."""


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

    A cache that is damaged or cannot be written changes nothing but the time that it takes.

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
    """The hash of all that the spheres follow from."""
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
    held = [(one.dtype, one.shape) for one in (centres, radii, links, reach)]
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
