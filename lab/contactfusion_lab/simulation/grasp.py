"""A hand before an object on a table: what its sensors read, and apart from that what is true."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.controller import Command
from contactfusion.errors import RobotError
from contactfusion.frames import Pose
from contactfusion.readings import JointCommand, Reading, Wrench
from contactfusion.robots.model import RobotModel
from contactfusion.robots.objects import ObjectModel
from contactfusion.scene import Facts
from contactfusion_lab.scenes.approach import led_by
from contactfusion_lab.scenes.arm import STEP
from contactfusion_lab.scenes.facts import standing, true_contact
from contactfusion_lab.scenes.touch.sensors import TouchSensors
from contactfusion_lab.scenes.touch.world import contacts_of
from contactfusion_lab.simulation.grasp_config import GraspConfig
from contactfusion_lab.simulation.grasp_driver import GraspDriver
from contactfusion_lab.simulation.grasp_picture import Eye
from contactfusion_lab.simulation.grasp_placing import check_names, facing, placed, starting
from contactfusion_lab.simulation.grasp_world import GraspWorld

OBJECT = "object"
"""What the truth calls the object, whichever it is."""
WRENCHES = 10
"""Wrists are read after so many steps of the physics."""
SETTLING = 0.3
"""What stands on the table settles so long before the grasp begins [s]."""


@dataclass(frozen=True, eq=False)
class GraspTruth:
    """What really happens at one instant.

    Attributes:
        stamp: [s].
        object: the pose of the object in the root link's frame.
        tool: the pose of the tool there.
        joints: shape (n,), where the joints are [rad, m].
        touched: whether the robot touches the object.
        supported: whether anything else does, such as the table.
        force: of all that has touched the robot since the last instant that was asked for, the
            greatest sum of magnitudes; looked at 100 times a second [N].
    """

    stamp: float
    object: Pose
    tool: Pose
    joints: FloatArray
    touched: bool
    supported: bool
    force: float


class GraspScene:
    """One grasp: give it commands, and take its readings.

    Args:
        config: the grasp.
        robot: the robot, its root link at the origin.
        seed: of all chance.

    Raises:
        RobotError: the robot lacks a link that is named, cannot reach where the grasp begins, or
            would touch something there; or the object cannot be loaded.
        ConfigurationError: a joint or the frame of an object is not what it should be.
    """

    def __init__(self, config: GraspConfig, robot: RobotModel, seed: int = 0) -> None:
        check_names(config, robot)
        self.config, self.robot = config, robot
        rng = np.random.default_rng(seed)
        self._thing = ObjectModel(config.object)
        self._around = {name: ObjectModel(one) for name, one in config.surroundings.items()}
        self._world = GraspWorld(
            robot, self._around, self._thing, config.mass, config.friction, config.table_friction
        )
        azimuth = float(np.radians(rng.uniform(*config.azimuth)))
        self._world.put(placed(config, azimuth, rng))
        start = starting(config, robot, facing(config, azimuth), rng)
        if self._world.blocked(start):
            raise RobotError("the robot would touch something where the grasp begins")
        leading = led_by(robot, config.tool)
        self._stuck = np.array([name in config.stuck for name in robot.joint_names])
        # a joint that is stuck yields as little as the arm, and stays where it began
        stiff = self._stuck | (leading > 0.0)
        stiffness = np.where(stiff, config.arm_stiffness, config.noise.finger_stiffness)
        self._arm = self._world.arm(start, stiffness)
        self._driver = GraspDriver(
            robot, config.tool, config.gripper, config.grip, self._arm.stiffness, start
        )
        (eyes,) = rng.spawn(1)  # who looks changes nothing of what others feel
        self._sensors = TouchSensors(robot, config.tool, leading, start, config.noise, rng, eyes)
        self._began = start
        for _ in range(round(SETTLING / STEP)):
            self._arm.step(start)
        self._steps, self._waiting = 0, list[Reading]()
        self._told: float | None = None
        self._pressed = 0.0
        self._looked = -np.inf

    @property
    def stamp(self) -> float:
        """The time [s]."""
        return self._steps * STEP

    def readings(self) -> list[Reading]:
        """Give what wrists have read since the last command, then joints, skins and cameras."""
        poses = self.robot.poses_at(self._arm.positions)
        told, self._waiting = self._waiting, []
        told.append(self._sensors.joints(self.stamp, self._arm.positions, self._arm.velocities))
        told += self._sensors.skins(self.stamp, poses, self._world.touching())
        rate = self.config.camera_rate
        if rate and self.stamp - self._looked >= 1.0 / rate - STEP:
            self._looked = self.stamp
            bodies = [(solid, poses[name]) for name, solid in self.robot.solids.items()]
            bodies += [(one.solid, one.config.pose.pose()) for one in self._around.values()]
            bodies.append((self._thing.solid, self._world.object_pose))
            told += self._sensors.sights(self.stamp, poses, bodies)
        return told

    def obey(self, command: Command) -> None:
        """Let one cycle pass in which arm and hand do as they are told.

        Raises:
            ConfigurationError: the command does not fit the robot.
        """
        self._driver.obey(command)
        if command.gripper is not None and command.gripper != self._told:
            self._told = command.gripper
            self._waiting.append(
                JointCommand(
                    stamp=self.stamp,
                    frame=self.robot.root,
                    sensor="gripper",
                    names=tuple(self.config.gripper),
                    positions=self._driver.fingers,
                )
            )
        for _ in range(round(self.config.period / STEP)):
            wanted = self._driver.advance(self._arm.positions)
            self._arm.step(np.where(self._stuck, self._began, wanted))
            self._steps += 1
            if self._steps % WRENCHES == 0:
                self._waiting += self._felt()
                self._pressed = max(self._pressed, self._force())

    def truth(self) -> GraspTruth:
        """Give what really happens now."""
        joints = self._arm.positions
        pressed, self._pressed = max(self._pressed, self._force()), 0.0
        return GraspTruth(
            stamp=self.stamp,
            object=self._world.object_pose,
            tool=self.robot.poses_at(joints)[self.config.tool],
            joints=joints,
            touched=self._world.touches_object(),
            supported=self._world.supports_object(),
            force=pressed,
        )

    def facts(self) -> Facts:
        """Tell where the robot is touched now, and where the object stands."""
        root, now = self.robot.root, contacts_of([self._world.touching()])
        contacts = tuple(
            true_contact(self.stamp, root, place, force)
            for place, force in zip(now.places, now.forces, strict=True)
        )
        poses = {OBJECT: self._world.object_pose}
        return Facts(self.stamp, root, contacts, standing(self.stamp, root, poses))

    def seen(self, eye: Eye, places: FloatArray) -> tuple[NDArray[np.uint8], FloatArray]:
        """Give a picture, shape (height, width, 3), and where places (n, 3) [m] are in it."""
        return self._world.seen(eye, places)

    def _force(self) -> float:
        return float(np.linalg.norm(self._world.touching().forces, axis=1).sum())

    def _felt(self) -> Iterator[Wrench]:
        """Read the wrists, which tell no more than their range."""
        for wrench in self._sensors.wrenches(self.stamp, self._world.felt()):
            if self.config.wrench_range is None:
                yield wrench
                continue
            force, torque = self.config.wrench_range
            yield replace(
                wrench,
                force=np.clip(wrench.force, -force, force),
                torque=np.clip(wrench.torque, -torque, torque),
            )
