"""The physics of a grasp: an arm on springs, a table, and an object that moves."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, inverse, pose_of
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectModel
from contactfusion_lab.scenes.arm import SpringyArm
from contactfusion_lab.scenes.touch.world import FAINT, Touching, TouchWorld
from contactfusion_lab.simulation.grasp_object import add_movable
from contactfusion_lab.simulation.grasp_picture import Eye

SPINNING, ROLLING = 0.004, 0.0005
"""Lever arms of the moments that the soft pads of a hand carry by friction [m]."""
ITERATIONS = 100
"""Of the solver in each step: what friction holds from several sides needs more than a touch."""

COLOUR = (0.34, 0.71, 0.91, 1.0)
"""Of the object in pictures."""


class GraspWorld:
    """A robot on a floor, what stands around, and one object that moves, in PyBullet.

    Args:
        model: the robot; its root link stands at the origin.
        surroundings: what does not move, by name.
        thing: the object.
        mass: of the object [kg]; None: as its URDF says.
        friction: between robot and object.
        table_friction: between the object and what it stands on.

    Raises:
        RobotError: the object's URDF has no mass, or PyBullet cannot read it.
    """

    def __init__(
        self,
        model: RobotModel,
        surroundings: Mapping[str, ObjectModel],
        thing: ObjectModel,
        mass: float | None,
        friction: float,
        table_friction: float,
    ) -> None:
        # the hand's friction is 1, and PyBullet multiplies those of two bodies
        self._touch = TouchWorld(model, surroundings, table_friction / friction)
        self._physics = self._touch.physics
        self._bullet, self._client = self._physics.bullet, self._physics.client
        floor = self._bullet.createCollisionShape(self._bullet.GEOM_PLANE, **self._client)
        self._bullet.createMultiBody(0.0, floor, **self._client)  # for what falls off the table
        bullet, client = self._bullet, self._client
        bodies = [bullet.getBodyUniqueId(n, **client) for n in range(bullet.getNumBodies(**client))]
        self._ground = [body for body in bodies if body != self._physics.robot]
        self._body = add_movable(self._physics, thing, mass)
        self._touch.adopt("object", self._body)
        grip = {"spinningFriction": SPINNING, "rollingFriction": ROLLING}
        self._bullet.changeDynamics(
            self._body, -1, lateralFriction=friction, **grip, linearDamping=0.0,
            angularDamping=0.0, **self._client,
        )  # fmt: skip
        self._bullet.setPhysicsEngineParameter(numSolverIterations=ITERATIONS, **self._client)
        self._bullet.changeVisualShape(self._body, -1, rgbaColor=COLOUR, **self._client)
        inertial = self._bullet.getDynamicsInfo(self._body, -1, **self._client)[3:5]
        self._inertial = pose_of(inertial[0], Rotation.from_quat(inertial[1]).as_matrix())

    @property
    def object_pose(self) -> Pose:
        """Where the object is, in the root link's frame."""
        place, turn = self._bullet.getBasePositionAndOrientation(self._body, **self._client)
        there: Pose = pose_of(place, Rotation.from_quat(turn).as_matrix()) @ inverse(self._inertial)
        return there

    def put(self, pose: Pose) -> None:
        """Put the object into a pose, at rest."""
        self._physics.place(self._body, pose @ self._inertial)

    def blocked(self, positions: FloatArray) -> bool:
        """Tell whether the robot would touch anything with its joints there, shape (n,)."""
        return self._touch.blocked(positions, set(), "object")

    def arm(self, positions: FloatArray, stiffness: FloatArray) -> SpringyArm:
        """Begin the physics with the joints at `positions`, on springs; both of shape (n,)."""
        return self._touch.arm(positions, stiffness)

    def felt(self) -> dict[str, FloatArray]:
        """Give what each wrist feels, weight and all, shape (6,) [N, N·m], on the robot."""
        return self._touch.felt()

    def touching(self) -> Touching:
        """Tell where the robot is touched now."""
        return self._touch.touching()

    def touches_object(self) -> bool:
        """Tell whether the robot touches the object."""
        return self._touches(self._physics.robot)

    def supports_object(self) -> bool:
        """Tell whether the floor or what stands around touches the object."""
        return any(self._touches(body) for body in self._ground)

    def _touches(self, body: int) -> bool:
        points = self._bullet.getContactPoints(body, self._body, **self._client)
        return any(point[9] >= FAINT for point in points)

    def seen(self, eye: Eye, places: FloatArray) -> tuple[NDArray[np.uint8], FloatArray]:
        """Give a picture, shape (height, width, 3), and where places (n, 3) [m] are in it."""
        return eye.picture(self._bullet, self._client), eye.pixels(self._bullet, places)
