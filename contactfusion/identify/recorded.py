"""What a recording holds for identification: motions of joints, and wrenches of wrists."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.assembly import built_generator, generator_class
from contactfusion.errors import (
    ConfigurationError,
    ContactFusionError,
    FrameError,
    RecordingError,
    RobotError,
    name_hint,
)
from contactfusion.frames import Pose, vectors_in
from contactfusion.generators.force_torque import ForceTorqueConfig
from contactfusion.generators.joint_torque import JointTorqueConfig
from contactfusion.grid import Grid
from contactfusion.identify.wrists import Sample
from contactfusion.readings import JointState, Reading, Wrench
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.recording import WHOLE
from contactfusion.robot_state import Robot, StateBuffer
from contactfusion.robots.description import EffortConfig
from contactfusion.robots.dynamics import Dynamics
from contactfusion.robots.model import RobotModel
from contactfusion.run.configuration import Setting
from contactfusion.run.session import matched
from contactfusion.stream import Stream
from contactfusion.terminal import followed

FRESH = 0.1
"""Gravity is looked up in the frames of the robot so often [s]: bases tilt slowly."""
UNKNOWN = EffortConfig(noise=1.0)
"""What is known of a joint that the robot's `efforts` do not name yet."""
Vectors = list[FloatArray]


@dataclass(frozen=True, eq=False)
class Motion:
    """The joints of one `joint_torque` generator as they moved.

    Attributes:
        readings: with the efforts of all joints of the generator, by rising stamps.
        positions: of all joints of the robot at each, shape (n,) [rad, m]; they do not leap by a
            turn.
        gravities: in the root link's frame at each, shape (3,) [m/s²].
    """

    readings: list[JointState]
    positions: Vectors
    gravities: Vectors

    @property
    def stamps(self) -> FloatArray:
        """Of the readings, shape (m,) [s]."""
        return np.array([reading.stamp for reading in self.readings])

    def efforts(self, names: Sequence[str]) -> FloatArray:
        """The efforts of joints, shape (m, len(names)), in their own units."""
        rows, known = [], tuple[str, ...]()
        columns: list[int] = []
        for reading in self.readings:
            if reading.names != known:
                known, columns = reading.names, [reading.names.index(name) for name in names]
            assert reading.efforts is not None
            rows.append(reading.efforts[columns])
        return np.array(rows)


class Recorded:
    """The generators of a configuration that can be identified, and what a recording holds of them.

    Args:
        setting: the configuration.
        recording: the file or folder.

    Attributes:
        config: the configuration of the pipeline.
        model: its robot; None: it has none.
        joints: the options of its `joint_torque` generators, by name.
        wrists: the options of its `force_torque` generators, by name.
        motions: of the joints, by generator.
        wrenches: with the joints, along the axes of the sensor's frame, by generator.
        gravities: in the sensor's frame at each wrench, shape (3,) [m/s²], by generator.
        mounts: the link that carries each sensor of a load of the robot, and the sensor's pose
            there, by generator.

    Raises:
        ContactFusionError: the configuration or the recording is not what it should be, or they do
            not fit.
    """

    def __init__(self, setting: Setting, recording: Path) -> None:
        self.joints: dict[str, JointTorqueConfig] = {}
        self.wrists: dict[str, ForceTorqueConfig] = {}
        stream, inputs = matched(setting, open_recording(recording), WHOLE, None, False)
        with closing(stream):
            self.config = setting.config(inputs.generators)
            self.model = self._robot()
            for name, options in self.config.generators.items():
                self._take(name, options)
            if not self.joints and not self.wrists:
                held = ", ".join(f"{n} ({g['type']})" for n, g in self.config.generators.items())
                raise ConfigurationError(
                    f"{setting.origin}: identify is for generators of type joint_torque and "
                    f"force_torque; there are: {held or 'none'}"
                )
            for absence in inputs.missing:
                if absence.split(": ")[0].removeprefix("generators.") in {
                    *self.joints,
                    *self.wrists,
                }:
                    raise RecordingError(f"{recording}: {absence}")
            self._read(stream, f"reading {recording}")

    def _robot(self) -> RobotModel | None:
        """The robot without its payload, which is to be found."""
        if self.config.robot is None:
            return None
        return RobotModel(self.config.robot.model_copy(update={"payload": None}))

    def _take(self, name: str, options: Mapping[str, Any]) -> None:
        """Read the options of a generator; joints may be named that no `efforts` describe yet."""
        of = generator_class(options["type"]).Config
        if not issubclass(of, JointTorqueConfig | ForceTorqueConfig):
            return
        robot, joints = self.config.robot, options.get("joints")
        if issubclass(of, JointTorqueConfig) and self.model is None:
            raise ConfigurationError("needs a robot by URDF", f"generators.{name}")
        known = self.model.joint_names if self.model is not None else ()
        for joint in joints if isinstance(joints, list | tuple | dict) else ():
            if joint not in known:
                hint = name_hint(str(joint), known, "joints of the robot")
                raise ConfigurationError(
                    f"unknown joint '{joint}'; {hint}", f"generators.{name}.joints"
                )
        if robot is not None and isinstance(joints, list | tuple):
            blank = dict.fromkeys(joints, UNKNOWN)
            robot = robot.model_copy(update={"efforts": {**blank, **robot.efforts}})
        generator = built_generator(
            name, dict(options), self.config.folder, robot, self.config.files_within
        )
        if isinstance(generator.config, JointTorqueConfig):
            if generator.config.effort != "external" and self.model is not None:
                Dynamics(self.model).require_inertias()
            self.joints[name] = generator.config
        elif isinstance(generator.config, ForceTorqueConfig):
            self.wrists[name] = generator.config

    def _read(self, stream: Stream, task: str) -> None:
        """Read the recording once; what comes before the robot's place is known is left out."""
        self.motions = {name: Motion([], [], []) for name in self.joints}
        self.wrenches: dict[str, list[Sample]] = {name: [] for name in self.wrists}
        self.gravities: dict[str, Vectors] = {name: [] for name in self.wrists}
        self.mounts: dict[str, tuple[str, Pose]] = {}
        self._refused: dict[str, ContactFusionError] = {}
        grid = Grid(self.config.integrator.frame, self.config.integrator.voxel_size)
        self._frames, self._states = Robot(self.config, grid), StateBuffer()
        self._down: dict[tuple[str, str], tuple[float, FloatArray]] = {}
        self._space = grid.frame
        arrived = (reading for arrival in stream.arrivals() for reading in arrival.readings)
        for reading in followed(arrived, task, stream.end):
            self._frames.add(reading)
            self._states.add(reading)
            for name in self._fed(reading):
                try:
                    self._add(name, reading)
                except (FrameError, RobotError, RecordingError) as error:
                    self._refused.setdefault(name, error)
        for name in (*self.joints, *self.wrists):
            held = self.motions[name].readings if name in self.joints else self.wrenches[name]
            if not held:
                why = self._refused.get(
                    name, RecordingError("the recording holds no reading of it")
                )
                raise type(why)(f"generators.{name}: {why}")
        if self.model is not None:
            for positions in (
                *(motion.positions for motion in self.motions.values()),
                *([each.positions for each in samples] for samples in self.wrenches.values()),
            ):
                _unwrap(positions, self.model.turning)

    def _fed(self, reading: Reading) -> Iterator[str]:
        """The generators that take a reading."""
        of = self.joints if isinstance(reading, JointState) else self.wrists
        if isinstance(reading, JointState | Wrench):
            for name, config in of.items():
                if config.sensor in (None, reading.sensor):
                    yield name

    def _add(self, name: str, reading: Reading) -> None:
        if isinstance(reading, JointState):
            require_efforts(reading, tuple(self.joints[name].joints))
            if self.model and (stray := self.model.stray(reading)):
                raise ConfigurationError(stray)
        positions = np.empty(0)
        if self.model is not None:
            positions = self.model.positions(self._states.joints(reading.stamp))
        if isinstance(reading, JointState):
            assert self.model is not None
            motion = self.motions[name]
            if motion.readings and reading.stamp <= motion.readings[-1].stamp:
                return  # it came twice, or late
            gravity = self._gravity(name, self.model.root, self.joints[name].gravity, reading)
            motion.readings.append(reading)
            motion.positions.append(positions)
            motion.gravities.append(gravity)
        elif isinstance(reading, Wrench):
            config = self.wrists[name]
            gravity = self._gravity(name, reading.frame, config.gravity, reading)
            if self.model is None:  # it rests while gravity does not turn in it
                positions = gravity / np.linalg.norm(gravity)
            elif config.load == "robot" and name not in self.mounts:
                link = self._frames.state(reading.stamp, None).link_of(reading.frame)
                tree = self._frames.frames(reading.stamp)
                self.mounts[name] = link, tree.pose(link, of=reading.frame)
            if config.axes:
                pose = self._frames.frames(reading.stamp).pose(reading.frame, of=config.axes)
                force, torque = vectors_in(pose, np.stack([reading.force, reading.torque]))
                reading = replace(reading, force=force, torque=torque)
            self.wrenches[name].append(Sample(reading, positions))
            self.gravities[name].append(gravity)

    def _gravity(
        self, name: str, frame: str, gravity: tuple[float, float, float], reading: Reading
    ) -> FloatArray:
        """Gravity in a frame, shape (3,) [m/s²]."""
        known = self._down.get((name, frame))
        if known is None or not 0.0 <= reading.stamp - known[0] < FRESH:
            pose = self._frames.frames(reading.stamp).pose(frame, of=self._space)
            known = reading.stamp, vectors_in(pose, np.array([gravity]))[0]
            self._down[name, frame] = known
        return known[1]


def _unwrap(positions: Vectors, turning: NDArray[np.bool_]) -> None:
    """Change positions, each of shape (n,), so that joints without limits do not leap by a turn."""
    if positions and turning.any():
        steady = np.unwrap(np.array(positions)[:, turning], axis=0)
        for own, row in zip(positions, steady, strict=True):
            own[turning] = row


def require_efforts(reading: JointState, names: Sequence[str]) -> None:
    """Refuse joints without efforts.

    Raises:
        RecordingError: a joint has none; the sentence names those of the reading.
    """
    if reading.efforts is None:
        raise RecordingError(
            f"{reading.label} has no efforts; a driver that reports torques or currents fills "
            "`effort`"
        )
    for name in names:
        if name not in reading.names:
            hint = name_hint(name, reading.names, "joints of the reading")
            raise RecordingError(f"{reading.label} has no effort of '{name}': {hint}")
        if np.isnan(reading.efforts[reading.names.index(name)]):
            raise RecordingError(f"{reading.label} reports no effort of '{name}'")
