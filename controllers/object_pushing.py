"""What pushers share that go by where the object is, and know only where it was touched."""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self, TypeVar

from pydantic import Field, model_validator

from contactfusion.controllers.face import FaceContact
from contactfusion.controllers.pushing import (
    ARRIVED,
    Decision,
    PushingConfig,
    PushingController,
)
from contactfusion.controllers.pushing_law import limited, place_of, wrapped
from contactfusion.errors import ConfigurationError
from contactfusion.frames import PlanarPose, planar_turned_back
from contactfusion.units import Reach, Speed, Spread

Place = tuple[float, float]
"""x and y in the odometry's frame [m]."""


@dataclass(frozen=True, slots=True)
class Sight:
    """What is believed; all angles in the odometry's frame [rad].

    Attributes:
        robot: the middle of the robot.
        thing: the middle of the object.
        goal: where the middle of the object is to go.
        bearing: from the robot to the object.
        way: from the object to the goal.
        left: how far the object is from the goal [m].
        touched: whether the object touches the face now.
    """

    robot: Place
    thing: Place
    goal: Place
    bearing: float
    way: float
    left: float
    touched: bool


@dataclass(frozen=True, slots=True)
class Motion:
    """Where to move, in the odometry's frame.

    Attributes:
        direction: [rad].
        speed: [m/s].
        mode: the state of the controller.
        reason: why, in a few words.
    """

    direction: float
    speed: float
    mode: str
    reason: str


class ObjectPushingConfig(PushingConfig):
    """What every controller can be told that goes by a believed place of the object."""

    reach: Reach = Field(default=0.25, ge=0)
    """The middle of the object is believed so far beyond the contact, straight ahead of the face
    [m]."""
    arrival: Spread = Field(default=0.05, gt=0)
    """The contact has arrived when it is so near to the target [m]."""
    speed_gain: float = Field(default=0.3, gt=0)
    """The speed is this times the distance to the target [1/s], within the next two."""
    slowest: Speed = Field(default=0.05, gt=0)
    """The least speed [m/s]."""
    fastest: Speed = Field(default=0.15, gt=0)
    """The greatest speed [m/s]."""
    turn_gain: float = Field(default=1.0, ge=0)
    """How fast the face turns to the object: ω is this times the angle between [1/s]."""
    fastest_turn: float = Field(default=0.4, gt=0)
    """The greatest ω [rad/s]."""

    @model_validator(mode="after")
    def _speeds(self) -> Self:
        if self.slowest > self.fastest:
            raise ConfigurationError("may not be above `fastest`", "slowest")
        return self


ConfigT = TypeVar("ConfigT", bound=ObjectPushingConfig)


class ObjectPushing(PushingController[ConfigT]):
    """Pushes by the place of the object, which it believes to lie beyond the contact.

    The methods of this kind see the object; here only contacts are known. Three beliefs stand in:

    - the middle of the object lies `reach` beyond the contact, straight ahead of the face;
    - without contact it stays where it was in the world, but not where the robot's face has passed
      in the meantime: what is not felt is further ahead;
    - the middle is to go as far as the contact has to go, since it is the contact that shall
      arrive: the way from object to goal is d = p_T - (p_R + R p_C) (O Eq 1).

    Their robots are round, so a heading does not matter; this base feels only with its face. The
    base moves in any direction, so the face always turns to the object's middle. Where the contact
    is, the object is believed straight ahead of it, hence turning brings the contact to the middle
    of the face; and while it goes round the object the robot does not lose sight of it.

    Args:
        config: the options.
    """

    Config: ClassVar[type[PushingConfig]] = ObjectPushingConfig

    def reset(self) -> None:
        """Forget the object."""
        self._contact: Place | None = None
        self._thing: Place = (0.0, 0.0)
        self._arrived: Decision | None = None

    @abstractmethod
    def move(self, sight: Sight) -> Motion:
        """Decide where to move.

        Args:
            sight: the believed object, and its goal.
        """

    def decide(
        self, touch: FaceContact | None, pose: PlanarPose, now: float, side: float = 0.0
    ) -> Decision:
        """Go straight ahead to the first contact, then where `move` says; stop at arrival."""
        options = self.options
        if self._arrived is not None:
            return self._arrived
        self._believe(touch, pose)
        if self._contact is None:
            return Decision(options.fastest, 0.0, 0.0, "approach", "no contact yet")
        sight = self._sight(self._contact, pose, touch is not None)
        if sight.touched and sight.left <= options.arrival:
            reason = f"contact {sight.left:.3f} m from the target"
            self._arrived = Decision(0.0, 0.0, 0.0, ARRIVED, reason)
            return self._arrived
        motion = self.move(sight)
        turn = limited(options.turn_gain * wrapped(sight.bearing - pose[2]), options.fastest_turn)
        ahead = motion.speed * math.cos(motion.direction - pose[2])
        aside = motion.speed * math.sin(motion.direction - pose[2])
        reason = motion.reason if sight.touched else motion.reason + ", contact lost"
        return Decision(ahead, aside, turn, motion.mode, reason)

    def speed(self, left: float) -> float:
        """Give the speed for the distance that is left [m] [m/s]."""
        options = self.options
        return min(max(options.speed_gain * left, options.slowest), options.fastest)

    def _believe(self, touch: FaceContact | None, pose: PlanarPose) -> None:
        face, reach = self.options.face, self.options.reach
        if touch is not None:
            self._place(pose, touch.lateral)
        elif self._contact is not None:
            way = self._thing[0] - pose[0], self._thing[1] - pose[1]
            ahead, aside = planar_turned_back(way, pose[2])
            if ahead < face.ahead + reach and abs(aside) <= face.half_width:
                self._place(pose, aside)

    def _place(self, pose: PlanarPose, lateral: float) -> None:
        """Believe that the object is at the face, so far to the left [m]."""
        ahead, reach = self.options.face.ahead, self.options.reach
        self._contact = place_of((ahead, lateral), pose)
        self._thing = place_of((ahead + reach, lateral), pose)

    def _sight(self, contact: Place, pose: PlanarPose, touched: bool) -> Sight:
        robot, thing, target = (pose[0], pose[1]), self._thing, self.options.target
        x, y = target[0] - contact[0], target[1] - contact[1]
        return Sight(
            robot=robot,
            thing=thing,
            goal=(thing[0] + x, thing[1] + y),
            bearing=math.atan2(thing[1] - robot[1], thing[0] - robot[0]),
            way=math.atan2(y, x),
            left=math.hypot(x, y),
            touched=touched,
        )
