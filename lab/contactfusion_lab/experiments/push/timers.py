"""How fast pushes are made, and what part of it is fusion; told apart from the results."""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.files import write_whole
from contactfusion.pipeline import Ask, Pipeline, Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.robots.description import RobotConfig
from contactfusion.terminal import note
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

    def take(self, reading: Reading) -> None:
        """Take a reading."""
        start = time.process_time()
        super().take(reading)
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
        """What the sensors read now."""
        start = time.process_time()
        readings = super().readings()
        self.sensed += time.process_time() - start
        return readings


def tell_costs(costs: Mapping[str, Sequence[Cost]], out: Path) -> None:
    """Print what pushes took, and write it to timing.json.

    Args:
        costs: of the pushes of this run, by what felt.
        out: the folder of the results.
    """
    told = {label: costs_of(part) for label, part in costs.items()}
    write_whole(out / "timing.json", json.dumps(told, indent=1) + "\n")
    for label, one in told.items():
        note(
            f"{label}: {one['trials_per_cpu_minute']:.0f} pushes a minute of CPU time, "
            f"{one['simulated_s_per_cpu_s']:.0f} times as fast as real; sensors take "
            f"{one['sensing_share']:.0%} of it, generators, fusion and controller "
            f"{one['fusion_share']:.0%}: {one['cycle_p50_ms']:.2f} ms a cycle, "
            f"p99 {one['cycle_p99_ms']:.2f} ms"
        )


def costs_of(costs: Sequence[Cost]) -> dict[str, float]:
    """Rates, shares and quantiles of what pushes took.

    Args:
        costs: of pushes that were felt in one way.
    """
    cpu, simulated = sum(one.cpu for one in costs), sum(one.simulated for one in costs)
    cycles = np.concatenate([one.fused for one in costs])
    p50, p99 = np.quantile(cycles, [0.5, 0.99]).tolist()
    return {
        "trials": len(costs),
        "cpu_s": cpu,
        "trials_per_cpu_minute": 60.0 * len(costs) / cpu,
        "simulated_s_per_cpu_s": simulated / cpu,
        "sensing_share": sum(one.sensed for one in costs) / cpu,
        "fusion_share": float(cycles.sum()) / cpu,
        "cycle_p50_ms": p50 * 1e3,
        "cycle_p99_ms": p99 * 1e3,
    }
