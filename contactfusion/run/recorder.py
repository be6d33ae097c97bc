"""Records what the sensors of a scene read, and beside it what is true, as one MCAP file."""

import math
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import final

from scipy.spatial.transform import Rotation

from contactfusion.errors import ConfigurationError, naming
from contactfusion.loop import Observer
from contactfusion.pipeline_config import PipelineConfig
from contactfusion.readings import Reading, Transform
from contactfusion.recordings.mcap import McapWriter
from contactfusion.recordings.messages import topic_of
from contactfusion.run.configuration import setting_of_file
from contactfusion.run.session import Session
from contactfusion.stream import Stream
from contactfusion.terminal import note, say

TRUTH = "truth"
"""Topics of what no sensor measures begin with this."""
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
    setting = setting_of_file(path, overrides, seed)
    if not setting.fields.get("scene"):
        raise ConfigurationError(f"{path}: scene: only a scene can be recorded, and here is none")
    if out.suffix != ".mcap":
        raise ConfigurationError(f"--out: '{out}' is no name for a recording; let it end in .mcap")
    session, last = Session(setting), None
    end = math.inf if duration is None else duration + ROUNDING
    with closing(session), naming(path), McapWriter(out, session.stream.epoch_ns) as writer:
        write_robot(writer, session.pipeline.config)
        recorder = Recorder(writer, session.stream, end)
        observer = Observer(recorder.reading)
        for last in session.play(observer):
            if observer.failure:
                raise observer.failure
            if last.stamp >= end - 2.0 * ROUNDING:
                last = None  # there was no time for all of it
                break
    say(f"{out}: {recorder.counts}, {out.stat().st_size / 1000.0:.0f} kB")
    if verdict := session.verdict(last):
        for sentence in verdict.sentences:
            note(f"truth: {sentence}")


@final
class Recorder:
    """Writes what a scene's sensors read, beside it what is true, and counts the readings.

    Args:
        writer: of the file.
        stream: at its start.
        end: what comes later is left out [s].
    """

    def __init__(self, writer: McapWriter, stream: Stream, end: float = math.inf) -> None:
        self._writer, self._stream, self._end = writer, stream, end
        self._counts: Counter[str] = Counter()
        self._newest = -math.inf

    def reading(self, reading: Reading) -> None:
        """Write a reading; at each new stamp, the truth before it."""
        if reading.stamp > self._end:
            return
        if reading.stamp > self._newest:
            self._newest = reading.stamp
            self._facts()
        self._writer.reading(reading)
        self._counts[topic_of(reading)] += 1

    @property
    def counts(self) -> str:
        """How much was recorded, as text."""
        count = self._counts.total()
        return f"{count} readings on {len(self._counts)} topics in {self._newest:.2f} s"

    def _facts(self) -> None:
        if (facts := self._stream.facts()) is not None:
            self._writer.contacts(facts.contacts, facts.frame, facts.stamp, TRUTH)
            for pose in facts.objects:
                self._writer.reading(pose, TRUTH)


def write_robot(writer: McapWriter, config: PipelineConfig) -> None:
    """Write what holds from the start: the robot's URDF, and all frames that stand still."""
    if config.robot is not None:
        writer.robot_description(config.robot.path().read_text(encoding="utf-8"))
    writer.static(fixed_frames(config))


def fixed_frames(config: PipelineConfig) -> tuple[Transform, ...]:
    """The frames of a configuration, and of its robot, that stand still in their parents."""
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
