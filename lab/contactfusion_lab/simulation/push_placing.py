"""Where the object of a push stands at first: before the robot's front."""

import math
from typing import Any

from contactfusion.errors import ConfigurationError
from contactfusion_lab.simulation.push_bodies import GRAVITY, Base, Client
from contactfusion_lab.simulation.push_config import PushConfig
from contactfusion_lab.simulation.push_thing import Thing, turned

FAR = 5.0
"""No object is so large [m]."""
ADVANCES, CLOSE, BESIDE = 1000, 1e-5, 0.01
"""An object is moved up to the front in so many steps at most, until it is so near, or so far past
the front [m]."""
HEAVIEST = 250.0
"""More the base cannot push, nor carry: its payload [kg]."""
SOFTEST = 0.05
"""What is soft gives way by so much at most, pressed as hard as it slides [m]."""


def require_movable(config: PushConfig, mass: float) -> None:
    """Make sure that an object can be pushed.

    Args:
        config: the push.
        mass: of the object [kg].

    Raises:
        ConfigurationError: it is too heavy or too soft, or has no mass.
    """
    if mass > HEAVIEST:
        raise ConfigurationError(
            f"{mass:g} kg are too heavy: the base moves {HEAVIEST:g} kg at most", "object"
        )
    if mass <= 0.0:
        raise ConfigurationError("it has no mass, so nothing moves it", "object")
    soft, slides = config.object.soft, config.friction.ground * mass * GRAVITY
    if soft is not None and slides > soft.stiffness * SOFTEST:
        raise ConfigurationError(
            f"{soft.stiffness:g} N/m are too soft: it slides at {slides:.3g} N, and may give way "
            f"by {SOFTEST:g} m",
            "object.soft",
        )


def stood(
    bullet: Any, client: Client, config: PushConfig, base: Base, thing: Thing
) -> tuple[float, float]:
    """Stand an object before the front of a base, as far away as the gap says.

    Args:
        bullet: the module pybullet.
        client: its physics.
        config: the push.
        base: at its start.
        thing: the object.

    Returns:
        Where front and object will first meet on a straight way, in `odom` [m].

    Raises:
        ConfigurationError: the front would pass the object.
    """
    ahead, gap, near = FAR, FAR, (FAR, 0.0)
    for _ in range(ADVANCES):
        _put(bullet, client, config, thing, ahead)
        found = bullet.getClosestPoints(base.body, thing.body, 4.0 * FAR, **client)
        point = min(found, key=lambda point: float(point[8]))
        gap, near = float(point[8]), point[6]
        if gap < CLOSE or near[0] < -BESIDE:
            break
        ahead -= gap  # nothing is nearer, so nothing can be hit on the way
    if gap >= CLOSE:
        raise ConfigurationError(
            f"the object starts out of sight: the robot's front, "
            f"{2 * base.half_width:g} m wide, would pass it",
            "offset",
        )
    x = ahead - gap + config.gap
    _put(bullet, client, config, thing, x)
    if thing.ball is not None:
        (*_, height), turn = bullet.getBasePositionAndOrientation(thing.ball, **client)
        place = (x, config.offset, height)
        bullet.resetBasePositionAndOrientation(thing.ball, place, turn, **client)
    return 0.0, float(near[1])


def _put(bullet: Any, client: Client, config: PushConfig, thing: Thing, x: float) -> None:
    yaw = math.radians(config.yaw)
    cos, sin = math.cos(yaw), math.sin(yaw)
    back_x, back_y, height = thing.back
    place = (x + cos * back_x - sin * back_y, config.offset + sin * back_x + (cos * back_y), height)
    turn = turned((0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)), thing.turn)
    bullet.resetBasePositionAndOrientation(thing.body, place, turn, **client)
