"""How to find a contact again that was lost: back off, stand before its place, go ahead."""

import math

from contactfusion.controllers.face import FaceConfig
from contactfusion.controllers.pushing_law import place_of
from contactfusion.controllers.pushing_parameters import SearchParameters
from contactfusion.frames import planar_turned_back

ALIGNED = 0.02
"""So near is near enough [m]."""
SHIFTS = (0, 1, -1)
"""Each round of tries goes straight, to the side of the loss, to the other side [shift]."""
MORE = 0.15
"""Back off so much further when something touches a side [m]."""


class Search:
    """Tries places one after the other: that of the last contact, then to its sides.

    Args:
        parameters: speed and distances.
        face: the face that shall find the contact.
        place: where the contact was last, x and y in the world [m].
        side: 1.0 if it was to the left of the robot's middle, -1.0 if to the right.
    """

    def __init__(
        self,
        parameters: SearchParameters,
        face: FaceConfig,
        place: tuple[float, float],
        side: float,
    ) -> None:
        self._parameters, self._face = parameters, face
        self._place, self._side = place, side
        self._tries, self._phase = 0, "back"
        self._clearance = parameters.clearance

    def velocity(self, pose: tuple[float, float, float], beside: float) -> tuple[float, float, str]:
        """Give the next velocity: ahead, to the left [m/s], and what it is for.

        Args:
            pose: of the robot, x, y [m] and yaw [rad] in the world; it does not turn meanwhile.
            beside: 1.0 if something touches the robot's left side, -1.0 if its right, else 0.0.
        """
        p = self._parameters
        x, y, yaw = pose
        way = self._place[0] - x, self._place[1] - y
        ahead, aside = planar_turned_back(way, yaw)
        ahead, aside = ahead - self._face.ahead, aside + self._shift()
        if beside and self._phase != "back":  # the object stands beside the robot, or reaches there
            self._place = place_of((self._face.ahead, beside * self._face.half_width), pose)
            self._clearance += MORE * (self._phase == "aside")
            self._tries, self._phase = 0, "back"
        if self._phase == "back" and ahead >= self._clearance and not beside:
            self._phase = "aside"
        if self._phase == "aside" and abs(aside) <= ALIGNED:
            self._phase = "ahead"
        if self._phase == "ahead" and ahead <= -p.beyond * (1 + self._tries // len(SHIFTS)):
            self._tries, self._phase = self._tries + 1, "back"
        match self._phase:
            case "back":
                return -p.speed, 0.0, f"back, try {self._tries + 1}"
            case "aside":
                slowed = min(p.speed, max(abs(aside) * 5.0, 0.02))
                return 0.0, math.copysign(slowed, aside), f"aside, try {self._tries + 1}"
            case _:
                return p.speed, 0.0, f"ahead, try {self._tries + 1}"

    def _shift(self) -> float:
        """Give how far this try goes beside the place, to the left [m]."""
        return self._side * self._parameters.shift * SHIFTS[self._tries % len(SHIFTS)]
