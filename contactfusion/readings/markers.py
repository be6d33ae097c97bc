"""Markers of motion capture."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from contactfusion.arrays import FloatArray
from contactfusion.readings.canvas import MARKER, Canvas
from contactfusion.readings.codec import Codec
from contactfusion.readings.columns import ColumnsConfig
from contactfusion.readings.messages import Message, point
from contactfusion.readings.reading import At, Reading
from contactfusion.readings.values import PointValues


@dataclass(frozen=True, kw_only=True, eq=False)
class Markers(Reading):
    """Positions of named markers, as motion capture gives them; a lost marker is NaN.

    Attributes:
        names: the markers, in the order of the rows.
        positions: shape (n, 3) [m].
    """

    names: tuple[str, ...]
    positions: FloatArray

    def _check(self) -> None:
        self._set("names", tuple(self.names))
        self._freeze("positions", len(self.names), 3, finite=False)


class MarkersColumns(ColumnsConfig):
    """Position x, y, z [m] of each marker; a missing value is a lost marker."""

    angles = "none"

    names: tuple[str, ...] = Field(min_length=1)
    """The markers, in the order of the columns."""
    gaps: ClassVar[bool] = True

    def counts(self) -> tuple[int, ...]:
        """Three times the number of markers."""
        return (3 * len(self.names),)

    def reading(self, at: At, row: FloatArray) -> Markers:
        """The positions of the markers."""
        return Markers(names=self.names, positions=row.reshape(-1, 3), **at)


class MarkersCodec(Codec[Markers]):
    """Positions of named markers."""

    name = "markers"
    kind = Markers
    messages = ("contactfusion_msgs/msg/Markers",)
    Columns = MarkersColumns
    values = PointValues("positions")

    def from_message(self, message: Message, at: At) -> Markers:
        """The markers of a contactfusion_msgs/Markers."""
        positions = np.array([(point.x, point.y, point.z) for point in message.positions])
        return Markers(names=tuple(message.names), positions=positions.reshape(-1, 3), **at)

    def to_message(self, reading: Markers, top: Message) -> Message:
        """A contactfusion_msgs/Markers."""
        positions = [point(position) for position in reading.positions]
        return self.message(header=top, names=list(reading.names), positions=positions)

    def draw(self, canvas: Canvas, reading: Markers) -> None:
        """The markers that are not lost, with their names."""
        canvas.points(reading.positions, MARKER, labels=reading.names, large=True)

    def example(self, stamp: float, scale: float) -> Markers:
        """Two markers."""
        positions = scale * np.eye(3)[:2]
        return Markers(stamp=stamp, frame="sensor", names=("m1", "m2"), positions=positions)
