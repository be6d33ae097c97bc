"""A compliant arm in PyBullet: joint impedance control towards commanded positions."""

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.model import RobotModel

STEP = 0.001
"""Time step of the physics [s]."""
BREAKING = 0.02
"""Bullet keeps a point of contact until it has slid or parted by this [m]. This is the default of
Bullet, but one number for all worlds of a process, and another may have changed it."""
STIFFEST = 400.0
"""Greatest natural frequency of a joint [rad/s]: the physics could not follow a faster one."""


class CompliantArm:
    """Joint impedance: τ = K (q* − q) + D (q*' − q') + g(q), as torque, for motors would jump.

    Args:
        world: the physics.
        model: the robot in it.
        positions: shape (n,), of the joints at the start [rad, m].
        stiffness: K, shape (n,) [N·m/rad, N/m]; D is critical damping.
    """

    def __init__(
        self, world: BulletWorld, model: RobotModel, positions: FloatArray, stiffness: FloatArray
    ) -> None:
        self._world, self._model = world, model
        bullet, client, rows = world.bullet, world.client, world.joints
        self._wanted = stiffness
        self.adapt(positions)
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
        self._commanded = positions
        self.positions, self.velocities = positions.copy(), np.zeros(count)
        self.torques, self.dragged = np.zeros((2, count))
        """What motors and friction exerted in the last step, shape (n,) [N·m, N]."""

    def adapt(self, positions: FloatArray) -> None:
        """Set stiffness and damping for the inertias at positions far from those at the start.

        Args:
            positions: shape (n,), of the joints [rad, m].
        """
        inertias = self._model.inertias(positions)
        self.stiffness = np.minimum(self._wanted, inertias * STIFFEST**2)
        """Stiffness K of the joints, shape (n,) [N·m/rad, N/m]."""
        self._damping = 2.0 * np.sqrt(self.stiffness * inertias)

    def step(self, commanded: FloatArray, friction: FloatArray | None = None) -> None:
        """One step of the physics.

        Args:
            commanded: q*, shape (n,) [rad, m].
            friction: the most that friction exerts, shape (n,) [N·m, N]; None: there is none.
        """
        bullet, client, world = self._world.bullet, self._world.client, self._world
        torques = (
            self.stiffness * (commanded - self.positions)
            + self._damping * ((commanded - self._commanded) / STEP - self.velocities)
            + self._model.gravity_torques(self.positions)
        )
        self._commanded = commanded
        np.clip(torques, -self._most, self._most, out=torques)
        if friction is not None:  # a motor that stands still with a limited force holds as it does
            bullet.setJointMotorControlArray(
                world.robot, world.joints, bullet.VELOCITY_CONTROL,
                targetVelocities=[0.0] * len(friction), forces=friction, **client
            )  # fmt: skip
        bullet.setJointMotorControlArray(
            world.robot, world.joints, bullet.TORQUE_CONTROL, forces=torques, **client
        )
        bullet.setPhysicsEngineParameter(contactBreakingThreshold=BREAKING, **client)
        bullet.stepSimulation(**client)
        states = bullet.getJointStates(world.robot, world.joints, **client)
        self.positions = np.array([state[0] for state in states])
        self.velocities = np.array([state[1] for state in states])
        self.torques = torques
        if friction is not None:
            self.dragged = np.array([state[3] for state in states])
