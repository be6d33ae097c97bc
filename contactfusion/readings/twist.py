"""Twists of bodies, such as the velocity that a base is driven with."""

from dataclasses import dataclass

import numpy as np

from contactfusion.arrays import FloatArray
from contactfusion.readings.codec import Codec
from contactfusion.readings.columns import ColumnsConfig
from contactfusion.readings.messages import Message, twist, xyz
from contactfusion.readings.reading import At, Reading
from contactfusion.readings.values import ScrewValues


@dataclass(frozen=True, kw_only=True, eq=False)
class Twist(Reading):
    """A velocity of `frame`, given in `frame`.

    Attributes:
        linear: shape (3,) [m/s].
        angular: shape (3,) [rad/s].
    """

    linear: FloatArray
    angular: FloatArray

    def _check(self) -> None:
        self._freeze("linear", 3)
        self._freeze("angular", 3)


class TwistColumns(ColumnsConfig):
    """Linear velocity x, y, z [m/s], then angular velocity x, y, z [rad/s]."""

    angles = "some"

    def counts(self) -> tuple[int, ...]:
        """Six."""
        return (6,)

    def reading(self, at: At, row: FloatArray) -> Twist:
        """The twist."""
        return Twist(linear=row[:3], angular=row[3:], **at)


class TwistCodec(Codec[Twist]):
    """Velocity of a frame."""

    name = "twist"
    kind = Twist
    alone = True
    messages = ("geometry_msgs/msg/TwistStamped",)
    Columns = TwistColumns
    values = ScrewValues(
        "linear",
        "angular",
        "angular",
        "6 numbers: linear x, y, z [m/s], angular x, y, z [rad/s]",
    )

    def from_message(self, message: Message, at: At) -> Twist:
        """The twist of a geometry_msgs/TwistStamped."""
        return Twist(linear=xyz(message.twist.linear), angular=xyz(message.twist.angular), **at)

    def to_message(self, reading: Twist, top: Message) -> Message:
        """A geometry_msgs/TwistStamped."""
        return self.message(header=top, twist=twist(reading.linear, reading.angular))

    def example(self, stamp: float, scale: float) -> Twist:
        """A base that moves along its diagonal."""
        linear = 0.1 * scale * np.ones(3)
        return Twist(stamp=stamp, frame="base", linear=linear, angular=np.zeros(3))
