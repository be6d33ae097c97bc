"""A grasp: what sensors read, what is true, and the loop with a pipeline and its controller."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.controller import Command
from contactfusion.controllers.grasp_parameters import ENDS, GraspMode
from contactfusion.errors import ConfigurationError, RobotError
from contactfusion.frames import Pose
from contactfusion.hooks import hookimpl
from contactfusion.loop import play
from contactfusion.pipeline import Pipeline, Step
from contactfusion.readings import JointCommand, Reading, Wrench
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import RobotModel, shared_robot
from contactfusion.robots.objects import ObjectModel
from contactfusion.scene import Scene
from contactfusion.stream import Arrival, Facts, Verdict
from contactfusion_lab.scenes.approach import led_by
from contactfusion_lab.scenes.arm import STEP
from contactfusion_lab.scenes.facts import standing, true_contact
from contactfusion_lab.scenes.grasp.config import GraspConfig
from contactfusion_lab.scenes.grasp.driver import GraspDriver
from contactfusion_lab.scenes.grasp.placing import check_names, facing, placed, starting
from contactfusion_lab.scenes.grasp.world import Eye, GraspWorld
from contactfusion_lab.scenes.touch.sensors import TouchSensors
from contactfusion_lab.scenes.touch.world import contacts_of

OBJECT = "object"
"""What the truth calls the object, whichever it is."""
WRENCHES = 10
"""Wrists are read after so many steps of the physics."""
SETTLING = 0.3
"""What stands on the table settles so long before the grasp begins [s]."""
TIMEOUT = "timeout"
"""How a grasp ends whose controller comes to no end."""
WAYS = (GraspMode.APPROACH, GraspMode.BACK, GraspMode.ASIDE, GraspMode.ENTER)
"""In these the hand is on its way to the object."""
FALLEN = math.radians(45.0)
"""An object whose z leans over by more has fallen."""


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
        """What wrists have read since the last command, then joints, skins and cameras."""
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
        """What really happens now."""
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
        """Where the robot is touched now, and where the object stands."""
        root, now = self.robot.root, contacts_of([self._world.touching()])
        contacts = tuple(
            true_contact(self.stamp, root, place, force)
            for place, force in zip(now.places, now.forces, strict=True)
        )
        poses = {OBJECT: self._world.object_pose}
        return Facts(self.stamp, root, contacts, standing(self.stamp, root, poses))

    def seen(self, eye: Eye, places: FloatArray) -> tuple[NDArray[np.uint8], FloatArray]:
        """A picture, shape (height, width, 3), and where places (n, 3) [m] are in it."""
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


@dataclass(frozen=True, eq=False)
class GraspMoment:
    """What really happened in a cycle of a grasp.

    Attributes:
        truth: of the world.
        mode: of the controller then.
        ending: why the grasp ends with this cycle: an end of the controller, or "timeout"; empty:
            it goes on.
    """

    truth: GraspTruth
    mode: str
    ending: str


@dataclass(frozen=True, eq=False)
class GraspCycle(GraspMoment):
    """One cycle of a grasp.

    Attributes:
        readings: what the sensors read.
        step: what the pipeline made of it.
    """

    readings: list[Reading]
    step: Step


def grasped(scene: GraspScene, pipeline: Pipeline) -> Iterator[GraspCycle]:
    """The cycles of a grasp; the controller hears readings, never the truth.

    Args:
        scene: at its start.
        pipeline: with a controller.

    Raises:
        ConfigurationError: the pipeline has no controller, or its controller failed.
    """
    grasping = Grasping(scene)
    for step in play(pipeline, grasping):
        yield grasping.cycle(step)


@dataclass(frozen=True)
class GraspResult:
    """What came of a grasp.

    Attributes:
        success: the object was high enough for long enough, up to the end, and touched nothing but
            the robot.
        height: how much higher it was in the end [m].
        moved: how far it had been moved level when the gripper began to close for the last time, or
            in the end if it never did [m].
        fallen: whether it has fallen over, and lies there.
        corrections: how often the hand went back.
        time: it took [s].
        force: the greatest that pushed the robot on its way, from the first approach on, but while
            it closed, and after it: the sum over all that touched it [N].
    """

    success: bool
    height: float
    moved: float
    fallen: bool
    corrections: int
    time: float
    force: float


def result_of(cycles: Sequence[GraspMoment], lifted: float, held: float) -> GraspResult:
    """Measure a grasp.

    Args:
        cycles: all of it.
        lifted: how much higher the object has to be [m].
        held: for how long at the end [s].
    """
    first, last = cycles[0].truth, cycles[-1].truth
    modes = [cycle.mode for cycle in cycles]
    heights = np.array([cycle.truth.object[2, 3] for cycle in cycles]) - first.object[2, 3]
    stamps = np.array([cycle.truth.stamp for cycle in cycles])
    late = stamps >= last.stamp - held
    closing = [row for row in range(1, len(modes)) if modes[row] == "close" != modes[row - 1]]
    before = cycles[closing[-1]].truth if closing else last
    # what has been felt up to a cycle was felt in the mode before it
    on_the_way = [cycle for mode, cycle in zip(modes, cycles[1:], strict=False) if mode in WAYS]
    turned = first.object[:3, 2] @ last.object[:3, 2]
    high = (heights[late] >= lifted) & ~np.array([cycle.truth.supported for cycle in cycles])[late]
    return GraspResult(
        success=bool(last.stamp >= held and high.all() and last.touched),
        height=float(heights[-1]),
        moved=float(np.linalg.norm((before.object - first.object)[:2, 3])),
        fallen=last.supported and float(turned) < math.cos(FALLEN),
        corrections=sum(a != b == "back" for a, b in zip(modes, modes[1:], strict=False)),
        time=last.stamp,
        force=max((cycle.truth.force for cycle in on_the_way), default=0.0),
    )


class Grasping(Scene):
    """A grasp by the controller of whatever pipeline listens.

    Args:
        scene: at its start.
    """

    Config = GraspConfig

    def __init__(self, scene: GraspScene) -> None:
        self._scene = scene
        self._readings: list[Reading] = []
        self._command: Command | None = None
        self._moments: list[GraspMoment] = []

    @classmethod
    def opened(cls, config: GraspConfig, robot: RobotConfig, seed: int) -> Self:
        """A grasp at its start."""
        return cls(GraspScene(config, shared_robot(robot), seed))

    def readings(self) -> Iterator[Reading]:
        """What the sensors read."""
        return (reading for arrival in self.arrivals() for reading in arrival.readings)

    def arrivals(self) -> Iterator[Arrival]:
        """What the sensors read in each cycle, at its end, until the grasp ends."""
        while not (self._moments and self._moments[-1].ending):
            if self._command is not None:
                self._scene.obey(self._command)
            self._readings = self._scene.readings()
            yield Arrival(self._scene.stamp, tuple(self._readings), due=True)

    def send(self, command: Command | None) -> None:
        """Take the command of the next cycle, and note how this one ended.

        Raises:
            ConfigurationError: there is no controller, or it failed.
        """
        scene, truth = self._scene, self._scene.truth()
        if command is None:
            raise ConfigurationError("a grasp needs a controller", "controller")
        if command.twist is None and command.joint_velocities is None:
            raise ConfigurationError(
                f"the controller gave no velocity: {command.reason}", "controller"
            )
        ending = command.mode if command.mode in ENDS else ""
        if not ending and scene.stamp >= scene.config.longest:
            ending = TIMEOUT
        self._command = command
        self._moments.append(GraspMoment(truth, command.mode, ending))

    def cycle(self, step: Step) -> GraspCycle:
        """The cycle that a step closed."""
        return GraspCycle(**vars(self._moments[-1]), readings=self._readings, step=step)

    def facts(self) -> Facts:
        """Where the robot is touched, and where the object stands."""
        return self._scene.facts()

    def verdict(self, pipeline: Pipeline, last: Step) -> Verdict:
        """How the grasp ended, and whether the object is really held."""
        config, ending = self._scene.config, self._moments[-1].ending
        result = result_of(self._moments, config.lifted, config.held)
        word = "success" if result.success else "no success"
        more = ", fallen over" if result.fallen else ""
        times = f"{result.corrections} correction{'' if result.corrections == 1 else 's'}"
        told = {"ending": ending, **vars(result)}
        return Verdict(
            told,
            (
                f"{ending} after {result.time:.1f} s and {times}; the "
                f"object is {100.0 * result.height:.1f} cm higher{more}: {word}",
            ),
        )


@hookimpl
def contactfusion_scenes() -> dict[str, type[Scene]]:
    """Offer the scene."""
    return {"grasp": Grasping}
