"""A robot's joints in PyBullet, held where they shall be by springs and dampers."""

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.model import RobotModel

STEP = 0.001
"""Of the physics [s]."""
BREAKING = 0.02
"""Bullet keeps a point of contact until it has slid or parted by this [m]. This is what it does of
its own, but it is one number for all worlds of a process, and another may have changed it."""
STIFFEST = 400.0
"""No joint may swing faster than this by itself [rad/s]: the physics could not follow."""


class SpringyArm:
    """Joint impedance: τ = K (q* − q) + D (q*' − q') + g(q), as torque, for motors would jump.

    Args:
        world: the physics.
        model: the robot in it.
        positions: shape (n,), where the joints stand [rad, m].
        stiffness: K, shape (n,) [N·m/rad, N/m]; D is critical.
    """

    def __init__(
        self, world: BulletWorld, model: RobotModel, positions: FloatArray, stiffness: FloatArray
    ) -> None:
        self._world, self._model = world, model
        bullet, client, rows = world.bullet, world.client, world.joints
        inertias = model.inertias(positions)
        self.stiffness = np.minimum(stiffness, inertias * STIFFEST**2)
        """How each joint yields, shape (n,) [N·m/rad, N/m]."""
        self._damping = 2.0 * np.sqrt(self.stiffness * inertias)
        self._most = model.efforts
        world.bend(positions)
        count = len(rows)
        for row in range(-1, bullet.getNumJoints(world.robot, **client)):
            bullet.changeDynamics(
                world.robot, row, jointDamping=0.0, linearDamping=0.0, angularDamping=0.0, **client
            )
        bullet.setJointMotorControlArray(
            world.robot, rows, bullet.VELOCITY_CONTROL, forces=[0.0] * count, **client
        )
        bullet.setTimeStep(STEP, **client)
        bullet.setGravity(0.0, 0.0, -9.81, **client)
        self._wanted = positions
        self.positions, self.velocities = positions.copy(), np.zeros(count)

    def step(self, wanted: FloatArray) -> None:
        """Let one step of physics pass; `wanted`, shape (n,), is where joints shall be [rad, m]."""
        bullet, client, world = self._world.bullet, self._world.client, self._world
        torques = (
            self.stiffness * (wanted - self.positions)
            + self._damping * ((wanted - self._wanted) / STEP - self.velocities)
            + self._model.gravity_torques(self.positions)
        )
        self._wanted = wanted
        np.clip(torques, -self._most, self._most, out=torques)
        bullet.setJointMotorControlArray(
            world.robot, world.joints, bullet.TORQUE_CONTROL, forces=torques, **client
        )
        bullet.setPhysicsEngineParameter(contactBreakingThreshold=BREAKING, **client)
        bullet.stepSimulation(**client)
        states = bullet.getJointStates(world.robot, world.joints, **client)
        self.positions = np.array([state[0] for state in states])
        self.velocities = np.array([state[1] for state in states])
