"""A baseline: pushing along a dipole field around the object."""

import math
from collections.abc import Mapping

from pydantic import Field

from contactfusion.controllers.object_pushing import (
    Motion,
    ObjectPushing,
    ObjectPushingConfig,
    Sight,
)
from contactfusion.controllers.pushing_law import wrapped
from contactfusion.hooks import hookimpl


class DipoleFieldConfig(ObjectPushingConfig):
    """The options of `dipole_field`."""

    caution: float = Field(default=10.0, ge=1)
    """The greatest ratio, near the goal, of the field across the course to that along it; 1: the
    plain dipole everywhere."""


class DipoleField(ObjectPushing[DipoleFieldConfig]):
    """Follows the field lines of a dipole at the object that points to the goal.

    Igarashi, Kamiyama, Inami, "A dipole field for object delivery by pushing on a flat surface"
    (ICRA 2010). Let θ be the angle at the object between the direction to the goal and that to the
    robot. In the frame at the object whose first axis points to the goal, the robot moves along
    (cos 2θ, sin 2θ): with the object to the goal when it is behind it (θ = π), backwards beside it
    (θ = ±π/2), and round it in between. θ to the robot or from the robot, which differ by π, give
    the same.

    Two parts are of the program that this group published (Phybots, class PushField), in words of
    our own: near the goal (cos² θ - a sin² θ, (1 + a) sin θ cos θ) replaces the plain dipole, its
    case a = 1, with a = |θ / angle at the robot between object and goal|, at most `caution`: it
    corrects more before it pushes on. And where the field leads away from the object, only the part
    across is kept: the robot circles it, and does not move off.

    The belief of the object's position, and the choice of the heading, are those of
    `ObjectPushing`. The paper measures both positions from above.
    """

    Config = DipoleFieldConfig

    def move(self, sight: Sight) -> Motion:
        """The motion along the field."""
        to_robot = wrapped(sight.bearing + math.pi - sight.course)
        to_goal = math.atan2(sight.goal[1] - sight.robot[1], sight.goal[0] - sight.robot[0])
        at_robot = abs(wrapped(to_goal - sight.bearing))
        # a is the ratio of two angles that vanish or open together; where one is 0, it is 1
        ratio = abs(to_robot) / at_robot if at_robot > 0.0 and to_robot != 0.0 else 1.0
        direction, pushing = dipole(to_robot, min(ratio, self.options.caution))
        mode = "push" if pushing else "orbit"
        reason = f"{sight.left:.2f} m to go, {math.degrees(to_robot):+.0f}° from the way"
        return Motion(sight.course + direction, self.speed(sight.left), mode, reason)


def dipole(theta: float, a: float = 1.0) -> tuple[float, bool]:
    """The direction of (cos² θ - a sin² θ, (1 + a) sin θ cos θ), never away from the object.

    Args:
        theta: θ, from the course of the object to the direction from the object to the robot [rad].
        a: the strength across; 1: the dipole.

    Returns:
        The angle from the course of the object [rad], and whether this leads towards the object.
    """
    cos, sin = math.cos(theta), math.sin(theta)
    along, across = cos * cos - a * sin * sin, (1.0 + a) * sin * cos
    away = along * cos + across * sin
    if away <= 0.0:
        return math.atan2(across, along), True
    along, across = along - away * cos, across - away * sin
    if math.hypot(along, across) < 1e-9:  # right in front of the object both sides are equal
        along, across = -sin, cos
    return math.atan2(across, along), False


@hookimpl
def contactfusion_controllers() -> Mapping[str, type[DipoleField]]:
    """Pushing along a dipole field."""
    return {"dipole_field": DipoleField}
