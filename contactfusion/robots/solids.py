"""Collision geometry of a link: sampled surface, and distance to it.

Meshes may be open, nested or of inconsistent orientation. So nothing here asks what is inside: a
point is on the surface when rays from it escape, on the side from which more of them do.
"""

import os
import re
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.confined import LimitError, confined
from contactfusion.errors import RobotError, missing_extra
from contactfusion.estimate import MESH_SAMPLE, SAMPLE, too_much
from contactfusion.frames import points_in
from contactfusion.limits import raised
from contactfusion.robots.urdf import Mesh
from contactfusion.shapes import ShapeConfig, unit_vectors

CROWD = 6.0
"""Factor of oversampling of a mesh, before it is thinned to one point a cell."""
ROUNDNESS = 64
"""Corners of the circumference of a round primitive."""
RAYS = 24
"""Rays cast from a point in all directions; it is hidden when none escapes."""
WIDEST = 1e3
"""The greatest hole of a mesh that is closed [m]."""
ROBUST, FRAGILE = (".stl", ".obj"), (".ply", ".off")
"""Suffixes of meshes, and of those on which open3d may crash, so that they are read in a process of
their own. It reads glTF and FBX, too, but opens whatever files these name."""
MEMORY = 2**32
"""The addresses that this process may take, with the library [bytes]."""
LARGEST: Final = 2**28
"""The greatest size of an OBJ file [bytes]."""
LARGEST_LIBRARY: Final = 2**24
"""The greatest size of its library of materials [bytes]."""
HIDDEN: Final = b"\x01"
"""What takes the place of each b in an OBJ file."""
LIBRARY: Final = re.compile(rb"(?m)^[ \t]*mtlli\x01[ \t]+([^\r\n]+)")
"""The name of a library of materials in an OBJ file without the letter b."""
MATERIAL: Final = re.compile(rb"(?m)^[ \t]*newmtl[ \t]+([^\0\f\r\n]+)")
"""The name of a material in a library."""
LIFT = 2e-4
"""Distance from the surface at which rays start [m]."""


class Solid:
    """The shapes of one link, in the link's frame.

    Args:
        shapes: at least one.

    Raises:
        RobotError: a mesh holds no triangles.
        DependencyError: open3d is not installed.
    """

    def __init__(self, shapes: Sequence[ShapeConfig | Mesh]) -> None:
        self._shapes = tuple(shapes)
        if any(isinstance(shape, Mesh) for shape in shapes):
            _ = self.meshes  # a file that can't be read is reported when the solid is built

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as the shapes."""
        return Solid, (self._shapes,)

    @cached_property
    def meshes(self) -> list[tuple[FloatArray, NDArray[np.uint32]]]:
        """The vertices (v, 3) [m] and the triangles (t, 3) of each shape."""
        return [_triangles(shape) for shape in self._shapes]

    @cached_property
    def _scene(self) -> Any:
        return _scene(self.meshes)

    @cached_property
    def _insides(self) -> list[Any]:
        # where shapes overlap, counting crossings fails: each shape has a scene of its own
        return [_scene([mesh]) for mesh in self.meshes]

    def samples(self, spacing: float) -> tuple[FloatArray, FloatArray]:
        """Points about `spacing` [m] apart and outward normals, both of shape (n, 3)."""
        points, normals = [], []
        for number, shape in enumerate(self._shapes):
            self._require_affordable(number, spacing)
            if isinstance(shape, Mesh):
                samples, directions = _on_triangles(*self.meshes[number], spacing)
            else:
                surface = shape.sampled("link", spacing)
                samples, directions = surface.points, surface.normals
            points.append(samples)
            normals.append(directions)
        if len(self._shapes) == 1 and isinstance(self._shapes[0], ShapeConfig):
            return points[0], normals[0]  # nothing hides a primitive from itself
        return self._seen(np.concatenate(points), np.concatenate(normals))

    def _require_affordable(self, number: int, spacing: float) -> None:
        """Refuse a shape with more samples than memory holds."""
        shape = self._shapes[number]
        if isinstance(shape, ShapeConfig):
            extent, area, each = shape.extent(), shape.area(), SAMPLE
            cure = "sizes are in metres"
        else:
            vertices, triangles = self.meshes[number]
            edges = " x ".join(f"{edge:.3g}" for edge in np.ptp(vertices, axis=0))
            extent, area = f"{shape.file}: {edges} m", float(_areas(vertices, triangles)[1].sum())
            each, cure = MESH_SAMPLE, 'a mesh in millimetres needs scale="0.001 0.001 0.001"'
        problem = too_much(f"{extent} at {spacing * 1e3:g} mm spacing", area / spacing**2, each)
        if problem:
            raise RobotError(f"{problem}; {cure}")

    def distances(self, points: FloatArray) -> FloatArray:
        """Distances of points, shape (n, 3) [m], to the nearest triangle, shape (n,) [m].

        Triangles inside the link count, too.
        """
        query = loaded_open3d().core.Tensor(np.ascontiguousarray(points, np.float32))
        return np.asarray(self._scene.compute_distance(query).numpy(), np.float64)

    def signed_distances(self, points: FloatArray) -> FloatArray:
        """Signed distances to the surface of closed shapes, shape (n,) [m], negative inside.

        Where shapes overlap, the depth is the greatest of theirs.
        """
        query = loaded_open3d().core.Tensor(np.ascontiguousarray(points, np.float32))
        scenes = self._insides
        signed = [scene.compute_signed_distance(query, nsamples=3).numpy() for scene in scenes]
        return np.asarray(np.min(signed, axis=0), np.float64)

    def _seen(self, points: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The points that are visible from outside, with their normals turned outward."""
        front, back = (self._escaping(points + side * normals) for side in (LIFT, -LIFT))
        turned = np.where((back > front)[:, None], -normals, normals)
        seen = np.maximum(front, back) > 0
        return points[seen], turned[seen]

    def _escaping(self, points: FloatArray) -> FloatArray:
        """The number of rays from each point that hit nothing, shape (n,)."""
        count = np.zeros(len(points))
        for direction in unit_vectors(RAYS):
            rays = np.concatenate([points, np.broadcast_to(direction, points.shape)], axis=1)
            query = loaded_open3d().core.Tensor(np.ascontiguousarray(rays, np.float32))
            count += ~self._scene.test_occlusions(query).numpy()
        return count


def _triangles(shape: ShapeConfig | Mesh) -> tuple[FloatArray, NDArray[np.uint32]]:
    """Vertices (v, 3) [m] in the link's frame, and triangles (t, 3) of their rows."""
    open3d = loaded_open3d()
    create = open3d.geometry.TriangleMesh
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    if isinstance(shape, Mesh):
        mesh, scale = _closed(shape), shape.scale
    elif shape.shape == "box":
        mesh = create.create_box(*(shape.size or ()))
        mesh.translate(-np.array(shape.size) / 2.0)
    elif shape.shape == "cylinder":
        mesh = create.create_cylinder(shape.radius, shape.length, ROUNDNESS, 1)
    else:
        mesh = create.create_sphere(shape.radius, ROUNDNESS // 2)
    vertices = points_in(shape.pose(), np.asarray(mesh.vertices) * scale)
    return vertices, np.asarray(mesh.triangles, np.uint32)


def _scene(meshes: Sequence[tuple[FloatArray, NDArray[np.uint32]]]) -> Any:
    """A ray-casting scene of triangles."""
    open3d = loaded_open3d()
    scene = open3d.t.geometry.RaycastingScene()
    for vertices, triangles in meshes:
        corners = open3d.core.Tensor(np.ascontiguousarray(vertices, np.float32))
        scene.add_triangles(corners, open3d.core.Tensor(np.ascontiguousarray(triangles)))
    return scene


def _closed(shape: Mesh) -> Any:
    """A mesh with its holes closed: links' meshes are often open where the next link begins."""
    open3d, path = loaded_open3d(), shape.file.resolve()
    suffix, file = path.suffix.lower(), str(path)
    if suffix not in (*ROBUST, *FRAGILE):
        raise RobotError(
            f"{shape.file} is none of the meshes that are read: .stl, .obj, .ply, .off"
        )
    try:
        is_robust = suffix in ROBUST
        read = read_mesh(file) if is_robust else confined(read_mesh, file, memory=MEMORY)
    except LimitError as error:
        raise RobotError(f"{shape.file} can't be read: {error}") from None
    except OSError as error:
        raise RobotError(f"{shape.file} can't be read: {error.strerror}") from None
    vertices, triangles = read
    if not np.isfinite(vertices).all():
        raise RobotError(f"{shape.file} holds corners that are not finite")
    if ((triangles < 0) | (triangles >= len(vertices))).any():  # open3d would look there
        raise RobotError(f"{shape.file} holds triangles of corners that it does not hold")
    vector = open3d.utility
    mesh = open3d.geometry.TriangleMesh(
        vector.Vector3dVector(vertices), vector.Vector3iVector(triangles)
    )
    mesh.remove_duplicated_vertices()
    mesh.remove_degenerate_triangles()
    if not len(mesh.triangles):
        raise RobotError(f"{shape.file} holds no triangles that can be read")
    tensor = open3d.core.Tensor
    mesh = open3d.t.geometry.TriangleMesh(
        tensor(np.asarray(mesh.vertices)), tensor(np.asarray(mesh.triangles))
    )
    return mesh.fill_holes(WIDEST).to_legacy()


def read_mesh(file: str) -> tuple[FloatArray, NDArray[np.int32]]:
    """The vertices (v, 3) of a mesh, and the triangles (t, 3) of their rows.

    Both are empty where open3d reads none.

    Raises:
        LimitError: it is larger than any.
        OSError: it cannot be read, or not copied.
    """
    if Path(file).suffix.lower() != ".obj":
        return _as_open3d_reads(file)
    with TemporaryDirectory(prefix="contactfusion-") as folder:
        copy = Path(folder) / "mesh.obj"
        _copy_alone(Path(file), copy)
        return _as_open3d_reads(str(copy))


def _copy_alone(file: Path, copy: Path) -> None:
    """Copy an OBJ file, so that open3d opens no other file that it names.

    Textures may lie anywhere, and promise more pixels than memory holds. Of the library there
    remain the names of materials, by whose order open3d orders the triangles. A statement may be
    broken up in many ways, but none is `mtllib` without the letter b, and none on shapes has it.
    """
    content = _content(file, LARGEST).replace(b"b", HIDDEN)
    if named := LIBRARY.search(content):
        name = os.fsdecode(named[1].replace(HIDDEN, b"b").strip())
        materials = b"".join(b"newmtl %s\n" % each for each in _materials(file, name))
        copy.with_suffix(".mtl").write_bytes(materials.replace(b"b", HIDDEN))
        content = b"%smtllib mesh.mtl%s" % (content[: named.start()], content[named.end() :])
    copy.write_bytes(content)


def _materials(file: Path, name: str) -> list[bytes]:
    """The names in the library of an OBJ file, if it lies in the folder of the file."""
    for path in (file.parent / name, file.with_suffix(".mtl")):  # open3d looks for both
        with suppress(OSError):
            if path.is_file() and path.resolve().is_relative_to(file.parent):
                return MATERIAL.findall(_content(path, LARGEST_LIBRARY))
    return []


def _content(file: Path, most: int) -> bytes:
    most = round(raised(most))
    if (size := file.stat().st_size) > most:
        raise LimitError(f"{file.name} has {size} bytes, more than {most}")
    return file.read_bytes()


def _as_open3d_reads(file: str) -> tuple[FloatArray, NDArray[np.int32]]:
    open3d = loaded_open3d()
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        mesh = open3d.io.read_triangle_mesh(file)
    return np.array(mesh.vertices), np.array(mesh.triangles)


def _on_triangles(
    vertices: FloatArray, triangles: NDArray[np.uint32], spacing: float
) -> tuple[FloatArray, FloatArray]:
    """Sample triangles evenly, with a fixed seed, and keep one point a cell.

    Returns:
        Points, and the normals of their triangles, of either sign; both of shape (n, 3).
    """
    corner, first, second = (vertices[triangles[:, i]] for i in range(3))
    across, areas = _areas(vertices, triangles)
    count = max(64, int(np.ceil(CROWD * areas.sum() / spacing**2)))
    rng = np.random.default_rng(0)
    along = (np.arange(count) + rng.random(count)) / count * areas.sum()
    chosen = np.searchsorted(np.cumsum(areas), along).clip(max=len(areas) - 1)
    root, side = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    points = (
        (1.0 - root) * corner[chosen]
        + root * (1.0 - side) * first[chosen]
        + root * side * second[chosen]
    )
    cells = np.floor(points / spacing).astype(np.int64)
    kept = np.sort(np.unique(cells, axis=0, return_index=True)[1])
    normals = across[chosen[kept]] / (2.0 * areas[chosen[kept], None])
    return points[kept], normals


def _areas(vertices: FloatArray, triangles: NDArray[np.uint32]) -> tuple[FloatArray, FloatArray]:
    """Normals of triangles, twice as long as the areas, (t, 3), and areas, (t,) [m²]."""
    corner, first, second = (vertices[triangles[:, i]] for i in range(3))
    across = np.cross(first - corner, second - corner)
    return across, np.linalg.norm(across, axis=1) / 2.0


def loaded_open3d() -> Any:
    """The library open3d.

    Raises:
        DependencyError: it is not installed.
    """
    try:
        import open3d
    except ImportError:
        raise missing_extra("open3d", "robot") from None
    return open3d
