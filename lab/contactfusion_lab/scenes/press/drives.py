"""The drives of an arm as it was built: friction, what joints report, and true inertias."""

from typing import Literal

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.model import Model
from contactfusion.readings import JointState
from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.model import RobotModel

STATIC = 1.3
"""Friction at rest, in Coulomb friction."""
STRIBECK = 0.05
"""Speed at which it has fallen to that of sliding (Stribeck) [rad/s]."""
VISCOUS = 0.5
"""Viscous friction at 1 rad/s, in Coulomb friction."""


class DrivesConfig(Model):
    """How the joints of an arm err; values by joint are in the order of the chain."""

    effort: Literal["measured", "current"]
    """Whether torques are measured behind the gears, or the motors' currents before them."""
    noise: tuple[float, ...]
    """Standard deviation of each sample of a torque, by joint [N·m]."""
    offset: float = Field(default=0.5, ge=0)
    """Standard deviation of the zero of a torque, in that of its noise, constant."""
    coulomb: tuple[float, ...]
    """Coulomb friction before the gear, by joint [N·m]; it varies by 20 % from arm to arm."""
    constant: tuple[float, ...] = ()
    """Torque per current, by joint [N·m/A]; it varies by 5 % from arm to arm."""
    encoder: float = Field(default=2e-5, ge=0)
    """Standard deviation of a measured position [rad]."""
    velocity: float = Field(default=1e-3, ge=0)
    """Standard deviation of a measured velocity [rad/s]."""
    inertia: float = Field(default=0.05, ge=0)
    """Standard deviation of the mass of each link, as a share of it, constant."""


class Drives:
    """The drives of one specimen of an arm.

    Args:
        config: how they err.
        robot: the arm.
        specimen: draws what is constant of this arm.
        rng: draws the noise of samples.
    """

    def __init__(
        self,
        config: DrivesConfig,
        robot: RobotModel,
        specimen: np.random.Generator,
        rng: np.random.Generator,
    ) -> None:
        names = [name for name in robot.joint_names if name not in robot.config.still]
        count = len(names)
        self._robot, self._rng, self._config = robot, rng, config
        self._rows = [robot.joint_names.index(name) for name in names]
        self._names = tuple(names)
        self._noise = np.array(config.noise)
        self._masses = 1.0 + config.inertia * specimen.standard_normal(len(robot.link_names))
        self._zeros = config.offset * self._noise * specimen.standard_normal(count)
        self._coulomb = np.array(config.coulomb) * (1.0 + 0.2 * specimen.standard_normal(count))
        self._constants = 1.0 + 0.05 * specimen.standard_normal(count)
        self._constants *= np.array(config.constant or (1.0,) * count)

    def weigh(self, world: BulletWorld) -> None:
        """Set the true masses and inertias of the arm."""
        bullet, client = world.bullet, world.client
        rows = {link: row for row, link in world.links.items()}
        for name, factor in zip(self._robot.link_names, self._masses.tolist(), strict=True):
            if not self._robot.urdf.links[name].mass:
                continue
            info = bullet.getDynamicsInfo(world.robot, rows[name], **client)
            inertia = [factor * each for each in info[2]]
            bullet.changeDynamics(
                world.robot, rows[name], mass=factor * info[0], localInertiaDiagonal=inertia,
                **client
            )  # fmt: skip

    def friction(self, velocities: FloatArray) -> FloatArray:
        """The most that friction exerts, shape (n,) [N·m]; `velocities` of shape (n,) [rad/s]."""
        speeds = np.abs(velocities[self._rows])
        found = np.full(len(velocities), 1e4)  # a joint that is still stays where it is
        excess = (STATIC - 1.0) * np.exp(-((speeds / STRIBECK) ** 2))
        found[self._rows] = self._coulomb * (1.0 + excess + VISCOUS * speeds)
        return found

    def read(
        self,
        stamp: float,
        positions: FloatArray,
        velocities: FloatArray,
        torques: FloatArray,
        dragged: FloatArray,
    ) -> JointState:
        """The reading of the joints, of means since the last one.

        Args:
            stamp: of the middle of that time [s].
            positions: shape (n,) [rad].
            velocities: shape (n,) [rad/s].
            torques: shape (n,), of the motors [N·m].
            dragged: shape (n,), of friction [N·m].
        """
        count, rows = len(self._rows), self._rows
        behind = torques[rows] + dragged[rows] * (self._config.effort == "measured")
        efforts = behind + self._zeros + self._noise * self._rng.standard_normal(count)
        if self._config.effort == "current":
            efforts = efforts / self._constants
        encoders, speeds = self._rng.standard_normal((2, count))
        return JointState(
            stamp=stamp,
            frame=self._robot.root,
            sensor="joints",
            names=self._names,
            positions=positions[rows] + self._config.encoder * encoders,
            velocities=velocities[rows] + self._config.velocity * speeds,
            efforts=efforts,
        )
