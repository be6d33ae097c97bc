"""Which columns of a log make which reading: one configuration for each type of reading."""

import math
import re
from abc import abstractmethod
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from contactfusion.arrays import FloatArray
from contactfusion.model import Model
from contactfusion.readings import (
    JointCommand,
    JointState,
    Markers,
    ObjectPose,
    Odometry,
    Reading,
    Switch,
    TactileImage,
    Twist,
    Wrench,
)
from contactfusion.recordings.tables import Column

RANGE = re.compile(r"(.*?)(\d+)\.\.(.*?)(\d+)")


def _columns(value: Any) -> Any:
    """Take one column or a list of them, and write ranges out."""
    if not isinstance(value, list | tuple):
        value = [value]
    return tuple(column for item in value for column in _written_out(item))


def _written_out(item: Any) -> list[Any]:
    """Write out ``p0..p14`` or ``7..18``: the names, or the numbers, from the first to the last."""
    ends = RANGE.fullmatch(item) if isinstance(item, str) else None
    if ends is None:
        return [item]
    before, first, before_last, last = ends.groups()
    if before != before_last or int(last) < int(first):
        raise ValueError(f"'{item}' is no range: write it as p0..p14 or 7..18")
    numbers = range(int(first), int(last) + 1)
    return [f"{before}{number:0{len(first)}}" if before else number for number in numbers]


def _factors(value: Any) -> Any:
    """Take one factor or one for each column; ``deg`` turns degrees into radians."""
    factors = value if isinstance(value, list | tuple) else [value]
    return tuple(math.pi / 180.0 if factor == "deg" else factor for factor in factors)


class ColumnsConfig(Model):
    """The columns that make one sensor's readings; a subclass for each type of reading."""

    frame: str = Field(min_length=1)
    """The frame in which the values are given."""
    columns: Annotated[tuple[Column, ...], BeforeValidator(_columns)] = Field(min_length=1)
    """Columns by name or by number from 1; `p0..p14` stands for all from p0 to p14."""
    scale: Annotated[tuple[float, ...], BeforeValidator(_factors)] = (1.0,)
    """What brings the columns to SI units: one factor, or one a column; `deg` for degrees."""
    gaps: ClassVar[bool] = False
    """Whether a value may be missing."""

    @abstractmethod
    def counts(self) -> tuple[int, ...]:
        """Give the numbers of values that make a reading; empty: any."""

    @abstractmethod
    def reading(self, sensor: str, stamp: float, row: FloatArray) -> Reading:
        """Give the reading of one row of values, in SI units."""


class WrenchColumns(ColumnsConfig):
    """Force x, y, z [N], then torque x, y, z [N·m]."""

    type: Literal["wrench"]

    def counts(self) -> tuple[int, ...]:
        """Give 6."""
        return (6,)

    def reading(self, sensor: str, stamp: float, row: FloatArray) -> Reading:
        """Give the wrench."""
        return Wrench(stamp=stamp, frame=self.frame, sensor=sensor, force=row[:3], torque=row[3:])


class TactileImageColumns(ColumnsConfig):
    """One column a taxel or channel, in the order of the patch."""

    type: Literal["tactile_image"]

    def counts(self) -> tuple[int, ...]:
        """Give none: any number will do."""
        return ()

    def reading(self, sensor: str, stamp: float, row: FloatArray) -> Reading:
        """Give the image."""
        return TactileImage(stamp=stamp, frame=self.frame, sensor=sensor, values=row)


class SwitchColumns(ColumnsConfig):
    """One column; whatever is not 0 is closed."""

    type: Literal["switch"]

    def counts(self) -> tuple[int, ...]:
        """Give 1."""
        return (1,)

    def reading(self, sensor: str, stamp: float, row: FloatArray) -> Reading:
        """Give the switch."""
        return Switch(stamp=stamp, frame=self.frame, sensor=sensor, closed=bool(row[0] != 0.0))


class JointStateColumns(ColumnsConfig):
    """All positions, then all velocities, then all efforts; the latter two may be left out."""

    type: Literal["joint_state"]
    names: tuple[str, ...] = Field(min_length=1)
    """The joints, in the order of the columns."""

    def counts(self) -> tuple[int, ...]:
        """Give once, twice and three times the number of joints."""
        count = len(self.names)
        return (count, 2 * count, 3 * count)

    def reading(self, sensor: str, stamp: float, row: FloatArray) -> Reading:
        """Give the state of the joints."""
        count = len(self.names)
        return JointState(
            stamp=stamp,
            frame=self.frame,
            sensor=sensor,
            names=self.names,
            positions=row[:count],
            velocities=row[count : 2 * count] if row.size > count else None,
            efforts=row[2 * count :] if row.size > 2 * count else None,
        )


class JointCommandColumns(ColumnsConfig):
    """The positions that joints are told to take."""

    type: Literal["joint_command"]
    names: tuple[str, ...] = Field(min_length=1)
    """The joints, in the order of the columns."""

    def counts(self) -> tuple[int, ...]:
        """Give the number of joints."""
        return (len(self.names),)

    def reading(self, sensor: str, stamp: float, row: FloatArray) -> Reading:
        """Give the command."""
        return JointCommand(
            stamp=stamp, frame=self.frame, sensor=sensor, names=self.names, positions=row
        )


class TwistColumns(ColumnsConfig):
    """Linear velocity x, y, z [m/s], then angular velocity x, y, z [rad/s]."""

    type: Literal["twist"]

    def counts(self) -> tuple[int, ...]:
        """Give 6."""
        return (6,)

    def reading(self, sensor: str, stamp: float, row: FloatArray) -> Reading:
        """Give the twist."""
        return Twist(stamp=stamp, frame=self.frame, sensor=sensor, linear=row[:3], angular=row[3:])


class OdometryColumns(ColumnsConfig):
    """Position x, y, z [m], quaternion x, y, z, w, then, if known, a twist as `TwistColumns`."""

    type: Literal["odometry"]
    child_frame: str = Field(min_length=1)
    """The frame that moves, e.g. `base`."""

    def counts(self) -> tuple[int, ...]:
        """Give 7, and 13 with a twist."""
        return (7, 13)

    def reading(self, sensor: str, stamp: float, row: FloatArray) -> Reading:
        """Give the pose, and the twist when there is one."""
        return Odometry(
            stamp=stamp,
            frame=self.frame,
            sensor=sensor,
            child_frame=self.child_frame,
            position=row[:3],
            orientation=row[3:7],
            linear=row[7:10] if row.size > 7 else None,
            angular=row[10:] if row.size > 7 else None,
        )


class ObjectPoseColumns(ColumnsConfig):
    """Position x, y, z [m], then the unit quaternion x, y, z, w."""

    type: Literal["object_pose"]
    name: str = Field(min_length=1)
    """The object."""

    def counts(self) -> tuple[int, ...]:
        """Give 7."""
        return (7,)

    def reading(self, sensor: str, stamp: float, row: FloatArray) -> Reading:
        """Give the pose."""
        return ObjectPose(
            stamp=stamp,
            frame=self.frame,
            sensor=sensor,
            name=self.name,
            position=row[:3],
            orientation=row[3:],
        )


class MarkersColumns(ColumnsConfig):
    """Position x, y, z [m] of each marker; a missing value is a lost marker."""

    type: Literal["markers"]
    names: tuple[str, ...] = Field(min_length=1)
    """The markers, in the order of the columns."""
    gaps: ClassVar[bool] = True

    def counts(self) -> tuple[int, ...]:
        """Give three times the number of markers."""
        return (3 * len(self.names),)

    def reading(self, sensor: str, stamp: float, row: FloatArray) -> Reading:
        """Give the places of the markers."""
        return Markers(
            stamp=stamp,
            frame=self.frame,
            sensor=sensor,
            names=self.names,
            positions=row.reshape(-1, 3),
        )


AnyColumns = Annotated[
    WrenchColumns
    | TactileImageColumns
    | SwitchColumns
    | JointStateColumns
    | JointCommandColumns
    | TwistColumns
    | OdometryColumns
    | ObjectPoseColumns
    | MarkersColumns,
    Field(discriminator="type"),
]
"""The columns of a reading of any type, by its `type`."""
