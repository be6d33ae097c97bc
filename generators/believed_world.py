"""A physics world of what is believed: which links are near which object."""

from collections.abc import Mapping

from contactfusion.frames import Pose
from contactfusion.robots.bullet import BulletWorld
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectModel
from contactfusion.robots.posed import PosedRobot


class BelievedWorld:
    """A robot and objects in PyBullet, put where they are believed to be; nothing falls in it.

    Args:
        robot: the robot.
        objects: by name.

    Raises:
        DependencyError: pybullet is not installed.
    """

    def __init__(self, robot: RobotModel, objects: Mapping[str, ObjectModel]) -> None:
        self._world = BulletWorld(robot)
        self._objects = {
            name: [(self._world.add(shape), shape.pose()) for shape in one.shapes]
            for name, one in objects.items()
        }

    def near(self, robot: PosedRobot, name: str, pose: Pose, reach: float) -> set[str]:
        """Give the links that may lie within `reach` [m] of an object.

        Args:
            robot: in its pose.
            name: the object.
            pose: where it is believed to be, in the frame of the robot's poses.
            reach: [m].
        """
        self._world.place_robot(robot.base)
        self._world.bend(robot.positions)
        links: set[str] = set()
        for body, own in self._objects[name]:
            self._world.place(body, pose @ own)
            links |= self._world.near(body, reach)
        return links
