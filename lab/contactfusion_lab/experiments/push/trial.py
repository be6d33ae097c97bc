"""One push of the experiment by one controller: its track, cycle by cycle, and what it cost."""

import json
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.contacts import Contact
from contactfusion.controllers.face import FaceConfig, on_face
from contactfusion.errors import ConfigurationError
from contactfusion.files import read_arrays, write_whole
from contactfusion.hypotheses import HypothesisKind
from contactfusion.pipeline import Ask, Pipeline, Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.robots.description import RobotConfig
from contactfusion.terminal import note
from contactfusion_lab.experiments.push.plan import Plan, Push
from contactfusion_lab.scenes.push.config import PushConfig
from contactfusion_lab.scenes.push.scene import Cycle, PushScene, pushed
from contactfusion_lab.trials.folder import as_npz

KINDS = ("none", "point", "line")
"""Kinds of contact."""


@dataclass(frozen=True, eq=False)
class Track:
    """One push by one controller; n cycles.

    Attributes:
        push: which.
        sensing: label of the sensor suite.
        controller: by name.
        ending: why it ended.
        within: goal tolerance of the contact [m].
        period: of a cycle [s].
        modes: the names of the controller's modes.
        sources: the kind of each source but Null ones, by name.
        stamp: shape (n,) [s].
        base: shape (n, 3), x, y [m] and yaw [rad] of the robot in `odom`.
        object: shape (n, 3), of the object likewise.
        kind: shape (n,), the true kind of contact as a row of `KINDS`.
        contact: shape (n, 2), the true contact in the robot's frame [m], NaN without.
        distance: shape (n,), from the true contact to the target [m], NaN without.
        force: shape (n,), of the object on the robot [N].
        lateral: shape (n,), the contact as it was estimated, to the left [m], NaN without.
        estimate: shape (n,), its estimated kind.
        shares: shape (n, k), of each source in the contacts on the face; they add up to 1, or to 0
            without one.
        mode: shape (n,), of the controller, as a row of `modes`.
        command: shape (n, 3), forward, lateral [m/s], yaw rate [rad/s].
    """

    push: Push
    sensing: str
    controller: str
    ending: str
    within: float
    period: float
    modes: tuple[str, ...]
    sources: Mapping[str, str]
    stamp: FloatArray
    base: FloatArray
    object: FloatArray
    kind: NDArray[np.uint8]
    contact: FloatArray
    distance: FloatArray
    force: FloatArray
    lateral: FloatArray
    estimate: NDArray[np.uint8]
    shares: FloatArray
    mode: NDArray[np.uint8]
    command: FloatArray


NAMED = ("push", "sensing", "controller", "ending", "within", "period", "modes", "sources")
ARRAYS = tuple(field.name for field in fields(Track) if field.name not in NAMED)


@dataclass(frozen=True, eq=False)
class Cost:
    """The cost of a push.

    Attributes:
        simulated: [s].
        cpu: of all of it [s].
        sensed: of simulating the readings [s].
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
        ask: the function that calls a generator for its clouds.
    """

    def __init__(self, config: PipelineConfig, ask: Ask) -> None:
        super().__init__(config, ask)
        self.cycles = [0.0]
        """CPU time of each cycle so far, and of the one that has begun [s]."""

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
        seed: of all random draws.
    """

    def __init__(self, config: PushConfig, robot: RobotConfig, seed: int) -> None:
        super().__init__(config, robot, seed)
        self.sensed = 0.0
        """CPU time of readings so far [s]."""

    def readings(self) -> list[Reading]:
        """The readings of the sensors now."""
        start = time.process_time()
        readings = super().readings()
        self.sensed += time.process_time() - start
        return readings


def run_trial(plan: Plan, push: Push, controller: str) -> tuple[Track, Cost]:
    """Push once.

    Raises:
        ContactFusionError: the scene cannot be set up, or the controller failed.
    """
    start = time.process_time()
    scene = WatchedScene(plan.scene_of(push), plan.robot, push.seed)
    pipeline = StopWatch(plan.pipeline_of(push, controller), plan.sensing.ask)
    track = track_of(plan, push, controller, pushed(scene, pipeline))
    cpu = time.process_time() - start
    return track, Cost(float(track.stamp[-1]), cpu, scene.sensed, np.array(pipeline.cycles[:-1]))


def push_cycles(plan: Plan, push: Push, pipeline: Pipeline) -> Iterator[Cycle]:
    """The cycles of a push by a pipeline.

    Raises:
        ContactFusionError: the scene cannot be set up, or the controller failed.
    """
    return pushed(PushScene(plan.scene_of(push), plan.robot, push.seed), pipeline)


def track_of(plan: Plan, push: Push, controller: str, cycles: Iterable[Cycle]) -> Track:
    """The track of all cycles: what the measures need."""
    truths, found, shares, commands, ending = [], [], [], [], None
    sources: dict[str, str] = {}
    for cycle in cycles:
        fusion = cycle.step.fusion
        truths.append(cycle.truth)
        found.append(on_face(fusion.contacts, plan.face))
        shares.append(shares_on_face(fusion.contacts, plan.face))
        sources = {
            name: str(source.kind)
            for name, source in fusion.report.sources.items()
            if source.kind != HypothesisKind.NULL
        }
        commands.append(cycle.step.command)
        ending = cycle.ending
    modes = tuple(dict.fromkeys(command.mode for command in commands if command))
    twists = [command.twist for command in commands if command and command.twist]
    config = plan.scene_of(push)
    return Track(
        push=push,
        sensing=plan.sensing.label,
        controller=controller,
        ending=str(ending),
        within=config.within,
        period=config.period,
        modes=modes,
        sources=sources,
        stamp=np.array([truth.stamp for truth in truths]),
        base=np.array([truth.base for truth in truths]),
        object=np.array([truth.object for truth in truths]),
        kind=np.array([KINDS.index(truth.kind) for truth in truths], np.uint8),
        contact=np.array([truth.contact for truth in truths]),
        distance=np.array([truth.distance for truth in truths]),
        force=np.array([truth.force for truth in truths]),
        lateral=np.array([touch.lateral if touch else np.nan for touch in found]),
        estimate=np.array(
            [KINDS.index(touch.kind if touch else "none") for touch in found], np.uint8
        ),
        shares=np.array(
            [[cycle_shares.get(name, 0.0) for name in sources] for cycle_shares in shares]
        ),
        mode=np.array([modes.index(command.mode) for command in commands if command], np.uint8),
        command=np.array([[*twist.linear[:2], twist.angular[2]] for twist in twists]),
    )


def shares_on_face(contacts: Sequence[Contact], face: FaceConfig) -> dict[str, float]:
    """The share of each source in the contacts on a face, which weigh by their voxels.

    Args:
        contacts: of one step, in the face's frame.
        face: the face.

    Returns:
        Shares that add up to 1; nothing without such a contact.
    """
    touching = [contact for contact in contacts if on_face([contact], face)]
    voxels = sum(contact.voxels for contact in touching)
    shares: dict[str, float] = {}
    for contact in touching:
        for name, share in contact.shares.items():
            shares[name] = shares.get(name, 0.0) + share * contact.voxels / voxels
    return shares


def content_of(track: Track) -> bytes:
    """The npz file of a track."""
    named = {name: getattr(track, name) for name in NAMED} | {"push": asdict(track.push)}
    return as_npz(told=json.dumps(named), **{name: getattr(track, name) for name in ARRAYS})


def load(path: Path) -> Track:
    """Read a track.

    Raises:
        ConfigurationError: the file is missing, or is no track.
    """
    held = read_arrays(path, "told", *ARRAYS)
    try:
        return _read(held)
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
        raise ConfigurationError(f"{path} is no push of this experiment") from None


def _read(held: Mapping[str, Any]) -> Track:
    fields: dict[str, Any] = json.loads(str(held["told"]))
    push = fields.pop("push")
    x, y = push.pop("target")
    return Track(
        push=Push(**push, target=(x, y)),
        modes=tuple(fields.pop("modes")),
        **fields,
        **{name: held[name] for name in ARRAYS},
    )


def report_costs(costs: Mapping[str, Sequence[Cost]], out: Path) -> None:
    """Print the costs of pushes, and write them to timing.json.

    Args:
        costs: of the pushes of this run, by sensor suite.
        out: the folder of the results.
    """
    fields = {label: costs_of(part) for label, part in costs.items()}
    write_whole(out / "timing.json", json.dumps(fields, indent=1) + "\n")
    for label, figures in fields.items():
        note(
            f"{label}: {figures['trials_per_cpu_minute']:.0f} pushes a minute of CPU time, "
            f"{figures['simulated_s_per_cpu_s']:.0f} times as fast as real; sensors take "
            f"{figures['sensing_share']:.0%} of it, generators, fusion and controller "
            f"{figures['fusion_share']:.0%}: {figures['cycle_p50_ms']:.2f} ms a cycle, "
            f"p99 {figures['cycle_p99_ms']:.2f} ms"
        )


def costs_of(costs: Sequence[Cost]) -> dict[str, float]:
    """Rates, shares and quantiles of the costs of pushes.

    Args:
        costs: of pushes by one sensor suite.
    """
    cpu, simulated = sum(cost.cpu for cost in costs), sum(cost.simulated for cost in costs)
    cycles = np.concatenate([cost.fused for cost in costs])
    p50, p99 = np.quantile(cycles, [0.5, 0.99]).tolist()
    return {
        "trials": len(costs),
        "cpu_s": cpu,
        "trials_per_cpu_minute": 60.0 * len(costs) / cpu,
        "simulated_s_per_cpu_s": simulated / cpu,
        "sensing_share": sum(cost.sensed for cost in costs) / cpu,
        "fusion_share": float(cycles.sum()) / cpu,
        "cycle_p50_ms": p50 * 1e3,
        "cycle_p99_ms": p99 * 1e3,
    }
