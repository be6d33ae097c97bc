"""What objects to push may be, and the simplest shapes of them."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from contactfusion.model import Model
from contactfusion_lab.simulation.push_disturbances import DisturbedConfig
from contactfusion_lab.simulation.push_parts import Part, polygon, rectangle

Length = Annotated[float, Field(gt=0, le=10)]
Mass = Annotated[float, Field(gt=0)]
ROUND = 48
"""So many corners make up the outline of what is round."""


class SoftConfig(Model):
    """How something gives way where robot and object press each other; the floor is rigid."""

    stiffness: float = Field(gt=0)
    """Of the whole of a line of contact from bottom to top [N/m]; foam has about 1500."""
    damping: float = Field(ge=0)
    """[N·s/m]."""

    def on(self, other: "SoftConfig") -> "SoftConfig":
        """Give what both are, one on the other."""
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
        """Give the box, its middle at the origin."""
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
        """Give the cylinder, its middle at the origin."""
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
        """Give the prism, its middle at the origin."""
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
        """Give bar and leg, the middle of their mass at the origin."""
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
