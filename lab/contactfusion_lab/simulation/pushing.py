"""A pipeline and its controller push: the closed loop of scene, contacts and commands."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

from contactfusion.controllers.pushing import ARRIVED
from contactfusion.errors import ConfigurationError
from contactfusion.hooks import hookimpl
from contactfusion.pipeline import Pipeline, Step
from contactfusion.readings import Reading, Twist
from contactfusion.robots.description import RobotConfig
from contactfusion.scene import Facts, Hear, Scene, Verdict
from contactfusion_lab.simulation.push import PushScene, PushTruth
from contactfusion_lab.simulation.push_config import PushConfig


class Ending(StrEnum):
    """Why a push ended."""

    ARRIVED = "arrived"
    """The controller declared arrival."""
    TIMEOUT = "timeout"
    """It took too long."""
    LOST = "lost"
    """There was no contact for too long, all in all."""
    AWAY = "away"
    """The object is too far away."""


@dataclass(frozen=True, eq=False)
class Cycle:
    """One cycle of a push.

    Attributes:
        readings: what the sensors read.
        step: what the pipeline made of it.
        truth: what really happened.
        ending: why the push ends with this cycle; None: it goes on.
    """

    readings: list[Reading]
    step: Step
    truth: PushTruth
    ending: Ending | None


def pushed(
    scene: PushScene, pipeline: Pipeline, hear: Hear = lambda reading: None
) -> Iterator[Cycle]:
    """Let a pipeline push until it ends; the controller hears readings, never the truth.

    Args:
        scene: at its start.
        pipeline: with a controller.
        hear: who hears every reading before the pipeline.

    Raises:
        ConfigurationError: the pipeline has no controller, or its controller failed.
    """
    config, lost = scene.config, 0.0
    while True:
        readings = scene.readings()
        for reading in readings:
            hear(reading)
            pipeline.receive(reading)
        step, truth = pipeline.step(scene.stamp), scene.truth()
        twist = _twist(step)
        lost += config.period * (truth.kind == "none" and scene.stamp > 0.0)
        ending = None
        if step.command is not None and step.command.mode == ARRIVED:
            ending = Ending.ARRIVED
        elif math.hypot(*truth.object[:2]) > config.furthest:
            ending = Ending.AWAY
        elif lost > config.longest_lost:
            ending = Ending.LOST
        elif scene.stamp >= config.longest:
            ending = Ending.TIMEOUT
        yield Cycle(readings, step, truth, ending)
        if ending is not None:
            return
        scene.drive(float(twist.linear[0]), float(twist.linear[1]), float(twist.angular[2]))


def _twist(step: Step) -> Twist:
    command = step.command
    if command is None:
        raise ConfigurationError("a push needs a controller", "controller")
    if command.twist is None:
        raise ConfigurationError(f"the controller gave no twist: {command.reason}", "controller")
    return command.twist


class Pushing(Scene):
    """A push by the controller of whatever pipeline listens.

    Args:
        scene: at its start.
    """

    Config = PushConfig

    def __init__(self, scene: PushScene) -> None:
        self._scene = scene
        self._last: Cycle | None = None

    @classmethod
    def opened(cls, config: PushConfig, robot: RobotConfig, seed: int) -> Self:
        """A push at its start."""
        return cls(PushScene(config, robot, seed))

    def run(self, pipeline: Pipeline, hear: Hear) -> Iterator[Step]:
        """Let a pipeline push until it ends.

        Raises:
            ConfigurationError: the pipeline has no controller, its controller failed, or pushes to
                another target than the scene's.
        """
        target = (pipeline.config.controller or {}).get("target", self._scene.config.target)
        if tuple(target) != self._scene.config.target:
            raise ConfigurationError(
                f"the controller pushes to {tuple(target)}, but the scene's target is "
                f"{self._scene.config.target}",
                "controller.target",
            )
        for cycle in pushed(self._scene, pipeline, hear):
            self._last = cycle
            yield cycle.step

    def facts(self) -> Facts:
        """Tell the true contact, and where the object stands."""
        return self._scene.facts()

    def verdict(self, pipeline: Pipeline, last: Step) -> Verdict:
        """Tell how the push ended, and where the object truly touches then."""
        assert self._last is not None  # run has given `last`
        truth, ending = self._last.truth, self._last.ending
        within = self._scene.config.within
        success = ending == Ending.ARRIVED and truth.distance <= within
        if truth.kind == "none":
            touches = "the object does not touch the robot"
        else:
            touches = f"the object touches {truth.distance:.3f} m from the target"
        told = {
            "ending": str(ending),
            "time": truth.stamp,
            "success": success,
            "kind": truth.kind,
            "distance": None if math.isnan(truth.distance) else truth.distance,
            "base": list(truth.base),
            "object": list(truth.object),
        }
        word = "success" if success else "no success"
        return Verdict(told, (f"{ending} after {truth.stamp:.1f} s; {touches}: {word}",))


@hookimpl
def contactfusion_scenes() -> dict[str, type[Scene]]:
    """Offer the scene."""
    return {"push": Pushing}
