"""What an object to push is in the plane: its outline, where it stands, and its inertia."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion_lab.simulation.push_config import RATE, FrictionConfig
from contactfusion_lab.simulation.push_objects import ObjectConfig, UrdfObjectConfig
from contactfusion_lab.simulation.push_parts import Part

CHASSIS = (0.05, 0.40)
"""The base of `mobile_base.urdf` pushes between these heights above the floor [m]."""
RIM = 8
"""A cylinder stands on so many points of a circle."""
RIM_SHARE = 0.5
"""Of the radius; on the whole rim a cylinder would turn less than PyBullet's, which rocks."""
GRAVITY = 9.81
"""[m/s²]."""


@dataclass(frozen=True, eq=False)
class Body:
    """An object in the plane, about its centre of mass.

    Attributes:
        centre: shape (2,), the centre of mass in the object's frame [m].
        outlines: shape (m, 2), corners of all polygons that the chassis can touch [m].
        sizes: shape (p,), how many corners each of them has.
        circles: shape (k, 3), middle and radius of each circle that it can touch [m].
        supports: shape (n, 3), where it stands [m], and the greatest force of friction there [N].
        numbers: mass [kg], inertia [kg·m²], friction with the robot, duration of a step [s].
    """

    centre: FloatArray
    outlines: FloatArray
    sizes: NDArray[np.int64]
    circles: FloatArray
    supports: FloatArray
    numbers: FloatArray


def planar_body(thing: ObjectConfig, friction: FrictionConfig) -> Body:
    """Bring an object to the plane.

    Args:
        thing: the object.
        friction: with floor and robot.

    Raises:
        ConfigurationError: it is a URDF, or the chassis would pass above or below it.
    """
    if isinstance(thing, UrdfObjectConfig):
        raise ConfigurationError("the planar model knows no URDF: give its shape", "object")
    parts = thing.parts()
    masses = np.array([part.mass for part in parts])
    middles = np.array([part.middle for part in parts])
    centre = masses @ middles / masses.sum()
    inertia = sum(
        part.mass * (_gyration_squared(part) + float(np.sum((part.middle - centre) ** 2)))
        for part in parts
    )
    low, high = CHASSIS
    met = [part for part in parts if part.bottom < high and part.bottom + part.height > low]
    if not met:
        raise ConfigurationError("the base would not touch it", "object")
    polygons = [part.outline - centre for part in met if part.radius is None]
    circles = [(*(part.middle - centre), part.radius) for part in met if part.radius is not None]
    return Body(
        centre=centre,
        outlines=np.concatenate([*polygons, np.empty((0, 2))]),
        sizes=np.array([len(polygon) for polygon in polygons], np.int64),
        circles=np.array(circles, np.float64).reshape(-1, 3),
        supports=_supports(parts, centre, friction.ground * masses.sum() * GRAVITY),
        numbers=np.array([masses.sum(), inertia, friction.robot, 1.0 / RATE]),
    )


def first_met(body: Body, yaw: float, y: float, half_width: float) -> float:
    """Give where a front that comes along x meets an object first.

    Args:
        body: the object.
        yaw: how it is turned [rad].
        y: of its centre of mass, to the left of the front's middle [m].
        half_width: of the front [m].

    Returns:
        x from its centre of mass [m]; infinite if the front would pass it.
    """
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cos, -sin], [sin, cos]])
    met, begin = [np.inf], 0
    for middle_x, middle_y, radius in np.column_stack(
        [body.circles[:, :2] @ turn.T + [0.0, y], body.circles[:, 2]]
    ):
        beside = max(abs(middle_y) - half_width, 0.0)
        if beside < radius:
            met.append(middle_x - np.sqrt(radius**2 - beside**2))
    for size in body.sizes:
        corners = body.outlines[begin : begin + size] @ turn.T + [0.0, y]
        begin += size
        for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if max(one[1], other[1]) < -half_width or min(one[1], other[1]) > half_width:
                continue
            sides = np.clip([one[1], other[1]], -half_width, half_width)
            rise = other[1] - one[1]
            shares = (sides - one[1]) / rise if rise else np.array([0.0, 1.0])
            met.append(float((one[0] + shares * (other[0] - one[0])).min()))
    return float(min(met))


def _supports(parts: list[Part], centre: FloatArray, friction: float) -> FloatArray:
    """Give where the object stands, and how friction is shared: linear in the place."""
    standing = [part for part in parts if part.bottom == 0.0]
    places = np.concatenate([_feet(part) for part in standing]) - centre
    shares = np.concatenate(
        [np.full(len(feet), part.mass / len(feet)) for part in standing for feet in [_feet(part)]]
    )
    shares /= shares.sum()
    # share of i: shares_i (a + b x_i + c y_i), so that they sum to 1 and balance about the centre
    basis = np.column_stack([np.ones(len(places)), places])
    coefficients = np.linalg.pinv(basis.T @ (shares[:, None] * basis))[:, 0]
    held = (shares * (basis @ coefficients)).clip(0.0)
    return np.column_stack([places, friction * held / held.sum()])


def _feet(part: Part) -> FloatArray:
    if part.radius is None:
        return part.outline
    angles = 2.0 * np.pi * np.arange(RIM) / RIM
    return part.middle + RIM_SHARE * part.radius * np.stack(
        [np.cos(angles), np.sin(angles)], axis=1
    )


def _gyration_squared(part: Part) -> float:
    """Give a part's inertia about its own middle, over its mass [m²]."""
    if part.radius is not None:
        return part.radius**2 / 2.0
    x, y = (part.outline - part.middle).T
    ahead_x, ahead_y = np.roll(x, -1), np.roll(y, -1)
    cross = x * ahead_y - ahead_x * y
    square = x * x + x * ahead_x + ahead_x**2 + y * y + y * ahead_y + ahead_y**2
    return float((cross * square).sum() / (6.0 * cross.sum()))
