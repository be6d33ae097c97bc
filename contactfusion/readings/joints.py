"""Joints: what they report, and what they are commanded."""

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError, InvalidReadingError, RecordingError
from contactfusion.readings.codec import Codec, Role
from contactfusion.readings.columns import RADIANS, SOME, ColumnsConfig
from contactfusion.readings.messages import Message, message, numbers
from contactfusion.readings.reading import At, Reading
from contactfusion.readings.values import Change, ElementValues

NO_FRAME = "joints"
"""The frame of joints whose header names none, as is usual: their values lie in no frame."""
TAKE_BIAS = {
    Change.MOVED: "which tells no places; take 'bias' for joints with a wrong zero",
}
ALL = ("positions", "velocities", "efforts")
NAMES, POSITIONS = ("joint_1", "joint_2"), np.array([0.1, -0.2])
"""Of examples."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointState(Reading):
    """The joints of a robot.

    Attributes:
        names: the joints, in the order of the arrays.
        positions: shape (n,) [rad, or m for prismatic joints].
        velocities: shape (n,) [rad/s, m/s], NaN of joints that report none; None: none does.
        efforts: shape (n,) [N·m, N], likewise.
    """

    names: tuple[str, ...]
    positions: FloatArray
    velocities: FloatArray | None = None
    efforts: FloatArray | None = None

    def _check(self) -> None:
        self._set("names", tuple(self.names))
        if len(set(self.names)) != len(self.names):
            raise InvalidReadingError(f"{self.label} names a joint twice")
        self._freeze("positions", len(self.names))
        for name in ("velocities", "efforts"):
            if getattr(self, name) is None:
                continue
            values = self._freeze(name, len(self.names), finite=False)
            if np.isinf(values).any():
                raise InvalidReadingError(f"{name} of {self.label} are infinite")


@dataclass(frozen=True, kw_only=True, eq=False)
class JointCommand(Reading):
    """The positions that joints are commanded.

    Attributes:
        names: the joints, in the order of the array.
        positions: shape (n,) [rad, or m for prismatic joints].
    """

    names: tuple[str, ...]
    positions: FloatArray

    def _check(self) -> None:
        self._set("names", tuple(self.names))
        if len(set(self.names)) != len(self.names):
            raise InvalidReadingError(f"{self.label} names a joint twice")
        self._freeze("positions", len(self.names))


class JointStateColumns(ColumnsConfig):
    """All positions, then all velocities, then all efforts; the latter two may be left out."""

    names: tuple[str, ...] = Field(min_length=1)
    """The joints, in the order of the columns."""
    holds: tuple[Literal["positions", "velocities", "efforts"], ...] = ()
    """What the columns hold, each for all joints, such as [positions, efforts] where there are no
    velocities; empty: positions, velocities, efforts, as far as there are columns."""

    @field_validator("holds")
    @classmethod
    def _with_positions(cls, holds: tuple[str, ...]) -> tuple[str, ...]:
        if holds and ("positions" not in holds or len(set(holds)) < len(holds)):
            raise ValueError("name positions, and each at most once")
        return holds

    @model_validator(mode="after")
    def _efforts_are_no_angles(self) -> Self:
        has_efforts = "efforts" in self.holds or (
            not self.holds and len(self.columns) == 3 * len(self.names)
        )
        if has_efforts and self.scale == (RADIANS,):
            raise ConfigurationError(SOME, "scale")
        return self

    def counts(self) -> tuple[int, ...]:
        """As often the number of joints as the columns hold values of each."""
        times = (len(self.holds),) if self.holds else (1, 2, 3)
        return tuple(len(self.names) * each for each in times)

    def reading(self, at: At, row: FloatArray) -> JointState:
        """The state of the joints."""
        parts = zip(self.holds or ALL, row.reshape(-1, len(self.names)), strict=False)
        held: dict[str, FloatArray] = dict(parts)
        return JointState(
            names=self.names,
            positions=held["positions"],
            velocities=held.get("velocities"),
            efforts=held.get("efforts"),
            **at,
        )


class JointCommandColumns(ColumnsConfig):
    """The positions that joints are commanded."""

    names: tuple[str, ...] = Field(min_length=1)
    """The joints, in the order of the columns."""

    def counts(self) -> tuple[int, ...]:
        """The number of joints."""
        return (len(self.names),)

    def reading(self, at: At, row: FloatArray) -> JointCommand:
        """The command."""
        return JointCommand(names=self.names, positions=row, **at)


class JointStateCodec(Codec[JointState]):
    """Positions, velocities and efforts of joints."""

    name = "joint_state"
    kind = JointState
    role = Role.CONTEXT
    use = "joints of the robot"
    messages = ("sensor_msgs/msg/JointState",)
    Columns = JointStateColumns
    values = ElementValues("positions", "velocities", "efforts", senseless=TAKE_BIAS)

    def from_message(self, message: Message, at: At) -> JointState:
        """The joints of a sensor_msgs/JointState."""
        if not len(message.position):
            raise RecordingError("it tells no positions")
        at = {**at, "frame": at["frame"] or NO_FRAME}
        return JointState(
            names=tuple(message.name),
            positions=message.position,
            velocities=_reported(message.velocity),
            efforts=_reported(message.effort),
            **at,
        )

    def to_message(self, reading: JointState, top: Message) -> Message:
        """A sensor_msgs/JointState."""
        return self.message(
            header=top,
            name=list(reading.names),
            position=reading.positions,
            velocity=numbers(reading.velocities),
            effort=numbers(reading.efforts),
        )

    def whose(self, reading: JointState) -> tuple[str, ...]:
        """The names of the joints."""
        return reading.names

    def example(self, stamp: float, scale: float) -> JointState:
        """Two joints that move."""
        return JointState(
            stamp=stamp,
            frame="base",
            names=NAMES,
            positions=scale * POSITIONS,
            velocities=POSITIONS,
            efforts=10.0 * POSITIONS,
        )


class JointCommandCodec(Codec[JointCommand]):
    """Positions that joints are commanded."""

    name = "joint_command"
    kind = JointCommand
    role = Role.CONTEXT
    messages = ("trajectory_msgs/msg/JointTrajectory",)
    Columns = JointCommandColumns
    values = ElementValues("positions", senseless=TAKE_BIAS)

    def from_message(self, message: Message, at: At) -> JointCommand:
        """The last point of a trajectory_msgs/JointTrajectory."""
        if not message.points:
            raise RecordingError("it has no point")
        at = {**at, "frame": at["frame"] or NO_FRAME}
        positions = message.points[-1].positions
        return JointCommand(names=tuple(message.joint_names), positions=positions, **at)

    def to_message(self, reading: JointCommand, top: Message) -> Message:
        """A trajectory_msgs/JointTrajectory of one point."""
        goal = message(
            "trajectory_msgs/JointTrajectoryPoint",
            positions=reading.positions,
            velocities=numbers(None),
            accelerations=numbers(None),
            effort=numbers(None),
            time_from_start=message("builtin_interfaces/Duration", sec=0, nanosec=0),
        )
        return self.message(header=top, joint_names=list(reading.names), points=[goal])

    def whose(self, reading: JointCommand) -> tuple[str, ...]:
        """The names of the joints."""
        return reading.names

    def example(self, stamp: float, scale: float) -> JointCommand:
        """Two joints."""
        return JointCommand(stamp=stamp, frame="base", names=NAMES, positions=scale * POSITIONS)


def _reported(values: FloatArray) -> FloatArray | None:
    """Numbers of a message, NaN where a joint reports none; None where none does."""
    finite = np.isfinite(values)
    return np.where(finite, values, np.nan) if finite.any() else None
