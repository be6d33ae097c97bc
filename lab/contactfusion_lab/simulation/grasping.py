"""A pipeline and its controller grasp: the closed loop of scene, contacts and commands."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from contactfusion.controllers.grasp_parameters import ENDS, GraspMode
from contactfusion.errors import ConfigurationError
from contactfusion.hooks import hookimpl
from contactfusion.pipeline import Pipeline, Step
from contactfusion.readings import Reading
from contactfusion.robots.description import RobotConfig
from contactfusion.robots.model import shared_robot
from contactfusion.scene import Facts, Hear, Scene, Verdict
from contactfusion_lab.simulation.grasp import GraspScene, GraspTruth
from contactfusion_lab.simulation.grasp_config import GraspConfig

TIMEOUT = "timeout"
"""How a grasp ends whose controller comes to no end."""
WAYS = (GraspMode.APPROACH, GraspMode.BACK, GraspMode.ASIDE, GraspMode.ENTER)
"""In these the hand is on its way to the object."""
FALLEN = math.radians(45.0)
"""An object whose z leans over by more has fallen."""


@dataclass(frozen=True, eq=False)
class GraspCycle:
    """One cycle of a grasp.

    Attributes:
        readings: what the sensors read.
        step: what the pipeline made of it.
        truth: what really happened.
        ending: why the grasp ends with this cycle: an end of the controller, or "timeout"; empty:
            it goes on.
    """

    readings: list[Reading]
    step: Step
    truth: GraspTruth
    ending: str


def grasped(
    scene: GraspScene, pipeline: Pipeline, hear: Hear = lambda reading: None
) -> Iterator[GraspCycle]:
    """Let a pipeline grasp until it ends; the controller hears readings, never the truth.

    Args:
        scene: at its start.
        pipeline: with a controller.
        hear: who hears every reading before the pipeline.

    Raises:
        ConfigurationError: the pipeline has no controller, or its controller failed.
    """
    while True:
        readings = scene.readings()
        for reading in readings:
            hear(reading)
            pipeline.receive(reading)
        step, truth = pipeline.step(scene.stamp), scene.truth()
        command = step.command
        if command is None:
            raise ConfigurationError("a grasp needs a controller", "controller")
        if command.twist is None and command.joint_velocities is None:
            raise ConfigurationError(
                f"the controller gave no velocity: {command.reason}", "controller"
            )
        ending = command.mode if command.mode in ENDS else ""
        if not ending and scene.stamp >= scene.config.longest:
            ending = TIMEOUT
        yield GraspCycle(readings, step, truth, ending)
        if ending:
            return
        scene.obey(command)


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


def result_of(cycles: Sequence[GraspCycle], lifted: float, held: float) -> GraspResult:
    """Measure a grasp.

    Args:
        cycles: all of it.
        lifted: how much higher the object has to be [m].
        held: for how long at the end [s].
    """
    first, last = cycles[0].truth, cycles[-1].truth
    modes = [cycle.step.command.mode if cycle.step.command else "" for cycle in cycles]
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
        self._cycles: list[GraspCycle] = []

    @classmethod
    def opened(cls, config: GraspConfig, robot: RobotConfig, seed: int) -> Self:
        """A grasp at its start."""
        return cls(GraspScene(config, shared_robot(robot), seed))

    def run(self, pipeline: Pipeline, hear: Hear) -> Iterator[Step]:
        """Let a pipeline grasp until it ends.

        Raises:
            ConfigurationError: the pipeline has no controller, or its controller failed.
        """
        for cycle in grasped(self._scene, pipeline, hear):
            self._cycles.append(cycle)
            yield cycle.step

    def facts(self) -> Facts:
        """Tell where the robot is touched, and where the object stands."""
        return self._scene.facts()

    def verdict(self, pipeline: Pipeline, last: Step) -> Verdict:
        """Tell how the grasp ended, and whether the object is really held."""
        config, ending = self._scene.config, self._cycles[-1].ending
        result = result_of(self._cycles, config.lifted, config.held)
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
