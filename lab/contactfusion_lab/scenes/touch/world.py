"""The physics of a touch: a compliant arm, fixed objects, and the true contacts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

from contactfusion.arrays import FloatArray
from contactfusion.frames import Pose, inverse, pose_of, vectors_in
from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectModel
from contactfusion_lab.scenes.arm import CompliantArm

FAINT = 0.05
"""Least normal force of a contact point that counts [N]."""
BALL_MASS, BALL_SPEED = 0.01, 0.05
"""Mass of a ball that presses [kg], and the speed with which it comes [m/s]."""
APART = 0.015
"""Single-linkage distance: contact points further apart are separate contacts [m]."""


@dataclass(frozen=True, eq=False)
class Touching:
    """Contacts on a robot, in the root link's frame.

    Attributes:
        places: shape (n, 3), positions [m].
        forces: shape (n, 3) [N], on the robot.
        links: the link that each acts on.
    """

    places: FloatArray
    forces: FloatArray
    links: tuple[str, ...]


class TouchWorld:
    """A robot and objects in PyBullet.

    Args:
        model: the robot; its root link stands at the origin.
        objects: fixed objects, by name.
        friction: coefficient between robot and objects.
    """

    def __init__(
        self, model: RobotModel, objects: Mapping[str, ObjectModel], friction: float
    ) -> None:
        self._model = model
        self._world = self.physics = BulletWorld(model, hollow=True, visual=True)
        """The robot and all bodies."""
        self._bullet, self._client = self._world.bullet, self._world.client
        self._friction, self._clutter = friction, list[int]()
        self._balls = dict[int, int]()
        """Balls that press, with the number of the link that is the ball."""
        self._bodies = {name: self._stand(added) for name, added in objects.items()}
        # a touch is a point contact, which bears no moment, whatever the URDF says
        grip = {"lateralFriction": 1.0, "spinningFriction": 0.0, "rollingFriction": 0.0}
        for row in self._world.links:
            self._bullet.changeDynamics(self._world.robot, row, **grip, **self._client)
        # without this a wrench would be reported about the link's centre of mass
        self._bullet.setPhysicsEngineParameter(
            jointFeedbackMode=self._bullet.JOINT_FEEDBACK_IN_JOINT_FRAME, **self._client
        )
        rows = {link: row for row, link in self._world.links.items()}
        self._wrists = {
            name: rows[model.link_of(wrist.frame)] for name, wrist in model.config.wrists.items()
        }
        self._feedback: dict[str, Pose] = {}
        self._inertial: dict[str, Pose] = {}
        for name, row in self._wrists.items():
            self._bullet.enableJointForceTorqueSensor(self._world.robot, row, True, **self._client)
            # it is reported at the link's origin, but along the axes of the link's inertia
            axes = self._bullet.getDynamicsInfo(self._world.robot, row, **self._client)[4]
            back = inverse(model.pose_on_link(model.config.wrists[name].frame))
            rotation = pose_of((0.0, 0.0, 0.0), Rotation.from_quat(axes).as_matrix())
            self._feedback[name], self._inertial[name] = back @ rotation, inverse(rotation)

    def stand(self, clutter: Sequence[ObjectModel]) -> list[int]:
        """Add further bodies that do not move; their numbers in PyBullet."""
        added = [body for model in clutter for body in self._stand(model)]
        self._clutter += added
        return added

    def press(
        self,
        place: FloatArray,
        normal: FloatArray,
        radius: float,
        gap: float,
        force: float,
        yields: bool = False,
    ) -> int:
        """Press a ball on a place, along a straight guide; its number in PyBullet.

        Args:
            place: shape (3,), on the robot [m].
            normal: shape (3,), outward there.
            radius: of the ball [m].
            gap: its distance from the robot before it comes [m].
            force: with which it presses [N].
            yields: whether the guide yields to that force sideways, too. A stiff one can jam on a
                link that moves, whose force on it nothing bounds.
        """
        bullet, client = self._bullet, self._client
        ball = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=radius, **client)
        axes = [*null_space(normal[None]).T, -normal] if yields else [-normal]
        body: int = bullet.createMultiBody(
            basePosition=(place + (radius + gap) * normal).tolist(),
            linkMasses=[BALL_MASS] * len(axes),
            linkCollisionShapeIndices=[*[-1] * (len(axes) - 1), ball],
            linkVisualShapeIndices=[-1] * len(axes),
            linkPositions=[[0.0] * 3] * len(axes),
            linkOrientations=[[0.0, 0.0, 0.0, 1.0]] * len(axes),
            linkInertialFramePositions=[[0.0] * 3] * len(axes),
            linkInertialFrameOrientations=[[0.0, 0.0, 0.0, 1.0]] * len(axes),
            linkParentIndices=[*range(len(axes))],
            linkJointTypes=[bullet.JOINT_PRISMATIC] * len(axes),
            linkJointAxis=[axis.tolist() for axis in axes],
            **client,
        )
        last = len(axes) - 1
        bullet.changeDynamics(body, last, lateralFriction=self._friction, **client)
        for row in range(len(axes)):
            bullet.setJointMotorControl2(
                body, row, bullet.VELOCITY_CONTROL, targetVelocity=BALL_SPEED * (row == last),
                force=force, **client
            )  # fmt: skip
        self._balls[body] = last
        return body

    def balls(self) -> list[Pose]:
        """Where the balls are that press."""
        states = [self._bullet.getLinkState(*ball, **self._client) for ball in self._balls.items()]
        return [pose_of(state[4], np.eye(3)) for state in states]

    def adopt(self, name: str, body: int) -> None:
        """Register a further body of `physics`, such as one that moves, as an object."""
        self._bodies[name] = [body]

    def blocked(
        self, positions: FloatArray, hand: set[str], target: str, margin: float = 0.0
    ) -> bool:
        """Whether the arm would touch the target, or any link another object.

        Args:
            positions: shape (n,), of the joints [rad, m].
            hand: the links that may touch the target.
            target: the object that they may touch.
            margin: what is nearer counts as touching [m].
        """
        self._world.bend(positions)
        for name, bodies in (*self._bodies.items(), ("", self._clutter)):
            near = set().union(*(self._world.near(body, margin) for body in bodies))
            if near - (hand if name == target else set()) - {self._model.root}:
                return True
        return False

    def arm(self, positions: FloatArray, stiffness: FloatArray) -> CompliantArm:
        """The compliant arm at its start.

        Args:
            positions: shape (n,), of the joints [rad, m].
            stiffness: shape (n,), of the joints [N·m/rad, N/m].
        """
        return CompliantArm(self._world, self._model, positions, stiffness)

    def felt(self) -> dict[str, FloatArray]:
        """The true wrench at each wrist, weight included, shape (6,) [N, N·m], on the robot."""
        wrenches = {}
        for name, row in self._wrists.items():
            state = self._bullet.getJointState(self._world.robot, row, **self._client)
            # PyBullet reports what the arm exerts on the link; the world exerts the reverse on it
            wrench, back = -np.array(state[2]), self._feedback[name]
            if state[3]:  # and leaves out the friction of the link's own joint
                axis = self._bullet.getJointInfo(self._world.robot, row, **self._client)[13]
                wrench[3:] -= state[3] * vectors_in(self._inertial[name], np.array([axis]))[0]
            force, torque = vectors_in(back, wrench.reshape(2, 3))
            wrenches[name] = np.concatenate([force, torque + np.cross(back[:3, 3], force)])
        return wrenches

    def touching(self) -> Touching:
        """The contact points on the robot now."""
        points = [
            point
            for bodies in (*self._bodies.values(), self._clutter, self._balls)
            for body in bodies
            for point in self._bullet.getContactPoints(self._world.robot, body, **self._client)
            if point[9] >= FAINT
        ]
        places = [(np.array(point[5]) + point[6]) / 2.0 for point in points]
        forces = [
            point[9] * np.array(point[7]) + point[10] * np.array(point[11])
            + point[12] * np.array(point[13])
            for point in points
        ]  # fmt: skip
        links = tuple(self._world.links[point[3]] for point in points)
        return Touching(np.reshape(places, (-1, 3)), np.reshape(forces, (-1, 3)), links)

    def _stand(self, model: ObjectModel) -> list[int]:
        """Add the shapes of an object that does not move; their numbers in PyBullet."""
        bodies = [self._world.add(shape) for shape in model.shapes]
        for body, shape in zip(bodies, model.shapes, strict=True):
            self._world.place(body, model.config.pose.pose() @ shape.pose())
            self._bullet.changeDynamics(body, -1, lateralFriction=self._friction, **self._client)
        return bodies


def contacts_of(moments: Sequence[Touching]) -> Touching:
    """Contacts from the contact points of several instants, the strongest first.

    The physics reports several points where a face or an edge lies on another: points near each
    other are one contact, at their mean weighted by force.
    """
    places = np.concatenate([np.empty((0, 3)), *(moment.places for moment in moments)])
    forces = np.concatenate([np.empty((0, 3)), *(moment.forces for moment in moments)])
    links = np.array([link for moment in moments for link in moment.links])
    if len(places) > 1:
        labels = fcluster(linkage(places), APART, criterion="distance")
    else:
        labels = np.ones(len(places), np.intp)
    found = []
    for label in np.unique(labels):
        own = labels == label
        weights = np.linalg.norm(forces[own], axis=1)
        position = weights @ places[own] / weights.sum()
        force = forces[own].sum(axis=0) / len(moments)
        found.append(
            (float(np.linalg.norm(force)), position, force, str(links[own][weights.argmax()]))
        )
    found.sort(key=lambda contact: -contact[0])
    return Touching(
        np.reshape([position for _, position, _, _ in found], (-1, 3)),
        np.reshape([force for _, _, force, _ in found], (-1, 3)),
        tuple(link for _, _, _, link in found),
    )
