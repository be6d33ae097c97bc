"""Stop-watches for a push: what fusing costs, and what making readings up."""

import time
from dataclasses import dataclass
from typing import final

from contactfusion.arrays import FloatArray
from contactfusion.pipeline import Ask, Pipeline, Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.robots.description import RobotConfig
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import PushScene


@dataclass(frozen=True, eq=False)
class Cost:
    """What a push took.

    Attributes:
        simulated: [s].
        cpu: of all of it [s].
        sensed: of making up what the sensors read [s].
        fused: shape (n,), of receiving and stepping in each cycle [s].
    """

    simulated: float
    cpu: float
    sensed: float
    fused: FloatArray


@final
class StopWatch(Pipeline):
    """A pipeline that adds up the CPU time it takes, cycle by cycle.

    Args:
        config: the configuration.
        ask: how a generator is asked for its clouds.
    """

    def __init__(self, config: PipelineConfig, ask: Ask) -> None:
        super().__init__(config, ask)
        self.cycles = [0.0]
        """Of each cycle so far, and of the one that has begun [s]."""

    def receive(self, reading: Reading) -> None:
        """Receive a reading."""
        start = time.process_time()
        super().receive(reading)
        self.cycles[-1] += time.process_time() - start

    def step(self, now: float) -> Step:
        """Step."""
        start = time.process_time()
        step = super().step(now)
        self.cycles[-1] += time.process_time() - start
        self.cycles.append(0.0)
        return step


@final
class WatchedScene(PushScene):
    """A scene that adds up the CPU time that its readings take.

    Args:
        config: the push.
        robot: the base.
        seed: of all chance.
    """

    def __init__(self, config: PushConfig, robot: RobotConfig, seed: int) -> None:
        super().__init__(config, robot, seed)
        self.sensed = 0.0
        """So far [s]."""

    def readings(self) -> list[Reading]:
        """Give what the sensors read now."""
        start = time.process_time()
        readings = super().readings()
        self.sensed += time.process_time() - start
        return readings
