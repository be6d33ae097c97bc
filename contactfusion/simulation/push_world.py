"""The physics of a push: a base that is driven, an object on the floor, and what touches where."""

import math
import os
import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, missing_extra
from contactfusion.robots.description import RobotConfig
from contactfusion.simulation.push_bodies import (
    ORIGIN_HEIGHT,
    add_base,
    add_floor,
    add_object,
    quiet,
    turned,
)
from contactfusion.simulation.push_config import RATE, PushConfig

ITERATIONS = 20
"""Of the solver, each step."""
STRONGEST = 5000.0
"""Force and torque of the drive's motors [N, N·m]."""
FAR = 5.0
"""No object is so large [m]."""
ADVANCES, CLOSE, BESIDE = 1000, 1e-5, 0.01
"""An object is moved up to the front in so many steps at most, until it is so near, or so far past
the front [m]."""
HEAVIEST = 250.0
"""More the base cannot push, nor carry: its payload [kg]."""
GRAVITY = 9.81
"""[m/s²]."""


@dataclass(frozen=True, eq=False)
class Touches:
    """Points at which the object pressed the robot in one cycle, in the robot's frame at that time.

    Attributes:
        steps: shape (n,), at which step of the cycle, from 0.
        points: shape (n, 3) [m].
        normals: shape (n, 3), into the robot.
        forces: shape (n,), along the normals [N].
    """

    steps: FloatArray
    points: FloatArray
    normals: FloatArray
    forces: FloatArray


class PushWorld:
    """A driven base and an object in a PyBullet world of their own; the same every time.

    Args:
        config: the push.
        robot: the base; its collision shapes push.

    Raises:
        DependencyError: pybullet is not installed.
        RobotError: PyBullet cannot load the base or the object.
        ConfigurationError: the object is too heavy, or does not stand before the robot's front; or
            there is no screen for a window.
    """

    def __init__(self, config: PushConfig, robot: RobotConfig) -> None:
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
        self._object, self._back, self._turn = add_object(pybullet, self._client, config.object)
        self._require_movable()
        self._place_object()
        self.touches = _gathered([])
        """What touched in the last cycle."""

    def drive(self, vx: float, vy: float, omega: float) -> None:
        """Let one cycle of physics pass while the base moves at a velocity.

        Args:
            vx: ahead [m/s].
            vy: to the left [m/s].
            omega: about the vertical [rad/s].
        """
        bullet, client = self._bullet, self._client
        heading = self.base_pose[2] + omega * self.config.period / 2.0
        cos, sin = math.cos(heading), math.sin(heading)
        bullet.setJointMotorControlArray(
            self._base,
            (0, 1, 2),
            bullet.VELOCITY_CONTROL,
            targetVelocities=(cos * vx - sin * vy, sin * vx + cos * vy, omega),
            forces=(STRONGEST, STRONGEST, STRONGEST),
            **client,
        )
        rows: list[tuple[float, ...]] = []
        for step in range(self.steps):
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
        """How many steps of the physics make a cycle."""
        return round(self.config.period * RATE)

    @property
    def base_pose(self) -> tuple[float, float, float]:
        """Where the base is: x, y [m] and yaw [rad] in `odom`."""
        x, y, yaw = self._bullet.getJointStates(self._base, (0, 1, 2), **self._client)
        return x[0], y[0], yaw[0]

    @property
    def base_twist(self) -> tuple[float, float, float]:
        """How the base moves: ahead, to the left [m/s], about the vertical [rad/s]."""
        x, y, yaw = self._bullet.getJointStates(self._base, (0, 1, 2), **self._client)
        cos, sin = math.cos(yaw[0]), math.sin(yaw[0])
        return cos * x[1] + sin * y[1], cos * y[1] - sin * x[1], yaw[1]

    @property
    def object_pose(self) -> tuple[float, float, float]:
        """Where the object is: x, y [m] and yaw [rad] in `odom`."""
        place, turn = self._bullet.getBasePositionAndOrientation(self._object, **self._client)
        a, b, c, d = self._turn
        x, y, z, w = turned(turn, (-a, -b, -c, d))
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        cos, sin = math.cos(yaw), math.sin(yaw)
        back_x, back_y = self._back[0], self._back[1]
        return place[0] - cos * back_x + sin * back_y, place[1] - sin * back_x - cos * back_y, yaw

    def mass(self) -> float:
        """Give the mass of the object [kg]."""
        rows = range(-1, self._bullet.getNumJoints(self._object, **self._client))
        return float(
            sum(self._bullet.getDynamicsInfo(self._object, row, **self._client)[0] for row in rows)
        )

    def _require_movable(self) -> None:
        mass = self.mass()
        if mass > HEAVIEST:
            raise ConfigurationError(
                f"{mass:g} kg are too heavy: the base moves {HEAVIEST:g} kg at most", "object"
            )
        if mass <= 0.0:
            raise ConfigurationError("it has no mass, so nothing moves it", "object")

    def _place_object(self) -> None:
        """Stand the object before the front, as far away as the gap says."""
        config, yaw = self.config, math.radians(self.config.yaw)
        ahead, gap, near = FAR, FAR, (FAR, 0.0)
        for _ in range(ADVANCES):
            self._put(ahead, config.offset, yaw)
            found = self._bullet.getClosestPoints(
                self._base, self._object, 4.0 * FAR, **self._client
            )
            point = min(found, key=lambda point: float(point[8]))
            gap, near = float(point[8]), point[6]
            if gap < CLOSE or near[0] < -BESIDE:
                break
            ahead -= gap  # nothing is nearer, so nothing can be hit on the way
        if gap >= CLOSE:
            raise ConfigurationError(
                f"the object starts out of sight: the robot's front, "
                f"{2 * self.base.half_width:g} m wide, would pass it",
                "offset",
            )
        self._put(ahead - gap + config.gap, config.offset, yaw)
        self.first_contact = (0.0, float(near[1]))
        """Where front and object will first meet on a straight way, in `odom` [m]."""

    def _put(self, x: float, y: float, yaw: float) -> None:
        cos, sin = math.cos(yaw), math.sin(yaw)
        place = (
            x + cos * self._back[0] - sin * self._back[1],
            y + sin * self._back[0] + (cos * self._back[1]),
        )
        turn = turned((0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)), self._turn)
        self._bullet.resetBasePositionAndOrientation(
            self._object, (*place, self._back[2]), turn, **self._client
        )


def _gathered(rows: list[tuple[float, ...]]) -> Touches:
    table = np.array(rows, np.float64).reshape(-1, 8)
    return Touches(table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7])
