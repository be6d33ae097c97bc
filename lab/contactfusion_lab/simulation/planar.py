"""Pushing in the plane: a quick stand-in for PyBullet, for tuning and for tests.

The object slides on its corners or its rim, each loaded by its share of the weight; the skin feels
it as the generator `tactile` and the integrator would tell, without noise. Single pushes differ
from PyBullet's; rates over many pushes rank controllers alike (docs/tuning.md).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from contactfusion.contacts import Contact
from contactfusion.controllers.face import beside, on_face
from contactfusion.controllers.pushing import ARRIVED, PushingController
from contactfusion.errors import ConfigurationError
from contactfusion_lab.simulation.planar_body import Body, first_met, planar_body
from contactfusion_lab.simulation.planar_kernels import BASE, MOST, STATE, THING, advance
from contactfusion_lab.simulation.planar_skin import felt
from contactfusion_lab.simulation.push import UNION, touching
from contactfusion_lab.simulation.push_config import RATE, PushConfig
from contactfusion_lab.simulation.push_world import Touches
from contactfusion_lab.simulation.pushing import Ending

FRONT, REAR, HALF_WIDTH = 0.30, -0.42, 0.30
"""The base of `mobile_base.urdf`, in the robot's frame [m]."""
ITERATIONS = 4
"""Of the solver, each step."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a push.

    Attributes:
        ending: why it ended.
        success_true: arrival was declared, with the true contact near enough at that moment.
        time: it took [s].
        distance: from the true contact to the target at the end [m], NaN without contact.
        lost: without contact, all in all [s].
    """

    ending: Ending
    success_true: bool
    time: float
    distance: float
    lost: float


class PlanarPush:
    """One push in the plane, without any chance; twists in, contacts out, as `PushScene`.

    Args:
        config: the push.

    Raises:
        ConfigurationError: the object is a URDF, or starts out of sight.
    """

    def __init__(self, config: PushConfig) -> None:
        self.config = config
        self._body: Body = planar_body(config.object, config.friction)
        self._steps = round(config.period * RATE)
        self._state = np.zeros(STATE)
        self._floor = np.zeros((len(self._body.supports), 2))
        self._touched = np.zeros((self._steps * MOST, 6))
        self._rows = 0
        self._box = np.array(
            [[REAR, -HALF_WIDTH], [FRONT, -HALF_WIDTH], [FRONT, HALF_WIDTH], [REAR, HALF_WIDTH]]
        )
        self._state[BASE] = -FRONT
        self._place_object()

    @property
    def base_pose(self) -> tuple[float, float, float]:
        """Where the base is: x, y [m] and yaw [rad] in `odom`."""
        x, y, yaw = self._state[BASE : BASE + 3].tolist()
        return x, y, yaw

    @property
    def object_pose(self) -> tuple[float, float, float]:
        """Where the object is: x, y [m] and yaw [rad] in `odom`."""
        x, y, yaw = self._state[THING : THING + 3].tolist()
        back_x, back_y = self._body.centre.tolist()
        cos, sin = math.cos(yaw), math.sin(yaw)
        return x - cos * back_x + sin * back_y, y - sin * back_x - cos * back_y, yaw

    def drive(self, ahead: float, aside: float, turn: float) -> None:
        """Let one cycle pass while the base moves ahead, to the left [m/s] and turns [rad/s]."""
        heading = float(self._state[BASE + 2]) + turn * self.config.period / 2.0
        cos, sin = math.cos(heading), math.sin(heading)
        body = self._body
        self._rows = advance(
            self._state,
            self._floor,
            (cos * ahead - sin * aside, sin * ahead + cos * aside, turn),
            self._box,
            body.outlines,
            body.sizes,
            body.circles,
            body.supports,
            body.numbers,
            self._steps,
            ITERATIONS,
            self._touched,
        )

    def contacts(self) -> list[Contact]:
        """Tell what the skin felt in the last cycle, as the integrator would."""
        if not self._rows:
            return []
        touched, activation = self._touched[: self._rows], self.config.skin.activation
        return felt(touched, self._steps, activation, FRONT, HALF_WIDTH)

    @property
    def touches(self) -> Touches:
        """What pressed the robot in the last cycle, at the height of the robot's frame."""
        rows = self._touched[: self._rows]
        level = np.zeros((len(rows), 1))
        points, normals = np.hstack([rows[:, 1:3], level]), np.hstack([rows[:, 3:5], level])
        return Touches(rows[:, 0].copy(), points, normals, rows[:, 5].copy())

    def truth(self) -> tuple[str, float]:
        """Tell how the object truly touches, and how far that contact is from the target [m].

        Returns:
            "none", "point" or "line"; and the distance, NaN without contact.
        """
        if not self._rows:
            return "none", math.nan
        kind, contact = touching(self.touches, self._steps)
        x, y, yaw = self.base_pose
        cos, sin = math.cos(yaw), math.sin(yaw)
        there_x = x + cos * contact[0] - sin * contact[1]
        there_y = y + sin * contact[0] + cos * contact[1]
        target_x, target_y = self.config.target
        return kind, math.hypot(target_x - there_x, target_y - there_y)

    def _touched_lately(self) -> bool:
        last = self._touched[self._rows - 1, 0] if self._rows else -1.0
        return bool(last >= self._steps - UNION * RATE)

    def _place_object(self) -> None:
        """Stand the object before the front, as far away as the gap says."""
        config, body = self.config, self._body
        yaw = math.radians(config.yaw)
        cos, sin = math.cos(yaw), math.sin(yaw)
        turn = np.array([[cos, -sin], [sin, cos]])
        middle = turn @ body.centre + [0.0, config.offset]
        first = first_met(body, yaw, float(middle[1]), HALF_WIDTH)
        if first == math.inf:
            raise ConfigurationError(
                f"the object starts out of sight: the robot's front, {2 * HALF_WIDTH:g} m wide, "
                "would pass it",
                "offset",
            )
        self._state[THING : THING + 3] = (config.gap - first, middle[1], yaw)


def planar_trial(config: PushConfig, controller: PushingController[Any]) -> Outcome:
    """Push in the plane until it ends, as `pushed` would; the controller is reset first.

    Args:
        config: the push.
        controller: decides from what the skin feels and where the robot is.

    Raises:
        ConfigurationError: the object cannot be pushed in the plane.
    """
    push, cycles, lost = PlanarPush(config), 0, 0.0
    face = controller.options.face
    controller.reset()
    while True:
        now = cycles * config.period
        contacts = push.contacts()
        touch, side = on_face(contacts, face), beside(contacts, face)
        decision = controller.decide(touch, push.base_pose, now, side)
        lost += config.period * (not push._touched_lately())
        if decision.mode == ARRIVED:
            ending = Ending.ARRIVED
        elif math.hypot(*push.object_pose[:2]) > config.furthest:
            ending = Ending.AWAY
        elif lost > config.longest_lost:
            ending = Ending.LOST
        elif now >= config.longest:
            ending = Ending.TIMEOUT
        else:
            push.drive(decision.ahead, decision.aside, decision.turn)
            cycles += 1
            continue
        distance = push.truth()[1]
        arrived = ending == Ending.ARRIVED and distance <= config.within
        return Outcome(ending, arrived, now, distance, lost)
