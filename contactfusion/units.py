"""Units of configuration, and the sentence for a number that is plausible in another unit only.

A field declares its unit by its type and its plausible limits by pydantic's own `ge` and `le`:

    voxel_size: Metres = Field(default=0.005, ge=1e-5, le=0.5)

Limits are an order of magnitude beyond any known robot, from a gripper with voxels of 0.1 mm to a
crane of 100 m: they exist to find millimetres, degrees and milliseconds.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any, get_args

from pydantic import Field
from pydantic.fields import FieldInfo


@dataclass(frozen=True)
class Unit:
    """The unit of a number, and the one for which it is mistaken.

    Attributes:
        symbol: after the number.
        rule: the clause that states the unit.
        factor: converts a number in the mistaken unit to this one.
        hint: the question or statement; `given` is the number, `meant` the same in this unit.
    """

    symbol: str
    rule: str
    factor: float = 0.001
    hint: str = "did you mean {meant:.5g}?"

    def implausible(self, given: float, limit: float) -> str:
        """The sentence on a number beyond a limit; with the hint only where it leads within it."""
        meant = given * self.factor
        beyond = f"{given:g} {self.symbol} is implausible, the limit is {limit:g} {self.symbol}"
        helps = meant <= limit if given > limit else meant >= limit
        hint = f": {self.hint.format(given=given, meant=meant)}" if helps else ""
        return f"{beyond}; {self.rule}{hint}"


@dataclass(frozen=True)
class LengthScale:
    """Marks the length scale of a generator's likelihood; `tune fusion` varies it."""


LENGTH = Unit("m", "lengths are in metres")
Metres = Annotated[float, LENGTH]
Seconds = Annotated[float, Unit("s", "times are in seconds")]
MetresPerSecond = Annotated[float, Unit("m/s", "speeds are in metres per second")]
MetresPerSecondSquared = Annotated[float, Unit("m/s²", "accelerations are in metres per second²")]
Kilograms = Annotated[float, Unit("kg", "masses are in kilograms")]
Newtons = Annotated[float, Unit("N", "forces are in newtons")]
NewtonMetres = Annotated[float, Unit("N·m", "torques are in newton metres")]
Radians = Annotated[
    float,
    Unit(
        "rad",
        "angles are in radians",
        math.pi / 180.0,
        "{given:g} degrees are {meant:.5g}",
    ),
]
Degrees = Annotated[
    float,
    Unit(
        "degrees",
        "this angle is in degrees",
        180.0 / math.pi,
        "{given:g} radians are {meant:.5g}",
    ),
]

Coordinate = Annotated[Metres, Field(ge=-1000, le=1000)]
"""Of a frame or a shape: the largest cranes reach 100 m, a work cell is within a kilometre."""
Position = tuple[Coordinate, Coordinate, Coordinate]
Edge = Annotated[Metres, Field(le=1000)]
"""Of a body: as far as its coordinates may reach."""
Nearby = Annotated[Metres, Field(ge=-10, le=10)]
"""Within a sensor, a hand or a load: a skin around a bus is 10 m long."""
Offset = tuple[Nearby, Nearby, Nearby]
Reach = Annotated[Metres, Field(le=10)]
"""Of a range or a single motion: beyond 10 m no contact is imminent."""
Spread = Annotated[Metres, Field(le=1)]
"""Of a standard deviation or a tolerance: a contact that is known to a metre is not located."""
Spacing = Annotated[Metres, Field(le=1)]
"""Of voxels and samples: a contact of a vehicle is still located by a metre."""
Tolerance = Annotated[Metres, Field(le=5)]
"""Between the voxels of a contact: five of the widest."""
TaxelEdge = Annotated[Metres, Field(gt=0, le=1)]
"""The pads of bumpers and of sensing floors are tiles of up to a metre."""
Angle = Annotated[Radians, Field(ge=-6.3, le=6.3)]
"""A full turn in either direction, 2π, rounded up so that 6.2832 passes."""
Angles = tuple[Angle, Angle, Angle]
Memory = Annotated[Seconds, Field(le=300)]
"""Time that something counts or is waited for: within five minutes a robot has moved on."""
Period = Annotated[Seconds, Field(le=5)]
"""Of steps and samples: even a rover on Mars measures more often than every five seconds."""
Limit = Annotated[Seconds, Field(le=3600)]
"""Of a whole attempt: none takes more than an hour."""
Speed = Annotated[MetresPerSecond, Field(le=10)]
"""There is no contact on purpose at 36 km/h."""
Force = Annotated[Newtons, Field(le=10_000)]
"""Of a contact to be reported: a ton rests on it, as on the bucket of an excavator."""
ForceNoise = Annotated[Newtons, Field(le=1000)]
"""1 % of the range of the largest force-torque sensors, 100 kN."""
TorqueNoise = Annotated[NewtonMetres, Field(le=1000)]
"""1 % of the range of the largest, 100 kN·m."""
ForceBias = Annotated[Newtons, Field(ge=-100_000, le=100_000)]
TorqueBias = Annotated[NewtonMetres, Field(ge=-100_000, le=100_000)]
"""The whole range of the largest force-torque sensors."""
Load = Annotated[Kilograms, Field(le=10_000)]
"""Of a sensor's load: the strongest arms lift 2.3 t."""
Acceleration = Annotated[MetresPerSecondSquared, Field(ge=-30, le=30)]
"""Of gravity: on Jupiter 25 m/s²."""


def unit_of(field: FieldInfo) -> Unit | None:
    """The unit that a field declares, itself or in the elements that it holds; None: none."""
    return _unit_in((*field.metadata, field.annotation))


def _unit_in(parts: tuple[Any, ...]) -> Unit | None:
    for part in parts:
        found = part if isinstance(part, Unit) else _unit_in(get_args(part))
        if found:
            return found
    return None
