"""How to get behind an object again: back off, circle around it, go ahead to the target."""

from contactfusion.controllers.face import FaceConfig
from contactfusion.controllers.pushing_law import heading_error, limited, place_of
from contactfusion.controllers.pushing_parameters import EscapeParameters
from contactfusion.frames import planar_turned_back

GAIN = 2.0
"""Errors fall by this part a second [1/s]."""
BEHIND, CENTRED = 0.05, 0.03
"""Behind the object is where heading [rad] and place [m] are so near to what they shall be."""
SHARE = 0.7
"""So much of the speed goes into circling; the rest keeps the object before the face."""
MORE = 0.15
"""Circle so much further away when something is touched on the way [m]."""
GRACE = 0.3
"""The object may be so much further away than it is believed to be [m]."""


class GoAround:
    """Circles around where the object is believed to be, until it lies before the target.

    Args:
        parameters: speed and distances.
        face: the face that pushes.
        target: x and y in the world [m].
        pose: of the robot, x, y [m] and yaw [rad] in the world.
        lateral: l, where the object touches the face [m].
    """

    def __init__(
        self,
        parameters: EscapeParameters,
        face: FaceConfig,
        target: tuple[float, float],
        pose: tuple[float, float, float],
        lateral: float,
    ) -> None:
        self._parameters, self._face, self._target = parameters, face, target
        self._middle = place_of((face.ahead + parameters.reach, lateral), pose)
        self._clearance, self._phase = parameters.clearance, "back"

    def velocity(
        self, pose: tuple[float, float, float], touched: bool
    ) -> tuple[float, float, float, str] | None:
        """Give the next velocity, and what it is for.

        Args:
            pose: of the robot, x, y [m] and yaw [rad] in the world.
            touched: whether anything touches the robot.

        Returns:
            Ahead, to the left [m/s], of turning [rad/s], and a word on why; None when it is done:
            the face touches the object from behind, or has not met it where it was believed to be.
        """
        p, (x, y, yaw) = self._parameters, pose
        way = self._middle[0] - x, self._middle[1] - y
        ahead, aside = planar_turned_back(way, yaw)
        if touched and self._phase == "around":  # the object is larger, or reaches back
            self._clearance += MORE
            self._phase = "back"
        radius = self._face.ahead + self._clearance + p.reach
        error = heading_error(
            (self._target[0] - self._middle[0], self._target[1] - self._middle[1]), yaw
        )
        if self._phase == "back" and ahead >= radius - BEHIND:
            self._phase = "around"
        if self._phase == "around" and abs(error) < BEHIND and abs(aside) < CENTRED:
            self._phase = "ahead"
        match self._phase:
            case "back":
                return -p.speed, 0.0, 0.0, "back off"
            case "around":
                turn = limited(GAIN * error, SHARE * p.speed / radius)
                return (
                    limited(GAIN * (ahead - radius), p.speed),
                    limited(GAIN * aside - turn * ahead, p.speed),
                    turn,
                    "go around",
                )
            case _ if ahead > self._face.ahead - GRACE and not touched:
                return p.speed, 0.0, 0.0, "go ahead"
            case _:
                return None
