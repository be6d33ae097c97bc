"""The dynamics of a robot: what its joints bear, and how a force on a link loads them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.errors import RobotError
from contactfusion.robots.model import RobotModel


class Dynamics:
    """Momentum, gravity and lever arms by joint, in the order of the robot's `joint_names`.

    Args:
        model: the robot; its root link does not move.
    """

    def __init__(self, model: RobotModel) -> None:
        self.model = model
        self._pin, whole = model.kinematics
        self._model: Any = whole.copy()
        self._data: Any = self._model.createData()
        self.supports: NDArray[np.bool_] = np.zeros(
            (len(model.link_names), self._model.nv), np.bool_
        )
        """Which joints a force on each link loads, shape (links, n)."""
        for row, name in enumerate(model.link_names):
            frame = self._model.frames[self._model.getBodyId(name)]
            for joint in self._model.supports[frame.parentJoint]:
                if joint:
                    self.supports[row, self._model.joints[joint].idx_v] = True

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as the robot."""
        return Dynamics, (self.model,)

    def require_inertias(self) -> None:
        """Refuse a robot that has no mass where a joint moves it.

        Raises:
            RobotError: names the links that a joint moves without a mass: all that it moves, or
                those with shapes between it and the next joint.
        """
        names = np.array(self.model.link_names)
        masses = np.array([self.model.carried_by(name) for name in names])
        weighs = masses @ self.supports > 0.0
        if not weighs.all():
            joint = self.model.joint_names[int(np.argmin(weighs))]
            links = ", ".join(names[self.supports[:, int(np.argmin(weighs))]])
            raise RobotError(
                f"{self.model.urdf.path}: joint '{joint}' moves no mass: give inertias of {links}"
            )
        shaped = np.array([self.model.urdf.links[name].is_shaped for name in names])
        for moved in np.unique(self.supports[self.supports.any(axis=1)], axis=0):
            body = (self.supports == moved).all(axis=1)
            if shaped[body].any() and not masses[body].any():
                raise RobotError(
                    f"{self.model.urdf.path}: {', '.join(names[body & shaped])} would weigh "
                    "nothing: give inertias, or `masses` in the robot's description"
                )

    def axes(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How each joint moves a point at the root's origin that it carries.

        A point at p moves by linear + angular × p for a unit of joint speed, and a force f there
        loads the joint with that, times f.

        Args:
            positions: shape (n,) [rad, m].

        Returns:
            Linear and angular velocity, both of shape (n, 3), in the root link's frame.
        """
        at = self.model.configuration(positions)
        jacobian = self._pin.computeJointJacobians(self._model, self._data, at)
        columns = np.reshape(np.array(jacobian), (6, -1))
        return np.ascontiguousarray(columns[:3].T), np.ascontiguousarray(columns[3:].T)

    def momentum(self, positions: FloatArray, velocities: FloatArray) -> FloatArray:
        """The generalised momentum M(q) q', shape (n,) [N·m·s, N·s]."""
        mass = self._pin.crba(self._model, self._data, self.model.configuration(positions))
        upper = np.triu(mass)
        symmetric = upper + np.triu(upper, 1).T
        return np.asarray(symmetric @ velocities, np.float64)

    def drift(
        self, positions: FloatArray, velocities: FloatArray, gravity: FloatArray
    ) -> FloatArray:
        """How the momentum changes without any torque, C(q, q')ᵀ q' − g(q), shape (n,) [N·m, N].

        Args:
            positions: shape (n,) [rad, m].
            velocities: shape (n,) [rad/s, m/s].
            gravity: shape (3,) [m/s²], in the root link's frame.
        """
        at = self.model.configuration(positions)
        self._model.gravity.linear = gravity
        coriolis = self._pin.computeCoriolisMatrix(self._model, self._data, at, velocities)
        held = self._pin.computeGeneralizedGravity(self._model, self._data, at)
        return np.asarray(coriolis.T @ velocities - held, np.float64)

    def payload_columns(
        self, link: str, positions: FloatArray, velocities: FloatArray, gravity: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """What each inertial parameter of a payload adds to momentum and drift.

        The parameters are mass [kg], the three first moments [kg·m], and the inertias xx, xy, yy,
        xz, yz, zz about the link's origin [kg·m²]; both are linear in them.

        Args:
            link: that carries it.
            positions: shape (n,) [rad, m].
            velocities: shape (n,) [rad/s, m/s].
            gravity: shape (3,) [m/s²], in the root link's frame.

        Returns:
            Momentum [N·m·s, N·s] and drift [N·m, N] per unit of each, both of shape (n, 10).
        """
        pin, at, frame = self._pin, self.model.configuration(positions), self._model.getBodyId(link)
        pin.computeJointJacobiansTimeVariation(self._model, self._data, at, velocities)
        pin.updateFramePlacement(self._model, self._data, frame)
        own = (self._model, self._data, frame, pin.LOCAL)
        jacobian = np.reshape(pin.getFrameJacobian(*own), (6, -1))
        change = np.reshape(pin.getFrameJacobianTimeVariation(*own), (6, -1))
        moving = jacobian @ velocities
        falling = np.r_[self._data.oMf[frame].rotation.T @ gravity, 0.0, 0.0, 0.0]
        momenta, weights = PARAMETERS @ moving, PARAMETERS @ falling  # (10, 6), of each parameter
        turning = np.zeros((6, 6))  # of a force by the link's motion
        turning[:3, :3] = turning[3:, 3:] = pin.skew(moving[3:])
        turning[3:, :3] = pin.skew(moving[:3])
        drift = momenta @ change + (weights - momenta @ turning.T) @ jacobian
        return (momenta @ jacobian).T, drift.T


def _spatial_inertias() -> FloatArray:
    """Spatial inertias of a unit of each inertial parameter, shape (10, 6, 6)."""
    found = np.zeros((10, 6, 6))
    found[0, :3, :3] = np.eye(3)
    cross = np.cross(np.eye(3)[:, None], np.eye(3)).transpose(0, 2, 1)
    found[1:4, :3, 3:], found[1:4, 3:, :3] = -cross, cross
    for number, (row, column) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)), 4):
        found[number, 3 + row, 3 + column] = found[number, 3 + column, 3 + row] = 1.0
    return found


PARAMETERS = _spatial_inertias()
