"""Wrenches of six-axis force-torque sensors and force plates."""

from dataclasses import dataclass

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.readings.canvas import FORCE, TORQUE, Canvas
from contactfusion.readings.codec import Codec
from contactfusion.readings.columns import ColumnsConfig
from contactfusion.readings.messages import Message, message, vector, xyz
from contactfusion.readings.reading import At, Reading
from contactfusion.readings.values import ScrewValues


@dataclass(frozen=True, kw_only=True, eq=False)
class Wrench(Reading):
    """A six-axis force-torque sample.

    Attributes:
        force: shape (3,) [N].
        torque: shape (3,) [N·m], about the origin of `frame`.
    """

    force: FloatArray
    torque: FloatArray

    def _check(self) -> None:
        self._freeze("force", 3)
        self._freeze("torque", 3)


class WrenchColumns(ColumnsConfig):
    """Force x, y, z [N], then torque x, y, z [N·m]."""

    angles = "none"

    def counts(self) -> tuple[int, ...]:
        """Six."""
        return (6,)

    def reading(self, at: At, row: FloatArray) -> Wrench:
        """The wrench."""
        return Wrench(force=row[:3], torque=row[3:], **at)


class WrenchCodec(Codec[Wrench]):
    """Force and torque at a wrist, or on a plate."""

    name = "wrench"
    kind = Wrench
    messages = ("geometry_msgs/msg/WrenchStamped",)
    Columns = WrenchColumns
    values = ScrewValues(
        "force", "torque", "force", "6 numbers: force x, y, z [N], torque x, y, z [N·m]"
    )

    def from_message(self, message: Message, at: At) -> Wrench:
        """The wrench of a geometry_msgs/WrenchStamped."""
        wrench = message.wrench
        return Wrench(force=xyz(wrench.force), torque=xyz(wrench.torque), **at)

    def to_message(self, reading: Wrench, top: Message) -> Message:
        """A geometry_msgs/WrenchStamped."""
        force, torque = vector(reading.force), vector(reading.torque)
        wrench = message("geometry_msgs/Wrench", force=force, torque=torque)
        return self.message(header=top, wrench=wrench)

    def draw(self, canvas: Canvas, reading: Wrench) -> None:
        """Two arrows at the origin of the frame."""
        canvas.arrow("force", reading.force, "N", FORCE)
        canvas.arrow("torque", reading.torque, "N·m", TORQUE)

    def example(self, stamp: float, scale: float) -> Wrench:
        """A push on a tool."""
        force = np.array([1.0, -2.0, -8.0])
        torque = scale * np.cross([0.02, 0.01, 0.05], force)
        return Wrench(stamp=stamp, frame="sensor", force=scale * force, torque=torque)
