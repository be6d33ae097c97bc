"""Surfaces of rigid bodies by configuration: boxes, cylinders, spheres, rectangles, or a file."""

import math
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.estimate import SAMPLE, too_much
from contactfusion.files import read_npz
from contactfusion.frames import Pose, pose_at
from contactfusion.model import Model
from contactfusion.surface import RigidPart, Surface
from contactfusion.units import Angles, Edge, Position, Spacing

LONG, SLENDER = 100.0, 1000.0
"""The length [m] from which on a box or cylinder is checked, and its greatest ratio to the next
edge: the boom of a crane is 100 times as long as wide."""
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


class ShapeConfig(Model):
    """A primitive, centred at `xyz` and rotated by `rpy` in the frame of its body."""

    shape: Literal["box", "cylinder", "sphere", "rectangle"]
    """The kind; a cylinder's axis is its z (rotated by `rpy`), a rectangle faces its +z."""
    size: tuple[Edge, ...] | None = None
    """Edges of a box or rectangle [m]."""
    radius: Edge | None = Field(default=None, gt=0)
    """Radius of a cylinder or sphere [m]."""
    length: Edge | None = Field(default=None, gt=0)
    """Length of a cylinder, along its z, half of it to either side of `xyz` [m]."""
    xyz: Position = (0.0, 0.0, 0.0)
    """The centre of the shape, of a cylinder too, in the frame of its body [m]."""
    rpy: Angles = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw [rad]."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        wanted = {
            "box": {"size"},
            "rectangle": {"size"},
            "cylinder": {"radius", "length"},
            "sphere": {"radius"},
        }[self.shape]
        given = {name for name in ("size", "radius", "length") if getattr(self, name) is not None}
        if given != wanted:
            raise ValueError(f"a {self.shape} needs {' and '.join(sorted(wanted))}")
        edges = {"box": 3, "rectangle": 2}.get(self.shape)
        if edges and (len(self.size or ()) != edges or min(self.size or (0,)) <= 0):
            raise ValueError(f"a {self.shape} has {edges} positive edges")
        return self

    @model_validator(mode="after")
    def _stout(self) -> Self:
        """Refuse a length in millimetres among metres; floors and walls are thin, but wide."""
        if self.shape not in ("box", "cylinder"):
            return self
        diameter = 2.0 * (self.radius or 0.0)
        edges = self.size or (diameter, diameter, self.length or 0.0)
        *_, wide, long = sorted(edges)
        if long >= LONG and long > SLENDER * wide:
            raise ConfigurationError(
                f"{long:g} m is implausible beside {wide:g} m; lengths are in metres: did you "
                f"mean {long / 1000.0:.5g}?",
                f"size.{edges.index(long)}" if self.size else "length",
            )
        return self

    def area(self) -> float:
        """The area of its surface [m²]."""
        radius, length = self.radius or 0.0, self.length or 0.0
        match self.shape:
            case "rectangle":
                return math.prod(self.size or ())
            case "box":
                x, y, z = self.size or (0.0, 0.0, 0.0)
                return 2.0 * (x * y + y * z + z * x)
            case "cylinder":
                return 2.0 * math.pi * radius * (radius + length)
            case "sphere":
                return 4.0 * math.pi * radius**2

    def extent(self) -> str:
        """Its size in words, such as "0.2 x 0.1 m"."""
        diameter = 2.0 * (self.radius or 0.0)
        sizes = self.size or ((diameter, self.length) if self.length else (diameter,))
        return " x ".join(f"{edge:g}" for edge in sizes) + " m"

    def pose(self) -> Pose:
        """The pose of the shape in the frame of its body."""
        return pose_at(self.xyz, self.rpy)

    def sampled(self, frame: str, spacing: Spacing) -> Surface:
        """The surface of the primitive as points at most about `spacing` [m] apart."""
        pose = self.pose()
        match self.shape:
            case "rectangle":
                x, y = np.diag([*(self.size or ()), 0.0])[:2] / 2.0
                return Surface.rectangle(frame, np.zeros(3), x, y, spacing).moved(pose, frame)
            case "box":
                return _box(frame, np.array(self.size), spacing).moved(pose, frame)
            case "cylinder":
                return _cylinder(frame, self.radius or 0, self.length or 0, spacing).moved(
                    pose, frame
                )
            case "sphere":
                return _sphere(frame, self.radius or 0, spacing).moved(pose, frame)


class PartConfig(ShapeConfig):
    """A primitive as a part of a body."""

    link: str = ""
    """The link that it is part of, where sensors are on parts of the body: what a sensor measures
    in a frame of that name, or in one that is fixed to it, is of contacts on this link alone.
    Empty: the body's frame."""


class BodyConfig(Model):
    """The surface of a rigid body, by shapes or from a file."""

    frame: str
    """The frame that the body is fixed to."""
    spacing: Spacing = Field(default=0.004, gt=0)
    """The distance between neighbouring points [m]."""
    shapes: tuple[PartConfig, ...] = ()
    """The primitives whose surfaces make up the body's."""
    file: Path | None = None
    """An npz file with `points` (n, 3) [m] and `normals` (n, 3)."""

    @model_validator(mode="after")
    def _something(self) -> Self:
        if bool(self.shapes) == (self.file is not None):
            raise ValueError("give shapes or a file")
        return self

    @model_validator(mode="after")
    def _affordable(self) -> Self:
        if problem := too_much(
            f"{' and '.join(shape.extent() for shape in self.shapes)} at {self.spacing * 1e3:g} mm "
            "spacing",
            self.samples(),
            SAMPLE,
        ):
            raise ValueError(f"{problem}; sizes are in metres, and a larger spacing needs less")
        return self

    def samples(self) -> float:
        """The approximate number of points on the shapes."""
        return sum(shape.area() for shape in self.shapes) / self.spacing**2

    def sampled(self, folder: Path) -> Surface:
        """The surface; a relative file name starts at `folder`.

        Raises:
            ConfigurationError: the file is missing, or holds no surface.
        """
        if self.file is not None:
            points, normals = read_npz(folder / self.file, "points", "normals")
            return Surface(self.frame, points, normals)
        links: dict[str, list[Surface]] = {}
        for shape in self.shapes:
            sampled = shape.sampled(self.frame, self.spacing)
            links.setdefault(shape.link or self.frame, []).append(sampled)
        parts = [RigidPart.of(surfaces, row) for row, surfaces in enumerate(links.values())]
        return Surface.of_parts(self.frame, [(part, np.eye(4)) for part in parts], [*links])


def _box(frame: str, size: FloatArray, spacing: Spacing) -> Surface:
    faces = []
    for axis in range(3):
        for side in (-0.5, 0.5):
            centre = np.zeros(3)
            centre[axis] = side * size[axis]
            first, second = np.zeros(3), np.zeros(3)
            first[(axis + 1) % 3] = size[(axis + 1) % 3] / 2.0
            second[(axis + 2) % 3] = size[(axis + 2) % 3] / 2.0 * (1.0 if side > 0 else -1.0)
            faces.append(Surface.rectangle(frame, centre, first, second, spacing))
    return Surface(
        frame,
        np.concatenate([face.points for face in faces]),
        np.concatenate([face.normals for face in faces]),
    )


def _cylinder(frame: str, radius: float, length: float, spacing: Spacing) -> Surface:
    around = max(6, int(np.ceil(2.0 * np.pi * radius / spacing)))
    along = max(1, int(np.ceil(length / spacing)))
    angle, height = np.meshgrid(
        2.0 * np.pi * np.arange(around) / around,
        ((np.arange(along) + 0.5) / along - 0.5) * length,
    )
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1).reshape(-1, 3)
    side = radius * out + np.stack([0 * height, 0 * height, height], axis=-1).reshape(-1, 3)
    disc = _disc(radius, spacing)
    points, normals = [side], [out]
    for end in (-0.5, 0.5):
        points.append(disc + [0.0, 0.0, end * length])
        normals.append(np.broadcast_to([0.0, 0.0, np.sign(end)], disc.shape))
    return Surface(frame, np.concatenate(points), np.concatenate(normals))


def _disc(radius: float, spacing: Spacing) -> FloatArray:
    """A disc, evenly sampled along a spiral of golden angles."""
    count = max(1, int(np.ceil(np.pi * (radius / spacing) ** 2)))
    step = np.arange(count, dtype=np.float64)
    distance, angle = radius * np.sqrt((step + 0.5) / count), step * GOLDEN_ANGLE
    return np.stack([distance * np.cos(angle), distance * np.sin(angle), 0.0 * step], axis=1)


def _sphere(frame: str, radius: float, spacing: Spacing) -> Surface:
    normals = unit_vectors(max(12, int(np.ceil(4.0 * np.pi * (radius / spacing) ** 2))))
    return Surface(frame, radius * normals, normals)


def unit_vectors(count: int) -> FloatArray:
    """Unit vectors, evenly spread over all directions, along a spiral of golden angles.

    Returns:
        Shape (count, 3).
    """
    step = np.arange(count)
    height, angle = 1.0 - (2.0 * step + 1.0) / count, step * GOLDEN_ANGLE
    ring = np.sqrt(1.0 - height**2)
    vectors = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors
