"""Pushing by the believed position of the object, of which only contacts are known."""

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

Point = tuple[float, float]
"""x and y in the odometry's frame [m]."""


@dataclass(frozen=True, slots=True)
class Sight:
    """Beliefs of a step; all angles in the odometry's frame [rad].

    Attributes:
        robot: the centre of the robot.
        object: the centre of the object.
        goal: the target of the object's centre.
        bearing: from the robot to the object.
        course: from the object to the goal.
        left: distance of the object from the goal [m].
        touched: whether the object touches the face now.
    """

    robot: Point
    object: Point
    goal: Point
    bearing: float
    course: float
    left: float
    touched: bool


@dataclass(frozen=True, slots=True)
class Motion:
    """A velocity, in the odometry's frame.

    Attributes:
        direction: [rad].
        speed: [m/s].
        mode: the state of the controller.
        reason: of the motion, in a few words.
    """

    direction: float
    speed: float
    mode: str
    reason: str


class ObjectPushingConfig(PushingConfig):
    """Options of all controllers that push by a believed position of the object."""

    reach: Reach = Field(default=0.25, ge=0)
    """Believed distance of the object's centre beyond the contact, straight forward of the face
    [m]."""
    arrival: Spread = Field(default=0.05, gt=0)
    """Distance of the contact from the target at which it has arrived [m]."""
    speed_gain: float = Field(default=0.3, gt=0)
    """Speed for each metre to the target [1/s], within the next two."""
    slowest: Speed = Field(default=0.05, gt=0)
    """The least speed [m/s]."""
    fastest: Speed = Field(default=0.15, gt=0)
    """The greatest speed [m/s]."""
    turn_gain: float = Field(default=1.0, ge=0)
    """Yaw rate ω for each radian between the face and the object [1/s]."""
    fastest_turn: float = Field(default=0.4, gt=0)
    """The greatest ω [rad/s]."""

    @model_validator(mode="after")
    def _speeds(self) -> Self:
        if self.slowest > self.fastest:
            raise ConfigurationError("may not be above `fastest`", "slowest")
        return self


ConfigT = TypeVar("ConfigT", bound=ObjectPushingConfig)


class ObjectPushing(PushingController[ConfigT]):
    """Pushes by the object's position, which is believed to lie beyond the contact.

    The published methods measure the object; here only contacts are known. Three beliefs stand in:

    - the centre of the object lies `reach` beyond the contact, straight forward of the face;
    - without contact it stays at its position in the world, but not where the robot's face has
      passed in the meantime: an object that is not felt is further forward;
    - the centre is to move as far as the contact, since it is the contact that shall arrive: the
      displacement from object to goal is d = p_T - (p_R + R p_C) (O Eq 1).

    Their robots are round, so a heading does not matter; this base feels only with its face. The
    base moves in any direction, so the face always yaws towards the object's centre. The object is
    believed straight forward of the contact, hence yawing brings the contact to the middle of the
    face; and while it circles the object the robot keeps facing it.

    Args:
        config: the options.
    """

    Config: ClassVar[type[PushingConfig]] = ObjectPushingConfig

    def reset(self) -> None:
        """Drop the object."""
        super().reset()
        self._contact: Point | None = None
        self._object: Point = (0.0, 0.0)
        self._arrived: Decision | None = None

    @abstractmethod
    def move(self, sight: Sight) -> Motion:
        """The motion by the believed object.

        Args:
            sight: the believed object, and its goal.
        """

    def decide(
        self, touch: FaceContact | None, pose: PlanarPose, now: float, side: float = 0.0
    ) -> Decision:
        """Move forward to the first contact, then as `move` decides; stop at arrival."""
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
        error = wrapped(sight.bearing - pose[2])
        yaw_rate = limited(options.turn_gain * error, options.fastest_turn)
        forward = motion.speed * math.cos(motion.direction - pose[2])
        lateral = motion.speed * math.sin(motion.direction - pose[2])
        reason = motion.reason if sight.touched else motion.reason + ", contact lost"
        return Decision(forward, lateral, yaw_rate, motion.mode, reason)

    def speed(self, left: float) -> float:
        """The speed for the remaining distance [m] [m/s]."""
        options = self.options
        return min(max(options.speed_gain * left, options.slowest), options.fastest)

    def _believe(self, touch: FaceContact | None, pose: PlanarPose) -> None:
        face, reach = self.options.face, self.options.reach
        if touch is not None:
            self._place(pose, touch.lateral)
        elif self._contact is not None:
            offset = self._object[0] - pose[0], self._object[1] - pose[1]
            forward, lateral = planar_turned_back(offset, pose[2])
            if forward < face.ahead + reach and abs(lateral) <= face.half_width:
                self._place(pose, lateral)

    def _place(self, pose: PlanarPose, lateral: float) -> None:
        """Believe the object at the face, at this lateral position [m]."""
        forward, reach = self.options.face.ahead, self.options.reach
        self._contact = place_of((forward, lateral), pose)
        self._object = place_of((forward + reach, lateral), pose)

    def _sight(self, contact: Point, pose: PlanarPose, touched: bool) -> Sight:
        robot, centre, target = (pose[0], pose[1]), self._object, self.options.target
        x, y = target[0] - contact[0], target[1] - contact[1]
        return Sight(
            robot=robot,
            object=centre,
            goal=(centre[0] + x, centre[1] + y),
            bearing=math.atan2(centre[1] - robot[1], centre[0] - robot[0]),
            course=math.atan2(y, x),
            left=math.hypot(x, y),
            touched=touched,
        )
