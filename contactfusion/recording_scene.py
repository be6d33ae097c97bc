"""Records what the sensors of a scene read, and beside it what is true, as one MCAP file."""

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from scipy.spatial.transform import Rotation

from contactfusion.errors import ConfigurationError, naming
from contactfusion.loop import Observer, play
from contactfusion.pipeline import Pipeline, Step
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading, Transform
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.messages import topic_of
from contactfusion.running import RunConfig, opened_scene, run_fields
from contactfusion.scene import Facts, Scene
from contactfusion.terminal import note

EPOCH_NS = 10**18
"""Scenes begin at this moment, in 2001 [ns]: to ROS a stamp of 0 means "the latest"."""
TRUTH = "truth"
"""Topics of what no sensor tells begin with this."""
ROUNDING = 1e-9
"""A stamp is the last when it is so nearly that [s]."""


def record_scene(
    path: Path,
    overrides: Sequence[str],
    out: Path,
    seed: int | None = None,
    duration: float | None = None,
) -> None:
    """Run a scene; write what its sensors read, before any faults, and the truth.

    The controller acts on what the pipeline makes of the readings, faults and all; of that, nothing
    is recorded. The same seed gives the same bytes.

    Args:
        path: a YAML file as for `contactfusion run`, with a scene.
        overrides: fields to change, as "a.b=c".
        out: the MCAP file; one that exists is replaced.
        seed: in place of the file's; None: that of the file.
        duration: end after so long [s]; None: when the scene ends.

    Raises:
        ConfigurationError: the file has no scene, or is not what it should be.
        RecordingError: the recording cannot be written.
        DependencyError: rosbags, or what the scene needs, is not installed.
    """
    fields = run_fields(path, overrides, seed)
    if not fields.get("scene"):
        raise ConfigurationError(f"{path}: scene: only a scene can be recorded, and here is none")
    if out.suffix != ".mcap":
        raise ConfigurationError(f"--out: '{out}' is no name for a recording; let it end in .mcap")
    with naming(path):
        config = RunConfig(**fields)
        scene, pipeline = opened_scene(config), Pipeline(config)
    end = math.inf if duration is None else duration + ROUNDING
    recorder = _Recorder(McapWriter(out, EPOCH_NS), scene, end)
    try:
        with naming(path), recorder.writer:
            recorder.robot(config)
            last = recorder.run(pipeline)
    finally:
        pipeline.close()
    print(f"{out}: {recorder.told()}, {out.stat().st_size / 1000.0:.0f} kB")
    if last is not None:
        for sentence in scene.verdict(pipeline, last).sentences:
            note(f"truth: {sentence}")


class _Recorder:
    """Writes what a scene tells, and counts the readings.

    Args:
        writer: of the file.
        scene: at its start.
        end: what comes later is left out [s].
    """

    def __init__(self, writer: McapWriter, scene: Scene, end: float) -> None:
        self.writer, self._scene, self._end = writer, scene, end
        self._counts: Counter[str] = Counter()
        self._newest = -math.inf

    def robot(self, config: RunConfig) -> None:
        """Write what holds from the start: the robot's URDF, and all frames that stand still."""
        assert config.robot is not None
        self.writer.robot_description(config.robot.path().read_text(encoding="utf-8"))
        self.writer.static(fixed_frames(config))

    def run(self, pipeline: Pipeline) -> Step | None:
        """Record the scene; give the last step, or None when there was no time for all of it."""
        last = None
        for last in play(pipeline, self._scene, [Observer(self._hear)]):
            if last.stamp >= self._end - 2.0 * ROUNDING:
                return None
        return last

    def told(self) -> str:
        """How much was recorded, as text."""
        count = self._counts.total()
        return f"{count} readings on {len(self._counts)} topics in {self._newest:.2f} s"

    def _hear(self, reading: Reading) -> None:
        """Write a reading; at each new stamp, the truth before it."""
        if reading.stamp > self._end:
            return
        if reading.stamp > self._newest:
            self._newest = reading.stamp
            self._truth(self._scene.facts())
        self.writer.reading(reading)
        self._counts[topic_of(reading)] += 1

    def _truth(self, facts: Facts) -> None:
        self.writer.contacts(facts.contacts, facts.frame, facts.stamp, TRUTH)
        for one in facts.objects:
            self.writer.reading(one, TRUTH)


def fixed_frames(config: PipelineConfig) -> tuple[Transform, ...]:
    """Give the frames of a configuration, and of its robot, that stand still in their parents."""
    on_robot = config.robot.frames if config.robot else {}
    return tuple(
        Transform(
            stamp=0.0,
            frame=frame.parent,
            child_frame=name,
            position=(pose := frame.pose())[:3, 3],
            orientation=Rotation.from_matrix(pose[:3, :3]).as_quat(),
            static=True,
        )
        for name, frame in {**on_robot, **config.frames}.items()
    )
