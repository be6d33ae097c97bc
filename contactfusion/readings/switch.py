"""Switches, such as bumpers."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.readings.canvas import ACTIVE, PLAIN, Canvas
from contactfusion.readings.codec import Codec
from contactfusion.readings.columns import ColumnsConfig
from contactfusion.readings.messages import Message
from contactfusion.readings.reading import At, Reading
from contactfusion.readings.values import MOVE_ITS_FRAME, Change, Values

RADIUS = 0.02
"""Of the sphere that is drawn [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Switch(Reading):
    """A binary switch such as a bumper.

    Attributes:
        closed: whether it is pressed.
    """

    closed: bool


class SwitchColumns(ColumnsConfig):
    """One column; whatever is not 0 is closed."""

    angles = "none"

    def counts(self) -> tuple[int, ...]:
        """One."""
        return (1,)

    def reading(self, at: At, row: FloatArray) -> Switch:
        """The switch."""
        return Switch(closed=bool(row[0] != 0.0), **at)


class SwitchValues(Values[Switch]):
    """Open or closed."""

    senseless: Mapping[Change, str] = {
        **MOVE_ITS_FRAME,
        Change.ADDED: "which has no number; take 'zeros' or 'stuck'",
    }

    def zeroed(self, reading: Switch) -> Switch:
        """An open switch."""
        return replace(reading, closed=False)


class SwitchCodec(Codec[Switch]):
    """Open or closed, as of a bumper."""

    name = "switch"
    kind = Switch
    messages = ("contactfusion_msgs/msg/Switch",)
    Columns = SwitchColumns
    values = SwitchValues()

    def from_message(self, message: Message, at: At) -> Switch:
        """The switch of a contactfusion_msgs/Switch."""
        return Switch(closed=message.closed, **at)

    def to_message(self, reading: Switch, top: Message) -> Message:
        """A contactfusion_msgs/Switch."""
        return self.message(header=top, closed=bool(reading.closed))

    def draw(self, canvas: Canvas, reading: Switch) -> None:
        """A sphere at the origin of the frame."""
        canvas.spheres(np.zeros((1, 3)), RADIUS, ACTIVE if reading.closed else PLAIN)

    def example(self, stamp: float, scale: float) -> Switch:
        """A switch that is closed at any scale above 1."""
        return Switch(stamp=stamp, frame="sensor", closed=scale > 1.0)
