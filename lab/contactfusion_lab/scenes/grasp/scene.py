"""A grasp: readings, ground truth, and the loop with a pipeline and its controller."""

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
from contactfusion.frames import Pose, points_in
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
from contactfusion_lab.scenes.as_built import as_built
from contactfusion_lab.scenes.clutter import clutter, points_of
from contactfusion_lab.scenes.facts import standing, true_contact
from contactfusion_lab.scenes.grasp.config import GraspConfig
from contactfusion_lab.scenes.grasp.driver import GraspDriver
from contactfusion_lab.scenes.grasp.placing import check_names, facing, placed, starting
from contactfusion_lab.scenes.grasp.world import GraspWorld, Viewpoint
from contactfusion_lab.scenes.sensor_errors import Arrivals
from contactfusion_lab.scenes.touch.sensors import TouchSensors
from contactfusion_lab.scenes.touch.world import contacts_of

OBJECT = "object"
"""Name of the object in the ground truth, whichever it is."""
WRENCHES = 10
"""Steps of the physics between readings of the wrists."""
SETTLING = 0.3
"""Time for objects on the table to settle before the grasp begins [s]."""
TIMEOUT = "timeout"
"""Ending of a grasp whose controller does not end it."""
APPROACH_MODES = (GraspMode.APPROACH, GraspMode.BACK, GraspMode.ASIDE, GraspMode.ENTER)
"""Modes in which the hand is on its path to the object."""
NEARLY, SAMPLES = 0.8, 7
"""On the first part of its way to the object's axis, at so many places, the hand is kept free of
clutter."""
FALLEN = math.radians(45.0)
"""Tilt of the object's z beyond which it has fallen [rad]."""


@dataclass(frozen=True, eq=False)
class GraspTruth:
    """Ground truth of a grasp at one instant.

    Attributes:
        stamp: [s].
        object: the pose of the object in the root link's frame.
        tool: the pose of the tool there.
        joints: shape (n,), joint positions [rad, m].
        touched: whether the robot touches the object.
        supported: whether any other body does, such as the table.
        force: greatest sum of the magnitudes of all contact forces on the robot since the last
            such truth, sampled at 100 Hz [N].
    """

    stamp: float
    object: Pose
    tool: Pose
    joints: FloatArray
    touched: bool
    supported: bool
    force: float


class GraspScene:
    """One grasp: commands in, readings out.

    Args:
        config: the grasp.
        robot: the robot, its root link at the origin.
        seed: of all random draws.

    Raises:
        RobotError: the robot lacks a link that is named, cannot reach where the grasp begins, or
            would touch something there; or the object cannot be loaded.
        ConfigurationError: a joint or the frame of an object is not what it should be.
    """

    def __init__(self, config: GraspConfig, robot: RobotModel, seed: int = 0) -> None:
        check_names(config, robot)
        self.config, self.robot = config, robot
        rng = np.random.default_rng(seed)
        self._object = ObjectModel(config.object)
        self._around = {name: ObjectModel(fixed) for name, fixed in config.surroundings.items()}
        # images and parts of the noise change no draw of others
        image_rng, surface_rng, clutter_rng, late_rng = rng.spawn(4)
        with as_built(robot, config.noise.surface, surface_rng) as built:
            self._world = GraspWorld(
                built,
                self._around,
                self._object,
                config.mass,
                config.friction,
                config.table_friction,
            )
        self._built = built
        azimuth = float(np.radians(rng.uniform(*config.azimuth)))
        self._world.put(placed(config, azimuth, rng))
        start = starting(config, robot, facing(config, azimuth), rng)
        if self._world.blocked(start):
            raise RobotError("the robot would touch something where the grasp begins")
        self._clutter: list[ObjectModel] = []
        if config.noise.clutter:
            self._clutter = self._cluttered(azimuth, start, clutter_rng)
            self._world.stand(self._clutter)
        leading = led_by(robot, config.tool)
        self._stuck = np.array([name in config.stuck for name in robot.joint_names])
        # a joint that is stuck yields as little as the arm, and stays where it began
        stiff = self._stuck | (leading > 0.0)
        stiffness = np.where(stiff, config.arm_stiffness, config.noise.finger_stiffness)
        self._arm = self._world.arm(start, stiffness)
        self._driver = GraspDriver(
            robot, config.tool, config.gripper, config.grip, config.press, self._arm.stiffness,
            start,
        )  # fmt: skip
        self._sensors = TouchSensors(
            robot, config.tool, leading, start, config.noise, rng, image_rng
        )
        self._start = start
        for _ in range(round(SETTLING / STEP)):
            self._arm.step(start)
        self._steps, self._waiting = 0, list[Reading]()
        self._late = Arrivals(config.noise.delays, late_rng)
        self._gripper: float | None = None
        self._pressed = 0.0
        self._last_image = -np.inf

    @property
    def stamp(self) -> float:
        """The time [s]."""
        return self._steps * STEP

    def readings(self) -> list[Reading]:
        """Readings of the wrists since the last command, then of joints, skins and cameras.

        Those that are late are among the readings of a later cycle.
        """
        poses = self.robot.poses_at(self._arm.positions)
        readings, self._waiting = self._waiting, []
        readings.append(self._sensors.joints(self.stamp, self._arm.positions, self._arm.velocities))
        readings += self._sensors.skins(self.stamp, poses, self._world.touching())
        rate = self.config.camera_rate
        if rate and self.stamp - self._last_image >= 1.0 / rate - STEP:
            self._last_image = self.stamp
            bodies = [(solid, poses[name]) for name, solid in self._built.solids.items()]
            fixed = (*self._around.values(), *self._clutter)
            bodies += [(model.solid, model.config.pose.pose()) for model in fixed]
            bodies.append((self._object.solid, self._world.object_pose))
            readings += self._sensors.sights(self.stamp, poses, bodies)
        return self._late.until(self.stamp, readings)

    def obey(self, command: Command) -> None:
        """One cycle, in which arm and hand follow a command.

        Raises:
            ConfigurationError: the command does not fit the robot.
        """
        self._driver.obey(command)
        if command.gripper is not None and command.gripper != self._gripper:
            self._gripper = command.gripper
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
            commanded = self._driver.advance(self._arm.positions)
            self._arm.step(np.where(self._stuck, self._start, commanded))
            self._steps += 1
            if self._steps % WRENCHES == 0:
                self._waiting += self._felt()
                self._pressed = max(self._pressed, self._force())

    def truth(self) -> GraspTruth:
        """The ground truth now."""
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
        """The true contacts on the robot now, and the true pose of the object."""
        root, now = self.robot.root, contacts_of([self._world.touching()])
        contacts = tuple(
            true_contact(self.stamp, root, position, force)
            for position, force in zip(now.places, now.forces, strict=True)
        )
        poses = {OBJECT: self._world.object_pose}
        return Facts(self.stamp, root, contacts, standing(self.stamp, root, poses))

    def seen(
        self, viewpoint: Viewpoint, positions: FloatArray
    ) -> tuple[NDArray[np.uint8], FloatArray]:
        """A picture, shape (height, width, 3), and the pixels of positions (n, 3) [m] in it."""
        return self._world.seen(viewpoint, positions)

    def _cluttered(
        self, azimuth: float, start: FloatArray, rng: np.random.Generator
    ) -> list[ObjectModel]:
        """Bodies around the object, none of them in the open hand's path to it.

        The path leads to where the object is believed, or to where it is.

        Args:
            azimuth: direction from the object to the hand [rad].
            start: shape (n,), joint positions at the start [rad, m].
            rng: draws the bodies.
        """
        robot, config, there = self.robot, self.config, self._world.object_pose
        opened = start.copy()
        for name, (position, _) in config.gripper.items():
            opened[robot.joint_names.index(name)] = position
        poses = robot.poses_at(opened)
        hand, tool = set(robot.beyond(config.tool)), poses[config.tool]
        open_hand = np.concatenate([*points_of(robot, poses, hand)])
        beside = (there[:3, 3] - config.object.pose.pose()[:3, 3]) @ tool[:3, 0]
        free = [*points_of(robot, poses, {*robot.link_names} - hand)]
        free += [
            open_hand + aside * tool[:3, 0] + ahead * tool[:3, 2]
            for aside in (0.0, beside)
            for ahead in np.linspace(0.0, NEARLY * config.distance, SAMPLES)
        ]
        corners = [points_in(there, vertices) for vertices, _ in self._object.solid.meshes]
        return clutter(robot.root, np.concatenate(corners), azimuth, np.concatenate(free), rng)

    def _force(self) -> float:
        return float(np.linalg.norm(self._world.touching().forces, axis=1).sum())

    def _felt(self) -> Iterator[Wrench]:
        """Readings of the wrists, which saturate at their range."""
        felt = self._sensors.wrenches(self.stamp, self._arm.positions, self._world.felt())
        for wrench in felt:
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
    """Ground truth of a cycle of a grasp.

    Attributes:
        truth: of the world.
        mode: of the controller then.
        ending: why the grasp ends with this cycle: an end of the controller, or "timeout"; empty:
            it continues.
    """

    truth: GraspTruth
    mode: str
    ending: str


@dataclass(frozen=True, eq=False)
class GraspCycle(GraspMoment):
    """One cycle of a grasp.

    Attributes:
        readings: of the sensors.
        step: of the pipeline, from them.
    """

    readings: list[Reading]
    step: Step


def grasped(scene: GraspScene, pipeline: Pipeline) -> Iterator[GraspCycle]:
    """The cycles of a grasp; the controller receives readings, never the truth.

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
    """The result of a grasp.

    Attributes:
        success: the object was high enough for long enough, up to the end, and touched by nothing
            but the robot.
        height: of the object above its start, at the end [m].
        moved: horizontal displacement of the object when the gripper began to close for the last
            time, or at the end if it never did [m].
        fallen: whether the object has fallen over, and lies there.
        corrections: how often the hand went back.
        time: duration of the grasp [s].
        force: greatest sum of contact forces on the robot on its path, from the first approach on,
            without the cycles in which the gripper closed, and those after it [N].
    """

    success: bool
    height: float
    moved: float
    fallen: bool
    corrections: int
    time: float
    force: float


def result_of(cycles: Sequence[GraspMoment], lifted: float, held: float) -> GraspResult:
    """The result of a grasp.

    Args:
        cycles: all of the grasp.
        lifted: least height above the start for success [m].
        held: how long at the end the object has to be there [s].
    """
    first, last = cycles[0].truth, cycles[-1].truth
    modes = [cycle.mode for cycle in cycles]
    heights = np.array([cycle.truth.object[2, 3] for cycle in cycles]) - first.object[2, 3]
    stamps = np.array([cycle.truth.stamp for cycle in cycles])
    late = stamps >= last.stamp - held
    closing = [row for row in range(1, len(modes)) if modes[row] == "close" != modes[row - 1]]
    before = cycles[closing[-1]].truth if closing else last
    # the force of a cycle acted in the mode of the cycle before
    approaching = [
        cycle for mode, cycle in zip(modes, cycles[1:], strict=False) if mode in APPROACH_MODES
    ]
    turned = first.object[:3, 2] @ last.object[:3, 2]
    high = (heights[late] >= lifted) & ~np.array([cycle.truth.supported for cycle in cycles])[late]
    return GraspResult(
        success=bool(last.stamp >= held and high.all() and last.touched),
        height=float(heights[-1]),
        moved=float(np.linalg.norm((before.object - first.object)[:2, 3])),
        fallen=last.supported and float(turned) < math.cos(FALLEN),
        corrections=sum(a != b == "back" for a, b in zip(modes, modes[1:], strict=False)),
        time=last.stamp,
        force=max((cycle.truth.force for cycle in approaching), default=0.0),
    )


class Grasping(Scene):
    """A grasp by the controller of the pipeline that plays it.

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
        """The readings of the sensors."""
        return (reading for arrival in self.arrivals() for reading in arrival.readings)

    def arrivals(self) -> Iterator[Arrival]:
        """The readings of each cycle, at its end, until the grasp ends."""
        while not (self._moments and self._moments[-1].ending):
            if self._command is not None:
                self._scene.obey(self._command)
            self._readings = self._scene.readings()
            yield Arrival(self._scene.stamp, tuple(self._readings), due=True)

    def send(self, command: Command | None) -> None:
        """Accept the command of the next cycle, and record how this one ended.

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
        """True contacts of the robot, and the pose of the object."""
        return self._scene.facts()

    def verdict(self, pipeline: Pipeline, last: Step) -> Verdict:
        """The ending of the grasp, and whether the object is truly held."""
        config, ending = self._scene.config, self._moments[-1].ending
        result = result_of(self._moments, config.lifted, config.held)
        word = "success" if result.success else "no success"
        more = ", fallen over" if result.fallen else ""
        times = f"{result.corrections} correction{'' if result.corrections == 1 else 's'}"
        values = {"ending": ending, **vars(result)}
        return Verdict(
            values,
            (
                f"{ending} after {result.time:.1f} s and {times}; the "
                f"object is {100.0 * result.height:.1f} cm higher{more}: {word}",
            ),
        )


@hookimpl
def contactfusion_scenes() -> dict[str, type[Scene]]:
    """The scene, as a plug-in."""
    return {"grasp": Grasping}
