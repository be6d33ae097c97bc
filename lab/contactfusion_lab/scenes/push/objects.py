"""What is pushed: objects, the parts that they are made of, their outlines and surfaces."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator
from scipy.spatial import ConvexHull, QhullError

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.frames import planar_rotation, points_in
from contactfusion.model import Model
from contactfusion.robots.description import RobotConfig

Triangles = tuple[FloatArray, NDArray[np.uint32]]
"""Vertices (v, 3) [m], and rows of them that make triangles, (t, 3)."""
STREAM = 5
"""Sets the chance of shoves apart from that of sensors, which has the same seed."""
Length = Annotated[float, Field(gt=0, le=10)]
Mass = Annotated[float, Field(gt=0)]
ROUND = 48
"""So many corners make up the outline of what is round."""
Place = Annotated[float, Field(ge=-5, le=5)]


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
        """The part turned by `yaw` [rad], then moved by `at`, shape (2,) [m], and lifted."""
        outline = self.outline @ planar_rotation(yaw).T + at
        return Part(outline, self.radius, self.bottom + bottom, self.height, self.mass)


def rectangle(x: float, y: float) -> FloatArray:
    """The corners of a rectangle about the origin, counterclockwise, shape (4, 2) [m]."""
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) / 2.0


def polygon(sides: int, radius: float) -> FloatArray:
    """The corners of a regular polygon, an edge ahead, counterclockwise, shape (n, 2) [m]."""
    angles = 2.0 * np.pi * (np.arange(sides) + 0.5) / sides
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def extruded(part: Part) -> Triangles:
    """A convex piece's surface: underside, top, and a strip of walls."""
    count = len(part.outline)
    low, high = (
        np.column_stack([part.outline, np.full(count, z)])
        for z in (part.bottom, part.bottom + part.height)
    )
    here = np.arange(count)
    there = np.roll(here, -1)
    fan = np.stack([np.zeros(count - 2, np.intp), here[1:-1], here[2:]], axis=1)
    walls = [
        np.stack([here, there, there + count], axis=1),
        np.stack([here, there + count, here + count], axis=1),
    ]
    triangles = np.concatenate([fan[:, ::-1], fan + count, *walls])
    return np.concatenate([low, high]), triangles.astype(np.uint32)


class DisturbanceConfig(Model):
    """One shove, level, through the object's middle."""

    start: float = Field(ge=0)
    """When it begins [s]."""
    duration: float = Field(default=0.3, ge=0.01)
    """[s]."""
    force: tuple[float, float]
    """Along x and y of `odom` [N]."""
    height: float = Field(default=0.2, ge=0, le=10)
    """Above the floor [m]."""


class DisturbedConfig(Model):
    """Shoves by chance: when, and which way, is drawn anew for every seed."""

    count: int = Field(ge=1, le=100)
    """How many."""
    force: float = Field(gt=0)
    """Of each, any way [N]."""
    duration: float = Field(default=0.3, ge=0.01)
    """Of each [s]."""
    height: float = Field(default=0.2, ge=0, le=10)
    """Above the floor [m]."""
    before: float = Field(default=20.0, gt=0)
    """They all begin before this [s]."""


def drawn(config: DisturbedConfig, seed: int) -> tuple[DisturbanceConfig, ...]:
    """Draw shoves: their starts are uniform in time, their directions on the circle.

    Args:
        config: how many, and how strong.
        seed: of the push.
    """
    rng = np.random.default_rng([seed, STREAM])
    starts = np.sort(rng.uniform(0.0, config.before, config.count)).tolist()
    angles = rng.uniform(-math.pi, math.pi, config.count).tolist()
    return tuple(
        DisturbanceConfig(
            start=start,
            duration=config.duration,
            force=(config.force * math.cos(angle), config.force * math.sin(angle)),
            height=config.height,
        )
        for start, angle in zip(starts, angles, strict=True)
    )


class SoftConfig(Model):
    """How something gives way where robot and object press each other; the floor is rigid."""

    stiffness: float = Field(gt=0)
    """Of the whole of a line of contact from bottom to top [N/m]; foam has about 1500."""
    damping: float = Field(ge=0)
    """[N·s/m]."""

    def on(self, other: "SoftConfig") -> "SoftConfig":
        """What both are, one on the other."""
        return SoftConfig(
            stiffness=1.0 / (1.0 / self.stiffness + 1.0 / other.stiffness),
            damping=min(self.damping, other.damping),
        )


class ThingConfig(Model):
    """What all objects may be."""

    soft: SoftConfig | None = None
    """How it gives way; None: it is rigid."""
    disturbed: DisturbedConfig | None = None
    """How somebody else pushes it at times; None: nobody does."""

    @model_serializer(mode="wrap")
    def _told(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out what it is not: objects are told as they were before they could be that."""
        return {name: value for name, value in handler(self).items() if value is not None}


class BoxConfig(ThingConfig):
    """A box."""

    shape: Literal["box"]
    size: tuple[Length, Length, Length]
    """Its edges along x, y and z [m]."""
    mass: Mass
    """[kg]."""

    def parts(self) -> list[Part]:
        """The box, its middle at the origin."""
        x, y, z = self.size
        return [Part(rectangle(x, y), None, 0.0, z, self.mass)]


class CylinderConfig(ThingConfig):
    """An upright cylinder."""

    shape: Literal["cylinder"]
    radius: Length
    """[m]."""
    height: Length
    """[m]."""
    mass: Mass
    """[kg]."""

    def parts(self) -> list[Part]:
        """The cylinder, its middle at the origin."""
        return [Part(polygon(ROUND, self.radius), self.radius, 0.0, self.height, self.mass)]


class PrismConfig(ThingConfig):
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
        """The prism, its middle at the origin."""
        return [Part(polygon(self.sides, self.radius), None, 0.0, self.height, self.mass)]


class LShapeConfig(ThingConfig):
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
        """Bar and leg, the middle of their mass at the origin."""
        (length, width), (leg, breadth) = self.bar, self.leg
        areas = np.array([length * width, leg * breadth])
        middles = np.array([[0.0, 0.0], [(width + leg) / 2.0, (length - breadth) / 2.0]])
        middles -= areas @ middles / areas.sum()
        outlines = rectangle(width, length), rectangle(leg, breadth)
        masses = self.mass * areas / areas.sum()
        return [
            Part(outline + middle, None, 0.0, self.height, float(mass))
            for outline, middle, mass in zip(outlines, middles, masses, strict=True)
        ]


class BallConfig(Model):
    """A ball."""

    mass: Mass
    """[kg]."""
    radius: Length
    """[m]."""


class HollowConfig(ThingConfig):
    """A closed box with thin walls, in which a ball may roll."""

    shape: Literal["hollow"]
    size: tuple[Length, Length, Length]
    """Its outer edges along x, y and z [m]."""
    wall: Length
    """How thick walls, floor and lid are [m]."""
    mass: Mass
    """Of walls, floor and lid, spread evenly [kg]."""
    ball: BallConfig | None = None
    """What rolls inside, without loss; it starts in the middle of the floor."""

    @model_validator(mode="after")
    def _roomy(self) -> Self:
        room = min(self.size) - 2.0 * self.wall
        if room <= 0.0:
            raise ConfigurationError(f"walls of {self.wall:g} m leave no room inside", "wall")
        if self.ball is not None and 2.0 * self.ball.radius >= room:
            raise ConfigurationError(
                f"a ball {2.0 * self.ball.radius:g} m across does not fit: there are "
                f"{room:g} m of room",
                "ball",
            )
        return self

    def parts(self) -> list[Part]:
        """Floor, lid and the four walls between them."""
        (x, y, z), wall = self.size, self.wall
        aside, ahead = np.array([0.0, (y - wall) / 2.0]), np.array([(x - wall) / 2.0, 0.0])
        slab, height = rectangle(x, y), z - 2.0 * wall
        long, short = rectangle(x, wall), rectangle(wall, y - 2.0 * wall)
        plates = [(slab, 0.0, wall), (slab, z - wall, wall)]
        sides = [long + aside, long - aside, short + ahead, short - ahead]
        plates += [(side, wall, height) for side in sides]
        volumes = np.array([np.prod(np.ptp(corners, axis=0)) * up for corners, _, up in plates])
        masses = self.mass * volumes / volumes.sum()
        return [
            Part(corners, None, bottom, up, float(mass))
            for (corners, bottom, up), mass in zip(plates, masses, strict=True)
        ]


class PieceConfig(Model):
    """A piece of a compound object, and where it stands."""

    piece: BoxConfig | CylinderConfig | PrismConfig | LShapeConfig = Field(discriminator="shape")
    """What it is."""
    at: tuple[Place, Place] = (0.0, 0.0)
    """The middle of the piece in the object's frame [m]."""
    yaw: float = 0.0
    """How it is turned [degrees]."""
    bottom: float = Field(default=0.0, ge=0)
    """How high its underside is above the floor [m]."""

    @model_validator(mode="after")
    def _plain(self) -> Self:
        for name in ("soft", "disturbed"):
            if getattr(self.piece, name) is not None:
                raise ConfigurationError(f"give `{name}` to the whole object", f"piece.{name}")
        return self


class CompoundConfig(ThingConfig):
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
        """The parts of all pieces."""
        return [
            part.moved(np.array(piece.at), np.radians(piece.yaw), piece.bottom)
            for piece in self.pieces
            for part in piece.piece.parts()
        ]


class UrdfObjectConfig(ThingConfig):
    """An object by URDF; its origin lies on the floor."""

    shape: Literal["urdf"]
    urdf: str = Field(min_length=1)
    """The file, or MODULE:FILE for one in an installed Python package."""
    folder: Path = Path()
    """Where a relative `urdf` starts; the folder of the configuration."""


ObjectConfig = Annotated[
    BoxConfig
    | CylinderConfig
    | PrismConfig
    | LShapeConfig
    | HollowConfig
    | CompoundConfig
    | UrdfObjectConfig,
    Field(discriminator="shape"),
]


def outlines(config: ObjectConfig) -> list[FloatArray]:
    """The object as it is seen from above: the corners of each convex piece.

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


def triangles_of(config: ObjectConfig) -> list[Triangles]:
    """The surface of an object in its frame, one closed mesh a piece.

    Returns:
        Vertices (v, 3) [m], and rows of them that make triangles, (t, 3).

    Raises:
        RobotError: a URDF cannot be read, or has no collision shape.
    """
    if isinstance(config, UrdfObjectConfig):
        from contactfusion.robots.model import RobotModel

        model = RobotModel(RobotConfig(urdf=config.urdf, folder=config.folder))
        poses = model.poses_at(np.zeros(len(model.joint_names)))
        return [
            (points_in(poses[link], vertices), triangles)
            for link, solid in model.solids.items()
            for vertices, triangles in solid.meshes
        ]
    return [extruded(part) for part in config.parts()]


def _hull(points: FloatArray) -> FloatArray:
    corners: FloatArray = points[ConvexHull(points).vertices]
    return corners
