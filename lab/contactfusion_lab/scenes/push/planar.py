"""Pushing in the plane: a quick substitute for PyBullet, for tuning and for tests.

The object slides on its corners or its rim, each loaded by its share of the weight; contacts are as
the generator `tactile` and the integrator would report them, without noise. Single pushes differ
from PyBullet's; rates over many pushes rank controllers alike (docs/tuning.md).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.controllers.face import beside, on_face
from contactfusion.controllers.pushing import ARRIVED, PushingController
from contactfusion.errors import ConfigurationError
from contactfusion.frames import planar_point, planar_rotation, planar_turned
from contactfusion_lab.scenes.push.config import RATE, FrictionConfig, PushConfig
from contactfusion_lab.scenes.push.objects import ObjectConfig, Part, UrdfObjectConfig
from contactfusion_lab.scenes.push.planar_kernels import BASE, MOST, OBJECT, STATE, advance, feel
from contactfusion_lab.scenes.push.scene import UNION, Ending, mobile_base, touching
from contactfusion_lab.scenes.push.world import Touches

ITERATIONS = 4
"""Iterations of the solver, each step."""
CHASSIS = (0.05, 0.40)
"""Heights of the lower and upper edge of the base of `mobile_base.urdf` above the floor [m]."""
RIM = 8
"""Points of a circle on which a cylinder stands."""
RIM_SHARE = 0.5
"""Radius of that circle over the cylinder's; on the whole rim it would yaw less than PyBullet's,
which rocks."""
GRAVITY = 9.81
"""[m/s²]."""
STRIPS = np.array(
    [
        [1.0, 0.0, 0.0, 1.0, 0.0, 0.05, 12.0],
        [0.0, 1.0, 1.0, 0.0, -0.06, 0.05, 14.0],
        [0.0, -1.0, 1.0, 0.0, -0.06, 0.05, 14.0],
    ]
)
"""The skin of `mobile_base.yaml`, front, left and right, as `feel` takes it."""
UNKNOWN, SKIN = np.full(3, math.nan), {"skin": 1.0}
"""Of contacts: the force, and the shares of sources."""
THRESHOLD, P_MAX = 0.1, 0.95
"""Threshold of the integrator, and largest likelihood of the generator `tactile`."""
RUNS = 16
"""Contacts at most."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a push.

    Attributes:
        ending: why it ended.
        success_true: arrival was declared, with the true contact near enough at that moment.
        time: duration [s].
        distance: from the true contact to the target at the end [m], NaN without contact.
        lost: time without contact, in all [s].
    """

    ending: Ending
    success_true: bool
    time: float
    distance: float
    lost: float


class PlanarPush:
    """One push in the plane, without random draws; twists in, contacts out, as `PushScene`.

    Args:
        config: the push.

    Raises:
        ConfigurationError: the object is a URDF, or starts out of sight.
    """

    def __init__(self, config: PushConfig) -> None:
        self.config = config
        self._body: Body = _planar_body(config.object, config.friction)
        self._steps = round(config.period * RATE)
        self._state = np.zeros(STATE)
        self._floor = np.zeros((len(self._body.supports), 2))
        self._touched = np.zeros((self._steps * MOST, 6))
        self._rows = 0
        self._chassis = mobile_base()
        self._box = self._chassis.corners
        self._state[BASE] = -self._chassis.front
        self._place_object()

    @property
    def base_pose(self) -> tuple[float, float, float]:
        """True pose of the base: x, y [m] and yaw [rad] in `odom`."""
        x, y, yaw = self._state[BASE : BASE + 3].tolist()
        return x, y, yaw

    @property
    def object_pose(self) -> tuple[float, float, float]:
        """True pose of the object: x, y [m] and yaw [rad] in `odom`."""
        x, y, yaw = self._state[OBJECT : OBJECT + 3].tolist()
        back_x, back_y = self._body.centre.tolist()
        return *planar_point((x, y, yaw), (-back_x, -back_y)), yaw

    def drive(self, forward: float, lateral: float, yaw_rate: float) -> None:
        """One cycle, in which the base moves forward, to the left [m/s] and yaws [rad/s]."""
        heading = float(self._state[BASE + 2]) + yaw_rate * self.config.period / 2.0
        body = self._body
        self._rows = advance(
            self._state,
            self._floor,
            (*planar_turned((forward, lateral), heading), yaw_rate),
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
        """The contacts of the last cycle, as the integrator would report them from the skin."""
        if not self._rows:
            return []
        touched, activation = self._touched[: self._rows], self.config.skin.activation
        return _felt(
            touched, self._steps, activation, self._chassis.front, self._chassis.half_width
        )

    @property
    def touches(self) -> Touches:
        """Contact points of the last cycle, at the height of the robot's frame."""
        rows = self._touched[: self._rows]
        level = np.zeros((len(rows), 1))
        points, normals = np.hstack([rows[:, 1:3], level]), np.hstack([rows[:, 3:5], level])
        return Touches(rows[:, 0].copy(), points, normals, rows[:, 5].copy())

    def truth(self) -> tuple[str, float]:
        """The true contact: its kind, and its distance from the target [m].

        Returns:
            "none", "point" or "line"; and the distance, NaN without contact.
        """
        if not self._rows:
            return "none", math.nan
        kind, contact = touching(self.touches, self._steps)
        there_x, there_y = planar_point(self.base_pose, contact)
        target_x, target_y = self.config.target
        return kind, math.hypot(target_x - there_x, target_y - there_y)

    def _touched_lately(self) -> bool:
        last = self._touched[self._rows - 1, 0] if self._rows else -1.0
        return bool(last >= self._steps - UNION * RATE)

    def _place_object(self) -> None:
        """Place the object before the front, at the distance `gap`."""
        config, body = self.config, self._body
        yaw = math.radians(config.yaw)
        cos, sin = math.cos(yaw), math.sin(yaw)
        rotation = np.array([[cos, -sin], [sin, cos]])
        middle = rotation @ body.centre + [0.0, config.offset]
        first = _first_met(body, yaw, float(middle[1]), self._chassis.half_width)
        if first == math.inf:
            raise ConfigurationError(
                "the object starts out of sight: the robot's front, "
                f"{2 * self._chassis.half_width:g} m wide, would pass it",
                "offset",
            )
        self._state[OBJECT : OBJECT + 3] = (config.gap - first, middle[1], yaw)


def planar_trial(config: PushConfig, controller: PushingController[Any]) -> Outcome:
    """The result of a push in the plane, as `pushed` makes it; the controller is reset first.

    Args:
        config: the push.
        controller: decides from contacts and the pose of the base.

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
            push.drive(decision.forward, decision.lateral, decision.yaw_rate)
            cycles += 1
            continue
        distance = push.truth()[1]
        arrived = ending == Ending.ARRIVED and distance <= config.within
        return Outcome(ending, arrived, now, distance, lost)


@dataclass(frozen=True, eq=False)
class Body:
    """An object in the plane, about its centre of mass.

    Attributes:
        centre: shape (2,), the centre of mass in the object's frame [m].
        outlines: shape (m, 2), corners of all polygons that the chassis can touch [m].
        sizes: shape (p,), number of corners of each of them.
        circles: shape (k, 3), middle and radius of each circle that it can touch [m].
        supports: shape (n, 3), points of support [m], and the greatest force of friction there [N].
        numbers: mass [kg], inertia [kg·m²], friction with the robot, duration of a step [s].
    """

    centre: FloatArray
    outlines: FloatArray
    sizes: NDArray[np.int64]
    circles: FloatArray
    supports: FloatArray
    numbers: FloatArray


def _planar_body(pushed: ObjectConfig, friction: FrictionConfig) -> Body:
    """An object in the plane.

    Args:
        pushed: the object.
        friction: with floor and robot.

    Raises:
        ConfigurationError: it is a URDF, or the chassis would pass above or below it.
    """
    if isinstance(pushed, UrdfObjectConfig):
        raise ConfigurationError("the planar model knows no URDF: give its shape", "object")
    parts = pushed.parts()
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


def _first_met(body: Body, yaw: float, y: float, half_width: float) -> float:
    """Position along x at which a front that moves along x meets an object first.

    Args:
        body: the object.
        yaw: of the object [rad].
        y: of its centre of mass, to the left of the front's middle [m].
        half_width: of the front [m].

    Returns:
        x from its centre of mass [m]; infinite if the front would pass it.
    """
    rotation, met, begin = planar_rotation(yaw), [np.inf], 0
    for middle_x, middle_y, radius in np.column_stack(
        [body.circles[:, :2] @ rotation.T + [0.0, y], body.circles[:, 2]]
    ):
        beside = max(abs(middle_y) - half_width, 0.0)
        if beside < radius:
            met.append(middle_x - np.sqrt(radius**2 - beside**2))
    for size in body.sizes:
        corners = body.outlines[begin : begin + size] @ rotation.T + [0.0, y]
        begin += size
        for corner, following in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if (
                max(corner[1], following[1]) < -half_width
                or min(corner[1], following[1]) > half_width
            ):
                continue
            sides = np.clip([corner[1], following[1]], -half_width, half_width)
            rise = following[1] - corner[1]
            shares = (sides - corner[1]) / rise if rise else np.array([0.0, 1.0])
            met.append(float((corner[0] + shares * (following[0] - corner[0])).min()))
    return float(min(met))


def _supports(parts: list[Part], centre: FloatArray, friction: float) -> FloatArray:
    """Points of support [m], and shares of the friction there [N], linear in the position."""
    standing = [part for part in parts if part.bottom == 0.0]
    points = np.concatenate([_feet(part) for part in standing]) - centre
    shares = np.concatenate(
        [np.full(len(feet), part.mass / len(feet)) for part in standing for feet in [_feet(part)]]
    )
    shares /= shares.sum()
    # share of i: shares_i (a + b x_i + c y_i), so that they sum to 1 and balance about the centre
    basis = np.column_stack([np.ones(len(points)), points])
    coefficients = np.linalg.pinv(basis.T @ (shares[:, None] * basis))[:, 0]
    held = (shares * (basis @ coefficients)).clip(0.0)
    return np.column_stack([points, friction * held / held.sum()])


def _feet(part: Part) -> FloatArray:
    if part.radius is None:
        return part.outline
    angles = 2.0 * np.pi * np.arange(RIM) / RIM
    return part.middle + RIM_SHARE * part.radius * np.stack(
        [np.cos(angles), np.sin(angles)], axis=1
    )


def _gyration_squared(part: Part) -> float:
    """A part's inertia about its own middle, over its mass [m²]."""
    if part.radius is not None:
        return part.radius**2 / 2.0
    x, y = (part.outline - part.middle).T
    next_x, next_y = np.roll(x, -1), np.roll(y, -1)
    cross = x * next_y - next_x * y
    square = x * x + x * next_x + next_x**2 + y * y + y * next_y + next_y**2
    return float((cross * square).sum() / (6.0 * cross.sum()))


def _felt(
    touched: FloatArray, steps: int, activation: float, front: float, half_width: float
) -> list[Contact]:
    """Contacts as skin, generator `tactile` and integrator would report them.

    Args:
        touched: shape (n, 6), as `planar_kernels.advance` wrote it.
        steps: of the cycle.
        activation: least mean force over the cycle at which a taxel responds [N].
        front: position of the front along x [m].
        half_width: distance of the sides from the middle [m].
    """
    runs = np.empty((RUNS, 4))
    count = feel(touched, steps, STRIPS, activation, THRESHOLD, P_MAX, runs)
    return [_contact(front, half_width, *run) for run in runs[:count].tolist()]


def _contact(
    front: float, half_width: float, strip: float, along: float, variance: float, likelihood: float
) -> Contact:
    facing_x, facing_y, along_x, along_y = STRIPS[int(strip), :4].tolist()
    reach = front if facing_x else half_width
    position = np.array([facing_x * reach + along_x * along, facing_y * reach + along_y * along, 0])
    scatter = np.diag([along_x * variance, along_y * variance, 0.0])
    return Contact(
        position=position,
        likelihood=likelihood,
        scatter=scatter,
        covariance=scatter,
        extent=np.stack([position, position]),
        force=UNKNOWN,
        voxels=1,
        shares=SKIN,
        stamp=0.0,
        frame="base",
    )
