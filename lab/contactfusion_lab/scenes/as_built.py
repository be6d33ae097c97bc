"""The robot as it was built: its true shapes deviate from those of its URDF."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.frames import inverse, points_in
from contactfusion.robots.model import RobotModel
from contactfusion.robots.solids import Solid
from contactfusion.robots.urdf import Mesh
from contactfusion.shapes import ShapeConfig

LEAST = 0.5
"""A shape is at least so large along each axis, as a share of its size in the URDF."""
FILE = "robot.urdf"


@contextmanager
def as_built(robot: RobotModel, deviation: float, rng: np.random.Generator) -> Iterator[RobotModel]:
    """The robot with shapes whose extents and positions deviate, along each axis.

    Links, joints, masses and sensors stay. A collision shape and the visual shape of the same
    number deviate alike.

    Args:
        robot: as its URDF describes it.
        deviation: the standard deviation [m]; 0: it is as described.
        rng: draws the deviations.

    Yields:
        The robot, whose URDF is a file that is there until the context ends.
    """
    if not deviation:
        yield robot
        return
    tree = ElementTree.parse(robot.urdf.path)
    kinds = tuple(dict.fromkeys(("collision", robot.config.shapes)))
    folders = set[Path]()
    for element in tree.getroot().findall("link"):
        link = robot.urdf.links[element.get("name", "")]
        elements = {kind: element.findall(kind) for kind in ("collision", "visual")}
        count = max(map(len, elements.values()))
        deviations = deviation * rng.standard_normal((count, 2, 3))
        for kind, found in elements.items():
            if kind not in kinds:  # without them the physics draws the collision shapes
                for each in found:
                    element.remove(each)
                continue
            for each, shape, (size, place) in zip(
                found, getattr(link, kind), deviations, strict=False
            ):
                if isinstance(shape, Mesh):
                    folders.add(shape.file.resolve().parent)
                _deviate(each, shape, size, place)
    with TemporaryDirectory(prefix="contactfusion-") as folder:
        tree.write(Path(folder, FILE))
        fields = {
            "urdf": FILE,
            "folder": Path(folder),
            "packages": tuple(sorted(folders)),
            "files_within": None,
        }
        built = RobotModel(robot.config.model_copy(update=fields))
        yield built


def _deviate(
    element: Element, shape: ShapeConfig | Mesh, size: FloatArray, place: FloatArray
) -> None:
    """Change the extents and the position of a shape.

    Args:
        element: of its URDF.
        shape: as it is there.
        size: shape (3,), the deviations of its extents along its axes [m].
        place: shape (3,), that of its position [m].
    """
    origin = element.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(element, "origin")
    origin.set("xyz", _text(np.add(shape.xyz, place)))
    geometry = element.find("geometry/*")
    assert geometry is not None  # the shape was read from it
    if isinstance(shape, Mesh):
        geometry.set("filename", str(shape.file.resolve()))
        geometry.set("scale", _text(np.multiply(shape.scale, _factors(_extents(shape), size))))
    elif shape.size is not None:
        geometry.set("size", _text(np.multiply(shape.size, _factors(np.array(shape.size), size))))
    else:
        width = 2.0 * (shape.radius or 0.0)
        extents = np.array([width, width, shape.length or width])
        across, _, along = extents * _factors(extents, size)
        geometry.set("radius", _text([across / 2.0]))
        if shape.length is not None:
            geometry.set("length", _text([along]))


def _factors(extents: FloatArray, deviations: FloatArray) -> FloatArray:
    """By how much extents that deviate are greater, shape (3,); a flat shape stays flat."""
    some = np.where(extents > 0.0, extents, np.inf)
    return np.asarray(np.maximum(1.0 + deviations / some, LEAST))


@lru_cache(maxsize=128)
def _extents(mesh: Mesh) -> FloatArray:
    """The extents of a mesh along its own axes, shape (3,) [m]."""
    vertices, _ = Solid((mesh,)).meshes[0]
    return np.asarray(np.ptp(points_in(inverse(mesh.pose()), vertices), axis=0))


def _text(values: Iterable[float]) -> str:
    """Numbers as a URDF has them."""
    return " ".join(repr(float(value)) for value in values)
