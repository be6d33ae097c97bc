"""Objects to push: simple shapes with a mass, hollow, put together, or a URDF."""

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from contactfusion.errors import ConfigurationError
from contactfusion.model import Model
from contactfusion_lab.simulation.push_parts import Part, rectangle
from contactfusion_lab.simulation.push_shapes import (
    BoxConfig,
    CylinderConfig,
    Length,
    LShapeConfig,
    Mass,
    PrismConfig,
    ThingConfig,
)

Place = Annotated[float, Field(ge=-5, le=5)]


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
        """Give floor, lid and the four walls between them."""
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
        """Give the parts of all pieces."""
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
