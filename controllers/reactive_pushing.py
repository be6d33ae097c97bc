"""Reactive pushing: the next velocity follows from the contact on the face (O §II-B).

Search and escape are ours; the set `paper` has neither.
"""

import math
from collections.abc import Mapping

from pydantic import Field

from contactfusion.controllers.face import FaceConfig, FaceContact
from contactfusion.controllers.pushing import (
    ARRIVED,
    Decision,
    PushingConfig,
    PushingController,
)
from contactfusion.controllers.pushing_law import (
    adaptive_rate,
    displacement,
    heading_error,
    limited,
    place_of,
    turn_rate,
    velocities,
)
from contactfusion.controllers.pushing_parameters import (
    EscapeParameters,
    NamedParameters,
    SearchParameters,
)
from contactfusion.frames import PlanarPose, planar_turned_back
from contactfusion.hooks import hookimpl

ALIGNED = 0.02
"""Lateral tolerance of a position that is tried [m]."""
SHIFTS = (0, 1, -1)
"""Lateral shifts of a round of tries: none, to the side of the loss, to the other side [shift]."""
GAIN = 2.0
"""Gain of heading and position [1/s]."""
BEHIND, CENTRED = 0.05, 0.03
"""Tolerances of heading [rad] and position [m] behind the object."""
SHARE = 0.7
"""The share of the speed for circling; the rest keeps the object in front of the face."""
MORE = 0.15
"""Clearance that is added on contact while searching or circling [m]."""
GRACE = 0.3
"""The greatest distance by which the object may be further away than believed [m]."""


class ReactivePushingConfig(PushingConfig):
    """The options of `reactive_pushing`."""

    parameters: NamedParameters = Field(default="tuned", validate_default=True)
    """The name of a set, `tuned` or `paper`; or fields that change one, named by `like`."""


class ReactivePushing(PushingController[ReactivePushingConfig]):
    """Keeps the object at the middle of the face while turning it to the target."""

    Config = ReactivePushingConfig

    def reset(self) -> None:
        """Drop the contact and all progress."""
        super().reset()
        self._arrived: Decision | None = None
        self._lateral = 0.0
        self._touched: float | None = None
        self._place = (math.nan, math.nan)
        self._search: Search | None = None
        self._realigning = False
        self._nearest, self._progressed = math.inf, math.nan
        self._escape: GoAround | None = None

    def decide(
        self, touch: FaceContact | None, pose: PlanarPose, now: float, side: float = 0.0
    ) -> Decision:
        """Push on; or search for the contact, escape from a cycle, or stop at arrival."""
        if self._arrived is not None:
            return self._arrived
        lost_for = self._follow(touch, pose, now)
        if lost_for is None:
            return self._approach()
        remaining = self._remaining(self._lateral if touch is None else touch.lateral, pose)
        distance = math.hypot(*remaining)
        if touch is not None and distance <= self.options.parameters.arrival:
            reason = f"contact {distance:.3f} m from the target"
            self._arrived = Decision(0.0, 0.0, 0.0, ARRIVED, reason)
            return self._arrived
        if decision := self._escaped(touch, pose, now, distance, side):
            return decision
        search = self.options.parameters.search
        if search is not None and lost_for > search.patience:
            return self._searched(search, pose, lost_for, side)
        return self._push(pose, lost_for)

    def _follow(self, touch: FaceContact | None, pose: PlanarPose, now: float) -> float | None:
        """The time since the last contact [s], updated by the contact; None: none so far."""
        if touch is None:
            return None if self._touched is None else now - self._touched
        smoothing = self.options.parameters.smoothing
        if self._touched is None or smoothing == 0.0:
            self._lateral = touch.lateral
        else:
            weight = 1.0 - math.exp(-(now - self._touched) / smoothing)
            self._lateral += weight * (touch.lateral - self._lateral)
        self._touched, self._search = now, None
        self._place = place_of((self.options.face.ahead, touch.lateral), pose)
        return 0.0

    def _remaining(self, lateral: float, pose: PlanarPose) -> tuple[float, float]:
        return displacement(self.options.target, pose, (self.options.face.ahead, lateral))

    def _speed(self, distance: float) -> float:
        p = self.options.parameters
        return min(max(p.speed_gain * distance, p.slowest), p.fastest)

    def _approach(self) -> Decision:
        p = self.options.parameters
        speed = p.search.speed if p.search else p.fastest
        return Decision(speed, 0.0, 0.0, "approach", "no contact yet")

    def _push(self, pose: PlanarPose, lost_for: float) -> Decision:
        """Pushing by O Eq 1-4, or realignment where the contact is near an edge."""
        p, lateral = self.options.parameters, self._lateral
        remaining = self._remaining(lateral, pose)
        distance = math.hypot(*remaining)
        speed, error = self._speed(distance), heading_error(remaining, pose[2])
        realign = p.realign
        if realign is not None:
            edge = realign.leave if self._realigning else realign.enter
            self._realigning = abs(lateral) > edge
        if realign is not None and self._realigning:
            rate = math.copysign(realign.rate, lateral)
            fading = max(0.0, 1.0 - abs(lateral) / realign.enter)
            share = fading if realign.turning is None else realign.turning
            omega = share * turn_rate(speed, error, p.heading_gain, p.length)
            v_x, v_y = velocities(speed, rate)
            mode, reason = "realign", f"contact {lateral:+.3f} m aside"
        else:
            far = distance > p.near
            rate = adaptive_rate(lateral, p.eta, p.zeta, p.beta, p.k) if far else 0.0
            v_x, v_y = velocities(speed, rate)
            omega = turn_rate(v_x, error, p.heading_gain, p.length)
            mode, reason = "push", f"{distance:.2f} m to go, contact {lateral:+.3f} m aside"
        if lost_for > 0.0:
            reason += f", lost {lost_for:.1f} s ago"
        omega = limited(omega, p.fastest_turn * min(1.0, distance / p.settle if p.settle else 1.0))
        return Decision(v_x, v_y, omega, mode, reason)

    def _searched(
        self, parameters: SearchParameters, pose: PlanarPose, lost_for: float, side: float
    ) -> Decision:
        """The next velocity of the search around the last contact."""
        if self._search is None:
            last = math.copysign(1.0, self._lateral)
            self._search = Search(parameters, self.options.face, self._place, last)
        v_x, v_y, doing = self._search.velocity(pose, side)
        return Decision(v_x, v_y, 0.0, "search", f"no contact for {lost_for:.1f} s, {doing}")

    def _escaped(
        self,
        touch: FaceContact | None,
        pose: PlanarPose,
        now: float,
        distance: float,
        side: float,
    ) -> Decision | None:
        """Circle the object once pushing has made no progress for a while; None: push on."""
        escape = self.options.parameters.escape
        if escape is None:
            return None
        nearer = touch is not None and distance < self._nearest - escape.progress
        if nearer or math.isnan(self._progressed):
            self._nearest, self._progressed = distance, now
        passed = self._nearest < escape.within and distance > self._nearest + escape.overshoot
        stuck = now - self._progressed > escape.patience
        if self._escape is None and touch and (passed or stuck):
            self._escape = GoAround(
                escape, self.options.face, self.options.target, pose, touch.lateral
            )
        if self._escape is None:
            return None
        velocity = self._escape.velocity(pose, touch is not None or side != 0.0)
        if velocity is None:
            self._escape, self._nearest, self._progressed = None, distance, now
            return None
        v_x, v_y, omega, doing = velocity
        return Decision(v_x, v_y, omega, "escape", f"no progress, {doing}")


class Search:
    """Tries positions one after the other: that of the last contact, then beside it.

    Args:
        parameters: speed and distances.
        face: that has to touch the object.
        place: position of the last contact, x and y in the world [m].
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
        """The next velocity, forward and lateral [m/s], and its purpose.

        Args:
            pose: of the robot, x, y [m] and yaw [rad] in the world; it does not rotate meanwhile.
            beside: 1.0 if something touches the robot's left side, -1.0 if its right, else 0.0.
        """
        p = self._parameters
        x, y, yaw = pose
        offset = self._place[0] - x, self._place[1] - y
        forward, lateral = planar_turned_back(offset, yaw)
        forward, lateral = forward - self._face.ahead, lateral + self._shift()
        if beside and self._phase != "back":  # the object is beside the robot, or extends there
            self._place = place_of((self._face.ahead, beside * self._face.half_width), pose)
            self._clearance += MORE * (self._phase == "aside")
            self._tries, self._phase = 0, "back"
        if self._phase == "back" and forward >= self._clearance and not beside:
            self._phase = "aside"
        if self._phase == "aside" and abs(lateral) <= ALIGNED:
            self._phase = "ahead"
        if self._phase == "ahead" and forward <= -p.beyond * (1 + self._tries // len(SHIFTS)):
            self._tries, self._phase = self._tries + 1, "back"
        match self._phase:
            case "back":
                return -p.speed, 0.0, f"back, try {self._tries + 1}"
            case "aside":
                slowed = min(p.speed, max(abs(lateral) * 5.0, 0.02))
                return 0.0, math.copysign(slowed, lateral), f"aside, try {self._tries + 1}"
            case _:
                return p.speed, 0.0, f"ahead, try {self._tries + 1}"

    def _shift(self) -> float:
        """The lateral shift of this try from the position, to the left [m]."""
        return self._side * self._parameters.shift * SHIFTS[self._tries % len(SHIFTS)]


class GoAround:
    """Circles the believed position of the object, until it lies between robot and target.

    Args:
        parameters: speed and distances.
        face: the face that pushes.
        target: x and y in the world [m].
        pose: of the robot, x, y [m] and yaw [rad] in the world.
        lateral: l, of the contact on the face [m].
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
        """The next velocity, and its purpose.

        Args:
            pose: of the robot, x, y [m] and yaw [rad] in the world.
            touched: whether anything touches the robot.

        Returns:
            Forward and lateral velocity [m/s], yaw rate [rad/s], and purpose; None at the end: the
            face touches the object from behind, or has not met it at its believed position.
        """
        p, (x, y, yaw) = self._parameters, pose
        offset = self._middle[0] - x, self._middle[1] - y
        forward, lateral = planar_turned_back(offset, yaw)
        if touched and self._phase == "around":  # the object is larger, or extends back
            self._clearance += MORE
            self._phase = "back"
        radius = self._face.ahead + self._clearance + p.reach
        error = heading_error(
            (self._target[0] - self._middle[0], self._target[1] - self._middle[1]), yaw
        )
        if self._phase == "back" and forward >= radius - BEHIND:
            self._phase = "around"
        if self._phase == "around" and abs(error) < BEHIND and abs(lateral) < CENTRED:
            self._phase = "ahead"
        match self._phase:
            case "back":
                return -p.speed, 0.0, 0.0, "back off"
            case "around":
                omega = limited(GAIN * error, SHARE * p.speed / radius)
                return (
                    limited(GAIN * (forward - radius), p.speed),
                    limited(GAIN * lateral - omega * forward, p.speed),
                    omega,
                    "go around",
                )
            case _ if forward > self._face.ahead - GRACE and not touched:
                return p.speed, 0.0, 0.0, "go ahead"
            case _:
                return None


@hookimpl
def contactfusion_controllers() -> Mapping[str, type[ReactivePushing]]:
    """Reactive pushing."""
    return {"reactive_pushing": ReactivePushing}
