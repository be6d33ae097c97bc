"""One push of the experiment by one controller: its track, cycle by cycle."""

import json
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.controllers.face import on_face
from contactfusion.errors import ConfigurationError
from contactfusion.experiments.push.plan import Plan, Push
from contactfusion.npz_files import read_arrays, write_npz
from contactfusion.pipeline import Pipeline, Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading
from contactfusion.simulation.push import PushScene
from contactfusion.simulation.pushing import Cycle, pushed

KINDS = ("none", "point", "line")
"""How the object touches."""


@dataclass(frozen=True, eq=False)
class Track:
    """One push by one controller; n cycles.

    Attributes:
        push: which.
        controller: by name.
        ending: why it ended.
        within: so near to the target the contact has arrived [m].
        period: of a cycle [s].
        modes: the names of the controller's modes.
        stamp: shape (n,) [s].
        base: shape (n, 3), x, y [m] and yaw [rad] of the robot in `odom`.
        object: shape (n, 3), of the object likewise.
        kind: shape (n,), the true kind of contact as a row of `KINDS`.
        contact: shape (n, 2), the true contact in the robot's frame [m], NaN without.
        distance: shape (n,), from the true contact to the target [m], NaN without.
        force: shape (n,), of the object on the robot [N].
        lateral: shape (n,), the contact as it was estimated, to the left [m], NaN without.
        estimate: shape (n,), its estimated kind.
        mode: shape (n,), of the controller, as a row of `modes`.
        command: shape (n, 3), ahead, to the left [m/s], turn [rad/s].
    """

    push: Push
    controller: str
    ending: str
    within: float
    period: float
    modes: tuple[str, ...]
    stamp: FloatArray
    base: FloatArray
    object: FloatArray
    kind: NDArray[np.uint8]
    contact: FloatArray
    distance: FloatArray
    force: FloatArray
    lateral: FloatArray
    estimate: NDArray[np.uint8]
    mode: NDArray[np.uint8]
    command: FloatArray


TOLD = ("push", "controller", "ending", "within", "period", "modes")
ARRAYS = tuple(field.name for field in fields(Track) if field.name not in TOLD)


@dataclass(frozen=True, eq=False)
class Cost:
    """What a push took.

    Attributes:
        simulated: [s].
        cpu: of all of it [s].
        fused: shape (n,), of receiving and stepping in each cycle [s].
    """

    simulated: float
    cpu: float
    fused: FloatArray


@final
class StopWatch(Pipeline):
    """A pipeline that adds up the CPU time it takes, cycle by cycle."""

    def __init__(self, config: PipelineConfig) -> None:
        super().__init__(config)
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


def run_trial(plan: Plan, push: Push, controller: str) -> tuple[Track, Cost]:
    """Push once.

    Raises:
        ContactFusionError: the scene cannot be set up, or the controller failed.
    """
    start = time.process_time()
    pipeline = StopWatch(plan.pipeline_of(push, controller))
    track = track_of(plan, push, controller, push_cycles(plan, push, pipeline))
    cpu = time.process_time() - start
    return track, Cost(float(track.stamp[-1]), cpu, np.array(pipeline.cycles[:-1]))


def push_cycles(plan: Plan, push: Push, pipeline: Pipeline) -> Iterator[Cycle]:
    """Let a pipeline make a push.

    Raises:
        ContactFusionError: the scene cannot be set up, or the controller failed.
    """
    return pushed(PushScene(plan.scene_of(push), plan.robot, push.seed), pipeline)


def track_of(plan: Plan, push: Push, controller: str, cycles: Iterable[Cycle]) -> Track:
    """Keep of all cycles what the measures need, and nothing else."""
    truths, found, commands, ending = [], [], [], None
    for cycle in cycles:
        truths.append(cycle.truth)
        found.append(on_face(cycle.step.fusion.contacts, plan.face))
        commands.append(cycle.step.command)
        ending = cycle.ending
    modes = tuple(dict.fromkeys(command.mode for command in commands if command))
    twists = [command.twist for command in commands if command and command.twist]
    config = plan.scene_of(push)
    return Track(
        push=push,
        controller=controller,
        ending=str(ending),
        within=config.within,
        period=config.period,
        modes=modes,
        stamp=np.array([truth.stamp for truth in truths]),
        base=np.array([truth.base for truth in truths]),
        object=np.array([truth.object for truth in truths]),
        kind=np.array([KINDS.index(truth.kind) for truth in truths], np.uint8),
        contact=np.array([truth.contact for truth in truths]),
        distance=np.array([truth.distance for truth in truths]),
        force=np.array([truth.force for truth in truths]),
        lateral=np.array([one.lateral if one else np.nan for one in found]),
        estimate=np.array([KINDS.index(one.kind if one else "none") for one in found], np.uint8),
        mode=np.array([modes.index(one.mode) for one in commands if one], np.uint8),
        command=np.array([[*twist.linear[:2], twist.angular[2]] for twist in twists]),
    )


def save(track: Track, path: Path) -> None:
    """Write a track to an npz file."""
    told = {name: getattr(track, name) for name in TOLD} | {"push": asdict(track.push)}
    write_npz(path, told=json.dumps(told), **{name: getattr(track, name) for name in ARRAYS})


def load(path: Path) -> Track:
    """Read a track.

    Raises:
        ConfigurationError: the file is missing, or is no track.
    """
    held = read_arrays(path, "told", *ARRAYS)
    try:
        return _told(held)
    except (KeyError, TypeError, ValueError):
        raise ConfigurationError(f"{path} is no push of this experiment") from None


def _told(held: Mapping[str, Any]) -> Track:
    told: dict[str, Any] = json.loads(str(held["told"]))
    push = told.pop("push")
    x, y = push.pop("target")
    return Track(
        push=Push(**push, target=(x, y)),
        modes=tuple(told.pop("modes")),
        **told,
        **{name: held[name] for name in ARRAYS},
    )
