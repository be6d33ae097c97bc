"""The physics of a push: a driven base, an object at its start, and their contact points."""

import math
import os
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, missing_extra
from contactfusion.frames import PlanarPose, planar_point, planar_turned, planar_turned_back
from contactfusion.robots.bullet import quiet
from contactfusion.robots.description import RobotConfig
from contactfusion_lab.scenes.push.bodies import (
    GRAVITY,
    ORIGIN_HEIGHT,
    Base,
    Client,
    PushedBody,
    add_base,
    add_floor,
    add_object,
    soften,
    turned,
)
from contactfusion_lab.scenes.push.config import RATE, PushConfig
from contactfusion_lab.scenes.push.objects import DisturbanceConfig, drawn

ITERATIONS = 20
"""Iterations of the solver, each step."""
BREAKING = 0.01
"""Bullet keeps a point of contact until it has slid or parted by this [m]. Its default is 2 cm: on
a cylinder that rolls along the front a point then stays behind on the robot, its normal turns with
the cylinder, and in the end it pulls. With half of this, bodies stand less firmly."""
STRONGEST = 5000.0
"""Greatest force and torque of the drive's motors [N, N·m]."""
FAR = 5.0
"""More than the size of any object [m]."""
ADVANCES, CLOSE, BESIDE = 1000, 1e-5, 0.01
"""Greatest number of steps in which an object is moved up to the front, the distance at which it
touches, and how far past the front it is refused [m]."""
HEAVIEST = 250.0
"""Payload of the base, the greatest mass of an object [kg]."""
SOFTEST = 0.05
"""Greatest compression of a soft object under the force at which it slides [m]."""
Velocity = tuple[float, float, float]
"""Of a base: forward, lateral, to the left [m/s], and yaw rate [rad/s]."""


@dataclass(frozen=True, eq=False)
class Touches:
    """Contact points of the object on the robot in one cycle, in the robot's frame at their time.

    Attributes:
        steps: shape (n,), step of the cycle, from 0.
        points: shape (n, 3) [m].
        normals: shape (n, 3), into the robot.
        forces: shape (n,), along the normals [N].
    """

    steps: FloatArray
    points: FloatArray
    normals: FloatArray
    forces: FloatArray


@dataclass(frozen=True, eq=False)
class WorldState:
    """What sensors of a push depend on.

    Attributes:
        base: true pose of the base in `odom`.
        object: true pose of the object in `odom`.
        touches: contact points of the last cycle.
    """

    base: PlanarPose
    object: PlanarPose
    touches: Touches


class PushWorld:
    """A driven base and an object in a PyBullet world of their own; deterministic.

    Args:
        config: the push.
        robot: the base; its collision shape pushes.
        seed: of random shoves.

    Raises:
        DependencyError: pybullet is not installed.
        RobotError: PyBullet cannot load the base or the object.
        ConfigurationError: the object is too heavy or too soft, or does not stand before the
            robot's front; or there is no screen for a window.
    """

    def __init__(self, config: PushConfig, robot: RobotConfig, seed: int = 0) -> None:
        try:
            with quiet():
                import pybullet
        except ImportError:
            raise missing_extra("pybullet", "sim") from None
        self.config = config
        self._bullet: Any = pybullet
        if config.window and not os.environ.get("DISPLAY"):  # PyBullet would end the process
            raise ConfigurationError(
                "there is no screen to show it on: DISPLAY is not set", "window"
            )
        with quiet():
            client = pybullet.connect(pybullet.GUI if config.window else pybullet.DIRECT)
        self._client = {"physicsClientId": client}
        weakref.finalize(self, pybullet.disconnect, client)
        pybullet.setPhysicsEngineParameter(
            deterministicOverlappingPairs=1, numSolverIterations=ITERATIONS, **self._client
        )
        pybullet.setTimeStep(1.0 / RATE, **self._client)
        pybullet.setGravity(0.0, 0.0, -GRAVITY, **self._client)
        add_floor(pybullet, self._client, config.friction.ground)
        self.base = add_base(pybullet, self._client, robot, config.friction.robot)
        """The base, and where its pushing face lies."""
        self._base = self.base.body
        self._pushed = add_object(pybullet, self._client, config.object)
        self._object, self._back, self._orientation = self._pushed[:3]
        _require_movable(config, self.mass())
        pad, soft, disturbed = config.skin.pad, config.object.soft, config.object.disturbed
        if between := pad.on(soft) if pad and soft else pad or soft:
            soften(pybullet, self._client, self._base, between)
        self.first_contact = _stand(pybullet, self._client, config, self.base, self._pushed)
        """Position of the first contact on a straight path, x and y in `odom` [m]."""
        shoves = config.disturbances + (drawn(disturbed, seed) if disturbed else ())
        self._shoves = [(*_steps_of(shove), shove) for shove in shoves]
        self._passed, self._heading = 0, 0.0
        self.touches = _gathered([])
        """Contact points of the last cycle."""

    def drive(self, vx: float, vy: float, omega: float) -> None:
        """One cycle of physics, in which the base moves at a velocity.

        Args:
            vx: forward [m/s].
            vy: lateral, to the left [m/s].
            omega: yaw rate [rad/s].
        """
        self._steer((vx, vy, omega), self.config.period)
        self._advance(range(self.steps))

    def follow(self, velocities: Iterable[Velocity]) -> None:
        """One cycle of physics, in which the base has a velocity at each step.

        Args:
            velocities: one is taken before each step; where they end, so does the cycle.
        """
        self._advance(self._steered(velocities))

    def _steered(self, velocities: Iterable[Velocity]) -> Iterator[int]:
        """The steps of the cycle, before each of which the base takes its velocity."""
        for step, velocity in enumerate(velocities):
            self._steer(velocity, 1.0 / RATE)
            yield step

    def _steer(self, velocity: Velocity, duration: float) -> None:
        """Set the velocity of the base for a duration [s]."""
        bullet, client, (vx, vy, omega) = self._bullet, self._client, velocity
        # halfway through; the velocity stays the same in the world
        self._heading = self.base_pose[2] + omega * duration / 2.0
        bullet.setJointMotorControlArray(
            self._base,
            (0, 1, 2),
            bullet.VELOCITY_CONTROL,
            targetVelocities=(*planar_turned((vx, vy), self._heading), omega),
            forces=(STRONGEST, STRONGEST, STRONGEST),
            **client,
        )

    def _advance(self, steps: Iterable[int]) -> None:
        """Some steps of physics, whose contact points are gathered."""
        bullet, client = self._bullet, self._client
        # one number for all worlds of a process, and another may have changed it
        bullet.setPhysicsEngineParameter(contactBreakingThreshold=BREAKING, **client)
        rows: list[tuple[float, ...]] = []
        for step in steps:
            self._shove()
            bullet.stepSimulation(**client)
            found = bullet.getContactPoints(self._base, self._object, **client)
            if not found:
                continue
            x, y, yaw = self.base_pose
            cos, sin = math.cos(yaw), math.sin(yaw)
            for point in found:
                force = point[9]
                if force <= 0.0:  # PyBullet lists points that are only near, too
                    continue
                (px, py, pz), (nx, ny, nz) = point[5], point[7]
                px, py = px - x, py - y
                rows.append(
                    (step, cos * px + sin * py, cos * py - sin * px, pz - ORIGIN_HEIGHT,
                     cos * nx + sin * ny, cos * ny - sin * nx, nz, force)
                )  # fmt: skip
        self.touches = _gathered(rows)

    @property
    def steps(self) -> int:
        """Steps of the physics in a cycle."""
        return round(self.config.period * RATE)

    @property
    def base_pose(self) -> PlanarPose:
        """True pose of the base: x, y [m] and yaw [rad] in `odom`."""
        x, y, yaw = self._bullet.getJointStates(self._base, (0, 1, 2), **self._client)
        return x[0], y[0], yaw[0]

    @property
    def base_twist(self) -> Velocity:
        """Twist of the base in the last cycle."""
        x, y, yaw = self._bullet.getJointStates(self._base, (0, 1, 2), **self._client)
        return *planar_turned_back((x[1], y[1]), self._heading), yaw[1]

    @property
    def object_pose(self) -> PlanarPose:
        """True pose of the object: x, y [m] and yaw [rad] in `odom`."""
        position, orientation = self._bullet.getBasePositionAndOrientation(
            self._object, **self._client
        )
        a, b, c, d = self._orientation
        x, y, z, w = turned(orientation, (-a, -b, -c, d))
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        back = -self._back[0], -self._back[1]
        return *planar_point((position[0], position[1], yaw), back), yaw

    @property
    def state(self) -> WorldState:
        """What sensors depend on, at the end of the last cycle."""
        return WorldState(self.base_pose, self.object_pose, self.touches)

    def mass(self) -> float:
        """Mass of the object, with a ball inside [kg]."""
        bullet, client, pushed = self._bullet, self._client, self._pushed
        rows = [(pushed.body, row) for row in range(-1, bullet.getNumJoints(pushed.body, **client))]
        rows += [] if pushed.ball is None else [(pushed.ball, -1)]
        return float(sum(bullet.getDynamicsInfo(*row, **client)[0] for row in rows))

    def _shove(self) -> None:
        """Apply the shoves of the next step."""
        for begin, end, shove in self._shoves:
            if begin <= self._passed < end:
                self._bullet.applyExternalForce(
                    self._object,
                    -1,
                    (*shove.force, 0.0),
                    (*self.object_pose[:2], shove.height),
                    self._bullet.WORLD_FRAME,
                    **self._client,
                )
        self._passed += 1


def _gathered(rows: list[tuple[float, ...]]) -> Touches:
    table = np.array(rows, np.float64).reshape(-1, 8)
    return Touches(table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7])


def _steps_of(shove: DisturbanceConfig) -> tuple[int, int]:
    """The first step of a shove, and the first one after it."""
    begin = round(shove.start * RATE)
    return begin, begin + round(shove.duration * RATE)


def _require_movable(config: PushConfig, mass: float) -> None:
    """Check that an object can be pushed.

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


def _stand(
    bullet: Any, client: Client, config: PushConfig, base: Base, pushed: PushedBody
) -> tuple[float, float]:
    """Place an object before the front of a base, at the distance `gap`.

    Args:
        bullet: the module pybullet.
        client: its physics.
        config: the push.
        base: at its start.
        pushed: the object.

    Returns:
        Position of the first contact on a straight path, x and y in `odom` [m].

    Raises:
        ConfigurationError: the front would pass the object.
    """
    distance, gap, near = FAR, FAR, (FAR, 0.0)
    for _ in range(ADVANCES):
        _put(bullet, client, config, pushed, distance)
        found = bullet.getClosestPoints(base.body, pushed.body, 4.0 * FAR, **client)
        point = min(found, key=lambda point: float(point[8]))
        gap, near = float(point[8]), point[6]
        if gap < CLOSE or near[0] < -BESIDE:
            break
        distance -= gap  # no point is nearer, so nothing can be hit on the path
    if gap >= CLOSE:
        raise ConfigurationError(
            f"the object starts out of sight: the robot's front, "
            f"{2 * base.chassis.half_width:g} m wide, would pass it",
            "offset",
        )
    x = distance - gap + config.gap
    _put(bullet, client, config, pushed, x)
    if pushed.ball is not None:
        (*_, height), orientation = bullet.getBasePositionAndOrientation(pushed.ball, **client)
        position = (x, config.offset, height)
        bullet.resetBasePositionAndOrientation(pushed.ball, position, orientation, **client)
    return 0.0, float(near[1])


def _put(bullet: Any, client: Client, config: PushConfig, pushed: PushedBody, x: float) -> None:
    yaw = math.radians(config.yaw)
    back_x, back_y, height = pushed.back
    position = (*planar_point((x, config.offset, yaw), (back_x, back_y)), height)
    orientation = turned((0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)), pushed.orientation)
    bullet.resetBasePositionAndOrientation(pushed.body, position, orientation, **client)
