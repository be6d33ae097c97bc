"""Objects to push: primitives with a mass, put together, or a URDF."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator
from scipy.spatial import ConvexHull, QhullError

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RobotError, name_hint
from contactfusion.files import require_file
from contactfusion.frames import points_in
from contactfusion.model import Model, rooted
from contactfusion.robots.description import RobotConfig
from contactfusion.yaml_files import read_yaml

Length = Annotated[float, Field(gt=0, le=10)]
Place = Annotated[float, Field(ge=-5, le=5)]
Mass = Annotated[float, Field(gt=0)]
ROUND = 48
"""So many corners make up the outline of what is round."""


@dataclass(frozen=True, eq=False)
class Part:
    """One convex piece of an object, upright.

    Attributes:
        outline: shape (n, 2) [m], its corners seen from above, in the object's frame.
        radius: of a cylinder [m], else None.
        bottom: above the floor [m].
        height: [m].
        mass: [kg].
    """

    outline: FloatArray
    radius: float | None
    bottom: float
    height: float
    mass: float

    @property
    def middle(self) -> FloatArray:
        """The middle of its area, shape (2,) [m], in the object's frame."""
        x, y = self.outline.T
        ahead_x, ahead_y = np.roll(self.outline, -1, axis=0).T
        cross = x * ahead_y - ahead_x * y
        weighted = [((x + ahead_x) * cross).sum(), ((y + ahead_y) * cross).sum()]
        middle: FloatArray = np.array(weighted) / (3.0 * cross.sum())
        return middle

    def moved(self, at: FloatArray, yaw: float, bottom: float) -> "Part":
        """Give the part turned by `yaw` [rad], then moved by `at`, shape (2,) [m], and lifted."""
        outline = self.outline @ _turn(yaw).T + at
        return Part(outline, self.radius, self.bottom + bottom, self.height, self.mass)


class BoxConfig(Model):
    """A box."""

    shape: Literal["box"]
    size: tuple[Length, Length, Length]
    """Its edges along x, y and z [m]."""
    mass: Mass
    """[kg]."""

    def parts(self) -> list[Part]:
        """Give the box, its middle at the origin."""
        x, y, z = self.size
        return [Part(_rectangle(x, y), None, 0.0, z, self.mass)]


class CylinderConfig(Model):
    """An upright cylinder."""

    shape: Literal["cylinder"]
    radius: Length
    """[m]."""
    height: Length
    """[m]."""
    mass: Mass
    """[kg]."""

    def parts(self) -> list[Part]:
        """Give the cylinder, its middle at the origin."""
        return [Part(_polygon(ROUND, self.radius), self.radius, 0.0, self.height, self.mass)]


class PrismConfig(Model):
    """An upright prism over a regular polygon, one face ahead."""

    shape: Literal["prism"]
    sides: int = Field(ge=3, le=24)
    """How many."""
    radius: Length
    """From the middle to a corner [m]."""
    height: Length
    """[m]."""
    mass: Mass
    """[kg]."""

    def parts(self) -> list[Part]:
        """Give the prism, its middle at the origin."""
        return [Part(_polygon(self.sides, self.radius), None, 0.0, self.height, self.mass)]


class LShapeConfig(Model):
    """Two boxes that make an L: a bar across, and a leg that goes on ahead from one end of it."""

    shape: Literal["lshape"]
    bar: tuple[Length, Length]
    """Its length along y and its width along x [m]."""
    leg: tuple[Length, Length]
    """Its length along x and its width along y [m]."""
    height: Length
    """[m]."""
    mass: Mass
    """Of both, spread evenly [kg]."""

    def parts(self) -> list[Part]:
        """Give bar and leg, the middle of their mass at the origin."""
        (length, width), (leg, breadth) = self.bar, self.leg
        areas = np.array([length * width, leg * breadth])
        middles = np.array([[0.0, 0.0], [(width + leg) / 2.0, (length - breadth) / 2.0]])
        middles -= areas @ middles / areas.sum()
        outlines = _rectangle(width, length), _rectangle(leg, breadth)
        masses = self.mass * areas / areas.sum()
        return [
            Part(outline + middle, None, 0.0, self.height, float(mass))
            for outline, middle, mass in zip(outlines, middles, masses, strict=True)
        ]


class PieceConfig(Model):
    """A piece of a compound object, and where it stands."""

    piece: "BoxConfig | CylinderConfig | PrismConfig | LShapeConfig" = Field(discriminator="shape")
    """What it is."""
    at: tuple[Place, Place] = (0.0, 0.0)
    """The middle of the piece in the object's frame [m]."""
    yaw: float = 0.0
    """How it is turned [degrees]."""
    bottom: float = Field(default=0.0, ge=0)
    """How high its underside is above the floor [m]."""


class CompoundConfig(Model):
    """Pieces that hold together, such as a box with something heavy in a corner, or a chair."""

    shape: Literal["compound"]
    pieces: tuple[PieceConfig, ...] = Field(min_length=1)
    """At least one of them stands on the floor."""

    @model_validator(mode="after")
    def _standing(self) -> Self:
        if min(piece.bottom for piece in self.pieces) > 0.0:
            raise ConfigurationError("no piece stands on the floor", "pieces")
        return self

    def parts(self) -> list[Part]:
        """Give the parts of all pieces."""
        return [
            part.moved(np.array(piece.at), np.radians(piece.yaw), piece.bottom)
            for piece in self.pieces
            for part in piece.piece.parts()
        ]


class UrdfObjectConfig(Model):
    """An object by URDF; its origin lies on the floor."""

    shape: Literal["urdf"]
    urdf: str = Field(min_length=1)
    """The file, or MODULE:FILE for one in an installed Python package."""
    folder: Path = Path()
    """Where a relative `urdf` starts; the folder of the configuration."""


ObjectConfig = Annotated[
    BoxConfig | CylinderConfig | PrismConfig | LShapeConfig | CompoundConfig | UrdfObjectConfig,
    Field(discriminator="shape"),
]

PAPER: dict[str, dict[str, Any]] = {
    "box": {"shape": "box", "size": (0.40, 0.40, 0.80), "mass": 20.0},
    "cylinder": {"shape": "cylinder", "radius": 0.25, "height": 0.70, "mass": 25.0},
    "nonuniform": {
        "shape": "compound",
        "pieces": (
            {"piece": {"shape": "box", "size": (0.45, 0.45, 0.60), "mass": 5.0}},
            {
                "piece": {"shape": "cylinder", "radius": 0.10, "height": 0.30, "mass": 10.0},
                "at": (0.125, 0.125),
                "bottom": 0.60,
            },
        ),
    },
}
"""The objects of O Fig 3: the third has its weight in the rear left corner, seen from the robot."""
OTHERS: dict[str, dict[str, Any]] = {
    "lshape": {
        "shape": "lshape",
        "bar": (0.80, 0.15),
        "leg": (0.40, 0.27),
        "height": 0.45,
        "mass": 3.0,
    },
    "prism": {"shape": "prism", "sides": 6, "radius": 0.30, "height": 0.60, "mass": 12.0},
    "light_cylinder": {"shape": "cylinder", "radius": 0.50, "height": 0.65, "mass": 0.8},
}
"""Objects that no parameter was chosen on; the first and the last are those of O §V, rigid."""
FRICTIONS: dict[str, tuple[float, float]] = {"mu1": (0.3, 0.35), "mu2": (0.2, 0.5)}
"""Between object and ground, and between object and robot (O §III-B)."""


def _named(value: Any) -> Any:
    """Take the name of a known object for the object."""
    if not isinstance(value, str):
        return value
    known = {**PAPER, **OTHERS}
    if value not in known:
        raise ConfigurationError(f"unknown object '{value}'; {name_hint(value, known, 'objects')}")
    return known[value]


AnyObject = Annotated[ObjectConfig, BeforeValidator(_named)]


class _File(Model):
    thing: AnyObject


def named_object(name: str) -> "ObjectConfig":
    """Give a known object.

    Raises:
        ConfigurationError: there is none of that name.
    """
    fields: dict[str, Any] = {"thing": name}
    return _File(**fields).thing


def read_object(path: Path) -> "ObjectConfig":
    """Read an object from a URDF, or from a YAML file that holds the fields of one.

    Raises:
        ConfigurationError: the file is missing, or holds no object.
    """
    if path.suffix not in (".yaml", ".yml"):
        require_file(path, ConfigurationError)
        return UrdfObjectConfig(shape="urdf", urdf=str(path.resolve()))
    fields: dict[str, Any] = {"thing": read_yaml(path)}
    try:
        return rooted(_File(**fields), path.parent).thing
    except ConfigurationError as error:
        field = error.path.removeprefix("thing").lstrip(".")
        raise ConfigurationError(f"{path}: {ConfigurationError(error.problem, field)}") from None


def outlines(config: "ObjectConfig") -> list[FloatArray]:
    """Give the object as it is seen from above: the corners of each convex piece.

    The collision shapes of a URDF are taken for convex, its joints stand at 0.

    Returns:
        Each of shape (n, 2) [m], counterclockwise, in the object's frame.

    Raises:
        RobotError: a URDF cannot be read, has no collision shape, or one that is flat.
    """
    if not isinstance(config, UrdfObjectConfig):
        return [part.outline for part in config.parts()]
    from contactfusion.robots.model import RobotModel

    model = RobotModel(RobotConfig(urdf=config.urdf, folder=config.folder))
    poses = model.poses_at(np.zeros(len(model.joint_names)))
    try:
        found = [
            _hull(points_in(poses[link], vertices)[:, :2])
            for link, solid in model.solids.items()
            for vertices, _ in solid.meshes
        ]
    except QhullError:
        raise RobotError(f"{model.urdf.path}: a collision shape is flat seen from above") from None
    if not found:
        raise RobotError(f"{model.urdf.path}: it has no collision shape")
    return found


def _hull(points: FloatArray) -> FloatArray:
    corners: FloatArray = points[ConvexHull(points).vertices]
    return corners


def _rectangle(x: float, y: float) -> FloatArray:
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) / 2.0


def _polygon(sides: int, radius: float) -> FloatArray:
    """Give the corners of a regular polygon, an edge ahead, counterclockwise."""
    angles = 2.0 * np.pi * (np.arange(sides) + 0.5) / sides
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _turn(yaw: float) -> FloatArray:
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
