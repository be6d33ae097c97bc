"""Objects to push: their convex parts, outlines and surfaces."""

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
"""Vertices, shape (v, 3) [m], and triangles as rows of vertices, shape (t, 3)."""
STREAM = 5
"""Separates the random draws of shoves from those of sensors, which have the same seed."""
Length = Annotated[float, Field(gt=0, le=10)]
Mass = Annotated[float, Field(gt=0)]
ROUND = 48
"""Corners of the outline of a circle."""
Place = Annotated[float, Field(ge=-5, le=5)]


@dataclass(frozen=True, eq=False)
class Part:
    """One convex, upright part of an object.

    Attributes:
        outline: shape (n, 2) [m], its corners from above, in the object's frame.
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
        """Centroid of its area, shape (2,) [m], in the object's frame."""
        x, y = self.outline.T
        next_x, next_y = np.roll(self.outline, -1, axis=0).T
        cross = x * next_y - next_x * y
        weighted = [((x + next_x) * cross).sum(), ((y + next_y) * cross).sum()]
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
    """The corners of a regular polygon, an edge at +x, counterclockwise, shape (n, 2) [m]."""
    angles = 2.0 * np.pi * (np.arange(sides) + 0.5) / sides
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def extruded(part: Part) -> Triangles:
    """Surface of a convex part: underside, top, and a strip of walls."""
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
    """One horizontal shove, through the origin of the object's frame."""

    start: float = Field(ge=0)
    """Start time [s]."""
    duration: float = Field(default=0.3, ge=0.01)
    """Duration [s]."""
    force: tuple[float, float]
    """Force along x and y of `odom` [N]."""
    height: float = Field(default=0.2, ge=0, le=10)
    """Height above the floor [m]."""


class DisturbedConfig(Model):
    """Random shoves: times and directions are drawn for every seed."""

    count: int = Field(ge=1, le=100)
    """Number of shoves."""
    force: float = Field(gt=0)
    """Force of each, in any direction [N]."""
    duration: float = Field(default=0.3, ge=0.01)
    """Duration of each [s]."""
    height: float = Field(default=0.2, ge=0, le=10)
    """Height above the floor [m]."""
    before: float = Field(default=20.0, gt=0)
    """Time before which they all start [s]."""


def drawn(config: DisturbedConfig, seed: int) -> tuple[DisturbanceConfig, ...]:
    """Random shoves: start times uniform in time, directions on the circle.

    Args:
        config: number, force and duration.
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
    """Compliance of the contact between robot and object; the floor is rigid."""

    stiffness: float = Field(gt=0)
    """Stiffness of a whole line of contact from bottom to top [N/m]; foam has about 1500."""
    damping: float = Field(ge=0)
    """Damping of such a line [N·s/m]."""

    def on(self, other: "SoftConfig") -> "SoftConfig":
        """Both in series."""
        return SoftConfig(
            stiffness=1.0 / (1.0 / self.stiffness + 1.0 / other.stiffness),
            damping=min(self.damping, other.damping),
        )


class PushedConfig(Model):
    """Options of all objects."""

    soft: SoftConfig | None = None
    """Compliance of the object; None: it is rigid."""
    disturbed: DisturbedConfig | None = None
    """Random shoves from outside; None: none."""

    @model_serializer(mode="wrap")
    def _serialized(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Without options that are None, so that earlier objects serialize as they did before."""
        return {name: value for name, value in handler(self).items() if value is not None}


class BoxConfig(PushedConfig):
    """A box."""

    shape: Literal["box"]
    size: tuple[Length, Length, Length]
    """Edges along x, y and z [m]."""
    mass: Mass
    """Mass [kg]."""

    def parts(self) -> list[Part]:
        """The box, its middle at the origin."""
        x, y, z = self.size
        return [Part(rectangle(x, y), None, 0.0, z, self.mass)]


class CylinderConfig(PushedConfig):
    """An upright cylinder."""

    shape: Literal["cylinder"]
    radius: Length
    """Radius [m]."""
    height: Length
    """Height [m]."""
    mass: Mass
    """Mass [kg]."""

    def parts(self) -> list[Part]:
        """The cylinder, its middle at the origin."""
        return [Part(polygon(ROUND, self.radius), self.radius, 0.0, self.height, self.mass)]


class PrismConfig(PushedConfig):
    """An upright prism over a regular polygon, one face at +x."""

    shape: Literal["prism"]
    sides: int = Field(ge=3, le=24)
    """Number of faces."""
    radius: Length
    """From the middle to a corner [m]."""
    height: Length
    """Height [m]."""
    mass: Mass
    """Mass [kg]."""

    def parts(self) -> list[Part]:
        """The prism, its middle at the origin."""
        return [Part(polygon(self.sides, self.radius), None, 0.0, self.height, self.mass)]


class LShapeConfig(PushedConfig):
    """Two boxes that make an L: a bar along y, and a leg towards +x from one end of it."""

    shape: Literal["lshape"]
    bar: tuple[Length, Length]
    """Length along y and width along x of the bar [m]."""
    leg: tuple[Length, Length]
    """Length along x and width along y of the leg [m]."""
    height: Length
    """Height [m]."""
    mass: Mass
    """Mass of both, spread evenly [kg]."""

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
    """Mass [kg]."""
    radius: Length
    """Radius [m]."""


class HollowConfig(PushedConfig):
    """A closed box with thin walls, in which a ball may roll."""

    shape: Literal["hollow"]
    size: tuple[Length, Length, Length]
    """Outer edges along x, y and z [m]."""
    wall: Length
    """Thickness of walls, floor and lid [m]."""
    mass: Mass
    """Mass of walls, floor and lid, spread evenly [kg]."""
    ball: BallConfig | None = None
    """A ball that rolls inside, without loss, from the middle of the floor; None: none."""

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
        lateral, forward = np.array([0.0, (y - wall) / 2.0]), np.array([(x - wall) / 2.0, 0.0])
        slab, height = rectangle(x, y), z - 2.0 * wall
        long, short = rectangle(x, wall), rectangle(wall, y - 2.0 * wall)
        plates = [(slab, 0.0, wall), (slab, z - wall, wall)]
        sides = [long + lateral, long - lateral, short + forward, short - forward]
        plates += [(side, wall, height) for side in sides]
        volumes = np.array([np.prod(np.ptp(corners, axis=0)) * up for corners, _, up in plates])
        masses = self.mass * volumes / volumes.sum()
        return [
            Part(corners, None, bottom, up, float(mass))
            for (corners, bottom, up), mass in zip(plates, masses, strict=True)
        ]


class PieceConfig(Model):
    """A piece of a compound object, and its pose."""

    piece: BoxConfig | CylinderConfig | PrismConfig | LShapeConfig = Field(discriminator="shape")
    """The piece."""
    at: tuple[Place, Place] = (0.0, 0.0)
    """The middle of the piece in the object's frame [m]."""
    yaw: float = 0.0
    """Yaw of the piece [degrees]."""
    bottom: float = Field(default=0.0, ge=0)
    """Height of its underside above the floor [m]."""

    @model_validator(mode="after")
    def _plain(self) -> Self:
        for name in ("soft", "disturbed"):
            if getattr(self.piece, name) is not None:
                raise ConfigurationError(f"give `{name}` to the whole object", f"piece.{name}")
        return self


class CompoundConfig(PushedConfig):
    """Rigidly joined pieces, such as a box with a load in a corner, or a chair."""

    shape: Literal["compound"]
    pieces: tuple[PieceConfig, ...] = Field(min_length=1)
    """The pieces; at least one of them stands on the floor."""

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


class UrdfObjectConfig(PushedConfig):
    """An object by URDF; its origin lies on the floor."""

    shape: Literal["urdf"]
    urdf: str = Field(min_length=1)
    """The URDF file, or MODULE:FILE for one in an installed Python package."""
    folder: Path = Path()
    """The folder to which a relative `urdf` refers; that of the configuration."""


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
    """Outlines of an object from above: the corners of each convex part.

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
    """The surface of an object in its frame, one closed mesh a part.

    Returns:
        Vertices, shape (v, 3) [m], and triangles as rows of vertices, shape (t, 3).

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
